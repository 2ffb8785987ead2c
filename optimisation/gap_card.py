"""The recommended device beside what else could be done, and what it bears: what the card of `design_gap` tells. SI units."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impact_env.curve import CurveCase, performance_curves
from impact_env.drive import Drive
from impact_env.ensemble import Executor, Lane, draw_members, each_lane, run_lanes
from impact_env.modes import ModalModel, Structure, modal_model
from impact_env.parameters import (
    ParameterError,
    instance,
    non_negative,
    positive,
    require,
    text,
)
from impact_env.results import Record, Response, require_recorded
from impact_env.sweep import simulate
from optimisation.baselines import Baselines, simulate_baselines
from optimisation.gap_advice import Advice, Answer
from optimisation.mounting import with_more_modes
from optimisation.uncertain import Distribution, drawn, shares

Array = NDArray[np.float64]
# of what is uncertain; the seed of members that no search has seen
DRAWS = 64
UNSEEN = 1
FACTORS = np.geomspace(0.25, 4.0, 97)  # of the force
EFFECTIVE_RATIO = 0.5  # of the level without absorber, which a device that works is below


@dataclass(frozen=True)
class ImpactLoads:
    """What impacts do over the worse of a sweep up and down: largest and RMS relative speed (m/s), number a second, and power lost (W).

    ``omega``: the higher frequency of the structure's level in rad/s.
    """

    largest: float
    rms: float
    rate: float
    power: float
    omega: float


@dataclass(frozen=True, eq=False)
class ServiceLoads:
    """What a device bears and what else there is: levels in m (RMS).

    ``works`` and ``helps``: lowest and highest force in N of those known where it at least halves the level, and where it lowers it; NaN for none.
    """

    answer: Answer
    forces: Array
    levels: Array
    impacts: ImpactLoads
    works: tuple[float, float]
    helps: tuple[float, float]
    baselines: Baselines


def service_loads(advice: Advice, answer: Answer, executor: Executor) -> ServiceLoads:
    """Run a device once up and once down with its impacts recorded, and other absorbers; raises KeyboardInterrupt if that is stopped."""
    check = advice.check
    impacts = impact_loads(check.swept.curve_case(answer.absorber), executor)
    forces = check.force * FACTORS
    without = float(check.without.median[0]) / check.force
    levels = np.array([advice.at_force(answer, float(factor)) for factor in FACTORS])
    works, helps = (
        contiguous_range(forces, levels < share * without * forces, len(forces) // 2)
        for share in (EFFECTIVE_RATIO, 1.0)
    )
    baselines = simulate_baselines(
        check.model,
        check.absorber.mass_ratio,
        (check.force, check.resonance),
        check.limits,
        check.rate,
        executor,
    )
    return ServiceLoads(answer, forces, levels, impacts, works, helps, baselines)


def impact_loads(case: CurveCase, executor: Executor) -> ImpactLoads:
    """Run a case's first force once up and once down with its impacts recorded; raises KeyboardInterrupt if that is stopped."""
    lanes = [
        Lane(case.scene, Drive(float(case.forces[0]), schedule), case.steady_start)
        for schedule in case.schedules()
    ]
    pairs = each_lane(lanes, _impacts, executor=executor)
    complete = [one for one in pairs if one is not None]
    if len(complete) < len(lanes):
        raise KeyboardInterrupt
    largest, rms, rate, power, ratio = (float(x) for x in np.max(complete, axis=0))
    return ImpactLoads(
        largest, rms, rate, power, ratio * case.scene.model.resonance_omega(case.resonance)
    )


def change_with_modes(
    advice: Advice, answer: Answer, structure: Structure, seed: int, executor: Executor
) -> str:
    """Return in words what twice the modes change of a device's level; nothing where the structure has no more."""
    beam = with_more_modes(structure)
    check = advice.check
    if beam is None:
        return ""
    case = check.swept.curve_case(answer.absorber, modal_model(beam))
    (curve,) = performance_curves([case], advice.members, seed, executor=executor)
    return f"; with {beam.modes} the level is {1e3 * curve.median[0]:.4g} mm, {curve.median[0] / answer.level:.2f} times as high"


def uncertain_levels(
    advice: Advice, answer: Answer, every: Sequence[Distribution], executor: Executor
) -> tuple[float, float, float]:
    """Return the 5, 50 and 95 % quantiles of a device's level in m with all that is uncertain drawn; raises KeyboardInterrupt if it is stopped."""
    check = advice.check
    case = check.swept.curve_case(answer.absorber)
    ensemble = draw_members(DRAWS + 1, UNSEEN)[1:]
    pairs = zip(
        *(ensemble.drives(check.force, schedule) for schedule in case.schedules()), strict=True
    )
    lanes = [
        drawn(
            Lane(case.scene, drive, case.steady_start), every, share, check.resonance, check.force
        )
        for pair, share in zip(pairs, shares(every, ensemble), strict=True)
        for drive in pair
    ]
    levels = run_lanes(lanes, executor=executor)
    if not levels.complete:
        raise KeyboardInterrupt
    low, median, high = np.quantile(levels.level.reshape(DRAWS, 2).max(axis=1), (0.05, 0.5, 0.95))
    return float(low), float(median), float(high)


def _impacts(lane: Lane) -> tuple[float, ...]:
    """Return a lane's `impact_numbers`, and the frequency of its level over the resonance's."""
    response = simulate(lane.scene, lane.drive, initial=lane.start, record=Record(events=True))
    assert response.level is not None
    return *impact_numbers(response), response.level.frequency_ratio


def impact_numbers(response: Response) -> tuple[float, float, float, float]:
    """Return largest and RMS speed of a run's impacts (m/s), their number a second, and the power lost in them (W)."""
    impacts = require_recorded("impacts", response.impacts)
    time = float(response.drive.schedule.times[-1])
    speed = np.abs(impacts.relative_velocity)
    rms = float(np.sqrt(np.mean(speed**2))) if len(speed) else 0.0
    return (
        float(np.max(speed, initial=0.0)),
        rms,
        len(speed) / time,
        float(np.sum(impacts.energy_lost)) / time,
    )


def contiguous_range(forces: Array, good: NDArray[np.bool_], middle: int) -> tuple[float, float]:
    """Return the lowest and highest force of the stretch around a force, by its index, that is good; NaN where that is not."""
    if not good[middle]:
        return float("nan"), float("nan")
    bad = np.flatnonzero(~good)
    first = int(np.max(bad[bad < middle], initial=-1)) + 1
    last = int(np.min(bad[bad > middle], initial=len(good))) - 1
    return float(forces[first]), float(forces[last])


# A first estimate of what an impact does where absorber and wall touch: contact time, peak force and pressure of two elastic bodies by Hertz.
#
# Source: K. L. Johnson, Contact Mechanics, Cambridge 1985, section 11.4: a sphere that meets a half-space, quasi-static, with no loss. So contact
# times are too short and forces too large where restitution is well below 1, and flat faces or yielding change both. SI units.


# usual values: Young's modulus in Pa, Poisson's ratio
MATERIALS = {
    "steel": (210e9, 0.3),
    "aluminium": (70e9, 0.33),
    "brass": (100e9, 0.35),
    "titanium": (110e9, 0.34),
    "glass": (70e9, 0.22),
    "pom": (2.8e9, 0.37),
    "nylon": (2.5e9, 0.4),
}
ALLOWED = f"one of {', '.join(MATERIALS)}, or E:NU, Young's modulus in Pa above 0 and Poisson's ratio from 0 to 0.5"


@dataclass(frozen=True)
class Contact:
    """Contact ``time`` in s, peak ``force`` in N and ``pressure`` in Pa, and the ``mass`` in kg with which absorber and structure meet."""

    time: float
    force: float
    pressure: float
    mass: float


def material(name: str) -> tuple[float, float]:
    """Return Young's modulus in Pa and Poisson's ratio of a name of `MATERIALS` or of E:NU; raises ParameterError for all else."""
    name = text("material", name)
    if name in MATERIALS:
        return MATERIALS[name]
    try:
        young, poisson = map(float, name.split(":"))
    except ValueError as error:
        raise ParameterError(f"material = {name!r} is not allowed: {ALLOWED}") from error
    require(np.isfinite(young) and young > 0 and 0 <= poisson <= 0.5, "material", name, ALLOWED)
    return young, poisson


def estimate(first: str, second: str, radius: float, mass: float, speed: float) -> Contact:
    """Return the contact of two materials: ``radius`` in m of the rounder one, effective ``mass`` in kg and relative ``speed`` in m/s above 0."""
    softness = sum((1 - poisson**2) / young for young, poisson in map(material, (first, second)))
    radius = positive("radius", radius)
    mass = positive("mass", mass)
    speed = positive("speed", speed)
    stiff = 1 / softness
    depth = (15 * mass * speed**2 / (16 * np.sqrt(radius) * stiff)) ** 0.4
    force = 4 / 3 * stiff * np.sqrt(radius) * depth**1.5
    time = 2.87 * (mass**2 / (radius * stiff**2 * speed)) ** 0.2
    return Contact(float(time), float(force), float(3 * force / (2 * np.pi * radius * depth)), mass)


YIELD_PRESSURE = 1.6  # times the yield stress: the peak pressure at which yield begins below the surface (Johnson 1985)


def speed_for_pressure(
    first: str, second: str, radius: float, mass: float, pressure: float
) -> float:
    """Return the relative speed in m/s at which `estimate` gives a peak ``pressure`` in Pa: it goes with the speed to the power of 2/5."""
    one = estimate(first, second, radius, mass, 1.0)
    return (positive("pressure", pressure) / one.pressure) ** 2.5


def meeting_mass(model: ModalModel, absorber_mass: float) -> float:
    """Return the mass in kg with which an absorber and the place of the structure meet, by the modes kept."""
    model = instance("model", model, ModalModel)
    return 1 / (
        1 / positive("absorber mass", absorber_mass)
        + non_negative("mobility", float(np.sum(model.tip_shape**2)))
    )


@dataclass(frozen=True)
class YieldLimit:
    """A limit on impacts: yield must not begin below the surface where two materials touch.

    ``materials`` as in `material`; ``radius`` in m of the rounder one; ``yield_stress`` in Pa of the softer one, whose peak pressure stays below
    `YIELD_PRESSURE` times it.
    """

    materials: tuple[str, str]
    radius: float
    yield_stress: float

    def __post_init__(self) -> None:
        for name in self.materials:
            material(name)
        for name, label in (
            ("radius", "radius of --contact in m"),
            ("yield_stress", "constraint yield_stress"),
        ):
            object.__setattr__(self, name, positive(label, getattr(self, name)))

    def speed(self, model: ModalModel, absorber_mass: float) -> float:
        """Return the impact speed in m/s at which yield begins, for an absorber's mass in kg at the place of a model."""
        mass = meeting_mass(model, absorber_mass)
        pressure = YIELD_PRESSURE * self.yield_stress
        return speed_for_pressure(*self.materials, self.radius, mass, pressure)


def reaches_beyond(model: ModalModel, contact: Contact) -> bool:
    """Return whether a pulse of this time has much force above the highest mode kept: at frequencies up to one over its time."""
    return bool(np.max(model.omega) / (2 * np.pi) < 1 / contact.time)
