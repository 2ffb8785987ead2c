"""Shooting: against Green's function, an independent stick-slip solution, disturbed runs of the exact method, and on cases of all kinds."""

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
import scipy.optimize
from core import ALL
from orbit_cases import many_reversals
from periodic_truth import matched

from impact_env import Beam, ModalModel, Record, modal_model
from impact_env.periodic.case import Case, start_from
from impact_env.periodic.continuation import Steps
from impact_env.periodic.green import NoOrbit
from impact_env.periodic.motion import ShotMotion
from impact_env.periodic.orbit import Orbit, mirrored, shot_orbit
from impact_env.periodic.orbit_branches import orbit_branch
from impact_env.periodic.passage import RECORD, passage
from impact_env.periodic.schedule import Regime
from impact_env.periodic.shooting import shoot
from impact_env.periodic.survey import closed_form_orbits, crossings, orbit_of_simulation, same
from impact_env.periodic.validation import BAR, CHATTER_BAR, map_over, propagated
from impact_env.sweep import simulate

# One mode with a friction damper, piece by piece in closed form: stuck together it is an oscillator of larger mass, else one under a constant force.
#
# Nothing of the package is used. The absorber slides (relative velocity of one sign), or sticks until the force that carries it reaches the limit.


Array = np.ndarray


@dataclass(frozen=True)
class Damper:
    """q'' + 2 D w q' + w^2 q = push f cos(omega t) - tip R, and m x'' = R: |R| is at most the limit."""

    w: float
    damping: float
    push: float
    tip: float
    mass: float
    force: float
    omega: float
    limit: float

    def oscillator(self, t0: float, q0: float, v0: float, inertia: float, pull: float):
        """Return q(t) and its derivatives (3,) of inertia q'' + 2 D w q' + w^2 q = push f cos(omega t) - tip pull."""
        rate, root = self.damping * self.w / inertia, np.sqrt(self.w**2 / inertia - (self.damping * self.w / inertia) ** 2)
        wave = self.push * self.force / (self.w**2 - inertia * self.omega**2 + 2j * self.damping * self.w * self.omega)
        rest = -self.tip * pull / self.w**2
        s = complex(-rate, root)
        start = wave * np.exp(1j * self.omega * t0)
        a, b = q0 - rest - start.real, v0 - (1j * self.omega * start).real
        z = a - 1j * (b + rate * a) / root

        def motion(t: float) -> Array:
            free, forced = z * np.exp(s * (t - t0)), wave * np.exp(1j * self.omega * t)
            return np.array([free.real + forced.real + rest, (s * free + 1j * self.omega * forced).real, (s**2 * free - self.omega**2 * forced).real])

        return motion

    def settled(self, periods: int) -> tuple[list[tuple[str, float]], Array, float]:
        """Return events ("stick" or "slip", time) of the last period, its state (q, q', x') at its begin, and the largest |tip|."""
        turn = 2 * np.pi / self.omega
        t, q, v, u, stuck, pull = 0.0, 0.0, 0.0, 0.0, True, 0.0
        events, begin, tips = [], np.zeros(3), []
        while t < periods * turn:
            inertia = 1 + self.mass * self.tip**2 if stuck else 1.0
            motion = self.oscillator(t, q, v, inertia, pull if not stuck else 0.0)

            def guard(s: float, motion=motion, stuck=stuck, t=t, u=u, pull=pull) -> float:
                if stuck:
                    return self.limit - abs(self.mass * self.tip * motion(s)[2])
                return (u + pull / self.mass * (s - t) - self.tip * motion(s)[1]) * -np.sign(pull)  # friction acts against the sliding

            grid = t + turn / 100 * np.arange(1, 226)
            values = np.array([guard(s) for s in grid])
            out = np.flatnonzero(values < 0)
            if len(out) == 0:  # stuck for more than two periods, as at first
                t, (q, v, _) = float(grid[-1]), motion(grid[-1])
                u = self.tip * v
                continue
            k = int(out[0])
            low = t + 1e-9 * turn if k == 0 else grid[k - 1]
            end = scipy.optimize.brentq(guard, low, grid[k], xtol=1e-18, rtol=1e-15)
            last = (periods - 1) * turn
            if end > last:
                tips += [abs(self.tip * motion(s)[0]) for s in np.linspace(max(t, last), min(end, periods * turn), 200)]
            if t <= last < end:
                q1, v1, _ = motion(last)
                begin = np.array([q1, v1, self.tip * v1 if stuck else u + pull / self.mass * (last - t)])
            (q, v, a), before, t = motion(end), t, end
            if stuck:
                u, pull, stuck = self.tip * v, float(np.sign(a * self.tip)) * self.limit, False
                events.append(("slip", t))
            else:
                u += pull / self.mass * (t - before)
                acceleration = (self.push * self.force * np.cos(self.omega * t) - 2 * self.damping * self.w * v - self.w**2 * q) * self.tip
                needed = self.mass * acceleration / (1 + self.mass * self.tip**2)
                stuck = abs(needed) <= self.limit
                pull = float(np.sign(needed)) * self.limit
                events.append(("stick" if stuck else "turn", t))
        return [event for event in events if (periods - 1) * turn <= event[1] < periods * turn], begin, float(np.max(tips))


@cache
def model_of(modes: int) -> ModalModel:
    return modal_model(Beam(modes=modes))


def paper_case(modes: int, ratio: float, force: float, restitution: float, friction: float = 0.0, gap: float = 1e-3) -> Case:
    model = model_of(modes)
    return Case(model, ratio * float(model.omega[0]), force, gap, restitution, friction)


def other_model() -> ModalModel:
    """Not the paper's beam; its last mode is overdamped."""
    return ModalModel([31.0, 95.0, 210.0], [0.02, 0.01, 1.3], [0.8, 0.4, 0.2], [1.1, -0.7, 0.5], 1.4)


@cache
def settled(case_name: str) -> Orbit:
    cases = {
        "chatter": paper_case(3, 0.9, 20.0, 0.1),
        "chatter with friction": paper_case(1, 0.9, 20.0, 0.3, 0.05),
        "without rebound": paper_case(3, 0.9, 8.0, 0.0, 0.05),
        "another structure": Case(other_model(), 33.0, 6.0, 1e-3, 0.2, 0.02, 0.05),
        "friction damper": damper_case(),
    }
    found = orbit_of_simulation(cases[case_name], settle=300)
    assert isinstance(found, Orbit), found.reason
    return found


def damper_case() -> Case:
    """One mode; the walls are out of reach."""
    return Case(model_of(1), 1.02 * float(model_of(1).omega[0]), 2.0, 5e-3, 0.7, 0.3)


HELD = ["chatter", "chatter with friction", "without rebound", "another structure"]


# --- against other solutions -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "case",
    [
        paper_case(3, 0.9523, 1.5, 1.0),
        paper_case(3, 0.9523, 1.5, 1.0, 0.01),
        paper_case(1, 0.93, 1.5, 0.75),
        paper_case(10, 0.97, 3.5, 0.7, 0.1),
        Case(other_model(), 33.0, 1.0, 3e-3, 0.6, 0.02, 0.05),
    ],
)
def test_closed_form_greens_function_and_shooting_agree(case: Case) -> None:
    for orbit in closed_form_orbits(case).orbits:
        phase, state = orbit.motion.mid_flight()
        start = state * (1 + 1e-4 * np.cos(np.arange(len(state))))
        again = shot_orbit(case, phase, start, orbit.schedule.symmetric, orbit.schedule.period_multiple)
        assert isinstance(again, Orbit)
        assert np.max(np.abs(again.motion.state_at(phase) - state)[: len(state) // 2]) < 1e-10 * case.gap
        assert [i.phase for i in again.impacts] == pytest.approx([i.phase for i in orbit.impacts], abs=1e-10)
        assert [i.impulse for i in again.impacts] == pytest.approx([i.impulse for i in orbit.impacts], rel=1e-10)
        assert again.motion.tip_max == pytest.approx(orbit.motion.tip_max, rel=1e-10)
        assert again.motion.tip_rms == pytest.approx(orbit.motion.tip_rms, rel=1e-10)
        assert again.schedule.reversals == orbit.schedule.reversals
        assert matched(again.stability.multipliers, orbit.stability.multipliers) < 1e-10 * max(1.0, abs(orbit.stability.multipliers[0]))


def test_stick_and_slip_of_a_friction_damper() -> None:
    orbit, case = settled("friction damper"), damper_case()
    model = case.model
    truth = Damper(
        float(model.omega[0]), float(model.damping_ratio[0]), float(model.force_shape[0]), float(model.tip_shape[0]), case.structure.mass, case.force,
        case.omega, case.friction_limit,
    )  # fmt: skip
    events, begin, tip = truth.settled(400)
    assert orbit.impacts == ()
    assert orbit.schedule.symmetric
    found = sorted((float(p % np.pi), e.regime is Regime.JOINED) for p, e in zip(orbit.solution.phases, orbit.schedule.events, strict=True))
    wanted = sorted((float(case.omega * t % np.pi), kind == "stick") for kind, t in events)[::2]
    assert {kind for kind, _ in events} == {"stick", "slip"}
    assert [stick for _, stick in found] == [stick for _, stick in wanted]
    assert [phase for phase, _ in found] == pytest.approx([phase for phase, _ in wanted], abs=1e-7)
    state = orbit.motion.state_at(0.0)
    assert state[[0, 2, 3]] == pytest.approx(begin, rel=1e-8, abs=1e-9 * case.gap * case.omega)
    assert orbit.motion.tip_max == pytest.approx(tip, rel=1e-4)
    assert orbit.residual < BAR
    # the place of rest is free: over half a period it turns to the other side
    assert np.min(np.abs(orbit.stability.multipliers + 1)) < 1e-10


@pytest.mark.parametrize("name", HELD)
def test_multipliers_are_those_of_disturbed_runs(name: str) -> None:
    """The exact method's map by central differences; each joined phase takes a rank from it."""
    orbit = settled(name)
    case, n = orbit.case, orbit.case.model.modes
    start, state = orbit.motion.mid_flight()
    unit = case.gap * np.concatenate([case.omega / case.model.omega, [1.0], np.full(n, case.omega), [case.omega]])
    columns = []
    for k in range(len(state)):
        step = 1e-6 * unit[k] * np.eye(len(state))[k]
        columns.append((map_over(orbit.motion, start, state + step) - map_over(orbit.motion, start, state - step)) / (2e-6 * unit))
    truth = np.linalg.eigvals(np.array(columns).T)
    assert matched(orbit.stability.multipliers, truth) < 1e-4
    zero = np.abs(orbit.stability.multipliers) < 1e-3
    assert np.sum(zero) >= 2


@pytest.mark.parametrize("name", [*HELD, "friction damper"])
def test_the_motion_is_the_exact_methods(name: str) -> None:
    orbit = settled(name)
    assert not orbit.schedule.flies
    assert orbit.residual < (BAR if name == "friction damper" else CHATTER_BAR)
    response, start = propagated(orbit.motion, ALL)
    history = response.history
    states = orbit.motion.states(start + orbit.case.omega * history.time)
    n = orbit.case.model.modes
    assert np.max(np.abs(states[:, :n] - history.modal_displacement)) < 1e-9 * orbit.case.gap
    assert np.max(np.abs(states[:, n] - history.absorber_displacement)) < 1e-9 * orbit.case.gap
    dense = orbit.motion.states(start + np.linspace(0, orbit.schedule.turn, 20001))
    tip = dense[:, :n] @ orbit.case.model.tip_shape
    assert np.max(np.abs(tip)) == pytest.approx(orbit.motion.tip_max, rel=1e-6)
    assert np.sqrt(np.mean(tip[:-1] ** 2)) == pytest.approx(orbit.motion.tip_rms, rel=1e-6)


def test_a_chatter_lists_the_impacts_of_the_recorded_run() -> None:
    orbit = settled("chatter")
    response, start = propagated(orbit.motion, Record(level=False, events=True))
    assert orbit.schedule.symmetric
    assert len(orbit.impacts) == 2 * len(response.impacts.time)
    sizes = np.abs([impact.impulse for impact in orbit.impacts])
    assert np.min(sizes) < 1e-5 * np.max(sizes)
    found = np.sort((start + orbit.case.omega * response.impacts.time) % np.pi)
    assert np.allclose(np.sort([impact.phase % np.pi for impact in orbit.impacts])[::2], found, rtol=0, atol=1e-12)


# --- ten modes, starts, branches -------------------------------------------------------------------------------------------------


def test_ten_modes_in_a_window_with_a_stuck_phase() -> None:
    """The recommended absorber, between two numbers of reversals: friction holds it for some microseconds, and shooting says so."""
    found = orbit_of_simulation(paper_case(10, 0.9726, 3.5, 0.7, 0.1), settle=1000)
    assert isinstance(found, Orbit), found.reason
    assert isinstance(found.motion, ShotMotion)
    assert [event.wall for event in found.schedule.events if event.regime is Regime.JOINED] == [0]
    assert found.residual < BAR
    assert found.schedule.period_multiple == 3
    assert found.stability.stable
    assert len(found.impacts) == 6
    assert np.sum(np.abs(found.stability.multipliers) < 1e-6) >= 1  # a disturbance of when it is let go dies at once


def test_a_branch_has_orbits_in_the_window_of_a_stuck_phase() -> None:
    """Between two numbers of reversals friction holds the absorber: there the branch's own solutions are no orbits, shooting's are."""
    start = many_reversals()
    first = float(start.case.model.omega[0])
    branch = orbit_branch(start.solution, "omega", (0.9695 * first, 0.973 * first), Steps(first=0.002, least=1e-8, most=0.01))
    found = list(branch.orbits())
    assert all(isinstance(point, Orbit) for point in found), [point.reason for point in found if isinstance(point, NoOrbit)]
    held = [point for point in found if isinstance(point, Orbit) and not point.schedule.flies]
    assert held
    assert all(point.residual < BAR for point in held)
    (crossing,) = crossings(branch, 0.9715 * first)
    assert isinstance(crossing, Orbit)
    assert not crossing.schedule.flies
    assert crossing.residual < BAR


# --- what is refused -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["chatter", "without rebound"])
def test_the_mirror_image_of_a_symmetric_orbit_with_held_phases_is_itself(name: str) -> None:
    other = mirrored(settled(name))
    assert isinstance(other, Orbit)
    assert same(settled(name), other)


def test_what_does_not_come_back_or_never_touches_says_so() -> None:
    lost = shoot(paper_case(3, 1.0, 3.0, 0.9), 0.0, np.array([1e-3, 0, 0, 0, 0.1, 0, 0, 2.0]))
    assert isinstance(lost, NoOrbit)
    assert "did not converge" in lost.reason
    apart = shoot(paper_case(1, 0.9, 0.1, 0.75), 0.0, np.zeros(4))
    assert isinstance(apart, NoOrbit)
    assert "do not touch" in apart.reason
    stuck = orbit_of_simulation(paper_case(1, 0.9, 0.01, 0.75, 5.0), settle=20)
    assert isinstance(stuck, NoOrbit)
    assert "holds the absorber all the time" in stuck.reason
    model = ModalModel([30.0], [0.0], [1.0], [1.0], 1.0)
    resonant = shoot(Case(model, 30.0, 1.0), 0.0, np.zeros(4))
    assert isinstance(resonant, NoOrbit)
    assert "resonance" in resonant.reason


def test_a_passage_repeats_the_exact_methods_run_from_any_state() -> None:
    """Over two periods through impacts, sticking and chatter, not on an orbit: the state in the end, and its derivative by central differences."""
    case, rng = paper_case(3, 0.95, 6.0, 0.4, 0.05), np.random.default_rng(5)
    unit = np.concatenate([np.full(4, case.gap), np.full(4, case.gap * case.omega)])
    # where a run was after 40 periods: another processor's run is elsewhere by then
    orbit_like = np.array([3.96e-4, 1.48e-7, 3.23e-6, 2.44e-4, 0.311, -1.39e-2, 2.68e-3, 0.969])

    def run(state: np.ndarray) -> np.ndarray:
        return simulate(case.scene, case.drive(2 * case.period, 0.3), initial=start_from(case.scene, state), record=RECORD).end_state / unit

    for _ in range(5):
        state = orbit_like * (1 + 0.1 * rng.uniform(-1, 1, 8))
        state[3] = model_of(3).tip_shape @ state[:3] + 0.2e-3 * rng.uniform(-1, 1)
        found = passage(case, 0.3, state, 2 * case.period)
        assert np.max(np.abs(found.end / unit - run(state))) < 1e-10
        steps = 1e-7 * np.diag(unit)
        truth = np.array([(run(state + step) - run(state - step)) / 2e-7 for step in steps]).T
        assert np.max(np.abs(found.derivative * unit / unit[:, None] - truth)) < 1e-4 * np.max(np.abs(truth))
        assert sum(happening.event.is_impact for happening in found.happenings) > 2
