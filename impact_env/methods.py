"""The integration methods, and the time steps of those that have one."""

from dataclasses import dataclass, field

import numpy as np

from impact_env.checks import (
    count_from,
    require,
)
from impact_env.drive import Excitation
from impact_env.fields import check_fields, parameter
from impact_env.laws import list_laws
from impact_env.modes import MOST_HEAVINESS, with_link
from impact_env.parameters import (
    CompliantWalls,
    ElasticCoulombFriction,
    NonlinearSink,
    StuckAbsorber,
)
from impact_env.scene import Scene

LEAST_STEPS_PER_PERIOD = 4  # per period of the highest mode, and of the force
MOST_STEPS_PER_PERIOD = 1_000_000  # far beyond where rounding outweighs what a shorter step gains
STEP_LIMIT_TOL = 1e-9  # a step this close to its limit counts as at it
STABLE_EIGENVALUE_STEP = (
    2.5  # |s| h up to which the classical Runge-Kutta method is stable for every damping
)
PAPER_STEPS = (
    20  # per period of the highest mode (paper, section 2.4), and per contact (paper, appendix A)
)


def _compliance(scene: Scene) -> float:
    """Return the compliance at the contact, 1/m_a + sum tip_shape^2, in 1/kg.

    It is the relative acceleration of absorber and tip per unit of force between them.
    """
    mass = scene.absorber_mass
    return float(np.sum(scene.model.tip_shape**2)) + (0.0 if mass is None else 1 / mass)


def _highest_frequency(scene: Scene) -> float:
    """Return the highest circular frequency (rad/s) that a step must resolve.

    It is the highest of the modes' frequencies and a linear absorber's on the tip.
    """
    highest = float(np.max(scene.model.omega))
    link = scene.link
    if link is not None:
        highest = max(
            highest,
            np.sqrt(link.stiffness * _compliance(scene)),
            link.damping * _compliance(scene),
        )
    if isinstance(
        scene.absorber, NonlinearSink
    ):  # its spring's frequency is known only once it moves
        highest = max(highest, scene.absorber.damping * _compliance(scene))
    return highest


STEPS = parameter(count_from(LEAST_STEPS_PER_PERIOD, MOST_STEPS_PER_PERIOD))


@dataclass(frozen=True)
class Exact:
    """Exact integration from event to event by the modes of each linear regime.

    The default method. It has no step, and its error is that of rounding. Not for a nonlinear
    spring.

    Examples
    --------
    >>> from impact_env import Exact
    >>> str(Exact())
    'Exact()'
    """


@dataclass(frozen=True)
class Moreau:
    """Moreau's time-stepping scheme, for rigid contact (paper, section 2.4).

    Parameters
    ----------
    steps_per_period : int, optional
        Time steps in a period of the highest mode.

    Raises
    ------
    ParameterError
        The value is out of range.

    Examples
    --------
    >>> from impact_env import Moreau, beam_scene, impact_absorber
    >>> step = Moreau(steps_per_period=100).step(beam_scene(absorber=impact_absorber()))
    >>> bool(step < 1e-5)
    True
    """

    steps_per_period: int = field(default=PAPER_STEPS, metadata=STEPS)

    def __post_init__(self) -> None:
        check_fields(self)

    def step(self, scene: Scene) -> float:
        """Return the time step in s."""
        return 2 * np.pi / (self.steps_per_period * _highest_frequency(scene))


@dataclass(frozen=True)
class RungeKutta:
    """Classical Runge-Kutta method of order four, for linear scenes and compliant contact.

    The paper uses it for compliant contact (appendix A).

    Parameters
    ----------
    steps_per_period : int, optional
        Steps in a period of the highest mode.
    steps_per_contact : int, optional
        Steps in a wall contact, whose duration is pi sqrt(m_a/k).

    Raises
    ------
    ParameterError
        A value is out of range.

    Examples
    --------
    >>> from impact_env import CompliantWalls, RungeKutta, SlidingAbsorber, beam_scene
    >>> scene = beam_scene(absorber=SlidingAbsorber(walls=CompliantWalls(stiffness=1e6)))
    >>> bool(RungeKutta(steps_per_period=40).step(scene) < RungeKutta().step(scene))
    True
    """

    steps_per_period: int = field(default=PAPER_STEPS, metadata=STEPS)
    steps_per_contact: int = field(default=PAPER_STEPS, metadata=STEPS)

    def __post_init__(self) -> None:
        check_fields(self)

    def step(self, scene: Scene) -> float:
        """Return the time step in s, the smaller of the paper's two conditions.

        The paper's duration of a contact assumes an immovable beam. If the tip is more compliant
        than the absorber, contacts are shorter, and a third condition, 1/sqrt(k (1/m_a + sum
        tip_shape^2)), keeps the method stable.
        """
        dt = 2 * np.pi / (self.steps_per_period * _highest_frequency(scene))
        springs = [
            part.stiffness
            for part in list_laws(scene.absorber)
            if isinstance(part, CompliantWalls | ElasticCoulombFriction)
        ]
        if springs and scene.absorber_mass is not None:
            stiffness = max(springs)
            mass = scene.absorber_mass
            dt = min(
                dt,
                np.pi * np.sqrt(mass / stiffness) / self.steps_per_contact,
                1 / np.sqrt(stiffness * _compliance(scene)),
            )
        return float(dt)


Method = Exact | Moreau | RungeKutta
METHODS: dict[str, type[Method]] = {
    "exact": Exact,
    "moreau": Moreau,
    "runge-kutta": RungeKutta,
}  # by their plain names


def check_mass(scene: Scene) -> None:
    """Raise ParameterError if a stuck absorber is so heavy that rounding hides the tip's motion.

    This holds for any method.
    """
    if not isinstance(scene.absorber, StuckAbsorber) or scene.absorber_mass is None:
        return
    heaviness = scene.absorber_mass * float(np.sum(scene.model.tip_shape**2))
    most = scene.absorber.mass_ratio * MOST_HEAVINESS / max(heaviness, MOST_HEAVINESS)
    allowed = f"at most {most:.1e} on this beam: a tip that hardly moves is lost in rounding"
    require(heaviness <= MOST_HEAVINESS, "mass_ratio", scene.absorber.mass_ratio, allowed)


def check_step(scene: Scene, drive: Excitation, method: Method) -> None:
    """Raise ParameterError if the steps of a method are too long for a scene or a drive.

    Without this check the results would be wrong without notice. A step that resolves the period of
    the highest mode may still be too long for strong damping, because both schemes are explicit and
    the faster rate of an overdamped mode grows with its damping ratio. It may also be too long for
    a force with a frequency above all modes.
    """
    if isinstance(method, Exact):
        return
    dt = method.step(scene)
    steps = method.steps_per_period
    growth = (
        _moreau_growth(scene, dt) if isinstance(method, Moreau) else _runge_kutta_growth(scene, dt)
    )
    why = "for this scene's damping, as an explicit step is unstable above its limit"
    require(
        growth <= 1,
        "steps_per_period",
        steps,
        f"about {2 ** max(0, int(np.ceil(np.log2(max(growth, 1))))) * steps} or more {why}",
    )
    coarseness = drive.highest_omega * dt * LEAST_STEPS_PER_PERIOD / (2 * np.pi)
    allowed = (
        f"{int(np.ceil(steps * coarseness))} or more for this force, so that each of its periods "
        f"has {LEAST_STEPS_PER_PERIOD} steps"
    )
    require(coarseness <= 1, "steps_per_period", steps, allowed)


def _moreau_growth(scene: Scene, dt: float) -> float:
    """Return the step over the limit of stability, or an upper bound of this ratio.

    ``dt`` in s. The scheme is stable if 4 M - 2 dt C - dt^2 K is not negative.
    """
    model = scene.model
    rate = 2 * model.damping_ratio * model.omega
    square = model.omega**2
    link = scene.link
    if link is None:
        limit = 4 / (rate + np.sqrt(rate**2 + 4 * square))
        return float(dt / np.min(limit) * (1 - STEP_LIMIT_TOL))
    mass = scene.absorber_mass
    assert mass is not None
    line = np.append(-model.tip_shape, 1 / np.sqrt(mass))
    damping = with_link(rate, link.damping, line)
    stiffness = with_link(square, link.stiffness, line)
    return float(
        np.max(np.linalg.eigvalsh(2 * dt * damping + dt**2 * stiffness)) / 4 * (1 - STEP_LIMIT_TOL)
    )


def _runge_kutta_growth(scene: Scene, h: float) -> float:
    """Return the largest ratio of a free mode's |s| h to the limit of stability.

    At the limit the amplification polynomial of order four leaves the unit circle. The result is 0
    if it stays inside for all modes. ``h`` is the step in s.
    """
    model = scene.model
    ratio = model.damping_ratio.astype(complex)
    s = -model.omega * (ratio + np.sqrt(ratio**2 - 1))  # of an overdamped mode the fast one
    z = s * h
    growing = np.abs(1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24) > 1 + STEP_LIMIT_TOL
    return float(np.max(np.where(growing, np.abs(z) / STABLE_EIGENVALUE_STEP, 0.0)))
