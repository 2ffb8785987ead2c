"""The recommended device beside what else could be done, and what it bears: what the card of `design_gap` tells. SI units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impact_env.curve import CurveCase
from impact_env.drive import Drive
from impact_env.ensemble import Executor, Lane, draw_members, each_lane, run_lanes
from impact_env.parameters import ParameterError
from impact_env.response import Record
from impact_env.scene import Scene
from impact_env.sweep import simulate
from optimisation.friction_rule import best_friction
from optimisation.gap_advice import Advice, Answer
from optimisation.tuned import HIGH, LOW, highest_amplitude, minimax
from optimisation.uncertain import Spread, drawn, shares

Array = NDArray[np.float64]
DRAWS, UNSEEN = 64, 1  # of what is uncertain; the seed of members that no search has seen
FACTORS = np.geomspace(0.25, 4.0, 97)  # of the force
HALVED = 0.5  # of the level without absorber, which a device that works is below


@dataclass(frozen=True)
class Impacts:
    """What impacts do over the worse of a sweep up and down: largest and RMS relative speed (m/s), number a second, and power lost (W)."""

    largest: float
    rms: float
    rate: float
    power: float


@dataclass(frozen=True, eq=False)
class Bearing:
    """What a device bears and what else there is: levels in m (RMS).

    ``works`` and ``helps``: lowest and highest force in N of those known where it at least halves the level, and where it lowers it; NaN for none.
    ``tuned``: the smallest peak of a tuned absorber of the same mass, stationary, over the wide range; ``damper``: a friction damper of the same mass
    with its best limit, both by the energy of a cycle, ``damper_limit`` in N.
    ``acceleration``: that of the structure at the level's frequency, m/s^2.
    """

    answer: Answer
    forces: Array
    levels: Array
    impacts: Impacts
    works: tuple[float, float]
    helps: tuple[float, float]
    tuned: float
    damper: float
    damper_limit: float
    acceleration: float


def bearing(found: Advice, answer: Answer, threads: int | None = None, executor: Executor | None = None) -> Bearing:
    """Run a device once up and once down with its impacts recorded, and its rivals; raises KeyboardInterrupt if that is stopped."""
    check = found.check
    model, force, resonance = check.model, check.force, check.resonance
    case = CurveCase(Scene(model, answer.absorber), np.array([force]), resonance, check.limits, check.rate)
    drives = [Drive(force, schedule) for schedule in case.schedules()]
    where = {"threads": threads if executor is None else None, "executor": executor}
    pairs = each_lane([Lane(case.scene, drive) for drive in drives], _impacts, **where)  # type: ignore[arg-type]
    seen = [one for one in pairs if one is not None]
    if len(seen) < len(drives):
        raise KeyboardInterrupt
    worse = Impacts(*(float(x) for x in np.max([[one.largest, one.rms, one.rate, one.power] for one, _ in seen], axis=0)))
    forces, without = force * FACTORS, float(check.without.median[0]) / force
    levels = np.array([found.at_force(answer, float(factor)) for factor in FACTORS])
    relative = levels / (without * forces)
    try:
        limit, damper = best_friction(model, check.mass, force, resonance)
    except ParameterError:  # no such damper where the resonance's own mode does not move the place, or the force
        limit, damper = float("nan"), float("nan")
    acceleration = float(np.sqrt(2) * answer.level * (max(seen, key=lambda one: one[1])[1] * model.resonance_omega(resonance)) ** 2)
    return Bearing(
        answer,
        forces,
        levels,
        worse,
        _range(forces, relative < HALVED),
        _range(forces, relative < 1),
        force * highest_amplitude(model, minimax(model, check.absorber.mass_ratio, resonance), resonance, LOW, HIGH)[0] / float(np.sqrt(2)),
        damper,
        limit,
        acceleration,
    )


def uncertain_levels(
    found: Advice, answer: Answer, every: Sequence[Spread], draws: int = DRAWS, threads: int | None = None, executor: Executor | None = None
) -> tuple[float, float, float]:
    """Return the 5, 50 and 95 % quantiles of a device's level in m with all that is uncertain drawn; raises KeyboardInterrupt if it is stopped."""
    check = found.check
    case = CurveCase(Scene(check.model, answer.absorber), np.array([check.force]), check.resonance, check.limits, check.rate)
    ensemble = draw_members(draws + 1, UNSEEN)[1:]
    pairs = zip(*(ensemble.drives(check.force, schedule) for schedule in case.schedules()), strict=True)
    lanes = [
        drawn(Lane(case.scene, drive), every, share, check.resonance, check.force)
        for pair, share in zip(pairs, shares(every, ensemble), strict=True)
        for drive in pair
    ]
    levels = run_lanes(lanes, threads=threads if executor is None else None, executor=executor)
    if not levels.complete:
        raise KeyboardInterrupt
    low, median, high = np.quantile(levels.level.reshape(draws, 2).max(axis=1), (0.05, 0.5, 0.95))
    return float(low), float(median), float(high)


def _impacts(lane: Lane) -> tuple[Impacts, float]:
    """Return a lane's impact speeds, rate and power, and the frequency of its level over the resonance's."""
    response = simulate(lane.scene, lane.drive, record=Record(events=True))
    impacts, level = response.impacts, response.level
    assert impacts is not None
    assert level is not None
    speed, time = np.abs(impacts.relative_velocity), float(lane.drive.schedule.times[-1])
    rms = float(np.sqrt(np.mean(speed**2))) if len(speed) else 0.0
    largest = float(np.max(speed, initial=0.0))
    return Impacts(largest, rms, len(speed) / time, float(np.sum(impacts.energy_lost)) / time), level.frequency_ratio


def _range(forces: Array, good: NDArray[np.bool_]) -> tuple[float, float]:
    """Return the lowest and highest force of the stretch around the middle one that is good; NaN where that is not."""
    middle = len(forces) // 2
    if not good[middle]:
        return float("nan"), float("nan")
    low = high = middle
    while low > 0 and good[low - 1]:
        low -= 1
    while high < len(forces) - 1 and good[high + 1]:
        high += 1
    return float(forces[low]), float(forces[high])
