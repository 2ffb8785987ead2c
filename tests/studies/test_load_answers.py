"""The study of loads is correct.

Two tones without contact superpose, written numbers are those that are printed, and pages can be
written again from the files.
"""

from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from commands import call
from drawing import line, lines, saved_figures

from impact_env.ensemble import Lane
from impact_env.parameters import impact_absorber
from impact_env.scene import Scene
from optimisation.files import read_json
from optimisation.signals import band_levels
from optimisation.tuned.under_loads import expected_rms, tune_for_loads
from studies import load_spectra
from studies.cli import load_answers
from studies.cli.load_answers import both_rows, both_text, main, orders
from studies.load_figures import FIGURES
from studies.load_spectra import (
    CASES,
    SpectrumSettings,
    random_rows,
    random_text,
    shock_rows,
    shock_text,
)

CASE = CASES["cantilever"]


def test_bands_of_two_orders_superpose() -> None:
    """Bands of two orders superpose.

    Without contact each band has the response to its own order, and the higher one is proportional
    to its force.
    """
    each = [band_levels(Lane(Scene(CASE.model), orders(CASE, share))) for share in (0.0, 0.1, 1.0)]
    assert each[1][1] == pytest.approx(0.1 * each[2][1], rel=0.02)
    assert each[0][0] == pytest.approx(each[2][0], rel=1e-3)
    assert each[0][1] < 1e-3 * each[2][1]
    wide = Scene(CASE.model, impact_absorber(1.0))
    assert band_levels(Lane(wide, orders(CASE, 1.0))) == pytest.approx(each[2], rel=1e-9)


def test_an_absorber_at_the_node_is_left_alone_by_the_second_mode() -> None:
    for case in CASES.values():
        assert abs(case.at(case.node).tip_shape[1]) < 1e-6 * abs(case.model.tip_shape[1])
        np.testing.assert_allclose(
            np.abs(case.at(case.node).level_shape), np.abs(case.model.tip_shape)
        )  # signs of modes are free


def smaller(module: ModuleType, monkeypatch: pytest.MonkeyPatch, **values: object) -> None:
    for name, value in values.items():
        monkeypatch.setattr(module, name, value)


def test_rows_of_both_resonances_are_printed_and_drawn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    groups = {name: load_answers.GROUPS[name] for name in ("share", "gap")}
    own = {
        "SHARES": (0.0, 1.0),
        "GAP_FACTORS": (2.0, 100.0),
        "REMEDIED": (1.0,),
        "LIMITS": (0.97, 1.0),
    }
    smaller(load_answers, monkeypatch, GROUPS=groups, CASES={"cantilever": CASE}, **own)
    rows = [row for group in groups for row in both_rows(CASE, group, SpectrumSettings(2, False))]
    assert rows[0]["higher"] is None
    assert rows[3]["lower"] == pytest.approx(
        [1.0, 1.0, 1.0], abs=0.01
    )  # no wall is touched in so wide a cavity, and phases matter little
    assert rows[4]["judged"] == 2
    assert (
        rows[4]["lower"] != rows[2]["lower"][:2]
    )  # other members than those that it was chosen by
    best = f"gap 2 mm, best of 2 | {np.median(rows[4]['lower']):.2f}"
    assert best in " ".join(both_text(rows).split())
    drawn = saved_figures(monkeypatch)
    FIGURES["loads_both"](tmp_path / "both.png", rows)
    left, right = drawn[0].axes
    shares = [row for row in rows if row["group"] == "share"]
    over_gap = [row["free_over_gap"][1] for row in shares]
    medians = [float(np.median(row["lower"])) for row in shares]
    np.testing.assert_allclose(line(left, "lower resonance"), [over_gap, medians])
    best = np.median(rows[4]["lower"]), np.median(rows[4]["higher"])
    assert any(np.allclose(points.T, best) for points in lines(right) if points.shape == (2, 1))


def test_random_loads_are_printed_and_drawn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Results under random loads are printed and drawn.

    The level with a tuned absorber follows from the sum over lines. Distant walls have no effect,
    and close ones reduce the level.
    """
    smaller(load_spectra, monkeypatch, PERIODS=400.0, GAPS=np.array([1.5, 100.0]), SHIFTS=(0.0,))
    (row,) = random_rows(CASE, 0, SpectrumSettings(3, False))
    loads = load_spectra._random(CASE.model, "wide")
    (wide,) = loads.parts
    expected = expected_rms(
        CASE.model, tune_for_loads(CASE.model, 0.02, [loads]), wide
    ) / expected_rms(CASE.model, None, wide)
    assert np.median(row["tuned"]) == pytest.approx(expected, rel=0.15)  # of three records
    assert row["impact"][1] == pytest.approx([1.0, 1.0, 1.0], abs=1e-6)
    assert np.median(row["impact"][0]) < 0.8
    assert f"{np.median(row['shifted']['0']['impact']):.2f}" in random_text([row])
    FIGURES["loads_random"](tmp_path / "random.png", [row])


def test_shocks_are_printed_and_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(load_spectra, "PEAKS", (0.5, 2.0))
    rows = shock_rows(CASE, 0.5, SpectrumSettings(3, False))
    assert rows[1]["peak_n"] == pytest.approx(4 * rows[0]["peak_n"])
    assert rows[0]["tuned"] == pytest.approx(rows[1]["tuned"], rel=1e-6)  # linear
    assert np.median(rows[1]["decay"]) < 0.9
    assert all(share is None or 0 <= share <= 1 for row in rows for share in row["high_share"])
    assert "0.5 periods" in shock_text(rows)
    FIGURES["loads_shock"](tmp_path / "shock.png", rows)


def test_the_command_from_runs_to_pages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    smaller(load_answers, monkeypatch, FACTORS=(0.8,), CASES={"cantilever": CASE})
    page = tmp_path / "load_findings.md"
    page.write_text(
        "".join(
            f"<!-- {part.name} -->\n<!-- /{part.name} -->\n" for part in load_answers.STUDY.parts
        )
    )
    options = [
        "--only",
        "loads_gravity",
        "--only",
        "loads_start",
        "--members",
        1,
        "--out",
        tmp_path,
    ]
    result = call(main, *options)
    assert result.exit_code == 0, result.output
    rows = read_json(tmp_path / "loads_start.json.gz")["rows"]
    assert {row["start"] for row in rows} == {"middle", "lower-wall", "bouncing"}
    assert rows[0]["down"] != rows[0]["ratio"]
    assert f"{np.median(rows[0]['ratio']):.2f}" in page.read_text()
    before = page.read_text()
    page.write_text(before.replace(f"{np.median(rows[0]['ratio']):.2f}", ""))
    again = call(main, *options, "--redraw")
    assert again.exit_code == 0, again.output
    assert page.read_text() == before
    assert (tmp_path / "loads_start.png").stat().st_size > 1000
