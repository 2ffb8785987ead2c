"""Rules and agents on the same held-out seeds."""

# needs: env

import csv
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import click

from impact_env.checks import require
from impact_env.envs.evaluation import EPISODES, SEED_SPLITS, Evaluation, PolicyScores, evaluate
from impact_env.extras import DISTRIBUTION
from optimisation.checkpoint import installed_versions
from optimisation.cli.common import check_target, check_targets, command, plain_errors
from optimisation.cli.options import OptionSpec, at_least, option
from optimisation.executors import Bar
from optimisation.files import DOCS, ROOT, fill, markdown, require_markers, write_csv, write_files
from optimisation.rl.agents import Agent, list_shipped, load_agent
from optimisation.rl.families import RandomPolicy
from optimisation.rl.rules import EIGHT, FOUR, TASKS, env_of, policies

LEADERBOARD = DOCS / "leaderboard.csv"
PAGE = DOCS / "tasks.md"
MARKER = "leaderboard"
COLUMNS = ("task", "policy", "who", "commit", "split", "episodes", "score", "low", "high")
THIS_PROJECT = "this project"


@dataclass(frozen=True, kw_only=True)
class EvaluateOptions:
    """Options of ``rl evaluate``; None or empty: not given."""

    tasks: tuple[str, ...] = option(
        "tasks",
        type=click.Choice(list(TASKS)),
        more=f"{', '.join(TASKS)}.",
        default_text="all, with --agent the agents'",
    )
    files: tuple[Path, ...] = option(
        OptionSpec(
            names=("--agent",),
            help="File of an agent; may be repeated",
            type=click.Path(path_type=Path),
            metavar="FILE",
            multiple=True,
            usual=True,
        )
    )
    split: str = option(
        OptionSpec(
            names=("--split",),
            help=f"Seeds that are played: {', '.join(SEED_SPLITS)}",
            type=click.Choice(list(SEED_SPLITS)),
            metavar="NAME",
            default="test",
            usual=True,
        )
    )
    episodes: int = option("episodes", type=at_least(2), default=EPISODES)
    json: Path | None = option("json", help="Write the scores")
    leaderboard: Path | None = option(
        OptionSpec(
            names=("--board",),
            help=f"Write the scores into a leaderboard, as in docs/{LEADERBOARD.name}",
            type=click.Path(path_type=Path),
            metavar="FILE",
            section="Output",
        )
    )
    page: Path | None = option(
        "page",
        help=f"Write the leaderboard's table into a page, as in docs/{PAGE.name}; with --board",
        type=click.Path(path_type=Path),
    )


def evaluate_policies(task: str, agents: list[Agent], split: str, episodes: int) -> Evaluation:
    """Return the scores of the first agent, or else of the best rule, beside all others."""
    rules = policies(task)
    best = rules.pop(EIGHT)
    rules.pop(FOUR, None)
    own = [load_agent(task, algorithm) for algorithm in list_shipped().get(task, [])]
    everyone = {
        **{f"{agent.name} (given)": agent for agent in agents},
        f"rule of {len(best.parameters[0])}, {type(best.family).__name__}": best,
        **{f"{agent.algorithm.upper()}, one agent, {agent.steps:,} steps": agent for agent in own},
        **rules,
        "random": RandomPolicy(numbers=TASKS[task].numbers),
    }
    (name, first), *others = Bar(everyone.items(), desc=task, unit="policy", leave=False)
    evaluation = evaluate(first, env_of(task), split, dict(others), episodes=episodes)
    return Evaluation(**{**vars(evaluation), "policy": PolicyScores.of(name, evaluation.scores)})


def revision() -> str:
    """Return the commit of the checkout that runs, else the version of the package."""
    if shutil.which("git") is not None and (ROOT / ".git").exists():
        answer = subprocess.run(
            ["git", "rev-parse", "--short", "HEAD"],
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=False,
        )
        if answer.returncode == 0:
            return answer.stdout.strip()
    return installed_versions([DISTRIBUTION]).get(DISTRIBUTION, "unknown")


def write_leaderboard(path: Path, evaluations: dict[str, Evaluation]) -> list[list[str]]:
    """Write the leaderboard and return its lines.

    Existing lines remain if their ``who`` is another one or if their task was not evaluated.
    """
    rows: list[list[str]] = []
    if path.exists():
        with path.open(newline="", encoding="utf-8") as lines:
            rows = [
                [row[name] for name in COLUMNS]
                for row in csv.DictReader(lines)
                if row["who"] != THIS_PROJECT or row["task"] not in evaluations
            ]
    for task, one in evaluations.items():
        for scored in (one.policy, *one.others.values()):
            numbers = (f"{value:.4f}" for value in (scored.mean, *scored.interval))
            rows.append(
                [
                    task,
                    scored.name,
                    THIS_PROJECT,
                    revision(),
                    one.split,
                    str(len(one.seeds)),
                    *numbers,
                ]
            )
    order = list(TASKS)
    rows.sort(key=lambda row: (order.index(row[0]), -float(row[6])))
    write_csv(path, COLUMNS, rows)
    return rows


def plain_scores(evaluations: dict[str, Evaluation]) -> list[dict[str, object]]:
    """Return the scores as plain data, a row for each task and policy.

    The rows contain the 95 % interval of the mean.
    """
    return [
        {
            "task": task,
            "policy": scored.name,
            "split": one.split,
            "episodes": len(one.seeds),
            "score": float(scored.mean),
            "interval": [float(end) for end in scored.interval],
        }
        for task, one in evaluations.items()
        for scored in (one.policy, *one.others.values())
    ]


@command(
    EvaluateOptions,
    examples=(
        "rl evaluate --task GapChoice-v1 --episodes 4",
        "rl evaluate --agent results/rl_train/agent.npz",
    ),
)
def main(options: EvaluateOptions) -> None:
    """Compare rules, shipped agents and given policies on the first seeds of a split.

    The comparison states which policy is better, and how certain that is.
    """
    page = options.page
    with plain_errors():
        check_target("--board", options.leaderboard, (".csv",))
        check_target("--page", page)
        check_targets({"json": options.json})
        require(
            page is None or options.leaderboard is not None,
            "--page",
            str(page),
            "given with --board",
        )
        if page is not None:
            require_markers(page, PAGE, (MARKER,))
        agents = [load_agent(file) for file in options.files]
        own = {agent.env_id.split("/")[1] for agent in agents}
        require(
            own <= set(TASKS), "--agent", sorted(own - set(TASKS)), f"agents for {', '.join(TASKS)}"
        )
        evaluations = {}
        for task in options.tasks or [name for name in TASKS if not own or name in own]:
            evaluations[task] = evaluate_policies(
                task,
                [agent for agent in agents if agent.env_id == env_of(task)],
                options.split,
                options.episodes,
            )
            click.echo(f"{evaluations[task]}\n")
        write_files({options.json: plain_scores(evaluations)})
        if options.leaderboard is not None:
            rows = write_leaderboard(options.leaderboard, evaluations)
            if page is not None:
                table = [
                    (f"`{task}`", name, who, f"{float(s):.3f} [{float(a):.3f}, {float(b):.3f}]")
                    for task, name, who, _, _, _, s, a, b in rows
                ]
                fill(page, PAGE, {MARKER: markdown(("task", "policy", "who", "mean score"), table)})
