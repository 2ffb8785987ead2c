"""The study of error against run time: a tiny run of each part, and its statistics."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from commands import call

pytest.importorskip("mpmath")
from impact_env import Exact, Moreau
from optimisation.files import read_json
from studies.accuracy import cost, jumps, trajectory
from studies.accuracy.bands import between_groups
from studies.accuracy.cases import AccuracySettings
from studies.accuracy.distribution import (
    bootstrap,
    distance_at_size,
    mean_difference,
    relative_distance,
)
from studies.cli import error_vs_runtime

TINY = AccuracySettings(
    quick=True,
    modes=(1,),
    kinds=("impact, e = 1",),
    steps=(20, 200),
    scipy_tolerances=(1e-6,),
    heyoka_tolerances=(1e-9,),
    starts=2,
    repeats=1,
    timed_seconds=0.001,
    sweep=(0.95, 0.952),
    sweep_steps=(20,),
    truth_members=6,
    members=4,
    band_members=4,
    band_phases=2,
    band_repeats=2,
    stretches=30,
    twins=2,
    jump_rates=(2.0, 4.0),
    jump_steps=(20,),
    jump_members=3,
    cost_modes=(1, 2),
    cost_lanes=(1, 2),
    cost_periods=(5, 10),
)


def test_a_tiny_run_shows_who_is_exact_and_writes_files_figures_and_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(error_vs_runtime, "QUICK", TINY)
    monkeypatch.setattr(
        cost, "OVER_MODES", (("impact, e = 1", Exact()), ("impact, e = 1", Moreau()))
    )
    monkeypatch.setattr(cost, "LANE_PERIODS", 2.0)
    out = tmp_path / "study"
    page = tmp_path / "study.md"
    page.write_text(
        "".join(
            f"text\n<!-- {name} -->\nold\n<!-- /{name} -->\n" for name in error_vs_runtime.PARTS
        )
    )
    result = call(error_vs_runtime, "--quick", "--out", out)
    assert result.exit_code == 0, result.output
    contents = {name: read_json(out / f"{name}.json.gz") for name in error_vs_runtime.PARTS}
    for content in contents.values():
        assert content["complete"]
        assert content["conditions"]["quick"]
        assert content["conditions"]["versions"]["numba"]
        assert len(content["rows"]) > 0
    assert {file.stem for file in out.glob("*.png")} == {
        "trajectory_error",
        "energy_balance",
        "main",
        "distribution",
        "growth",
        "jumps",
        "cost",
    }
    text = page.read_text()
    assert "old" not in text
    assert text.count("| ") > 50
    assert text.count("A quick look") == len(error_vs_runtime.PARTS)

    rows = contents["trajectory"]["rows"]
    by_name = {(row["method"], row["setting"]): row for row in rows}
    first = {name: row["first_impact_error_periods"] for name, row in by_name.items()}
    assert not any(row["note"] for row in rows)
    assert by_name["Exact", None]["state_error"] < 1e-9
    assert first["Exact", None] < 1e-13
    assert 1e-6 < first["Moreau", 200] < first["Moreau", 20] < 0.1
    assert by_name["SciPy", 1e-6]["state_error"] < by_name["Moreau", 20]["state_error"]
    assert all(row["us_per_period"] > 0 and row["balance_error"] < 0.1 for row in rows)
    assert {trajectory.key(row) for row in rows} == set(trajectory.cases(TINY))

    (out / "jumps.png").unlink()
    (out / "cost.json.gz").unlink()
    again = call(error_vs_runtime, "--redraw", "--out", out)
    assert again.exit_code == 0, again.output
    assert (out / "jumps.png").stat().st_size > 1000
    assert page.read_text() == text


def test_shares_count_the_high_branch() -> None:
    shared = {"periods_per_percent": 100.0, "method": "Exact", "setting": None}
    (share,) = jumps.shares(
        [{**shared, "level_m": level} for level in (0.5e-3, 0.52e-3, 0.8e-3, 1.0e-3)]
    )
    assert (share.hits, share.runs, share.between) == (2, 4, 1)
    assert share.interval() == pytest.approx((0.1500, 0.8500), abs=1e-4)  # Wilson's


def test_distances_of_shifted_samples() -> None:
    sample = np.random.default_rng(1).normal(3.0, 0.2, 500)
    assert relative_distance(sample + 0.3, sample) == pytest.approx(0.3 / sample.mean())
    assert mean_difference(1.1 * sample, sample) == pytest.approx(0.1)
    low, high = bootstrap(mean_difference, 1.1 * sample, sample)
    assert 0.08 < low < 0.1 < high < 0.12


def test_more_runs_come_closer_to_the_truth_down_to_the_bias() -> None:
    truth = np.random.default_rng(2).normal(1.0, 0.1, 4000)
    right, wrong = (
        [distance_at_size(truth + bias, truth, size) for size in (1, 4, 16, 64)]
        for bias in (0, 0.2)
    )
    assert all(a > 1.5 * b for a, b in pairwise(right))
    assert wrong[-1] == pytest.approx(0.2, rel=0.05)


def test_share_between_groups_is_that_of_the_model() -> None:
    generator = np.random.default_rng(4)
    share, low, high = between_groups(
        0.5 * generator.normal(size=(400, 1)) + generator.normal(size=(400, 20))
    )
    assert share == pytest.approx(0.2, abs=0.03)  # 0.25 / (0.25 + 1)
    assert low < 0.2 < high < low + 0.08
    assert abs(between_groups(generator.normal(size=(400, 20)))[0]) < 0.02
    # six ratings of four judges, table 2 of Shrout and Fleiss: ICC(1,1) = 0.17
    ratings = [[9, 2, 5, 8], [6, 1, 3, 2], [8, 4, 6, 8], [7, 1, 2, 6], [10, 5, 6, 9], [6, 2, 4, 7]]
    assert between_groups(ratings)[0] == pytest.approx(0.17, abs=0.005)
