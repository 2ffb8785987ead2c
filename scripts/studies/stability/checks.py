"""Check the event search of the exact method for missed events by dense sampling.

The searches are those of a mix of scenes.
"""

from collections.abc import Callable

import numpy as np

from impact_env import (
    Beam,
    CompliantWalls,
    ElasticCoulombFriction,
    ModalModel,
    SeveralAbsorbers,
    SlidingAbsorber,
    friction_damper,
    impact_absorber,
)
from impact_env.drive import Drive, linear_sweep
from impact_env.parameters import Absorber
from impact_env.results import Record
from impact_env.scene import Scene, beam_scene
from impact_env.sweep import IntegrationError, simulate
from studies.study import Json

# of all cases together
SEARCHES = 1_000_000
QUICK_SEARCHES = 20_000
SWEEP = (0.93, 1.05)  # frequencies over the first resonance that runs begin at
# of a run's sweep, and percent per 100 pseudo periods
WIDTH = 0.01
RATE = 1.0
FORCES = (1.0, 10.0)  # N, uniform in its logarithm
KINDS = ("passed", "turned", "joint force")
RECORD = Record(check=True)


def beam(modes: int, absorber: Absorber) -> Scene:
    """Return the paper's beam with so many modes and an absorber."""
    return beam_scene(Beam(modes=modes), absorber)


def random_structure(
    generator: np.random.Generator,
    scale: float,
    several: bool = False,
    pair: bool = False,
    critical: tuple[int, int] | None = None,
) -> Scene:
    """Return a random modal model with a random absorber, at 3 N in the first resonance.

    The gap is ``scale`` times below the amplitude without absorber.

    ``several``: two absorbers; ``pair``: two modes of one frequency; ``critical``: how far damping
    ratios are off 1, as powers of ten.
    """
    modes = int(generator.integers(2, 7))
    omega = np.sort(10 ** generator.uniform(0, 3, modes))
    damping = 10 ** generator.uniform(-4, -0.5, modes)
    if pair:
        omega[1] = omega[0]
    if critical:
        damping = 1 + generator.choice([-1, 1], modes) * 10 ** generator.uniform(*critical, modes)
    shapes = generator.normal(size=(2, modes))
    places = generator.normal(size=(2, modes))
    reach = abs(
        np.sum(shapes[0] * shapes[1] / (omega**2 - omega[0] ** 2 + 2j * damping * omega * omega[0]))
    )
    absorbers = []
    for _ in range(1 + several):
        friction = None if generator.random() < 0.5 else float(10 ** generator.uniform(-6, 0))
        e = float(generator.choice([0.0, 0.3, 0.7, 0.9, 1.0]))
        ratio = float(10 ** generator.uniform(-3, -1))
        absorbers.append(impact_absorber(float(3 * reach / scale), e, friction, ratio))
    model = ModalModel(omega, damping, shapes[0], shapes[1], 1.0, places if several else None)
    return Scene(model, SeveralAbsorbers(tuple(absorbers), (1.0, 1.0)) if several else absorbers[0])


def two_absorbers() -> Scene:
    """Return two cavities in different places, one of them with friction."""
    absorbers = (
        impact_absorber(mass_ratio=0.01, restitution=0.7, friction_limit=0.03),
        impact_absorber(mass_ratio=0.01, restitution=0.9),
    )
    return beam_scene(Beam(modes=5), SeveralAbsorbers(absorbers, (0.7, 1.0)))


OTHER = Beam(
    modes=5,
    damping_ratio=(0.001, 0.02, 0.005, 0.05, 0.01),
    force_position=0.7,
    absorber_position=0.8,
    modal_frequency_ratio={2: 2.001},
)
# modes close together, far apart and hardly damped: no beam
ODD = ModalModel(
    np.array([100.0, 101.0, 730.0, 9000.0]),
    np.array([0.002, 0.03, 0.3, 1e-4]),
    np.array([0.8, -0.5, 1.0, 0.3]),
    np.array([1.0, 0.7, -1.2, 0.4]),
    0.5,
)
CASES: dict[str, Callable[[np.random.Generator], Scene]] = {
    "2 modes, e = 1": lambda _: beam(2, impact_absorber(restitution=1.0)),
    "2 modes, e = 1, friction": lambda _: beam(
        2, impact_absorber(restitution=1.0, friction_limit=0.025)
    ),
    "5 modes, e = 0": lambda _: beam(5, impact_absorber(restitution=0.0)),
    "5 modes, e = 0.5, friction": lambda _: beam(
        5, impact_absorber(restitution=0.5, friction_limit=0.1)
    ),
    "10 modes, e = 0.7": lambda _: beam(10, impact_absorber(restitution=0.7)),
    "10 modes, friction damper": lambda _: beam(10, friction_damper()),
    "30 modes, e = 0.8": lambda _: beam(30, impact_absorber(restitution=0.8)),
    "30 modes, e = 0.8, friction": lambda _: beam(
        30, impact_absorber(restitution=0.8, friction_limit=0.05)
    ),
    "5 modes, compliant walls": lambda _: beam(5, SlidingAbsorber(walls=CompliantWalls(1e6))),
    "5 modes, compliant walls, elastic friction": lambda _: beam(
        5, SlidingAbsorber(walls=CompliantWalls(1e6), friction=ElasticCoulombFriction(0.1, 1e5))
    ),
    "5 modes, two absorbers": lambda _: two_absorbers(),
    "5 modes, other beam, e = 0.5": lambda _: beam_scene(
        OTHER, impact_absorber(gap=3e-4, restitution=0.5)
    ),
    "modes of no beam, e = 0.9, friction": lambda _: Scene(
        ODD, impact_absorber(restitution=0.9, friction_limit=0.02)
    ),
    "random structures, 1e4 gaps": lambda generator: random_structure(generator, 1e4),
    "random structures, 1e6 gaps": lambda generator: random_structure(generator, 1e6),
    "random structures, 1e8 gaps": lambda generator: random_structure(generator, 1e8),
    "two absorbers, 1e6 gaps": lambda generator: random_structure(generator, 1e6, several=True),
    "equal pairs, 1e5 gaps": lambda generator: random_structure(generator, 1e5, pair=True),
    "near critical damping, 1e5 gaps": lambda generator: random_structure(
        generator, 1e5, critical=(-3, -1)
    ),
}
NEARER = {
    "nearer to critical damping": lambda generator: random_structure(
        generator, 1e5, critical=(-4, -2)
    )
}  # told beside the table


def check(name: str, searches: int, seed: int | None = None) -> Json:
    """Run sweeps of random force, phase and frequency until enough searches are checked.

    The number is ``searches``. A run with more events ends there.

    ``misses`` among them, the ``worst`` as in `SearchCheck`, and where the ``first`` was. The seed
    is by default the case's number.
    """
    generator = np.random.default_rng(list(CASES).index(name) if seed is None else seed)
    result: Json = {"name": name, "searches": 0, "misses": 0, "worst": 0.0, "first": ""}
    while result["searches"] < searches:
        scene = (CASES | NEARER)[name](generator)
        omega = scene.model.resonance_omega(1)
        force = float(np.exp(generator.uniform(*np.log(FORCES))))
        start = float(generator.uniform(*SWEEP))
        phase = float(generator.uniform(0, 2 * np.pi))
        stop = start + WIDTH * float(generator.choice([-1, 1]))
        drive = Drive(force, linear_sweep(omega, start, stop, RATE), phase)
        try:
            results = simulate(scene, drive, record=RECORD, most_events=searches).recorded.check
        except IntegrationError as error:
            if "budget" not in str(error) or error.response is None:
                raise
            results = error.response.recorded.check
        result["searches"] += results.searches
        result["misses"] += results.misses
        result["worst"] = max(result["worst"], results.worst)
        if results.misses and not result["first"]:
            at = results.times[0] * omega / (2 * np.pi)
            kind = KINDS[results.kinds[0]]
            run = f"{force!r} N, phase {phase!r} rad, {start!r} to {stop!r}"
            result["first"] = (
                f"{kind} by {results.sizes[0]:.1e} at {at:.6g} pseudo periods of {run}"
            )
    return result | {"passed": result["misses"] == 0}
