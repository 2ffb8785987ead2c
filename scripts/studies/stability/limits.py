"""Largest stable steps of the two stepping methods, by bisection on runs and by theory."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.optimize

from impact_env import (
    Beam,
    CompliantWalls,
    Drive,
    FrequencySchedule,
    InitialState,
    Scene,
    SlidingAbsorber,
    TunedAbsorber,
    beam_scene,
)
from impact_env.frequency import joint_matrices
from impact_env.kernels.motion.observers import (
    DONE,
    Observers,
    StateSeries,
    new_clock,
    new_counters,
)
from impact_env.methods import Method, Moreau, RungeKutta
from impact_env.solvers import find_solver
from studies.study import Array, Json

MOREAU = "moreau"
RUNGE_KUTTA = "runge-kutta"
MAKE: dict[str, type[Moreau | RungeKutta]] = {MOREAU: Moreau, RUNGE_KUTTA: RungeKutta}
STEPS = 50_000
GROWN = 100.0  # a run whose state is so many times larger at its end was not stable
HALVINGS = 40
AGREE = 1e-3  # relative difference to theory that the finite number of steps explains


def at_step(method: Method, dt: float) -> Method:
    """Return a stepping method whose step is ``dt`` (s) in every scene."""
    return type("AtStep", (type(method),), {"step": lambda *_: dt})()


@dataclass(frozen=True)
class LimitCase:
    """A linear scene whose largest stable step is known.

    It is a mode, or a mode with a spring to the absorber. Walls without clearance are such a
    spring.
    """

    method: str
    what: str
    damping_ratio: float
    modes: int = 1
    spring: float | None = None
    damper: float = 0.0

    def scene(self) -> Scene:
        """Return the scene whose step is searched."""
        absorber = None
        if self.spring is not None:
            walls = SlidingAbsorber(walls=CompliantWalls(self.spring, 0.0))
            absorber = (
                TunedAbsorber(stiffness=self.spring, damping=self.damper)
                if self.method == MOREAU or self.damper
                else walls
            )
        return beam_scene(Beam(modes=self.modes, damping_ratio=self.damping_ratio), absorber)


RATIOS = (0.0, 0.001, 0.01, 0.1, 0.3, 0.7, 1.0, 2.0, 5.0, 20.0)
OTHERS = (
    ("ten modes", 0.01, 10),
    ("spring 1e6 N/m", 0.01, 3, 1e6),
    ("spring 1e10 N/m", 0.01, 3, 1e10),
    ("spring 1e4 N/m, damper 100 N s/m", 0.01, 3, 1e4, 100.0),
)
CASES = (
    *(LimitCase(method, "one mode", ratio) for method in MAKE for ratio in RATIOS),
    *(LimitCase(method, *other) for other in OTHERS for method in MAKE),
)
QUICK = tuple(case for case in CASES if case.damping_ratio in (0.0, 0.01, 1.0, 20.0))


def first_order(scene: Scene) -> Array:
    """Return the matrix of the first-order form of the linear scene with its spring closed.

    Its states are displacements and velocities.
    """
    mass, damping, stiffness = _matrices(scene)
    zero = np.zeros_like(mass)
    inverse = np.diag(1 / np.diag(mass))
    return np.block([[zero, np.eye(len(mass))], [-inverse @ stiffness, -inverse @ damping]])


def _matrices(scene: Scene) -> tuple[Array, Array, Array]:
    """Return the mass, damping and stiffness matrices.

    The closed spring of a wall is the spring of a tuned absorber without a damper.
    """
    absorber = scene.absorber
    if isinstance(absorber, SlidingAbsorber):
        assert isinstance(absorber.walls, CompliantWalls)
        return joint_matrices(
            scene.model, TunedAbsorber(absorber.mass_ratio, absorber.walls.stiffness, 0.0)
        )
    assert absorber is None or isinstance(absorber, TunedAbsorber)
    return joint_matrices(scene.model, absorber)


def moreau_theory(scene: Scene) -> float:
    """Return the step in s at which the scheme's one-step map leaves the unit circle.

    A mode with x = omega dt and damping ratio D has z^2 - (2 - 2 D x - x^2) z + (1 - 2 D x) = 0,
    which passes z = -1 at x = 2 (sqrt(D^2 + 1) - D). Modes that a spring and a damper couple: the
    spectral radius of the whole map.
    """
    model = scene.model
    if scene.absorber is None:
        return float(
            np.min(2 * (np.sqrt(model.damping_ratio**2 + 1) - model.damping_ratio) / model.omega)
        )
    mass, damping, stiffness = _matrices(scene)
    inverse = np.diag(1 / np.diag(mass))
    eye = np.eye(len(mass))

    def radius(dt: float) -> float:
        keep = eye - dt * inverse @ damping
        pull = -dt * inverse @ stiffness
        return float(
            np.max(
                np.abs(np.linalg.eigvals(np.block([[eye + dt * pull, dt * keep], [pull, keep]])))
            )
        )

    return _crossing(radius, 1 / float(np.max(np.abs(np.linalg.eigvals(first_order(scene))))))


def runge_kutta_theory(scene: Scene) -> float:
    """Return the largest stable step h in s of the Runge-Kutta method.

    At it |1 + z + z^2/2 + z^3/6 + z^4/24| = 1 for an eigenvalue s, z = s h.
    """
    eigenvalues = np.linalg.eigvals(first_order(scene))
    eigenvalues = eigenvalues[
        np.abs(eigenvalues) > 1e-9 * np.max(np.abs(eigenvalues))
    ]  # the absorber's own rest

    def radius(h: float) -> float:
        z = eigenvalues * h
        return float(np.max(np.abs(1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24)))

    return _crossing(radius, 1 / float(np.max(np.abs(eigenvalues))))


def _crossing(radius: Callable[[float], float], unit: float) -> float:
    """Return the step at which a spectral radius exceeds 1 for good.

    It is searched in units of the fastest time scale.
    """
    grid = np.linspace(0.01, 4.0, 1600) * unit
    grown = np.array([radius(dt) > 1 + 1e-9 for dt in grid])
    k = int(np.flatnonzero(~grown)[-1])
    return float(scipy.optimize.brentq(lambda dt: radius(dt) - 1 - 1e-9, grid[k], grid[k + 1]))


def grows(case: LimitCase, scene: Scene, dt: float) -> bool:
    """Return whether a run of `STEPS` steps without a force ends far above its start."""
    reference = float(scene.model.omega[0])
    duration = dt * STEPS
    drive = Drive(
        0.0, FrequencySchedule(np.array([0.0, duration]), np.full(2, reference), reference)
    )
    start = InitialState(
        1e-6 * np.ones(scene.model.modes) / scene.model.omega,
        1e-6 * np.ones(scene.model.modes),
        absorber_velocity=1e-6,
    )
    state = start.vector(scene)
    weight = np.concatenate([scene.model.omega, [0.0], np.ones(len(state) // 2)])
    size = np.hypot(*np.split(weight * state, 2)).max()
    observe = Observers(
        new_clock(duration), new_counters(), series=StateSeries(np.zeros((2, len(state))))
    )
    method = at_step(MAKE[case.method](), dt)
    status = find_solver(scene, method).run(scene, drive, method, state, observe)
    end = weight * state
    return (
        status != DONE or not np.all(np.isfinite(end)) or bool(np.max(np.abs(end)) > GROWN * size)
    )


def find_limit(case: LimitCase) -> Json:
    """Return the largest stable step of a case by theory, bisection, and the paper's setting.

    Steps are in s. The bisection does not use the theory; ``agrees`` says whether both agree.
    """
    scene = case.scene()
    fastest = float(np.max(np.abs(np.linalg.eigvals(first_order(scene)))))
    low = 0.01 / fastest
    high = 10.0 / fastest
    for _ in range(HALVINGS):
        middle = float(np.sqrt(low * high))
        low, high = (low, middle) if grows(case, scene, middle) else (middle, high)
    theory = moreau_theory(scene) if case.method == MOREAU else runge_kutta_theory(scene)
    result = float(np.sqrt(low * high))
    paper = MAKE[case.method]().step(scene)
    own = {
        "method": case.method,
        "what": case.what,
        "damping_ratio": case.damping_ratio,
        "omega": float(np.max(scene.model.omega)),
    }
    return own | {
        "theory_s": theory,
        "found_s": result,
        "paper_s": paper,
        "agrees": abs(result / theory - 1) <= AGREE,
    }
