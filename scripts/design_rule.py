"""Find out where the design rule holds: the best simulated gap over the rule's, over damping, mass ratio and place, on two beams."""

from __future__ import annotations

import json
from pathlib import Path

import click

from optimisation.bounds import expected_factor
from optimisation.command_line import BadInput, end_early, name_files, plain_errors
from optimisation.files import require_writable, write_json
from optimisation.progress import runs_bar
from optimisation.report.markdown import markdown
from optimisation.studies.machine import conditions, sources
from optimisation.studies.page import ROOT, fill, published, require_markers
from optimisation.studies.rule import (
    DAMPING,
    MASS,
    PLACE,
    QUICK_STEPS,
    STEPS,
    Row,
    as_json,
    cases,
    from_json,
    price_at,
    run_cases,
    verdicts,
)

PAGE, RESULTS = "design_rule.md", "design_rule.json"
MEMBERS, QUICK_MEMBERS = 4, 1
SECTIONS = {DAMPING: "rule:damping", MASS: "rule:mass", PLACE: "rule:place"}
VERDICT, MACHINE = "rule:verdict", "rule:machine"


def table(rows: list[Row]) -> str:
    what = ("beam", "resonance", rows[0].varied, "free amplitude over gap", "best gap over rule's", "expected")
    header = (*what, "level at the best, %", "at the rule's, %", "at the expected, %")
    return markdown(header, [_cells(row) for row in rows])


def _cells(row: Row) -> tuple[str, ...]:
    at_rule = row.relative[len(row.factors) // 2]
    least, expected = min(row.relative), expected_factor(row.reach)
    levels = (f"{100 * x:.1f}" for x in (least, at_rule, least * price_at(row, expected)))
    numbers = (f"{row.value:g}", f"{row.reach:.3g}", f"{row.best:.2g}", f"{expected:.2g}", *levels)
    return (row.structure, str(row.resonance), *numbers)


def sections(rows: list[Row], machine: dict[str, object]) -> dict[str, str]:
    found = {name: table([row for row in rows if row.varied == varied]) for varied, name in SECTIONS.items()}
    good = ("rule within 10 %", "expected within 10 %", "rule's worst, times", "expected's worst, times")
    header = ("free amplitude over gap", "cases", "best gap over rule's", "from", "to", *good)
    lines = [
        (
            v.label,
            *(f"{x:.2g}" for x in (v.cases, v.median, v.low, v.high)),
            str(v.good),
            str(v.expected),
            f"{v.worst:.2f}",
            f"{v.worst_expected:.2f}",
        )
        for v in verdicts(rows)
    ]
    return found | {VERDICT: markdown(header, lines), MACHINE: sources(machine)}


def known_rows(file: Path, settings: dict[str, object]) -> dict[str, Row]:
    """Return the finished cases of an earlier run with the same settings."""
    if not file.exists():
        return {}
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
        if content["settings"] != settings:
            return {}
        return {row["key"]: from_json(row) for row in content["rows"]}
    except (ValueError, KeyError, TypeError) as error:
        raise BadInput(f"{file} is not allowed: a file that an earlier run wrote ({error!r}); remove it or choose another --out") from error


@click.command(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120})
@click.option("--quick", is_flag=True, help="A look: one member, fewer gaps, no damping of 0.1 %.")
@click.option("--members", type=click.IntRange(min=1), help=f"Runs for each point.  [default: {MEMBERS}, with --quick {QUICK_MEMBERS}]")
@click.option("--threads", type=click.IntRange(min=1), help="Number of threads; the result does not depend on it.  [default: all cores]")
@click.option("--out", type=click.Path(path_type=Path), help="Folder for page and numbers.  [default: docs, with --quick results/design_rule]")
def main(quick: bool, members: int | None, threads: int | None, out: Path | None) -> None:
    """Simulate the rule's gap and its neighbours on two beams, over damping, mass ratio and place of the absorber.

    Writes design_rule.json after each case, and the page design_rule.md. Ctrl-C keeps what is finished: the same command goes on from there.
    """
    results = Path("results/design_rule")
    out = out or (results if quick else published(ROOT / "docs", results))
    members, steps = members or (QUICK_MEMBERS if quick else MEMBERS), QUICK_STEPS if quick else STEPS
    with plain_errors():
        require_writable("--out", out)
        template, file = ROOT / "docs" / PAGE, out / RESULTS
        require_markers(out / PAGE, template, [*SECTIONS.values(), VERDICT, MACHINE])
        settings: dict[str, object] = {"members": members, "steps": steps, "quick": quick}
        known, machine, wanted = known_rows(file, settings), conditions(), cases(quick)
        for row in run_cases(wanted, dict(known), members, steps, threads, runs_bar):
            known[row.key] = row
            write_json(file, {"settings": settings, "conditions": machine, "rows": [as_json(known[c.key]) for c in wanted if c.key in known]})
        rows = [known[case.key] for case in wanted if case.key in known]
        if rows and all(any(row.varied == varied for row in rows) for varied in SECTIONS):
            fill(out / PAGE, template, sections(rows, machine))
            name_files([file, out / PAGE])
    for verdict in verdicts(rows):
        click.echo(f"free amplitude over gap {verdict.label}: best gap {verdict.low:.2g} to {verdict.high:.2g} of the rule's, {verdict.cases} cases")
    end_early(len(rows) == len(wanted), "the same command goes on from here.")


if __name__ == "__main__":
    main()
