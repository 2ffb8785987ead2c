"""Calibration agrees with closed forms and refuses wrong measurements.

Measurement files, statistics, the linear fit, posteriors, the predictive check and the command are
tested.
"""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy
from commands import call, done
from numpy.typing import NDArray

from impact_env import (
    Beam,
    InitialState,
    ParameterError,
    Record,
    Scene,
    beam_scene,
    impact_absorber,
    linear_sweep,
    modal_model,
    simulate,
)
from impact_env.loads import Samples
from impact_env.records.units import find_unit
from optimisation.answers.calibration import CalibrationRuns, calibrate
from optimisation.calibration.admission import require_plausible, require_reachable_gap
from optimisation.calibration.alternatives import list_alternatives
from optimisation.calibration.inference import Ensemble, infer, measure_sensitivity
from optimisation.calibration.likelihood import (
    fit_regression_statistics,
    polynomial_terms,
    sample_density,
)
from optimisation.calibration.linear_fit import fit_linear
from optimisation.calibration.measurement import (
    ACCELERATION,
    DISPLACEMENT,
    VELOCITY,
    DecayMeasurement,
    LevelMeasurement,
    RecordMeasurement,
    Sensor,
    read_measurements,
)
from optimisation.calibration.parameters import Prior, read_priors, scene_with
from optimisation.calibration.plan import order_sweeps
from optimisation.calibration.posterior import Posterior, read_posterior
from optimisation.calibration.predictive import (
    compare_statistics,
    estimate_by_measurement,
    log_density,
)
from optimisation.calibration.simulation import (
    MeasurementSimulator,
    Simulator,
    loads_on_clock,
    read_sensor,
)
from optimisation.calibration.summaries import Statistic, plan_record_summary
from optimisation.checkpoint import Checkpoint
from optimisation.cli import calibrate as command
from optimisation.cli.options import join_words
from optimisation.files import write_json

Array = NDArray[np.float64]
BEAM = Beam(modes=2)
RATE = 800.0
NOISE = 1e-5  # m


def swept_load(force: float = 3.5, percent: float = 16.0) -> Samples:
    """A force swept through the first resonance of the paper's beam."""
    schedule = linear_sweep(modal_model(BEAM).resonance_omega(1), 0.92, 1.06, percent)
    times = np.arange(int(float(schedule.times[-1]) * RATE) + 1) / RATE
    return Samples(times, force * np.cos(schedule.phase_at(times)))


def record_of(
    response: Array, load: Samples, quantity: str = DISPLACEMENT, absorber: str = "moving"
) -> RecordMeasurement:
    return RecordMeasurement("sweep", load, response, Sensor(quantity, NOISE), absorber)


def measured(
    restitution: float = 0.55, friction: float = 0.1, gap: float = 1e-3
) -> RecordMeasurement:
    """A simulated measurement of the displacement."""
    load = swept_load()
    blank = record_of(np.sin(load.times), load)
    part = MeasurementSimulator(blank, modal_model(BEAM), 1)
    scene = beam_scene(BEAM, impact_absorber(gap, restitution, friction))
    (lane,) = part.lanes([part.scene_of(scene)], 7)
    return replace(blank, response=part.recorder(lane))


SCENE = beam_scene(BEAM, impact_absorber(1e-3, 0.6, 0.1))

# Files of measurements.

TIMES = np.arange(200) / 100


def write_records(folder: Path, **columns: Array) -> None:
    header = "time (s),force (N),response"
    values = columns or {"force": np.sin(TIMES), "response": np.cos(TIMES)}
    rows = zip(TIMES, *values.values(), strict=False)
    lines = [",".join(f"{value:.9g}" for value in row) for row in rows]
    (folder / "run.csv").write_text("\n".join([header, *lines]) + "\n")


RUN = """
[[measurement]]
load = { file = "run.csv", channel = "force" }
response = { file = "run.csv", channel = "response", quantity = "acceleration", unit = "g", noise = 0.1 }
"""


def test_a_file_names_records_with_units_place_and_noise(tmp_path: Path) -> None:
    write_records(tmp_path)
    (tmp_path / "m.toml").write_text(RUN)
    (one,) = read_measurements(tmp_path / "m.toml")
    assert isinstance(one, RecordMeasurement)
    assert (one.sensor.quantity, one.sensor.noise, one.absorber) == (ACCELERATION, 0.1, "moving")
    assert np.allclose(one.response, 9.80665 * np.cos(TIMES), atol=1e-7)
    assert np.allclose(one.load.values, np.sin(TIMES), atol=1e-8)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            'quantity = "acceleration"',
            'quantity = "jerk"',
            "quantity = 'jerk' is not allowed: one of",
        ),
        ('unit = "g"', 'unit = "mm"', "unit = 'mm' is not allowed: a unit of acceleration"),
        ("noise = 0.1", "noise = -1", "noise = -1"),
        ("noise = 0.1", "noise = 10", "noise = 10.0 is not allowed: less than the response's"),
        ("noise = 0.1", "direction = 2", "direction = 2"),
        ("noise = 0.1", "place = 2.0", "place = 2"),
        ("noise = 0.1", "noises = 2.0", "only the keys"),
        ('load = { file = "run.csv", channel = "force" }', "", "the key load must be given"),
        ('file = "run.csv", channel = "force"', 'file = "no.csv"', "no.csv"),
        ("[[measurement]]", '[[measurement]]\nkind = "photo"', "kind = 'photo'"),
        ("[[measurement]]", '[[measurement]]\nabsorber = "gone"', "absorber = 'gone'"),
    ],
)
def test_what_a_file_has_wrong_is_one_message(
    old: str, new: str, words: str, tmp_path: Path
) -> None:
    write_records(tmp_path)
    (tmp_path / "m.toml").write_text(RUN.replace(old, new))
    with pytest.raises(ParameterError) as error:
        read_measurements(tmp_path / "m.toml")
    assert words in str(error.value)


@pytest.mark.parametrize(("step", "count", "words"), [(0.01, 150, "samples"), (0.02, 200, "rate")])
def test_records_of_another_length_or_clock_are_refused(
    step: float, count: int, words: str, tmp_path: Path
) -> None:
    write_records(tmp_path)
    rows = "\n".join(f"{k * step:.4f},{np.cos(k):.6f}" for k in range(count))
    (tmp_path / "other.csv").write_text("time (s),response\n" + rows + "\n")
    text = RUN.replace('file = "run.csv", channel = "response"', 'file = "other.csv"')
    (tmp_path / "m.toml").write_text(text)
    with pytest.raises(ParameterError, match=f"response: .*{words}"):
        read_measurements(tmp_path / "m.toml")


def test_levels_and_decays_are_measurements(tmp_path: Path) -> None:
    write_records(tmp_path)
    (tmp_path / "m.toml").write_text(
        '[[measurement]]\nkind = "levels"\nforces_n = [1.0, 2.0]\nlevels_m = [[1e-3, 1.1e-3], '
        "[2e-3, 2.2e-3]]\n"
        "from_hz = 36.0\nto_hz = 43.0\nduration_s = 10.0\n"
        '[[measurement]]\nkind = "decay"\n'
        'response = { file = "run.csv", channel = "response", quantity = "velocity", unit = '
        '"mm/s" }\n'
    )
    levels, decay = read_measurements(tmp_path / "m.toml")
    assert isinstance(levels, LevelMeasurement)
    assert levels.levels.shape == (2, 2)
    assert isinstance(decay, DecayMeasurement)
    assert (decay.absorber, decay.sensor.quantity) == ("removed", VELOCITY)
    assert np.allclose(decay.response, 1e-3 * np.cos(TIMES), atol=1e-10)


@pytest.mark.parametrize(
    ("text", "dimension", "factor"),
    [
        ("mm", "length", 1e-3),
        ("in", "length", 0.0254),
        ("mm/s", "velocity", 1e-3),
        ("km/h", "velocity", 1 / 3.6),
    ],
)
def test_units_of_motion_have_factors(text: str, dimension: str, factor: float) -> None:
    unit = find_unit(text)
    assert unit is not None
    assert (unit.dimension, unit.factor) == (dimension, pytest.approx(factor))


# Statistics and simulated sensors.


def test_statistics_of_a_sine_are_those_of_its_amplitude() -> None:
    load = swept_load()
    omega = modal_model(BEAM).omega
    amplitudes = 1e-3, 2e-5
    response = sum(a * np.sin(own * load.times) for a, own in zip(amplitudes, omega, strict=True))
    summary = plan_record_summary(record_of(np.asarray(response), load), modal_model(BEAM), 1)
    values = np.exp(summary.compute(np.asarray(response)))
    groups: dict[str, list[float]] = {}
    for one, value in zip(summary.statistics, values, strict=True):
        groups.setdefault(one.group, []).append(float(value))
    # bins at both ends see where the filter cuts the record off
    assert np.allclose(groups["resonant RMS"][1:-1], amplitudes[0] / np.sqrt(2), rtol=0.02)
    assert np.allclose(
        groups["RMS above the resonance"][1:-1], amplitudes[1] / np.sqrt(2), rtol=0.2
    )
    assert np.allclose(
        groups["RMS in the band of a mode"], np.array(amplitudes) / np.sqrt(2), rtol=0.1
    )


@pytest.mark.parametrize("quantity", [DISPLACEMENT, VELOCITY, ACCELERATION])
def test_a_sensor_measures_derivatives_of_the_harmonic_motion(quantity: str) -> None:
    """Free vibration of one mode: each sensor has the closed form on the record's clock."""
    beam = Beam(modes=1, damping_ratio=0.0)
    model = modal_model(beam)
    times = np.arange(400) / RATE
    load = Samples(times, np.zeros(len(times)) + 1e-12)
    measurement = record_of(np.sin(times), load, quantity)
    loads, samples = loads_on_clock(measurement, float(model.omega[0]))
    start = InitialState(modal_displacement=[1e-3])
    record = Record(level=False, series=True, samples_per_period=samples)
    response = simulate(Scene(model), loads, initial=start, record=record)
    omega = float(model.omega[0])
    size = 1e-3 * float(model.tip_shape[0])
    motions = {
        DISPLACEMENT: size * np.cos(omega * times),
        VELOCITY: -size * omega * np.sin(omega * times),
        # the mean over a sampling interval, centred
        ACCELERATION: -size
        * omega**2
        * np.cos(omega * times)
        * np.sinc(omega / (2 * np.pi * RATE)),
    }
    result = read_sensor(response, measurement)
    assert np.allclose(result[1:-1], motions[quantity][1:-1], atol=1e-7 * np.max(np.abs(result)))


def test_a_base_in_space_adds_its_acceleration() -> None:
    load = replace(swept_load(), quantity="base_acceleration")
    model = modal_model(BEAM)
    results = []
    for relative in (True, False):
        sensor = Sensor(ACCELERATION, relative=relative)
        measurement = RecordMeasurement("base", load, np.sin(load.times), sensor)
        loads, samples = loads_on_clock(measurement, float(model.omega[0]))
        record = Record(level=False, series=True, samples_per_period=samples)
        response = simulate(Scene(model), loads, record=record)
        results.append(read_sensor(response, measurement))
    assert np.allclose(results[1] - results[0], load.values)


# The linear part.


def linear_response(omega: float, damping: float, load: Samples, shape: float) -> Array:
    """Return the displacement of one mode under a load.

    It is scipy's exact solution for straight lines between samples.
    """
    system = scipy.signal.lti(
        [[0, 1], [-(omega**2), -2 * damping * omega]], [[0], [shape]], [[shape, 0]], [[0]]
    )
    return np.asarray(scipy.signal.lsim(system, load.values, load.times)[1])


def test_frequency_and_damping_are_recovered_from_a_sweep_without_absorber() -> None:
    beam = Beam(modes=1)
    model = modal_model(beam)
    omega = 1.03 * float(model.omega[0])
    load = swept_load(0.5)
    shape = float(np.sqrt(model.force_shape[0] * model.tip_shape[0]))
    noise = 1e-5 * np.random.default_rng(0).standard_normal(len(load.values))
    response = 1.3 * linear_response(omega, 0.013, load, shape) + noise
    fit = fit_linear(
        beam, Scene(model, SCENE.absorber), [record_of(response, load, absorber="removed")], 1
    )
    assert fit is not None
    assert fit.hertz[0] == pytest.approx(omega / (2 * np.pi), rel=1e-4)
    assert fit.damping[0] == pytest.approx(0.013, rel=0.01)
    assert fit.gain == pytest.approx(1.3, rel=0.01)
    (warning,) = fit.warnings
    assert f"the measured response is {fit.gain:.3g} times" in warning
    applied = fit.apply(SCENE, 1).model
    assert applied.damping_ratio[0] == fit.damping[0]
    assert applied.omega[1] / SCENE.model.omega[1] == pytest.approx(1.03, rel=1e-4)


def test_frequency_and_damping_are_recovered_from_a_decay() -> None:
    times = np.arange(3000) / RATE
    response = np.exp(-0.012 * 2 * np.pi * 40.5 * times) * np.cos(2 * np.pi * 40.5 * times + 0.3)
    response += 0.02 * np.random.default_rng(1).standard_normal(len(times))
    decay = DecayMeasurement("decay", response, RATE, Sensor(DISPLACEMENT))
    fit = fit_linear(BEAM, SCENE, [decay], 1)
    assert fit is not None
    ratio = np.sqrt(1 - 0.012**2)
    assert fit.hertz[0] == pytest.approx(40.5 / ratio, abs=4 * fit.hertz_error[0])
    assert fit.damping[0] == pytest.approx(0.012, abs=4 * fit.damping_error[0])
    assert fit.damping_error[0] < 5e-4


# What is refused before the run.


def test_exchanged_records_units_and_nodes_are_refused() -> None:
    load = swept_load()
    good = measured()
    require_plausible([good], BEAM, 1)
    in_milliseconds = Samples(load.times / 1000, load.values)
    exchanged = replace(good, load=Samples(load.times, good.response), response=load.values)
    free = linear_response(float(modal_model(BEAM).omega[0]), 0.01, load, 1.3)
    for bad, words in (
        (replace(good, load=Samples(load.times, free), response=load.values), "exchanged"),
        (exchanged, "exchanged"),
        (replace(good, response=1e3 * good.response), "times that of the structure"),
        (replace(good, response=1e-3 * good.response), "times that of the structure"),
        (replace(good, sensor=replace(good.sensor, place=0.01)), "node"),
        (replace(good, load=in_milliseconds), "a load that excites resonance 1"),
    ):
        with pytest.raises(ParameterError, match=words):
            require_plausible([bad], BEAM, 1)
    force = np.array([1.0])
    level = np.array([[1e-6]])
    sensor = Sensor(DISPLACEMENT)
    for sweep, words in (
        ((36.0, 43.0, 10.0), "times that of the structure"),
        ((3.0, 4.0, 10.0), "a load that excites resonance 1"),
        ((43.0, 36.0, 0.1), "10 periods of resonance 1"),
    ):
        with pytest.raises(ParameterError, match=words):
            require_plausible([LevelMeasurement("levels", force, level, *sweep, sensor)], BEAM, 1)


def test_a_gap_in_another_unit_is_refused() -> None:
    """Bounds from the linear steady state: the largest motion of one mode is force times shapes over 2 D omega^2, at most."""
    model = modal_model(Beam(modes=1))
    scene = Scene(model, SCENE.absorber)
    steady = 3.5 * float(model.force_shape[0] * model.tip_shape[0])
    steady /= 2 * float(model.damping_ratio[0]) * float(model.omega[0]) ** 2
    for factor in (0.01, 1.0, 8.0):
        require_reachable_gap([measured()], scene, factor * steady, 1)
    for factor in (1e-3, 21.0):
        with pytest.raises(ParameterError, match=r"gap = .* the structure without absorber moves"):
            require_reachable_gap([measured()], scene, factor * steady, 1)


def test_a_sensor_the_other_way_round_is_a_warning() -> None:
    beam = Beam(modes=1)
    load = swept_load(0.5)
    model = modal_model(beam)
    shape = float(np.sqrt(model.force_shape[0] * model.tip_shape[0]))
    response = -linear_response(float(model.omega[0]), 0.01, load, shape)
    removed = record_of(response, load, absorber="removed")
    fit = fit_linear(beam, Scene(model, SCENE.absorber), [removed], 1)
    assert fit is not None
    assert fit.gain == pytest.approx(-1.0, rel=0.01)
    (warning,) = fit.warnings
    assert "direction = -1" in warning


# Priors.


def test_priors_are_read_and_refused() -> None:
    priors = read_priors({"gap_m": ("1e-3", "2e-3", "log"), "restitution": None}, SCENE, 1)
    assert [one.name for one in priors] == ["gap", "restitution"]
    assert priors[0].at(np.array([0.5]))[0] == pytest.approx(np.sqrt(2) * 1e-3)
    normal = Prior("gap", 1e-3, 1e-4, "normal").at(np.linspace(0.001, 0.999, 999))
    assert np.mean(normal) == pytest.approx(1e-3)
    assert np.std(normal) == pytest.approx(1e-4, rel=0.02)
    for free, words in (
        ({"gap": (2e-3, 1e-3)}, "the lower one first"),
        ({"gap": (1e-3,)}, "two numbers"),
        ({"gap": ("a", "b")}, "two numbers"),
        ({"restitution": (0.5, 1.5)}, "at most 1"),
        ({"height": None}, "free = 'height'"),
        ({"gap": None, "gap_m": None}, "each parameter once"),
        ({"friction_stiffness": None}, "without a range"),
        ({}, "one parameter or more"),
    ):
        with pytest.raises(ParameterError, match=words):
            read_priors(free, SCENE, 1)


def test_a_scene_takes_the_values_of_free_parameters() -> None:
    chosen = {
        "restitution": 0.4,
        "gap": 2e-3,
        "friction_limit": 0.2,
        "frequency": 41.0,
        "damping": 0.02,
    }
    scene = scene_with(SCENE, chosen, 1)
    walls = scene.absorber.walls  # type: ignore[union-attr]
    assert (walls.gap, walls.restitution) == (2e-3, 0.4)  # type: ignore[union-attr]
    assert scene.absorber.friction.limit == 0.2  # type: ignore[union-attr]
    assert scene.model.omega[0] == pytest.approx(2 * np.pi * 41.0)
    assert scene.model.omega[1] / scene.model.omega[0] == pytest.approx(
        SCENE.model.omega[1] / SCENE.model.omega[0]
    )
    assert np.allclose(scene.model.damping_ratio, 0.02)


def test_scenes_of_one_structure_have_one_model() -> None:
    """Scenes of one structure share one model, unless frequency or damping is free.

    Linear regimes are thus computed once for all simulations.
    """
    load = swept_load()
    part = MeasurementSimulator(record_of(np.sin(load.times), load), modal_model(BEAM), 1)
    first, other = (
        part.scene_of(scene_with(SCENE, {"gap": gap, "restitution": 0.5}, 1)).model
        for gap in (1e-3, 2e-3)
    )
    assert first is other
    softer = part.scene_of(scene_with(SCENE, {"frequency": 40.0}, 1)).model
    assert softer.omega[0] == pytest.approx(2 * np.pi * 40.0)
    assert part.scene_of(SCENE).model.omega[0] == SCENE.model.omega[0]


# Inference against closed forms.


class LinearSimulator:
    """Statistics that are linear in the parameters, with normal noise: the posterior is known."""

    def __init__(self, design: Array, deviation: Array, truth: Array) -> None:
        self.design = design
        self.deviation = deviation
        generator = np.random.default_rng(3)
        self.observed = design @ truth + deviation * generator.standard_normal(len(design))

    def simulate(
        self,
        names: Sequence[str],  # noqa: ARG002 - as of every simulator
        values: Array,
        seed: int,
        progress: Any = None,  # noqa: ARG002
    ) -> Array:
        noise = np.random.default_rng(seed).standard_normal((len(values), len(self.design)))
        return values @ self.design.T + self.deviation * noise


def test_the_posterior_of_a_linear_model_is_the_closed_form() -> None:
    """Flat prior, normal noise: least squares gives mean and covariance."""
    generator = np.random.default_rng(0)
    design = generator.standard_normal((8, 2))
    design[:, 1] += 1.5 * design[:, 0]  # correlated parameters
    deviation = np.full(8, 0.1)
    simulator = LinearSimulator(design, deviation, np.array([0.45, 0.55]))
    priors = (Prior("restitution", 0.0, 1.0), Prior("damping", 0.0, 1.0))
    inference = infer(simulator, priors, seed=1, round_runs=400, rounds=4)
    used = inference.sensitivity.used
    own_design = design[used] / deviation[used, None]
    covariance = np.linalg.inv(own_design.T @ own_design)
    mean = covariance @ own_design.T @ (simulator.observed / deviation)[used]
    own = np.cov(inference.values.T)
    scatter = np.sqrt(np.diag(covariance))
    assert np.all(np.abs(np.mean(inference.values, axis=0) - mean) < 0.25 * scatter)
    assert np.allclose(np.sqrt(np.diag(own)), scatter, rtol=0.12)
    assert own[0, 1] / np.sqrt(own[0, 0] * own[1, 1]) == pytest.approx(
        covariance[0, 1] / np.prod(scatter), abs=0.1
    )


def test_a_statistic_that_says_nothing_is_not_used() -> None:
    generator = np.random.default_rng(0)
    shares = generator.random((256, 2))
    noise = generator.standard_normal((256, 3))
    statistics = np.stack(
        [3 * shares[:, 0] + 0.1 * noise[:, 0], noise[:, 1], shares[:, 1] ** 2 + 0.1 * noise[:, 2]],
        axis=1,
    )
    sensitivity = measure_sensitivity(Ensemble(shares, statistics))
    assert sensitivity.used.tolist() == [True, False, True]
    assert sensitivity.shifts[0, 0] == pytest.approx(0.9 * 3 / 0.1, rel=0.2)
    assert abs(sensitivity.shifts[0, 1]) < 2


def test_more_parameters_than_statistics_are_refused() -> None:
    simulator = LinearSimulator(np.ones((1, 2)), np.ones(1), np.ones(2))
    with pytest.raises(ParameterError, match="2 or more, as many as there are free parameters"):
        infer(simulator, (Prior("restitution", 0.0, 1.0), Prior("damping", 0.0, 1.0)))


def test_predictions_without_a_simulation_are_those_of_a_fit_without_it() -> None:
    """Predictions without a simulation are those of a fit without it.

    The shortcut for leaving one simulation out is compared with fits that leave it out. These use
    ridge regression by the normal equations.
    """
    generator = np.random.default_rng(2)
    shares = generator.random((40, 1))
    statistics = shares + 0.3 * generator.standard_normal((40, 3))
    statistic, predicted = fit_regression_statistics(shares, statistics)
    x = (statistics - statistic.mean) / statistic.scale
    residual = shares[:, 0] - statistic.compute(statistics)[:, 0]
    penalty = float(
        (
            x.T
            @ residual
            / np.where(np.abs(statistic.weights[:, 0]) > 0, statistic.weights[:, 0], 1)
        )[0]
    )
    for k in (0, 17):
        others = np.arange(40) != k
        design = np.column_stack([np.ones(39), x[others]])
        weight = np.diag([0.0, penalty, penalty, penalty])
        solved = np.linalg.solve(design.T @ design + weight, design.T @ shares[others, 0])
        assert predicted[k, 0] == pytest.approx(np.append(1.0, x[k]) @ solved, abs=2e-3)


def test_draws_have_the_density_and_terms_are_all_products() -> None:
    covariance = np.array([[0.02, 0.012], [0.012, 0.01]])
    inverse = np.linalg.inv(covariance)

    def log_density(points: Array) -> Array:
        return np.asarray(-0.5 * np.einsum("np,pq,nq->n", points - 0.5, inverse, points - 0.5))

    generator = np.random.default_rng(0)
    draws = sample_density(log_density, generator.random((300, 2)), 20_000, generator)
    assert np.allclose(np.mean(draws, axis=0), 0.5, atol=0.02)
    assert np.allclose(np.cov(draws.T), covariance, rtol=0.15)
    terms = polynomial_terms(np.array([[0.75, 1.0]]), 2)  # coordinates 0.5 and 1
    assert terms[0].tolist() == [1.0, 0.5, 1.0, 0.25, 0.5, 1.0]


# The predictive check.

NAMES = tuple(Statistic("m", "g", float(k), "Hz", "m") for k in range(12))


def test_the_check_refuses_a_wrong_model_and_few_right_ones() -> None:
    generator = np.random.default_rng(0)
    factor = np.linalg.cholesky(0.5 + 0.5 * np.eye(12))

    def draw(count: int) -> Array:
        return np.asarray(0.1 * generator.standard_normal((count, 12)) @ factor.T)

    right = [compare_statistics(NAMES, draw(160), draw(1)[0]).explains for _ in range(400)]
    assert 0.92 <= np.mean(right) <= 0.98  # of 95 %
    shifted = draw(1)[0]
    shifted[3] += 0.6
    check = compare_statistics(NAMES, draw(160), shifted)
    assert not check.explains
    assert check.failing[0] == 3
    # deviations that are small one by one, but of opposite signs where the model has one
    twisted = 0.22 * np.array([1.0, -1.0] * 6)
    assert not compare_statistics(NAMES, draw(160), twisted).explains


def test_what_fitted_parameters_absorb_is_no_deviation() -> None:
    """Deviations that fitted parameters can explain do not count.

    Statistics are linear and parameters are fitted by least squares. The remaining deviation is
    judged equally, wherever the parameters of the simulations are.

    Without the fit the scatter of the parameters would be that of the statistics: no model would be
    refused.
    """
    generator = np.random.default_rng(0)
    design = generator.standard_normal((12, 2))
    solve = np.linalg.pinv(design)
    beyond = np.linalg.svd(design)[0][:, -1]  # at right angles to what the parameters do

    def measure_and_fit(count: int, spread: float) -> tuple[Array, Array]:
        values = spread * generator.standard_normal((count, 2))
        statistics = values @ design.T + 0.1 * generator.standard_normal((count, 12))
        return statistics, statistics @ solve.T

    def explains(shift: float, fitted: bool) -> bool:
        simulated, estimates = measure_and_fit(160, 0.5)
        observed = measure_and_fit(1, 0.01)[0][0] + shift * beyond
        both = (estimates, solve @ observed) if fitted else None
        return compare_statistics(NAMES, simulated, observed, both).explains

    assert 0.9 <= np.mean([explains(0.0, True) for _ in range(300)]) <= 0.99
    assert np.mean([explains(0.8, True) for _ in range(50)]) < 0.05
    assert np.mean([explains(0.0, False) for _ in range(50)]) > 0.99


def test_measurements_that_give_other_parameters_contradict_one_another() -> None:
    generator = np.random.default_rng(1)
    names = tuple(replace(one, measurement="ab"[k // 6]) for k, one in enumerate(NAMES))
    design = np.abs(generator.standard_normal((12, 1))) + 0.5
    used = np.ones(12, dtype=bool)
    centre = np.array([0.5])

    def measure_at(shares: Array) -> Array:
        return np.asarray(shares @ design.T + 0.1 * generator.standard_normal((len(shares), 12)))

    shares = generator.random((200, 1))
    simulated = measure_at(shares)
    alike = []
    for _ in range(100):
        _, apart = estimate_by_measurement(
            names, used, shares, simulated, measure_at(centre[None])[0], centre
        )
        assert apart is not None
        alike.append(np.mean(apart >= apart[-1]) >= 0.05)
    assert np.mean(alike) > 0.87
    observed = np.where(np.arange(12) < 6, 0.35, 0.65) * design[:, 0]
    estimates, apart = estimate_by_measurement(names, used, shares, simulated, observed, centre)
    assert apart is not None
    assert np.mean(apart >= apart[-1]) < 0.02
    # the prior, which counts as one more measurement, draws the estimates to the middle by some
    # percent
    assert [one.shares[0] for one in estimates] == pytest.approx([0.35, 0.65], abs=0.03)


def test_a_fit_to_the_same_data_has_a_log_score_that_is_half_the_parameters_too_high() -> None:
    """Linear normal statistics with a flat prior: in the mean the score is that of new data, the log score is not."""
    generator = np.random.default_rng(4)
    design = np.linalg.qr(generator.standard_normal((12, 4)))[0]
    gains = []
    for _ in range(300):
        data, fresh = generator.standard_normal((2, 12))
        fitted = design @ (design.T @ data)
        drawn = fitted + generator.standard_normal((600, 4)) @ design.T
        drawn += generator.standard_normal((600, 12))
        gains.append(log_density(drawn, data) - log_density(drawn, fresh))
    assert np.mean(gains) == pytest.approx(4 / 2, abs=0.5)
    check = compare_statistics(NAMES, drawn, data, (drawn @ design, design.T @ data))
    assert check.score == check.log_score - 4 / 2


# The plan.


def test_the_next_sweep_is_the_one_that_adds_most_to_those_before_it() -> None:
    """Normal parameters measured with normal errors: deviation after a sweep with error s is s / sqrt(1 + s^2)."""
    generator = np.random.default_rng(5)
    parameters = generator.standard_normal((2000, 2))

    def sweep(which: int, error: float) -> Array:
        return parameters[:, [which]] + error * generator.standard_normal((2000, 1))

    sweeps = [sweep(0, 0.2), sweep(1, 0.3), sweep(0, 0.1)]
    order, together = order_sweeps(parameters, sweeps, 2)
    assert order.tolist() == [2, 1]
    first, second = (error / np.sqrt(1 + error**2) for error in (0.1, 0.3))
    assert together[0] == pytest.approx([first, 1.0], rel=0.06)
    assert together[1] == pytest.approx([first, second], rel=0.06)


# The whole.

RUNS = CalibrationRuns(64, 48, 2, 40)


def test_a_whole_answer_holds_the_truth_and_goes_on_from_a_checkpoint(tmp_path: Path) -> None:
    measurement = measured()
    free = {"restitution": (0.3, 0.9), "gap": (0.6e-3, 1.5e-3)}
    absorber = impact_absorber(1e-3, 0.6, 0.1)
    first = Checkpoint(tmp_path / "a.db")
    answer = calibrate(
        [measurement], BEAM, absorber, free, runs=RUNS, alternatives="never", checkpoint=first
    )
    first.close()
    posterior = answer.posterior
    low, _, high = np.quantile(posterior.draws, [0.005, 0.5, 0.995], axis=0)
    assert low[0] < 0.55 < high[0]
    assert low[1] < 1e-3 < high[1]
    assert np.std(posterior.column("gap")) < 0.6 * 0.9e-3 / np.sqrt(12)
    assert answer.model.check.explains

    again = Checkpoint(tmp_path / "a.db")
    before = len(again.known)
    other = calibrate(
        [measurement], BEAM, absorber, free, runs=RUNS, alternatives="never", checkpoint=again
    )
    assert len(again.known) == before == 3
    again.close()
    assert np.array_equal(other.posterior.draws, posterior.draws)

    files = {path.name for path in answer.save(tmp_path / "out")}
    assert {"posterior.json", "summary.json", "card.html", "statistics.csv"} <= files
    read = read_posterior(tmp_path / "out" / "posterior.json")
    assert np.allclose(read.draws, posterior.draws, rtol=1e-6)
    assert "Posterior of" in str(answer)
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["runs"] == 160


def test_a_wrong_model_is_refused_and_the_right_one_is_named(tmp_path: Path) -> None:
    """The device has friction, the model none."""
    free = {"restitution": (0.3, 0.9), "gap": (0.6e-3, 1.5e-3)}
    answer = calibrate([measured(friction=0.2)], BEAM, impact_absorber(1e-3, 0.6), free, runs=RUNS)
    assert not answer.model.check.explains
    summary = answer.to_json()
    assert summary["best_model"] == "friction"
    scores = {name: one.get("score") for name, one in summary["models"].items()}
    assert set(scores) == {
        "model",
        "compliant walls",
        "restitution falls with speed",
        "friction",
        "unequal gaps",
    }
    assert scores["friction"] > scores["model"] + 3
    assert summary["models"]["friction"]["free_parameters"] == 3
    line = f"Best score: friction, {scores['friction'] - scores['model']:.1f} above the model"
    answer.save(tmp_path)
    assert line in str(answer)
    assert "unequal gaps" in str(answer)
    assert line in (tmp_path / "card.html").read_text()


def test_levels_over_force_are_simulated_with_their_repeats() -> None:
    levels = LevelMeasurement(
        "levels",
        np.array([2.0, 4.0]),
        np.array([[1e-3, 1.2e-3], [2e-3, 2e-3]]),
        37.0,
        42.5,
        3.0,
        Sensor(DISPLACEMENT),
    )
    simulator = Simulator(BEAM, SCENE, [levels], 1, threads=1)
    assert simulator.observed[0] == pytest.approx(np.log(np.sqrt(1e-3 * 1.2e-3)))
    statistics = simulator.simulate(["restitution"], np.array([[0.5], [0.7]]), 1)
    assert statistics.shape == (2, 2)
    assert np.all(np.diff(statistics, axis=1) > 0)


def test_alternatives_are_other_models_of_the_walls_and_friction() -> None:
    priors = read_priors(["restitution", "friction_limit"], SCENE, 1)
    models = list_alternatives(SCENE, priors, 1)
    assert {name: [one.name for one in own] for name, (_, own) in models.items()} == {
        "compliant walls": ["restitution", "friction_limit", "contact_stiffness"],
        "restitution falls with speed": ["restitution", "friction_limit", "yield_velocity"],
        "no friction": ["restitution"],
    }
    frictionless = beam_scene(BEAM, impact_absorber(1e-3, 0.6))
    own = list_alternatives(frictionless, priors[:1], 1)
    assert [one.name for one in own["friction"][1]] == ["restitution", "friction_limit"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"format": "other"}, "a posterior.json that calibrate has written"),
        ({"version": 2}, "version = 2"),
        ({"draws": [[1.0]]}, "draws"),
        ({"parameters": {"height": {}}}, "parameters = 'height'"),
    ],
)
def test_another_file_is_no_posterior(change: dict[str, Any], words: str, tmp_path: Path) -> None:
    draws = np.random.default_rng(0).random((60, 1))
    plain = Posterior(("restitution",), draws, True).to_plain()
    write_json(tmp_path / "p.json", plain | change)
    with pytest.raises(ParameterError) as error:
        read_posterior(tmp_path / "p.json")
    assert words in str(error.value)


def test_the_command_writes_a_posterior_and_refuses_before_it_runs(tmp_path: Path) -> None:
    measurement = measured()
    rows = zip(measurement.load.times, measurement.load.values, measurement.response, strict=True)
    text = "\n".join(f"{t:.6g},{f:.6g},{y:.6g}" for t, f, y in rows)
    (tmp_path / "run.csv").write_text("time (s),force (N),tip (m)\n" + text + "\n")
    (tmp_path / "m.toml").write_text(
        '[measurement]\nload = { file = "run.csv", channel = "force" }\n'
        'response = { file = "run.csv", channel = "tip", quantity = "displacement", noise = '
        "1e-5 }\n"
    )
    (tmp_path / "beam.toml").write_text(
        "[beam]\nlength_m = 0.5\nbending_stiffness_n_m2 = 362.88\nmass_per_length_kg_m = "
        "1.1275\nmodes = 2\n"
    )
    start = [tmp_path / "m.toml", "--structure", tmp_path / "beam.toml", "--out", tmp_path / "out"]
    free = ["--free", "restitution", 0.3, 0.9, "--friction-limit", 0.1]
    done(command, *start, *free, "--quick", "--threads", 1, "--alternatives", "never")
    assert read_posterior(tmp_path / "out" / "posterior.json").names == ("restitution",)
    for words, message in (
        (["--free", "restitution", 0.9, 0.3], "the lower one first"),
        (["--free", "height"], "free = 'height'"),
        ([*free, "--free", "restitution"], "--free restitution is given twice"),
        ([*free, "--plan", "a"], "--plan = 'a'"),
        ([*free, "--plan", "0,1"], "plan = 0.0 is not allowed"),
        ([*free, "--resonance", 9], "resonance = 9"),
    ):
        result = call(command, *start, *words)
        assert result.exit_code == 2, result.output
        assert message in result.output


def test_words_of_a_prior_are_joined() -> None:
    words = [
        "m.toml",
        "--free",
        "gap",
        "1e-3",
        "2e-3",
        "log",
        "--free",
        "restitution",
        "--seed",
        "1",
    ]
    assert join_words(words, {"--free": command.count_prior_words}) == [
        "m.toml", "--free", "gap 1e-3 2e-3 log", "--free", "restitution", "--seed", "1",
    ]  # fmt: skip
