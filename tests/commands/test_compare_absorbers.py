import contextlib
import json
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from commands import call, read

from impact_env import Beam
from optimisation.cli import compare_absorbers
from optimisation.comparison import FORCE_SPAN, IMPACT, LTVA_PAPER, NONE, Comparison, compare, force_grid
from optimisation.files import replacing, require_writable, write_csv, write_json
from optimisation.report.comparison_tables import CURVE_COLUMNS, RUN_COLUMNS, summary
from optimisation.tuned import den_hartog

FILES = {"runs.csv", "curves.csv", "summary.json", "comparison.png", "card.html", "card.json"}
KEYS = ["none", "impact", "friction", "ltva_paper", "ltva_tuned", "ltva_paper_wide", "ltva_tuned_wide"]
small = partial(compare, Beam(modes=2), percent_per_100_periods=40.0)  # fast: the numbers do not matter here


@pytest.fixture(scope="module", autouse=True)
def quickly_tuned() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("optimisation.comparison.minimax", den_hartog)  # in closed form, and as good here
        yield


@pytest.fixture(scope="module")
def study() -> Comparison:
    return small(forces=4, members=3, seed=1)


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.setattr("optimisation.cli.compare_absorbers.compare", small)
    return compare_absorbers


def test_forces_cover_the_range_and_gather_at_the_design_force() -> None:
    forces = force_grid(3.5, 24)
    assert len(forces) == 24
    assert forces[[0, -1]] == pytest.approx(3.5 * np.array(FORCE_SPAN))
    assert np.all(np.diff(forces) > 0)
    assert np.sum((forces > 1.75) & (forces < 5.6)) >= 9


def test_study_holds_every_concept_near_both_resonances(study: Comparison) -> None:
    assert study.complete
    assert [part.resonance for part in study.resonances] == [1, 2]
    for part in study.resonances:
        assert list(part.curves) == KEYS == [concept.key for concept in study.concepts]
        assert all(curve.level.shape == (4, 3, 2) for curve in part.curves.values())
        assert part.limit.shape == (4,)
        assert part.limit[0] == 0
        np.testing.assert_allclose(part.curves[NONE].median / part.forces, part.curves[NONE].median[0] / part.forces[0])
    assert study.resonances[0].design_force < study.resonances[1].design_force


def test_summary_names_optimum_and_parameters(study: Comparison) -> None:
    content = json.loads(json.dumps(summary(study), allow_nan=False))
    assert content["complete"] is True
    part = content["resonances"]["1"]
    assert list(part["concepts"]) == KEYS
    impact, tuned = part["concepts"][IMPACT], part["concepts"][LTVA_PAPER]
    assert impact["absorber"] == {"mass_ratio": 0.02, "walls": {"gap": 1e-3, "restitution": 0.7}, "friction": {"limit": 0.1}, "gravity": 0.0}
    assert impact["optimum"]["force_n"] in part["forces_n"]
    low, high = impact["optimum"]["relative_5_to_95_percent"]
    assert 0 < low <= impact["optimum"]["relative_to_no_absorber"] <= high < 1
    assert tuned["absorber"] == {"mass_ratio": 0.02, "stiffness": 701.8, "damping": 0.728, "gravity": 0.0}
    assert tuned["optimum"]["force_n"] is None
    assert tuned["at_best_force_of_impact_absorber"]["force_n"] == impact["optimum"]["force_n"]
    assert part["concepts"]["friction"]["absorber"] == {"mass_ratio": 0.02, "friction": {"limit": 0.5}, "gravity": 0.0}


def test_quick_look_writes_all_files(script: ModuleType, tmp_path: Path) -> None:
    result = call(script, "--quick", "--seed", 4, "--out", tmp_path / "new" / "folder")
    assert result.exit_code == 0, result.output
    out = tmp_path / "new" / "folder"
    assert {file.name for file in out.iterdir()} == FILES
    assert (out / "comparison.png").read_bytes().startswith(b"\x89PNG")
    content = json.loads((out / "summary.json").read_text())
    assert {"versions", "threads", "wall_s", "complete", "settings", "resonances"} <= set(content)
    assert content["settings"] | {"members": 2, "seed": 4} == content["settings"]
    assert len(content["resonances"]["2"]["forces_n"]) == 10
    assert tuple(read(out / "runs.csv")[0]) == RUN_COLUMNS
    assert tuple(read(out / "curves.csv")[0]) == CURVE_COLUMNS
    assert "impact absorber" in result.stdout


def test_files_are_whole_or_absent(tmp_path: Path) -> None:
    write_csv(tmp_path / "a.csv", ["x", "y"], [[1, 0.1], [2, ""]])
    assert (tmp_path / "a.csv").read_text() == "x,y\n1,0.1\n2,\n"

    def rows() -> object:
        yield [1, 2]
        raise RuntimeError

    for write in (lambda: write_csv(tmp_path / "a.csv", ["x"], rows()), lambda: write_json(tmp_path / "a.json", [float("nan")])):
        with pytest.raises((RuntimeError, ValueError)):
            write()
    with contextlib.suppress(OSError), replacing(tmp_path / "b.txt") as temporary:
        temporary.write_text("half")
        raise OSError("disk full")
    assert [file.name for file in tmp_path.iterdir()] == ["a.csv"]
    assert (tmp_path / "a.csv").read_text() == "x,y\n1,0.1\n2,\n"
    with pytest.raises(ValueError, match="--out"):
        require_writable("--out", tmp_path / "a.csv" / "under")
