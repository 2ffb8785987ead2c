"""Policies judged on the same held-out seeds: rules and schedules without learning, and trained agents."""

# needs: env

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from impact_env.parameters import ParameterError
from optimisation.command_line import INTERRUPTED, BadInput
from optimisation.commands.policy_evaluation import OUT, POLICIES, QUICK_OUT, QUICK_SEEDS, evaluate, publish
from optimisation.files import require_writable
from optimisation.report.policy_tables import table
from optimisation.rl.tasks.table import GROUPS, GROUPS_HELP, TASKS
from optimisation.rl.tasks.task import FEW_SEEDS, MANY_SEEDS


@click.command(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120})
@click.option("--task", type=click.Choice([*TASKS, *GROUPS]), default="both", show_default=True, help=GROUPS_HELP)
@click.option("--agents", type=click.Path(path_type=Path), help="Folder with agents, or one agent's file.  [default: docs/agents, else results]")
@click.option("--without-agents", is_flag=True, help="Judge only what does not learn.")
@click.option(
    "--baselines", type=click.Path(file_okay=False, path_type=Path), default=POLICIES, help="Folder of TASK_baselines.json.  [default: docs/policies]"
)
@click.option("--policy", "names", multiple=True, metavar="NAME", help="Judge only this one of the baselines; may be given several times.")
@click.option("--seeds", type=click.IntRange(min=2), help=f"Number of evaluation seeds.  [default: {FEW_SEEDS}, suite {MANY_SEEDS}]")
@click.option("--ceiling", type=click.IntRange(min=1), metavar="DRAWS", help="Suite: the best of so many random schedules, too, on 64 seeds.")
@click.option("--quick", is_flag=True, help=f"{QUICK_SEEDS} evaluation seeds, into {QUICK_OUT} unless told otherwise: a look, not a result.")
@click.option("--redraw", is_flag=True, help="Tables and figures again from the files in the folder; nothing is played.")
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    help=f"Folder for results.  [default: docs/policies, with the page docs/agents.md; without a checkout {QUICK_OUT}]",
)
def main(task: str, out: Path | None, **given: Any) -> None:
    """Play every policy on the same held-out seeds, and say which is better and how sure that is.

    Writes TASK_results.csv (each episode), TASK_table.json and .md, TASK_curves.json, and figures.
    """
    folder, tables = out or (QUICK_OUT if given["quick"] else OUT), {}
    try:
        require_writable("--out", folder)
        for name in GROUPS.get(task, (task,)):
            tables[name] = evaluate(name, given, folder)
            click.echo(f"{name}:\n{table(name, tables[name])}\n")
        publish(task, tables, folder)
    except ParameterError as error:
        raise BadInput(str(error)) from error
    except KeyboardInterrupt:
        click.echo("Stopped; the tasks that are finished are written.", err=True)
        sys.exit(INTERRUPTED)


if __name__ == "__main__":
    main(prog_name="scripts/run evaluate_policies")
