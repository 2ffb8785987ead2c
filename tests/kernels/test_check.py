import numpy as np
import pytest
from core import ALL, scene_of

from impact_env import Drive, Moreau, Record, Response, Scene, constant_frequency, impact_absorber, simulate
from impact_env.families.exact import rigid_regimes
from impact_env.kernels.events.signals import HIT_HIGH, REVERSAL
from impact_env.kernels.exact.check import check_flight, check_hold
from impact_env.kernels.exact.free_and_joined import Rigid, new_room
from impact_env.kernels.exact.next_event import end_of_flight, end_of_hold
from impact_env.kernels.exact.rigid import solve_free, solve_joined
from impact_env.kernels.exact.rigid_contact import Body, Contact, Walls
from impact_env.kernels.motion.observers import PASSED, PULLED, TURNED, new_check
from impact_env.kernels.motion.segments import Losses, Schedule, to_slots, window_of

GAP = 1e-3


def checked(scene: Scene, periods: float = 30.0, force: float = 3.5) -> Response:
    drive = Drive(force, constant_frequency(scene.model.resonance_omega(1), 1.0, periods))
    return simulate(scene, drive, record=ALL)


@pytest.mark.parametrize("friction", [None, 0.1])
def test_no_miss_where_there_is_none(friction: float | None) -> None:
    response = checked(scene_of(impact_absorber(restitution=0.7, friction_limit=friction), modes=2))
    assert response.impact_count > 20
    assert response.check.searches > response.impact_count
    assert (response.check.misses, response.check.worst, len(response.check.times)) == (0, 0.0, 0)


@pytest.mark.parametrize("friction", [None, 0.1])
def test_what_is_observed_and_checked_changes_no_run(friction: float | None) -> None:
    """The run of a level alone, in another kernel: tests observe and check what users often do not."""
    scene = scene_of(impact_absorber(restitution=0.7, friction_limit=friction), modes=2)
    drive = Drive(3.5, constant_frequency(scene.model.resonance_omega(1), 1.0, 10.0))
    one, other = (simulate(scene, drive, record=record) for record in (Record(), ALL))
    np.testing.assert_array_equal(one.end_state, other.end_state)
    assert one.impact_count == other.impact_count > 5
    assert one.check is None


def test_nothing_to_check_without_a_search() -> None:
    drive = Drive(1.0, constant_frequency(250.0, 1.0, 1.0))
    assert simulate(scene_of(modes=2), drive, record=Record(check=True)).check is None
    assert simulate(scene_of(impact_absorber(), modes=2), drive, Moreau(), record=Record(check=True)).check is None


# --- planted misses: a search is told to have found its event later than it is ------------------------------------------------------------------


class Bench:
    """A beam at rest under a force of 20 N in the middle of a window, and an absorber that flies over it."""

    def __init__(self, limit: float | None) -> None:
        scene = scene_of(impact_absorber(GAP, friction_limit=limit), modes=3)
        omega, mass = scene.model.resonance_omega(1), scene.absorber_mass
        assert mass is not None
        tip_shape = np.array(scene.model.tip_shape)
        self.free, self.joined, reach = rigid_regimes(scene, 20.0 / omega)
        schedule = Schedule(np.array([0.0, 2.0 / omega]), np.full(2, omega), np.array([0.0, 2.0]), 20.0, reach, None)
        self.window, self.walls, self.limit = window_of(schedule, 0, 0, 1), Walls(GAP, 1.0, None), limit
        contact = Contact(mass, 1 / mass + float(np.sum(tip_shape**2)), tip_shape, self.walls, limit, None)
        rigid = Rigid(self.free, self.joined, contact, Losses(tip_shape, tip_shape, tip_shape, 0.0))
        self.room = new_room(self.free, self.joined, None, np.zeros(8))
        solve_free(rigid, self.window, self.room)
        solve_joined(rigid, self.window, self.room)
        self.now, self.z, self.check = self.room.now[0], self.room.work.z, new_check()
        self.body = Body(self.now, self.room.work, self.room.signal)
        self.now["tau"] = -self.window.half
        self.z[0, 0] = 1e-4  # the beam swings, too

    def fly(self, velocity: float) -> tuple[int, float]:
        now, length = self.now, 2 * self.window.half
        now["q"], now["v"], now["a"], now["sign"] = 0.0, velocity, 0.0, np.sign(velocity)
        if self.limit is not None:
            now["force"] = -now["sign"] * self.limit
            now["a"], now["at_rest"] = now["force"] / 0.01, False
        found = end_of_flight(self.free.slots, self.room.free_forced, self.window, self.walls, self.limit, self.body, 0.0, length)
        return found.kind, found.offset

    def see_flight(self, offset: float) -> list[int]:
        forced = self.room.free_forced
        check_flight(self.check, self.free.slots, forced, self.window, self.walls, self.limit, self.body, offset)
        return [int(n) for n in self.check.counts]

    def see_hold(self, offset: float) -> list[int]:
        check_hold(self.check, self.joined.slots, self.room.joined_forced, self.window, self.limit, self.body, offset)
        return [int(n) for n in self.check.counts]


@pytest.mark.parametrize("late", [1e-8, 1e-3])
def test_a_wall_passed_is_seen(late: float) -> None:
    bench = Bench(None)
    kind, offset = bench.fly(5.0)
    assert kind == HIT_HIGH
    assert bench.see_flight(offset) == [1, 0]
    assert bench.see_flight(offset * (1 + late)) == [2, 1]
    time, what, share = bench.check.first[0]
    assert (what, bench.check.worst[PASSED]) == (PASSED, share)
    assert share == pytest.approx(late, rel=0.5)  # it flies through the gap, and the beam moves a little
    start = bench.window.centre - bench.window.half
    assert start + offset < time <= start + offset * (1 + late)


def test_a_reversal_passed_is_seen() -> None:
    bench = Bench(0.5)
    kind, offset = bench.fly(0.01)
    assert kind == REVERSAL
    assert bench.see_flight(offset) == [1, 0]
    assert bench.see_flight(1.001 * offset) == [2, 1]
    assert bench.check.first["kind"][0] == TURNED
    assert bench.check.worst[TURNED] > 0


def test_a_joint_that_gives_too_much_is_seen() -> None:
    bench = Bench(limit := 0.3)
    swing = np.zeros(8)
    swing[4] = 0.05  # m/s of the first mode, so that the joint is loaded more and more
    to_slots(bench.joined.into, swing, bench.z)
    found = end_of_hold(bench.joined.slots, bench.room.joined_forced, bench.window, limit, 0.0, bench.body, 2 * bench.window.half)
    assert 0 < found.offset < 2 * bench.window.half
    assert bench.see_hold(found.offset) == [1, 0]
    assert bench.see_hold(1.001 * found.offset) == [2, 1]
    assert bench.check.first["kind"][0] == PULLED
    assert bench.check.counts["searches"] == 2
    assert bench.check.counts["misses"] == 1


def test_what_is_not_a_stretch_is_not_counted() -> None:
    bench = Bench(None)
    bench.fly(5.0)
    assert bench.see_flight(0.0) == [0, 0]
    assert bench.see_flight(np.nan) == [0, 0]
