"""The cases of the study of regimes, and how much of each is computed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from impact_env.ensemble import Executor
from impact_env.modes import ModalModel
from impact_env.parameters import Beam, count, finite, impact_absorber, positive, require
from impact_env.periodic.jump import Range
from impact_env.periodic.residence import Approach
from impact_env.scene import Scene, beam_scene

PAPER, STRIP, RECOMMENDED = "paper", "strip", "recommended"


@dataclass(frozen=True, eq=False)
class Case:
    """A scene under a force (N) and what is asked of it; ratios are of its first resonance, times in its pseudo periods.

    ``stay_ratios``: where rates of leaving are measured; ``kind_ratios``: where responses are classified; ``slownesses`` of sweeps, in pseudo periods
    per percent, over ``sweep`` (None: no sweeps). ``approach_ratio``: where runs come into impact. ``high_level`` in m, to compare with; None: not.
    ``both_ways``: ratios between which sweeps down and up are compared, None: not.
    """

    name: str
    title: str
    scene: Scene
    force: float
    approach_ratio: float
    stay_ratios: tuple[float, ...] = ()
    slownesses: tuple[float, ...] = ()
    sweep: Range | None = None
    kind_ratios: tuple[float, ...] = ()
    high_level: float | None = None
    both_ways: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        finite("force", self.force)
        positive("approach_ratio", self.approach_ratio)
        for slowness in self.slownesses:
            positive("slowness", slowness)

    @property
    def approach(self) -> Approach:
        """How lanes come into impact."""
        return Approach(self.scene.model.resonance_omega(1), self.approach_ratio)


@dataclass(frozen=True)
class Settings:
    """How much to compute, the same for all cases: members of each kind, and times in pseudo periods (the window's in periods of the force).

    ``executor``: as in `run_lanes`.
    """

    cases: tuple[Case, ...]
    stay_members: int = 200
    stay_periods: float = 8000.0
    burn_in: float = 100.0
    silence: float = 100.0
    sweep_members: int = 2000
    kind_members: int = 40
    settle: float = 1500.0
    window: int = 300
    seed: int = 0
    threads: int | None = None
    executor: Executor | None = None
    quick: bool = False

    def __post_init__(self) -> None:
        for name in ("stay_members", "sweep_members", "kind_members"):
            count(name, getattr(self, name), 1)
        count("seed", self.seed, 0)
        positive("silence", self.silence)
        require(self.stay_periods > self.silence, "stay_periods", self.stay_periods, f"more than a silence, {self.silence}")


def grid(first: float, last: float, points: int) -> tuple[float, ...]:
    """Return equidistant ratios, rounded so that they can be written down; at least 2."""
    count("points", points, 2)
    return tuple(np.round(np.linspace(positive("first ratio", first), positive("last ratio", last), points), 6).tolist())


def strip_scene() -> Scene:
    """Return a simply supported strip of 1 kg, three modes known in closed form, forced at 0.3 and with the absorber at 0.45 of its length."""
    number = np.arange(1.0, 4.0)
    force, absorber = (2**0.5 * np.sin(number * np.pi * place) for place in (0.3, 0.45))
    model = ModalModel(180.0 * number**2, np.full(3, 0.006), force, absorber, 1.0)
    return Scene(model, impact_absorber(gap=2e-3, mass_ratio=0.03, friction_limit=0.03))


@cache
def cases() -> tuple[Case, ...]:
    """Return the page's cases."""
    paper = beam_scene(Beam(modes=2), impact_absorber(friction_limit=0.025))
    recommended = beam_scene(Beam(), impact_absorber(restitution=0.7, friction_limit=0.1))
    return (
        Case(
            PAPER, "the paper's beam, 2 modes, friction limit 0.025 N, e = 1, 1.5 N, down", paper, 1.5, 1.0, grid(0.988, 0.952, 37),
            (20.0, 50.0, 100.0, 200.0, 500.0, 1000.0, 1450.0, 2000.0), Range(1.0, 0.988, 0.952, 0.9), grid(0.9, 1.06, 65), 0.75e-3, (0.972, 0.958),
        ),
        Case(
            STRIP, "a simply supported strip, 3 modes, friction limit 0.03 N, e = 1, 0.75 N, down", strip_scene(), 0.75, 1.0, grid(1.0, 0.956, 23),
            (20.0, 40.0, 70.0, 100.0, 150.0, 200.0, 300.0, 500.0, 800.0), Range(1.002, 1.0, 0.956, 0.9),
        ),
        Case(
            RECOMMENDED, "the paper's beam, 10 modes, friction limit 0.1 N, e = 0.7, 3.5 N", recommended, 3.5, 1.0,
            kind_ratios=(*grid(0.946, 0.998, 27), *grid(1.0, 1.04, 5)),
        ),
    )  # fmt: skip
