"""The design rule: the limit leaves zero at the force f*, and the gap that puts f* at a wanted force follows without simulation."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_env.frequency import frequency_range
from impact_env.modes import ModalModel
from impact_env.parameters import DEFAULT_MASS_RATIO, non_negative, positive, require
from optimisation.bounds.lines import masses_of, stuck_frequencies
from optimisation.bounds.stroke import GRID, SWEPT, line_terms, resonance_limit, smallest
from optimisation.tuned import highest_amplitude

Real = NDArray[np.float64]

NEAR = (0.93, 1.06)  # of the resonance frequency, where `design_force` asks for the limit to be zero, for a mass like the paper's
# free amplitude over the rule's gap: below the first no answer, below the second the best gap is narrower, above the third it is wider
LEAST_REACH, SMALL_REACH, LARGE_REACH = 1.0, 1.5, 6.0
LIGHT_DAMPING, LEAST_DAMPING = 0.005, 0.0015  # damping ratios between which `expected_factor` grows
_LEAST = 0.5  # of the resonance with the mass stuck: where the range begins at the lowest


def near_range(model: ModalModel, mass: float, resonance: int = 1) -> tuple[float, float]:
    """Return the default (low, high) of `design_force` in units of omega_r: `NEAR` for the paper's mass ratio, for a mass in kg.

    All that an absorber does to a resonance happens within a few times the shift of the frequency by the stuck mass, so the lower end is as far
    below 1 as that shift is larger or smaller than with the paper's mass ratio. At higher resonances and masses from a tenth of the
    beam's an antiresonance comes into the range, and the rule then asks for too wide a gap.
    """
    usual, shift = (1 - _stuck_ratio(model, m, resonance) for m in (DEFAULT_MASS_RATIO * model.beam_mass, mass))
    if usual <= 0:  # a node at the absorber
        return NEAR
    return max(_LEAST * (1 - shift), 1 - (1 - NEAR[0]) * shift / usual), NEAR[1]


def _stuck_ratio(model: ModalModel, mass: float, resonance: int) -> float:
    """Return the natural frequency of the beam with the mass stuck to it, over omega_r."""
    omega_r = model.resonance_omega(resonance)
    return float(stuck_frequencies(model, masses_of(model, mass))[resonance - 1]) / omega_r


def design_force(model: ModalModel, mass: float, gap: float, resonance: int = 1, low: float | None = None, high: float | None = None) -> float:
    """Return f* in N, the force at which the limit leaves zero somewhere in low..high times omega_r: min over Omega of |kappa| R/|G_f|.

    ``mass`` m_a in kg, ``gap`` g0 in m. The paper's best operating points of the first two modes, found by simulation, lie close to f*.
    For the paper's beam |kappa|/|G_f| grows with the frequency, so the minimum sits at the lower end of the range, and f* depends on
    where "near the resonance" begins: 1 % of frequency moves it by 2 % at the first mode and by 5 to 6 % at the second. The default
    begins 7 % below the resonance for the paper's mass ratio, see `near_range`. It is the absorber's own place whose limit is meant, also where
    the level is read elsewhere: there the absorber gets its motion from. Raises ParameterError for numbers out of range, and for a
    range without the resonance of the beam with the mass stuck to it, around which the limit is largest.
    """
    omega_r, default = model.resonance_omega(resonance), near_range(model, mass, resonance)
    low, high = frequency_range(default[0] if low is None else low, default[1] if high is None else high)
    stuck = _stuck_ratio(model, mass, resonance)
    require(low <= stuck <= high, "range (low, high)", (low, high), f"a range that holds the resonance with the mass stuck, at {stuck:.4f}")

    def needed(ratio: Real) -> Real:
        by_force, reach, _ = line_terms(model, mass, gap, ratio * omega_r, model.tip_shape)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.where(by_force > 0, reach / by_force, np.inf))

    grid = np.linspace(low, high, GRID)
    forces = needed(grid)
    require(bool(np.isfinite(forces.min())), "force_shape", model.force_shape, "a force that moves the tip")
    return smallest(lambda ratio: float(needed(np.asarray(ratio))), grid, forces)[0]


def design_gap(model: ModalModel, mass: float, force: float, resonance: int = 1, low: float | None = None, high: float | None = None) -> float:
    """Return the half-clearance g0 in m whose `design_force` is ``force`` (N): f* is proportional to the gap, so no simulation is needed."""
    return positive("force", force) / design_force(model, mass, 1.0, resonance, low, high)


def free_amplitude(model: ModalModel, mass: float, force: float, resonance: int = 1) -> float:
    """Return the largest stationary amplitude in m of the place of an absorber of ``mass`` (kg) without it, over `near_range`, for a force in N.

    Infinite at an undamped resonance. Raises ParameterError for numbers out of range.
    """
    own = replace(model, response_shape=None)
    return positive("force", force) * highest_amplitude(own, None, resonance, *near_range(model, mass, resonance))[0]


def reach(model: ModalModel, mass: float, resonance: int = 1) -> float:
    """Return `free_amplitude` over `design_gap`, at any force: both are proportional to it.

    Below 1 the free structure does not fill the rule's cavity, so that an absorber without friction never touches a wall: at a node, with little
    motion, with much damping or a very light mass. Then the rule says nothing. Raises ParameterError as `design_gap` does.
    """
    return free_amplitude(model, mass, 1.0, resonance) / design_gap(model, mass, 1.0, resonance)


def require_reach(model: ModalModel, mass: float, force: float, resonance: int = 1) -> float:
    """Return `reach`; raises ParameterError, with gap and free amplitude, where it is below `LEAST_REACH`."""
    found = reach(model, mass, resonance)
    if found < LEAST_REACH:
        gap, free = (1e3 * x for x in (design_gap(model, mass, force, resonance), free_amplitude(model, mass, force, resonance)))
        require(
            False,
            f"gap by the rule for {force:g} N at resonance {resonance}, in mm",
            float(f"{gap:.4g}"),
            f"where the place of the absorber moves as far without it, and here that is {free:.4g} mm ({found:.3g} of the gap): no wall would be "
            "touched (choose another place, a heavier absorber, or a structure with less damping)",
        )
    return found


def expected_gap(model: ModalModel, mass: float, force: float, resonance: int = 1) -> float:
    """Return the gap in m that simulations of other structures let expect to be best: the rule's times `expected_factor`.

    Raises ParameterError as `design_gap` does.
    """
    gap, found = design_gap(model, mass, force, resonance), reach(model, mass, resonance)  # first: they know which resonances there are
    return expected_factor(found, float(model.damping_ratio[resonance - 1])) * gap


def expected_factor(reach: float, damping: float) -> float:
    """Return the best gap over the rule's that simulations let expect, for free amplitude over the rule's gap and the resonance's damping ratio.

    A fit, not a theory (docs/which_gap.md says how good it is): (reach/2.5)^0.6 but at least 0.25 below 2.5, 1 up to 6, and above 1.2, times
    (0.005/damping)^0.2 for a damping from 0.5 % down to 0.15 %.
    """
    if reach > LARGE_REACH:
        return 1.2 * max(1.0, LIGHT_DAMPING / max(damping, LEAST_DAMPING)) ** 0.2
    return float(np.clip((reach / 2.5) ** 0.6, 0.25, 1.0))


def gap_unit(model: ModalModel, mass: float, force: float, resonance: int = 1) -> float:
    """Return the rule's gap in m, or the free amplitude where that is smaller: a length by which gaps can be counted on any structure."""
    return min(design_gap(model, mass, force, resonance), free_amplitude(model, mass, force, resonance))


def common_gap(model: ModalModel, mass: float, forces: Mapping[int, float]) -> float:
    """Return the smallest gap in m for which the limit is zero near several resonances at once.

    ``forces`` gives the force in N for each resonance (counted from 1). It is the largest of the single gaps: a smaller one lets the limit
    leave zero at one of the resonances, a larger one costs level at all of them, since levels below f* are proportional to the gap.
    """
    require(len(forces) > 0, "forces", dict(forces), "at least one resonance with its force in N")
    return max(design_gap(model, mass, force, resonance) for resonance, force in forces.items())


# How much of the possible reduction a design reached: 0 is no absorber, 1 is the limit.


def _levels(name: str, values: ArrayLike) -> Real:
    array = np.asarray(values, dtype=np.float64)
    require(bool(np.all(np.isfinite(array) & (array >= 0))), name, values, "finite levels in m, 0 or above")
    return array


def reduction_share(level: ArrayLike, without: ArrayLike, limit: ArrayLike) -> Real:
    """Return (without - level)/(without - limit), of the broadcast shape of the three levels in m.

    ``without`` is the level without an absorber, ``limit`` what no device can go below. A limit lies below the best device, so the share is
    a lower bound of what was reached; below 0 means worse than no absorber, and above 1 a level that is not a stationary one (a
    sweep's). Raises ParameterError where limit >= without: nothing can be gained there.
    """
    reached, start, end = _levels("level", level), _levels("without", without), _levels("limit", limit)
    require(bool(np.all(end < start)), "limit", limit, f"below the level without an absorber, {without!r} m")
    return np.asarray((start - reached) / (start - end))


def share_reached(
    model: ModalModel,
    mass: float,
    gap: float,
    force: float,
    level: ArrayLike,
    resonance: int = 1,
    low: float = SWEPT[0],
    high: float = SWEPT[1],
) -> Real:
    """Return the share of the possible reduction that a ``level`` (m, RMS, any shape) reached near a resonance, of level's shape.

    ``level`` is a design's largest level over low..high times omega_r, simulated or measured, at a ``force`` in N; ``mass`` m_a in kg and ``gap`` g0
    in m are the design's, and the limit is `resonance_limit`. It is compared with the free beam's largest stationary level over that range.
    Raises ParameterError for numbers out of range, a force of 0, and an undamped resonance in the range.
    """
    low, high = frequency_range(low, high)
    require(non_negative("force", force) > 0, "force", force, "above 0 N, since nothing is to be reduced")
    without = float(force) * highest_amplitude(model, None, resonance, low, high)[0] / np.sqrt(2)
    require(bool(np.isfinite(without)), "damping_ratio", model.damping_ratio, "above 0 at every resonance of the range")
    return reduction_share(level, without, resonance_limit(model, mass, gap, force, resonance, low, high))
