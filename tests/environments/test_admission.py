"""Admission of tasks works.

Rules of eight parameters start from those of four, copies of lanes behave like the lanes, and a
planner scores higher than its rule.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from impact_env import ParameterError

gymnasium = pytest.importorskip("gymnasium")
pytest.importorskip("cmaes")
from commands import call
from environment_cases import ACTIVE_FRICTION, ACTIVE_GAP, LIMITED, RUBBING, STRUCTURES

from impact_env.envs.evaluation import play
from optimisation.files import read_json, write_json
from optimisation.rl.agents import FINAL, load_agent, save_agent
from optimisation.rl.families import FamilyPolicy
from optimisation.rl.rules import TASKS, Switch, chosen
from studies.admission import FIRST_JUDGED, QUICK, Held, Planner, admit, disturb, plan
from studies.cli import admit_tasks

RULE = (-0.22, -0.14, -0.6, 0.4, -0.29, 0.09, 2.3, 0.09)
KINDS = {"best constant", "blind schedule", "rule of 4", "rule of 8"}
BRIEF: dict[str, Any] = {"time_budget": 10.0}


ACTIVE = TASKS["ActiveGap-v0"].feedback
PAIRS = TASKS["Passage-v0"].feedback


@pytest.mark.parametrize("family", [*ACTIVE, *PAIRS])
def test_a_rule_of_four_is_one_of_eight_and_rules_are_even(family: Any) -> None:
    """A rule of four parameters is one of eight, and rules are symmetric.

    The scene and its mirror image get the same action. Displacements, velocities and the force's
    phase have opposite signs in the mirror image.
    """
    generator = np.random.default_rng(0)
    numbers = generator.normal(size=(20, 4))
    observed = np.abs(generator.normal(size=(20, 13))).astype(np.float32)
    rest = np.tile(family.neutral[4:], (20, 1))
    four = Held(family()).act(numbers, observed)
    eight = family().act(np.concatenate([numbers, rest], axis=1), observed)
    np.testing.assert_array_equal(four, eight)
    assert np.std(four) > 0.1
    mirror = observed.copy()
    mirror[:, :4] *= -1
    if family in ACTIVE:
        mirror[:, 5:7] *= -1
    np.testing.assert_allclose(
        family().act(np.concatenate([numbers, rest], axis=1), mirror), eight, rtol=1e-6
    )


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        (STRUCTURES, {"structures": 24}),
        (STRUCTURES, {"structures": 5}),
        (LIMITED, {}),
        (
            ACTIVE_FRICTION,
            {"observation_delay": 3, "action_delay": 2, "friction_error": (-0.2, 0.2)},
        ),
    ],
    ids=["structures", "as many structures as lanes", "passage", "delays"],
)
def test_copies_do_what_the_lane_does(name: str, arguments: dict[str, Any]) -> None:
    few, many = (gymnasium.make_vec(name, num_envs=lanes, **arguments) for lanes in (5, 15))
    few.reset(seed=3)
    many.reset(seed=90)
    generator = np.random.default_rng(0)
    drawn = generator.uniform(-1, 1, (12, *few.action_space.shape)).astype(np.float32)
    for action in drawn[:5]:
        few.step(action)
    many.unwrapped.task.copy_from(few.unwrapped.task, 3)
    for action in drawn[5:]:
        observed, rewards, *_ = few.step(action)
        others, gained, *_ = many.step(np.repeat(action, 3, axis=0))
        np.testing.assert_array_equal(np.repeat(rewards, 3), gained)
        np.testing.assert_array_equal(np.repeat(observed, 3, axis=0), others)
    with pytest.raises(ParameterError, match="2 times the 5 lanes"):
        many.unwrapped.task.copy_from(few.unwrapped.task, 2)


def test_copies_are_off_by_little_and_to_both_sides() -> None:
    load = {"kind": "random", "spectrum": [[20.0, 0.5], [60.0, 0.5]], "duration_s": 2.0, "seed": 4}
    env = gymnasium.make_vec(ACTIVE_FRICTION, num_envs=8, load=load)
    env.reset(seed=0)
    task = env.unwrapped.task
    force = task.lanes.force.copy()
    phase = task.runs.orders["phase"].copy()
    place = task.runs.orders["place"].copy()
    disturb(task, 4, np.random.default_rng(0))
    changes = (
        (task.lanes.force / force - 1, 0.002, 0.01),
        (task.runs.orders["phase"] - phase, 0.02, 0.1),
    )
    for change, least, most in changes:
        np.testing.assert_allclose(change[:4], change[4:], atol=1e-12)
        assert np.all((np.abs(change) >= least - 1e-12) & (np.abs(change) <= most + 1e-12))
        assert np.sum(change[:4] > 0) == 2
    place_order = task.runs.orders["place"]
    np.testing.assert_array_equal(place_order[:4], place_order[4:])
    assert len(set(place_order[:4]) - set(place)) == 4


def test_planners_are_above_their_rule_on_64_seeds() -> None:
    seeds = range(2_600_000, 2_600_064)
    rule = play(FamilyPolicy("rule", Switch(), list(RULE)), ACTIVE_FRICTION, seeds, BRIEF).scores
    planner = Planner([(a,) for a in (-1.0, -0.4, 0.2, 0.8)], horizon=10)
    robust, exact = (
        plan(ACTIVE_FRICTION, seeds, BRIEF, (Switch(), np.array(RULE)), one)
        for one in (planner, replace(planner, copies=1, exact=True))
    )
    for scores in (robust, exact):
        apart = scores - rule
        assert apart.mean() > 4 * apart.std() / np.sqrt(len(apart))
    nobody = plan(
        ACTIVE_FRICTION,
        seeds[:4],
        BRIEF,
        (Switch(), np.array(RULE)),
        replace(planner, actions=[(0.0,)], lasting=(0,)),
    )
    np.testing.assert_allclose(
        nobody, rule[:4], rtol=1e-9
    )  # a planner without a choice is its rule


def test_the_command_fills_the_page_and_keeps_what_is_known(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A task for comparison gets rules and no planner; room is the share that a rule leaves."""
    few = replace(QUICK, searched=6, judged=4, grid=3, horizon=3)
    monkeypatch.setattr(admit_tasks, "QUICK", few)
    target = tmp_path / "tasks.json.gz"
    page = tmp_path / "page.md"
    rules = tmp_path / "rules.json"
    page.write_text("".join(f"<!-- {name} -->\n<!-- /{name} -->\n" for name in admit_tasks.MARKERS))
    compared = admit(
        "GapChoice-v1",
        {"hold": (20.0, 40.0), "time_budget": 100.0} | RUBBING,
        few,
    )
    assert set(compared["scores"]) == KINDS
    write_json(target, {"tasks": {"GapChoice-v1": compared}})
    result = call(
        admit_tasks.main, "--quick", "--task", "ActiveGap-v0", "--json", target, "--page", page
    )
    assert result.exit_code == 0, result.output
    known = read_json(target)["tasks"]
    assert set(known) == {"ActiveGap-v0", "GapChoice-v1"}
    assert "room" not in known["GapChoice-v1"]
    scores = {label: np.mean(values) for label, values in known["ActiveGap-v0"]["scores"].items()}
    share = (scores["robust oracle"] - scores["rule of 8"]) / (
        scores["robust oracle"] - scores["best constant"]
    )
    low, middle, high = sorted(known["ActiveGap-v0"]["room"])
    assert known["ActiveGap-v0"]["room"] == [middle, low, high]
    assert middle == pytest.approx(share, abs=1e-3)
    text = page.read_text()
    assert all(line in text for line in result.stdout.splitlines()[-2:])
    assert "`ActiveGap-v0`" in text
    assert "| for comparison |" in text
    before = target.read_bytes()
    assert call(admit_tasks.main, "--redraw", "--json", target, "--rules", rules).exit_code == 0
    assert target.read_bytes() == before
    assert set(chosen(rules)["ActiveGap-v0"]) == KINDS
    agent = load_agent("ActiveGap-v0")
    for seed in (0, 1):
        (tmp_path / "agents" / str(seed)).mkdir(parents=True)
        save_agent(tmp_path / "agents" / str(seed) / FINAL, replace(agent, seed=seed))
    assert (
        "(2 runs)"
        in call(
            admit_tasks.main, "--redraw", "--json", target, "--agents", tmp_path / "agents"
        ).output
    )
    judged = read_json(target)["tasks"]
    runs = judged["ActiveGap-v0"]["scores"].pop("PPO")
    np.testing.assert_allclose(
        runs, [play(agent, ACTIVE_GAP, range(FIRST_JUDGED, FIRST_JUDGED + 4)).scores] * 2, atol=1e-6
    )
    assert judged == known
