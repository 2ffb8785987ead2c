"""The console command ``impact-absorber NAME``: the studies of ``scripts/run``, also where there is neither a checkout nor a shell.

A wheel brings scripts/ and what they read of docs/ in the folder ``shipped``; in a checkout they are used where they lie.
"""

from __future__ import annotations

import ast
import importlib
import importlib.util
import os
import re
import sys
from copy import copy
from functools import partial
from pathlib import Path

import click

from impact_env.extras import EXTRAS, how_to_install
from optimisation.command_line import INTERRUPTED

NEEDS = re.compile(r"^# needs: *(.*)$", re.MULTILINE)
HEAD_LINES = 40  # a script says near its top what it needs


def scripts_folder() -> Path:
    """Return the folder of the scripts: the wheel's, else the checkout's."""
    shipped = Path(__file__).with_name("shipped") / "scripts"
    return shipped if shipped.is_dir() else Path(__file__).resolve().parents[1] / "scripts"


def missing_extras(script: Path) -> dict[str, list[str]]:
    """Return the extras that a script needs and that are not complete here, each with the packages that are missing."""
    head = "\n".join(script.read_text(encoding="utf-8").splitlines()[:HEAD_LINES])
    needed = [extra for line in NEEDS.findall(head) for extra in line.replace(",", " ").split()]
    missing = {extra: [name for name, brings in EXTRAS.items() if brings == extra and importlib.util.find_spec(name) is None] for extra in needed}
    return {extra: packages for extra, packages in missing.items() if packages}


def refuse(script: str, missing: dict[str, list[str]], **_options: object) -> None:
    """Raise ClickException with the command that installs the extras that a script lacks."""
    packages = ", ".join(package for names in missing.values() for package in names)
    raise click.ClickException(f"{script} needs packages that are not installed ({packages}); they come with: {how_to_install(*missing)}")


def first_line(script: Path) -> str:
    """Return the first line of what a script says about itself."""
    return (ast.get_docstring(ast.parse(script.read_text(encoding="utf-8"))) or "").partition("\n")[0]


class Studies(click.Group):
    """One sub-command for each script; a script is imported when it is called, since some take long or need an extra."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002 - click's own signature
        """Return the names of all scripts."""
        return sorted(file.stem for file in scripts_folder().glob("[!_]*.py"))

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return a script's command, None if there is no such script; without an extra that the script needs, it can tell its options only."""
        if cmd_name not in self.list_commands(ctx):
            return None
        folder = scripts_folder()
        if str(folder) not in sys.path:
            sys.path.insert(0, str(folder))  # the scripts import one another
        try:
            command: click.Command = importlib.import_module(cmd_name).main
        except KeyboardInterrupt:  # click would call it an error of its own
            click.echo("Broken off.", err=True)
            sys.exit(INTERRUPTED)
        if missing := missing_extras(folder / f"{cmd_name}.py"):
            command = copy(command)
            command.callback = partial(refuse, cmd_name, missing)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list of scripts without importing one."""
        with formatter.section("NAME is one of"):
            formatter.write_dl([(name, first_line(scripts_folder() / f"{name}.py")) for name in self.list_commands(ctx)])


@click.command(
    cls=Studies,
    subcommand_metavar="NAME [OPTIONS]",
    options_metavar="",
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 160},
)
def main() -> None:
    """Run a study of absorbers on a vibrating beam. NAME --help lists its options; results go to the folder results of the current one."""
    os.environ["MPLBACKEND"] = "Agg"  # figures go to files


if __name__ == "__main__":
    main(prog_name="impact-absorber")
