from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numba
import pytest
from click.testing import CliRunner
from places import ROOT

from optimisation.files import write_json
from optimisation.machine import conditions
from studies import variants
from studies.cli import specialisation
from studies.specialisation import probe, results, study
from studies.study import Measured


def function(name: str, arithmetic: int = 3) -> dict[str, Any]:
    return {"name": name, "statements": 10, "arithmetic": arithmetic, "calls": 1}


def entry(absorber: str, *functions: dict[str, Any], record: str = "level", growth: float = 1.0, imported: tuple[str, ...] = ("numpy",)) -> Any:
    return {
        "absorber": absorber,
        "method": "exact",
        "record": record,
        "cold_s": 20.0,
        "cached_s": 0.2,
        "functions": list(functions),
        "instructions": 7000,
        "ns_per_period": 9000.0,
        "impacts_per_period": 2.0,
        "memory_mb": 150.0,
        "peak_kb": [100.0, 100.0 + growth],
        "imported": list(imported),
        "import_s": 0.5,
    }


def measured(**others: Any) -> results.Results:
    good = {
        "no absorber, exact": entry("no absorber", function("linear.linear_lane"), function("slots.advance")),
        "impact, exact": entry("impact", function("search.search"), function("rigid_contact.friction_force", 0), function("rigid_contact.turn", 0)),
        "impact and friction, exact": entry("impact and friction", function("search.search"), function("rigid_contact.friction_force", 1)),
        "impact, exact, level and samples recorded": entry("impact", function("rigid_contact.turn", 0), record="level and samples", growth=1e4),
    }
    pair = {
        "part": "friction (exact)",
        "without": "impact, exact",
        "switched_off": "other, exact",
        "without_ns": 5e3,
        "switched_off_ns": 9e3,
        "ratio": 1.8,
    }
    return results.Results(good | others, [pair])


def broken(values: results.Results) -> list[str]:
    return [claim.text for claim in results.claims(values) if not claim.holds]


def test_claims_hold_or_are_broken() -> None:
    assert broken(measured()) == []
    searching = entry("no absorber", function("search.search"))
    assert broken(measured(**{"no absorber, exact": searching})) == ["no absorber, exact, level: searches no events"]
    rubbing = entry("impact", function("rigid_contact.friction_force", 2))
    assert broken(measured(**{"impact, exact": rubbing})) == ["impact, exact, level: no friction arithmetic"]
    growing = entry("impact", growth=1e4)
    assert broken(measured(**{"impact, exact": growing})) == ["impact, exact, level: stores no time series"]
    loading = entry("impact", imported=("numpy", "torch"))
    assert broken(measured(**{"impact, exact": loading})) == ["importing the simulator loads no heavy package"]


def test_parts_that_save_nothing_are_named() -> None:
    values = measured()
    assert results.unreal(values) == []
    values.pairs[0]["ratio"] = 1.0
    assert results.unreal(values) == ["friction (exact)"]


def test_pairs_share_the_kernels_of_the_scenes() -> None:
    kinds = {variant.kind for variant in variants.own(quick=False)}
    for pair in variants.PAIRS:
        assert pair.without.kind in kinds
        assert pair.switched_off.kind in kinds
    assert len(variants.pairs(quick=False)) == len(variants.PAIRS)
    assert 0 < len(variants.pairs(quick=True)) < len(variants.PAIRS)


@pytest.mark.parametrize("variant", variants.OWN)
def test_scenes_can_be_built(variant: variants.Variant) -> None:
    assert variant.scene().model.modes == variants.MODES
    assert variant.drive(3.0).schedule.periods == pytest.approx(3)


def test_redraw_writes_figure_and_page(tmp_path: Path) -> None:
    write_json(tmp_path / "specialisation.json", study.STUDY.pack("specialisation", Measured(vars(measured()), conditions() | {"quick": True})))
    outcome = CliRunner().invoke(specialisation.main, ["--redraw", "--out", str(tmp_path)])
    assert outcome.exit_code == 0, outcome.output
    text = (tmp_path / "specialisation.md").read_text()
    assert "Every part left out saves time." in text
    assert "| friction (exact) |" in text
    assert (tmp_path / "specialisation.png").read_bytes().startswith(b"\x89PNG")
    values = json.loads((tmp_path / "specialisation.json").read_text())
    values["own"]["no absorber, exact"]["functions"].append(function("search.search"))
    (tmp_path / "specialisation.json").write_text(json.dumps(values))
    outcome = CliRunner().invoke(specialisation.main, ["--redraw", "--out", str(tmp_path)])
    assert outcome.exit_code == 1
    assert "BROKEN  no absorber, exact, level: searches no events" in outcome.output


@numba.njit
def rub(limit: float | None, x: float) -> float:
    if limit is None:
        return 0.0
    return -limit * x


@numba.njit
def fly(limit: float | None, x: float) -> float:
    return x + rub(limit, x)


@pytest.mark.parametrize(("limit", "operations"), [(None, {"fly": 1, "rub": 0}), (2.0, {"fly": 1, "rub": 2})])
def test_what_is_absent_is_not_in_the_compiled_code(limit: float | None, operations: dict[str, int]) -> None:
    fly(limit, 1.0)
    (signature,) = (args for args in fly.signatures if (args[0] == numba.none) == (limit is None))
    kernel = SimpleNamespace(signatures=[signature], overloads=fly.overloads, py_func=fly.py_func)
    found = probe.functions(kernel)
    assert {entry["name"].partition(".")[2]: entry["arithmetic"] for entry in found} == operations
    assert probe.instructions(kernel) > 2


def test_an_import_of_the_simulator_is_light() -> None:
    code = "import runpy, sys; print(sorted(runpy.run_path(sys.argv[1], run_name='probe')['IMPORTED']))"
    loaded = subprocess.run([sys.executable, "-P", "-c", code, results.PROBE], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    assert "'numba'" in loaded
    assert not [name for name in results.HEAVY if f"'{name}'" in loaded]


@pytest.mark.parametrize(("arguments", "words"), [(["--redraw", "--out", "{tmp}"], "--redraw"), (["--out", "{tmp}/file/folder"], "--out")])
def test_bad_input(arguments: list[str], words: str, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    outcome = CliRunner().invoke(specialisation.main, [argument.format(tmp=tmp_path) for argument in arguments])
    assert outcome.exit_code == 2
    assert words in outcome.output
