"""A study: cases measured as plain values, stored as JSON and shown on a page.

The page has figures. `run` executes the study.

A new one is its cases with a function that measures their rows, the text of its tables and figures,
and a command with its options in ``cli``. `cli.reference_levels` has one table and all in one file;
`accuracy` has parts with rows by case, files and figures of their own.
"""

import sys
import time
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import KW_ONLY, dataclass, field
from functools import wraps
from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeVar

import click
import numpy as np
from numpy.typing import NDArray

from impact_env import IntegrationError, ParameterError
from optimisation.checkpoint import PACKAGES, conditions, sources
from optimisation.cli.common import (
    check_target,
    end_early,
    json_option,
    name_files,
    page_option,
    plain_errors,
)
from optimisation.cli.options import Command
from optimisation.executors import BAR, Bar
from optimisation.files import (
    DOCS,
    fill,
    has_markers,
    markdown,
    read_json,
    replacing,
    require_markers,
    require_writable,
    write_csv,
    write_json,
)

Json = dict[str, Any]
Array = NDArray[np.float64]
Steps = Generator[Json, None, None]
Saver = Callable[[Path], None]  # writes a figure; the ending of the path chooses the format
S = TypeVar("S")
T = TypeVar("T")


def not_none(value: T | None) -> T:
    """Return a value that the caller knows to be there; raises AssertionError for None."""
    assert value is not None
    return value


@dataclass(frozen=True)
class Measurement:
    """The known values of a part, with the ``conditions`` under which they were measured.

    ``complete`` says whether all values are known.
    """

    values: Json
    conditions: Json = field(default_factory=dict)
    complete: bool = True


class CsvTable(NamedTuple):
    """A CSV file: its name without the ending, columns and rows."""

    name: str
    columns: Sequence[str]
    rows: Iterable[Sequence[object]]


@dataclass(frozen=True)
class Part(Generic[S]):
    """What is measured together and kept in one JSON file.

    ``measure(settings, known)`` yields, after each of its ``steps(settings, known)``, all values
    that are known by then; what it yielded last is kept however it ends. ``known`` are the values
    of an earlier run to go on from, else empty. ``steps`` is None where it shows a bar of its own.

    The rest tells of what was measured: ``sections`` the text between the page's ``markers``,
    ``tables`` the CSV files, ``figures`` by file name, a PNG where it has no ending, ``summary``
    what is printed (the sections, if it is None), and ``failures`` what makes the exit code 1.

    ``key_values(settings)``: values on which all others depend. A part that has some goes on from
    its file whenever these are the same in it.
    """

    name: str
    title: str
    _: KW_ONLY
    measure: Callable[[S, Json], Steps]
    markers: tuple[str, ...]
    sections: Callable[[Measurement], Mapping[str, str]]
    steps: Callable[[S, Json], int] | None = None
    tables: Callable[[Measurement], Iterable[CsvTable]] = lambda _: ()
    figures: Callable[[Measurement], Mapping[str, Saver]] = lambda _: {}
    summary: Callable[[Measurement], str] | None = None
    failures: Callable[[Measurement], Sequence[str]] = lambda _: ()
    key_values: Callable[[S], Json] = lambda _: {}


def to_file_content(measured: Measurement) -> Json:
    """Return the content of a part's JSON file.

    It has ``conditions``, ``complete``, and the values by name.
    """
    return {"conditions": measured.conditions, "complete": measured.complete, **measured.values}


def from_file_content(content: Json) -> Measurement:
    """Return the inverse of `to_file_content`; raises KeyError for the content of another file."""
    values = {
        name: value for name, value in content.items() if name not in ("conditions", "complete")
    }
    return Measurement(values, dict(content["conditions"]), bool(content["complete"]))


@dataclass(frozen=True)
class Study(Generic[S]):
    """Parts by name; each has its own JSON file.

    Attributes
    ----------
    parts : tuple of Part
        The parts.
    notes : callable
        Returns entries of the conditions, from the settings.
    packages : tuple of str
        Packages whose versions are conditions.
    same : tuple of str
        Conditions that must be equal for a run to continue an earlier one.
    stopped_message : str
        Message after an interruption.
    key : callable or None
        Returns all values on which a part's numbers depend; a file with another key is not
        continued. None: only the conditions decide.
    """

    parts: tuple[Part[S], ...]
    notes: Callable[[S], Json] = lambda _: {}
    packages: tuple[str, ...] = PACKAGES
    same: tuple[str, ...] = ("processor", "versions", "quick")
    stopped_message: str = "the files hold what was finished."
    key: Callable[[str, S], Json] | None = None

    def chosen(self, names: Sequence[str]) -> list[Part[S]]:
        """Return the named parts in their own order; all if none is named."""
        return [part for part in self.parts if not names or part.name in names]


@dataclass(frozen=True)
class OutputPaths:
    """Paths of the results.

    PART.json.gz and all other files go into ``folder``, or only the JSON file to ``json``. Sections
    go into ``page``, which starts as ``template``.
    """

    folder: Path | None = None
    page: Path | None = None
    template: Path | None = None
    json: Path | None = None

    def numbers(self, name: str) -> Path | None:
        """Return the JSON file of a part."""
        return self.json or (self.folder and self.folder / f"{name}.json.gz")


def paths_with_page(out: Path, names: Iterable[str]) -> OutputPaths:
    """Return the paths of results that all go into one folder.

    Sections go into the page FOLDER.md next to the folder, if it exists and has markers for them.
    """
    page = (out if out.name else out.resolve()).with_suffix(".md")  # "." has no name
    if not page.is_file():
        return OutputPaths(out)
    text = page.read_text(encoding="utf-8")
    missing = [name for name in names if not has_markers(text, name)]
    if missing:
        click.echo(f"{page} has no place for {', '.join(missing)}", err=True)
    return OutputPaths(out, None if missing else page)


def paths_next_to_page(out: Path, name: str, data: Path | None = None) -> OutputPaths:
    """Return the paths of a study whose page NAME.md is in ``out``.

    The other files are in ``data``, or in ``out`` if ``data`` is None.
    """
    return OutputPaths(data or out, out / f"{name}.md", DOCS / f"{name}.md")


# How a study is carried out: the bar, Ctrl-C, going on from an earlier run, drawing anew from the
# files, machine and sources, and the exit code.

WRITE_INTERVAL_S = (
    30.0  # what is measured is written this often at least, where a step does not take longer
)


def run(
    study: Study[S],
    settings: S,
    place: OutputPaths,
    *,
    only: Sequence[str] = (),
    redraw: bool = False,
    resume: bool = False,
) -> None:
    """Measure the parts of a study, and write, draw and print the results.

    All parts are measured if ``only`` names none. With ``redraw`` they are read from their files
    instead.

    ``resume``: go on from files of runs that were stopped.

    Exits with 1 if something failed, 2 with bad input, 130 if the run was stopped; each with one
    message.
    """
    with plain_errors(f"Stopped early: {study.stopped_message}"):
        parts = study.chosen(only)
        if place.folder is not None:
            require_writable("--out", place.folder)
        if redraw:
            parts = find_measured_parts(parts, place, bool(only))
        if place.page is not None:
            require_markers(
                place.page,
                place.template or place.page,
                [marker for part in parts for marker in part.markers],
            )
        failures: list[str] = []
        for part in parts:
            measured = (
                read_measurement(part, place)
                if redraw
                else measure_or_resume(study, part, settings, place, resume)
            )
            publish(
                part,
                measured,
                place,
                [] if redraw else [file for file in [place.numbers(part.name)] if file],
            )
            failures += part.failures(measured)
            if not redraw and measured.conditions.get("failure"):
                raise click.ClickException(
                    f"{part.name} is not complete: {measured.conditions['failure']}"
                )
            if not redraw:
                end_early(measured.complete, study.stopped_message)
    if failures:
        sys.exit(1)


def find_measured_parts(parts: list[Part[S]], place: OutputPaths, named: bool) -> list[Part[S]]:
    """Return the parts for which files exist, or all if the caller has ``named`` them."""
    files = {part.name: place.numbers(part.name) for part in parts}
    present = [
        part
        for part in parts
        if named or ((file := files[part.name]) is not None and file.exists())
    ]
    if not present:
        raise ParameterError(
            f"--out = {place.folder} is not allowed with --redraw: a folder with results of "
            f"{', '.join(files)}"
        )
    return present


def read_measurement(part: Part[S], place: OutputPaths, option: str = "--redraw") -> Measurement:
    """Return the measurement of an earlier run.

    Raises ParameterError if the file does not exist or has other content.
    """
    path = place.numbers(part.name)
    assert path is not None
    try:
        return from_file_content(dict(read_json(path)))
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise ParameterError(
            f"{option}: {path} is not allowed: a file that an earlier run of this command "
            f"wrote ({error})"
        ) from error


def measure_or_resume(
    study: Study[S], part: Part[S], settings: S, place: OutputPaths, resume: bool
) -> Measurement:
    """Measure a part and write its numbers.

    With ``resume``, a part that an earlier run has finished is not measured again.
    """
    path = place.numbers(part.name)
    earlier = None
    resume_values = part.key_values(settings)
    if (resume or resume_values) and path is not None and path.exists():
        earlier = read_measurement(part, place, "--resume" if resume else "--out")
        if study.key is not None and earlier.conditions.get("key") != study.key(
            part.name, settings
        ):
            earlier = None
        elif resume_values:
            earlier = (
                earlier
                if all(earlier.values.get(name) == value for name, value in resume_values.items())
                else None
            )
        elif earlier.complete:
            return earlier
        else:
            old = earlier.conditions
            new = conditions(study.packages) | study.notes(settings)
            for name in study.same:
                if old.get(name) != new.get(name):
                    raise ParameterError(
                        f"--resume is not allowed: with the same {name} as the earlier run, "
                        f"{old.get(name)}, not {new.get(name)}"
                    )

    def write(measured: Measurement) -> None:
        if path is not None:
            write_json(path, to_file_content(measured))

    return measure(study, part, settings, earlier, write)


def measure(
    study: Study[S],
    part: Part[S],
    settings: S,
    earlier: Measurement | None = None,
    keep: Callable[[Measurement], object] = lambda _: None,
) -> Measurement:
    """Measure a part, or what is missing in ``earlier``.

    After Ctrl-C or a failed run, the values known so far are returned. If there are none, the
    exception is raised.

    What is known is handed to ``keep`` every now and then, and at the end.
    """
    made = conditions(study.packages)
    values = earlier.values if earlier else {}
    began = time.perf_counter()
    if earlier is not None:
        began -= earlier.conditions["wall_s"]

    def earlier_values(ended: bool, failure: str = "") -> Measurement:
        taken: Json = (
            {"wall_s": round(time.perf_counter() - began, 1)}
            | study.notes(settings)
            | ({"failure": failure} if failure else {})
        )
        taken |= {} if study.key is None else {"key": study.key(part.name, settings)}
        result = Measurement(values, made | taken, ended)
        keep(result)
        return result

    total = part.steps(settings, values) if part.steps else None
    selection = time.perf_counter()
    with (
        Bar(total=total, desc=part.name, bar_format=BAR, disable=total is None) as bar,
        closing(part.measure(settings, values)) as steps,
    ):
        try:
            for values in steps:  # noqa: B007 - `known` reads it
                bar.update()
                if time.perf_counter() - selection > WRITE_INTERVAL_S:
                    earlier_values(ended=False)
                    selection = time.perf_counter()
        except (KeyboardInterrupt, IntegrationError) as error:
            if not values:
                raise
            return earlier_values(
                ended=False, failure="" if isinstance(error, KeyboardInterrupt) else str(error)
            )
    return earlier_values(ended=True)


def publish(
    part: Part[S], measured: Measurement, place: OutputPaths, written: Sequence[Path] = ()
) -> None:
    """Write a part's CSV files, figures and sections of the page, and print the results.

    The names of all files ``written`` are printed too.
    """
    sections = part.sections(measured)
    click.echo(
        part.summary(measured)
        if part.summary
        else f"{part.title}\n\n" + "\n\n".join(sections.values())
    )
    files = list(written)
    if place.folder is not None:
        for table in part.tables(measured):
            files.append(place.folder / f"{table.name}.csv")
            write_csv(files[-1], table.columns, table.rows)
        for name, save in part.figures(measured).items():
            files.append(place.folder / (name if "." in name else f"{name}.png"))
            with replacing(files[-1]) as temporary:
                save(temporary)
    if place.page is not None:
        files.append(place.page)
        fill(place.page, place.template or place.page, sections)
    if files:
        name_files(files)


# Parts of a usual kind.


def measure_rows_by_case(
    cases: Mapping[Any, Callable[[], list[Json]]], key: Callable[[Json], Any], earlier: Json
) -> Steps:
    """Yield {"rows": ...} after each case that has no rows yet.

    A case is a function that measures its rows. ``key`` returns the case to which a row belongs.

    Rows stand in the order of the cases, whatever the order in which they were measured, behind
    those of an earlier run's other cases.
    """
    places = {name: place for place, name in enumerate(cases)}
    rows: list[Json] = list(earlier.get("rows", ()))
    for name in find_missing_cases(cases, key, earlier):
        rows = sorted(
            rows + cases[name](), key=lambda row: places.get(key(row), -1)
        )  # stable: a case's rows keep their order
        yield {"rows": rows}


def find_missing_cases(
    cases: Iterable[Any], key: Callable[[Json], Any], earlier: Json
) -> list[Any]:
    """Return the cases that have no rows yet."""
    done = {key(row) for row in earlier.get("rows", ())}
    return [name for name in cases if name not in done]


def make_rows_part(
    name: str,
    title: str,
    cases: Callable[[S], Mapping[Any, Callable[[], list[Json]]]],
    key: Callable[[Json], Any],
    text: Callable[[Measurement], str],
    marker: str = "",
    key_values: Callable[[S], Json] = lambda _: {},
    **others: Any,
) -> Part[S]:
    """Return a part with rows by case as values, and with one section, ``text``.

    The values of ``key_values`` belong to the part too. ``others`` override arguments of the part,
    such as its sections.
    """
    marker = marker or name

    def measure(settings: S, earlier: Json) -> Steps:
        for values in measure_rows_by_case(cases(settings), key, earlier):
            yield {**key_values(settings), **values}

    usual: Json = {"markers": (marker,), "sections": lambda measured: {marker: text(measured)}}
    usual["steps"] = lambda settings, earlier: len(
        find_missing_cases(cases(settings), key, earlier)
    )
    return Part(name, title, measure=measure, key_values=key_values, **usual | others)


def make_whole_part(
    name: str,
    title: str,
    measure: Callable[[S], Json],
    text: Callable[[Measurement], str],
    marker: str,
    **others: Any,
) -> Part[S]:
    """Return a part that is measured as a whole and has one section, ``text``.

    ``others`` are further arguments of the part.
    """

    def steps(settings: S, _earlier: Json) -> Steps:
        yield measure(settings)

    return Part(
        name,
        title,
        measure=steps,
        markers=(marker,),
        sections=lambda measured: {marker: text(measured)},
        **others,
    )


def add_sources(summarise: Callable[[Measurement], str]) -> Callable[[Measurement], str]:
    """Return a function that adds the conditions of a measurement below a text.

    They say when, where and with which versions the numbers were measured.
    """
    return lambda measured: f"{summarise(measured)}\n\n{sources(measured.conditions)}"


def make_rows_study(
    name: str,
    title: str,
    cases: Callable[[S], Mapping[Any, Callable[[], list[Json]]]],
    key: Callable[[Json], Any],
    text: Callable[[Measurement], str],
    *,
    key_values: Callable[[S], Json] = lambda _: {},
    stopped_message: str = "with --json the same command goes on from here.",
    **others: Any,
) -> Study[S]:
    """Return a study of one part with rows by case, as of `make_rows_part`.

    Its table ``text`` is printed; the page also has the conditions of the measurement.
    """
    usual: Json = {"text": add_sources(text), "summary": text}
    part = make_rows_part(name, title, cases, key, key_values=key_values, **usual | others)
    return Study((part,), stopped_message=stopped_message)


# Studies of one table: it is printed, its numbers go to a JSON file, and the table itself into a
# page, each on request.


def make_table_study(
    name: str, title: str, measure: Callable[[S], Json], summarise: Callable[[Measurement], str]
) -> Study[S]:
    """Return a study of one part whose table is the text of ``summarise``.

    The part is measured as a whole by ``measure``, so an interrupted run has no result.
    """
    part = make_whole_part(name, title, measure, add_sources(summarise), name, summary=summarise)
    return Study(
        (part,),
        stopped_message="nothing is written.",
    )


def format_table(columns: Mapping[str, str], rows: Iterable[Mapping[str, Any]]) -> str:
    """Return a Markdown table with a line for each row.

    ``columns`` give for each header the format of a row's values, as for `str.format`.
    """
    return markdown(
        tuple(columns), [tuple(form.format(**row) for form in columns.values()) for row in rows]
    )


def add_table_options(marker: str, page: str) -> Callable[[Command], Command]:
    """Add --json and --page to a command whose table is between markers of ``page``.

    The command receives their paths as ``place``. Files that cannot be written are refused before
    any computation.
    """
    json = json_option("Write the numbers, each repeat where there are any.", "target")
    table = page_option(marker, page)

    def add(command: Command) -> Command:
        @wraps(command)
        def called(target: Path | None, page: Path | None, **options: Any) -> Any:
            check_target("--json", target)
            check_target("--page", page)
            return command(**options, place=OutputPaths(json=target, page=page))

        return json(table(called))

    return add


def add_folder_options(page: str, contents: str = "numbers") -> Callable[[Command], Command]:
    """Add --redraw and --out to a command whose files are in the folder ``page`` beside page.md.

    The command receives ``redraw`` and the paths as ``place``. ``contents`` says in the help what
    the folder holds.
    """
    redraw = click.option(
        "--redraw", is_flag=True, help="Write the page again from existing numbers."
    )
    out = click.option(
        "--out",
        type=click.Path(path_type=Path, file_okay=False),
        default=DOCS,
        show_default=False,
        help=f"Folder of the page {page}.md and of its folder of {contents} (default: docs).",
    )

    def add(command: Command) -> Command:
        @wraps(command)
        def called(out: Path, **options: Any) -> Any:
            return command(**options, place=paths_next_to_page(out, page, out / page))

        return redraw(out(called))

    return add
