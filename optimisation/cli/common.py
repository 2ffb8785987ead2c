"""Shared parts of the commands: errors in one line, exit codes, and checks of files to be written."""

import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from functools import partial, reduce, wraps
from pathlib import Path
from typing import Any

import click

from impact_env.extras import MissingExtraError
from impact_env.parameters import ParameterError
from impact_env.sweep import IntegrationError
from optimisation.files import STANDARD_OUTPUT, is_writable, json_to
from optimisation.machine import conditions, sources
from optimisation.page import fill, require_markers

INTERRUPTED = 130  # the shell's exit code after Ctrl-C
FIGURES = (".png", ".pdf", ".svg")
FILE = click.Path(dir_okay=False, path_type=Path)
Command = Callable[..., Any]


class BadInput(click.ClickException):
    """An error of the caller: one line, exit code 2."""

    exit_code = 2


def check_target(option: str, target: Path | None, suffixes: tuple[str, ...] = ()) -> None:
    """Raise BadInput, before any work is done, if a file cannot be written or has a suffix other than ``suffixes``."""
    if target is None or target is STANDARD_OUTPUT:
        return
    if not is_writable(target.resolve().parent):
        raise BadInput(
            f"{option} = {target} is not allowed: a file in a folder that exists and can be written to"
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
    """Return comma-separated numbers; raises ParameterError that names the option."""
    try:
        return tuple(kind(part) for part in text.split(","))
    except ValueError as error:
        raise ParameterError(
            f"{option} = {text!r} is not allowed: numbers with commas between"
        ) from error


def page_option(marker: str, page: str) -> Callable[[Command], Command]:
    """Add --page, for a table between two comments that hold the ``marker``, as in ``page``."""
    words = f"Write the table into this page, between <!-- {marker} --> and <!-- /{marker} -->, as in {page}."
    return file_option("--page", words)


def check_page(page: Path | None, marker: str) -> None:
    """Raise BadInput or ParameterError, before any work is done, if the table of `page_option` cannot be written."""
    check_target("--page", page)
    if page is not None:
        require_markers(page, page, (marker,))


def fill_page(page: Path | None, marker: str, table: str) -> list[Path]:
    """Write a table and where it was made into the page of `page_option`, if there is one; return the page."""
    if page is None:
        return []
    fill(page, page, {marker: f"{table}\n\n{sources(conditions())}"})
    return [page]


def stack_options(options: Sequence[Callable[[Command], Command]]) -> Callable[[Command], Command]:
    """Return a decorator that adds several options to a command, in this order."""
    return lambda command: reduce(lambda made, option: option(made), reversed(options), command)


def file_option(name: str, words: str) -> Callable[[Command], Command]:
    """Add an option that names a file."""
    return click.option(name, type=FILE, metavar="FILE", help=words)


def out_option(
    folder: str, words: str = "Folder for figure and tables."
) -> Callable[[Command], Command]:
    """Add --out, a folder for what is written."""
    return click.option(
        "--out",
        type=click.Path(path_type=Path),
        default=Path(folder),
        show_default=True,
        help=words,
    )


def check_targets(options: dict[str, Any], *suffixes: str) -> None:
    """Check --json (``suffixes``: .json unless given), --csv and --plot, as far as a command has them."""
    allowed = {"json": suffixes or (".json",), "csv": (".csv",), "plot": FIGURES}
    for name, endings in allowed.items():
        check_target(f"--{name}", options.get(name), endings)


threads_option = click.option(
    "--threads",
    type=click.IntRange(min=1),
    help="Number of threads; the result does not depend on it.  [default: all cores]",
)
seed_option = click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Seed of the phases and forces.",
)
RATE_HELP = (
    "Sweep rate in % per 100 pseudo periods.  [default: 1, less by the square of damping below 1 %]"
)
rate_option = click.option("--rate", type=float, help=RATE_HELP)
plot_option = file_option("--plot", "Draw it: .png, .pdf or .svg.")
RESUME = "Keep each finished piece in this file, and take from it what is there: goes on where a run was stopped."
resume_option = file_option("--resume", RESUME)


def json_option(words: str, name: str = "json") -> Callable[[Command], Command]:
    """Add --json to a command; with - the JSON is all that goes to standard output, and what else the command says to standard error."""

    def add(command: Command) -> Command:
        @wraps(command)
        def called(**options: Any) -> Any:
            if str(options[name]) != "-":
                return command(**options)
            with json_to(sys.stdout), redirect_stdout(sys.stderr):
                return command(**options | {name: STANDARD_OUTPUT})

        return click.option("--json", name, type=FILE, metavar="FILE|-", help=words)(called)

    return add


OLDER = {
    "--percent-per-100-periods": "--rate",
    "--figure": "--plot",
}  # names of options of the version before, and theirs of now


class Uncertain(click.ParamType):  # type: ignore[type-arg, unused-ignore]
    """A name of `optimisation.uncertain.NAMES` with a standard deviation in % or two numbers: as many words as it takes, which `OneCommand` joins."""

    name = "name 5%|low high"

    def convert(
        self,
        value: object,
        param: click.Parameter | None,  # noqa: ARG002
        ctx: click.Context | None,  # noqa: ARG002
    ) -> tuple[str, tuple[str, ...]]:
        """Return the name and its words."""
        name, *words = str(value).split(" ")
        return name, tuple(words)


def is_posterior_file(words: Sequence[str]) -> bool:
    """Return whether the first of some words is the name of a posterior's file."""
    return bool(words) and words[0].lower().endswith((".json", ".json.gz"))


def join_words(args: list[str], known: Iterable[str]) -> list[str]:
    """Return arguments with the words of each option of ``known`` as one: a name, and either one that ends in % or two; or a posterior's file."""
    words_joined = list[str]()
    k = 0
    while k < len(args):
        words_joined.append(args[k])
        if args[k] in known:
            percent = [word.endswith("%") for word in args[k + 2 : k + 4]]
            count = 2 if percent[:1] == [True] and percent[1:] != [True] else 3
            if is_posterior_file(args[k + 1 : k + 2]):
                count = 1
            words = args[k + 1 : k + 1 + count]
            words_joined += [" ".join(words)] if words else []
            k += len(words)
        k += 1
    return words_joined


class OneCommand(click.Command):
    """A command that takes an option by its older name, too, with a notice, and one that is given twice not at all."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Put the names of now in the place of older ones; raises UsageError for an option that is given twice and takes one value."""
        known = {name for parameter in self.params for name in parameter.opts}
        for k, word in enumerate(args):
            name, equals, value = word.partition("=")
            if name in OLDER and name not in known:
                click.echo(
                    f"warning: {name} is called {OLDER[name]} now; the next version does not know the older name",
                    err=True,
                )
                args[k] = OLDER[name] + equals + value
        args = join_words(
            args,
            {
                name
                for parameter in self.params
                if isinstance(parameter.type, Uncertain)
                for name in parameter.opts
            },
        )
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
        """Run the command; whatever it does not handle itself ends as `plain_errors` says."""
        with plain_errors():
            return super().invoke(ctx)


uncertain_option = click.option(
    "--uncertain",
    multiple=True,
    type=Uncertain(),
    metavar="NAME 5%|LOW HIGH",
    help="damping, frequency, force, gap, restitution or friction is not known: normal with this standard deviation, cut at 3; or "
    "uniform, in SI units or in %. May be repeated. With design_gap also the posterior.json of calibrate.",
)


def parse_uncertain(values: Iterable[tuple[str, tuple[str, ...]]]) -> dict[str, tuple[str, ...]]:
    """Return the values of --uncertain in the form of Python's ``uncertain=``; raises BadInput for a name that is given twice."""
    distributions: dict[str, tuple[str, ...]] = {}
    for word, own_words in values:
        is_file = is_posterior_file([word])
        name = "posterior" if is_file else word
        words = (word,) if is_file else own_words
        if name in distributions:
            raise BadInput(
                f"--uncertain {name} is given twice: once is allowed, as only one of them could count"
            )
        distributions[name] = words
    return distributions


command = partial(
    click.command,
    cls=OneCommand,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 150},
)


@contextmanager
def stop_on_interrupt(complete: list[bool]) -> Iterator[None]:
    """Let Ctrl-C end what runs, set ``complete[0]`` to False then, and go on with what is finished."""
    try:
        yield
    except KeyboardInterrupt:
        complete[0] = False


@contextmanager
def plain_errors(broken_off: str = "Broken off.") -> Iterator[None]:
    """Turn a bad value, a missing extra, a run that breaks down, a file that cannot be written, and Ctrl-C into one line and an exit code."""
    try:
        yield
    except ParameterError as error:
        raise BadInput(str(error)) from error
    except (IntegrationError, MissingExtraError) as error:
        raise click.ClickException(str(error)) from error
    except BrokenPipeError:  # who reads the output has gone, which click knows how to end
        raise
    except OSError as error:
        raise click.ClickException(
            f"{error.filename or 'a file'}: {error.strerror or error}"
        ) from error
    except KeyboardInterrupt:  # where a script does not keep what is finished, or keeps it already
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
    """Exit with 1 if a search came to its end and found nothing that keeps all constraints."""
    if not winner:
        click.echo(
            "No winner: no design kept all constraints; loosen them, or search longer.", err=True
        )
        sys.exit(1)


def end_early(complete: bool, what_remains: str = "the files hold what was finished.") -> None:
    """Exit with the code of Ctrl-C if a run did not come to its end."""
    if not complete:
        click.echo(f"Stopped early: {what_remains}", err=True)
        sys.exit(INTERRUPTED)
