"""The script that measures error against run time: a tiny run of each part."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

pytest.importorskip("mpmath")
from impact_env import Exact, Moreau
from optimisation.files import read_json
from studies.accuracy import cost, jumps, study, trajectory
from studies.accuracy.bands import between_groups
from studies.accuracy.cases import Settings
from studies.accuracy.distribution import bootstrap, distance_at_size, mean_difference, relative_distance
from studies.cli import error_vs_runtime

TINY = Settings(
    quick=True, modes=(1,), kinds=("impact, e = 1",), steps=(20, 200), scipy_tolerances=(1e-6,), heyoka_tolerances=(1e-9,), starts=2, repeats=1,
    timed_seconds=0.001, sweep=(0.95, 0.952), sweep_steps=(20,), truth_members=6, members=4, band_members=4, band_phases=2, band_repeats=2,
    stretches=30, twins=2, jump_rates=(2.0, 4.0), jump_steps=(20,), jump_members=3, cost_modes=(1, 2), cost_lanes=(1, 2), cost_periods=(5, 10),
)  # fmt: skip


def call(*arguments: object) -> Result:
    return CliRunner().invoke(error_vs_runtime.main, [str(argument) for argument in arguments])


@pytest.mark.nightly
def test_trajectories_show_who_is_exact() -> None:
    (measure,) = trajectory.cases(TINY).values()
    rows = measure()
    by_name = {(row["method"], row["setting"]): row for row in rows}
    assert not any(row["note"] for row in rows)
    assert by_name["Exact", None]["state_error"] < 1e-9
    assert by_name["Exact", None]["first_impact_error_periods"] < 1e-13
    assert 1e-6 < by_name["Moreau", 200]["first_impact_error_periods"] < by_name["Moreau", 20]["first_impact_error_periods"] < 0.1
    assert by_name["SciPy", 1e-6]["state_error"] < by_name["Moreau", 20]["state_error"]
    assert all(row["us_per_period"] > 0 and row["balance_error"] < 0.1 for row in rows)
    assert {trajectory.key(row) for row in rows} == set(trajectory.cases(TINY))


def test_shares_count_the_high_branch() -> None:
    shared = {"periods_per_percent": 100.0, "method": "Exact", "setting": None}
    levels = (0.5e-3, 0.52e-3, 0.8e-3, 1.0e-3)
    (share,) = jumps.shares([{**shared, "member": k, "level_m": level} for k, level in enumerate(levels)])
    assert (share.hits, share.runs, share.between, share.share) == (2, 4, 1, 0.5)
    assert share.interval() == pytest.approx((0.1500, 0.8500), abs=1e-4)  # Wilson's


@pytest.fixture
def tiny(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(error_vs_runtime, "QUICK", TINY)
    monkeypatch.setattr(cost, "OVER_MODES", (("impact, e = 1", Exact()), ("impact, e = 1", Moreau())))
    monkeypatch.setattr(cost, "LANE_PERIODS", 2.0)


@pytest.mark.nightly
@pytest.mark.usefixtures("tiny")
def test_tiny_run_writes_files_figures_and_page(tmp_path: Path) -> None:
    out, page = tmp_path / "study", tmp_path / "study.md"
    page.write_text("".join(f"text\n<!-- {name} -->\nold\n<!-- /{name} -->\n" for name in study.PARTS))
    result = call("--quick", "--out", out)
    assert result.exit_code == 0, result.output
    for name in study.PARTS:
        content = read_json(out / f"{name}.json.gz")
        assert content["complete"]
        assert content["quick"]
        assert content["versions"]["numba"]
        assert content["machine"]
        assert len(content["rows"]) > 0
    figures = {"trajectory_error", "energy_balance", "main", "distribution", "growth", "jumps", "cost"}
    assert {file.stem for file in out.glob("*.png")} == figures
    text = page.read_text()
    assert "old" not in text
    assert text.count("| ") > 50
    assert text.count("A quick look") == len(study.PARTS)

    (out / "jumps.png").unlink()
    (out / "cost.json.gz").unlink()
    before = (out / "jumps.json.gz").read_bytes()
    again = call("--redraw", "--out", out)
    assert again.exit_code == 0, again.output
    assert (out / "jumps.png").stat().st_size > 1000
    assert (out / "jumps.json.gz").read_bytes() == before
    assert page.read_text() == text


# --- one scene anew ----------------------------------------------------------------------------------------------------------------------------


# --- statistics --------------------------------------------------------------------------------------------------------------------------------


def test_distances_of_shifted_samples() -> None:
    sample = np.random.default_rng(1).normal(3.0, 0.2, 500)
    assert relative_distance(sample + 0.3, sample) == pytest.approx(0.3 / sample.mean())
    assert mean_difference(1.1 * sample, sample) == pytest.approx(0.1)
    low, high = bootstrap(mean_difference, 1.1 * sample, sample)
    assert 0.08 < low < 0.1 < high < 0.12


def test_more_runs_come_closer_to_the_truth_down_to_the_bias() -> None:
    truth = np.random.default_rng(2).normal(1.0, 0.1, 4000)
    right = [distance_at_size(truth, truth, size) for size in (1, 4, 16, 64)]
    wrong = [distance_at_size(truth + 0.2, truth, size) for size in (1, 4, 16, 64)]
    assert all(a > 1.5 * b for a, b in pairwise(right))
    assert wrong[-1] == pytest.approx(0.2, rel=0.05)
    with pytest.raises(ValueError, match="size"):
        distance_at_size(truth, truth, 0)


def test_share_between_groups_is_that_of_the_model() -> None:
    generator = np.random.default_rng(4)
    groups = 0.5 * generator.normal(size=(400, 1)) + generator.normal(size=(400, 20))
    share, low, high = between_groups(groups)
    assert share == pytest.approx(0.2, abs=0.03)  # 0.25 / (0.25 + 1)
    assert low < 0.2 < high
    assert high - low < 0.08
    assert abs(between_groups(generator.normal(size=(400, 20)))[0]) < 0.02
    # six ratings of four judges, table 2 of Shrout and Fleiss: ICC(1,1) = 0.17
    ratings = [[9, 2, 5, 8], [6, 1, 3, 2], [8, 4, 6, 8], [7, 1, 2, 6], [10, 5, 6, 9], [6, 2, 4, 7]]
    assert between_groups(ratings)[0] == pytest.approx(0.17, abs=0.005)
    with pytest.raises(ValueError, match="groups"):
        between_groups([[1.0, 2.0]])
