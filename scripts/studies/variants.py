"""Scenes with observers for studies of compiled code.

Each combination of absorber, method and observers has its own compiled code. For comparison, the
module has scenes whose compiled code is more general than necessary: a part is present, but has no
effect because of its value, such as walls out of reach.
"""

from collections.abc import Callable
from dataclasses import dataclass

from impact_env import Drive, Record, Scene, beam_scene, constant_frequency, impact_absorbers
from impact_env.methods import Exact, Method, Moreau, RungeKutta
from impact_env.parameters import (
    Absorber,
    Beam,
    CompliantWalls,
    CoulombFriction,
    ElasticCoulombFriction,
    RigidWalls,
    SlidingAbsorber,
    StuckAbsorber,
    TunedAbsorber,
    friction_damper,
    impact_absorber,
)

MODES = 10
FORCE = 3.5
RATIO = 0.98
OUT_OF_REACH = 1e6  # m: gap of walls that the absorber never reaches
# N: friction without any effect. A limit of 0 would remove the friction law from the scene. A still
# smaller limit could give subnormal numbers, with which some processors are slow.
NO_FRICTION = 1e-200
SPRING = 100 * Beam().static_tip_stiffness

ABSORBERS: dict[str, Callable[[], Absorber | None]] = {
    "no absorber": lambda: None,
    "stuck": StuckAbsorber,
    "tuned": TunedAbsorber,
    "friction damper": lambda: friction_damper(0.1),
    "impact": lambda: impact_absorber(restitution=0.7),
    "impact and friction": lambda: impact_absorber(restitution=0.7, friction_limit=0.1),
    "compliant": lambda: SlidingAbsorber(walls=CompliantWalls(SPRING)),
    "compliant and elastic friction": lambda: SlidingAbsorber(
        walls=CompliantWalls(SPRING), friction=ElasticCoulombFriction(0.1, SPRING)
    ),
    "two impact absorbers": lambda: impact_absorbers((1e-3, 1e-3), (0.8, 1.0), 0.7, 0.05),
    # more general scenes, with a part that has no effect
    "impact out of reach": lambda: impact_absorber(OUT_OF_REACH, 0.7),
    "impact out of reach, and friction": lambda: SlidingAbsorber(
        walls=RigidWalls(OUT_OF_REACH, 0.7), friction=CoulombFriction(0.1)
    ),
    "impact, and friction without effect": lambda: impact_absorber(
        restitution=0.7, friction_limit=NO_FRICTION
    ),
    "nothing in reach, friction without effect": lambda: impact_absorber(
        OUT_OF_REACH, 0.7, NO_FRICTION
    ),
    "compliant out of reach": lambda: SlidingAbsorber(walls=CompliantWalls(SPRING, OUT_OF_REACH)),
    "compliant, and friction without effect": lambda: SlidingAbsorber(
        walls=CompliantWalls(SPRING), friction=ElasticCoulombFriction(NO_FRICTION, SPRING)
    ),
}
METHODS: dict[str, Method] = {"exact": Exact(), "moreau": Moreau(), "runge-kutta": RungeKutta()}
RECORDS = {
    "nothing": Record(level=False),
    "level": Record(),
    "level and events": Record(events=True),
    "level and energy": Record(energy=True),
    "level and samples": Record(series=True),
    "everything": Record(events=True, series=True, energy=True),
}


@dataclass(frozen=True)
class KernelVariant:
    """A scene, a method and observers: keys of `ABSORBERS`, `METHODS` and `RECORDS`."""

    absorber: str
    method: str = "exact"
    record: str = "level"

    @property
    def name(self) -> str:
        """Absorber and method, and the key of the record if it is not the level alone."""
        return f"{self.absorber}, {self.method}" + (
            "" if self.record == "level" else f", {self.record} recorded"
        )

    @property
    def kind(self) -> str:
        """Name of the compiled code: method, types of the absorber's parts, and record.

        Variants with the same kind use the same compiled code.
        """
        absorber = self.scene().absorber
        parts = (
            (absorber.walls, absorber.friction)
            if isinstance(absorber, SlidingAbsorber)
            else (absorber,)
        )
        return f"{self.method}, {' '.join(type(part).__name__ for part in parts)}, {self.record}"

    def scene(self) -> Scene:
        """Return the beam (`MODES` modes) with the absorber."""
        return beam_scene(Beam(modes=MODES), ABSORBERS[self.absorber]())

    def drive(self, periods: float) -> Drive:
        """Return a drive of ``periods`` pseudo periods at `RATIO` times the first resonance."""
        return Drive(
            FORCE, constant_frequency(self.scene().model.resonance_omega(1), RATIO, periods)
        )


OWN = (
    *(KernelVariant(name) for name in list(ABSORBERS)[:8]),
    *(KernelVariant(name, "moreau") for name in ("no absorber", "impact", "impact and friction")),
    *(KernelVariant(name, "runge-kutta") for name in ("no absorber", "compliant")),
    *(KernelVariant("impact", record=record) for record in RECORDS if record != "level"),
)
QUICK_OWN = tuple(
    variant
    for variant in OWN
    if variant
    in (KernelVariant("no absorber"), KernelVariant("impact"), KernelVariant("impact and friction"))
)


@dataclass(frozen=True)
class Pair:
    """Two variants with the same motion: one lacks a part, in the other it has no effect.

    ``part`` names the part and the method, for tables.
    """

    part: str
    without: KernelVariant
    switched_off: KernelVariant


PAIRS = (
    Pair(
        "walls (exact, no friction)",
        KernelVariant("no absorber"),
        KernelVariant("impact out of reach"),
    ),
    Pair(
        "walls and friction (exact)",
        KernelVariant("no absorber"),
        KernelVariant("nothing in reach, friction without effect"),
    ),
    Pair(
        "walls (exact, with friction)",
        KernelVariant("friction damper"),
        KernelVariant("impact out of reach, and friction"),
    ),
    Pair(
        "friction (exact)",
        KernelVariant("impact"),
        KernelVariant("impact, and friction without effect"),
    ),
    Pair(
        "compliant walls (exact)",
        KernelVariant("no absorber"),
        KernelVariant("compliant out of reach"),
    ),
    Pair(
        "elastic friction (exact)",
        KernelVariant("compliant"),
        KernelVariant("compliant, and friction without effect"),
    ),
    Pair(
        "walls (Moreau)",
        KernelVariant("no absorber", "moreau"),
        KernelVariant("impact out of reach", "moreau"),
    ),
    Pair(
        "friction (Moreau)",
        KernelVariant("impact", "moreau"),
        KernelVariant("impact, and friction without effect", "moreau"),
    ),
    Pair(
        "walls (Runge-Kutta)",
        KernelVariant("no absorber", "runge-kutta"),
        KernelVariant("compliant out of reach", "runge-kutta"),
    ),
    *(
        Pair(
            f"{record} recorded",
            KernelVariant("impact", record="nothing"),
            KernelVariant("impact", record=record),
        )
        for record in RECORDS
        if record != "nothing"
    ),
)


def own(quick: bool) -> tuple[KernelVariant, ...]:
    """Return the variants whose own compiled code is studied; ``quick``: three of them."""
    return QUICK_OWN if quick else OWN


def pairs(quick: bool) -> tuple[Pair, ...]:
    """Return the pairs of which `own` contains the compiled code of both variants."""
    kinds = {variant.kind for variant in own(quick)}
    return tuple(pair for pair in PAIRS if {pair.without.kind, pair.switched_off.kind} <= kinds)
