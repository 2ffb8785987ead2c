"""The stiff and extreme cases of the stability report.

Most cases have few modes and short runs, because the slow reference solution, by dense matrix
exponentials, must reach the first impacts.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np

from impact_env import (
    Drive,
    FrequencySchedule,
    InitialState,
    Record,
    Scene,
    beam_scene,
    constant_frequency,
    simulate,
)
from impact_env.checks import ParameterError
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

STATIC = Beam().static_tip_stiffness  # 3 EI / l^3 in N/m
GAP = RigidWalls.gap
NEAR = 0.98  # of the first resonance: where the impact absorber works
EXACT = "exact"
MOREAU = "moreau"
RUNGE_KUTTA = "runge-kutta"
METHODS = (EXACT, MOREAU, RUNGE_KUTTA)


@dataclass(frozen=True, eq=False)
class StabilityCase:
    """One line of the stability report: a run that each method must compute or refuse.

    ``group`` is the quantity that is varied, ``name`` its value. ``build`` returns scene, drive
    and initial state, or raises ParameterError if the parameters are refused. ``quick``: the case
    is part of the quick run. ``impacts`` is the number of impacts up to which the reference is
    computed. ``must_refuse``: every method must refuse the case, because it has no correct result.
    ``conserved``: the energy must stay constant, because nothing dissipates it. ``methods`` are
    those tested, without methods that would take too long.
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
) -> StabilityCase:
    """Return a case of a beam with an absorber.

    The drive has a constant ``force`` (N) and frequency, ``ratio`` times the first resonance, for
    ``periods`` pseudo periods, unless ``drive`` returns another one for the scene. ``start``
    returns the initial state for the scene; None: at rest. ``beam``: further parameters of `Beam`;
    ``options``: further fields of `StabilityCase`.
    """

    def build() -> tuple[Scene, Drive, InitialState]:
        scene = beam_scene(Beam(**({"modes": modes} | (beam or {}))), absorber())  # type: ignore[arg-type]
        schedule = constant_frequency(scene.model.resonance_omega(1), ratio, periods)
        return (
            scene,
            drive(scene) if drive else Drive(force, schedule),
            start(scene) if start else InitialState(),
        )

    return StabilityCase(group, name, build, **options)  # type: ignore[arg-type]


impact = partial(impact_absorber, restitution=0.7)
rubbing = partial(impact, friction_limit=0.1)


def soft(stiffness: float = 100 * STATIC, mass_ratio: float = 0.02) -> Absorber:
    """Return an absorber between compliant walls of a ``stiffness`` in N/m."""
    return SlidingAbsorber(mass_ratio, CompliantWalls(stiffness))


def elastic(limit: float = 0.1, stiffness: float = STATIC, walls: bool = True) -> Absorber:
    """Return an absorber with elastic friction, with or without compliant walls.

    ``limit`` (N) and ``stiffness`` (N/m) are those of the friction.
    """
    return SlidingAbsorber(
        walls=CompliantWalls(100 * STATIC) if walls else None,
        friction=ElasticCoulombFriction(limit, stiffness),
    )


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


def _ordinary() -> Iterator[StabilityCase]:
    """Yield a case with ordinary parameters for each kind of absorber."""
    for name, make in KINDS.items():
        yield make_case("ordinary", name, make, modes=10, quick=True)


def _damping() -> Iterator[StabilityCase]:
    damped = partial(make_case, "damping ratio")
    for ratio in (0.0, 1 - 1e-9, 1.0, 1 + 1e-6, 3.0, 10.0, 1000.0):
        for name in ("no absorber", "stuck", "tuned", "impact and friction", "compliant"):
            quick = name in ("tuned", "impact and friction") and ratio in (0.0, 1.0, 10.0)
            yield damped(
                f"{ratio:.10g}, {name}",
                KINDS[name],
                beam={"damping_ratio": ratio},
                force=50 * max(ratio, 0.1),
                quick=quick,
            )
    # short runs: an unstable step has not overflowed yet, so that its wrong results look plausible
    for ratio, periods in ((3.5, 1.0), (4.5, 0.5), (6.0, 0.3)):
        yield damped(
            f"{ratio:g}, a run of {periods:g} periods",
            lambda: None,
            force=50,
            periods=periods,
            beam={"damping_ratio": ratio},
        )
    yield damped(
        "0 to 5 over the modes, impact", impact, beam={"damping_ratio": (0.0, 0.9, 5.0)}, force=20
    )


def _modes() -> Iterator[StabilityCase]:
    for modes in (1, 30, 60):
        for name in ("no absorber", "stuck", "tuned", "impact", "impact and friction", "compliant"):
            # the highest of all 60 modes is 12,000 times faster than the first
            quick = modes == 60 and name in ("no absorber", "impact")
            yield make_case(
                "modes",
                f"{modes}, {name}",
                KINDS[name],
                modes=modes,
                force=40,
                periods=2,
                impacts=2,
                quick=quick,
            )
    yield make_case(
        "modes",
        "two with one frequency, impact and friction",
        rubbing,
        beam={"modal_frequency_ratio": {2: 1 + 1e-12}},
    )
    yield make_case(
        "modes",
        "two with one frequency, tuned",
        TunedAbsorber,
        beam={"modal_frequency_ratio": {2: 1 + 1e-12}},
    )
    yield make_case(
        "modes",
        "a node at the absorber, impact and friction",
        rubbing,
        beam={"absorber_position": 0.7834442},
        force=20,
    )


def _gaps() -> Iterator[StabilityCase]:
    for gap in (0.0, 1e-12, 1e-7, 1e-5, 1.0, 1e6, np.inf):
        for friction in (None, 0.1):
            name = f"{gap:g} m" + ("" if friction is None else ", friction")
            make = partial(impact_absorber, gap, 0.7, friction)
            yield make_case(
                "gap", name, make, quick=gap in (0.0, np.inf, 1e-7) and friction is not None
            )
    for gap in (0.0, 1e-9, 1e6):
        yield make_case(
            "gap",
            f"{gap:g} m, compliant",
            partial(SlidingAbsorber, walls=CompliantWalls(100 * STATIC, gap)),
        )


def _restitution() -> Iterator[StabilityCase]:
    for e in (0.0, 1e-9, 0.3, 0.99, 1.0):
        for friction in (None, 0.1):
            name = f"{e:g}" + ("" if friction is None else ", friction")
            make = partial(impact_absorber, GAP, e, friction)
            yield make_case(
                "restitution", name, make, modes=10, quick=e in (0.0, 1.0) and friction is None
            )


def _friction() -> Iterator[StabilityCase]:
    for limit in (1e-12, 1e-6, 10.0, 5e3, 2e4, 1e6, 1e12):
        yield make_case(
            "friction limit",
            f"{limit:g} N, walls",
            partial(impact_absorber, GAP, 0.7, limit),
            modes=10,
        )
        make = partial(friction_damper, limit)
        yield make_case(
            "friction limit", f"{limit:g} N, damper", make, modes=10, quick=limit in (1e-6, 1e6)
        )
    # a start at 1 m/s with a friction limit far above all other forces: sliding ends at once
    fast = partial(_at, velocity=1.0)
    for limit in (5e3, 2e4, 1e5):
        make = partial(impact_absorber, GAP, 0.7, limit)
        yield make_case(
            "friction limit", f"{limit:g} N, absorber starts at 1 m/s", make, modes=10, start=fast
        )
        yield make_case(
            "friction limit",
            f"{limit:g} N, a tiny absorber",
            partial(impact_absorber, GAP, 0.7, limit, 1e-5),
            modes=10,
            start=fast,
        )
        yield make_case(
            "friction limit",
            f"{limit:g} N, force {limit:g} N",
            make,
            modes=10,
            drive=partial(_near, force=limit),
            impacts=2,
        )
    for limit, stiffness in (
        (1e-9, STATIC),
        (1e6, STATIC),
        (0.1, 1e-2 * STATIC),
        (0.1, 1e4 * STATIC),
        (0.1, 1e8 * STATIC),
    ):
        name = f"elastic, {limit:g} N, {stiffness / STATIC:g} x 3EI/l^3"
        yield make_case(
            "friction limit", name, partial(elastic, limit, stiffness, False), periods=3
        )


def _masses() -> Iterator[StabilityCase]:
    for ratio in (1e-6, 1e-3, 10.0):
        for name, make in (
            ("impact", lambda r: impact_absorber(restitution=0.7, mass_ratio=r)),
            ("impact and friction", lambda r: impact_absorber(GAP, 0.7, 1e-3, r)),
            ("stuck", StuckAbsorber),
            ("tuned", TunedAbsorber),
            ("compliant", lambda r: soft(100 * STATIC, r)),
        ):
            yield make_case(
                "absorber mass",
                f"{ratio:g}, {name}",
                partial(make, ratio),
                force=20,
                quick=name == "impact",
            )
    for ratio in (1e3, 1e5, 1e8, 1e10, 1e14):
        # from 1e8 on, the motion of a tip that carries the mass is lost in rounding: no correct
        # result; with friction the mass only acts like the ground
        yield make_case(
            "absorber mass",
            f"{ratio:g}, stuck",
            partial(StuckAbsorber, ratio),
            must_refuse=ratio >= 1e8,
        )
        yield make_case(
            "absorber mass", f"{ratio:g}, friction", partial(friction_damper, 0.05, ratio)
        )
    yield make_case("absorber mass", "1e-14, friction", partial(friction_damper, 1e-14, 1e-14))


def _drives() -> Iterator[StabilityCase]:
    for name, make in (
        ("impact", impact),
        ("impact and friction", rubbing),
        ("tuned", TunedAbsorber),
        ("compliant", soft),
    ):
        yield make_case("force", f"0 N, {name}", make, force=0.0, quick=name == "impact")
        yield make_case("force", f"1e-12 N, {name}", make, force=1e-12)
        yield make_case("force", f"1e4 N, {name}", make, force=1e4, periods=3, impacts=2)
        yield make_case(
            "frequency", f"0, {name}", make, ratio=0.0, force=15.0, quick=name == "impact"
        )
        yield make_case("frequency", f"100 times the first, {name}", make, ratio=100.0, force=1e4)
        yield make_case(
            "frequency", f"2e3 times the first, {name}", make, ratio=2e3, force=1e6, periods=0.02
        )
        yield make_case(
            "frequency",
            f"1e5 times the first, {name}",
            make,
            ratio=1e5,
            force=1e9,
            periods=0.02,
            quick=name == "impact",
        )
        yield make_case(
            "frequency",
            f"0 to 30 times the first in two periods, {name}",
            make,
            drive=_sweep,
            quick=name == "impact",
        )
        yield make_case(
            "frequency",
            f"at the first exactly, no damping, {name}",
            make,
            ratio=1.0,
            beam={"damping_ratio": 0.0},
        )
    yield make_case(
        "frequency", "phase 1e9 rad", impact, drive=partial(_near, force=5.0, phase=1e9)
    )
    yield make_case("frequency", "a run of 1e-9 periods", impact, periods=1e-9, methods=(EXACT,))


def _constant(scene: Scene, periods: float = 6.0) -> FrequencySchedule:
    """Return a constant frequency near the first resonance, for ``periods`` pseudo periods."""
    return constant_frequency(scene.model.resonance_omega(1), NEAR, periods)


def _sweep(scene: Scene) -> Drive:
    """Return a force of 500 N from 0 to 30 times the first resonance in two pseudo periods."""
    reference = scene.model.resonance_omega(1)
    return Drive(
        500.0,
        FrequencySchedule(
            np.array([0.0, 4 * np.pi / reference]), np.array([0.0, 30.0]) * reference, reference
        ),
    )


def _near(scene: Scene, force: float, phase: float = 0.0) -> Drive:
    """Return a drive of constant ``force`` (N) and frequency, with its ``phase`` (rad) at t = 0."""
    return Drive(force, _constant(scene), phase)


def _at(_scene: Scene, displacement: float = 0.0, velocity: float = 0.0) -> InitialState:
    """Return a structure at rest and an absorber at a displacement (m) and a velocity (m/s)."""
    return InitialState(absorber_displacement=displacement, absorber_velocity=velocity)


@lru_cache(maxsize=4)
def _peak_per_newton(modes: int, periods: float) -> float:
    """Return the largest tip displacement per newton (m/N) of the beam without absorber.

    The drive is that of `_near` for ``periods`` pseudo periods, from rest.
    """
    scene = beam_scene(Beam(modes=modes))
    return simulate(
        scene, Drive(1.0, _constant(scene, periods)), record=Record(samples_per_period=512)
    ).recorded.level.max_tip


def _peak_at(scene: Scene, displacement: float) -> Drive:
    """Return the drive of `_near` whose force moves the tip to a ``displacement`` (m).

    The tip is that of the beam of three modes without absorber.
    """
    return _near(scene, displacement / _peak_per_newton(3, 6.0))


def _grazing() -> Iterator[StabilityCase]:
    """Yield cases in which the tip just reaches a wall at the absorber at rest, or just not."""
    for excess in (-1e-3, -1e-6, 1e-7, 1e-5, 1e-3):
        drive = partial(_peak_at, displacement=GAP * (1 + excess))
        yield make_case(
            "grazing",
            f"peak {excess:+g} of the gap past it, rigid",
            impact,
            drive=drive,
            impacts=1,
            quick=abs(excess) == 1e-3,
        )
        yield make_case(
            "grazing",
            f"peak {excess:+g} of the gap past it, compliant",
            soft,
            drive=drive,
            impacts=1,
        )


def _starts() -> Iterator[StabilityCase]:
    for side in (-1.0, 1.0):
        for velocity in (0.0, 0.05, -0.05):
            start = partial(_at, displacement=side * GAP, velocity=velocity)
            for name, make in (("impact", impact), ("impact and friction", rubbing)):
                label = f"on the {'upper' if side > 0 else 'lower'} wall, {velocity:+g} m/s, {name}"
                yield make_case(
                    "start", label, make, start=start, quick=name == "impact" and side > 0
                )
    outside = partial(_at, displacement=1.1 * GAP)
    yield make_case(
        "start", "outside the cavity", impact, start=outside, must_refuse=True, quick=True
    )
    yield make_case(
        "start", "outside the cavity, friction", rubbing, start=outside, must_refuse=True
    )
    yield make_case("start", "outside the cavity, compliant", soft, start=outside)
    undefined = partial(_at, displacement=np.nan)
    yield make_case("start", "not a number", impact, start=undefined, must_refuse=True)


def _stiffness() -> Iterator[StabilityCase]:
    for power in range(-2, 9):
        stiffness = 10.0**power * STATIC
        make = partial(soft, stiffness)
        yield make_case(
            "contact stiffness",
            f"1e{power} x 3EI/l^3",
            make,
            periods=4,
            impacts=2 if power < 6 else 1,
            quick=power in (-2, 2, 5),
        )
        name = f"1e{power} x 3EI/l^3, elastic friction"
        both = partial(
            SlidingAbsorber,
            walls=CompliantWalls(stiffness),
            friction=ElasticCoulombFriction(0.1, STATIC),
        )
        yield make_case("contact stiffness", name, both, periods=4, impacts=2 if power < 6 else 1)
    for stiffness, ratio in ((5e8, 1e-4), (5e8, 1e-6), (5e10, 1e-4), (1e12, 1e-8)):
        name = f"{stiffness:g} N/m, mass ratio {ratio:g}"
        slow = (
            (EXACT,) if stiffness / ratio > 1e15 else METHODS
        )  # more than 1e9 steps a pseudo period
        yield make_case(
            "contact stiffness",
            name,
            partial(soft, stiffness, ratio),
            modes=10,
            periods=4,
            impacts=1,
            methods=slow,
        )
        with_friction = partial(
            SlidingAbsorber, ratio, CompliantWalls(stiffness), ElasticCoulombFriction(1e-3, STATIC)
        )
        yield make_case(
            "contact stiffness",
            f"{name}, elastic friction",
            with_friction,
            modes=10,
            periods=4,
            impacts=1,
            methods=(EXACT,),
        )
        undamped: dict[str, object] = {"damping_ratio": 0.0}
        yield make_case(
            "contact stiffness",
            f"{name}, no damping",
            partial(soft, stiffness, ratio),
            periods=20,
            beam=undamped,
            methods=(EXACT,),
        )
    for stiffness, damping in (
        (1e-6, 0.728),
        (1e10, 0.728),
        (701.8, 0.0),
        (701.8, 1e3),
        (701.8, 1e6),
        (1e-6, 1e6),
    ):
        name = f"tuned absorber, {stiffness:g} N/m, {damping:g} N s/m"
        periods = 2.0 if damping < 1e6 else 0.3
        yield make_case(
            "contact stiffness",
            name,
            partial(TunedAbsorber, stiffness=stiffness, damping=damping),
            periods=periods,
        )


def _on_a_pressing_wall(scene: Scene, velocity: float) -> InitialState:
    """Return a deflected beam whose lower wall is accelerated towards the absorber.

    The absorber is on this wall and moves away from it with ``velocity`` (m/s).
    """
    displaced = -2e-3
    return InitialState(
        np.array([displaced]),
        absorber_displacement=displaced * scene.model.tip_shape[0] - GAP,
        absorber_velocity=velocity,
    )


def _pressed() -> Iterator[StabilityCase]:
    """Yield cases in which a wall is accelerated towards an absorber on it.

    The impacts are a chatter for e < 1; for e = 1 they are many.
    """
    for e in (0.5, 0.9, 1.0):
        for velocity in (1e-3, 1e-6, 1e-9):
            make = partial(impact_absorber, restitution=e, mass_ratio=1e-3)
            start = partial(_on_a_pressing_wall, velocity=velocity)
            quick = velocity == 1e-6 and e in (0.5, 1.0)
            yield make_case(
                "pressed",
                f"e = {e:g}, {velocity:g} m/s",
                make,
                modes=1,
                force=0.0,
                start=start,
                periods=0.2,
                quick=quick,
            )


def _conserved() -> Iterator[StabilityCase]:
    """Yield free vibrations without any dissipation."""

    def start(scene: Scene) -> InitialState:
        n = scene.model.modes
        return InitialState(np.full(n, 1e-3) / (1 + np.arange(n)) ** 3, absorber_velocity=0.1)

    free = partial(
        make_case,
        "conserved",
        beam={"damping_ratio": 0.0},
        force=0.0,
        periods=20,
        start=start,
        conserved=True,
    )
    yield free("no absorber", lambda: None)
    yield free("tuned", partial(TunedAbsorber, damping=0.0))
    yield free("impact", impact_absorber, quick=True)
    yield free("compliant", soft)
    yield free("compliant, 1e6 x 3EI/l^3", partial(soft, 1e6 * STATIC))


GROUPS = (
    _ordinary,
    _damping,
    _modes,
    _gaps,
    _restitution,
    _friction,
    _masses,
    _drives,
    _grazing,
    _starts,
    _stiffness,
    _pressed,
    _conserved,
)


def cases(quick: bool = False) -> list[StabilityCase]:
    """Return all cases, or only those of a quick run.

    Methods that cannot compute the rigid or compliant contact of a case are removed from it.
    """
    every = [case for group in GROUPS for case in group()]
    return [_applicable(case) for case in every if case.quick or not quick]


def _applicable(case: StabilityCase) -> StabilityCase:
    """Return the case without the method that cannot compute its scene.

    This is Runge-Kutta for rigid contact, and Moreau for compliant contact. A case whose parameters
    are refused is unchanged.
    """
    try:
        scene, _, _ = case.build()
    except ParameterError:
        return case
    sliding = scene.absorber
    if not isinstance(sliding, SlidingAbsorber):
        return case
    rigid = isinstance(sliding.walls or sliding.friction, RigidWalls | CoulombFriction)
    unable = RUNGE_KUTTA if rigid else MOREAU
    return replace(case, methods=tuple(m for m in case.methods if m != unable))
