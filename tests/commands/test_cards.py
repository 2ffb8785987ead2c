"""Cards and figures of commands show the numbers of summary.json and of the CSV files.

Every row of a card is a number of summary.json, in its unit and in words, or is named here as known
from another source. Lines and bands of figures are the numbers of the CSV files.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import FAST, done, load, read
from drawing import bands, line, lines, saved_figures

from impact_env import Beam, modal_model
from optimisation.cli import compare as command
from optimisation.comparison import Comparison, compare
from optimisation.report.report import Row
from optimisation.tuned import den_hartog, undamped_h2

MODEL = modal_model(Beam(modes=2))
HERTZ = 0.15915494309189535  # 1/(2 pi)
Rows = dict[tuple[str, str], str]


@pytest.fixture(autouse=True)
def quickly_tuned(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("optimisation.comparison.minimax", den_hartog)
    monkeypatch.setattr(
        "optimisation.report.tuning_report.minimax",
        lambda model, mass, resonance, *_range: den_hartog(model, mass, resonance),
    )
    monkeypatch.setattr(
        "optimisation.report.tuning_report.minimum_h2",
        lambda model, mass, resonance, *_range: undamped_h2(model, mass, resonance),
    )


def rows_of(folder: Path) -> Rows:
    """Return the rows of a card as they are printed, by heading and label."""
    groups = json.loads((folder / "card.json").read_text())["groups"]
    return {
        (heading, row["label"]): Row(row["label"], row["value"], row["unit"]).text
        for heading, rows in groups.items()
        for row in rows
    }


def summary_of(folder: Path) -> Any:
    return json.loads((folder / "summary.json").read_text())


def banded(value: float, ends: tuple[float, float] | list[float], unit: str = "") -> str:
    """Return a value with its band, which is left out where all three read the same."""
    low, middle, high = (f"{x:.4g}" for x in (ends[0], value, ends[1]))
    text = f"{middle} {unit}".rstrip()
    return text if low == middle == high else f"{text} ({low} to {high})"


def mass(heading: str, ratio: float, model: Any = MODEL) -> Rows:
    """Return the two rows about an absorber's mass."""
    return {
        (heading, "absorber mass"): f"{ratio * model.beam_mass:.4g} kg",
        (heading, "that is"): f"{100 * ratio:.4g} % of the structure's {model.beam_mass:.4g} kg",
    }


def assumptions(resonances: tuple[int, ...], modes: str, rate: float | None = 40.0) -> Rows:
    rows = {
        f"resonance {r}": f"{MODEL.omega[r - 1] * HERTZ:.4g} Hz, damping ratio 1 %"
        for r in resonances
    } | {"modes kept": modes}
    if rate is not None:
        rows["sweeps up and down at"] = f"{rate:g} % per 100 pseudo periods"
    return {("Assumptions", label): text for label, text in rows.items()}


def check_rows(rows: Rows, expected: Mapping[tuple[str, str], str], elsewhere: set[str]) -> None:
    """Compare all rows of a card with the expected ones.

    Rows ``elsewhere``, given by label, must exist and are checked by other tests.
    """
    assert {label for _, label in rows.keys() - expected.keys()} == elsewhere
    assert {key: rows[key] for key in expected} == expected


def curve_rows(file: Path, resonance: str, concept: str) -> list[list[float]]:
    """Return force, median, 5 and 95 % of each row of a curve."""
    names = ("force_n", "level_median_m", "level_5_percent_m", "level_95_percent_m")
    return [
        [float(row[name]) for name in names]
        for row in read(file)
        if (row["resonance"], row["concept"]) == (resonance, concept)
    ]


def small(*_own: object, **options: Any) -> Comparison:
    return compare(Beam(modes=2), **(options | {"percent_per_100_periods": 40.0}))


def test_the_comparisons_card(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("optimisation.cli.compare.compare", small)
    drawn = saved_figures(monkeypatch)
    result = done(command, "--forces", 5, "--members", 2, "--out", tmp_path)
    content = summary_of(tmp_path)
    own = content["resonances"]["1"]["concepts"]["impact"]["absorber"]
    expected = mass("Impact absorber", own["mass_ratio"])
    expected |= {
        ("Impact absorber", "clearance to either wall"): f"{1e3 * own['walls']['gap']:.4g} mm",
        ("Impact absorber", "coefficient of restitution"): f"{own['walls']['restitution']:.4g}",
        ("Impact absorber", "friction limit"): f"{own['friction']['limit']:.4g} N",
    }
    halves = "the impact absorber halves the level"
    for number, part in content["resonances"].items():
        best = part["concepts"]["impact"]["at_best_force_of_impact_absorber"]["force_n"]
        heading = f"Resonance {number}, at {best:.3g} N"
        for key, concept in part["concepts"].items():
            absorber = concept["absorber"]
            at = concept["at_best_force_of_impact_absorber"]
            assert at["force_n"] == best
            level = banded(
                1e3 * at["response_level_m"],
                [1e3 * x for x in at["response_level_5_to_95_percent_m"]],
                "mm",
            )
            none = part["concepts"]["none"]["at_best_force_of_impact_absorber"]["response_level_m"]
            share = 100 * at["response_level_m"] / none
            place = f"read at {at['level_frequency_ratio']:.4g} of the resonance"
            expected[heading, concept["label"]] = f"{level}, {share:.3g} %, {place}"
            words = ""
            if "stiffness" in absorber:
                words = f"{absorber['stiffness']:.6g} N/m, {absorber['damping']:.4g} N s/m"
            elif "friction" in absorber:
                words = f"friction limit {absorber['friction']['limit']:.4g} N"
            if key not in ("none", "impact"):
                expected["Others of its mass", concept["label"]] = words
        at = part["forces_n"].index(best)
        limit = f"{1e3 * part['limit_m'][at]:.4g} mm"
        expected[heading, "no device in this cavity comes below"] = limit
        table = [row for row in read(tmp_path / "curves.csv") if row["resonance"] == number]
        impact, none = (
            [float(row["level_median_m"]) for row in table if row["concept"] == concept]
            for concept in ("impact", "none")
        )
        low = high = at
        good = [x < 0.5 * y for x, y in zip(impact, none, strict=True)]
        while good[at] and low > 0 and good[low - 1]:
            low -= 1
        while good[at] and high < len(good) - 1 and good[high + 1]:
            high += 1
        force = part["forces_n"]
        known = f"{force[low]:.3g} to {force[high]:.3g} N"
        expected[heading, halves] = known if good[at] else "at no force that is known"
    expected |= assumptions((1, 2), "2; more are not tried")
    service_labels = {
        label for heading, label in rows_of(tmp_path) if heading == "What it bears there"
    }
    ranges = {f"resonance {number} swept over" for number in content["resonances"]}
    rows = {
        key: text.removesuffix(", an end of the sweeps") for key, text in rows_of(tmp_path).items()
    }
    check_rows(rows, expected, service_labels | ranges | {"in brackets"})
    for key in ("none", "impact", "friction"):
        one = content["resonances"]["1"]["concepts"][key]
        assert one["label"] in result.output
    figure = drawn[0]  # the other one is the level over the frequency
    looks = {
        "none": "no absorber",
        "friction": "friction damper",
        "ltva_paper_wide": "tuned absorber, paper",
        "ltva_tuned_wide": "tuned absorber, well",
        "impact": "impact absorber",
    }
    for panel, number in zip(figure.axes, content["resonances"], strict=True):
        filled = bands(panel)
        for k, (concept, label) in enumerate(looks.items()):
            curve = curve_rows(tmp_path / "curves.csv", number, concept)
            if not curve:  # far from its own resonance a tuned absorber is not swept widely
                curve = curve_rows(tmp_path / "curves.csv", number, concept.removesuffix("_wide"))
            force, median, low, high = np.array(curve).T
            x, y = line(panel, label)
            np.testing.assert_allclose(x, force)
            np.testing.assert_allclose(y, 1e3 * median)
            np.testing.assert_allclose(filled[k], [force, 1e3 * low, 1e3 * high])


def test_the_gaps_card(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    options = ("--force", 3.5, "--modes", 2, "--rate", 40, "--members", 2, "--out", tmp_path)
    drawn = saved_figures(monkeypatch)
    result = done(load("design_gap", monkeypatch), *options)
    content = summary_of(tmp_path)
    best = content["recommended"]
    none = 1e3 * content["level_without_absorber_m"]
    settings = content["settings"]
    low, high = settings["sweep_limits"]
    (row,) = (r for r in read(tmp_path / "levels.csv") if float(r["gap_m"]) == best["gap_m"])
    response = {
        "at 3.5 N, median of 2 runs": f"{1e3 * best['level_m']:.4g} mm RMS",
        "90 % of further runs": f"{1e3 * best['level_5_m']:.4g} to {1e3 * best['level_95_m']:.4g} mm",
        "read at": f"{best['frequency_ratio']:.4g} of the resonance",
        "at most, 3.15 to 3.85 N": f"{1e3 * best['level_worst_m']:.4g} mm",
        "of no absorber": f"{1e5 * best['level_m'] / none:.4g} %",
        "no absorber": f"{none:.4g} mm",
        "no device in this cavity comes below": f"{1e3 * float(row['limit_m']):.4g} mm",
    }
    device = {
        "clearance to either wall": f"{1e3 * best['gap_m']:.4g} mm",
        "coefficient of restitution": f"{best['restitution']:.4g}",
        "friction limit": f"{best['friction_limit_n']:.4g} N",
    }
    expected = mass("Device", settings["mass_ratio"])
    expected |= {("Device", label): text for label, text in device.items()}
    expected |= {("Response level", label): text for label, text in response.items()}
    stroke = "stroke of the absorber, wall to wall"
    expected["What it bears", stroke] = f"{2e3 * best['gap_m']:.4g} mm"
    swept = {
        "over": f"{low:.3g} to {high:.3g} of the resonance",
        "such sweeps show of the stationary level": f"{100 * content['sweep_over_stationary_level']:.4g} %",
        "sweeps taken": f"{settings['sweeps']}, and two with impacts recorded",
        "resonance 1": f"{MODEL.omega[0] * HERTZ:.4g} Hz, damping ratio 1 %",
        "sweeps up and down at": "40 % per 100 pseudo periods",
    }
    expected |= {("Assumptions", label): text for label, text in swept.items()}
    assert best["mass_kg"] == pytest.approx(settings["mass_ratio"] * MODEL.beam_mass)
    rows = rows_of(tmp_path)
    (damper,) = (label for _, label in rows if label.startswith("best friction damper"))
    impacts = {label for heading, label in rows if heading == "What it bears"} - {stroke}
    forces = {label for heading, label in rows if heading == "Forces"}
    tuned = "best tuned absorber of this mass"
    check_rows(rows, expected, {damper, tuned, "modes kept"} | impacts | forces)
    for (_, label), text in rows.items():  # the card is printed, too
        assert f"  {label}" in result.stdout
        assert text in result.stdout
    figure = drawn[0]  # the other one is the level over the frequency
    (panel,) = figure.axes
    full = [row for row in read(tmp_path / "levels.csv") if row["members"] == "2"]
    names = ("gap_m", "level_median_m", "level_5_percent_m", "level_95_percent_m")
    gap, median, low, high = 1e3 * np.array([[float(r[name]) for name in names] for r in full]).T
    x, y = line(panel, "median of up to")
    in_curve = np.isin(np.round(x, 9), np.round(gap, 9))
    np.testing.assert_allclose([x[in_curve], y[in_curve]], [gap, median])
    np.testing.assert_allclose(bands(panel)[1][:, in_curve][1:], [low, high])
    marked = {"design rule": content["rule_gap_m"], "recommended": best["gap_m"]}
    marked["lowest level"] = content["sharp"]["gap_m"]
    for label, value in marked.items():
        np.testing.assert_allclose(line(panel, label)[0], 1e3 * value)
    worst = line(panel, "at most")
    np.testing.assert_allclose(np.ravel(worst), [1e3 * best["gap_m"], 1e3 * best["level_worst_m"]])
    single = sorted((1e3 * one["gap_m"], 1e3 * one["level_m"]) for one in content["single_runs"])
    np.testing.assert_allclose(sorted(np.array(line(panel, "one run")).T.tolist()), single)


def test_no_card_is_written_or_printed_where_none_is_wanted(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    line = ["--force", 3.5, "--modes", 2, "--rate", 40, "--members", 1, "--gaps", 3]
    command = load("design_gap", monkeypatch)
    result = done(command, *line, "--no-card", "--out", tmp_path)
    assert {file.name for file in tmp_path.iterdir()} == {
        "frequency.csv",
        "frequency.png",
        "levels.csv",
        "summary.json",
        "levels.png",
    }
    assert "What it bears" not in result.output
    assert summary_of(tmp_path)["recommended"] is not None


def test_a_band_of_one_run_is_no_interval(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    line = ["--force", 3.5, "--modes", 2, "--rate", 40, "--members", 1, "--gaps", 3]
    result = done(load("design_gap", monkeypatch), *line, "--out", tmp_path)
    table = [
        [cell.strip() for cell in row.strip("|").split("|")]
        for row in result.stdout.splitlines()
        if row.startswith("|")
    ]
    assert "5 to 95 %" in table[0][3] or "90 %" in table[0][3]
    assert {row[3] for row in table[2:]} == {"-"}
    assert {row[-1] for row in table[2:]} == {"1"}
    assert rows_of(tmp_path)["Response level", "90 % of further runs"] == "not known"
    assert summary_of(tmp_path)["recommended"]["level_5_m"] is None
    assert {row["level_5_percent_m"] for row in read(tmp_path / "levels.csv")} == {""}


def test_the_searchs_card(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    pytest.importorskip("optuna")
    monkeypatch.setattr("optimisation.space.AT_BOUND", 0.4)  # so that winners lie at bounds
    line = (*FAST, "--at", "1:3.5", "--designs", 6, "--no-figures", "--out", tmp_path)
    result = done(load("optimise_design", monkeypatch), *line)
    folder = tmp_path / "impact"
    content = summary_of(folder)
    winner = content["winner"]["values"]
    expected = mass("Winner", winner["mass_ratio"])
    units = {
        "gap": "m",
        "restitution": "",
        "friction_limit": "N",
        "position": "of the beam's length",
    }
    for name, unit in units.items():
        expected["Winner", name.replace("_", " ")] = f"{winner[name]:.4g} {unit}".rstrip()
    for name in ("winner", "paper", "rule"):
        one = content[name]
        judged = banded(one["score"][0], one["score_5_to_95_percent"][0])
        heading = "response level relative to no absorber, on fresh members"
        expected[heading, f"{name}'s design"] = judged
    (condition,) = content["conditions"]
    heading = "Resonance 1, 3.5 N"
    for name in ("winner", "paper"):
        one = condition[name]
        level = banded(
            1e3 * one["level_m"], [1e3 * x for x in one["level_5_to_95_percent_m"]], "mm"
        )
        share = f"{100 * one['relative']:.3g} % of no absorber"
        place = f"read at {one['level_frequency_ratio']:.4g} of the resonance"
        expected[heading, f"{name}'s design"] = f"{level}, {share}, {place}"
    expected[heading, "no absorber"] = f"{1e3 * condition['without_m']:.4g} mm"
    limit = f"{1e3 * condition['winner']['limit_m']:.4g} mm"
    expected[heading, "no device in this cavity comes below"] = limit
    wider = content["with_more_modes"]
    low, high = wider["change"]["95_percent"]
    change = f"{wider['change']['ratio']:.3f} ({low:.3f} to {high:.3f})"
    expected |= assumptions((1,), f"2; with {wider['modes']} {change} of its value")
    searched = f"{content['designs']} designs, {content['runs']} runs"
    expected["Assumptions", "searched"] = searched
    rows = rows_of(folder)
    baselines = {label for _, label in rows if label.startswith("best ")}
    assert len(baselines) == 2
    check_rows(rows, expected, baselines)
    warnings = json.loads((folder / "card.json").read_text())["warnings"]
    bounds = [f"the winner lies at a bound: {line}" for line in content["winner_at_bounds"]]
    assert bounds
    assert [line for line in warnings if "bound" in line] == bounds
    assert [line.strip() for line in result.stdout.splitlines() if "at a bound" in line] == bounds


def test_the_fronts_card(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    pytest.importorskip("optuna")
    drawn = saved_figures(monkeypatch)
    done(load("pareto", monkeypatch), *FAST, "--designs", 13, "--out", tmp_path)
    folder = tmp_path / "resonances"
    content = summary_of(folder)
    expected: Rows = {}
    for one in content["front"]:
        free = ("gap", "restitution", "friction_limit")
        values = ", ".join(f"{name} {one['values'][name]:.4g}" for name in free)
        scores = "{:.4g} and {:.4g}".format(*one["score"])
        expected["Front", f"design {one['number']}"] = f"{values}: {scores}"
    expected |= assumptions((1, 2), "2; more are not tried")
    searched = f"{content['designs']} designs, {content['runs']} runs"
    expected["Assumptions", "searched"] = searched
    rows = rows_of(folder)
    service_labels = {label for heading, label in rows if heading.startswith("What design")}
    levels = {label for _, label in rows if label.endswith(": levels")}
    assert len(levels) == 2
    check_rows(rows, expected, service_labels | levels)
    (figure,) = drawn
    (panel,) = figure.axes
    columns = [name for name in read(folder / "front.csv")[0] if name.startswith("level_")][:2]
    searched = [[float(row[name]) for name in columns] for row in read(folder / "front.csv")]
    np.testing.assert_allclose(np.array(line(panel, "designs of the search")).T, searched)
    every = [points.T.tolist() for points in lines(panel)]
    for name in ("score", "score_on_fresh_members"):
        assert any(
            np.allclose(points, [one[name] for one in content["front"]])
            for points in every
            if len(points) == len(content["front"])
        ), name


def test_the_tunings_card(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    pytest.importorskip("cvxpy")
    drawn = saved_figures(monkeypatch)
    done(load("tune_ltva", monkeypatch), "--modes", 2, "--out", tmp_path)
    content = summary_of(tmp_path)
    expected = mass("Assumptions", content["settings"]["mass_ratio"])
    expected |= assumptions((1,), "2; more are not tried", None)
    reference = content["tunings"]["none"]["peak_m_n"]
    for one in content["tunings"].values():
        words = (
            f"peak {100 * one['peak_relative']:.4g} % at {one['peak_frequency_ratio']:.4g}, "
            f"proved {100 * one['certified_amplitude_m_n'] / reference:.4g} %"
        )
        if one["stiffness_n_m"] is not None:
            words += f", {one['stiffness_n_m']:.6g} N/m, {one['damping_n_s_m']:.4g} N s/m"
        expected["Tunings", one["label"]] = words
    rows = rows_of(tmp_path)
    service_labels = {label for heading, label in rows if heading.startswith("What the tuning")}
    check_rows(rows, expected, service_labels)
    (figure,) = drawn
    (panel,) = figure.axes
    for key in ("none", "paper", "den_hartog", "minimax"):
        one = content["tunings"][key]
        x, y = line(panel, f"{one['label']}: peak")
        assert y.max() == pytest.approx(100 * one["peak_relative"], rel=1e-6), key
        assert y[np.argmin(np.abs(x - one["peak_frequency_ratio"]))] == y.max()
