"""The table of claims: what all figures that are there decide, as a part that is read from their files."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from functools import partial

from studies.paper.claim import Claim, Verdict, from_plain
from studies.paper.frame import PaperFigure, marker
from studies.paper.settings import Settings
from studies.runner import load
from studies.study import Json, Measured, Part, Place, Steps, Study

CLAIMS = "claims"
HEADER = ("the paper says", "section", "computed", "verdict", "figure")


def claims_part(modules: Sequence[PaperFigure]) -> Part[Settings]:
    """Return the part whose JSON file holds the claims of each figure that has been finished."""
    return Part(
        CLAIMS,
        "what the paper says, and what was computed",
        measure=partial(_collected, modules=modules),
        markers=(marker(CLAIMS),),
        sections=lambda measured: {marker(CLAIMS): table(of(measured)) + reasons(of(measured))},
    )


def _collected(settings: Settings, _known: Json, modules: Sequence[PaperFigure]) -> Steps:
    place, found, missing = Place(settings.folder), list[Claim](), list[str]()
    for module in modules:
        path = place.numbers(module.PART.name)
        measured = load(Study((module.PART,)), module.PART, place, "--out") if path is not None and path.exists() else None
        if measured is None or not measured.complete:
            missing.append(module.PART.name)
        else:
            found += module.claims(measured)
    yield {"claims": [claim.to_plain() for claim in found], "missing": missing}


def of(measured: Measured) -> list[Claim]:
    """Return the claims of the part's values."""
    return [from_plain(plain) for plain in measured.values["claims"]]


def table(claims: Sequence[Claim]) -> str:
    """Return how many there are of each verdict, and a row for each claim."""
    counts = Counter(claim.verdict for claim in claims)
    said = "".join(f"; {counts[verdict]} {verdict.value}" for verdict in Verdict if counts[verdict])
    rows = [(claim.statement, claim.section, claim.computed, f"**{claim.verdict.value}**", claim.figure) for claim in claims]
    lines = ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in (HEADER, ("---",) * len(HEADER), *rows)]
    return f"{len(claims)} statements{said}.\n\n" + "\n".join(lines)


def reasons(claims: Sequence[Claim]) -> str:
    """Return a paragraph for each claim that does not simply hold."""
    left = [claim for claim in claims if claim.verdict is not Verdict.HOLDS]
    return "".join(f"\n\n**{claim.statement[0].upper()}{claim.statement[1:]}: {claim.verdict.value}.** {claim.why}" for claim in left)
