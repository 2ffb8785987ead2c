"""What a run may use, and how it tells how far it is."""

import math

import numpy as np
import pytest
from core import ALL, cut, drive_of, run, scene_of, still

from impact_env import (
    CompliantWalls,
    Drive,
    Exact,
    InitialState,
    IntegrationError,
    ModalModel,
    Moreau,
    Record,
    RungeKutta,
    Scene,
    SeveralAbsorbers,
    SlidingAbsorber,
    constant_frequency,
    impact_absorber,
    simulate,
)
from impact_env.controlled import ControlledRuns
from impact_env.curve import performance_curve
from impact_env.ensemble import Lane, run_lanes
from impact_env.kernels.motion import observers
from impact_env.kernels.motion.loads import ForceWindow
from impact_env.kernels.motion.observers import (
    FIRST_EVENTS,
    LONG_SEARCH_EVALUATIONS,
    count_progress,
    new_counters,
)
from impact_env.methods import Method
from impact_env.parameters import Absorber

FORCE = 3.5
DRIVE = drive_of(FORCE, 1.0, periods=40)
ABSORBERS: dict[str, Absorber] = {
    "rigid": impact_absorber(restitution=0.7, friction_limit=0.1),
    "compliant": SlidingAbsorber(walls=CompliantWalls(1e5)),
    "several": SeveralAbsorbers(
        (impact_absorber(mass_ratio=0.01), impact_absorber(mass_ratio=0.01, restitution=0.5)),
        (0.7, 1.0),
    ),
}


# --- what a run may use


@pytest.mark.parametrize("name", ABSORBERS)
def test_an_abandoned_run_reports_its_time_and_returns_what_it_has(name: str) -> None:
    """What it has is what a run gives that ends there."""
    # few enough to be followed
    scene = scene_of(ABSORBERS[name], modes=2)
    most = 30
    with pytest.raises(
        IntegrationError,
        match=rf"more events than its budget.*31 events of {most} allowed.*raise most_events",
    ) as caught:
        simulate(scene, DRIVE, record=ALL, most_events=most)
    at = caught.value.time
    part = caught.value.response
    assert 0 < at < 0.9 * DRIVE.schedule.times[-1]
    assert f"at {at:.9g} s ({at / DRIVE.schedule.pseudo_period:.6g} of 40 pseudo periods)" in str(
        caught.value
    )
    whole = run(scene, cut(DRIVE, at))
    assert len(part.impacts.time) - len(whole.impacts.time) in (
        0,
        1,
    )  # the impact at the end belongs to the run that was given up
    assert part.impact_count == len(part.impacts.time) > 3
    np.testing.assert_allclose(
        part.impacts.time[: len(whole.impacts.time)], whole.impacts.time, rtol=1e-9
    )
    np.testing.assert_allclose(part.end_state[:2], whole.end_state[:2], rtol=1e-7)
    assert (
        part.history.time[-1] <= at < part.history.time[-1] + 2 * DRIVE.schedule.pseudo_period / 32
    )
    count = len(part.history.time)
    np.testing.assert_allclose(
        part.history.modal_displacement,
        whole.history.modal_displacement[:count],
        rtol=0,
        atol=1e-11,
    )
    assert part.energy.relative_error < 1e-9


def pressed() -> tuple[Scene, InitialState]:
    """Return a scene in which a static load presses the absorber to its wall.

    The absorber leaves the wall and hits it without loss in very small bounces.
    """
    scene = scene_of(impact_absorber(restitution=1.0, mass_ratio=1e-3), modes=1)
    tip = -2e-3 * float(scene.model.tip_shape[0])
    return scene, InitialState(
        np.array([-2e-3]), absorber_displacement=tip - 1e-3, absorber_velocity=2e-7
    )


def test_bounces_without_end_use_up_the_default_budget() -> None:
    scene, start = pressed()
    drive = still(0.2 * 2 * np.pi / scene.model.resonance_omega(1), scene.model.resonance_omega(1))
    with pytest.raises(IntegrationError, match="more events than its budget") as caught:
        simulate(scene, drive, initial=start)
    assert caught.value.response.impact_count > 0.9 * FIRST_EVENTS


def test_a_control_interval_has_a_budget() -> None:
    scene, start = pressed()
    omega = scene.model.resonance_omega(1)
    runs = ControlledRuns(scene, 2, omega, 0.25, samples_per_period=64)
    runs.orders["omega_start"] = runs.orders["omega_stop"] = omega
    runs.state[1] = start.vector(scene)
    with pytest.raises(IntegrationError, match=r"lane 1.*more events than its budget"):
        runs.advance()


def test_lanes_have_budgets() -> None:
    scene = scene_of(impact_absorber(), modes=2)
    lane = Lane(scene, DRIVE)
    with pytest.raises(IntegrationError, match=r"lane 0 \(3.5 N, .*20 allowed") as caught:
        run_lanes([lane, lane], threads=1, most_events=20)
    assert caught.value.time == pytest.approx(
        caught.value.response.drive.schedule.times[-1], rel=1.0
    )
    with pytest.raises(IntegrationError, match="lane 0"):
        performance_curve(scene, [FORCE], members=1, threads=1, limits=(0.98, 1.0), most_events=5)


@pytest.mark.parametrize(
    ("name", "value", "tau", "status"),
    [
        ("evaluations", 10.0, 0.5, observers.DONE),
        ("evaluations", 41.0, 0.5, observers.TOO_MANY_EVALUATIONS),
        ("evaluations", 10.0, math.nan, observers.NOT_FINITE),
        ("evaluations", 30.0, math.nan, observers.TOO_MANY_EVALUATIONS),
        ("most_evaluations", math.inf, math.nan, observers.SEARCH_GAVE_UP),
        ("events", 10.0, 0.5, observers.DONE),
        ("events", 19.0, 0.5, observers.TOO_MANY_EVENTS),
        ("stop", True, 0.5, observers.STOPPED),
    ],
)
def test_why_a_run_ends(name: str, value: float, tau: float, status: int) -> None:
    counters = new_counters(events=10, events_per_s=1.0, evaluations=20, evaluations_per_s=2.0)
    counters.counts["evaluations"] = LONG_SEARCH_EVALUATIONS if name == "most_evaluations" else 0
    counters.counts[name] = value
    window = ForceWindow(8.5, 1.0, 1.0, 0.0, 0.0, 0.0)
    assert count_progress(counters, window, tau, 0.0, 0)[1] == status
    assert counters.counts["reached"] == (9.0 if tau == tau else 0.0)


# --- progress


@pytest.mark.parametrize(
    ("method", "absorber"),
    [
        (Exact(), impact_absorber()),
        (Exact(), None),
        (Moreau(), impact_absorber()),
        (RungeKutta(), None),
    ],
    ids=str,
)
def test_progress_goes_on_to_the_end_and_an_error_in_it_ends_the_run(
    method: Method, absorber: Absorber | None
) -> None:
    scene = scene_of(absorber, modes=2)
    reports = list[tuple[float, float]]()
    drive = drive_of(FORCE, 1.0, periods=3e4)
    response = simulate(scene, drive, method, progress=lambda at, end: reports.append((at, end)))
    times, ends = map(list, zip(*reports, strict=True))
    assert set(ends) == {times[-1]} == {float(drive.schedule.times[-1])}
    assert times == sorted(times)
    np.testing.assert_array_equal(response.end_state, simulate(scene, drive, method).end_state)

    def stop(at: float, _: float) -> None:
        raise ValueError(f"at {at}")

    with pytest.raises(ValueError, match="at "):  # a run that would take hours
        simulate(scene, drive_of(FORCE, 1.0, periods=1e8), method, progress=stop)


def test_a_budget_of_events_bounds_what_a_search_may_cost() -> None:
    """Frequencies over seven decades: one search of these could take millions of evaluations."""
    modes = 60
    shapes = np.cos(np.arange(2 * modes)).reshape(2, modes)
    scene = Scene(
        ModalModel(np.geomspace(0.9, 3.2e6, modes), np.full(modes, 1e-6), *shapes, 1.0),
        impact_absorber(1e-12),
    )
    with pytest.raises(IntegrationError, match="budget") as caught:
        simulate(
            scene,
            Drive(3.5, constant_frequency(0.9, 1.0, 1e6)),
            record=Record(events=True),
            most_events=2000,
        )
    assert caught.value.response.evaluations < 2 * 40 * 2000 + 40 * 10
