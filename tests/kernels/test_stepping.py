"""The stepping methods converge to the exact method as their steps shrink.

A step is that of the textbook. Steps that are too long are refused.
"""

import numpy as np
import pytest
from core import (
    EVERYTHING,
    OMEGA,
    PERIOD,
    Array,
    drive_of,
    golden,
    run,
    scene_of,
    steady_base,
    still,
)

from impact_env import (
    Beam,
    CompliantWalls,
    Drive,
    ElasticCoulombFriction,
    Exact,
    FrequencySchedule,
    InitialState,
    IntegrationError,
    ModalModel,
    Moreau,
    NonlinearSink,
    ParameterError,
    RungeKutta,
    Scene,
    SlidingAbsorber,
    StuckAbsorber,
    TunedAbsorber,
    beam_scene,
    friction_damper,
    impact_absorber,
    simulate,
)
from impact_env.controlled import ControlledRuns
from impact_env.kernels.motion.loads import NO_LOADS
from impact_env.kernels.stepping import runge_kutta
from impact_env.kernels.stepping.grid import BeamModes, DriveForce, fill_force
from impact_env.kernels.stepping.runge_kutta_step import (
    STRIDE,
    CompliantLaws,
    Q,
    new_runge_kutta_table,
)
from impact_env.level import response_level
from impact_env.methods import LEAST_STEPS_PER_PERIOD, Method, check_mass, check_step
from impact_env.parameters import Absorber
from impact_env.results import Response

LINEAR = [None, StuckAbsorber(), TunedAbsorber()]
RIGID = [
    impact_absorber(),
    impact_absorber(restitution=0.7),
    impact_absorber(5e-4, 0.3, 0.1),
    friction_damper(0.1),
]
COMPLIANT = [
    SlidingAbsorber(walls=CompliantWalls(1e6)),
    SlidingAbsorber(friction=ElasticCoulombFriction(0.1, 1e5)),
    SlidingAbsorber(0.05, CompliantWalls(1e5, 5e-4), ElasticCoulombFriction(0.1, 1e5)),
]
DRIVE = drive_of(6.0, 0.98, 1.02, periods=3.5, phase=0.4)
METHODS = [Moreau, RungeKutta]
Stepping = type[Moreau] | type[RungeKutta]


def deviation(response: Response, exact: Response) -> float:
    """Return the largest difference of the modal displacements, relative to the largest.

    It is that over the run, or for linear scenes that at the end.
    """
    scale = np.max(np.abs(exact.history.modal_displacement))
    modes = exact.scene.model.modes
    if not isinstance(exact.scene.absorber, SlidingAbsorber):
        return float(np.max(np.abs(response.end_state - exact.end_state)[:modes]) / scale)
    return float(
        np.max(np.abs(response.history.modal_displacement - exact.history.modal_displacement))
        / scale
    )


def converge(
    absorber: Absorber | None, methods: list[Method], close: float, **beam: float
) -> tuple[float, float]:
    """Return the finest run's deviation and the order of convergence.

    The finest run's impacts, phases and energies must be within multiples of ``close``.
    """
    scene = scene_of(absorber, modes=2, **beam)
    exact = run(scene, DRIVE)
    runs = [run(scene, DRIVE, method) for method in methods]
    errors = [deviation(r, exact) for r in runs]
    fine = runs[-1]
    few = min(3, exact.impact_count)
    np.testing.assert_allclose(
        fine.impacts.time[:few], exact.impacts.time[:few], rtol=0, atol=10 * close * PERIOD
    )
    np.testing.assert_allclose(
        fine.impacts.impulse[:few], exact.impacts.impulse[:few], rtol=100 * close
    )
    for name in ("work", "friction_loss", "impact_loss", "absorber_damping"):
        values = [getattr(r.energy, name) for r in (fine, exact)]
        assert values[0] == pytest.approx(
            values[1], rel=20 * close, abs=20 * close * abs(exact.energy.work)
        )
    np.testing.assert_allclose(
        fine.energy.modal_loss,
        exact.energy.modal_loss,
        rtol=0,
        atol=20 * close * abs(exact.energy.work),
    )
    if isinstance(methods[0], Moreau):  # the other method does not count how long a slider holds
        assert fine.stuck_time == pytest.approx(exact.stuck_time, abs=100 * close * PERIOD)
    steps = [method.steps_per_period for method in methods]
    return errors[-1], float(np.log(errors[0] / errors[-1]) / np.log(steps[-1] / steps[0]))


@pytest.mark.parametrize("absorber", LINEAR)
def test_linear_scenes(absorber: Absorber | None) -> None:
    error, order = converge(absorber, [RungeKutta(50), RungeKutta(400)], 1e-8)
    assert error < 1e-8
    assert order > 3.7
    error, order = converge(absorber, [Moreau(100), Moreau(10_000)], 1e-4)
    assert error < 1e-4
    assert order > 0.8


def driven_from_rest(
    ratio: float, damping: float, time: Array, natural: float
) -> tuple[Array, Array]:
    """Return displacement and velocity of one mode from rest in closed form.

    The force is cos(ratio natural t).
    """
    force = ratio * natural
    gain = 1 / (natural**2 - force**2 + 2j * damping * natural * force)
    rate = -damping * natural + 1j * natural * np.sqrt(1 - damping**2)
    steady = gain * np.exp(1j * force * time)
    # free motion a exp(rate t) that cancels the steady one at time 0
    q = -gain.real
    v = -(1j * force * gain).real
    free = (q + 1j * (rate.real * q - v) / rate.imag) * np.exp(rate * time)
    return (steady + free).real, (1j * force * steady + rate * free).real


SAMPLED = [(RungeKutta, 0.01, 4.0), (Moreau, 0.01, 1.0), (Moreau, 0.0, 2.0)]


@pytest.mark.parametrize(("method", "damping", "order"), SAMPLED, ids=str)
def test_level_and_samples_between_steps_converge_at_the_order_of_the_method(
    method: Stepping, damping: float, order: float
) -> None:
    """Steps and samples fall together nowhere but at the ends of periods."""
    scene = Scene(ModalModel([OMEGA], [damping], [1.0], [1.0], 1.0))
    drive = drive_of(1.0, 0.93, periods=40.0)
    time = PERIOD / 32 * np.arange(40 * 32 + 1)
    displacement, velocity = driven_from_rest(0.93, damping, time, OMEGA)
    at = int(np.argmax(np.abs(displacement)))
    level = np.sqrt(np.mean(displacement[max(at - 320, 0) + 1 : at + 321] ** 2))
    errors = []
    for steps in (45, 180):
        response = simulate(scene, drive, method(steps), record=EVERYTHING)
        motion = response.history
        errors.append(
            [
                abs(response.level.value / level - 1),
                np.max(np.abs(motion.modal_displacement[:, 0] - displacement)) / level,
                np.max(np.abs(motion.modal_velocity[:, 0] - velocity)) / level / OMEGA,
            ]
        )
    orders = np.log(np.divide(*errors)) / np.log(4)
    # the velocity of a cubic is of one order less
    assert np.all(orders > np.array([order, order, min(order, 3.0)]) - 0.3), (orders, errors)


def test_controlled_intervals_sample_between_steps_as_a_run_does() -> None:
    scene = Scene(ModalModel([OMEGA], [0.01], [1.0], [0.5], 1.0, response_shape=[2.0]))
    runs = ControlledRuns(scene, 1, OMEGA, 1.0, RungeKutta(45), samples_per_period=32, threads=1)
    runs.orders["force"] = 1.0
    runs.orders["omega_start"] = runs.orders["omega_stop"] = 0.93 * OMEGA
    for _ in range(40):
        runs.advance()
    time = PERIOD / 32 * np.arange(40 * 32)
    displacement = 2.0 * driven_from_rest(0.93, 0.01, time, OMEGA)[0]
    mean_square = np.mean(displacement[-32:] ** 2)
    assert runs.reports["mean_square"][0] == pytest.approx(mean_square, rel=2e-4)
    level = response_level(displacement, 32)[0]
    assert runs.reports["level"][0] == pytest.approx(level, rel=2e-4)
    runs.close()


def test_moreau_without_damping_is_of_second_order() -> None:
    assert 1.9 < converge(None, [Moreau(100), Moreau(1600)], 1e-4, damping_ratio=0.0)[1] < 2.2


@pytest.mark.parametrize("absorber", RIGID)
def test_rigid_scenes(absorber: Absorber) -> None:
    error, order = converge(absorber, [Moreau(200), Moreau(20_000)], 2e-4)
    assert error < 2e-4
    assert order > 0.6


@pytest.mark.parametrize("absorber", COMPLIANT)
def test_compliant_scenes(absorber: Absorber) -> None:
    error, order = converge(absorber, [RungeKutta(50, 50), RungeKutta(500, 500)], 5e-4)
    assert error < 5e-4
    assert order > 1.3


@pytest.mark.parametrize(
    ("name", "duration", "paper_error"),
    [("rigid_friction_10_modes", 0.2, 3e-4), ("rigid_frictionless_3_modes", 0.45, 5e-3)],
)
def test_moreau_s_first_impacts_of_the_golden_cases(
    name: str, duration: float, paper_error: float
) -> None:
    scene, drive, times, velocities = golden(name, duration)
    period = drive.schedule.pseudo_period
    paper, fine = (run(scene, drive, Moreau(steps)).impacts for steps in (20, 10_000))
    assert abs(paper.time[0] - times[0]) < paper_error * period
    np.testing.assert_allclose(fine.time[:5], times[:5], atol=1e-3 * period)
    assert abs(fine.time[0] - times[0]) < 2e-5 * period
    np.testing.assert_allclose(fine.relative_velocity[:3], velocities[:3], rtol=1e-2)


def test_mirror_symmetry_and_scaling_law_of_moreau_s_scheme() -> None:
    one, mirrored, doubled = (
        run(
            scene_of(impact_absorber(factor * 1e-3, 0.7, factor * 0.1)),
            drive_of(force, 0.98, 0.985, periods=50),
            Moreau(),
        )
        for factor, force in ((1, 3.5), (1, -3.5), (2, 7.0))
    )
    np.testing.assert_array_equal(mirrored.end_state, -one.end_state)
    np.testing.assert_array_equal(doubled.end_state, 2 * one.end_state)


@pytest.mark.parametrize("dt", [1e-4, 3.3e-3, 0.4])
def test_the_turning_phasor_is_the_cosine(dt: float) -> None:
    schedule = FrequencySchedule(
        np.array([0.0, 0.3, 0.301, 0.5, 2.0]), np.array([240.0, 270.0, 100.0, 100.0, 900.0]), OMEGA
    )
    force = DriveForce(
        *(
            np.array(row)
            for row in (schedule.times, schedule.omegas, schedule.phase_at(schedule.times))
        ),
        1.0,
        0.7,
        NO_LOADS,
    )
    count = int(2.0 / dt)
    target = np.zeros(count)
    fill_force(target, count, force, 0, 0.0, dt)
    np.testing.assert_allclose(
        target, np.cos(schedule.phase_at(dt * np.arange(count)) + 0.7), atol=2e-12
    )


def textbook(scene: Scene, drive: Drive, steps: int) -> Array:
    """Return the end state of the classical Runge-Kutta method.

    The method is applied to the equations of motion directly. The slider moves after each step.
    """
    model = scene.model
    n = scene.model.modes
    sliding = scene.absorber
    mass = scene.absorber_mass
    walls = sliding.walls
    friction = sliding.friction
    y = np.zeros(2 * n + 2)
    rest = 0.0
    h = drive.schedule.times[-1] / steps

    def slope(t: float, y: Array) -> Array:
        d = y[n] - model.tip_shape @ y[:n]
        p = -walls.stiffness * np.sign(d) * max(abs(d) - walls.gap, 0.0) - np.clip(
            friction.stiffness * (d - rest), -friction.limit, friction.limit
        )
        force = drive.amplitude * np.cos(drive.schedule.phase_at(t) + drive.phase)
        modal = (
            model.force_shape * force
            - model.tip_shape * p
            - model.omega**2 * y[:n]
            - 2 * model.damping_ratio * model.omega * y[n + 1 : -1]
        )
        return np.concatenate([y[n + 1 :], modal, [p / mass]])

    for i in range(steps):
        k1 = slope(i * h, y)
        k2 = slope((i + 0.5) * h, y + h / 2 * k1)
        k3 = slope((i + 0.5) * h, y + h / 2 * k2)
        k4 = slope((i + 1) * h, y + h * k3)
        y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        d = y[n] - model.tip_shape @ y[:n]
        reach = friction.limit / friction.stiffness
        rest = min(max(rest, d - reach), d + reach)
    return y


def test_the_runge_kutta_step_is_the_textbook_step() -> None:
    scene = scene_of(
        SlidingAbsorber(0.02, CompliantWalls(1e5, 5e-5), ElasticCoulombFriction(0.02, 2e4))
    )
    schedule = FrequencySchedule(
        np.array([0.0, 0.011, 0.02, 0.03]), np.array([250.0, 300.0, 90.0, 90.0]), OMEGA
    )
    drive = Drive(20.0, schedule, 0.4)
    response = run(scene, drive, RungeKutta())
    assert response.impact_count > 1
    np.testing.assert_allclose(
        response.end_state, textbook(scene, drive, response.steps), rtol=1e-9, atol=1e-13
    )


@pytest.mark.parametrize("mass_ratio", [1e-6, 0.02, 10.0])
@pytest.mark.parametrize("stiffness", [1e2, 1e9])
def test_runge_kutta_is_stable_for_light_and_heavy_absorbers_on_soft_and_hard_walls(
    mass_ratio: float, stiffness: float
) -> None:
    scene = scene_of(SlidingAbsorber(mass_ratio, CompliantWalls(stiffness, 1e-5)), modes=10)
    assert np.max(np.abs(run(scene, drive_of(1.0, 1.0, periods=0.5), RungeKutta()).end_state)) < 1.0


# --- steps that are too long are refused before anything is computed, and only those


def checked(ratio: float, method: Method, frequency: float = 1.0, force: float = 1.0) -> None:
    scene = scene_of(modes=1, damping_ratio=ratio)
    check_step(
        scene,
        drive_of(force, frequency, periods=1.0, reference=float(scene.model.omega[0])),
        method,
    )


@pytest.mark.parametrize("steps", [4, 20, 200])
@pytest.mark.parametrize("method", METHODS)
def test_the_limit_of_strong_damping_is_that_of_a_step_s_polynomial(
    method: Stepping, steps: int
) -> None:
    """The limit of strong damping is that of the polynomial of a step.

    Moreau: z^2 - (2 - 2 D x - x^2) z + 1 - 2 D x has a root at -1 where x^2 + 4 D x = 4.
    Runge-Kutta: the fourth-order polynomial is 1.
    """
    x = 2 * np.pi / steps
    fastest = 2.785293563405282 / x  # D + sqrt(D^2 - 1)
    critical = (4 - x**2) / (4 * x) if method is Moreau else 0.5 * (fastest + 1 / fastest)
    checked(critical * (1 - 1e-6), method(steps))
    with pytest.raises(ParameterError, match=rf"steps_per_period = {steps} .*damping"):
        checked(critical * (1 + 1e-6), method(steps))


@pytest.mark.parametrize("method", METHODS)
def test_steps_that_the_message_asks_for_are_allowed_and_a_force_between_the_steps_is_not(
    method: Stepping,
) -> None:
    for ratio in (5.0, 50.0, 500.0):
        with pytest.raises(ParameterError) as caught:
            checked(ratio, method())
        checked(ratio, method(int(str(caught.value).partition("about ")[2].split()[0])))
    most = 20 / LEAST_STEPS_PER_PERIOD
    checked(0.01, method(), most * (1 - 1e-9))
    checked(0.01, method(), 100.0, force=0.0)
    checked(0.01, method(401), 100.0)
    with pytest.raises(ParameterError, match=r"steps_per_period = 20 .*force"):
        checked(0.01, method(), most * 1.01)


@pytest.mark.parametrize("method", METHODS)
def test_simulate_refuses_in_a_short_run_what_would_blow_up_in_a_long_one(method: Stepping) -> None:
    """After a third of a period the numbers would still look like numbers."""
    with pytest.raises(ParameterError, match="steps_per_period"):
        simulate(
            scene_of(TunedAbsorber() if method is Moreau else None, damping_ratio=6.0),
            drive_of(50.0, 1.0, periods=0.3),
            method(),
        )


def test_friction_under_a_force_far_above_all_modes() -> None:
    """The micro flights after a reversal are then set by the force, not by the modes."""
    scene = scene_of(impact_absorber(restitution=0.7, friction_limit=0.1))
    exact, stepped = (
        run(scene, drive_of(1e7, 1e4, periods=0.002), method, samples=500).end_state
        for method in (Exact(), Moreau(400_000))
    )
    np.testing.assert_allclose(exact, stepped, atol=3e-5 * float(np.max(np.abs(stepped))))


@pytest.mark.parametrize("method", [Exact(), Moreau(), RungeKutta()])
def test_an_absorber_that_holds_the_tip_still_is_refused(method: Method) -> None:
    # a mass that the tip slides along is another matter: to it, a mass without end is the ground
    for absorber in (StuckAbsorber(8e5), friction_damper(1.0, 1e9), TunedAbsorber(1e9)):
        check_mass(scene_of(absorber))
    with pytest.raises(
        ParameterError, match=r"mass_ratio = 1000000.0 is not allowed: at most 8\.3e\+05"
    ):
        simulate(scene_of(StuckAbsorber(1e6)), drive_of(1.0, 1.0, periods=1.0), method)
    model = beam_scene(Beam(modes=3)).model
    assert 8.3e5 * model.beam_mass * np.sum(model.tip_shape**2) == pytest.approx(1e7, rel=0.01)


def test_friction_of_moreau_s_scheme_brakes_by_its_limit() -> None:
    """Friction of Moreau's scheme decelerates by its limit.

    A body of 1 kg on a base at rest loses the limit times the time of its velocity. This is exact,
    since the scheme is exact for constant forces.
    """
    limit = 0.02
    response = run(
        Scene(steady_base(), friction_damper(limit, 1.0)),
        still(1.5),
        Moreau(20),
        InitialState(absorber_velocity=0.05),
    )
    assert response.end_state[3] == pytest.approx(0.05 - limit * 1.5, rel=1e-12)
    assert response.energy.friction_loss == pytest.approx(
        limit * (0.05 * 1.5 - limit * 1.5**2 / 2), rel=1e-6
    )


def test_an_impact_of_moreau_s_scheme_has_the_restitution_of_its_wall() -> None:
    """An impact of Moreau's scheme has the restitution of its wall.

    A body of 1 kg on a base at rest rebounds from a wall with this share of its velocity and loses
    the rest of its energy.
    """
    response = run(
        Scene(steady_base(), impact_absorber(1e-3, 0.7, mass_ratio=1.0)),
        still(0.06),
        Moreau(2000),
        InitialState(absorber_velocity=0.05),
    )
    assert response.impact_count == 1
    assert response.end_state[3] == pytest.approx(-0.7 * 0.05, rel=1e-12)
    assert response.energy.impact_loss == pytest.approx((1 - 0.7**2) * 0.05**2 / 2, rel=1e-9)


def test_friction_of_runge_kutta_s_scheme_brakes_by_its_limit() -> None:
    """The same with a slider so stiff that its spring hardly counts: closed form with it."""
    limit = 0.02
    stiffness = 100.0
    speed = 0.05
    rate = np.sqrt(stiffness)
    first = np.arcsin(limit / (stiffness * speed / rate)) / rate
    left = speed * np.cos(rate * first) - limit * (0.5 - first)
    response = run(
        Scene(
            steady_base(), SlidingAbsorber(1.0, friction=ElasticCoulombFriction(limit, stiffness))
        ),
        still(0.5),
        RungeKutta(100, 2000),
        InitialState(absorber_velocity=speed),
    )
    assert response.end_state[3] == pytest.approx(left, rel=1e-6)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("depth", [0.1, 0.01])
def test_a_wall_that_is_touched_within_a_step_only_is_listed(side: float, depth: float) -> None:
    """A contact with a wall that begins and ends within a step is listed.

    A tip turns back at the wall of an absorber at rest. At a depth of a hundredth, even the cubic
    through the step's ends does not reach the wall.
    """
    scene = scene_of(SlidingAbsorber(0.02, CompliantWalls(100.0, 1e-3)), modes=1)
    model = scene.model
    method = RungeKutta(6)
    dt = method.step(scene)
    # undisturbed, the distance of the tip at the middle of the first step is the gap and a share of
    # what it gains in half a step
    turn = 0.5 * dt * OMEGA
    amplitude = side * 1e-3 / (1 - depth * (1 - np.cos(turn))) / model.tip_shape[0]
    start = InitialState([amplitude * np.cos(turn)], [amplitude * OMEGA * np.sin(turn)], 0.0, 0.0)
    response = run(scene, still(dt), method, start)
    assert response.steps == 1
    impacts = response.impacts
    assert response.impact_count == len(impacts.time) == 1
    assert 0 < impacts.time[0] < dt
    assert impacts.impulse[0] == pytest.approx(
        scene.absorber_mass * response.end_state[-1], rel=1e-12
    )
    assert np.sign(impacts.impulse[0]) == side
    phases = response.phases
    assert phases.start[0] == impacts.time[0] <= phases.end[0] < dt
    assert np.sign(impacts.relative_velocity[0]) in (-side, 0)


def test_a_step_too_long_for_a_nonlinear_spring_where_it_is_ends_the_run() -> None:
    """A run ends if its step is too long for the present stiffness of a nonlinear spring.

    The limit is four steps in a period of the tangent stiffness 3 k y^2, as of a mode, at the
    largest stretch of a run with short steps.
    """
    sink = NonlinearSink(1e9, 0.02, 0.0)
    scene = scene_of(sink, modes=1)
    start = InitialState([0.0], absorber_displacement=2e-3)
    fine = run(scene, still(PERIOD), RungeKutta(400), start)
    stretch = fine.history.absorber_displacement - fine.history.tip_displacement
    stiffness = 3 * sink.cubic_stiffness * np.max(np.abs(stretch)) ** 2
    mobility = 1 / scene.absorber_mass + float(np.sum(scene.model.tip_shape**2))
    needed = 4 * np.sqrt(stiffness * mobility) / OMEGA
    assert needed > 10
    run(scene, still(PERIOD), RungeKutta(int(1.02 * needed) + 1), start)
    with pytest.raises(IntegrationError, match=r"stiffness of the nonlinear spring.*steps_per_per"):
        run(scene, still(PERIOD), RungeKutta(int(0.95 * needed)), start)


@pytest.mark.plain
def test_an_absorber_that_is_not_finite_is_reported_as_a_mode_is() -> None:
    modes = BeamModes(np.array([1.0]), np.zeros(1), np.ones(1), np.zeros(1))
    laws = CompliantLaws(mass=0.1)
    for place in (0, 1):
        table = new_runge_kutta_table(modes, laws, 1.0, np.zeros(4), 0.1, None)
        assert runge_kutta._is_finite(table)
        table.cells[Q * STRIDE + place] = np.nan
        assert not runge_kutta._is_finite(table)
