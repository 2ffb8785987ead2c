"""The one pattern of all studies: cases are measured as plain values, kept as JSON and CSV, and told on a page with figures.

A study is its parts and where its files lie. What every study needs is here, once: the bar, Ctrl-C, going on from an earlier run, drawing anew from
the files, the description of machine and sources, and the exit code. `run` is what a command calls.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeVar

import click
from tqdm import tqdm

from impact_env.parameters import ParameterError
from impact_env.sweep import IntegrationError
from optimisation.command_line import end_early, name_files, plain_errors
from optimisation.files import replacing, require_writable, write_csv, write_json
from optimisation.progress import BAR
from optimisation.studies.machine import PACKAGES, conditions
from optimisation.studies.page import DOCS, fill, require_markers

Json = dict[str, Any]
Steps = Generator[Json, None, None]
Saver = Callable[[Path], None]  # writes a figure; the ending of the path chooses the format
S = TypeVar("S")


@dataclass(frozen=True)
class Measured:
    """What is known of a part: plain values, the `conditions` under which they were measured, and whether that is all of them."""

    values: Json
    conditions: Json = field(default_factory=dict)
    complete: bool = True


class Table(NamedTuple):
    """A CSV file: its name without the ending, columns and rows."""

    name: str
    columns: Sequence[str]
    rows: Iterable[Sequence[object]]


@dataclass(frozen=True)
class Part(Generic[S]):
    """What is measured together and kept in one JSON file.

    ``measure(settings, known)`` yields, after each of its ``steps(settings, known)``, all values that are known by then; what it yielded last is kept
    however it ends. ``known`` are the values of an earlier run to go on from, else empty. ``steps`` is None where it shows a bar of its own.
    ``whole(settings, values)``: whether nothing is left to measure once ``measure`` has ended.

    The rest tells of what was measured: ``sections`` the text between the page's ``markers``, ``tables`` the CSV files, ``figures`` by file name
    without ending, ``said`` what is printed (the sections, if it is None), and ``failures`` what makes the exit code 1.
    """

    name: str
    title: str
    _: KW_ONLY
    measure: Callable[[S, Json], Steps]
    markers: tuple[str, ...]
    sections: Callable[[Measured], Mapping[str, str]]
    steps: Callable[[S, Json], int] | None = None
    whole: Callable[[S, Json], bool] = lambda *_: True
    tables: Callable[[Measured], Iterable[Table]] = lambda _: ()
    figures: Callable[[Measured], Mapping[str, Saver]] = lambda _: {}
    said: Callable[[Measured], str] | None = None
    failures: Callable[[Measured], Sequence[str]] = lambda _: ()


def pack(_name: str, measured: Measured) -> Json:
    """Return what the JSON file of a part holds."""
    return {"conditions": measured.conditions, "complete": measured.complete, **measured.values}


def unpack(_name: str, content: Json) -> Measured:
    """Return what `pack` has packed; raises KeyError if it was another."""
    values = {name: value for name, value in content.items() if name not in ("conditions", "complete")}
    return Measured(values, dict(content["conditions"]), bool(content["complete"]))


@dataclass(frozen=True)
class Study(Generic[S]):
    """Parts by name, and what their files hold.

    ``notes(settings)`` is added to the conditions once a part is measured. A run goes on from an earlier one if the conditions named in ``same``
    are the same. ``kept`` says what is left of a run that is stopped.
    """

    parts: tuple[Part[S], ...]
    notes: Callable[[S], Json] = lambda _: {}
    pack: Callable[[str, Measured], Json] = pack
    unpack: Callable[[str, Json], Measured] = unpack
    packages: tuple[str, ...] = PACKAGES
    same: tuple[str, ...] = ("processor", "versions", "quick")
    kept: str = "the files hold what was finished."

    def chosen(self, names: Sequence[str]) -> list[Part[S]]:
        """Return the named parts in their own order; all if none is named."""
        return [part for part in self.parts if not names or part.name in names]


@dataclass(frozen=True)
class Place:
    """Where files go: PART.json and all else into ``folder``, or the JSON alone to ``json``; sections into ``page``, which starts as ``template``."""

    folder: Path | None = None
    page: Path | None = None
    template: Path | None = None
    json: Path | None = None

    def numbers(self, name: str) -> Path | None:
        """Return the JSON file of a part."""
        return self.json or (self.folder and self.folder / f"{name}.json")


def run(
    study: Study[S],
    settings: S,
    place: Place,
    *,
    only: Sequence[str] = (),
    redraw: bool = False,
    resume: bool = False,
    keep: Callable[[Json], Json] | None = None,
) -> None:
    """Measure the parts (all, if ``only`` names none), or with ``redraw`` read them from their files, and write, draw and print what was found.

    ``resume``: go on from files of runs that were stopped. ``keep`` returns what to keep of the values in a file; the rest is measured anew.

    Exits with 1 if something failed, 2 with bad input, 130 if the run was stopped; each with one message.
    """
    with plain_errors(f"Stopped early: {study.kept}"):
        parts = study.chosen(only)
        if place.folder is not None:
            require_writable("--out", place.folder)
        if redraw:
            parts = _there(parts, place, bool(only))
        if place.page is not None:
            require_markers(place.page, place.template or place.page, [marker for part in parts for marker in part.markers])
        failures: list[str] = []
        for part in parts:
            measured = load(study, part, place) if redraw else _measured_and_kept(study, part, settings, place, resume, keep)
            publish(part, measured, place, [] if redraw else [file for file in [place.numbers(part.name)] if file])
            failures += part.failures(measured)
            if not redraw and measured.conditions.get("failure"):
                raise click.ClickException(f"{part.name} is not complete: {measured.conditions['failure']}")
            if not redraw:
                end_early(measured.complete, study.kept)
    if failures:
        sys.exit(1)


def _there(parts: list[Part[S]], place: Place, named: bool) -> list[Part[S]]:
    """Return the parts that there are files of; all of those that the caller has named."""
    files = {part.name: place.numbers(part.name) for part in parts}
    there = [part for part in parts if named or ((file := files[part.name]) is not None and file.exists())]
    if not there:
        raise ParameterError(f"--out = {place.folder} is not allowed with --redraw: a folder with results of {', '.join(files)}")
    return there


def load(study: Study[S], part: Part[S], place: Place, option: str = "--redraw") -> Measured:
    """Read what an earlier run has measured; raises ParameterError if it is not there, or is something else."""
    path = place.numbers(part.name)
    assert path is not None
    try:
        return study.unpack(part.name, dict(json.loads(path.read_text(encoding="utf-8"))))
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise ParameterError(f"{option}: {path} is not allowed: a file that an earlier run of this command wrote ({error})") from error


def _measured_and_kept(study: Study[S], part: Part[S], settings: S, place: Place, resume: bool, keep: Callable[[Json], Json] | None) -> Measured:
    """Measure a part and write its numbers; one that an earlier run has finished is left as it is with ``resume``."""
    path, earlier = place.numbers(part.name), None
    if (resume or keep) and path is not None and path.exists():
        earlier = load(study, part, place, "--resume" if resume else "--out")
        if keep:
            earlier = replace(earlier, values=keep(earlier.values))
        elif earlier.complete:
            return earlier
        else:
            _require_same(study, earlier.conditions, conditions(study.packages) | study.notes(settings))
    measured = measure(study, part, settings, earlier)
    if path is not None:
        write_json(path, study.pack(part.name, measured))
    return measured


def measure(study: Study[S], part: Part[S], settings: S, earlier: Measured | None = None) -> Measured:
    """Measure a part, or what ``earlier`` lacks of it. Ctrl-C or a run that breaks down leaves what is known, and is raised if that is nothing."""
    began, made, known, ended, failure = time.perf_counter(), conditions(study.packages), earlier.values if earlier else {}, False, ""
    if earlier is not None:
        began -= earlier.conditions["wall_s"]
    values: Json = known
    total = part.steps(settings, known) if part.steps else None
    with tqdm(total=total, desc=part.name, bar_format=BAR, disable=True if total is None else None) as bar:
        steps = part.measure(settings, known)
        try:
            for values in steps:  # noqa: B007 - the last is kept
                bar.update()
            ended = True
        except KeyboardInterrupt:
            if not values:
                raise
        except IntegrationError as error:
            if not values:
                raise
            failure = str(error)
        finally:
            steps.close()
    made |= {"wall_s": round(time.perf_counter() - began, 1)} | study.notes(settings) | ({"failure": failure} if failure else {})
    return Measured(values, made, ended and part.whole(settings, values))


def beside(out: Path, name: str, data: Path | None = None) -> Place:
    """Return the place of a study whose page NAME.md is in ``out``, and whose other files are there as well, or in ``data``."""
    return Place(data or out, out / f"{name}.md", DOCS / f"{name}.md")


def _require_same(study: Study[S], old: Json, new: Json) -> None:
    for name in study.same:
        if old.get(name) != new.get(name):
            raise ParameterError(f"--resume is not allowed: with the same {name} as the earlier run, {old.get(name)}, not {new.get(name)}")


def publish(part: Part[S], measured: Measured, place: Place, written: Sequence[Path] = ()) -> None:
    """Write a part's CSV files, figures and sections of the page, and print what was found and all that was ``written``."""
    files = list(written)
    if place.folder is not None:
        for table in part.tables(measured):
            files.append(place.folder / f"{table.name}.csv")
            write_csv(files[-1], table.columns, table.rows)
        for name, save in part.figures(measured).items():
            files.append(place.folder / f"{name}.png")
            with replacing(files[-1]) as temporary:
                save(temporary)
    sections = part.sections(measured)
    if place.page is not None:
        files.append(place.page)
        fill(place.page, place.template or place.page, sections)
    click.echo(part.said(measured) if part.said else f"{part.title}\n\n" + "\n\n".join(sections.values()))
    if files:
        name_files(files)


def rows_by_case(cases: Mapping[Any, Callable[[], list[Json]]], key: Callable[[Json], Any], known: Json, order: Sequence[Any] | None = None) -> Steps:
    """Yield {"rows": ...} after each case: a function that measures its rows, by what ``key`` returns of them. Cases that are known are left out.

    Rows stand in the order of ``order``, by default that of the cases, whatever the order in which they were measured.
    """
    places = {name: place for place, name in enumerate(order if order is not None else cases)}
    rows: list[Json] = list(known.get("rows", ()))
    for name in left(cases, key, known):
        rows = sorted(rows + cases[name](), key=lambda row: places[key(row)])  # stable: a case's rows keep their order
        yield {"rows": rows}


def left(cases: Iterable[Any], key: Callable[[Json], Any], known: Json) -> list[Any]:
    """Return the cases that have no rows yet."""
    done = {key(row) for row in known.get("rows", ())}
    return [name for name in cases if name not in done]
