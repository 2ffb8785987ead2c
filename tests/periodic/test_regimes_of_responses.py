"""Kinds of response, stays in the impact regime, and the jump are identified correctly.

They are tested with constructed motions, known samples, runs of the beam, and runs of a strip.
"""

from collections.abc import Callable

import numpy as np
import pytest
import scipy.stats

from impact_env import Beam, InitialState, beam_scene, impact_absorber
from impact_env.drive import Drive, constant_frequency
from impact_env.ensemble import draw_members
from impact_env.periodic.case import case_of
from impact_env.periodic.passage import RECORD
from impact_env.periodic.residence import (
    Approach,
    ExitRate,
    Jumps,
    Range,
    ResidenceTimes,
    exit_rate,
    hazard,
    hold,
    jumps,
    passage_schedule,
    read_duration,
    residence_times,
)
from impact_env.periodic.shooting import Exponent, exponent_of, largest_exponent
from impact_env.periodic.stationary import (
    Criteria,
    ResponseKind,
    StationaryWindow,
    classify,
    classify_members,
    envelope,
)
from impact_env.periodic.survey import closed_form_orbits
from impact_env.scene import Scene
from impact_env.sweep import simulate

PERIODS = 60


def window(multiple: int | None, impacts: np.ndarray, wobble: float = 0.0) -> StationaryWindow:
    """Return a window whose states come again after ``multiple`` periods, or never."""
    n = np.arange(PERIODS + 1)
    angle = 2 * np.pi * n / multiple if multiple else n * np.sqrt(5.0)
    states = np.column_stack([np.cos(angle), np.sin(angle), np.full(len(n), 0.3)]) * 1e-3
    return StationaryWindow(states, impacts, 1e-3 * (1 + wobble * np.sin(0.37 * n[:-1])))


TWO_A_PERIOD = np.arange(0.25, PERIODS, 0.5)
WITH_PAUSES = TWO_A_PERIOD[TWO_A_PERIOD % 10 < 6]


@pytest.mark.parametrize(
    ("stationary", "kind", "multiple"),
    [
        (window(1, np.zeros(0)), ResponseKind.LINEAR, 1),
        (window(None, np.zeros(0)), ResponseKind.LINEAR, None),
        (window(1, TWO_A_PERIOD), ResponseKind.PERIODIC, 1),
        (window(3, TWO_A_PERIOD), ResponseKind.PERIODIC, 3),
        (window(3, WITH_PAUSES, 0.8), ResponseKind.PERIODIC, 3),
        (window(None, TWO_A_PERIOD, 0.1), ResponseKind.SUSTAINED, None),
        (window(None, TWO_A_PERIOD, 0.8), ResponseKind.SUSTAINED, None),
        (window(None, WITH_PAUSES, 0.1), ResponseKind.SUSTAINED, None),
        (window(None, WITH_PAUSES, 0.8), ResponseKind.MODULATED, None),
    ],
)
def test_kinds_of_constructed_responses(
    stationary: StationaryWindow, kind: ResponseKind, multiple: int | None
) -> None:
    classified = classify(stationary)
    assert (classified.kind, classified.multiple) == (kind, multiple)
    assert classified.impacts_per_period == len(stationary.impacts) / PERIODS


def test_period_is_identified_within_its_tolerance_and_up_to_the_largest_multiple() -> None:
    exact = window(13, TWO_A_PERIOD)
    assert classify(exact).kind is ResponseKind.SUSTAINED
    assert classify(exact, Criteria(most_multiple=13)).multiple == 13
    noise = np.random.default_rng(0).uniform(-1, 1, exact.states.shape) * 1e-3 * 2e-4
    blurred = StationaryWindow(window(2, TWO_A_PERIOD).states + noise, TWO_A_PERIOD, exact.peaks)
    assert classify(blurred).multiple is None
    assert classify(blurred, Criteria(tolerance=1e-3)).multiple == 2


def members_at(modes: int, ratio: float, force: float, **absorber: float) -> list:
    scene = beam_scene(Beam(modes=modes), impact_absorber(**absorber))
    return classify_members(
        scene, force, Approach(scene.model.resonance_omega(1)), ratio, 500, 150, [0.0, 1.0, 2.5]
    )


def test_runs_of_each_kind() -> None:
    linear = members_at(2, 0.9, 0.5, friction_limit=0.025)
    assert {member.classification.kind for member in linear} == {ResponseKind.LINEAR}
    assert all(member.classification.depth < 1e-9 for member in linear)
    modulated = members_at(1, 1.0, 1.7)  # the paper's strongly modulated response
    assert {member.classification.kind for member in modulated} == {ResponseKind.MODULATED}
    assert all(
        1.7 < member.classification.impacts_per_period < 2.5 and member.energies.absorber_most > 0.9
        for member in modulated
    )
    periodic = members_at(10, 0.9625, 3.5, restitution=0.7, friction_limit=0.1)
    assert all(
        (
            member.classification.kind,
            member.classification.multiple,
            member.classification.impacts_per_period,
        )
        == (ResponseKind.PERIODIC, 1, 2.0)
        for member in periodic
    )
    for member in periodic:
        energies = member.energies
        assert (
            energies.modal + energies.impact + energies.friction + energies.damper
            == pytest.approx(1)
        )
        assert energies.impact > 0.1
        assert energies.friction > 0.1
    chaotic = members_at(10, 1.0, 3.5, restitution=0.7, friction_limit=0.1)
    assert {member.classification.kind for member in chaotic} == {ResponseKind.SUSTAINED}
    assert np.all(np.diff(envelope(chaotic)) > 0)


def test_stay_ends_is_censored_or_never_began() -> None:
    steady = np.arange(0.0, 100.0, 1.0)
    assert read_duration(steady, 20, 100, 10) == (70.0, False, False, 1.0)
    assert read_duration(steady[steady <= 50], 20, 100, 10) == (30.0, True, False, 1.0)
    assert read_duration(steady[steady <= 95], 20, 100, 10) == (70.0, False, False, 1.0)
    assert read_duration(steady[steady <= 19], 20, 100, 10) is None
    assert read_duration(steady[(steady <= 50) | (steady > 80)], 20, 100, 10) == (
        30.0,
        True,
        True,
        1.0,
    )


def sample(rate: float, most: float, n: int) -> ResidenceTimes:
    times = np.random.default_rng(3).exponential(1 / rate, n)
    return ResidenceTimes(np.minimum(times, most), times < most)


def test_rate_of_a_known_sample() -> None:
    observed = sample(2e-3, 400.0, 20000)
    estimate = exit_rate(observed)
    count = int(np.sum(observed.ended))
    assert estimate.rate == count / np.sum(observed.durations)
    # the same interval by chi-square quantiles, and the same estimate by maximising the likelihood
    # of a library's censored fit
    assert estimate.low == pytest.approx(
        scipy.stats.chi2.ppf(0.025, 2 * count) / 2 / estimate.exposure
    )
    assert estimate.high == pytest.approx(
        scipy.stats.chi2.ppf(0.975, 2 * count + 2) / 2 / estimate.exposure
    )
    data = scipy.stats.CensoredData.right_censored(observed.durations, ~observed.ended)
    assert 1 / scipy.stats.expon.fit(data, floc=0)[1] == pytest.approx(estimate.rate, rel=1e-3)
    assert estimate.low < 2e-3 < estimate.high
    assert exit_rate(observed, burn_in=100.0).rate == pytest.approx(2e-3, rel=0.04)


def rate_of(drawn: np.random.Generator) -> ExitRate:
    times = drawn.exponential(500.0, 40)
    return exit_rate(ResidenceTimes(np.minimum(times, 600.0), times < 600.0))


@pytest.mark.parametrize(
    ("measured", "true"),
    [(rate_of, 1 / 500), (lambda drawn: exponent_of(drawn.normal(0.3, 1.0, 400)), 0.3)],
)
def test_intervals_cover_what_is_known_as_often_as_they_say(
    measured: Callable[[np.random.Generator], ExitRate | Exponent], true: float
) -> None:
    drawn = np.random.default_rng(1)
    estimates = [measured(drawn) for _ in range(1000)]
    above = np.mean([one.low >= true for one in estimates])
    below = np.mean([one.high <= true for one in estimates])
    assert 0.93 < 1 - above - below < 0.975
    assert max(above, below) < 0.04  # on neither side alone


def test_rate_without_exits_and_without_time() -> None:
    estimate = exit_rate(ResidenceTimes(np.full(10, 50.0), np.zeros(10, dtype=bool)))
    assert (estimate.exits, estimate.rate, estimate.low) == (0, 0.0, 0.0)
    assert estimate.high == pytest.approx(-np.log(0.025) / 500)
    assert np.isnan(
        exit_rate(ResidenceTimes(np.full(3, 5.0), np.ones(3, dtype=bool)), burn_in=10).rate
    )


def rates_of(exits: list[int]) -> list[ExitRate]:
    return [exit_rate(ResidenceTimes(np.full(1000, 10.0), np.arange(1000) < n)) for n in exits]


def test_integral_of_the_rate() -> None:
    integral = hazard([0.98, 0.97, 0.95], rates_of([0, 40, 0]))
    # a triangle of height 40/10,000 over 3 %
    assert integral.value == pytest.approx(0.5 * 0.004 * 3)
    assert integral.low < integral.value < integral.high
    value, low, high = integral.probability(100.0)
    assert value == pytest.approx(np.exp(-0.6))
    assert low < value < high
    turned = hazard([0.95, 0.97, 0.98], rates_of([0, 40, 0]))
    assert turned.value == pytest.approx(integral.value)


def test_factor_of_a_moving_frequency_is_estimated_from_counts() -> None:
    """The factor of a moving frequency is estimated from counts.

    Runs leave at one rate in time and at another in frequency. Survival is the product of both,
    drawn run by run.
    """
    drawn = np.random.default_rng(5)
    rate = 1 / 700
    moved = 0.05
    predicted = hazard(
        [0.98, 0.97], [ExitRate(4000, 4000 / rate, rate, 0.97 * rate, 1.03 * rate)] * 2
    )
    measured = {}
    for slowness in (20.0, 100.0, 300.0, 900.0):
        at = np.minimum(
            drawn.exponential(1 / (slowness * rate), 5000), drawn.exponential(1 / moved, 5000)
        )  # percent of frequency passed
        measured[slowness] = Jumps(int(np.sum(at > 1)), 5000, 5000)
    fitted = predicted.with_sweeps(measured)
    assert fitted.factor_low < np.exp(-moved) < fitted.factor_high
    assert fitted.factor_high - fitted.factor_low < 0.02
    assert (fitted.value, predicted.factor) == (predicted.value, 1.0)
    for slowness, jumped in measured.items():
        value, low, high = fitted.probability(slowness)
        assert value == pytest.approx(fitted.factor * predicted.probability(slowness)[0])
        assert low < jumped.share + 3 * np.sqrt(jumped.share / 5000)
        assert high > jumped.share - 3 * np.sqrt(jumped.share / 5000)


def test_sweeps_up_keep_what_sweeps_down_lose() -> None:
    """Fewer runs leave the impact regime in sweeps up than in sweeps down.

    The change of the frequency carries runs over the border of the regime, or away from it. Both
    sweeps pass the same range.
    """
    scene, approach = paper()
    phases = draw_members(1200, 3, "phase").phases.tolist()
    down, up = (
        jumps(scene, 1.5, approach, Range(*ratios), 100.0, phases)
        for ratios in ((0.974, 0.972, 0.958, 0.946), (0.956, 0.958, 0.972, 0.984))
    )
    assert len(down.left) > len(up.left) + 3 * np.sqrt(
        len(up.left)
    )  # of 1,200: 68 to 90 and 31 to 44
    assert all(0.958 <= ratio < 0.972 for ratio in (*down.left, *up.left))


def paper() -> tuple:
    scene = beam_scene(Beam(modes=2), impact_absorber(friction_limit=0.025))
    return scene, Approach(scene.model.resonance_omega(1), 1.0)


def test_jump_is_predicted_without_a_fit() -> None:
    scene, approach = paper()
    phases = np.linspace(0, 2 * np.pi, 60, endpoint=False).tolist()
    ratios = np.linspace(0.984, 0.956, 8).tolist()
    rates = [
        exit_rate(residence_times(scene, 1.5, approach, ratio, 2000, phases), 100)
        for ratio in ratios
    ]
    predicted = hazard(ratios, rates)
    assert 600 < 1 / predicted.value < 2000  # 967 to 1,207 over six sets of phases
    for slowness in (100.0, 1450.0):
        observed = jumps(
            scene,
            1.5,
            approach,
            Range(1.0, 0.984, 0.956, 0.92),
            slowness,
            phases,
            high_level=0.75e-3,
        )
        low, high = observed.interval(1 - 1e-7)
        assert low < predicted.probability(slowness)[0] < high
        assert observed.high is not None
        assert abs(observed.high - observed.jumped) <= 4
    assert observed.share < 0.5


def test_approach_and_passage_go_where_they_should() -> None:
    approach = Approach(2 * np.pi, 1.0, 200.0, 50.0)
    drive = passage_schedule(approach, 1.0, 0.99, 0.95, 100.0)
    np.testing.assert_allclose(drive.schedule.times, [0, 200, 250, 300, 700])
    np.testing.assert_allclose(drive.schedule.omegas / (2 * np.pi), [1.0, 1.0, 0.99, 0.99, 0.95])
    at_once = hold(Approach(2 * np.pi), 1.0, 0.97, 30.0)
    np.testing.assert_allclose(at_once.schedule.times, [0, 30])
    assert set(at_once.schedule.omegas / (2 * np.pi)) == {0.97}


# The largest Lyapunov exponent: of a stable orbit its multiplier's, of chaos how two runs part, by
# the exact method alone.


def drive(scene: Scene, force: float, ratio: float, periods: float) -> Drive:
    return Drive(force, constant_frequency(scene.model.resonance_omega(1), ratio, periods))


def test_exponent_of_a_stable_orbit_is_its_largest_multipliers() -> None:
    scene = beam_scene(Beam(modes=1), impact_absorber(restitution=0.75))
    reference = scene.model.resonance_omega(1)
    settled = Drive(
        1.5, Approach(reference, 1.0).to((800.0, 0.9), (400.0, 0.9))
    )  # down from impact at the resonance
    exponent = largest_exponent(scene, settled, 800)
    orbits = closed_form_orbits(case_of(scene, 1.5, 0.9 * reference)).orbits
    (stable,) = (orbit for orbit in orbits if orbit.stability.stable)
    assert exponent.value == pytest.approx(np.log(abs(stable.stability.full[0])), abs=2e-3)
    assert not exponent.chaotic


def test_chaos_parts_runs_as_its_exponent_says() -> None:
    """In chaos, runs separate as the Lyapunov exponent says.

    Pairs of runs start a billionth of the gap apart. The mean logarithm of their distance grows
    with the exponent until they are no longer correlated.
    """
    scene = beam_scene(Beam(modes=1), impact_absorber())
    omega = scene.model.resonance_omega(1)
    exponent = largest_exponent(scene, drive(scene, 1.7, 1.0, 500.0), 1600)
    assert exponent.chaotic
    rates = []
    for k in range(40):
        state = simulate(scene, drive(scene, 1.7, 1.0, 500.0 + 10 * k), record=RECORD).end_state
        other = state + 1e-11 * np.random.default_rng(k).normal(size=len(state)) * np.array(
            [1.0, 1.0, omega, omega]
        )
        ends = []
        for periods in (2.0, 12.0):  # the first two turn the difference into the fastest direction
            run = Drive(1.7, constant_frequency(omega, 1.0, periods))
            one, two = (
                simulate(
                    scene, run, initial=InitialState.from_vector(scene, start), record=RECORD
                ).end_state
                for start in (state, other)
            )
            ends.append(np.linalg.norm((two - one) / np.array([1.0, 1.0, omega, omega])))
        rates.append(np.log(ends[1] / ends[0]) / 10)
    width = 3 * np.std(rates) / np.sqrt(len(rates)) + exponent.high - exponent.low
    assert abs(np.mean(rates) - exponent.value) < width
