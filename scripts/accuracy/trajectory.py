"""Error over the first impacts and balance of energy against run time, for each scene and method."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from accuracy.cases import BARE, KINDS, Case, Kind, case, kind_named, method_name
from accuracy.event_driven import PeerFailedError, PeerRun, follow, scipy_integrator
from accuracy.reference import Trajectory, reference
from accuracy.study import Row, Settings, median_time
from impact_env.methods import Exact, Method
from impact_env.response import Record
from impact_env.sweep import IntegrationError, simulate

Array = NDArray[np.float64]
NAME = "trajectory"
IMPACTS = 5  # the error is read in the widest gap between two impacts from this one on
LATEST = 9
MOST_PERIODS = 6.0
WITHOUT_IMPACTS = 2.3  # pseudo periods
LONGEST = 100.0  # pseudo periods of a timed run
WATCHED = Record(level=False, events=True, energy=True)


@dataclass(frozen=True, eq=False)
class Truth:
    """The reference of a case: end of the compared stretch in pseudo periods, state there, impact times (s) up to there."""

    periods: float
    end_state: Array
    impact_time: Array


def truth_of(it: Case) -> Truth:
    """Compute the reference up to the middle of the widest gap between late impacts, where no method is just at one."""
    drive = it.drive(MOST_PERIODS)
    walled = getattr(it.scene.absorber, "walls", None) is not None
    periods = WITHOUT_IMPACTS
    if walled:
        times = _times(reference(it.scene, drive, it.initial, impacts=LATEST)) / it.period
        late = times[IMPACTS - 1 :]
        if len(late) > 1:
            k = int(np.argmax(np.diff(late)))
            periods = float(0.5 * (late[k] + late[k + 1]))
    ended = reference(it.scene, it.drive(periods), it.initial)
    return Truth(periods, ended.end_state, _times(ended))


def _times(trajectory: Trajectory) -> Array:
    return np.array([float(t) for t in trajectory.impact_time])


def state_error(it: Case, state: Array, true: Array) -> float:
    """Return the distance of two states in the norm of energy, relative to the true state's; the absorber's place counts as on a spring of omega_1."""
    n, model = it.modes, it.scene.model
    mass = it.scene.absorber_mass or 0.0
    weights = np.concatenate([model.omega**2, [mass * model.omega[0] ** 2], np.ones(n), [mass]])
    return float(np.sqrt(np.sum(weights * (state - true) ** 2) / np.sum(weights * true**2)))


def _impact_error(it: Case, times: Array, truth: Truth, k: int) -> float | None:
    if min(len(times), len(truth.impact_time)) < k:
        return None
    return float(abs(times[k - 1] - truth.impact_time[k - 1]) / it.period)


def _row(it: Case, name: str, setting: float | None, truth: Truth) -> Row:
    return {
        "scene": it.kind.name,
        "modes": it.modes,
        "method": name,
        "setting": setting,
        "compared_periods": truth.periods,
        "impacts": len(truth.impact_time),
        "us_per_period": None,
        "state_error": None,
        "first_impact_error_periods": None,
        "fifth_impact_error_periods": None,
        "balance_error": None,
        "note": "",
    }


def _fill(row: Row, it: Case, truth: Truth, state: Array, times: Array, balance: float | None) -> None:
    row["state_error"] = state_error(it, state, truth.end_state)
    row["first_impact_error_periods"] = _impact_error(it, times, truth, 1)
    row["fifth_impact_error_periods"] = _impact_error(it, times, truth, IMPACTS)
    row["balance_error"] = balance


def own_row(it: Case, truth: Truth, method: Method, settings: Settings) -> Row:
    """Measure one of the package's methods."""
    row = _row(it, method_name(method, it.scene), None if isinstance(method, Exact) else method.steps_per_period, truth)
    try:
        response = simulate(it.scene, it.drive(truth.periods), method, initial=it.initial, record=WATCHED)
        assert response.impacts is not None
        assert response.energy is not None
        _fill(row, it, truth, response.end_state, response.impacts.time, response.energy.relative_error)
        row["us_per_period"] = own_time(it, method, truth.periods, settings)
    except IntegrationError as error:
        row["note"] = str(error)
    return row


def own_time(it: Case, method: Method, shortest: float, settings: Settings) -> float:
    """Return the time of a pseudo period in us: the median of runs that are long enough to be timed."""

    def run(periods: float) -> float:
        return simulate(it.scene, it.drive(periods), method, initial=it.initial, record=BARE).wall_time / periods

    run(0.01)  # compile
    rough = run(min(shortest, 1.0))
    periods = float(np.clip(settings.timed_seconds / max(rough, 1e-9), min(shortest, 1.0), LONGEST))
    return 1e6 * median_time(lambda: run(periods), settings.repeats, settings.patience)


def peer_row(it: Case, truth: Truth, name: str, tolerance: float, make: Any, with_energy: Any, settings: Settings) -> Row:
    """Measure a peer: ``make`` and ``with_energy`` make its integrator without and with an account of energy."""
    row = _row(it, name, tolerance, truth)
    drive = it.drive(truth.periods)
    try:
        run: PeerRun = follow(it.scene, drive, it.initial, make)
        balance = follow(it.scene, drive, it.initial, with_energy, energy=True).balance
        _fill(row, it, truth, run.end_state, run.impact_time, balance)

        def again() -> float:
            return follow(it.scene, drive, it.initial, make).wall_time

        slow = run.wall_time > settings.patience
        seconds = run.wall_time if slow else median_time(again, settings.repeats, settings.patience)
        row["us_per_period"] = 1e6 * seconds / truth.periods
    except PeerFailedError as error:
        row["note"] = str(error)
    return row


def peers(settings: Settings) -> list[tuple[str, float, Any, Any]]:
    """Return name, tolerance and makers of each peer; heyoka where it is installed."""
    if not settings.peers:
        return []
    found: list[tuple[str, float, Any, Any]] = [("SciPy", t, scipy_integrator(t), scipy_integrator(t)) for t in settings.scipy_tolerances]
    try:
        from accuracy.heyoka_peer import heyoka_integrator
    except ModuleNotFoundError:
        return found
    # one that is compiled belongs to one scene: made anew for each
    return found + [("heyoka", t, heyoka_integrator, heyoka_integrator) for t in settings.heyoka_tolerances]


def wanted_kinds(settings: Settings) -> list[Kind]:
    return [kind_named(name) for name in settings.kinds] if settings.kinds else list(KINDS)


def count(settings: Settings) -> int:
    return len(wanted_kinds(settings)) * len(settings.modes)


def rows(settings: Settings) -> Iterator[list[Row]]:
    """Yield the rows of one scene and number of modes after the other."""
    for kind in wanted_kinds(settings):
        for modes in settings.modes:
            it = case(kind, modes)
            truth = truth_of(it)
            found = [own_row(it, truth, method, settings) for method in it.methods(settings.steps)]
            for name, tolerance, make, with_energy in peers(settings):
                makers = (make(tolerance), with_energy(tolerance)) if name == "heyoka" else (make, with_energy)
                found.append(peer_row(it, truth, name, tolerance, *makers, settings))
            yield found


