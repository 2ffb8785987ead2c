"""One table of what needs no learning, for all tasks: families of rules and schedules, and the numbers that `admit_tasks` chose for them."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from impact_env.parameters import require
from optimisation.rl import active_rules as active
from optimisation.rl import passage_rules as passage
from optimisation.rl.families import ConstantAction, ConstantPair, Family, FamilyPolicy, task_of

CONSTANT, BLIND, FOUR, EIGHT = "best constant", "blind schedule", "rule of 4", "rule of 8"  # at most so many numbers
CHOSEN = Path(__file__).with_name("rules.json")  # by task and what it is: family and numbers


class Families(NamedTuple):
    """Of a task: what is always the same, what looks at nothing, and what looks. ``planned``: a planner over such a rule is worth a look."""

    constant: type[Family]
    blind: type[Family]
    looking: tuple[type[Family], ...]
    planned: bool = False

    @property
    def numbers(self) -> int:
        """How many numbers an action has."""
        return len(self.constant.names)


WITHIN = Families(ConstantAction, active.Blind, (active.Switch, active.Phase, active.Products), planned=True)
RATE = Families(ConstantAction, passage.FrequencyWindow, (passage.SmallRule,))
TASKS = {
    "ActiveFriction-v0": WITHIN,
    "ActiveGap-v0": WITHIN,
    "Structures-v0": WITHIN,
    "Passage-v0": Families(ConstantPair, active.BlindPair, (active.PairBySize, active.PairByImpacts), planned=True),
    "FrictionChoice-v1": Families(ConstantAction, passage.LimitOverFrequency, (passage.LimitByLook,)),
    "SweepAndGap-v1": Families(ConstantPair, passage.RateAndGapOverFrequency, (passage.RateAndGapByEstimatedForce,)),
    "GapChoice-v1": Families(ConstantAction, passage.GapOverFrequency, (passage.GapByEstimatedForce,)),
    "SweepRate-v1": RATE,
    "SweepRateNoisy-v1": RATE,
    "SweepRateDelayed-v1": RATE,
}  # in the newest version; those with a planner are the ones with room


def env_of(task: str) -> str:
    """Return the environment of a task; raises ParameterError for one that is not in the table."""
    require(task in TASKS, "task", task, f"one of {', '.join(TASKS)}")
    return f"ImpactAbsorber/{task}"


def chosen(file: Path = CHOSEN) -> dict[str, dict[str, Any]]:
    """Return what was chosen: by task and by what it is, the family's name and its numbers."""
    return dict(json.loads(file.read_text(encoding="utf-8")))


def policies(task: str, arguments: Mapping[str, Any] | None = None) -> dict[str, FamilyPolicy]:
    """Return the chosen policies of a task, by what they are; the rule of eight stands for the one of four where it is no other."""
    behind, own = task_of(env_of(task), arguments), TASKS[task]
    known: dict[str, Callable[[Any], Family]] = {family.__name__: family for family in (own.constant, own.blind, *own.looking)}
    found = {}
    for label, rule in chosen()[task].items():
        family = known[rule["family"]](behind)
        numbers = [*rule["numbers"], *family.neutral[len(rule["numbers"]) :]]
        found[label] = FamilyPolicy(label, family, numbers)
    return found
