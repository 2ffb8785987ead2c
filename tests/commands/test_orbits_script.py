"""Commands of periodic motions keep their JSON format and agree with published numbers.

Contents of their files are tested as well.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import call, done, read
from drawing import bands, line, lines, saved_figures

from impact_env import Drive, InitialState, constant_frequency, simulate
from impact_env.frequency import tip_response
from impact_env.modes import modal_model
from impact_env.parameters import Beam, StuckAbsorber
from impact_env.periodic import HybridOrbit, Orbit, hybrid_orbit_of, orbit_of, unpack_orbits
from impact_env.periodic.orbit_table import ORBIT_COLUMNS
from impact_env.periodic.response_curve import CurvePoint
from impact_env.plain import to_scene
from optimisation.cli import periodic_orbits as orbits
from optimisation.cli.group import imported
from optimisation.report.response_report import thin_marks

KEYS = {
    "omega_ratio",
    "period_multiple",
    "symmetric",
    "impacts",
    "tip_max_m",
    "tip_rms_m",
    "stable",
    "residual",
}
KEYS |= {"basin", "scene", "force_N", "omega_rad_s", "period_s", "events", "held_rad", "start"}
PAPER = ["--modes", "3", "--friction-limit", "0.01", "--restitution", "1", "--force", "1.5"]
ONE_MODE = ["--modes", "1", "--restitution", "0.75", "--force", "1.5"]


def listed(tmp_path: Path, *arguments: str) -> tuple[str, list[dict[str, Any]]]:
    target = tmp_path / "orbits.json"
    result = done(orbits, *arguments, "--json", target)
    content = json.loads(target.read_text(encoding="utf-8"))
    assert isinstance(content, list)
    return result.output, content


def test_the_orbits_over_a_range_have_exactly_the_promised_keys(tmp_path: Path) -> None:
    output, listing = listed(tmp_path, *PAPER, "--from", "0.94", "--to", "0.95", "--points", "2")
    assert [orbit["omega_ratio"] for orbit in listing] == pytest.approx(
        [0.94, 0.94, 0.95, 0.95], abs=1e-12
    )
    for orbit in listing:
        assert set(orbit) == KEYS | {"half_multipliers"}
        assert orbit["symmetric"] is True
        assert [set(impact) for impact in orbit["impacts"]] == [
            {"phase_rad", "impulse_Ns", "wall"}
        ] * 2
        assert all(
            impact["impulse_Ns"] * impact["wall"] < 0 and 0 <= impact["phase_rad"] < 2 * np.pi
            for impact in orbit["impacts"]
        )
        assert orbit["stable"] == (max(np.hypot(*pair) for pair in orbit["half_multipliers"]) < 1)
        assert len(orbit["half_multipliers"]) == 8
        assert orbit["residual"] < 1e-10
        assert 0 < orbit["tip_rms_m"] < orbit["tip_max_m"]
    assert "4 orbits, 0 of them stable." in output


def test_an_orbit_of_a_file_can_be_read_back_and_run_again(tmp_path: Path) -> None:
    _, listing = listed(tmp_path, *PAPER, "--at", "0.95", "--symmetric")
    for plain in listing:
        orbit = orbit_of(plain)
        assert isinstance(orbit, Orbit)
        assert orbit.motion.tip_max == pytest.approx(plain["tip_max_m"], rel=1e-9)
        struck = [event for event in plain["events"] if event["wall"]]
        assert all(
            any(abs(event["phase_rad"] - impact["phase_rad"]) < 1e-9 for impact in plain["impacts"])
            for event in struck
        )
        scene = to_scene(plain["scene"])
        start = plain["start"]
        run = Drive(
            plain["force_N"],
            constant_frequency(plain["omega_rad_s"], 1.0, plain["period_multiple"]),
            start["phase_rad"],
        )
        first = InitialState(
            start["modal_displacement"],
            start["modal_velocity"],
            start["absorber_displacement_m"],
            start["absorber_velocity_m_s"],
        )
        end = simulate(scene, run, initial=first).end_state
        assert end == pytest.approx(first.vector(scene), abs=1e-9)


TWO_ABSORBERS = """
[beam]
modes = 1
[absorber]
kind = "several"
[[absorber.absorbers]]
position = 1.0
gap = 8e-4
restitution = 0.7
mass_ratio = 0.01
[[absorber.absorbers]]
position = 0.75
gap = 1e-3
restitution = 0.8
mass_ratio = 0.01
"""


def test_orbits_of_a_scene_with_two_absorbers_are_in_the_same_form(tmp_path: Path) -> None:
    """Orbits of a scene with two absorbers have the same form as those of one absorber.

    Keys of JSON and columns of CSV are the same. Each orbit is computed again from its entry.
    """
    scene = tmp_path / "two.toml"
    scene.write_text(TWO_ABSORBERS, encoding="utf-8")
    table = tmp_path / "orbits.csv"
    options = ["--scene", str(scene), "--at", "1", "--force", "3", "--starts", "0"]
    output, orbits_in_file = listed(tmp_path, *options, "--csv", str(table))
    assert len(orbits_in_file) == 2  # one without symmetry, and its mirror image
    for plain in orbits_in_file:
        assert set(plain) == (KEYS - {"basin", "held_rad"}) | {"multipliers"}
        assert {impact["absorber"] for impact in plain["impacts"]} == {0, 1}
        orbit = hybrid_orbit_of(plain)
        assert isinstance(orbit, HybridOrbit)
        assert orbit.tip_max == pytest.approx(plain["tip_max_m"], rel=1e-9)
    rows = read(table)
    assert list(rows[0]) == list(ORBIT_COLUMNS)
    assert [float(row["tip_max_m"]) for row in rows] == [o["tip_max_m"] for o in orbits_in_file]
    assert "2 orbits, 2 of them stable." in output
    branch_table = tmp_path / "branch.csv"
    limits = ["--along", "force", "--over", "2.95", "3.1"]
    _, (branch,) = listed(tmp_path, *options, *limits, "--csv", str(branch_table))
    points = [row for row in read(branch_table) if row["kind"] == "point"]
    assert [float(point["force_N"]) for point in points] == branch["force_N"]
    assert [mark["kind"] for mark in branch["located"]] == ["fold", "period doubling"]


def test_options_that_do_not_go_with_several_absorbers_are_refused(tmp_path: Path) -> None:
    scene = tmp_path / "two.toml"
    scene.write_text(TWO_ABSORBERS, encoding="utf-8")
    for options, message in (
        ([], "--frequency is required"),
        (["--frequency", "1", "--gap", "1e-3"], "--gap does not go with"),
        (["--frequency", "1", "--over", "gap", "1e-4", "1e-2"], "--over gap: force or frequency"),
    ):
        result = call(orbits, "--scene", str(scene), *options)
        assert result.exit_code == 2 or result.exit_code == 1
        assert message in result.output


def test_branches_over_the_force_hold_both_ends_of_an_s(tmp_path: Path) -> None:
    """A branch over the force contains both ends of an S.

    Low and high orbits of one frequency are on one branch over the force. It turns at the force of
    the fold.
    """
    _, (branch,) = listed(
        tmp_path,
        "--modes",
        "2",
        "--force",
        "3",
        "--at",
        "0.95",
        "--along",
        "force",
        "--over",
        "1",
        "6",
    )
    assert max(branch["force_N"]) == pytest.approx(6, rel=1e-6)
    entries = list(unpack_orbits(branch["orbits"]))
    assert len(entries) == sum(tip is not None for tip in branch["tip_max_m"])
    for entry in entries[:: len(entries) // 4]:
        orbit = orbit_of(entry)
        assert isinstance(orbit, Orbit)
        assert orbit.case.omega_ratio == pytest.approx(0.95)
        assert any(abs(force - orbit.case.force) < 1e-12 for force in branch["force_N"])
        assert orbit.motion.tip_max == pytest.approx(entry["tip_max_m"], rel=1e-7)
    (fold,) = (mark for mark in branch["located"] if mark["kind"] == "fold")
    _, levels = listed(
        tmp_path,
        "--modes",
        "2",
        "--force",
        f"{fold['force_N']:.9f}",
        "--folds",
        "--from",
        "0.94",
        "--to",
        "0.96",
    )
    assert min(abs(level["omega_ratio"] - 0.95) for level in levels) < 1e-5


def test_one_frequency_has_what_runs_settle_to_as_well(tmp_path: Path) -> None:
    output, listing = listed(tmp_path, *ONE_MODE, "--at", "0.93")
    shares = [orbit["basin"] for orbit in listing]
    assert {share["runs"] for share in shares} == {16}
    assert sum(share["ended"] for share in shares) == 16
    assert {share["nothing_periodic"]["ended"] for share in shares} == {0}
    for share in shares:
        assert share["low"] <= share["share"] == share["ended"] / 16 <= share["high"]
        assert share["ended"] == 0 or f"{share['ended']} of 16 (" in output
    assert "over 2000 periods of the force: 0 of 16 (0-19 %) end on nothing periodic" in output
    assert {orbit["omega_ratio"] for orbit in listing} == {0.93}
    sided = [orbit for orbit in listing if not orbit["symmetric"]]
    assert len(sided) == 2
    for orbit in sided:
        assert set(orbit) == KEYS | {"multipliers"}
        assert orbit["stable"] is True
        assert orbit["period_multiple"] == 1
    one, other = (
        sorted(
            (impact["wall"], impact["phase_rad"], impact["impulse_Ns"])
            for impact in orbit["impacts"]
        )
        for orbit in sided
    )
    for (wall, phase, impulse), (_, mirrored_phase, back) in zip(one, other[::-1], strict=True):
        assert back == pytest.approx(-impulse, rel=1e-8), wall
        assert np.exp(1j * mirrored_phase) == pytest.approx(-np.exp(1j * phase), abs=1e-8)


def test_two_absorbers_are_refused_in_one_line(tmp_path: Path) -> None:
    scene = tmp_path / "two.toml"
    places = "".join(f"[[absorber.absorbers]]\nposition = {at}\n" for at in (1.0, 0.6))
    scene.write_text(f'[beam]\nmodes = 2\n[absorber]\nkind = "several"\n{places}', "utf-8")
    for name in ("frequency_response", "isola"):
        result = call(imported(name), "--scene", scene)
        assert result.exit_code == 2
        error = result.output.strip().splitlines()[-1]
        assert error.startswith("Error: absorber = at 1 of the length impact absorber")
        assert "(" not in error


def test_a_range_has_pairs_and_doubled_periods(tmp_path: Path) -> None:
    """A range of frequencies has pairs of orbits and orbits with doubled period.

    N_m = 1, e = 0.8: between 0.9307 and 0.9353 a stable orbit has two periods of the force, and
    runs end on it (test_switching).
    """
    arguments = [
        "--modes",
        "1",
        "--restitution",
        "0.8",
        "--force",
        "1.5",
        "--from",
        "0.932",
        "--to",
        "0.934",
        "--points",
        "3",
    ]
    output, listing = listed(tmp_path, *arguments)
    assert "one-sided, period 2" in output
    kinds = {(orbit["symmetric"], orbit["period_multiple"]) for orbit in listing}
    assert kinds == {(True, 1), (False, 1), (False, 2)}
    doubled = [orbit for orbit in listing if orbit["period_multiple"] == 2]
    assert any(orbit["stable"] for orbit in doubled)
    for orbit in doubled:
        assert len(orbit["impacts"]) == 4
        assert set(orbit) == KEYS | {"multipliers"}
        assert all(0 <= impact["phase_rad"] < 4 * np.pi for impact in orbit["impacts"])


def test_folds_and_thresholds(tmp_path: Path) -> None:
    _, listing = listed(tmp_path, *PAPER, "--from", "0.93", "--to", "0.96", "--folds")
    keys = {"kind", "omega_ratio", "force_N", "tip_max_m", "orbit"}
    assert all(set(fold) == keys and fold["kind"] == "fold" for fold in listing)
    assert all(fold["orbit"]["tip_max_m"] == fold["tip_max_m"] for fold in listing)
    assert [fold["omega_ratio"] for fold in listing] == pytest.approx(
        [0.9336128203, 0.9336233427, 0.9552754578], abs=1e-9
    )
    assert {fold["force_N"] for fold in listing} == {1.5}
    _, listing = listed(tmp_path, *PAPER, "--from", "0.93", "--to", "1", "--thresholds")
    assert [threshold["force_N"] for threshold in listing] == pytest.approx(
        [1.221955, 2.370284], abs=5e-7
    )  # birth and merger with reversals


def test_curves_over_two_parameters_are_in_all_files(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    drawn = saved_figures(monkeypatch)
    table = tmp_path / "curves.csv"
    figure = tmp_path / "curves.png"
    options = [
        "--curve",
        "fold",
        "--with",
        "force",
        "--over",
        "1",
        "2",
        "--from",
        "0.93",
        "--to",
        "0.95",
        "--symmetric",
    ]
    output, curves = listed(
        tmp_path, *ONE_MODE, *options, "--csv", str(table), "--plot", str(figure)
    )
    (curve,) = curves
    assert curve["kind"] == "fold"
    assert max(abs(real - 1) + abs(imaginary) for real, imaginary in curve["multiplier"]) < 1e-6
    places = [
        (at, force)
        for at, force in zip(curve["omega_ratio"], curve["value"], strict=True)
        if abs(force - 1.5) < 0.2
    ]
    assert min(abs(at - 0.9433449134) for at, _ in places) < 0.005  # the fold at 1.5 N
    rows = table.read_text(encoding="utf-8").splitlines()
    assert len(rows) == 1 + len(curve["value"]) + len(curve["located"])
    points = read(table)[: len(curve["value"])]
    assert [float(point["force_N"]) for point in points] == curve["value"]
    assert {point["kind"] for point in points} == {"fold"}
    (panel,) = drawn[0].axes
    solid, dotted = lines(panel)[:2]
    value = np.where(np.isnan(solid[1]), dotted[1], solid[1])
    np.testing.assert_allclose(solid[0], curve["omega_ratio"])
    np.testing.assert_allclose(value, curve["value"])
    true = np.array(curve["orbit"]) == "yes"
    assert np.isfinite(solid[1][true]).all()
    np.testing.assert_array_equal(np.isfinite(dotted[1]), ~true)
    assert panel.get_ylabel() == "force in N"
    assert "Curve 1: " in output


# frequency_response, isola and balance_error: contents of their files, and published numbers.


ISOLA = ("--modes", 3, "--friction-limit", 0.01)


def test_the_papers_isola_by_both_methods_in_all_files(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    drawn = saved_figures(monkeypatch)
    files = [tmp_path / name for name in ("response.json", "response.csv", "response.png")]
    limits = ("--from", 0.92, "--to", 0.962, "--rate", 20)
    done(
        imported("frequency_response"),
        *ISOLA,
        *limits,
        "--json",
        files[0],
        "--csv",
        files[1],
        "--plot",
        files[2],
    )
    summary = json.loads(files[0].read_text())
    exact = [curve for curve in summary["curves"] if curve["method"] == "exact orbits"]
    (closed,) = [curve for curve in exact if curve["closed"]]
    folds = sorted(mark["omega_ratio"] for mark in closed["located"] if mark["kind"] == "fold")
    assert folds[0] == pytest.approx(0.9336128203, abs=1e-9)
    assert folds[-1] == pytest.approx(0.9552754578, abs=1e-9)
    assert closed["peak"]["tip_max_m"] == pytest.approx(1.4743e-3, abs=1e-7)
    assert not any(closed["stable"])
    assert any(closed["slowly_stable"])
    entries = list(unpack_orbits(closed["orbits"]))
    assert len(entries) == sum(tip is not None for tip in closed["tip_max_m"])
    assert all(
        {"scene", "start", "events", "held_rad", "half_multipliers", "period_s", "symmetric"}
        <= set(entry)
        for entry in entries
    )
    assert isinstance(orbit_of(entries[len(entries) // 2]), Orbit)
    balance = [curve for curve in summary["curves"] if curve["method"] == "harmonic balance"]
    assert sorted(curve["closed"] for curve in balance) == [False, True]
    model = modal_model(Beam(modes=3))
    ratio = np.array(summary["linear"]["omega_ratio"])
    assert summary["linear"]["stuck_m"] == pytest.approx(
        1.5 * np.abs(tip_response(model, StuckAbsorber(), ratio * model.omega[0]))
    )
    assert [sweep["omega_ratio"][0] > sweep["omega_ratio"][-1] for sweep in summary["sweeps"]] == [
        False,
        True,
    ]
    rows = read(files[1])
    for number, curve in enumerate(summary["curves"], 1):
        amplitudes = [x for x in curve["tip_max_m"] if x is not None]
        assert [
            float(row["tip_max_m"])
            for row in rows
            if row["number"] == str(number) and row["kind"] == "point"
        ] == amplitudes
    (panel,) = drawn[0].axes
    for name, label in (("alone_m", "no absorber"), ("stuck_m", "absorber stuck")):
        np.testing.assert_allclose(
            line(panel, label), [ratio, 1e3 * np.array(summary["linear"][name])]
        )
    for sweep, way in zip(summary["sweeps"], ("up", "down"), strict=True):
        tips = 1e3 * np.array(sweep["tip_max_m"])
        np.testing.assert_allclose(line(panel, f"sweep {way}"), [sweep["omega_ratio"], tips])
    drawn_points = {
        (round(x, 9), round(y, 6)) for points in lines(panel) for x, y in points.T.tolist()
    }
    for curve in summary["curves"]:
        points = zip(curve["omega_ratio"], curve["tip_max_m"], strict=True)
        is_drawn = [(round(x, 9), round(1e3 * y, 6)) in drawn_points for x, y in points if y]
        assert np.mean(is_drawn) > 0.99
    assert sorted(tmp_path.iterdir()) == sorted(files)


def test_balance_at_springs_loses_its_stability_where_the_absorber_first_touches_them(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Harmonic balance with compliant walls becomes unstable at the first contact.

    It has a contact stiffness. Up to the fold the absorber touches no wall and the beam moves as
    without one. Beyond it each solution is a saddle.
    """
    drawn = saved_figures(monkeypatch)
    file = tmp_path / "found.json"
    figure = tmp_path / "found.png"
    options = (
        "--modes",
        1,
        "--force",
        3,
        "--from",
        0.95,
        "--to",
        0.97,
        "--no-sweeps",
        "--method",
        "balance",
        "--harmonics",
        10,
        "--hill",
    )
    done(
        imported("frequency_response"),
        *options,
        "--contact-stiffness",
        2e4,
        "--json",
        file,
        "--plot",
        figure,
    )
    curve = json.loads(file.read_text())["curves"][0]
    model = modal_model(Beam(modes=1))
    alone = 3 * np.abs(tip_response(model, None, np.array(curve["omega_ratio"]) * model.omega[0]))
    floats = np.isclose(curve["tip_max_m"], alone, rtol=1e-9)
    assert 5 < np.sum(floats) < len(floats) - 5
    np.testing.assert_array_equal(curve["stable"], floats)
    tips = 1e3 * np.array(curve["tip_max_m"])
    for wanted in (np.where(floats, tips, np.nan), np.where(floats, np.nan, tips)):
        assert any(
            len(points[1]) == len(tips) and np.allclose(points[1], wanted, equal_nan=True)
            for points in lines(drawn[0].axes[0])
        )


def test_both_commands_list_the_same_folds(tmp_path: Path) -> None:
    """The commands frequency_response and orbits list the same folds.

    At 3 N the branch folds twice near 0.90321, with 4 reversals and with 8. The steps of the
    continuation decide which of them is found.
    """
    limits = ("--force", 3, "--from", 0.89, "--to", 0.93)
    done(
        imported("frequency_response"),
        *ISOLA,
        *limits,
        "--method",
        "exact",
        "--no-sweeps",
        "--json",
        tmp_path / "r.json",
    )
    done(orbits, *ISOLA, *limits, "--folds", "--json", tmp_path / "o.json")
    curves = json.loads((tmp_path / "r.json").read_text())["curves"]
    drawn = sorted(
        mark["omega_ratio"]
        for curve in curves
        for mark in curve["located"]
        if mark["kind"] == "fold"
    )
    assert drawn == [fold["omega_ratio"] for fold in json.loads((tmp_path / "o.json").read_text())]
    assert drawn == pytest.approx([0.9032099017, 0.9032184151], abs=1e-10)


def test_the_envelope_has_quantiles_of_runs_that_settled(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The envelope has quantiles of stationary runs.

    The paper's two-mode case at 0.9 is linear except for sliding friction: all members are equal,
    between the linear curves, and without an impact.
    """
    drawn = saved_figures(monkeypatch)
    files = [tmp_path / name for name in ("response.json", "response.png")]
    run = (
        "--modes",
        2,
        "--friction-limit",
        0.025,
        "--method",
        "exact",
        "--no-sweeps",
        "--from",
        0.9,
        "--to",
        0.905,
    )
    runs = ("--envelope", 2, "--members", 3, "--window", 20, "--settle", 200, "--threads", 1)
    result = done(
        imported("frequency_response"), *run, *runs, "--json", files[0], "--plot", files[1]
    )
    assert "runs at" in result.output
    first, last = json.loads(files[0].read_text())["stationary"]
    assert (first["omega_ratio"], last["omega_ratio"]) == (0.9, 0.905)
    assert first["quantiles"] == [0.05, 0.5, 0.95]
    assert first["impacts_per_period"] == last["impacts_per_period"] == 0
    model = modal_model(Beam(modes=2))
    ends = [
        1.5 * abs(tip_response(model, absorber, np.array([0.9 * model.omega[0]]))[0])
        for absorber in (None, StuckAbsorber())
    ]
    assert all(0.95 * min(ends) < tip < 1.05 * max(ends) for tip in first["tip_max_m"])
    assert first["tip_max_m"][0] == pytest.approx(first["tip_max_m"][2], rel=1e-2)
    assert last["tip_max_m"][1] > 1.02 * first["tip_max_m"][1]
    tips = 1e3 * np.array([first["tip_max_m"], last["tip_max_m"]]).T
    (panel,) = drawn[0].axes
    np.testing.assert_allclose(line(panel, "stationary runs, median"), [[0.9, 0.905], tips[1]])
    (band,) = bands(panel)
    np.testing.assert_allclose(band, [[0.9, 0.905], tips[0], tips[2]])


def test_births_and_mergers_and_their_map(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    drawn = saved_figures(monkeypatch)
    files = [tmp_path / name for name in ("isola.json", "isola.csv", "isola.png")]
    options = (
        "--json",
        files[0],
        "--csv",
        files[1],
        "--plot",
        files[2],
        "--map-modes",
        "1,3",
        "--map-restitutions",
        "0.75,1",
    )
    done(
        imported("periodic isola"),
        *("--modes", 3, "--friction-limit", 0.01, "--from", 0.93, "--to", 1),
        *options,
    )
    summary = json.loads(files[0].read_text())
    assert [row["kind"] for row in summary["thresholds"]] == ["birth", "merger"]
    assert all(row["orbit"] == "yes" for row in summary["thresholds"])
    same = [
        row["force_N"] for row in summary["map"] if row["modes"] == 3 and row["restitution"] == 1
    ]
    assert same == [row["force_N"] for row in summary["thresholds"]]
    births = {
        row["restitution"]: row["force_N"]
        for row in summary["map"]
        if row["modes"] == 3 and row["kind"] == "birth"
    }
    assert births[0.75] > births[1.0] + 0.5
    ratio, force = (
        np.array(summary["fold_force"][name], dtype=float) for name in ("omega_ratio", "force_N")
    )
    inside = (ratio > 0.94) & (ratio < 0.95)
    assert np.min(force[inside]) == pytest.approx(1.221955, abs=1e-4)
    assert len(read(files[1])) == len(summary["thresholds"]) + len(summary["map"])
    panel, by_restitution = drawn[0].axes
    np.testing.assert_allclose(lines(panel)[0], [ratio, force])
    for row in summary["thresholds"]:
        marked = np.ravel(line(panel, row["kind"]))
        np.testing.assert_allclose(marked, [row["omega_ratio"], row["force_N"]])
    for modes in (1, 3):
        for kind in ("birth", "merger"):
            cells = sorted(
                (row["restitution"], row["force_N"])
                for row in summary["map"]
                if (row["modes"], row["kind"]) == (modes, kind)
            )
            known = {
                (round(x, 9), round(y, 9))
                for points in lines(by_restitution)
                for x, y in points.T.tolist()
            }
            assert {(round(x, 9), round(y, 9)) for x, y in cells} <= known


def test_error_of_harmonic_balance_falls_with_the_harmonics(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    drawn = saved_figures(monkeypatch)
    file = tmp_path / "error.json"
    figure = tmp_path / "error.png"
    done(
        imported("balance_error"),
        "--harmonics",
        "20,40",
        "--weights",
        "100",
        "--growing",
        "--json",
        file,
        "--plot",
        figure,
    )
    first, second = json.loads(file.read_text())["rows"]
    assert (first["weight"], second["weight"]) == (100, 400)
    assert first["closed"]
    assert second["closed"]
    assert 0.08 < first["tip_max_error"] < 0.13
    assert 0 < second["tip_max_error"] < first["tip_max_error"] / 3
    assert first["first_fold_ratio"] == pytest.approx(0.926, abs=6e-4)
    assert abs(second["first_fold_ratio"] - 0.93361) < abs(first["first_fold_ratio"] - 0.93361) / 2
    error, folds, _ = drawn[0].axes
    expected = [[20, 40], 100 * np.array([first["tip_max_error"], second["tip_max_error"]])]
    np.testing.assert_allclose(line(error, "weight 100"), expected)
    expected = [[20, 40], [first["first_fold_ratio"], second["first_fold_ratio"]]]
    np.testing.assert_allclose(line(folds, "weight 100"), expected)


def test_marks_of_one_kind_that_would_cover_each_other_are_drawn_once() -> None:
    marks = [
        CurvePoint("fold", 1.0, 1e-3),
        CurvePoint("fold", 1.0005, 1e-3),  # 0.005 of the width: covered
        CurvePoint("torus", 1.0005, 1e-3),  # another kind
        CurvePoint("fold", 1.01, 1e-3),  # 0.1 of the width
        CurvePoint("fold", 1.0, 1.1e-3),  # 0.05 of the height
    ]
    assert thin_marks(marks, 0.1, 2e-3) == [marks[0], *marks[2:]]


def test_curves_have_criticality_and_special_points_in_all_files(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Curves of bifurcations have criticality and special points in all files.

    N_m = 1, e = 0.8: the symmetry breaking from 1.08 to 1.12 N becomes subcritical at 1.1003 N,
    close to a fold-flip.
    """
    drawn = saved_figures(monkeypatch)
    table = tmp_path / "curves.csv"
    target = tmp_path / "curves.json"
    options = "--modes 1 --restitution 0.8 --force 1.11 --over 1.07 1.12 --from 0.9 --to 0.94"
    options += " --symmetric --kind symmetry-breaking"
    result = done(
        imported("periodic curves"),
        *options.split(),
        *("--csv", table, "--json", target, "--plot", tmp_path / "curves.png"),
    )
    (curve,) = json.loads(target.read_text(encoding="utf-8"))
    labels = {"fold-flip", "degenerate symmetry breaking"}
    special = {mark["kind"]: mark for mark in curve["located"] if mark["kind"] in labels}
    assert set(special) == labels
    assert special["degenerate symmetry breaking"]["value"] == pytest.approx(1.1003245, abs=1e-6)
    rows = read(table)
    points = [row for row in rows if row["kind"] == "symmetry breaking"]
    assert len(points) == len(curve["value"])
    signs = {row["criticality"]: float(row["coefficient"]) > 0 for row in points}
    assert signs == {"supercritical": True, "subcritical": False}
    assert [row["kind"] for row in rows[len(points) :]] == [
        mark["kind"] for mark in curve["located"]
    ]
    assert "degenerate symmetry breaking 1.100324 at 0.925838" in result.stdout
    (panel,) = drawn[0].axes
    legend = {label for each in panel.get_lines() if (label := str(each.get_label()))[0] != "_"}
    assert {"1 fold-flip", "2 degenerate symmetry breaking", "subcritical"} <= legend
