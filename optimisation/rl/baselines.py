"""What an engineer would do without learning: fixed values, tuned fixed values, rules, and the best schedule that does not look at the response.

Numbers are chosen on training seeds and stored, so that judging does not search again.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from impact_env.drive import PAPER_RATE
from impact_env.parameters import ParameterError, RigidWalls, require
from optimisation.files import write_json
from optimisation.rl.families import Array, ConstantAction, Family, FrequencyWindow, OpenLoop, Rates, policy_of, task_of
from optimisation.rl.gap_rules import EstimatedForceRule, GapOverFrequency, GapScale, TrueForceRule
from optimisation.rl.play import GAP, SWEEP
from optimisation.rl.policies import Policy, Random
from optimisation.rl.suite import BLIND, FEEDBACK, SUITE, WINDOW, kinds_of, search_adaptive, search_friction, search_passage, tried
from optimisation.rl.tuning import Search, Tuned, best_of, evolve, mean_scores, searched

OLD = {"sweep": SWEEP, "gap": GAP}
TASKS = OLD | SUITE
KNOTS = 21
PAPER_SLOW_RATE = 100 / 725  # % per 100 pseudo periods, of the paper's example of a jump (section 3.1)
GROUPS: dict[str, tuple[str, ...]] = {"both": tuple(OLD), "suite": tuple(SUITE), "all": tuple(TASKS)}  # of tasks, as commands take them
GROUPS_HELP = "; ".join(f"{name}: {env_id.split('/')[1]}" for name, env_id in TASKS.items()) + "; both: the first two; suite: the others."
RANDOM = "random"
BEST_CONSTANT, BEST_SCHEDULE = "best constant rate", "best open-loop schedule"
WINDOWED, KNOTTED = "rule over the frequency", "schedule by knots"
BEST_PAIR, BEST_LIMIT = "best constant rate and gap", "best constant limit"
BEST_GAP, TUNED_TRUE, TUNED_ESTIMATE = "best fixed gap", "rule, true force, fitted", "rule, estimated force, fitted"
# what the normalised scores 0 and 1 mean
ZERO_AND_ONE = {
    "sweep": (BEST_CONSTANT, BEST_SCHEDULE),
    "gap": (BEST_GAP, TUNED_TRUE),
    **{task: ({"adaptive": BEST_PAIR, "friction": BEST_LIMIT}.get(task, BEST_CONSTANT), FEEDBACK) for task in SUITE},
}
# what agents are compared with episode by episode: the best that needs no learning and knows no more, or what does not look at the response
RIVAL = {"sweep": BEST_SCHEDULE, "gap": TUNED_ESTIMATE, **dict.fromkeys(SUITE, BEST_SCHEDULE)}
VERSION = 1


@dataclass(frozen=True)
class Baseline:
    """A policy by its name, kind and numbers; ``training`` says how they were chosen, None if they were not."""

    name: str
    kind: str
    parameters: tuple[float, ...]
    training: Tuned | None = None


RULES, SCHEDULES = Search(generations=12, population=10, sigma=0.1), Search(generations=40, population=16, sigma=0.2)
FITS = Search(generations=14, population=12, sigma=0.4)
SUITE_SEARCH = Search(generations=18, population=12, sigma=0.15, relative=True)
# a first look for slow windows, in shares of the range
WINDOW_EDGES, WINDOW_WIDTHS, SLOW_ACTIONS = np.arange(0.25, 0.56, 0.05), (0.1, 0.15, 0.2, 0.3), (-0.9, -0.7, -0.5)


@dataclass(frozen=True)
class Effort:
    """How much is spent on choosing numbers: training seeds, a first look at windows, points of a grid, searches."""

    seeds: int = 96
    windows: bool = True
    grid: int = 25
    rule: Search = RULES
    schedule: Search = SCHEDULES
    fit: Search = FITS
    suite: Search = SUITE_SEARCH

    def scaled(self, share: float, seeds: int | None = None) -> Effort:
        """Return an effort with a share of the generations, at least one, and another number of seeds if one is given."""
        searches: dict[str, Any] = {
            name: replace(search, generations=max(1, round(share * search.generations)))
            for name, search in (("rule", self.rule), ("schedule", self.schedule), ("fit", self.fit), ("suite", self.suite))
        }
        return replace(self, **searches, seeds=seeds or self.seeds)


FEW = Search(generations=2, population=6, finalists=2)
QUICK = Effort(seeds=9, windows=False, grid=5, rule=FEW, schedule=FEW, fit=FEW, suite=replace(FEW, sigma=0.1, relative=True))
FIRST_TRAINING_SEED = 1000
SUITE_SEEDS = 2  # times as many training seeds: its episodes are short


def families(task: str, arguments: Mapping[str, Any]) -> dict[str, Family]:
    """Return the kinds of policies of a task (one of `TASKS`) by name."""
    require(task in TASKS, "task", task, f"one of {', '.join(TASKS)}")
    behind = task_of(TASKS[task], arguments)
    if task in SUITE:
        return kinds_of(task, behind)
    constant: dict[str, Family] = {"constant": ConstantAction()}
    if task == "sweep":
        rates = Rates.of(behind)
        return constant | {"window": FrequencyWindow(rates), "open loop": OpenLoop(rates, KNOTS)}
    scale = GapScale(behind)
    return constant | {
        "over frequency": GapOverFrequency(),
        "true force": TrueForceRule(scale),
        "estimated force": EstimatedForceRule(scale),
    }


def policy(baseline: Baseline, kinds: Mapping[str, Family]) -> Policy:
    """Return the policy of a baseline; raises ParameterError for an unknown kind."""
    if baseline.kind == RANDOM:
        return Random(name=baseline.name, numbers=2 if "pair" in kinds else 1)
    require(baseline.kind in kinds, "kind", baseline.kind, f"one of {RANDOM}, {', '.join(kinds)}")
    return policy_of(baseline.name, kinds[baseline.kind], list(baseline.parameters))


Advance = Callable[[int], None]


def tune(task: str, arguments: Mapping[str, Any], effort: Effort, advance: Advance | None = None) -> list[Baseline]:
    """Return the baselines of a task with their numbers chosen on training seeds. ``advance`` is called with the number of candidates tried."""
    kinds = families(task, arguments)
    seeds = training_seeds(task, effort)
    rest = (TASKS[task], seeds, arguments)
    if task in SUITE:
        return [Baseline(RANDOM, RANDOM, ()), *_suite(task, kinds, rest, effort, advance)]
    return [Baseline(RANDOM, RANDOM, ()), *(_sweep if task == "sweep" else _gap)(kinds, rest, effort, advance)]


def training_seeds(task: str, effort: Effort) -> range:
    """Return the seeds on which a task's numbers are chosen."""
    return range(FIRST_TRAINING_SEED, FIRST_TRAINING_SEED + effort.seeds * (SUITE_SEEDS if task in SUITE else 1))


Rest = tuple[str, Sequence[int], Mapping[str, Any]]


def _grid(effort: Effort) -> Array:
    return np.linspace(-1, 1, effort.grid)[:, None]


def _sweep(kinds: Mapping[str, Family], rest: Rest, effort: Effort, advance: Advance | None) -> list[Baseline]:
    window, schedule = kinds["window"], kinds["open loop"]
    assert isinstance(window, FrequencyWindow)
    assert isinstance(schedule, OpenLoop)
    rates = window.rates
    found = [Baseline(f"paper's rate, {rate:.3g} %", "constant", (float(rates.action(rate)),)) for rate in (PAPER_RATE, PAPER_SLOW_RATE)]
    constant = best_of(kinds["constant"], _grid(effort), *rest, advance)
    rule = evolve(window, _windows(window, rest, effort, advance), np.array([(0, 1), (0, 1), (-1, 1), (-1, 1)]), *rest, effort.rule, advance)
    knots = np.linspace(0, 1, schedule.knots)
    edges = np.sort(rule.parameters[:2])
    begin = np.where((knots > edges[0]) & (knots <= edges[1]), rule.parameters[2], rule.parameters[3]).tolist()
    best = evolve(schedule, [begin] * 2, np.array([(-1.0, 1.0)] * schedule.knots), *rest, effort.schedule, advance)
    return [
        *found,
        Baseline(BEST_CONSTANT, "constant", constant.parameters, constant),
        *_schedules(rule, best),
    ]


def _schedules(rule: Tuned, knotted: Tuned) -> list[Baseline]:
    """Return both schedules over the frequency; the one with the better score on the seeds that neither search saw is the best open-loop schedule."""
    simple = rule.score >= knotted.score
    names = (BEST_SCHEDULE, KNOTTED) if simple else (WINDOWED, BEST_SCHEDULE)
    return [Baseline(names[0], "window", rule.parameters, rule), Baseline(names[1], "open loop", knotted.parameters, knotted)]


def _suite(task: str, kinds: Mapping[str, Family], rest: Rest, effort: Effort, advance: Advance | None) -> list[Baseline]:
    """Return a suite task's baselines; of two schedules the better one on the seeds that no search saw is the best open-loop schedule."""
    search = {"adaptive": search_adaptive, "friction": search_friction}.get(task, search_passage)
    found = search(kinds, rest, effort.grid, effort.suite, advance)
    names = {"constant": ZERO_AND_ONE[task][0], "schedule": BEST_SCHEDULE}
    schedules = {name: numbers.score for name, _, numbers in found if name in (WINDOW, BLIND)}
    if schedules:
        names[max(schedules, key=schedules.__getitem__)] = BEST_SCHEDULE
    return [Baseline(names.get(name, name), kind, numbers.parameters, numbers) for name, kind, numbers in found]


def _windows(window: FrequencyWindow, rest: Rest, effort: Effort, advance: Advance | None) -> list[list[float]]:
    """Return two starts for the search of a rule: the best of a coarse grid of slow windows, with the fastest rate outside."""
    grid = np.array([(low, low + width, slow, 1.0) for low in WINDOW_EDGES for width in WINDOW_WIDTHS for slow in SLOW_ACTIONS])
    if not effort.windows:
        return [[0.3, 0.5, -0.8, 1.0], [0.35, 0.5, -0.8, 1.0]]
    name, seeds, arguments = rest
    scores = mean_scores(window, grid, name, searched(seeds), arguments)
    if advance is not None:
        advance(len(grid))
    return grid[np.argsort(-scores)[:2]].tolist()


def _gap(kinds: Mapping[str, Family], rest: Rest, effort: Effort, advance: Advance | None) -> list[Baseline]:
    known, guessed = kinds["true force"], kinds["estimated force"]
    assert isinstance(known, TrueForceRule)
    scale, search = known.scale, effort.fit
    constant = best_of(kinds["constant"], _grid(effort), *rest, advance)
    line = evolve(kinds["over frequency"], [(constant.parameters[0], 0.0)], np.array([(-1, 1), (-5, 5)]), *rest, search, advance)
    bounds = np.array([(0.2, 4.0), (-5.0, 5.0)])
    true = evolve(known, [(1.0, 0.0), (1.5, 0.0)], bounds, *rest, search, advance)
    estimate = evolve(
        guessed, [(*true.parameters, 1.0, 0.7), (1.0, 0.0, 1.0, 0.5)], np.concatenate([bounds, [(0.3, 1.5), (0.0, 0.98)]]), *rest, search, advance
    )
    return [
        Baseline("paper's gap, 1 mm", "constant", (float(scale.action(RigidWalls.gap)),)),
        Baseline(BEST_GAP, "constant", constant.parameters, constant),
        Baseline("best gap over the frequency", "over frequency", line.parameters, line),
        Baseline("rule, estimated force", "estimated force", (1.0, 0.0, 1.0, 0.5)),
        Baseline(TUNED_ESTIMATE, "estimated force", estimate.parameters, estimate),
        Baseline("rule, true force", "true force", (1.0, 0.0)),
        Baseline(TUNED_TRUE, "true force", true.parameters, true),
    ]


def candidates_of(task: str, effort: Effort) -> int:
    """Return how many candidates `tune` is going to try."""

    def count(search: Search, starts: int) -> int:
        return starts * (search.generations * search.population + search.finalists + 2)

    if task in SUITE:
        return tried(task, effort.grid, effort.suite)
    if task == "sweep":
        windows = len(WINDOW_EDGES) * len(WINDOW_WIDTHS) * len(SLOW_ACTIONS) if effort.windows else 0
        return effort.grid + windows + count(effort.rule, 2) + count(effort.schedule, 2)
    return effort.grid + count(effort.fit, 5)


def store(path: Path, task: str, arguments: Mapping[str, Any], effort: Effort, baselines: Sequence[Baseline]) -> None:
    """Write baselines as JSON."""
    seeds = training_seeds(task, effort)
    content = {"version": VERSION, "task": task, "arguments": dict(arguments), "training_seeds": [seeds[0], seeds[-1]], "effort": asdict(effort)}
    write_json(path, content | {"policies": [asdict(baseline) for baseline in baselines]})


def load(path: Path, task: str) -> tuple[list[Baseline], dict[str, Any]]:
    """Return stored baselines and the environment's arguments that they were tuned for.

    Raises ParameterError if there is no such file, or if it is of another task or version.
    """
    require(path.is_file(), "baselines", str(path), "a file that tune_baselines has written")
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        rows = content["policies"]
        require(content["task"] == task, "baselines", str(path), f"baselines of the task {task}, not of {content['task']}")
        require(content["version"] == VERSION, "baselines", str(path), f"version {VERSION}, not {content['version']}")
        found = [
            Baseline(row["name"], row["kind"], tuple(row["parameters"]), None if row["training"] is None else _tuned(row["training"])) for row in rows
        ]
    except (ValueError, KeyError, TypeError) as error:
        if isinstance(error, ParameterError):
            raise
        raise ParameterError(f"baselines = {path} is not allowed: a whole file that tune_baselines has written ({error})") from error
    return found, dict(content["arguments"])


def _tuned(row: Mapping[str, Any]) -> Tuned:
    return Tuned(tuple(row["parameters"]), float(row["score"]), int(row["candidates"]))
