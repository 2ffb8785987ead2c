"""Basins of attraction: on which motions runs from random initial states end, and their shares with intervals."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.stats
from numpy.typing import NDArray

from impact_env.parameters import count, positive
from impact_env.periodic.case import Case
from impact_env.periodic.green import NoOrbit
from impact_env.periodic.orbit import Orbit, mirror_orbit
from impact_env.periodic.passage import RECORD
from impact_env.periodic.shooting import units_of
from impact_env.periodic.survey import (
    MOST_MULTIPLE,
    RETURN_TOL,
    find_return,
    is_same_orbit,
    least_multiple,
    orbit_next_to,
)
from impact_env.scene import InitialState
from impact_env.sweep import simulate

Array = NDArray[np.float64]
RunProgress = Callable[[int, int], None]
DEFAULT_RUNS = 16
LEAST_RUNS = 1
MOST_PERIODS_OF_RUN = 2000  # of the force
CHECKED_SHARES = (0.125, 0.25, 0.5, 1.0)  # of the periods: where a run is compared with orbits
CAPTURE_TOL = 1e-6  # of gap and gap times omega: a run so close to a stable orbit stays there
START_REACH = 1.5  # of the larger of gap and tip displacements: how far initial states reach
BASIN_CONFIDENCE = 0.95


@dataclass(frozen=True)
class Share:
    """The share of ``runs`` that ``ended`` on a motion: ``value``, with the limits ``low`` and ``high`` of Wilson's 95 % interval."""

    ended: int
    runs: int

    @property
    def value(self) -> float:
        """The share."""
        return self.ended / self.runs

    @property
    def low(self) -> float:
        """Lower limit of the interval."""
        return self._interval()[0]

    @property
    def high(self) -> float:
        """Upper limit of the interval."""
        return self._interval()[1]

    def _interval(self) -> tuple[float, float]:
        result = scipy.stats.binomtest(self.ended, self.runs).proportion_ci(
            BASIN_CONFIDENCE, method="wilson"
        )
        return float(result.low), float(result.high)

    def to_plain(self) -> dict[str, Any]:
        """Return the number of runs that ended there, the share, and the limits of its interval."""
        return {"ended": self.ended, "share": self.value, "low": self.low, "high": self.high}


@dataclass(frozen=True, eq=False)
class Basins:
    """On what runs from random initial states ended after so many ``periods`` of the force, or before that at a stable orbit.

    ``orbits`` with impacts, all of them stable, and ``ended`` (as many): the runs on each. ``without_impacts``: runs whose impacts had come to an
    end. ``nothing_periodic``: all others, which are chaotic, quasi-periodic, of a longer period, or still on their way.
    """

    orbits: tuple[Orbit, ...]
    ended: tuple[int, ...]
    without_impacts: int
    nothing_periodic: int
    periods: int
    seed: int

    @property
    def runs(self) -> int:
        """Number of runs."""
        return sum(self.ended) + self.without_impacts + self.nothing_periodic

    def share_of(self, orbit: Orbit) -> Share:
        """Return the share of the runs that ended on an orbit."""
        number = sum(
            number
            for other, number in zip(self.orbits, self.ended, strict=True)
            if is_same_orbit(orbit, other)
        )
        return Share(number, self.runs)

    @property
    def share_without_impacts(self) -> Share:
        """The share of the runs that ended without impacts."""
        return Share(self.without_impacts, self.runs)

    @property
    def share_of_nothing_periodic(self) -> Share:
        """The share of the runs that ended on no periodic motion."""
        return Share(self.nothing_periodic, self.runs)

    def to_plain(self, orbit: Orbit) -> dict[str, Any]:
        """Return the share of an orbit, and of the runs that ended on none, as plain values."""
        return {
            "runs": self.runs,
            "periods": self.periods,
            "seed": self.seed,
            **self.share_of(orbit).to_plain(),
            "without_impacts": self.share_without_impacts.to_plain(),
            "nothing_periodic": self.share_of_nothing_periodic.to_plain(),
        }


def draw_start(case: Case, reach: float, rng: np.random.Generator) -> tuple[Array, float]:
    """Return a random state (2 N_m + 2,) and phase of the force in rad.

    All are uniform: the phase over a turn, the relative displacement over the clearance, and between both signs of these the relative velocity up to
    ``reach`` (m) times the force's frequency, each mode's velocity at the tip up to ``reach`` times the first resonance, and its displacement up to
    that over its own resonance.
    """
    model = case.model
    largest = float(np.max(np.abs(model.tip_shape))) or 1.0
    velocity = reach * float(model.omega[0]) / largest * rng.uniform(-1, 1, model.modes)
    displacement = (
        reach * float(model.omega[0]) / (largest * model.omega) * rng.uniform(-1, 1, model.modes)
    )
    shape = model.tip_shape
    absorber = float(shape @ displacement) + case.gap * rng.uniform(-1, 1)
    rate = float(shape @ velocity) + reach * case.omega * rng.uniform(-1, 1)
    state = np.concatenate([displacement, [absorber], velocity, [rate]])
    return state, float(rng.uniform(0, 2 * np.pi))


def find_basins(
    case: Case,
    known: Sequence[Orbit] = (),
    starts: int = DEFAULT_RUNS,
    periods: int = MOST_PERIODS_OF_RUN,
    seed: int = 0,
    most_multiple: int = MOST_MULTIPLE,
    reach: float | None = None,
    progress: RunProgress | None = None,
) -> Basins:
    """Return on which motions runs from random initial states end: what they come to is brought to an orbit by Newton's method.

    Parameters
    ----------
    case
        Structure, absorber, force and frequency.
    known
        Orbits that are known already, such as those of branches.
    starts
        Number of runs, each from a state of its own (see `draw_start`).
    periods
        Periods of the force of each run; it ends before at a stable orbit.
    seed
        Of the random states.
    most_multiple
        The longest period sought, in periods of the force.
    reach
        How far initial states reach, in m. None: 1.5 times the larger of the clearance and the known orbits' tip displacements.
    progress
        Called with the number of finished runs and of all.

    Returns
    -------
    Basins
        Orbits, and the shares of the runs that end on each, without impacts, and on nothing periodic.

    Raises
    ------
    ParameterError
        For numbers out of range.
    """
    starts = count("starts", starts, LEAST_RUNS)
    periods = count("periods", periods, len(CHECKED_SHARES) * 2)
    seed = count("seed", seed, 0)
    most_multiple = count("most_multiple", most_multiple, 1)
    if reach is None:
        reach = START_REACH * max([case.gap, *(orbit.motion.tip_max for orbit in known)])
    reach = positive("reach", reach)
    stable = [orbit for orbit in known if orbit.stability.stable and len(orbit.impacts) > 0]
    ended = [0] * len(stable)
    silent = 0
    other = 0
    for k in range(starts):
        state, phase = draw_start(case, reach, np.random.default_rng([seed, k]))
        end = _find_attractor(case, state, phase, periods, most_multiple, stable)
        if isinstance(end, Orbit):
            place = next((j for j, orbit in enumerate(stable) if orbit is end), len(stable))
            if place == len(stable):
                image = () if end.schedule.symmetric else (mirror_orbit(end),)
                new = [end, *(orbit for orbit in image if isinstance(orbit, Orbit))]
                stable += new
                ended += [0] * len(new)
            ended[place] += 1
        elif end:
            silent += 1
        else:
            other += 1
        if progress is not None:
            progress(k + 1, starts)
    return Basins(tuple(stable), tuple(ended), silent, other, periods, seed)


def _find_attractor(
    case: Case,
    state: Array,
    phase: float,
    periods: int,
    most_multiple: int,
    stable: Sequence[Orbit],
) -> Orbit | bool:
    """Return the stable orbit with impacts that a run ends on, one of the known ones if it is; else whether it ends without impacts."""
    done = 0
    silent = False
    for share in CHECKED_SHARES:
        span = round(share * periods) - done
        done += span
        response = simulate(
            case.scene,
            case.drive(span * case.period, phase),
            initial=InitialState.from_vector(case.scene, state),
            record=RECORD,
        )
        state = response.end_state
        phase = (phase + 2 * np.pi * span) % (2 * np.pi)
        assert response.impacts is not None
        silent = bool(np.all(response.impacts.time < 0.5 * span * case.period))
        if silent:
            continue
        near = RETURN_TOL if done == periods else CAPTURE_TOL
        for orbit in stable:
            if distance_to(orbit, state, phase) < near:
                return orbit
        result = _find_orbit_near(case, state, phase, most_multiple)
        if result is not None and distance_to(result, state, phase) < near:
            return next((orbit for orbit in stable if is_same_orbit(orbit, result)), result)
    return silent


def _find_orbit_near(case: Case, state: Array, phase: float, most_multiple: int) -> Orbit | None:
    """Return the stable orbit with impacts next to a state that nearly comes again, of its smallest period; None where there is none."""
    symmetric, multiple, _ = find_return(case, state, phase, most_multiple)
    if multiple == 0:
        return None
    result = orbit_next_to(case, phase, state, symmetric, multiple)
    if isinstance(result, Orbit) and least_multiple(result) != multiple:
        result = orbit_next_to(case, phase, state, symmetric, least_multiple(result))
    if isinstance(result, NoOrbit) or len(result.impacts) == 0 or not result.stability.stable:
        return None
    return result


def distance_to(orbit: Orbit, state: Array, phase: float) -> float:
    """Return how far a state (2 N_m + 2,) at a phase (rad) lies from an orbit, in units of the gap and the gap times omega."""
    phases = phase + 2 * np.pi * np.arange(orbit.schedule.period_multiple)
    miss = np.abs(orbit.motion.states(phases) - state) / units_of(orbit.case)
    return float(np.min(np.max(miss, axis=1)))
