"""Benefit of compiling each scene separately: compiled code, compile time, speed and memory.

Each scene without a part is compared with a scene in which the part is only switched off.
"""

import json
import os
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import click

from impact_env.sweep import IntegrationError
from optimisation.checkpoint import sources
from optimisation.cli.common import command
from optimisation.files import DOCS, markdown, publication_folder
from studies.study import (
    CsvTable,
    Json,
    Measurement,
    OutputPaths,
    Part,
    Steps,
    Study,
    format_table,
    run,
)
from studies.variants import KernelVariant, Pair, own, pairs

PROBE = Path(__file__).parents[1] / "probe.py"
PACKAGES = PROBE.parents[2]  # the folder from which they are imported
PERIODS = 400.0
QUICK_PERIODS = 60.0
REPEATS = 5
QUICK_REPEATS = 3
# functions of the kernels with friction's arithmetic, with their former names
FRICTION = (
    "rigid_contact.add_friction_loss",
    "rigid_contact.update_friction_force",
    "rigid_contact.update_slip_direction",
    "rigid_contact.friction_force",
    "rigid_contact.turn",
)
LINEAR = ("no absorber", "stuck", "tuned")
# a part switched off by its value must cost more than this, or leaving it out saves nothing
REAL = 1.02
FLAT_KB = 64.0  # memory that a longer run may need more, when nothing is stored


class CodeClaim(NamedTuple):
    """A sentence and whether the numbers bear it out."""

    text: str
    finding: str
    holds: bool


def _probe(
    variant: KernelVariant, what: str, cache: Path, periods: float, repeats: int
) -> dict[str, Any]:
    command = [
        sys.executable,
        "-P",
        str(PROBE),
        variant.absorber,
        variant.method,
        variant.record,
        what,
        str(periods),
        str(repeats),
    ]
    path = os.pathsep.join([str(PACKAGES), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = {
        **os.environ,
        "IMPACT_ENV_CACHE": str(cache),
        "PYTHONPATH": path,
        "OMP_NUM_THREADS": "1",
    }
    result = subprocess.run(
        command, capture_output=True, text=True, env=environment, check=False, cwd=PACKAGES
    )
    if result.returncode:
        printed = result.stderr.strip().splitlines()
        raise IntegrationError(f"{variant.name}: {printed[-1] if printed else result.returncode}")
    values: dict[str, Any] = json.loads(result.stdout.splitlines()[-1])
    return values


def left(quick: bool, earlier: Json) -> tuple[list[KernelVariant], list[Pair]]:
    """Return the variants and the pairs that an earlier run has not measured."""
    done = {pair["part"] for pair in earlier.get("pairs", ())}
    return [variant for variant in own(quick) if variant.name not in earlier.get("own", {})], [
        pair for pair in pairs(quick) if pair.part not in done
    ]


def measure(quick: bool, earlier: Json) -> Steps:
    """Measure all values that are not yet known, and yield all results after each.

    Each measurement runs in a process of its own, one after the other. Results are "own" by
    variant, and "pairs".
    """
    periods, repeats = (QUICK_PERIODS, QUICK_REPEATS) if quick else (PERIODS, REPEATS)
    results: Json = {"own": {}, "pairs": []} | earlier
    variants, compared = left(quick, earlier)
    timed = {
        variant: results["own"][variant.name]
        for variant in own(quick)
        if variant.name in results["own"]
    }
    with tempfile.TemporaryDirectory(prefix="impact_env-") as folder:
        caches = {
            kind: Path(folder) / str(number)
            for number, kind in enumerate(dict.fromkeys(variant.kind for variant in own(quick)))
        }
        for variant in variants:
            cold = _probe(variant, "inspect", caches[variant.kind], 1.0, 1)
            yield results
            warm = timed[variant] = _probe(variant, "time", caches[variant.kind], periods, repeats)
            compiled = {
                "cold_s": cold["first_s"],
                "cached_s": warm["first_s"],
                "functions": cold["functions"],
                "instructions": cold["instructions"],
            }
            ran = {
                name: warm[name]
                for name in ("ns_per_period", "impacts_per_period", "memory_mb", "peak_kb")
            }
            results["own"][variant.name] = asdict(variant) | compiled | ran
            yield results
        for pair in compared:
            one, other = (
                (
                    timed.get(variant)
                    or _probe(variant, "time", caches[variant.kind], periods, repeats)
                )["ns_per_period"]
                for variant in (pair.without, pair.switched_off)
            )
            named = {
                "part": pair.part,
                "without": pair.without.name,
                "switched_off": pair.switched_off.name,
            }
            results["pairs"].append(
                named | {"without_ns": one, "switched_off_ns": other, "ratio": other / one}
            )
            yield results


def claims(results: Json) -> Iterator[CodeClaim]:
    """Yield the claims on the compiled code and on the measurements."""
    for entry in results["own"].values():
        scene = f"{entry['absorber']}, {entry['method']}, {entry['record']}"
        exact = entry["method"] == "exact"
        if exact and entry["absorber"] in LINEAR:
            search = sum(function["name"].startswith("search.") for function in entry["functions"])
            yield CodeClaim(
                f"{scene}: searches no events", f"{search} functions of the search", not search
            )
        rubbed = sum(
            function["arithmetic"]
            for function in entry["functions"]
            if function["name"] in FRICTION
        )
        if exact and entry["absorber"] == "impact":
            yield CodeClaim(f"{scene}: no friction arithmetic", f"{rubbed} operations", rubbed == 0)
        if exact and entry["absorber"] == "impact and friction":
            yield CodeClaim(
                f"{scene}: has friction arithmetic (the check can fail)",
                f"{rubbed} operations",
                rubbed > 0,
            )
        growth = entry["peak_kb"][1] - entry["peak_kb"][0]
        if entry["record"] in ("nothing", "level"):
            yield CodeClaim(
                f"{scene}: stores no time series",
                f"{growth:+.1f} kB for a run 10 times longer",
                growth < FLAT_KB,
            )
        if entry["record"] == "level and samples":
            yield CodeClaim(
                f"{scene}: stores one (the check can fail)",
                f"{growth:+.1f} kB for a run 10 times longer",
                growth > FLAT_KB,
            )


PARTS = (
    "search",
    "forced",
    "modal_system",
    "segments",
    "exact",
    "stick_slip",
    "rigid_contact",
    "compliant",
    "linear",
    "moreau",
    "moreau_law",
    "runge_kutta",
    "feedback",
    "observers",
    "energies",
)
OF = {
    "rigid": "exact",
    "compliant_contact": "compliant",
    "slots": "modal_system",  # former names, as measurements of former versions have them
    "free_and_joined": "stick_slip",
    "springs": "compliant",
    "level": "observers",
    "steps": "search",
}  # modules that are counted with another


MARKERS = tuple(
    f"specialisation:{name}" for name in ("summary", "claims", "scenes", "code", "pairs")
)


def _summary(results: Json, measured: Measurement) -> str:
    result = list(claims(results))
    broken = [claim for claim in claims(results) if not claim.holds]
    words = [
        f"{len(result) - len(broken)} of {len(result)} claims hold. {sources(measured.conditions)}"
    ]
    words += (
        ["**Stopped early or a quick look: not all of the report.**"]
        if not measured.complete or measured.conditions.get("quick")
        else []
    )
    without = [
        pair["part"] for pair in results["pairs"] if pair["ratio"] < REAL
    ]  # their absence saves no time that can be told from noise
    if not results["pairs"]:
        return "\n".join(words)
    saving = (
        f"Left out without a saving of {100 * (REAL - 1):.0f} % or more: {', '.join(without)}."
        if without
        else "Every part left out saves time."
    )
    return "\n".join([*words, saving])


def _claims(every: list[CodeClaim]) -> str:
    """Return a line for each kind of claim, and one for each claim that does not hold.

    The line of a kind has the number of scenes in which it holds.
    """
    held = Counter(claim.text.rpartition(": ")[2] for claim in every if claim.holds)
    rows = [
        (
            kind,
            f"holds in {number}",
            next(c.finding for c in every if c.holds and c.text.endswith(kind)),
        )
        for kind, number in held.items()
    ]
    return markdown(
        ("claim", "scenes", "in the first"),
        rows + [(claim.text, "DOES NOT HOLD", claim.finding) for claim in every if not claim.holds],
    )


def sections(measured: Measurement) -> dict[str, str]:
    """Return the page's sections by the names of their `MARKERS`."""
    results = measured.values
    entries = list[Json]()
    for entry in results["own"].values():
        name = ", ".join(
            [
                entry["absorber"],
                entry["method"],
                *([entry["record"]] if entry["record"] != "level" else []),
            ]
        )
        entries.append(
            {
                **entry,
                "name": name,
                "us": entry["ns_per_period"] / 1e3,
                "called": len(entry["functions"]),
                **counts(entry),
            }
        )
    scenes = {
        "scene, method, recorded": "{name}",
        "compile cold, s": "{cold_s:.1f}",
        "cached, s": "{cached_s:.2f}",
        "us per period": "{us:.2f}",
        "impacts": "{impacts_per_period:.2f}",
        "memory, MB": "{memory_mb:.0f}",
        "held by a run, kB": "{peak_kb[0]:.0f}",
        "10 times longer, kB": "{peak_kb[1]:.0f}",
    }
    code = {
        "scene, method, recorded": "{name}",
        "machine instructions": "{instructions:,}",
        "functions": "{called}",
    }
    pairs = {
        "part": "{part}",
        "scene without it": "{without}",
        "us per period": "{us[0]:.2f}",
        "scene with it switched off": "{switched_off}",
        "us per period ": "{us[1]:.2f}",
        "ratio": "{ratio:.2f}",
    }
    result = (
        _summary(results, measured),
        _claims(list(claims(results))),
        format_table(scenes, entries),
        format_table(code | {part: f"{{{part}}}" for part in PARTS}, entries),
        format_table(
            pairs,
            (
                {**pair, "us": (pair["without_ns"] / 1e3, pair["switched_off_ns"] / 1e3)}
                for pair in results["pairs"]
            ),
        ),
    )
    return dict(zip(MARKERS, result, strict=True))


def counts(entry: dict[str, Any]) -> dict[str, str]:
    """Return the arithmetic operations in each module of the kernels, blank for none."""
    result = dict.fromkeys(PARTS, 0)
    for function in entry["functions"]:
        module = function["name"].partition(".")[0]
        part = "energies" if module.startswith("energ") else OF.get(module, module)
        if part in result:
            result[part] += function["arithmetic"]
    return {part: str(number or "") for part, number in result.items()}


NAME = "specialisation"
QUICK_OUT = Path("results/specialisation")
OUT = publication_folder(Path("docs/internals"), QUICK_OUT)
COLUMNS = (
    "absorber",
    "method",
    "record",
    "cold_s",
    "cached_s",
    "ns_per_period",
    "impacts_per_period",
    "memory_mb",
    "instructions",
)


def _list_claims(measured: Measurement) -> str:
    result = claims(measured.values)
    return "\n".join(
        f"{'holds ' if claim.holds else 'BROKEN'}  {claim.text}: {claim.finding}"
        for claim in result
    )


PART: Part[bool] = Part(
    NAME,
    "what each scene leaves out",
    measure=measure,
    markers=MARKERS,
    sections=sections,
    steps=lambda quick, earlier: 2 * len(left(quick, earlier)[0]) + len(left(quick, earlier)[1]),
    tables=lambda measured: [
        CsvTable(
            NAME,
            COLUMNS,
            [[entry[column] for column in COLUMNS] for entry in measured.values["own"].values()],
        )
    ],
    summary=_list_claims,
    failures=lambda measured: [claim.text for claim in claims(measured.values) if not claim.holds],
)
# settings: whether it is a quick look
STUDY: Study[bool] = Study((PART,), notes=lambda quick: {"quick": quick})


@command()
@click.option(
    "--quick",
    is_flag=True,
    help=f"Three scenes and short runs, into {QUICK_OUT} unless told otherwise.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help=f"Folder for specialisation.json.gz, .csv and .md.  [default: {OUT}]",
)
@click.option(
    "--redraw",
    is_flag=True,
    help="Write the page again from the specialisation.json.gz in the folder; nothing is measured.",
)
@click.option(
    "--resume",
    is_flag=True,
    help="Go on from the specialisation.json.gz in the folder, if that run was stopped early.",
)
def main(quick: bool, out: Path | None, redraw: bool, resume: bool) -> None:
    """Compile each scene into its own cache, inspect its code, time it and compare it.

    The comparison is with scenes in which a part is switched off.

    Run it on an otherwise idle machine: it compiles some twenty variants, one process after the
    other. The exit code is 1 if a claim does not hold. Ctrl-C ends the run early and leaves what is
    finished.
    """
    folder = out or (QUICK_OUT if quick else OUT)
    place = OutputPaths(folder, folder / f"{NAME}.md", DOCS / "internals" / f"{NAME}.md")
    run(STUDY, quick, place, redraw=redraw, resume=resume)
