"""The study of machines that differ from what their control takes them for."""

from dataclasses import replace
from typing import Any

import pytest

gymnasium = pytest.importorskip("gymnasium")

from impact_env.envs.evaluation import SEED_SPLITS
from optimisation.rl.agents import load_agent
from optimisation.rl.rules import CONSTANT, EIGHT, policies
from studies.cli import real_controller as study
from studies.study import Measurement

TASK = "ActiveFriction-v0"
EPISODES = 3
ROUGH = {"action_levels": 4, "friction_error": -0.3, "observation_noise": 0.2}


def play_constant(arguments: dict[str, Any]) -> float:
    """Return the mean score of the best constant action, by single environments."""
    action = policies(TASK)[CONSTANT].parameters[0]
    total = 0.0
    for seed in SEED_SPLITS["test"][:EPISODES]:
        env = gymnasium.make(f"ImpactAbsorber/{TASK}", **arguments)
        env.reset(seed=seed)
        over = False
        while not over:
            _, reward, terminated, truncated, _ = env.step(action)
            total += reward
            over = terminated or truncated
    return total / EPISODES


def test_rows_are_scores_on_the_machine_and_what_it_costs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study, "TASKS", (TASK,))
    monkeypatch.setattr(study, "MACHINES", {study.IDEAL: {}, "rough": ROUGH})
    trained = replace(load_agent(TASK), arguments=ROUGH, seed=77)
    cases = study.list_cases(study.Settings(EPISODES, (trained,)))
    rows = [row for case in cases.values() for row in case()]
    ideal, rough = (
        {row["policy"]: row for row in rows if row["machine"] == name}
        for name in (study.IDEAL, "rough")
    )
    assert list(ideal) == list(rough)
    assert {CONSTANT, EIGHT, "PPO trained on machines that differ, seed 77"} < set(ideal)
    for arguments, row in (({}, ideal[CONSTANT]), (ROUGH, rough[CONSTANT])):
        assert row["score"] == pytest.approx(play_constant(arguments), rel=1e-12)
    for name, row in rough.items():
        assert row["change"][0] == pytest.approx(row["score"] - ideal[name]["score"], rel=1e-9)
        assert row["change"][1] <= row["change"][0] <= row["change"][2]
        assert ideal[name]["change"] == [0.0, 0.0, 0.0]
    table = study.make_tables(Measurement({"rows": rows}))
    assert f"| {study.write_cell(rough[EIGHT])} |" in table
    assert table.count("\n| ") == 4  # heads, a rule, and two machines
