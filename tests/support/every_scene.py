"""Small scenes of every kind with their results.

They run compiled or in plain Python (NUMBA_DISABLE_JIT=1).
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from core import ALL, EVERYTHING, OMEGA, drive_of, scene_of
from numpy.typing import ArrayLike, NDArray
from orbit_cases import paper_case

from impact_env.controlled import ControlledRuns
from impact_env.drive import Drive
from impact_env.laws import SceneKind
from impact_env.loads import Loads, Samples
from impact_env.methods import Method, Moreau, RungeKutta
from impact_env.modes import ModalModel
from impact_env.parameters import (
    Absorber,
    Beam,
    CompliantWalls,
    ElasticCoulombFriction,
    NonlinearSink,
    SeveralAbsorbers,
    SlidingAbsorber,
    StuckAbsorber,
    TunedAbsorber,
    YieldingWalls,
    friction_damper,
    impact_absorber,
    impact_absorbers,
)
from impact_env.periodic.survey import closed_form_orbits
from impact_env.results import Record, Response
from impact_env.scene import Scene, beam_scene
from impact_env.sweep import simulate

# Scenes of every kind of contact, for comparisons with the references.


SCENES: dict[str, Absorber] = {
    "friction": friction_damper(0.3),
    "impacts": impact_absorber(restitution=0.8),
    "impacts and friction": impact_absorber(restitution=0.6, friction_limit=0.1),
    "chatter": impact_absorber(restitution=0.3),
    "no rebound": impact_absorber(restitution=0.0, friction_limit=0.05),
    "springs": SlidingAbsorber(walls=CompliantWalls(3e5)),
    "elastic friction": SlidingAbsorber(friction=ElasticCoulombFriction(0.5, 7e4)),
    "springs and elastic friction": SlidingAbsorber(
        walls=CompliantWalls(7e5, 3e-4), friction=ElasticCoulombFriction(0.1, 7e4)
    ),
    "tuned": TunedAbsorber(),
    "stuck": StuckAbsorber(),
}
STUCK_WITH_FREE = SeveralAbsorbers(
    (
        impact_absorber(3e-4, 0.6, 0.05, 0.012),
        impact_absorber(2e-4, 0.8, 0.15, 0.02),
        friction_damper(0.1, 0.01),
    ),
    (1.0, 0.7, 0.5),
)
TORN = SeveralAbsorbers(
    (
        impact_absorber(1e-3, 0.0, None, 0.5),
        impact_absorber(1e-4, 0.0, None, 0.5),
        friction_damper(1.0, 0.25),
    ),
    (1.0, 1.0, 1.0),
)
HELD = Beam(modes=2, damping_ratio=0.05)


def ring_scene(
    gaps: Sequence[float],
    restitution: float,
    friction_limit: float | None = None,
    coupling: float = 0.05,
    wave_number: int = 1,
    gravity: float = 0.0,
) -> Scene:
    """Return a ring of equal sectors of 1 kg with an absorber of 2 % in each.

    All its eigenvalues except one or two occur twice.
    """
    n = len(gaps)
    neighbours = np.roll(np.eye(n), 1, axis=0) + np.roll(np.eye(n), -1, axis=0)
    stiffness = OMEGA**2 * ((1 + 2 * coupling) * np.eye(n) - coupling * neighbours)
    square, shapes = np.linalg.eigh(stiffness)
    force = np.cos(2 * np.pi * wave_number * np.arange(n) / n)
    model = ModalModel(
        np.sqrt(square), np.full(n, 0.01), shapes.T @ force, shapes[0], float(n), shapes
    )
    absorbers = tuple(
        replace(impact_absorber(gap, restitution, friction_limit, 0.02 / n), gravity=gravity)
        for gap in gaps
    )
    return Scene(model, SeveralAbsorbers(absorbers, (1.0,) * n))


# name: scene, force in N, frequency ratio, pseudo periods
SEVERAL: dict[str, tuple[Scene, float, float, float]] = {
    "impacts of three": (
        beam_scene(
            Beam(modes=3),
            impact_absorbers(
                (3e-4, 1e-4, 2e-4), (1.0, 0.55, 0.8), (0.8, 1.0, 0.9), shares=(0.5, 0.2, 0.3)
            ),
        ),
        4.0,
        0.98,
        2.5,
    ),
    "sticking beside impacts": (beam_scene(Beam(modes=2), STUCK_WITH_FREE), 4.0, 0.98, 2.3),
    "torn loose": (beam_scene(Beam(modes=1, damping_ratio=0.0), TORN), 10.0, 1.0, 1.5),
    "chatter of two": (
        beam_scene(
            HELD, impact_absorbers((1e-5, 1e-5), (1.0, 0.8), restitution=0.0, mass_ratio=0.2)
        ),
        5.0,
        0.3,
        2.9,
    ),
    "ring of six": (ring_scene((2e-4, 3e-4, 2.5e-4, 2.2e-4, 2.8e-4, 3.5e-4), 0.8), 40.0, 1.02, 1.5),
    "ring of five with friction": (
        ring_scene((2e-4, 3e-4, 2.5e-4, 2.2e-4, 1.5e-4), 0.7, 0.6),
        40.0,
        1.02,
        1.3,
    ),
}
LEVEL = Record(events=True)
DRIVE = drive_of(12.0, 0.98, 1.02, periods=2.0, phase=0.4)
SHORT_DRIVE = drive_of(
    12.0, 0.98, 1.0, phase=0.4, periods=1.0
)  # for kinds that take long in plain Python
Values = dict[str, NDArray[Any]]


def collect_arrays(named: Iterable[tuple[str, ArrayLike | None]]) -> Values:
    """Return those that are not None, as arrays."""
    return {name: np.ascontiguousarray(values) for name, values in named if values is not None}


def bits(values: Values) -> dict[str, str]:
    """Return the bytes of each array in hexadecimal."""
    return {name: array.tobytes().hex() for name, array in values.items()}


def fields(result: object, *names: str) -> list[tuple[str, ArrayLike | None]]:
    return [(name, getattr(result, name)) for name in names] if result is not None else []


def values_of(response: Response) -> Values:
    named = fields(response, "end_state", "stuck_time")
    named += fields(response.level, "value", "time", "max_tip")
    impacts = fields(
        response.impacts, "time", "relative_velocity", "impulse", "energy_lost", "absorber"
    )
    named += [(f"impact {name}", value) for name, value in impacts]
    named += [
        (f"phase {name}", value) for name, value in fields(response.phases, "start", "end", "kind")
    ]
    named += fields(
        response.history,
        "modal_displacement",
        "modal_velocity",
        "absorber_displacement",
        "absorber_velocity",
    )
    named += fields(
        response.energy, "work", "modal_loss", "friction_loss", "impact_loss", "absorber_damping"
    )
    named += [
        (f"envelope {name}", value) for name, value in fields(response.envelope, "low", "high")
    ]
    named += [(f"reversal {name}", value) for name, value in fields(response.reversals, "time")]
    return collect_arrays(named)


def swept(
    absorber: Absorber | SeveralAbsorbers | None,
    method: Method | None = None,
    record: Record = ALL,
    drive: Drive = DRIVE,
) -> Callable[[], Values]:
    return lambda: values_of(simulate(scene_of(absorber, modes=2), drive, method, record=record))


def under_loads(absorber: Absorber | None) -> Callable[[], Values]:
    """Return a run under a record and a harmonic force."""

    def run() -> Values:
        end = float(SHORT_DRIVE.schedule.times[-1])
        record = Samples(np.linspace(0.0, end, 9), np.cos(np.arange(9.0) ** 2))
        return values_of(
            simulate(
                scene_of(absorber, modes=2),
                Loads((SHORT_DRIVE, record), OMEGA),
                record=EVERYTHING,
            )
        )

    return run


def controlled(absorber: Absorber | None, method: Method | None = None) -> Callable[[], Values]:
    """Return a run of two lanes in intervals, as an environment makes."""

    def run() -> Values:
        runs = ControlledRuns(
            scene_of(absorber, modes=2),
            2,
            OMEGA,
            1.0,
            method,
            samples_per_period=32,
            exponent=4.0,
            threads=2,
        )
        runs.orders["omega_start"] = runs.orders["omega_stop"] = OMEGA
        runs.orders["force"] = [6.0, 3.0]
        named: list[tuple[str, ArrayLike | None]] = []
        for k in range(3):
            runs.advance()
            named += [(f"report {k}", np.array(runs.reports)), (f"state {k}", runs.state.copy())]
            if runs.scene.kind is SceneKind.RIGID:
                runs.orders["gap"] *= 1.1
            runs.orders["fresh"] = False
        runs.close()
        return collect_arrays(named)

    return run


def orbits() -> Values:
    """Return periodic orbits from the closed form, and the derivatives of their return maps."""
    solutions = closed_form_orbits(paper_case(2, 0.9523, 1.5, friction=0.01)).orbits
    assert solutions
    named: list[tuple[str, ArrayLike | None]] = []
    for k, orbit in enumerate(solutions):
        named += [
            (f"{name} {k}", value) for name, value in fields(orbit.solution, "phases", "impulses")
        ]
        named += [
            (f"largest {k}", orbit.motion.tip_max),
            (f"derivative {k}", orbit.motion.derivative),
        ]
    return collect_arrays(named)


SOFT = SlidingAbsorber(0.05, CompliantWalls(1e5, 5e-4), ElasticCoulombFriction(0.1, 1e5))
EVERY: dict[str, Callable[[], Values]] = {
    "no absorber": swept(None),
    "stuck": swept(StuckAbsorber()),
    "tuned": swept(TunedAbsorber()),
    "impacts without loss": swept(impact_absorber()),
    "impacts with loss": swept(impact_absorber(restitution=0.7)),
    "impacts on walls that yield": swept(SlidingAbsorber(walls=YieldingWalls(0.01))),
    "impacts and friction": swept(impact_absorber(5e-4, 0.3, 0.1)),
    "friction damper": swept(friction_damper(0.3)),
    "compliant walls": swept(SlidingAbsorber(walls=CompliantWalls(1e6))),
    "elastic friction": swept(SlidingAbsorber(friction=ElasticCoulombFriction(0.1, 1e5))),
    "compliant walls and elastic friction": swept(SOFT),
    "several absorbers": swept(
        impact_absorbers((3e-4, 5e-4), (1.0, 0.6), 0.7, 0.04), drive=SHORT_DRIVE
    ),
    "a friction damper beside an impact absorber": swept(
        SeveralAbsorbers((impact_absorber(3e-4, 0.7, 0.04), friction_damper(0.04)), (1.0, 0.6)),
        drive=SHORT_DRIVE,
    ),
    "Moreau": swept(impact_absorber(5e-4, 0.3, 0.1), Moreau(200)),
    "Runge-Kutta": swept(SOFT, RungeKutta(50, 50)),
    "Runge-Kutta, nonlinear sink": swept(NonlinearSink(1e6), RungeKutta(50)),
    "Runge-Kutta, tuned": swept(TunedAbsorber(), RungeKutta(50)),
    "level": swept(impact_absorber(restitution=0.7, friction_limit=0.1), record=LEVEL),
    "level, no absorber": swept(None, record=LEVEL),
    "level, Moreau": swept(impact_absorber(), Moreau(100), LEVEL),
    "intervals": controlled(impact_absorber(restitution=0.7, friction_limit=0.1)),
    "intervals, no absorber": controlled(None),
    "intervals, compliant walls": controlled(SlidingAbsorber(walls=CompliantWalls(1e5))),
    "intervals, Moreau": controlled(impact_absorber(restitution=0.7), Moreau(100)),
    "intervals, Runge-Kutta": controlled(
        SlidingAbsorber(walls=CompliantWalls(1e5)), RungeKutta(20)
    ),
    "loads": under_loads(impact_absorber(5e-4, 0.3, 0.1)),
    "orbits": orbits,
}
