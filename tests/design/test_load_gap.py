"""Gaps and tunings under loads agree with scans, the scaling law and a transfer function.

The commands are tested too.
"""

import json
from pathlib import Path

import numpy as np
import pytest
import scipy.optimize
from commands import done, read
from drawing import line, saved_figures
from load_cases import MASS, OMEGA, file_of_one_mode
from numpy.typing import NDArray

from impact_env.ensemble import draw_members, drives_of
from impact_env.loads import BASE_QUANTITY, FORCE_QUANTITY, Loads, Random, Shock
from impact_env.modes import ModalModel
from impact_env.parameters import TunedAbsorber, impact_absorber
from impact_env.results import Record
from impact_env.scene import Scene
from impact_env.sweep import simulate
from optimisation.cli.group import imported
from optimisation.gap_advice import Advice, search_gap
from optimisation.load_cases import AppliedLoads
from optimisation.objectives import Condition
from optimisation.problem import Problem, evaluate_arrays
from optimisation.space import GAP, IMPACT, design_space
from optimisation.tuned.under_loads import expected_rms, tune_under_loads

MODEL = ModalModel(*(np.array([x]) for x in (OMEGA[0], 0.01, 0.6, 2.6)), MASS)
BAND = ((35.0, 0.5), (46.0, 0.5))
NOISE, SHORT_NOISE = (
    Loads((Random(np.array(BAND), length, 1),), OMEGA[0]) for length in (20.0, 4.0)
)
SHOCK = Loads((Shock("half-sine", 20.0, 0.0125, 0.5),), OMEGA[0])
CHAIN = 900.0 * np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
DAMPED = ModalModel(*(np.array([x]) for x in (OMEGA[0], 0.02, 0.6, 2.6)), MASS)


def late_rms(scene: Scene, drive: object, damping: float) -> float:
    """Return the RMS of the tip after five time constants, from the run's samples."""
    history = simulate(
        scene, drive, record=Record(level=False, series=True, samples_per_period=64)
    ).history
    return float(
        np.sqrt(np.mean(history.tip_displacement[history.time >= 5 / (damping * OMEGA[0])] ** 2))
    )


def of_members(gap: float) -> float:
    """Return the median over three members of the RMS under the noise."""
    scene = Scene(MODEL, impact_absorber(gap, 0.7, 0.0, 0.02))
    return float(
        np.median([late_rms(scene, drive, 0.01) for drive in drives_of(draw_members(3, 0), NOISE)])
    )


def search(loads: Loads, factor: float = 1.0, **options: object) -> Advice:
    """Return the gap under loads of an absorber without friction."""
    case = AppliedLoads(MODEL, loads).times(factor)
    absorber = case.absorber(0.02, 0.7, 0.0)
    return search_gap(case, absorber, friction_fixed=True, **options)


def test_the_gap_under_noise_is_among_the_best_of_a_scan() -> None:
    advice = search(NOISE)
    scan = [
        of_members(float(gap))
        for gap in AppliedLoads(MODEL, NOISE).free_size * np.geomspace(0.5, 4, 9)
    ]
    assert np.isnan(advice.check.rule)
    assert advice.sharp.level == pytest.approx(of_members(advice.sharp.gap), rel=1e-3)
    assert advice.sharp.level < 1.15 * min(scan) < 0.7 * advice.check.without.median[0]
    assert advice.sharp.level <= advice.recommended.level <= advice.recommended.worst


@pytest.mark.parametrize("loads", [NOISE, SHOCK])
def test_twice_the_load_wants_twice_the_gap(loads: Loads) -> None:
    """The scaling law; a factor of two leaves all digits as they are."""
    one, two = (search(loads, factor, members=1) for factor in (1.0, 2.0))
    length = 2.0 if one.case.measure == "rms" else 1.0
    assert two.sharp.gap == pytest.approx(2 * one.sharp.gap)
    assert two.sharp.level == pytest.approx(length * one.sharp.level, rel=1e-6)


def test_a_search_under_loads_that_is_stopped_keeps_what_is_finished() -> None:
    def stop(done: int, _total: int) -> None:
        if done == 4:
            raise KeyboardInterrupt

    advice = search(SHOCK, members=1, progress=stop)
    whole = search(SHOCK, members=1)
    assert not advice.complete
    assert 0 < len(advice.check.gaps) < len(whole.check.gaps)
    for step, levels in advice.samples.levels.items():
        assert whole.samples.levels[step] == levels


def exact_rms(stiffness: float, damping: float) -> float:
    """Return the RMS of one mode with a tuned absorber under the noise.

    It is the sum over frequencies.
    """
    omega = 2 * np.pi * np.linspace(BAND[0][0], BAND[1][0], 4001)
    mass = 0.02 * MASS
    link: NDArray[np.complex128] = stiffness + 1j * omega * damping
    carried = (
        link * mass * omega**2 / (link - mass * omega**2)
    )  # what the absorber adds to the dynamic stiffness, negative
    own = OMEGA[0] ** 2 - omega**2 + 2j * 0.01 * OMEGA[0] * omega - 2.6**2 * carried
    return float(np.sqrt(np.trapezoid(0.5 * np.abs(2.6 * 0.6 / own) ** 2, omega / (2 * np.pi))))


@pytest.mark.parametrize("quantity", [FORCE_QUANTITY, BASE_QUANTITY])
@pytest.mark.parametrize("tuned", [None, TunedAbsorber(0.05, 900.0, 2.0)])
def test_the_expected_rms_is_that_of_the_matrices(
    quantity: str, tuned: TunedAbsorber | None
) -> None:
    """The expected RMS is that of the matrices.

    A chain of three masses has an absorber at the last one. Its foot moves, or is fixed with a
    force at the first mass. The reference is a dense solution.
    """
    omega, vectors = scipy.linalg.eigh(CHAIN, np.eye(3))
    omega = np.sqrt(omega)
    model = ModalModel(
        omega,
        np.full(3, 0.02),
        vectors[0],
        vectors[2],
        3.0,
        base_participation=vectors.sum(axis=0),
    )
    load = Random(np.array([[2.0, 0.3], [9.0, 0.6]]), 30.0, 1, quantity)
    damping = vectors @ np.diag(2 * 0.02 * omega) @ vectors.T
    square = 0.0
    for hertz, density in zip(load.lines / load.length, load.density, strict=True):
        s = 2j * np.pi * hertz
        dynamic = np.zeros((4, 4), dtype=complex)
        dynamic[:3, :3] = CHAIN + s * damping + s**2 * np.eye(3)
        mass = 0.0 if tuned is None else 0.05 * 3.0
        pull = -np.array([1.0, 1.0, 1.0, mass])  # of the base's acceleration
        if quantity == FORCE_QUANTITY:
            pull = np.array([1.0, 0.0, 0.0, 0.0])
        dynamic[3, 3] = 1.0
        if tuned is not None:
            link = 900.0 + 2.0 * s
            dynamic[3, 3] = mass * s**2 + link
            dynamic[2, 2] += link
            dynamic[2, 3] = dynamic[3, 2] = -link
        square += density * abs(np.linalg.solve(dynamic, pull)[2]) ** 2 / load.length
    assert expected_rms(model, tuned, load) == pytest.approx(np.sqrt(square), rel=1e-9)


def test_a_random_load_is_tuned_to_its_least_mean_square() -> None:
    tuned = tune_under_loads(MODEL, NOISE, 0.02)

    def shifted(x: NDArray[np.float64]) -> float:
        return exact_rms(tuned.peak.stiffness * np.exp(x[0]), tuned.peak.damping * np.exp(x[1]))

    least = scipy.optimize.minimize(shifted, np.zeros(2), method="Nelder-Mead").fun
    assert exact_rms(tuned.best.stiffness, tuned.best.damping) == pytest.approx(least, rel=1e-4)
    assert least < 0.99 * exact_rms(tuned.peak.stiffness, tuned.peak.damping)


def written(folder: Path) -> list[object]:
    (folder / "structure.toml").write_text(file_of_one_mode(0.02))
    (folder / "load.toml").write_text(
        '[load]\nkind = "shock"\npulse = "half-sine"\npeak_n = 20.0\npulse_s = '
        "0.0125\nduration_s = 0.5\n"
    )
    return [
        "--structure",
        folder / "structure.toml",
        "--load",
        folder / "load.toml",
        "--out",
        folder,
    ]


def test_the_commands(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    options = written(tmp_path)
    drawn = saved_figures(monkeypatch)
    load = tmp_path / "load.toml"
    result = done(
        imported("design_gap"),
        *options,
        "--quick",
        "--force",
        2,
        "--device",
        tmp_path / "device.json",
    )
    summary = json.loads((tmp_path / "summary.json").read_text())
    best = summary["recommended"]
    assert summary["rule_gap_m"] is None
    assert "No rule for this load" in result.output
    assert f"{1e3 * best['gap_m']:.4g} mm" in result.output
    assert best["decay_s"] < summary["decay_without_absorber_s"]
    assert json.loads((tmp_path / "device.json").read_text())["absorber"]["gap"] == best["gap_m"]
    (panel,) = drawn[0].axes
    runs: dict[float, list[float]] = {}
    for row in read(tmp_path / "runs.csv"):
        runs.setdefault(1e3 * float(row["gap_m"]), []).append(float(row["value"]))
    gap, decay = line(panel, "median of up to")
    np.testing.assert_allclose(sorted(gap), sorted(runs))
    np.testing.assert_allclose(decay, [np.median(runs[x]) for x in gap.tolist()], rtol=1e-9)
    np.testing.assert_allclose(line(panel, "recommended")[0], 1e3 * best["gap_m"])
    free = summary["decay_without_absorber_s"]
    np.testing.assert_allclose(line(panel, "no absorber")[1], free)
    again = done(
        imported("design_gap"),
        "--scene",
        tmp_path / "device.json",
        "--load",
        load,
        "--quick",
        "--out",
        tmp_path,
    )
    assert f"friction limit {best['friction_limit_n']:.4g} N" in again.output
    done(imported("tune_ltva"), *options)
    assert json.loads((tmp_path / "summary.json").read_text())["best"]["ratio"] < 1


# Searches under loads: measures written out, members with records of their own, and both commands
# on a structure of one mode.


def problem(
    loads: Loads, factors: tuple[float, ...] = (1.0,), members: int = 1, **more: object
) -> Problem:
    conditions = tuple(Condition(1, factor, loads=loads) for factor in factors)
    return Problem(
        design_space(IMPACT, (GAP,), None, {"friction_limit": 0.0}),
        conditions,
        beam=DAMPED,
        members=members,
        **more,
    )


def test_a_design_is_judged_by_the_measure_of_its_loads() -> None:
    """A design is judged by the measure of its loads.

    Member 0 has the given loads times the factor. The value is relative to the same record without
    absorber.
    """
    own = problem(SHORT_NOISE, (1.0, 2.0))
    gap = own.space.free[0]
    F, _, _ = evaluate_arrays(
        own, [[own.space.coordinates(own.space.decoded({gap.name: gap.low}))[gap.name]]]
    )
    design = own.space.decoded({gap.name: gap.low})
    expected = []
    for factor in (1.0, 2.0):
        absorber = impact_absorber(
            design.values[GAP], design.values["restitution"], design.values["friction_limit"], 0.02
        )
        loads = Loads((Random(SHORT_NOISE.parts[0].spectrum, 4.0, 1, factor=factor),), OMEGA[0])
        expected.append(
            late_rms(Scene(DAMPED, absorber), loads, 0.02) / late_rms(Scene(DAMPED), loads, 0.02)
        )
    assert F[0, 0] == pytest.approx(max(expected), rel=1e-9)


def test_every_member_has_a_record_of_its_own() -> None:
    """Every member has its own record of a random load.

    This includes the members that judge a winner, and parts of an ensemble that a search runs one
    after the other.
    """
    own = problem(SHORT_NOISE, members=6)
    sets = [own.ensemble, own.fresh_ensemble(6, 0), own.fresh_ensemble(6, 1)]
    drawn = [
        lane.drive.parts[0].amplitudes()[0]
        for members in sets
        for chunk in own.chunks(None, members, own.rate)
        for lane in chunk.lanes
    ]
    assert len(drawn) == 18
    assert len(set(drawn)) == 18
    again = [
        lane.drive.parts[0].amplitudes()[0]
        for chunk in own.chunks(None, own.ensemble[4:6], own.rate)
        for lane in chunk.lanes
    ]
    assert again == drawn[4:6]


def test_a_search_begins_at_the_gap_that_the_free_motion_sets() -> None:
    history = simulate(Scene(DAMPED), SHOCK, record=Record(level=False, series=True)).history
    largest = float(np.max(np.abs(history.tip_displacement)))
    assert problem(SHOCK).space.default.values[GAP] == pytest.approx(
        1.5 * largest / np.sqrt(2), rel=0.01
    )


def test_optimise_design_under_a_shock(tmp_path: Path) -> None:
    options = [*written(tmp_path), "--designs", 10, "--members", 2]
    result = done(imported("optimise_design"), *options, "--quick", "--free", "gap", "--threads", 1)
    out = tmp_path / "impact"
    summary = json.loads((out / "summary.json").read_text())
    condition = summary["conditions"][0]
    assert condition["winner"]["decay_s"] == pytest.approx(
        condition["winner"]["relative"] * condition["without_s"]
    )
    assert condition["winner"]["relative"] < 0.7
    assert "in_service" not in summary
    assert (
        f"{condition['winner']['decay_s']:.3f} s, {100 * condition['winner']['relative']:.1f} "
        "% of no absorber"
    ) in result.output
    assert {"load", "factor", "decay_median_s"} <= set(read(out / "curves.csv")[0])


def test_a_front_under_a_shock(tmp_path: Path) -> None:
    options = [*written(tmp_path), "--designs", 10, "--members", 2]
    result = done(imported("pareto"), *options, "--batch", 5, "--free", "gap", "--threads", 1)
    summary = json.loads((tmp_path / "severity" / "summary.json").read_text())
    assert len(summary["front"]) >= 1
    assert "under shock, 1 times; the level is the decay time" in result.output
