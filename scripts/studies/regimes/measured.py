"""The cases of the study of regimes, and their measurements as rows of plain values.

The module also has the amount of computation for each.

Stays and sweeps belong to the part jump, responses to the part kinds.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, partial
from itertools import product
from operator import itemgetter
from typing import Any

import numpy as np

from impact_env import ModalModel, Scene, beam_scene
from impact_env.checks import count, finite, positive, require
from impact_env.ensemble import Executor, draw_members
from impact_env.parameters import Beam, impact_absorber
from impact_env.periodic.residence import Approach, Range, exit_rate, jumps, residence_times
from impact_env.periodic.stationary import QUANTILES, ResponseKind, classify_members, envelope
from studies.study import not_none

PAPER = "paper"
STRIP = "strip"
RECOMMENDED = "recommended"


@dataclass(frozen=True, eq=False)
class RegimeCase:
    """A scene under a force (N) and the measurements for it.

    Ratios are relative to its first resonance, and times are in its pseudo periods.

    Attributes
    ----------
    approach_ratio : float
        Frequency ratio at which runs begin to have impacts.
    stay_ratios, kind_ratios : tuple of float
        Ratios at which escape rates are measured, and at which responses are classified.
    slownesses, sweep : tuple of float, and Range or None
        Pseudo periods per percent of the sweeps, and their range (None: no sweeps).
    high_level : float or None
        Level of the high branch in m.
    both_ways : tuple or None
        Ratios between which sweeps down and up are compared.
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
        """The approach to the regime of impacts."""
        return Approach(self.scene.model.resonance_omega(1), self.approach_ratio)


@dataclass(frozen=True)
class RegimeSettings:
    """Amount of computation, the same for all cases.

    It has the members of each kind, and times in pseudo periods (``window`` is in periods of the
    force).

    ``executor``: as in `run_lanes`.
    """

    cases: tuple[RegimeCase, ...]
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
        require(
            self.stay_periods > self.silence,
            "stay_periods",
            self.stay_periods,
            f"more than a silence, {self.silence}",
        )


def grid(first: float, last: float, points: int) -> tuple[float, ...]:
    """Return equidistant ratios, rounded so that they can be written down; at least 2."""
    count("points", points, 2)
    return tuple(
        np.round(
            np.linspace(positive("first ratio", first), positive("last ratio", last), points), 6
        ).tolist()
    )


def strip_scene() -> Scene:
    """Return a simply supported strip of 1 kg with an absorber.

    Its three modes are known in closed form. The force acts at 0.3 and the absorber at 0.45 of its
    length.
    """
    number = np.arange(1.0, 4.0)
    force, absorber = (2**0.5 * np.sin(number * np.pi * place) for place in (0.3, 0.45))
    model = ModalModel(180.0 * number**2, np.full(3, 0.006), force, absorber, 1.0)
    return Scene(model, impact_absorber(gap=2e-3, mass_ratio=0.03, friction_limit=0.03))


@cache
def cases() -> tuple[RegimeCase, ...]:
    """Return the page's cases."""
    paper = beam_scene(Beam(modes=2), impact_absorber(friction_limit=0.025))
    recommended = beam_scene(Beam(), impact_absorber(restitution=0.7, friction_limit=0.1))
    return (
        RegimeCase(
            PAPER,
            "the paper's beam, 2 modes, friction limit 0.025 N, e = 1, 1.5 N, down",
            paper,
            1.5,
            1.0,
            grid(0.988, 0.952, 37),
            (20.0, 50.0, 100.0, 200.0, 500.0, 1000.0, 1450.0, 2000.0),
            Range(1.0, 0.988, 0.952, 0.9),
            grid(0.9, 1.06, 65),
            0.75e-3,
            (0.972, 0.958),
        ),
        RegimeCase(
            STRIP,
            "a simply supported strip, 3 modes, friction limit 0.03 N, e = 1, 0.75 N, down",
            strip_scene(),
            0.75,
            1.0,
            grid(1.0, 0.956, 23),
            (20.0, 40.0, 70.0, 100.0, 150.0, 200.0, 300.0, 500.0, 800.0),
            Range(1.002, 1.0, 0.956, 0.9),
        ),
        RegimeCase(
            RECOMMENDED,
            "the paper's beam, 10 modes, friction limit 0.1 N, e = 0.7, 3.5 N",
            recommended,
            3.5,
            1.0,
            kind_ratios=(*grid(0.946, 0.998, 27), *grid(1.0, 1.04, 5)),
        ),
    )


Row = dict[str, Any]
Key = tuple[str, str, float]
STAY = "stay"
SWEEP = "sweep"
RESPONSE = "response"
WAYS = ("down", "up")
# of the resonance, that sweeps either way begin before their range and go on after it
BEFORE = 0.002
AFTER = 0.012
BOTH_WAYS = 100.0, 300.0  # pseudo periods per percent


key = itemgetter("what", "case", "at")  # of a row: its case


def jump_cases(settings: RegimeSettings) -> Mapping[Key, Callable[[], list[Row]]]:
    """Return the measurements: stays at each frequency and sweeps at each slowness."""
    stay = {
        (STAY, case.name, ratio): partial(_stay, case, ratio, settings)
        for case in settings.cases
        for ratio in case.stay_ratios
    }
    sweep = {
        (SWEEP, case.name, slow): partial(_sweep, case, slow, settings)
        for case in settings.cases
        if case.sweep
        for slow in case.slownesses
    }
    both = product((case for case in settings.cases if case.both_ways), BOTH_WAYS, WAYS)
    return {
        **stay,
        **sweep,
        **{
            (way, case.name, slow): partial(_one_way, case, way, slow, settings)
            for case, slow, way in both
        },
    }


def kind_cases(settings: RegimeSettings) -> Mapping[Key, Callable[[], list[Row]]]:
    """Return the measurements of the stationary responses at each frequency."""
    return {
        (RESPONSE, case.name, ratio): partial(_responses, case, ratio, settings)
        for case in settings.cases
        for ratio in case.kind_ratios
    }


def _phases(members: int, seed: int) -> list[float]:
    return draw_members(members, seed, "phase").phases.tolist()


def _stay(case: RegimeCase, ratio: float, settings: RegimeSettings) -> list[Row]:
    drawn = _phases(settings.stay_members, settings.seed)
    length = settings.stay_periods
    at = (case.scene, case.force, case.approach, ratio)
    result = residence_times(
        *at, length, drawn, settings.silence, threads=settings.threads, executor=settings.executor
    )
    rate = exit_rate(result, settings.burn_in)
    late = exit_rate(result, settings.burn_in + length / 8)
    pauses = result.longest_pauses
    return [
        {
            "what": STAY,
            "case": case.name,
            "at": ratio,
            "runs": settings.stay_members,
            "absent": result.absent,
            "returned": result.returned,
            "exits": rate.exits,
            "exposure": rate.exposure,
            "rate": _plain(rate.rate),
            "low": _plain(rate.low),
            "high": _plain(rate.high),
            "late_exits": late.exits,
            "late_exposure": late.exposure,
            "longest_pause": float(np.max(pauses)) if pauses is not None and len(pauses) else None,
        }
    ]


def _sweep(case: RegimeCase, slowness: float, settings: RegimeSettings) -> list[Row]:
    drawn = _phases(settings.sweep_members, settings.seed + 1)
    at = (case.scene, case.force, case.approach, not_none(case.sweep), slowness, drawn)
    limits = (settings.silence, case.high_level)
    result = jumps(*at, *limits, threads=settings.threads, executor=settings.executor)
    low, high = result.interval()
    counts = {
        "runs": result.runs,
        "present": result.present,
        "jumped": result.jumped,
        "high_level": result.high,
    }
    return [
        {
            "what": SWEEP,
            "case": case.name,
            "at": slowness,
            **counts,
            "share": _plain(result.share),
            "low": low,
            "high": high,
        }
    ]


def _one_way(case: RegimeCase, way: str, slowness: float, settings: RegimeSettings) -> list[Row]:
    """Return how many members leave the regime between two ratios in a sweep down or up.

    There are twice the usual number of members. Before a sweep up they come down to its start.
    """
    high, low = not_none(case.both_ways)
    over = (
        Range(high + BEFORE, high, low, low - AFTER)
        if way == WAYS[0]
        else Range(low - BEFORE, low, high, high + AFTER)
    )
    drawn = _phases(2 * settings.sweep_members, settings.seed + 2)
    at = (case.scene, case.force, case.approach, over, slowness, drawn)
    result = jumps(*at, settings.silence, threads=settings.threads, executor=settings.executor)
    row: Row = {
        "what": way,
        "case": case.name,
        "at": slowness,
        "first": over.first,
        "last": over.last,
    }
    return [row | {"present": result.present, "left": len(result.left)}]


MEANS = ("impacts_per_period", "depth", "absorber_share", "impact_loss", "friction_loss")


def _responses(case: RegimeCase, ratio: float, settings: RegimeSettings) -> list[Row]:
    drawn = _phases(settings.kind_members, settings.seed)
    at = (case.scene, case.force, case.approach, ratio)
    lengths = (settings.settle, settings.window)
    members = classify_members(
        *at, *lengths, drawn, threads=settings.threads, executor=settings.executor
    )
    kinds = {
        kind.value: sum(member.classification.kind is kind for member in members)
        for kind in ResponseKind
    }
    multiples = [
        m
        for member in members
        if member.classification.kind is ResponseKind.PERIODIC
        and (m := member.classification.multiple) is not None
    ]
    peaks = dict(
        zip((f"peak_{100 * q:g}" for q in QUANTILES), envelope(members).tolist(), strict=True)
    )
    each = [
        (
            m.classification.impacts_per_period,
            m.classification.depth,
            m.energies.absorber_mean,
            m.energies.impact,
            m.energies.friction,
        )
        for m in members
    ]
    means = {
        name: float(np.mean(values))
        for name, values in zip(MEANS, zip(*each, strict=True), strict=True)
    }
    counted = {str(multiple): multiples.count(multiple) for multiple in sorted(set(multiples))}
    return [
        {
            "what": RESPONSE,
            "case": case.name,
            "at": ratio,
            "runs": len(members),
            **kinds,
            "multiples": counted,
            **means,
            **peaks,
        }
    ]


def _plain(value: float) -> float | None:
    return None if np.isnan(value) else value
