"""Rules and schedules without learning, their numbers chosen on training seeds: what agents are compared with."""

# needs: rl optimise

from __future__ import annotations

import sys
from pathlib import Path

import click
from _command_line import BadInput
from _table import markdown
from tqdm import tqdm

from impact_env.parameters import ParameterError
from optimisation.files import require_writable
from optimisation.rl.baselines import QUICK, TASKS, Baseline, Effort, candidates_of, store, tune

INTERRUPTED = 130


def table(baselines: list[Baseline]) -> str:
    rows = [
        (b.name, "-" if b.training is None else f"{b.training.score:.4f}", "-" if b.training is None else str(b.training.candidates))
        for b in baselines
    ]
    return markdown(("policy", "mean score, training seeds", "candidates"), rows)


@click.command(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120})
@click.option("--task", type=click.Choice([*TASKS, "both"]), default="both", show_default=True)
@click.option("--quick", is_flag=True, help="A few candidates on a few seeds: a look, not a search.")
@click.option("--out", type=click.Path(file_okay=False, path_type=Path), default=Path("results/tune_baselines"), show_default=True)
def main(task: str, quick: bool, out: Path) -> None:
    """Choose the numbers of all baselines and write them to OUT/TASK_baselines.json.

    docs/policies holds the ones that evaluate_policies uses; they are made by --out docs/policies.
    """
    effort = QUICK if quick else Effort()
    tasks = list(TASKS) if task == "both" else [task]
    try:
        require_writable("--out", out)
        for name in tasks:
            with tqdm(total=candidates_of(name, effort), desc=f"{name}: searching", unit="candidate", leave=False, disable=None) as bar:
                found = tune(name, {}, effort, bar.update)
            store(out / f"{name}_baselines.json", name, {}, effort, found)
            click.echo(f"{name}:\n{table(found)}\n")
    except ParameterError as error:
        raise BadInput(str(error)) from error
    except KeyboardInterrupt:
        click.echo("Stopped; what is finished is written.", err=True)
        sys.exit(INTERRUPTED)


if __name__ == "__main__":
    main(prog_name="scripts/run tune_baselines")
