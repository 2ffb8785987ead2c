"""Shared parts of the commands: options, one-line errors, exit codes, and output files."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass, replace
from functools import partial, reduce, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from impact_env.checks import ParameterError
from impact_env.extras import MissingExtraError
from impact_env.sweep import IntegrationError
from optimisation.calibration.posterior import Posterior, read_posterior
from optimisation.checkpoint import conditions, sources
from optimisation.cli.options import (
    FIGURES,
    FILE,
    HELP_ALL,
    SECTIONS,
    TABLE,
    Command,
    OptionSpec,
    TableOption,
    file_spec,
    is_posterior_file,
    join_words,
    list_specs,
    make_options,
    rename_older,
)
from optimisation.files import (
    HISTORY_FORMATS,
    STANDARD_OUTPUT,
    fill,
    is_writable,
    json_to,
    require_markers,
    require_writable,
    write_files,
)
from optimisation.report.report import Report, list_named_files, render_text

if TYPE_CHECKING:
    from optimisation.report.report import CompleteAnswer

INTERRUPTED = 130  # the shell's exit code after Ctrl-C


class BadInput(click.ClickException):
    """An error of the caller: one line, exit code 2."""

    exit_code = 2


def check_target(option: str, target: Path | None, suffixes: tuple[str, ...] = ()) -> None:
    """Raise BadInput, before any run, if a file cannot be written or has a wrong suffix.

    ``suffixes``: allowed suffixes, with their dots; empty: any. For ``target`` None, or
    standard output, nothing is checked.
    """
    if target is None or target is STANDARD_OUTPUT:
        return
    if not is_writable(target.resolve().parent):
        raise BadInput(
            f"{option} = {target} is not allowed: a file in a folder that exists and can be "
            "written to"
        )
    if target.exists() and not target.is_file():
        raise BadInput(
            f"{option} = {target} is not allowed: a plain file, since it is replaced as a whole"
        )
    if suffixes and target.suffix.lower() not in suffixes:
        raise BadInput(
            f"{option} = {target} is not allowed: a name that ends in {', '.join(suffixes)}"
        )


def numbers(option: str, text: str, kind: type) -> tuple[Any, ...]:
    """Return the comma-separated numbers in ``text``, each converted by ``kind`` (int or float).

    Raises ParameterError, whose message names the ``option``, for any other text.
    """
    try:
        return tuple(kind(part) for part in text.split(","))
    except ValueError as error:
        raise ParameterError(
            f"{option} = {text!r} is not allowed: numbers with commas between"
        ) from error


def page_spec(marker: str, page: str) -> OptionSpec:
    """Return the option --page, which names a page to write a table into.

    The table replaces the text between the comments <!-- marker --> and <!-- /marker -->. The help
    names ``page`` as an example.
    """
    words = (
        f"Write the table into this page, between <!-- {marker} --> and <!-- /{marker} -->, as in "
        f"{page}"
    )
    return replace(TABLE["page"], help=words)


page_option = page_spec


def check_page(page: Path | None, marker: str) -> None:
    """Check, before any run, that a table can be written into the page of --page.

    Raises BadInput if the file cannot be written, and ParameterError if the markers are missing.
    """
    check_target("--page", page)
    if page is not None:
        require_markers(page, page, (marker,))


def fill_page(page: Path | None, marker: str, table: str) -> list[Path]:
    """Write a table into the page of --page, between its markers.

    Versions and machine are written below the table. Returns a list of the page; it is empty if
    ``page`` is None.
    """
    if page is None:
        return []
    fill(page, page, {marker: f"{table}\n\n{sources(conditions())}"})
    return [page]


def stack_options(options: Sequence[Callable[[Command], Command]]) -> Callable[[Command], Command]:
    """Return a decorator that adds several options to a command, in this order."""
    return lambda command: reduce(lambda made, option: option(made), reversed(options), command)


def file_option(name: str, words: str) -> OptionSpec:
    """Return an option ``name`` that takes the name of a file; ``words``: its help."""
    return file_spec(name, words.removesuffix("."))


def out_option(
    folder: str, words: str = "Folder for figure and tables."
) -> Callable[[Command], Command]:
    """Return a decorator that adds --out, a folder for output files; default: ``folder``."""
    return click.option(
        "--out",
        type=click.Path(path_type=Path),
        default=Path(folder),
        show_default=True,
        help=words,
    )


def check_targets(options: dict[str, Any], *suffixes: str) -> None:
    """Raise BadInput if a file of --json, --csv or --plot cannot be written.

    ``options``: the files by the names of their options, without dashes; missing ones are not
    checked. ``suffixes``: allowed suffixes for --json. Default: .json.
    """
    allowed = {"json": suffixes or (".json",), "csv": (".csv",), "plot": FIGURES}
    for name, endings in allowed.items():
        check_target(f"--{name}", options.get(name), endings)


@dataclass(frozen=True)
class AnswerFiles:
    """Folder and files to which an answer is written.

    Attributes
    ----------
    out : Path
        Folder of --out.
    json, device, history : Path or None
        Files of the options with these names; None: not written.
    """

    out: Path
    json: Path | None = None
    device: Path | None = None
    history: Path | None = None

    def check(self) -> None:
        """Check, before any run, that all files can be written.

        Raises BadInput or ParameterError if one of them cannot.
        """
        require_writable("--out", self.out)
        check_targets({"json": self.json})
        check_target("--device", self.device, (".json",))
        check_target("--history", self.history, HISTORY_FORMATS)

    def write(self, answer: CompleteAnswer) -> list[Path]:
        """Print an answer, write its files, and return their paths."""
        click.echo(str(answer))
        files = answer.save(self.out) + write_files({self.json: answer.to_json()})
        if self.history is not None and (run := answer.worst_run()) is not None:
            from optimisation.report.frequency_report import save_history

            files += write_files({self.history: partial(save_history, run=run)})
        if self.device is not None and (scene := answer.device_scene()) is not None:
            files += write_files({self.device: scene})
        return files


def write_report(report: Report, options: Any) -> None:
    """Print a report, and write its numbers, table and figure.

    ``options`` has the attributes ``json``, ``csv`` and ``plot`` of the options with these names;
    for a missing attribute, or None, nothing is written.
    """
    if report.text:
        click.echo(render_text(report))
    targets = (getattr(options, name, None) for name in ("json", "csv", "plot"))
    name_files(write_files(list_named_files(report, *targets)))


threads_option = TABLE["threads"]
seed_option = TABLE["seed"]
rate_option = TABLE["rate"]
cluster_option = TABLE["cluster"]
resume_option = TABLE["resume"]


def json_option(words: str, name: str = "json") -> Callable[[Command], Command]:
    """Return a decorator that adds --json to a command; ``name``: the command's argument.

    With - standard output receives the JSON alone, and all other output goes to standard error.
    """

    def add(command: Command) -> Command:
        @wraps(command)
        def called(**options: Any) -> Any:
            with json_on_standard_output(options[name]) as target:
                return command(**options | {name: target})

        option = click.option("--json", name, type=FILE, metavar="FILE|-", help=words)
        return option(called)

    return add


@contextmanager
def json_on_standard_output(target: Path | None) -> Iterator[Path | None]:
    """Yield the file of --json, `STANDARD_OUTPUT` for -, None without the option.

    For - all printed text goes to standard error, and standard output receives the JSON alone.
    """
    if str(target) != "-":
        yield target
        return
    with json_to(sys.stdout), redirect_stdout(sys.stderr):
        yield STANDARD_OUTPUT


class TableCommand(click.Command):
    """A command whose --help lists the usual options, and --help-all all options.

    The name that an option had in the previous version is accepted with a warning. An option that
    takes one value and is given twice is an error.
    """

    def __init__(
        self,
        *args: Any,
        examples: Sequence[str] = (),
        rewrite: Callable[[list[str]], list[str]] | None = None,
        **settings: Any,
    ) -> None:
        super().__init__(*args, **settings)
        self.examples = tuple(examples)
        self.rewrite = rewrite
        if any(self.is_extra(parameter) for parameter in self.params):
            self.params.append(
                click.Option(
                    ["--help-all"],
                    is_flag=True,
                    is_eager=True,
                    expose_value=False,
                    callback=show_all_options,
                    help="Show every option and exit.",
                )
            )

    @staticmethod
    def is_extra(parameter: click.Parameter) -> bool:
        """Return whether an option is listed by --help-all only."""
        return isinstance(parameter, TableOption) and not parameter.spec.usual

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Replace old names of options, and parse the arguments.

        Returns the arguments left over, as `click.Command.parse_args`. Raises UsageError if an
        option that takes one value is given twice.
        """
        args = rename_older(args, self.params)
        if self.rewrite is not None:
            args = self.rewrite(args)
        counters = {
            name: parameter.spec.count_words
            for parameter in self.params
            if isinstance(parameter, TableOption) and parameter.spec.count_words is not None
            for name in parameter.opts
        }
        args = join_words(args, counters)
        single = [
            parameter
            for parameter in self.params
            if isinstance(parameter, click.Option) and not parameter.multiple
        ]
        once = {name: parameter for parameter in single for name in parameter.opts}
        repeated = [
            once[name] for name in (word.partition("=")[0] for word in args) if name in once
        ]
        for parameter in repeated:
            if repeated.count(parameter) > 1 and not parameter.is_flag:
                times = f"{parameter.opts[0]} is given {repeated.count(parameter)} times"
                raise click.UsageError(
                    f"{times}: once is allowed, as only one of them could count", ctx
                )
        return super().parse_args(ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; errors that it does not handle end as in `plain_errors`."""
        with plain_errors():
            return super().invoke(ctx)

    def format_help_text(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the docstring and the examples.

        --help of a command that has --help-all writes the first two paragraphs only.
        """
        text = inspect.cleandoc(self.help or "")
        if not ctx.meta.get(HELP_ALL) and any(map(self.is_extra, self.params)):
            text = "\n\n".join(text.split("\n\n")[:2])
        formatter.write_paragraph()
        with formatter.indentation():
            formatter.write_text(text)
        if self.examples:
            program = ctx.find_root().info_name
            with formatter.section("Example" if len(self.examples) == 1 else "Examples"):
                for example in self.examples:
                    formatter.write(f"{'':>{formatter.current_indent}}{program} {example}\n")

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the usual options in one list; for --help-all all options in sections."""
        everything = bool(ctx.meta.get(HELP_ALL))
        listed: dict[str, list[tuple[str, str]]] = {}
        options = [one for one in self.get_params(ctx) if isinstance(one, click.Option)]
        for parameter in options:
            record = parameter.get_help_record(ctx)
            if record is None or (self.is_extra(parameter) and not everything):
                continue
            section = parameter.spec.section if isinstance(parameter, TableOption) else "Other"
            listed.setdefault(section, []).append(record)
        sections = [name for name in (*SECTIONS, "Other") if name in listed]
        if everything and len(sections) > 2:
            for name in sections:
                with formatter.section(f"{name} options"):
                    formatter.write_dl(listed[name], col_max=HELP_COLUMN)
            return
        with formatter.section("Options"):
            records = [record for name in sections for record in listed[name]]
            formatter.write_dl(records, col_max=HELP_COLUMN)

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the text at the end of the help, for --help-all only."""
        if ctx.meta.get(HELP_ALL):
            super().format_epilog(ctx, formatter)


HELP_COLUMN = 26  # widest name of an option with its help on the same line


def show_all_options(ctx: click.Context, _: click.Parameter, value: bool) -> None:
    """Print the help with all options and exit; callback of --help-all."""
    if not value or ctx.resilient_parsing:
        return
    ctx.meta[HELP_ALL] = True
    click.echo(ctx.get_help(), color=ctx.color)
    ctx.exit()


def parse_uncertain(values: Iterable[tuple[str, tuple[str, ...]]]) -> dict[str, tuple[str, ...]]:
    """Return the values of --uncertain as a dict, as `Problem.uncertain` has it.

    Each value is a pair of a quantity's name, or a posterior's file, and the words after it. Keys
    are the names, "posterior" for a file. Raises BadInput for a name that is given twice.
    """
    distributions: dict[str, tuple[str, ...]] = {}
    for word, own_words in values:
        is_file = is_posterior_file(word)
        name = "posterior" if is_file else word
        words = (word,) if is_file else own_words
        if name in distributions:
            raise BadInput(
                f"--uncertain {name} is given twice: once is allowed, as only one of them "
                "could count"
            )
        distributions[name] = words
    return distributions


def parse_posterior(values: Iterable[tuple[str, tuple[str, ...]]]) -> Posterior | None:
    """Return the posterior of --uncertain FILE, or None without that option.

    Raises BadInput if --uncertain has a quantity instead of a file, or two files.
    """
    table = parse_uncertain(values)
    file = table.pop("posterior", None)
    for name in table:
        raise BadInput(f"--uncertain {name} is not allowed: the posterior.json of calibrate")
    return None if file is None else read_posterior(Path(file[0]))


COMMAND_SETTINGS = {"help_option_names": ["-h", "--help"], "max_content_width": 100}


def command(
    group: type[Any] | None = None,
    *,
    examples: Sequence[str] = (),
    epilog: str | None = None,
    rewrite: Callable[[list[str]], list[str]] | None = None,
) -> Callable[[Command], TableCommand]:
    """Return a decorator that makes a function a command.

    Parameters
    ----------
    group : type, optional
        Frozen dataclass with the options, see `optimisation.cli.options`; the function takes an
        instance of it. Without it the options are declared by decorators, and the function takes
        them as keyword arguments; ``epilog`` and ``rewrite`` then have no effect.
    examples : sequence of str
        Lines of the help, from the command's name on.
    epilog : str, optional
        Text at the end of the help.
    rewrite : callable, optional
        Function that replaces outdated forms in the list of command-line arguments.
    """

    def make(function: Command) -> TableCommand:
        if group is None:
            made: TableCommand = click.command(
                cls=TableCommand, examples=examples, context_settings=COMMAND_SETTINGS
            )(function)
            return made
        owns_json = "json" in list_specs(group)

        @wraps(function)
        def called(**values: Any) -> Any:
            if not owns_json:
                return function(make_options(group, values))
            with json_on_standard_output(values["json"]) as target:
                return function(make_options(group, values | {"json": target}))

        return TableCommand(
            function.__name__,
            callback=called,
            params=[spec.make_parameter(name) for name, spec in list_specs(group).items()],
            help=function.__doc__,
            epilog=epilog,
            examples=examples,
            rewrite=rewrite,
            context_settings=COMMAND_SETTINGS,
        )

    return make


@contextmanager
def stop_on_interrupt(complete: list[bool]) -> Iterator[None]:
    """End the body of this context at Ctrl-C, set ``complete[0]`` to False, and continue after it.

    The caller then goes on with the results that are finished.
    """
    try:
        yield
    except KeyboardInterrupt:
        complete[0] = False


@contextmanager
def plain_errors(broken_off: str = "Broken off.") -> Iterator[None]:
    """Turn errors and Ctrl-C into one line and an exit code.

    Exit code 2: a value that is not allowed. 1: a missing extra, a run that breaks down, or a file
    that cannot be read or written. 130: Ctrl-C, with ``broken_off`` as its line.
    """
    try:
        yield
    except ParameterError as error:
        raise BadInput(str(error)) from error
    except (IntegrationError, MissingExtraError) as error:
        raise click.ClickException(str(error)) from error
    except BrokenPipeError:  # the reader of the output has ended; click handles it
        raise
    except OSError as error:
        raise click.ClickException(
            f"{error.filename or 'a file'}: {error.strerror or error}"
        ) from error
    except KeyboardInterrupt:  # `stop_on_interrupt` is not in use, so nothing is left to save
        click.echo(broken_off, err=True)
        sys.exit(INTERRUPTED)


def name_files(files: Sequence[Path]) -> None:
    """Print the names of the files written, if there are any."""
    if not files:
        return
    click.echo(
        "\nwritten: "
        + ", ".join("standard output" if file is STANDARD_OUTPUT else str(file) for file in files)
    )


def end_without(winner: bool) -> None:
    """Exit with code 1 and a message if a search has no ``winner``.

    ``winner``: whether a design keeps all constraints.
    """
    if not winner:
        click.echo(
            "No winner: no design kept all constraints; loosen them, or search longer.", err=True
        )
        sys.exit(1)


def end_early(complete: bool, what_remains: str = "the files hold what was finished.") -> None:
    """Exit with code 130, as after Ctrl-C, and a message unless a run is ``complete``."""
    if not complete:
        click.echo(f"Stopped early: {what_remains}", err=True)
        sys.exit(INTERRUPTED)
