"""Whatever is handed in to what is public: refused by name, or right."""

import inspect
import warnings
from pathlib import Path
from typing import Any

import handed_in
import pytest

import impact_env
from impact_env import CoulombFriction
from impact_env.curve import CurveCase, performance_curve
from impact_env.drive import default_rate
from impact_env.ensemble import Lane, Members, draw_members, run_lanes
from impact_env.envs.settings import Settings
from impact_env.level import response_level

MADE_BY_RUNS = ("Compilation", "PerformanceCurve", "Preparation", "Response", "IntegrationError", "ParameterError", "Stopped", "StructureWarning")
ELSEWHERE = ("Stop", "curve_passes", "is_ready", "prepare", "evaluate", "__version__")  # test_stop_and_passes.py, test_evaluation.py
MORE = {
    make.__name__: make for make in (CurveCase, Lane, Members, default_rate, draw_members, performance_curve, response_level, run_lanes, Settings)
}
PUBLIC = {name: getattr(impact_env, name) for name in impact_env.__all__ if name not in MADE_BY_RUNS + ELSEWHERE} | MORE
OWN: dict[str, dict[str, Any]] = {
    "Beam": {"modes": 2, "elements": 4},
    "SlidingAbsorber": {"friction": CoulombFriction(0.1)},
    "load_structure": {"path": Path(__file__).parents[2] / "docs" / "examples" / "steel_beam.toml"},
    "Window": {"start": 0.0, "end": 1.0},
    "run_lanes": {"lanes": [Lane(handed_in.SCENE, handed_in.DRIVE)]},
}
DEAR = ("performance_curve", "run_lanes")


@pytest.mark.parametrize("name", PUBLIC)
def test_whatever_is_handed_in_is_refused_by_name_or_right(name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of numpy, where numbers are extreme
        found = list(handed_in.complaints(name, PUBLIC[name], OWN.get(name, {}), dear=name in DEAR))
    assert not [problem for problem in found if problem is not None]
    assert len(found) >= len(handed_in.VALUES) / 2 * len(inspect.signature(PUBLIC[name]).parameters)
