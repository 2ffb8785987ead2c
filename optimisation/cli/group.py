"""The commands by name: ``impact-absorber NAME`` anywhere, ``scripts/run NAME`` in a checkout, which also has those that make its pages.

A command is the function ``main`` of the module of its name; a module is imported when its command is called, since some take long or need an extra.
``periodic`` is a group of its own, whose subcommands are those of `PERIODIC`.
"""

import ast
import difflib
import importlib
import importlib.util
import os
import re
import sys
from copy import copy
from functools import partial
from pathlib import Path
from types import ModuleType

import click

from impact_env.extras import DISTRIBUTION, EXTRAS, how_to_install
from optimisation.cli.common import INTERRUPTED

HERE = Path(__file__).parent
PAGES = Path(__file__).resolve().parents[2] / "scripts" / "studies" / "cli"  # a checkout's
HEADINGS = {
    "Explore": ("explore", "structure"),
    "Simulate": ("sweep", "compare_absorbers", "render_episode"),
    "Design": (
        "design_gap",
        "design_place",
        "optimise_design",
        "pareto",
        "mass_ratios",
        "tune_ltva",
    ),
    "Measure": ("calibrate",),
    "Periodic responses": ("periodic", "frequency_response", "balance_error"),
    "Learn": ("train", "judge", "record_demonstrations"),
    "This installation": ("doctor", "prepare", "cache"),
}
# subcommands of ``periodic``, in the order of its help, and their modules
PERIODIC = {
    "orbits": "orbits",
    "curves": "curves",
    "isola": "isola",
    "manifold": "manifold",
    "basins": "basins",
    "diagram": "diagram",
    "section": "section",
}
OLDER_NAMES = ("orbits", "isola", "manifold")  # subcommands that are also commands, not listed
NEEDS = re.compile(r"^# needs: *(.*)$", re.MULTILINE)
HEAD_LINES = 40  # a command says near its top what it needs


def files() -> dict[str, dict[str, Path]]:
    """Return the module of each command, by heading and name; in a checkout also of those that make pages."""
    by_heading = {
        heading: {name: HERE / f"{name}.py" for name in names}
        for heading, names in HEADINGS.items()
    }
    if PAGES.is_dir():
        by_heading["Pages and benchmarks of this checkout"] = {
            file.stem: file for file in sorted(PAGES.glob("[!_]*.py"))
        }
    return by_heading


def subcommand_files() -> dict[str, Path]:
    """Return the modules of the subcommands of ``periodic``, by their names."""
    return {name: HERE / f"{module}.py" for name, module in PERIODIC.items()}


def modules() -> dict[str, Path]:
    """Return the files of all modules that are a command or a subcommand, by the names of the modules."""
    known = {name: file for commands in files().values() for name, file in commands.items()}
    return known | {file.stem: file for file in subcommand_files().values()}


def file_of(name: str) -> Path | None:
    """Return the file of the module of a command or subcommand, None if there is none of this name."""
    return modules().get(name)


def imported(name: str) -> ModuleType:
    """Return the module of a command that there is."""
    return importlib.import_module(
        f"optimisation.cli.{name}" if (HERE / f"{name}.py").exists() else f"studies.cli.{name}"
    )


def missing_extras(file: Path) -> dict[str, list[str]]:
    """Return the extras that a command needs and that are not complete here, each with the packages that are missing."""
    head = "\n".join(file.read_text(encoding="utf-8").splitlines()[:HEAD_LINES])
    needed = [extra for line in NEEDS.findall(head) for extra in line.replace(",", " ").split()]
    missing = {
        extra: [
            name
            for name, brings in EXTRAS.items()
            if brings == extra and importlib.util.find_spec(name) is None
        ]
        for extra in needed
    }
    return {extra: packages for extra, packages in missing.items() if packages}


def refuse(name: str, missing: dict[str, list[str]], /, **_options: object) -> None:
    """Raise ClickException with the command that installs the extras that a command lacks."""
    packages = ", ".join(package for names in missing.values() for package in names)
    raise click.ClickException(
        f"{name} needs packages that are not installed ({packages}); they come with: {how_to_install(*missing)}"
    )


class Commands(click.Group):
    """Commands whose modules are imported when they are called."""

    def sections(self) -> dict[str, dict[str, Path]]:
        """Return the commands that help lists: the file of each, by heading and name."""
        return files()

    def older(self) -> dict[str, Path]:
        """Return further names of commands, which are not listed."""
        return {name: HERE / f"{PERIODIC[name]}.py" for name in OLDER_NAMES}

    def file_of(self, name: str) -> Path | None:
        """Return the file of a command of this group, None if there is none of this name."""
        known = self.older()
        for commands in self.sections().values():
            known |= commands
        return known.get(name)

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002 - click's own signature
        """Return all names that are listed."""
        return sorted(name for commands in self.sections().values() for name in commands)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        """Return a command, None if there is none of this name; without an extra that it needs, it can tell its options only."""
        file = self.file_of(cmd_name)
        if file is None:
            return None
        try:
            command: click.Command = imported(file.stem).main
        except KeyboardInterrupt:  # click would call it an error of its own
            click.echo("Broken off.", err=True)
            sys.exit(INTERRUPTED)
        if missing := missing_extras(file):
            command = copy(command)
            command.callback = partial(refuse, cmd_name, missing)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the command that is called; raises UsageError, with the names that are most alike, if there is none."""
        if not args[0].startswith("-") and self.file_of(args[0]) is None:
            alike = difflib.get_close_matches(args[0], self.list_commands(ctx))
            ctx.fail(
                f"there is no command {args[0]}"
                + (f"; did you mean {' or '.join(alike)}?" if alike else "")
            )
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        """Write the names under their headings, with the first line of each module's docstring, without importing a command."""
        for heading, commands in self.sections().items():
            docstrings = {
                name: ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""
                for name, file in commands.items()
            }
            with formatter.section(heading):
                formatter.write_dl(
                    [(name, words.partition("\n")[0]) for name, words in docstrings.items()]
                )


GROUP_SETTINGS = {"help_option_names": ["-h", "--help"], "max_content_width": 160}


@click.command(
    cls=Commands,
    subcommand_metavar="NAME [OPTIONS]",
    options_metavar="",
    context_settings=GROUP_SETTINGS,
)
@click.version_option(package_name=DISTRIBUTION)
def main() -> None:
    """Simulate, compare and design absorbers on a vibrating beam. NAME --help lists the options of a command.

    Results go to the folder results of the current one. The shell completes names and options: docs/installation.md.
    """
    os.environ["MPLBACKEND"] = "Agg"  # figures go to files


if __name__ == "__main__":
    main(prog_name="impact-absorber")
