"""The first events of runs with friction, impacts, reversals, sticking and releases, against the reference with many digits."""

import numpy as np
import pytest
from core import Array, drive_of, run, scene_of

from impact_env import Drive, FrequencySchedule, InitialState, ModalModel, Scene, impact_absorber

pytest.importorskip("mpmath")
from reference import digits
from reference.contact import RELEASE_DOWN, RELEASE_UP, REVERSAL, WALL

EVENTS = 40
OTHER = ModalModel([60.0, 61.0, 340.0, 2100.0], [0.002, 0.0, 0.3, 0.05], [1.1, -0.7, 0.9, 0.4], [1.0, 0.8, -1.3, 1.6], 0.4)
CASES: dict[str, tuple[Scene, Drive, InitialState]] = {
    "paper": (
        scene_of(impact_absorber(1e-3, 0.7, 0.3), modes=5),
        drive_of(3.5, 0.98, 0.99, periods=10),
        InitialState(np.array([5e-4, 1e-5, 0.0, 0.0, 0.0])),
    ),
    "other": (
        Scene(OTHER, impact_absorber(4e-4, 0.85, 0.05, 0.05)),
        drive_of(3.0, 0.95, 1.05, periods=12, reference=60.0, phase=0.3),
        InitialState(),
    ),
}


def true_events(scene: Scene, drive: Drive, initial: InitialState) -> list[tuple[str, float, str]]:
    """Return what ended each regime, when (s), and the regime that followed; a start that sticks counts as a reversal at 0."""
    true = digits.follow(scene, drive, initial, events=EVENTS)
    first = [(REVERSAL, 0.0, true.start[0])] if true.start[0] == "stuck" else []
    return [*first, *((event.what, float(event.time), event.regime) for event in true.events)][:EVENTS]


def speed_at(scene: Scene, drive: Drive, initial: InitialState, time: float) -> float:
    """Return the relative velocity of a run that ends at a time."""
    schedule = FrequencySchedule(np.array([0.0, time]), drive.schedule.omega_at(np.array([0.0, time])), drive.schedule.reference)
    state = run(scene, Drive(drive.amplitude, schedule, drive.phase), initial=initial, samples=4).end_state
    n = scene.model.modes
    return float(state[-1] - scene.model.tip_shape @ state[n + 1 : -1])


@pytest.mark.parametrize("name", CASES)
def test_first_events_are_those_of_the_reference(name: str) -> None:
    scene, drive, initial = CASES[name]
    events, response = true_events(scene, drive, initial), run(scene, drive, initial=initial, samples=4)
    walls = np.cumsum([kind == WALL for kind, _, _ in events])
    slack = np.minimum(1e-12 * 5.0**walls, 1e-8) * drive.schedule.pseudo_period

    def same(found: Array, chosen: list[int], least: int) -> None:
        times = np.array([events[k][1] for k in chosen])
        assert len(times) >= least
        assert np.sum(found < events[-1][1] + slack[-1]) == len(times)
        assert np.all(np.abs(found[: len(times)] - times) < slack[chosen])

    same(response.impacts.time, [k for k, (kind, _, _) in enumerate(events) if kind == WALL], 4)
    same(response.phases.start, [k for k, (_, _, regime) in enumerate(events) if regime == "stuck" or regime.startswith("held")], 4)
    same(response.phases.end, [k for k, (kind, _, _) in enumerate(events) if kind in (RELEASE_UP, RELEASE_DOWN)], 4)
    turns = [k for k, (kind, _, regime) in enumerate(events) if kind == REVERSAL and regime.startswith("slide")]
    assert len(turns) >= 2
    for k in turns:
        _, time, regime = events[k]
        before, after = (speed_at(scene, drive, initial, time + sign * slack[k]) for sign in (-1, 1))
        assert before * after < 0
        assert (after > 0) == (regime == "slide +")
