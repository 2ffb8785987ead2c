"""The table of absorber laws has one set of names for all interfaces.

The interfaces are files, commands, environments and designs. Restitution that decreases with the
velocity, and a nonlinear sink, are tested as well.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from core import ALL
from scipy.integrate import solve_ivp
from scipy.linalg import eigvals, expm

from impact_env import (
    Beam,
    Drive,
    Exact,
    Moreau,
    NonlinearSink,
    ParameterError,
    Response,
    RigidWalls,
    RungeKutta,
    SeveralAbsorbers,
    SlidingAbsorber,
    TunedAbsorber,
    YieldingWalls,
    beam_scene,
    constant_frequency,
    linear_sweep,
    simulate,
)
from impact_env.envs.settings import TaskSettings
from impact_env.frequency import find_steady_start, poles, tip_response
from impact_env.laws import (
    _ENTRIES,
    WHOLE_ABSORBERS,
    Law,
    Link,
    SceneKind,
    find_law,
    make,
    values,
)
from impact_env.methods import Method
from impact_env.periodic.case import case_of
from impact_env.periodic.harmonic_balance import harmonic_balance
from impact_env.periodic.hybrid_case import HybridCase
from impact_env.plain import from_scene, to_scene
from optimisation.cli.scene_options import SceneOptions, make_absorber

EXAMPLES: dict[str, dict[str, Any]] = {
    "impact": {"mass_ratio": 0.03, "gap": 2e-3, "restitution": 0.8, "friction_limit": 0.2},
    "impact, yielding": {
        "mass_ratio": 0.03,
        "gap": 2e-3,
        "restitution": 0.8,
        "yield_velocity": 0.5,
    },
    "impact, compliant": {
        "mass_ratio": 0.03,
        "gap": 2e-3,
        "contact_stiffness": 1e5,
        "friction_limit": 0.2,
        "friction_stiffness": 2e4,
    },
    "impact, compliant, damped": {
        "mass_ratio": 0.03,
        "gap": 2e-3,
        "contact_stiffness": 1e5,
        "restitution": 0.7,
    },
    "impact, static friction": {
        "mass_ratio": 0.03,
        "gap": 2e-3,
        "restitution": 0.8,
        "friction_limit": 0.2,
        "static_friction_ratio": 1.4,
    },
    "friction": {"mass_ratio": 0.03, "friction_limit": 0.2},
    "friction, static": {
        "mass_ratio": 0.03,
        "friction_limit": 0.2,
        "static_friction_ratio": 1.4,
    },
    "friction, elastic": {"mass_ratio": 0.03, "friction_limit": 0.2, "friction_stiffness": 2e4},
    "tuned": {"mass_ratio": 0.03, "stiffness": 650.0, "damping": 0.9},
    "sink": {"mass_ratio": 0.03, "cubic_stiffness": 5e7, "damping": 0.4},
    "stuck": {"mass_ratio": 0.03},
    "none": {},
}


@pytest.mark.parametrize("name", EXAMPLES)
def test_one_vocabulary(name: str) -> None:
    """All interfaces make the same absorber from the same names.

    They are files, options of commands, arguments of environments and the library.
    """
    concept = name.partition(",")[0]
    own_values = EXAMPLES[name]
    absorber = make(concept, own_values)
    assert values(absorber) == own_values
    assert (
        TaskSettings(
            absorber=concept,
            absorber_options=own_values,
            method="runge-kutta" if concept == "sink" else "exact",
        ).scene.absorber
        == absorber
    )
    assert make_absorber(SceneOptions(absorber=concept, values=own_values)) == absorber
    if absorber is not None:
        plain = {"beam": {"modes": 2}, "absorber": {"kind": concept, **own_values}}
        assert to_scene(plain).absorber == absorber
        assert from_scene(to_scene(plain))["absorber"] == plain["absorber"]


@pytest.mark.parametrize(
    ("concept", "values", "message"),
    [
        ("impact", {"contact_stiffness": 1e5, "restitution": 0.0}, "restitution"),
        ("impact", {"friction_limit": 0.1, "static_friction_ratio": 0.9}, "static_friction_ratio"),
        ("impact", {"static_friction_ratio": 1.5}, "static_friction_ratio"),
        (
            "friction",
            {"friction_limit": 0.1, "friction_stiffness": 1e4, "static_friction_ratio": 1.5},
            "static_friction_ratio",
        ),
        ("impact", {"yield_velocity": -1.0}, "yield_velocity"),
        ("impact", {"yield_velocity": 1.0, "contact_stiffness": 1e5}, None),
        ("impact", {"friction_stiffness": 1e4}, "friction_stiffness"),
        ("tuned", {"stiffness": -1.0}, "stiffness"),
        ("tuned", {"gap": 1e-3}, None),
        ("sink", {}, "cubic_stiffness"),
        ("magnet", {}, None),
    ],
)
def test_an_error_names_the_value(
    concept: str, values: dict[str, float], message: str | None
) -> None:
    with pytest.raises(ParameterError, match="is not allowed") as error:
        make(concept, values)
    assert message is None or error.value.argument == message


def test_an_older_form_is_read_with_a_notice() -> None:
    plain = {
        "kind": "impact",
        "walls": {"kind": "compliant", "gap_m": 2e-3, "stiffness_n_m": 1e5},
        "friction": {"limit_n": 0.1, "stiffness_n_m": 1e4},
    }
    with pytest.warns(FutureWarning, match="friction, walls is an older form"):
        scene = to_scene({"absorber": plain})
    older = {
        "gap": 2e-3,
        "contact_stiffness": 1e5,
        "friction_limit": 0.1,
        "friction_stiffness": 1e4,
    }
    assert scene.absorber == make("impact", older)
    with pytest.warns(FutureWarning, match="stiffness_n_m"):
        assert to_scene({"absorber": {"kind": "tuned", "stiffness_n_m": 600.0}}).absorber == make(
            "tuned", {"stiffness": 600.0}
        )


def yielding(velocity: float, method: Any = None) -> Response:
    scene = beam_scene(Beam(modes=2), SlidingAbsorber(0.02, YieldingWalls(velocity, 1e-3, 0.9)))
    drive = Drive(2.0, linear_sweep(scene.model.resonance_omega(1), 0.95, 1.0, 10.0))
    return simulate(scene, drive, method, record=ALL)


def test_restitution_falls_with_the_velocity_of_each_impact() -> None:
    response = yielding(0.1)
    impacts = response.impacts
    model = response.scene.model
    assert response.impact_count > 30
    e = 0.9 * (1 + np.abs(impacts.relative_velocity) / 0.1) ** -0.25
    assert np.ptp(e) > 0.03  # the velocities are such that the law matters
    compliance = 1 / (0.02 * model.beam_mass) + np.sum(model.tip_shape**2)
    np.testing.assert_allclose(
        impacts.impulse, -(1 + e) * impacts.relative_velocity / compliance, rtol=1e-12
    )
    np.testing.assert_allclose(
        impacts.energy_lost,
        (1 - e**2) * impacts.relative_velocity**2 / (2 * compliance),
        rtol=1e-12,
    )
    assert response.energy.relative_error < 1e-11
    far_below = yielding(1e30)
    constant = simulate(
        beam_scene(Beam(modes=2), SlidingAbsorber(0.02, RigidWalls(1e-3, 0.9))),
        response.drive,
        record=ALL,
    )
    np.testing.assert_array_equal(far_below.impacts.time, constant.impacts.time)
    np.testing.assert_array_equal(far_below.end_state, constant.end_state)


def test_the_moreau_scheme_comes_closer_with_its_step() -> None:
    """Up to the first impacts, which multiply every difference."""
    exact = yielding(0.1).impacts.time[1]
    distances = [
        abs(yielding(0.1, Moreau(steps)).impacts.time[1] - exact) for steps in (100, 1000, 10000)
    ]
    assert distances[2] < distances[1] < distances[0]


def test_what_knows_the_constant_law_alone_refuses_it() -> None:
    walls = SlidingAbsorber(0.02, YieldingWalls(0.1))
    scene = beam_scene(Beam(modes=2), walls)
    two = beam_scene(Beam(modes=2), SeveralAbsorbers((walls, walls), (0.5, 1.0)))
    omega = 0.95 * scene.model.resonance_omega(1)
    for known in (
        lambda: harmonic_balance(scene, omega, 1.5),
        lambda: case_of(scene, 1.5, omega),
        lambda: HybridCase(two, 1.5, omega),
    ):
        with pytest.raises(ParameterError, match="is not allowed"):
            known()


def test_a_nonlinear_sink_is_integrated_as_an_independent_solver_does() -> None:
    scene = beam_scene(Beam(modes=2), NonlinearSink(5e7, 0.02, 0.5))
    model = scene.model
    mass = scene.absorber_mass
    omega = scene.model.resonance_omega(1)
    drive = Drive(2.0, constant_frequency(omega, 0.98, 12.0))

    def rates(t: float, x: Any) -> Any:
        u = x[:2]
        q = x[2]
        v = x[3:5]
        w = x[5]
        d = q - model.tip_shape @ u
        g = w - model.tip_shape @ v
        force = -5e7 * d**3 - 0.5 * g
        pull = model.force_shape * 2.0 * np.cos(0.98 * omega * t) - model.tip_shape * force
        return np.concatenate(
            [
                v,
                [w],
                pull - model.omega**2 * u - 2 * model.damping_ratio * model.omega * v,
                [force / mass],
            ]
        )

    end = drive.schedule.times[-1]
    reference = solve_ivp(
        rates, (0.0, end), np.zeros(6), method="DOP853", rtol=1e-12, atol=1e-15
    ).y[:, -1]
    errors = []
    for steps in (50, 100, 200):
        response = simulate(scene, drive, RungeKutta(steps), record=ALL)
        errors.append(np.max(np.abs(response.end_state - reference)) / np.max(np.abs(reference)))
    assert errors[2] < 1e-6
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.5)  # fourth order
    assert response.energy.relative_error < 1e-9


@dataclass(frozen=True)
class FrequencyAbsorber(TunedAbsorber):
    """Mass on a spring that is given by its frequency in rad/s, and on a damper in N s/m."""

    own_frequency: float = 250.0
    damper: float = 0.3


@pytest.fixture
def frequency_absorbers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Add the absorber to the table of laws."""
    law = Law(
        FrequencyAbsorber,
        SceneKind.LINEAR,
        lambda a: f"own frequency {a.own_frequency:g} rad/s, damping {a.damper:g} N s/m",
        link=lambda a, mass: Link(mass * a.own_frequency**2, a.damper),
    )
    monkeypatch.setitem(_ENTRIES, FrequencyAbsorber, law)
    monkeypatch.setitem(WHOLE_ABSORBERS, "tuned", law)


def _linked_matrices(scene: Any, stiffness: float, damper: float) -> tuple[Any, Any, Any]:
    """Return mass, damping and stiffness matrices of modes and absorber, entry by entry."""
    model = scene.model
    n = model.modes
    matrices = np.diag(np.append(np.ones(n), scene.absorber_mass)), np.zeros((n + 1, n + 1))
    mass, damping = matrices
    spring = np.zeros((n + 1, n + 1))
    for matrix, factor, own in (
        (damping, damper, 2 * model.damping_ratio * model.omega),
        (spring, stiffness, model.omega**2),
    ):
        matrix[n, n] = factor
        for i in range(n):
            matrix[i, i] += own[i]
            matrix[i, n] = matrix[n, i] = -factor * model.tip_shape[i]
            for j in range(n):
                matrix[i, j] += factor * model.tip_shape[i] * model.tip_shape[j]
    return mass, damping, spring


@pytest.mark.usefixtures("frequency_absorbers")
def test_a_linear_absorber_is_its_link() -> None:
    """All methods and frequency responses take spring and damper from the table's `Link`.

    Frequency response, poles, steady start and the motion of a run agree with dense matrices.
    """
    absorber = FrequencyAbsorber()
    scene = beam_scene(Beam(modes=2), absorber)
    model = scene.model
    assert "own frequency 250 rad/s" in str(scene)
    stiffness = scene.absorber_mass * 250.0**2
    mass, damping, spring = _linked_matrices(scene, stiffness, 0.3)
    load = np.append(model.force_shape, 0.0)
    tip = np.append(model.tip_shape, 0.0)

    omega = np.array([100.0, 252.0, 900.0])
    dense = [np.linalg.solve(spring + 1j * w * damping - w**2 * mass, load) for w in omega]
    computed = tip_response(model, absorber, omega)
    np.testing.assert_allclose(computed, [tip @ u for u in dense], rtol=1e-11)

    zero = np.zeros((3, 3))
    inverse = np.linalg.inv(mass)
    rates = np.block([[zero, np.eye(3)], [-inverse @ spring, -inverse @ damping]])
    every = eigvals(rates)
    np.testing.assert_allclose(
        np.sort_complex(poles(model, absorber)), np.sort_complex(every[every.imag > 0]), rtol=1e-9
    )

    # a force cos(w t) as two further states
    w = 0.98 * model.resonance_omega(1)
    drive = Drive(2.0, constant_frequency(model.resonance_omega(1), 0.98, 12.0))
    whole = np.zeros((8, 8))
    whole[:6, :6] = rates
    whole[3:6, 6] = 2.0 * inverse @ load
    whole[6, 7] = -w
    whole[7, 6] = w
    end = expm(whole * drive.schedule.times[-1])[:6, 6]
    steady = 2.0 * np.linalg.solve(spring + 1j * w * damping - w**2 * mass, load)
    start = find_steady_start(scene, drive)
    np.testing.assert_allclose(
        start.vector(scene), np.concatenate([steady.real, (1j * w * steady).real]), rtol=1e-9
    )
    methods: tuple[tuple[Method, float, float], ...] = (
        (Exact(), 1e-10, 1e-12),
        (RungeKutta(100), 1e-6, 1e-9),
        (Moreau(400), 1e-3, 1e-4),
    )
    for method, tolerance, balance in methods:
        response = simulate(scene, drive, method, record=ALL)
        assert np.max(np.abs(response.end_state - end)) < tolerance * np.max(np.abs(end))
        assert response.energy.relative_error < balance


@pytest.mark.usefixtures("frequency_absorbers")
@pytest.mark.parametrize(("own_frequency", "damper"), [(2e4, 0.0), (1.0, 900.0)])
def test_a_step_resolves_the_link_of_a_linear_absorber(own_frequency: float, damper: float) -> None:
    scene = beam_scene(Beam(modes=2), FrequencyAbsorber(own_frequency=own_frequency, damper=damper))
    compliance = 1 / scene.absorber_mass + np.sum(scene.model.tip_shape**2)
    stiffness = scene.absorber_mass * own_frequency**2
    highest = max(np.sqrt(stiffness * compliance), damper * compliance)
    for method in (Moreau(50), RungeKutta(50)):
        assert method.step(scene) == pytest.approx(2 * np.pi / (50 * highest), rel=1e-12)


def test_an_entry_of_a_linear_absorber_has_a_link() -> None:
    """Without one it would be a stuck absorber."""
    tuned = find_law(TunedAbsorber())
    with pytest.raises(ParameterError, match="link") as error:
        Law(TunedAbsorber, SceneKind.LINEAR, tuned.words)
    assert error.value.argument == "link"
    with pytest.raises(ParameterError, match="left out for NonlinearSink"):
        Law(NonlinearSink, SceneKind.SMOOTH, tuned.words, link=tuned.link)
