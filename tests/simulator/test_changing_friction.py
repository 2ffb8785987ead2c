"""A friction limit that is another one from interval to interval: against references restarted where it changes, and against fixed limits."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest
from core import OMEGA, run, scene_of

from impact_env import Drive, FrequencySchedule, InitialState, Moreau, Scene, friction_damper, impact_absorber
from impact_env.controlled import ControlledRuns
from impact_env.energy import stored_energy
from impact_env.kernels.exact.rigid_contact import FREE
from impact_env.methods import Method
from impact_env.parameters import SlidingAbsorber
from reference import dense

SAMPLES, PERIODS = 32, 0.75  # of an interval: short, so that many limits change
ABSORBERS = {"damper": friction_damper(0.3), "impacts": impact_absorber(restitution=0.6, friction_limit=0.1), "dead": impact_absorber(1e-3, 0.0, 0.1)}


def lanes_of(scene: Scene, lanes: int, method: Method | None = None, force: float = 3.0) -> ControlledRuns:
    runs = ControlledRuns(scene, lanes, OMEGA, PERIODS, method, samples_per_period=SAMPLES, threads=1)
    runs.orders["force"] = np.linspace(0.5, 1.0, lanes) * force
    runs.orders["phase"] = np.linspace(0.0, 3.0, lanes)
    runs.orders["omega_start"], runs.orders["omega_stop"] = 0.98 * OMEGA, 0.99 * OMEGA
    return runs


def drive_of_order(order: Any) -> Drive:
    schedule = FrequencySchedule(np.array([0.0, order.duration]), np.array([order.omega_start, order.omega_stop]), OMEGA)
    return Drive(float(order.force), schedule, float(order.phase))


def start_of(state: np.ndarray) -> InitialState:
    modes = len(state) // 2 - 1
    return InitialState(state[:modes], state[modes + 1 : -1], state[modes], state[-1])


def with_limit(scene: Scene, limit: float) -> Scene:
    absorber = scene.absorber
    assert isinstance(absorber, SlidingAbsorber)
    return Scene(scene.model, SlidingAbsorber(absorber.mass_ratio, absorber.walls, type(absorber.friction)(limit)))  # type: ignore[misc,call-arg]


def bundle(runs: ControlledRuns) -> bytes:
    return b"".join(np.ascontiguousarray(values).tobytes() for values in (runs.state, *(runs.reports[name] for name in runs.reports.dtype.names)))


@pytest.mark.parametrize("name", ABSORBERS)
def test_each_interval_is_that_of_a_reference_with_the_new_limit(name: str) -> None:
    """The dense reference starts anew from the state at each interval's start; what was joined or sliding there is its own finding."""
    scene, generator = scene_of(ABSORBERS[name], modes=2), np.random.default_rng(4)
    runs = lanes_of(scene, 1)
    regimes, impacts, before = set(), 0, np.inf
    for _ in range(30 if name == "damper" else 60):
        limit = float(0.02 * 150 ** generator.uniform())  # to 3 N
        runs.orders["limit"] = limit
        start, order, rigid = runs.state[0].copy(), runs.orders[0].copy(), runs._memory.rigid[0].copy()
        runs.advance()
        joined = rigid.regime != FREE
        truth = dense.follow(with_limit(scene, limit), drive_of_order(order), start_of(start), np.array([0.0, order.duration]), most_events=1000)
        assert truth.complete
        scale = np.max(np.abs(truth.states[:, :3]))
        speed = np.max(np.abs(truth.states[:, 3:]))
        np.testing.assert_allclose(runs.state[0, :3], truth.states[-1, :3], rtol=0, atol=1e-8 * scale)
        np.testing.assert_allclose(runs.state[0, 3:], truth.states[-1, 3:], rtol=0, atol=1e-8 * speed)
        first = dense.follow(with_limit(scene, limit), drive_of_order(order), start_of(start), np.array([0.0, 1e-3 * order.duration])).states[-1]
        slides = abs(relative_speed(scene, first)) > 1e-12 * speed
        regimes.add(("joined" if joined else "sliding", "raised" if limit > before else "lowered", "slides" if slides else "holds"))
        impacts += runs.reports["impact_count"][0]
        before = limit
    wanted = {("joined", "lowered", "holds"), ("joined", "lowered", "slides"), ("sliding", "lowered", "slides"), ("sliding", "raised", "slides")}
    assert regimes >= wanted if name == "damper" else regimes >= wanted - {("joined", "lowered", "holds")}
    assert (impacts > 10) == (name != "damper")


def relative_speed(scene: Scene, state: np.ndarray) -> float:
    modes = scene.model.modes
    return float(state[-1] - scene.model.tip_shape @ state[modes + 1 : -1])


@pytest.mark.parametrize("name", ABSORBERS)
def test_energy_balances_over_the_changes(name: str) -> None:
    """Work and losses from single runs between the changes; the energy from the lane, which went through them."""
    scene, generator = scene_of(ABSORBERS[name], modes=3), np.random.default_rng(5)
    runs = lanes_of(scene, 1)
    work = losses = 0.0
    for _ in range(40):
        limit = float(0.02 * 100 ** generator.uniform())
        runs.orders["limit"] = limit
        start, order = runs.state[0].copy(), runs.orders[0].copy()
        runs.advance()
        account = run(with_limit(scene, limit), drive_of_order(order), initial=start_of(start)).energy
        assert account is not None
        work += account.work
        losses += float(np.sum(account.modal_loss)) + account.friction_loss + account.impact_loss
    assert stored_energy(scene, runs.state[0]) == pytest.approx(work - losses, rel=1e-7)
    assert losses > 0.2 * work


@pytest.mark.parametrize(("name", "method"), [("damper", None), ("impacts", None), ("dead", None), ("impacts", Moreau())])
def test_a_limit_that_stays_is_the_scenes_own_bit_for_bit(name: str, method: Method | None) -> None:
    scene = scene_of(ABSORBERS[name], modes=2)
    own, told = lanes_of(with_limit(scene, 0.25), 4, method), lanes_of(scene, 4, method)
    for _ in range(40):
        told.orders["limit"] = 0.25
        own.advance()
        told.advance()
        assert bundle(own) == bundle(told)
    assert abs(told.reports["distance"]).max() > 0


def test_lanes_with_other_limits_and_a_snapshot_do_not_touch_each_other() -> None:
    scene, limits = scene_of(ABSORBERS["impacts"], modes=2), np.geomspace(0.02, 2.0, 5)
    many = lanes_of(scene, 5)
    singles = [lanes_of(scene, 1) for _ in limits]
    for lane, runs in enumerate(singles):
        for field in ("force", "phase"):
            runs.orders[field] = many.orders[field][lane]
    generator, kept = np.random.default_rng(6), None
    for k in range(30):
        wanted = generator.permutation(limits)
        many.orders["limit"] = wanted
        if k == 20:
            kept = many.snapshot(), [wanted]
        elif kept:
            kept[1].append(wanted)
        many.advance()
        for lane, runs in enumerate(singles):
            runs.orders["limit"] = wanted[lane]
            runs.advance()
            np.testing.assert_array_equal(many.state[lane], runs.state[0])
    again = copy.deepcopy(lanes_of(scene, 5))
    assert kept is not None
    again.restore(kept[0])
    for wanted in kept[1]:
        again.orders["limit"] = wanted
        again.advance()
    assert bundle(again) == bundle(many)


def test_the_stepping_scheme_takes_new_limits_as_the_exact_method_does() -> None:
    scene = scene_of(ABSORBERS["damper"], modes=1)
    exact, steps = lanes_of(scene, 1), lanes_of(scene, 1, Moreau(2000))
    for limit in (0.3, 0.05, 1.0, 0.02, 0.3, 5.0, 0.1):
        for runs in (exact, steps):
            runs.orders["limit"] = limit
            runs.advance()
    scale = np.max(np.abs(exact.state[0]))
    np.testing.assert_allclose(steps.state[0], exact.state[0], rtol=0, atol=2e-3 * scale)


@pytest.mark.parametrize("amplitude", [4.0, 20.0])
@pytest.mark.parametrize("absorber", [friction_damper(0.3), impact_absorber(1e-3, 0.0)], ids=["friction", "walls"])
def test_a_joined_absorber_is_let_go_where_the_force_jumps(absorber: SlidingAbsorber, amplitude: float) -> None:
    """Whatever the force's phase at the jump; the reference finds for itself what can be held."""
    scene, lanes = scene_of(absorber, modes=2), 24
    runs = lanes_of(scene, lanes)
    runs.orders["force"], runs.orders["phase"] = 0.2 if absorber.walls is None else 6.0, 0.26 * np.arange(lanes)
    for _ in range(6 if absorber.walls is None else 40):
        runs.advance()
    held = np.flatnonzero(runs._memory.rigid["regime"] != FREE)
    assert len(held) > (20 if absorber.walls is None else 4)
    runs.orders["force"] = amplitude
    starts, orders = runs.state.copy(), runs.orders.copy()
    runs.advance()
    for lane in held.tolist():
        order = orders[lane]
        truth = dense.follow(scene, drive_of_order(order), start_of(starts[lane]), np.array([0.0, order.duration]), most_events=1000)
        assert truth.complete
        for part in (slice(0, 3), slice(3, 6)):
            np.testing.assert_allclose(runs.state[lane, part], truth.states[-1, part], rtol=0, atol=1e-8 * np.max(np.abs(truth.states[-1, part])))
