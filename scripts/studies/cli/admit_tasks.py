"""Whether tasks have room above rules of few numbers: constants, schedules, rules by CMA-ES, and planners that look ahead; and the page of tasks."""

# needs: env, optimise

from dataclasses import replace
from pathlib import Path

import click

from impact_env.parameters import ParameterError
from optimisation.cli.common import BadInput, check_target, command
from optimisation.files import read_json, write_json
from optimisation.page import DOCS, fill, require_markers
from optimisation.progress import Bar
from optimisation.rl.admission import EFFORTS, QUICK, add_agents, admit, tried
from optimisation.rl.agents import FINAL, find_agents
from optimisation.rl.rules import CHOSEN, TASKS, env_of
from studies.admission import NAMES, PICTURES, described, rooms, searches
from studies.study import Json

NUMBERS, PAGE = DOCS / "tasks.json.gz", DOCS / "tasks.md"
MARKERS = ("admission", "rules", "tasks")


def known(file: Path) -> dict[str, Json]:
    """Return the results of earlier runs by task; raises ParameterError for a file that is another."""
    if not file.exists():
        return {}
    try:
        found = dict(read_json(file)["tasks"])
        rooms(found)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ParameterError(f"--json = {file} is not allowed: a file that an earlier run of this command wrote ({error!r})") from error
    return {name: found[name] for name in TASKS if name in found}


@command()
@click.option("--task", "tasks", multiple=True, type=click.Choice(list(TASKS)), help="May be repeated.  [default: all that have a planner]")
@click.option("--quick", is_flag=True, help="A few seeds and generations: to see that it works.")
@click.option("--judged", type=click.IntRange(min=8), help="Seeds that all are judged on.  [default: 32 to 64, by task]")
@click.option("--agents", type=click.Path(path_type=Path, file_okay=False, exists=True), help="Folder of trained agents to judge beside rules.")
@click.option("--json", "target", type=click.Path(path_type=Path), help="File of the numbers, to which others are added.")
@click.option(
    "--page",
    type=click.Path(path_type=Path),
    help=f"Write tables, sections and pictures of all tasks, as in docs/{PAGE.name}.",
)
@click.option("--rules", type=click.Path(path_type=Path), help=f"Write the numbers of all rules, too, as in optimisation/rl/{CHOSEN.name}.")
@click.option("--redraw", is_flag=True, help="The page again from the numbers in --json; only agents of --agents are judged, beside these.")
def main(
    tasks: tuple[str, ...],
    quick: bool,
    judged: int | None,
    agents: Path | None,
    target: Path | None,
    page: Path | None,
    rules: Path | None,
    redraw: bool,
) -> None:
    """Find the best rules of each task, let planners look ahead, and print scores and room."""
    try:
        check_target("--json", target)
        check_target("--page", page)
        check_target("--rules", rules)
        if page is not None:
            require_markers(page, PAGE, MARKERS)
        found = known(target or NUMBERS) if target is not None or redraw else {}
        for task in tasks or [name for name, own in TASKS.items() if own.planned]:
            effort = QUICK if quick else EFFORTS[task]
            effort = replace(effort, judged=judged or effort.judged)
            trained = [] if agents is None else find_agents(agents, FINAL, env_of(task))
            if not redraw:
                with Bar(total=tried(task, effort), desc=task, unit="candidate", leave=False) as bar:
                    found[task] = admit(task, {}, effort, bar.update)
            if task in found:
                add_agents(task, found[task], trained)
            found = {name: found[name] for name in TASKS if name in found}
            if target is not None:
                write_json(target, {"tasks": found})
        click.echo(rooms(found))
        if rules is not None:
            write_json(rules, {name: one["rules"] for name, one in found.items()})
        if page is not None:
            from studies.task_pictures import save_picture  # matplotlib is slow to import

            for name in Bar(NAMES, desc="pictures", unit="task", leave=False):
                save_picture(page.parent / PICTURES / f"{name}.png", name)
            fill(page, PAGE, {"admission": rooms(found), "rules": searches(found), "tasks": described()})
    except ParameterError as error:
        raise BadInput(str(error)) from error
