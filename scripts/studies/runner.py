"""How a study is carried out. What every study needs is here, once.

That is the bar, Ctrl-C, going on from an earlier run, drawing anew from the files, the description of machine and sources, and the exit code.
"""

import sys
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path
from typing import TypeVar

import click

from impact_env import IntegrationError, ParameterError
from optimisation.cli.common import end_early, name_files, plain_errors
from optimisation.files import read_json, replacing, require_writable, write_csv, write_json
from optimisation.machine import conditions
from optimisation.page import fill, require_markers
from optimisation.progress import BAR, Bar
from studies.study import Json, Measured, Part, Place, Study

KEEP_S = 30.0  # what is measured is written this often at least, where a step does not take longer
S = TypeVar("S")


def run(
    study: Study[S],
    settings: S,
    place: Place,
    *,
    only: Sequence[str] = (),
    redraw: bool = False,
    resume: bool = False,
) -> None:
    """Measure the parts (all, if ``only`` names none), or with ``redraw`` read them from their files, and write, draw and print the results.

    ``resume``: go on from files of runs that were stopped.

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
            measured = load(study, part, place) if redraw else _measured_and_kept(study, part, settings, place, resume)
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
        return study.unpack(part.name, dict(read_json(path)))
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise ParameterError(f"{option}: {path} is not allowed: a file that an earlier run of this command wrote ({error})") from error


def _measured_and_kept(study: Study[S], part: Part[S], settings: S, place: Place, resume: bool) -> Measured:
    """Measure a part and write its numbers; one that an earlier run has finished is left as it is with ``resume``."""
    path, earlier, told = place.numbers(part.name), None, part.told(settings)
    if (resume or told) and path is not None and path.exists():
        earlier = load(study, part, place, "--resume" if resume else "--out")
        if study.key is not None and earlier.conditions.get("key") != study.key(part.name, settings):
            earlier = None
        elif told:
            earlier = earlier if all(earlier.values.get(name) == value for name, value in told.items()) else None
        elif earlier.complete:
            return earlier
        else:
            old, new = earlier.conditions, conditions(study.packages) | study.notes(settings)
            for name in study.same:
                if old.get(name) != new.get(name):
                    raise ParameterError(f"--resume is not allowed: with the same {name} as the earlier run, {old.get(name)}, not {new.get(name)}")

    def write(measured: Measured) -> None:
        if path is not None:
            write_json(path, study.pack(part.name, measured))

    return measure(study, part, settings, earlier, write)


def measure(
    study: Study[S], part: Part[S], settings: S, earlier: Measured | None = None, keep: Callable[[Measured], object] = lambda _: None
) -> Measured:
    """Measure a part, or what ``earlier`` lacks of it. Ctrl-C or a run that breaks down leaves what is known, and is raised if that is nothing.

    What is known is handed to ``keep`` every now and then, and at the end.
    """
    made, values, began = conditions(study.packages), earlier.values if earlier else {}, time.perf_counter()
    if earlier is not None:
        began -= earlier.conditions["wall_s"]

    def known(ended: bool, failure: str = "") -> Measured:
        taken: Json = {"wall_s": round(time.perf_counter() - began, 1)} | study.notes(settings) | ({"failure": failure} if failure else {})
        taken |= {} if study.key is None else {"key": study.key(part.name, settings)}
        found = Measured(values, made | taken, ended)
        keep(found)
        return found

    total, kept = part.steps(settings, values) if part.steps else None, time.perf_counter()
    with Bar(total=total, desc=part.name, bar_format=BAR, disable=total is None) as bar, closing(part.measure(settings, values)) as steps:
        try:
            for values in steps:  # noqa: B007 - `known` reads it
                bar.update()
                if time.perf_counter() - kept > KEEP_S:
                    known(ended=False)
                    kept = time.perf_counter()
        except (KeyboardInterrupt, IntegrationError) as error:
            if not values:
                raise
            return known(ended=False, failure="" if isinstance(error, KeyboardInterrupt) else str(error))
    return known(ended=True)


def publish(part: Part[S], measured: Measured, place: Place, written: Sequence[Path] = ()) -> None:
    """Write a part's CSV files, figures and sections of the page, and print the results and the names of all files ``written``."""
    files = list(written)
    if place.folder is not None:
        for table in part.tables(measured):
            files.append(place.folder / f"{table.name}.csv")
            write_csv(files[-1], table.columns, table.rows)
        for name, save in part.figures(measured).items():
            files.append(place.folder / (name if "." in name else f"{name}.png"))
            with replacing(files[-1]) as temporary:
                save(temporary)
    sections = part.sections(measured)
    if place.page is not None:
        files.append(place.page)
        fill(place.page, place.template or place.page, sections)
    click.echo(part.said(measured) if part.said else f"{part.title}\n\n" + "\n\n".join(sections.values()))
    if files:
        name_files(files)
