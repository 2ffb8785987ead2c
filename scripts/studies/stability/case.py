"""A case of the stability matrix, and the absorbers that its cases are made of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from impact_env import (
    Beam,
    CompliantWalls,
    Drive,
    ElasticCoulombFriction,
    InitialState,
    RigidWalls,
    Scene,
    SlidingAbsorber,
    StuckAbsorber,
    TunedAbsorber,
    beam_scene,
    constant_frequency,
    friction_damper,
    impact_absorber,
)
from impact_env.parameters import Absorber

STATIC = Beam().static_tip_stiffness  # 3 EI / l^3 in N/m
GAP = RigidWalls.gap
NEAR = 0.98  # of the first resonance: where the impact absorber works
EXACT, MOREAU, RUNGE_KUTTA = "exact", "moreau", "runge-kutta"
METHODS = (EXACT, MOREAU, RUNGE_KUTTA)


@dataclass(frozen=True, eq=False)
class Case:
    """One line of the matrix. ``build`` gives scene, drive and start, or raises ParameterError where the parameters are already refused.

    ``impacts``: up to which impact the reference is followed. ``must_refuse``: there is no right answer, every method has to say so. ``conserved``:
    nothing takes or gives energy. ``methods``: those that can be asked for in a reasonable time.
    """

    group: str
    name: str
    build: Callable[[], tuple[Scene, Drive, InitialState]]
    quick: bool = False
    impacts: int = 3
    must_refuse: bool = False
    conserved: bool = False
    methods: tuple[str, ...] = METHODS


def make_case(
    group: str,
    name: str,
    absorber: Callable[[], Absorber | None],
    *,
    modes: int = 3,
    force: float = 5.0,
    periods: float = 6.0,
    ratio: float = NEAR,
    drive: Callable[[Scene], Drive] | None = None,
    start: Callable[[Scene], InitialState] | None = None,
    beam: dict[str, object] | None = None,
    **options: object,
) -> Case:
    """Return a case on the beam (its parameters in ``beam``) at ``ratio`` times the first resonance; ``options`` are `Case`'s."""

    def build() -> tuple[Scene, Drive, InitialState]:
        scene = beam_scene(Beam(**({"modes": modes} | (beam or {}))), absorber())  # type: ignore[arg-type]
        schedule = constant_frequency(scene.model.resonance_omega(1), ratio, periods)
        return scene, drive(scene) if drive else Drive(force, schedule), start(scene) if start else InitialState()

    return Case(group, name, build, **options)  # type: ignore[arg-type]


def impact() -> Absorber:
    """Return rigid walls with a usual restitution."""
    return impact_absorber(restitution=0.7)


def rubbing() -> Absorber:
    """Return the same with friction."""
    return impact_absorber(restitution=0.7, friction_limit=0.1)


def soft(stiffness: float = 100 * STATIC, mass_ratio: float = 0.02) -> Absorber:
    """Return compliant walls of a stiffness in N/m."""
    return SlidingAbsorber(mass_ratio, CompliantWalls(stiffness))


def elastic(limit: float = 0.1, stiffness: float = STATIC, walls: bool = True) -> Absorber:
    """Return elastic friction with a limit in N and a stiffness in N/m, with or without compliant walls."""
    return SlidingAbsorber(walls=CompliantWalls(100 * STATIC) if walls else None, friction=ElasticCoulombFriction(limit, stiffness))


KINDS: dict[str, Callable[[], Absorber | None]] = {
    "no absorber": lambda: None,
    "stuck": StuckAbsorber,
    "tuned": TunedAbsorber,
    "impact": impact,
    "impact and friction": rubbing,
    "friction damper": friction_damper,
    "compliant": soft,
    "compliant and elastic friction": elastic,
}
