"""A kernel that another process compiles is loaded from there, or compiled here if that fails; and validations of orbits use the kernel meant."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from places import ROOT, SUPPORT

from impact_env import Beam
from impact_env.kernels.exact.rigid import exact_lane
from impact_env.modes import modal_model
from impact_env.periodic.case import Case
from impact_env.periodic.survey import orbits_over
from impact_env.periodic.validation import shortest_validation


@pytest.mark.parametrize(
    ("way", "first", "again"),
    [("well", "False 1 1 0 None True", "True 0 1 0 None True"), ("badly", "False 1 0 0 None True", ""), ("alone", "False 0 0 0 None True", "")],
)
def test_a_kernel_comes_from_the_other_process_or_else_from_here(tmp_path: Path, way: str, first: str, again: str) -> None:
    environment = os.environ | {"PYTHONPATH": str(ROOT), "IMPACT_ENV_CACHE": str(tmp_path)}
    for told in (first, again) if again else (first,):
        words = [sys.executable, str(SUPPORT / "beside.py"), way]
        done = subprocess.run(words, env=environment, capture_output=True, text=True, timeout=120)
        assert done.stdout.strip() == told, done.stderr
        assert all(line.startswith("impact_env: compiling ") for line in done.stderr.splitlines())


def test_the_shortest_trial_has_the_kernels_of_trials() -> None:
    model = modal_model(Beam(modes=2))
    case = Case(model, 0.95 * float(model.omega[0]), 1.5, friction_limit=0.01)
    shortest_validation(case)
    known = list(exact_lane.signatures)  # type: ignore[attr-defined]
    assert any(found.orbits for found in orbits_over(case, [0.95, 0.96]))
    assert exact_lane.signatures == known  # type: ignore[attr-defined]
