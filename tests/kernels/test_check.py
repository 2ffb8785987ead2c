"""Observers that check and record change no run.

A search that finds its event too late is reported.
"""

import numba
import numpy as np
import pytest
from core import ALL, drive_of, scene_of

from impact_env import Moreau, Record, impact_absorber, simulate
from impact_env.kernels.events.signals import HIT_HIGH, HIT_LOW, REVERSAL
from impact_env.kernels.exact import rigid
from impact_env.kernels.motion.observers import GUARD_PASSED, JOINT_EXCEEDED, RATE_TURNED


@pytest.mark.parametrize("friction", [None, 0.1])
def test_no_missed_event_is_reported_in_correct_runs(friction: float | None) -> None:
    response = simulate(
        scene_of(impact_absorber(restitution=0.7, friction_limit=friction), modes=2),
        drive_of(3.5, 1.0, periods=30),
        record=ALL,
    )
    assert response.impact_count > 20
    assert response.check.searches > response.impact_count
    assert (response.check.misses, response.check.worst, len(response.check.times)) == (0, 0.0, 0)


@pytest.mark.parametrize("friction", [None, 0.1])
def test_what_is_observed_and_checked_changes_no_run(friction: float | None) -> None:
    """Observing and checking changes no run.

    The other run records only the level, in another kernel, since tests observe and check more than
    users often do.
    """
    scene = scene_of(impact_absorber(restitution=0.7, friction_limit=friction), modes=2)
    drive = drive_of(3.5, 1.0, periods=10)
    one, other = (simulate(scene, drive, record=record) for record in (Record(), ALL))
    np.testing.assert_array_equal(one.end_state, other.end_state)
    assert one.impact_count == other.impact_count > 5
    assert one.check is None


def test_nothing_to_check_without_a_search() -> None:
    for absorber, method in ((None, None), (impact_absorber(), Moreau())):
        assert (
            simulate(
                scene_of(absorber, modes=2),
                drive_of(1.0, 1.0, periods=1),
                method,
                record=Record(check=True),
            ).check
            is None
        )


@pytest.mark.plain
@pytest.mark.skipif(
    not numba.config.DISABLE_JIT, reason="in a compiled kernel no search can be replaced"
)
@pytest.mark.parametrize(
    ("search", "events", "friction", "kind"),
    [
        ("find_end_of_flight", {HIT_LOW, HIT_HIGH}, None, GUARD_PASSED),
        ("find_end_of_flight", {REVERSAL}, 0.1, RATE_TURNED),
        ("find_end_of_hold", {HIT_LOW, HIT_HIGH}, 0.1, JOINT_EXCEEDED),
    ],
)
def test_an_event_that_is_located_too_late_is_reported(
    search: str,
    events: set[int],
    friction: float | None,
    kind: int,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    searched = getattr(rigid, search)
    planted = []

    def tardy(*arguments: object) -> object:
        event = searched(*arguments)
        if planted or event.kind not in events or event.offset < 1e-4:
            return event
        planted.append(event)
        return event._replace(offset=event.offset * (1 + 1e-6))

    monkeypatch.setattr(rigid, search, tardy)
    scene = scene_of(impact_absorber(restitution=0.7, friction_limit=friction), modes=2)
    check = simulate(scene, drive_of(6.0, 1.0, periods=3.5), record=ALL).check
    assert planted
    assert check.misses >= 1
    assert check.kinds[0] == kind
    assert kind != GUARD_PASSED or 1e-7 < check.worst < 1e-5  # of the gap
