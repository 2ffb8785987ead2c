"""Every part of the findings works from studies to figures and page.

Redrawing, and the energy balance of the friction damper, are tested too.
"""

from pathlib import Path

import numpy as np
import pytest
from commands import call, load

pytest.importorskip("optuna")
pytest.importorskip("cmaes")

from impact_env import Beam, modal_model
from optimisation.absorber_rules import best_friction
from optimisation.checkpoint import peak_memory
from optimisation.files import read_json
from optimisation.problem import Problem
from optimisation.space import VARIABLES
from studies.study import from_file_content

PARTS = ("concepts", "optima", "place", "robustness", "front", "scaling", "full")
PAGE = "# Findings\n" + "".join(
    f"<!-- findings:{part} -->\n<!-- /findings:{part} -->\n" for part in PARTS
)


@pytest.mark.nightly  # 25 s of the processor
def test_parts_write_numbers_figures_and_page(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    findings = load("findings", monkeypatch)
    from studies import study as pattern
    from studies.findings import parts

    def small(
        self: object,
        concept: str,
        at: object,
        free: object = None,
        bounds: object = None,
        members: int | None = None,
    ) -> Problem:
        space = parts.design_space(concept, free, bounds)
        conditions = parts.make_conditions(concept, list(at))
        return Problem(
            space, conditions, beam=Beam(modes=2), members=members or self.members, rate=40.0
        )

    monkeypatch.setattr(parts.FindingsSettings, "problem", small)
    for name, value in (
        ("QUICK_DESIGNS", 4),
        ("QUICK_POINTS", 3),
        ("JOURNALS", tmp_path / "journals"),
    ):
        monkeypatch.setattr(findings, name, value)
    monkeypatch.setattr(pattern, "DOCS", tmp_path / "docs")
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "findings.md").write_text(PAGE)
    # which other tests have filled
    chosen = [part for part in PARTS if part != "scaling"]
    before = peak_memory()
    run = call(
        findings,
        "--quick",
        "--out",
        tmp_path,
        *[word for part in chosen for word in ("--part", part)],
    )
    assert run.exit_code == 0, run.output
    data = tmp_path / "findings"
    page = (tmp_path / "findings.md").read_text()
    result = {
        part: from_file_content(dict(read_json(data / f"{part}.json.gz"))).values for part in chosen
    }
    assert all((data / f"{part}.png").read_bytes().startswith(b"\x89PNG") for part in chosen[:-1])
    assert all(f"\n| {concept} " in page for concept in VARIABLES)
    assert set(result["concepts"]) == set(VARIABLES)
    assert page.count("| resonance 1") == 2
    assert len(result["robustness"]["designs"]) == 2 * len(VARIABLES) + 1
    full = result["full"]
    assert full["designs"] == 41
    assert 0 <= full["overhead"] < 1
    assert before <= full["memory_bytes"] < before + 2**31
    (data / "optima.png").unlink()
    again = call(findings, "--redraw", "--out", tmp_path, "--part", "optima")
    assert again.exit_code == 0, again.output
    assert (data / "optima.png").exists()
    assert (tmp_path / "findings.md").read_text() == page


def test_energy_argument_scales_and_balances() -> None:
    model = modal_model(Beam(modes=3))
    mass = 0.02 * model.beam_mass
    limit, level = best_friction(model, mass, 3.5)
    twice = best_friction(model, mass, 7.0)
    assert twice == pytest.approx((2 * limit, 2 * level))
    omega, tip, at_force, damping = (
        float(x[0]) for x in (model.omega, model.tip_shape, model.force_shape, model.damping_ratio)
    )
    square = omega**2 / (1 + mass * tip**2 / 2)
    q = np.sqrt(2) * level
    relative = np.sqrt(q**2 - (4 * limit / np.pi / (mass * square)) ** 2)
    assert relative == pytest.approx(q / np.sqrt(2))
    lost = 4 * limit * relative + 2 * np.pi * damping * square * (q / tip) ** 2
    assert np.pi * 3.5 * at_force / tip * q == pytest.approx(lost)  # work of the force in a cycle
