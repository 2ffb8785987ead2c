"""The scenes of the work-precision diagrams, and where their runs start: in the midst of motion, so that errors and times are those of impacts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from impact_env.drive import PAPER_RATE, Drive, FrequencySchedule, linear_sweep
from impact_env.laws import SceneKind
from impact_env.methods import Exact, Method, Moreau, RungeKutta
from impact_env.parameters import Absorber, Beam, CompliantWalls, SlidingAbsorber, TunedAbsorber, friction_damper, impact_absorber
from impact_env.response import Record
from impact_env.scene import InitialState, Scene, beam_scene
from impact_env.sweep import simulate

MODES = (1, 3, 10, 30)
START = 0.95  # of the first resonance
RUN_IN, APART = 40.0, 6.3  # pseudo periods from rest until the first case of a scene starts, and between two of them
STATIC = Beam().static_tip_stiffness
BARE = Record(level=False)
WATCHED = Record(level=False, events=True, series=True, energy=True)  # one set of observers, so that each kernel is compiled once


@dataclass(frozen=True)
class Kind:
    """A scene for any number of modes, at a force in N."""

    name: str
    absorber: Callable[[], Absorber | None]
    force: float


KINDS = (
    Kind("no absorber", lambda: None, 5.0),
    Kind("tuned absorber (LTVA)", TunedAbsorber, 5.0),
    Kind("friction damper", friction_damper, 3.5),
    Kind("impact, e = 1", impact_absorber, 5.0),
    Kind("impact, e = 0.7", lambda: impact_absorber(restitution=0.7), 5.0),
    Kind("impact, e = 0.7, with friction", lambda: impact_absorber(restitution=0.7, friction_limit=0.1), 3.5),
    Kind("compliant walls, soft", lambda: SlidingAbsorber(walls=CompliantWalls(STATIC)), 5.0),
    Kind("compliant walls, stiff", lambda: SlidingAbsorber(walls=CompliantWalls(1e4 * STATIC)), 5.0),
)


def kind_named(name: str) -> Kind:
    """Return the kind of this name."""
    return next(kind for kind in KINDS if kind.name == name)


@dataclass(frozen=True, eq=False)
class Case:
    """A scene with a start in the midst of motion. ``omega`` (rad/s) and ``phase`` (rad) are those of the force there."""

    kind: Kind
    scene: Scene
    initial: InitialState
    omega: float
    phase: float

    @property
    def modes(self) -> int:
        """Number of modes."""
        return self.scene.model.modes

    @property
    def period(self) -> float:
        """A pseudo period in s."""
        return self.scene.model.pseudo_period()

    def drive(self, periods: float) -> Drive:
        """Return the drive that goes on from the start at the paper's rate for a number of pseudo periods."""
        reference = self.scene.model.resonance_omega(1)
        rise = periods * PAPER_RATE / 1e4 * reference
        schedule = FrequencySchedule(np.array([0.0, periods * self.period]), np.array([self.omega, self.omega + rise]), reference)
        return Drive(self.kind.force, schedule, self.phase)

    @property
    def moving(self) -> bool:
        """Whether the scene has an absorber whose coordinate counts."""
        return self.scene.absorber is not None

    def methods(self, steps: tuple[int, ...]) -> list[Method]:
        """Return the methods that can do the scene; ``steps`` are those per period of the highest mode, and per contact."""
        compliant = isinstance(self.scene.absorber, SlidingAbsorber) and isinstance(self.scene.absorber.walls, CompliantWalls)
        result: list[Method] = [Exact()]
        if not compliant:
            result += [Moreau(count) for count in steps]
        if compliant or self.scene.kind is SceneKind.LINEAR:
            result += [RungeKutta(count, count) for count in steps]
        return result


def method_name(method: Method, scene: Scene) -> str:
    """Return a method's name in tables and figures."""
    if isinstance(method, Exact):
        return "closed form" if scene.kind is SceneKind.LINEAR else "Exact"
    return type(method).__name__ if isinstance(method, Moreau) else "Runge-Kutta"


@lru_cache(maxsize=256)
def case(kind: Kind, modes: int, number: int = 0) -> Case:
    """Run a scene in with the exact method, and start where its absorber moves freely; each ``number`` starts later than the one before."""
    scene = beam_scene(Beam(modes=modes), kind.absorber())
    reference = scene.model.resonance_omega(1)
    period = 2 * np.pi / reference
    for k in range(40):
        periods = RUN_IN + APART * number + 0.137 * k
        schedule = linear_sweep(reference, START, START + periods * PAPER_RATE / 1e4)
        state = simulate(scene, Drive(kind.force, schedule), record=BARE).end_state
        initial = InitialState(state[:modes], state[modes + 1 : 2 * modes + 1], float(state[modes]), float(state[-1]))
        if _moves_freely(scene, state):
            phase = float(np.mod(schedule.phase_at(periods * period), 2 * np.pi))
            return Case(kind, scene, initial, float(schedule.omegas[-1]), phase)
    raise RuntimeError(f"{kind.name}, {modes} modes: the absorber is never found in free motion")


def _moves_freely(scene: Scene, state: np.ndarray) -> bool:
    absorber, n, tip = scene.absorber, scene.model.modes, scene.model.tip_shape
    if not isinstance(absorber, SlidingAbsorber):
        return True
    y, gamma = state[n] - tip @ state[:n], state[-1] - tip @ state[n + 1 : 2 * n + 1]
    slides = abs(gamma) > 1e-3 * abs(state[-1])
    inside = absorber.walls is None or abs(y) < 0.9 * absorber.walls.gap
    return bool(slides and inside)
