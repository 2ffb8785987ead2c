"""The study of regimes: its parts, its files and its page."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

from optimisation.page import published
from studies.regimes.cases import Settings
from studies.regimes.measured import RESPONSE, STAY, WAYS, Row, jump_cases, key, kind_cases
from studies.regimes.tables import about, hazard_of, kind_table, names, of_case, slownesses, stay_table, sweep_table, ways_table, with_sweeps
from studies.study import Json, Measured, Part, Place, Saver, Steps, Study, Table, beside, left, rows_by_case

NAME = "regimes"
QUICK_OUT = Path("results/regimes")
OUT = published(Path("docs"), QUICK_OUT)
JUMP, KINDS = "jump", "kinds"
CASES = {JUMP: jump_cases, KINDS: kind_cases}


def place(out: Path, own: bool) -> Place:
    """Return where files go: the page into a folder, all else into its folder regimes; for a scene of the caller's all into the folder, no page."""
    return Place(out) if own else beside(out, NAME, out / NAME)


def _jump_words(measured: Measured) -> dict[str, str]:
    rows, blocks = measured.values["rows"], []
    for case in names(rows):
        stays, sweeps = of_case(rows, STAY, case), slownesses(rows, case)
        found = with_sweeps(hazard_of(stays), sweeps)
        blocks.append(f"**{case}.** {about(found)}")
        blocks += [
            table for table in (sweep_table(sweeps, found) if sweeps else "", ways_table(rows, case), stay_table(stays) if stays else "") if table
        ]
    return {f"{NAME}:{JUMP}": "\n\n".join([*blocks, _made(measured)])}


def _kind_words(measured: Measured) -> dict[str, str]:
    rows = measured.values["rows"]
    blocks = [part for case in names(rows) for part in (f"**{case}**", kind_table(of_case(rows, RESPONSE, case)))]
    return {f"{NAME}:{KINDS}": "\n\n".join([*blocks, _made(measured)])}


def _made(measured: Measured) -> str:
    from optimisation.machine import sources

    return f"{sources(measured.conditions)} {measured.conditions['wall_s']:g} s." + ("" if measured.complete else " Stopped early.")


def _tables(measured: Measured, name: str) -> list[Table]:
    rows: list[Row] = measured.values["rows"]
    found = []
    for what in dict.fromkeys(row["what"] for row in rows if row["what"] not in WAYS):
        own = [row for row in rows if row["what"] == what]
        columns = [column for column in own[0] if column != "what"]
        found.append(Table(f"{name}_{what}", columns, [[_cell(row[column]) for column in columns] for row in own]))
    return found


def _cell(value: Any) -> Any:
    return " ".join(f"{k}:{v}" for k, v in value.items()) if isinstance(value, dict) else "" if value is None else value


def _figures(measured: Measured, name: str) -> dict[str, Saver]:
    from studies.regimes import figures  # matplotlib is slow to import

    save = {JUMP: figures.save_jump, KINDS: figures.save_kinds}[name]
    return {name: partial(save, rows=measured.values["rows"])}


def _steps(settings: Settings, known: Json, name: str) -> int:
    return len(left(CASES[name](settings), key, known))


def _measure(settings: Settings, known: Json, name: str) -> Steps:
    return rows_by_case(CASES[name](settings), key, known)


def _part(name: str, title: str) -> Part[Settings]:
    return Part(
        name,
        title,
        measure=partial(_measure, name=name),
        markers=(f"{NAME}:{name}",),
        sections={JUMP: _jump_words, KINDS: _kind_words}[name],
        steps=partial(_steps, name=name),
        tables=partial(_tables, name=name),
        figures=partial(_figures, name=name),
    )


def _notes(settings: Settings) -> Json:
    words = [f"{case.name}: {case.scene}, {case.force:g} N, by {case.approach_ratio:g}" for case in settings.cases]
    numbers = {name: getattr(settings, name) for name in ("stay_members", "sweep_members", "kind_members", "seed", "quick")}
    times = {name: getattr(settings, name) for name in ("stay_periods", "burn_in", "silence", "settle", "window")}
    return {"cases": words, **numbers, **times}


STUDY: Study[Settings] = Study(
    (_part(JUMP, "how long impacts last, and the jump"), _part(KINDS, "kinds of response over the frequency")),
    notes=_notes,
    same=(
        "processor",
        "versions",
        "cases",
        "stay_members",
        "sweep_members",
        "kind_members",
        "seed",
        "stay_periods",
        "burn_in",
        "silence",
        "settle",
        "window",
    ),
)
