"""What each scene leaves out: absent parts are pruned from the compiled code, and the page says which claims the numbers bear out."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numba
import pytest
from commands import call

from optimisation.files import write_json
from optimisation.machine import conditions
from studies import probe
from studies.cli import specialisation
from studies.study import Measured


def entry(absorber: str, *functions: tuple[str, int], record: str = "level", growth: float = 1.0) -> dict[str, Any]:
    """Return a variant whose compiled code has these functions and as many arithmetic operations in each."""
    code = {"functions": [{"name": name, "arithmetic": arithmetic} for name, arithmetic in functions], "instructions": 7000}
    times = {"cold_s": 20.0, "cached_s": 0.2, "ns_per_period": 9000.0, "impacts_per_period": 2.0}
    memory = {"memory_mb": 150.0, "peak_kb": [100.0, 100.0 + growth]}
    return {"absorber": absorber, "method": "exact", "record": record} | code | times | memory


def measured(ratio: float = 1.8, **others: Any) -> specialisation.Results:
    good = {
        "no absorber, exact": entry("no absorber", ("linear.linear_lane", 3)),
        "impact, exact": entry("impact", ("search.search", 3), ("rigid_contact.friction_force", 0)),
        "impact and friction, exact": entry("impact and friction", ("rigid_contact.friction_force", 1)),
        "impact, exact, level and samples recorded": entry("impact", ("rigid_contact.turn", 0), record="level and samples", growth=1e4),
    }
    names = {"part": "friction (exact)", "without": "impact, exact", "switched_off": "other, exact"}
    return specialisation.Results(good | others, [names | {"without_ns": 5e3, "switched_off_ns": ratio * 5e3, "ratio": ratio}])


@pytest.mark.parametrize(
    ("name", "found", "broken"),
    [
        ("no absorber, exact", entry("no absorber", ("search.search", 3)), "no absorber, exact, level: searches no events"),
        ("impact, exact", entry("impact", ("rigid_contact.friction_force", 2)), "impact, exact, level: no friction arithmetic"),
        ("impact, exact", entry("impact", growth=1e4), "impact, exact, level: stores no time series"),
    ],
)
def test_claims_hold_or_are_broken_and_the_page_says_so(name: str, found: dict[str, Any], broken: str, tmp_path: Path) -> None:
    def redrawn(values: specialisation.Results) -> Any:
        write_json(
            tmp_path / "specialisation.json.gz", specialisation.STUDY.pack("specialisation", Measured(vars(values), conditions() | {"quick": True}))
        )
        return call(specialisation, "--redraw", "--out", tmp_path)

    assert redrawn(measured()).exit_code == 0
    page = (tmp_path / "specialisation.md").read_text()
    assert "Every part left out saves time." in page
    assert "| friction (exact) |" in page
    again = redrawn(measured(1.0, **{name: found}))
    assert again.exit_code == 1
    assert [line.split("  ")[1].rpartition(":")[0] for line in again.output.splitlines() if line.startswith("BROKEN")] == [broken]
    assert "Left out without a saving of 2 % or more: friction (exact)." in (tmp_path / "specialisation.md").read_text()


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
