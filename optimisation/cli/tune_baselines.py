"""Rules and schedules without learning, their numbers chosen on training seeds: what agents are compared with."""

# needs: env, optimise

from __future__ import annotations

import sys
from pathlib import Path

import click

from impact_env.parameters import ParameterError
from optimisation.cli.common import INTERRUPTED, BadInput, command
from optimisation.files import require_writable
from optimisation.progress import Bar
from optimisation.report.policy_tables import baseline_table
from optimisation.rl.baselines import store, tune
from optimisation.rl.tasks.effort import QUICK, Effort
from optimisation.rl.tasks.table import GROUPS, GROUPS_HELP, TASKS, task_named


@command()
@click.option("--task", type=click.Choice([*TASKS, *GROUPS]), default="both", show_default=True, help=GROUPS_HELP)
@click.option("--quick", is_flag=True, help="A few candidates on a few seeds: a look, not a search.")
@click.option("--effort", type=click.FloatRange(min=0, min_open=True), default=1.0, show_default=True, help="Share of the generations.")
@click.option("--seeds", type=click.IntRange(min=3), help=f"Number of training seeds.  [default: {Effort.seeds}]")
@click.option("--out", type=click.Path(file_okay=False, path_type=Path), default=Path("results/tune_baselines"), show_default=True)
def main(task: str, quick: bool, effort: float, seeds: int | None, out: Path) -> None:
    """Choose the numbers of all baselines and write them to OUT/TASK_baselines.json.

    Those that evaluate_policies uses come with this package; in a checkout they are made by --out optimisation/rl/tuned.
    """
    spent = (QUICK if quick else Effort()).scaled(effort, seeds)
    try:
        require_writable("--out", out)
        for name in GROUPS.get(task, (task,)):
            with Bar(total=task_named(name).tried(spent), desc=f"{name}: searching", unit="candidate", leave=False) as bar:
                found = tune(name, {}, spent, bar.update)
            store(out / f"{name}_baselines.json", name, {}, spent, found)
            click.echo(f"{name}:\n{baseline_table(found)}\n")
    except ParameterError as error:
        raise BadInput(str(error)) from error
    except KeyboardInterrupt:
        click.echo("Stopped; what is finished is written.", err=True)
        sys.exit(INTERRUPTED)
