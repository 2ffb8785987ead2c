"""The commands by name: ``impact-absorber NAME``, in a checkout also ``scripts/run NAME``.

``scripts/run`` also has the commands that make the pages of the checkout.

A command is the function ``main`` of its module (`optimisation.cli.names`), which is imported when
the command is called, since some take long or need an extra. Names of the version before go on
working, with a note on stderr.
"""

import ast
import difflib
import importlib.util
import os
import sys
from copy import copy
from functools import partial
from pathlib import Path

import click

from impact_env.extras import DISTRIBUTION, EXTRAS, how_to_install
from optimisation.cli.common import INTERRUPTED
from optimisation.cli.names import (
    GROUPS,
    HEADINGS,
    OLDER_DEFAULTS,
    OLDER_NAMES,
    REPRODUCE,
    imported,
    list_commands,
    list_needs,
    list_other_names,
    list_studies,
    name_of,
)


def modules() -> dict[str, Path]:
    """Return the modules of all commands by their names."""
    return list_commands()


def file_of(name: str) -> Path | None:
    """Return the module of a command, None if there is none of this name."""
    return list_commands().get(name_of(name))


def missing_extras(file: Path) -> dict[str, list[str]]:
    """Return the extras that a command needs and that are incomplete in this installation.

    Each comes with the names of the missing packages.
    """
    missing = {
        extra: [
            name
            for name, brings in EXTRAS.items()
            if brings == extra and importlib.util.find_spec(name) is None
        ]
        for extra in list_needs(file)
    }
    return {extra: packages for extra, packages in missing.items() if packages}


def refuse(name: str, missing: dict[str, list[str]], /, **_options: object) -> None:
    """Raise ClickException with the command that installs the extras that a command lacks."""
    packages = ", ".join(package for names in missing.values() for package in names)
    raise click.ClickException(
        f"{name} needs packages that are not installed ({packages}); they come with: "
        f"{how_to_install(*missing)}"
    )


def summary_of(file: Path) -> str:
    """Return the first line of the docstring of a module, without importing it."""
    docstring = ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""
    return docstring.partition("\n")[0].rstrip(".")


class Commands(click.Group):
    """Group of commands whose modules are imported when they are called.

    The names of its commands begin with the words of ``prefix``.
    """

    def __init__(self, prefix: str = "", **settings: object) -> None:
        super().__init__(**settings)  # type: ignore[arg-type]
        self.prefix = prefix

    def own_commands(self) -> dict[str, Path]:
        """Return the modules of this group's commands, by their names in it."""
        start = f"{self.prefix} " if self.prefix else ""
        return {
            name.removeprefix(start): file
            for name, file in list_commands().items()
            if name.startswith(start) and (self.prefix or " " not in name)
        }

    def own_groups(self) -> list[str]:
        """Return the names of the groups in this one."""
        if self.prefix:
            return []
        return [name for name in GROUPS if name != REPRODUCE or list_studies()]

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002 - click's own signature
        """Return all names that are listed."""
        return sorted([*self.own_commands(), *self.own_groups()])

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        """Return a command, or None if no command has this name.

        Without an extra that it needs, the command can only show its options.
        """
        if cmd_name in self.own_groups():
            return make_group(cmd_name)
        name = f"{self.prefix} {cmd_name}" if self.prefix else name_of(cmd_name)
        file = list_commands().get(name)
        if file is None:
            return None
        try:
            command: click.Command = copy(imported(name).main)
        except KeyboardInterrupt:  # click would call it an error of its own
            click.echo("Broken off.", err=True)
            sys.exit(INTERRUPTED)
        if missing := missing_extras(file):
            command.callback = partial(refuse, name, missing)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the command that is called.

        Raises UsageError with the most similar names if no command has this name.
        """
        word = args[0]
        others = {} if self.prefix else list_other_names()
        if not self.prefix and word in OLDER_NAMES:
            click.echo(
                (
                    f"note: {word} is called {others[word]} now; the next version does not know "
                    "the older name"
                ),
                err=True,
            )
        elif (
            word not in others and not word.startswith("-") and word not in self.list_commands(ctx)
        ):
            self.refuse_name(ctx, word)
        return super().resolve_command(ctx, args)

    def refuse_name(self, ctx: click.Context, word: str) -> None:
        """Raise UsageError for a command that there is not, with the names that are most alike."""
        start = f"{self.prefix} " if self.prefix else ""
        names = {name.replace(" ", "-"): name for name in list_commands()}
        names |= {name.rpartition(" ")[2]: name for name in list_commands()}
        names |= {name: name for name in self.own_groups()}
        if self.prefix:
            names = {name: f"{start}{name}" for name in self.own_commands()}
        alike = difflib.get_close_matches(word.replace("_", "-"), names)
        suggestions = dict.fromkeys(names[name] for name in alike)
        ctx.fail(
            f"there is no command {start}{word}"
            + (f"; did you mean {' or '.join(suggestions)}?" if suggestions else "")
        )

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        """Write the names of the commands with the first line of each module's docstring.

        The complete list of commands has headings.
        """
        if self.prefix:
            with formatter.section("Commands"):
                formatter.write_dl(
                    [(name, summary_of(file)) for name, file in self.own_commands().items()]
                )
            return
        known = list_commands()
        groups = self.own_groups()
        for heading, names in HEADINGS.items():
            words = dict.fromkeys(name.partition(" ")[0] for name in names)
            lines = [(name, summary_of(known[name])) for name in names]
            if heading not in EXPANDED:  # one line for each group
                lines = [(f"{word} NAME", GROUPS[word]) for word in words]
            if heading == LAST and REPRODUCE in groups:
                lines.append((f"{REPRODUCE} NAME", GROUPS[REPRODUCE]))
            with formatter.section(heading):
                formatter.write_dl(lines)


EXPANDED = ("Simulate", "Design an absorber", "This installation")  # headings with every command
LAST = "This installation"
GROUP_SETTINGS = {"help_option_names": ["-h", "--help"], "max_content_width": 100}


def make_group(name: str) -> Commands:
    """Return a group of commands, as ``design``."""
    return Commands(
        prefix=name,
        name=name,
        help=f"{GROUPS[name]}.\n\n{name} NAME --help lists the options of a command.",
        subcommand_metavar="NAME [OPTIONS]",
        options_metavar="",
        context_settings=GROUP_SETTINGS,
    )


@click.command(
    cls=Commands,
    subcommand_metavar="NAME [OPTIONS]",
    options_metavar="",
    context_settings={**GROUP_SETTINGS, "default_map": OLDER_DEFAULTS},
)
@click.version_option(package_name=DISTRIBUTION)
def main() -> None:
    """Simulate, compare and design absorbers on a vibrating beam.

    NAME --help lists the usual options of a command, NAME --help-all every one.
    """
    os.environ["MPLBACKEND"] = "Agg"  # figures go to files


if __name__ == "__main__":
    main(prog_name="impact-absorber")
