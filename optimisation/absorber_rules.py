"""Design rules for absorbers, and baseline levels with other absorbers of the same mass.

The rules give a friction damper's limit from the energy of one cycle, and the gap and friction of
an impact absorber. The baselines are the best of the other absorbers.

A mass m_a slides on a tip that moves with amplitude q at Omega. Only friction acts on it, with the
first harmonic F = 4 mu f_N/pi, so its own amplitude is F/(m_a Omega^2), a quarter period apart from
the sliding motion. The sliding amplitude X therefore satisfies X^2 + (F/(m_a Omega^2))^2 = q^2. The
energy lost in a cycle, pi F X, is largest for F = m_a Omega^2 q/sqrt(2): then X = q/sqrt(2), the
loss is pi m_a Omega^2 q^2/2, and half of the mass moves with the tip. With one mode (damping ratio
D, shapes phi_t at the tip and phi_f at the force) in resonance, force and losses balance:

    f phi_f/phi_t = q Omega^2 (m_a/2 + 2 D/phi_t^2),        Omega^2 = omega_r^2/(1 + m_a phi_t^2/2).

The effect of friction in an impact absorber depends on its ratio to m_a g0 omega^2 (scaling law:
mass, gap and time are the units). The paper's 0.1 N with 2 % of the beam's mass and 1 mm is 0.139
m_a g0 omega_1^2; on other structures this ratio gives a similar absorber.

Absorbers of other kinds with the same mass are compared by one criterion: the larger response level
of a sweep up and a sweep down over the same range of frequencies.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np

from impact_env.checks import ParameterError, instance, positive, require
from impact_env.curve import CurveCase, performance_curves
from impact_env.ensemble import Executor
from impact_env.modes import ModalModel, modal_model
from impact_env.parameters import (
    DEFAULT_MASS_RATIO,
    Absorber,
    Beam,
    RigidWalls,
    SlidingAbsorber,
    TunedAbsorber,
    friction_damper,
    impact_absorber,
)
from impact_env.scene import Scene
from optimisation.bounds import design_gap, free_amplitude, gap_unit
from optimisation.sweep_range import usable_mass_ratio
from optimisation.tuned import smallest_amplitude

PAPER_FRICTION = 0.1  # mu f_N in N of the paper's best impact absorber (section 6)
RESTITUTION = 0.7  # of the paper's best absorber


@cache
def paper_share() -> float:
    """Return the ratio of the paper's friction limit to m_a g0 omega_1^2."""
    model = modal_model(Beam())
    return PAPER_FRICTION / (
        DEFAULT_MASS_RATIO * model.beam_mass * RigidWalls.gap * model.resonance_omega(1) ** 2
    )


def scaled_friction(model: ModalModel, mass: float, gap: float) -> float:
    """Return the paper's friction limit in N, scaled to ``mass`` (kg) and ``gap`` (m).

    Its ratio to m_a g0 omega_1^2 is that of the paper, with the frequency omega_1 of the lowest
    mode for every resonance: the paper has the same limit of 0.1 N at two resonances.
    """
    model = instance("model", model, ModalModel)
    return (
        paper_share()
        * positive("mass", mass)
        * positive("gap", gap)
        * model.resonance_omega(1) ** 2
    )


def best_friction(
    model: ModalModel, mass: float, force: float, resonance: int = 1
) -> tuple[float, float]:
    """Return the best friction limit mu f_N in N, and the level's RMS in m with it.

    Both follow from the energy of one cycle of the resonance's mode alone, for a ``force`` in N and
    a ``mass`` m_a in kg. Raises ParameterError for numbers out of range, and if the mode does not
    move the tip or the force does not excite it.
    """
    model = instance("model", model, ModalModel)
    omega = model.resonance_omega(resonance)
    k = resonance - 1
    tip = float(model.tip_shape[k])
    at_force = float(model.one_phase_force_shape[k])
    damping = float(model.damping_ratio[k])
    require(
        tip != 0,
        f"tip_shape of mode {resonance}",
        tip,
        "not 0: a damper at a node of a mode cannot act on it",
    )
    require(
        at_force != 0,
        f"force_shape of mode {resonance}",
        at_force,
        "not 0: a force at a node of a mode does not move it",
    )
    own = positive("mass", mass)
    square = omega**2 / (1 + own * tip**2 / 2)
    amplitude = (
        positive("force", force) * abs(at_force / tip) / (square * (own / 2 + 2 * damping / tip**2))
    )
    level = amplitude * abs(float(model.level_shape[k]) / tip) / np.sqrt(2)
    return float(np.pi / 4 * own * square * amplitude / np.sqrt(2)), float(level)


def scaled_absorber(
    model: ModalModel,
    force: float,
    resonance: int = 1,
    mass_ratio: float = DEFAULT_MASS_RATIO,
    restitution: float = RESTITUTION,
) -> SlidingAbsorber:
    """Return an impact absorber with the design rule's gap for a force in N.

    Its friction is the paper's, scaled by `scaled_friction`.
    """
    model = instance("model", model, ModalModel)
    mass = usable_mass_ratio("mass_ratio", mass_ratio) * model.beam_mass
    friction = scaled_friction(model, mass, gap_unit(model, mass, force, resonance))
    return impact_absorber(
        design_gap(model, mass, force, resonance), restitution, friction, mass_ratio
    )


def rigid_walls(absorber: SlidingAbsorber) -> RigidWalls:
    """Return an absorber's rigid walls; raise ParameterError if it has none."""
    absorber = instance("absorber", absorber, SlidingAbsorber)
    if not isinstance(absorber.walls, RigidWalls):
        require(
            False, "absorber", absorber, "one with rigid walls, since the rule is about their gap"
        )
        raise AssertionError
    return absorber.walls


DAMPER_STEP = float(np.log(2.2))  # of ln friction limit


@dataclass(frozen=True)
class Baselines:
    """Levels in m (RMS) with other absorbers of the same mass, swept over the same range.

    A level is NaN if the absorber has no effect.

    Attributes
    ----------
    tuned : float
        Level with the tuned absorber whose largest amplitude in the range is smallest.
    damper : float
        Level with the best simulated friction damper.
    damper_limit : float
        Friction limit of this damper in N.
    tuned_absorber : TunedAbsorber or None
        The tuned absorber.
    """

    tuned: float
    damper: float
    damper_limit: float
    tuned_absorber: TunedAbsorber | None = None


def simulate_baselines(
    model: ModalModel,
    mass_ratio: float,
    condition: tuple[float, int],
    sweep_range: tuple[float, float],
    rate: float,
    executor: Executor,
) -> Baselines:
    """Return the levels with other absorbers of the same mass.

    ``condition`` is a force in N and a resonance, ``sweep_range`` two frequency ratios to the
    resonance, and ``rate`` in % per 100 pseudo periods. Raises KeyboardInterrupt if the runs are
    stopped.
    """
    force, resonance = condition

    def level(absorber: Absorber) -> float:
        case = CurveCase(
            Scene(model, absorber),
            np.array([force]),
            resonance,
            sweep_range,
            rate,
            steady_start=True,
        )
        (curve,) = performance_curves([case], 1, executor=executor)
        if not curve.complete:
            raise KeyboardInterrupt
        return float(curve.median[0])

    tuned = None
    tuned_level = float("nan")
    try:
        tuned = smallest_amplitude(model, mass_ratio, resonance, *sweep_range)
        tuned_level = level(tuned)
    except (
        ParameterError
    ):  # nothing can be tuned where the resonance's mode does not move the place
        pass

    limit, damper_level = find_best_damper(
        lambda limit: level(friction_damper(limit, mass_ratio)),
        estimate_damper(model, mass_ratio * model.beam_mass, force, resonance),
    )
    return Baselines(tuned_level, damper_level, limit, tuned)


def estimate_damper(model: ModalModel, mass: float, force: float, resonance: int) -> float:
    """Return the friction limit in N at which the search for a damper's limit starts.

    It follows from the energy of one cycle, or from the free amplitude if the energy gives no
    limit.
    """
    try:
        return best_friction(model, mass, force, resonance)[0]
    except ParameterError:
        free = free_amplitude(model, mass, force, resonance)
        return 0.2 * mass * model.resonance_omega(resonance) ** 2 * free


def find_best_damper(level: Callable[[float], float], estimate: float) -> tuple[float, float]:
    """Return (friction limit in N, level) of the best of four friction dampers.

    ``level`` is a function of the limit. Three limits are the ``estimate`` and one on either side
    of it. The fourth is the minimum of the parabola through these three; if the best of the three
    is the smallest or the largest, it lies beyond it.
    """
    if not (np.isfinite(estimate) and estimate > 0):
        return float("nan"), float("nan")
    shifts = [-DAMPER_STEP, 0.0, DAMPER_STEP]
    levels = [level(estimate * float(np.exp(shift))) for shift in shifts]
    best = int(np.argmin(levels))
    if best == 1:
        left, middle, right = np.log(levels)
        curvature = left - 2 * middle + right
        fourth = DAMPER_STEP * (left - right) / (2 * curvature) if curvature > 0 else 0.0
        if abs(fourth) < 0.05:  # the estimate is the best already
            fourth = 0.3
    else:
        fourth = 2 * shifts[best]
    shifts.append(float(fourth))
    levels.append(level(estimate * float(np.exp(fourth))))
    best = int(np.argmin(levels))
    return estimate * float(np.exp(shifts[best])), levels[best]
