"""What the paper says, read from the figures' files: a summary of eight lines, what does not hold with the reasons, and the rest."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from functools import partial

from studies.paper.claim import Claim, Verdict, from_plain
from studies.paper.frame import PaperFigure, marker
from studies.paper.settings import Settings
from studies.paper.tolerances import RULE
from studies.runner import load
from studies.study import Json, Measured, Part, Place, Steps, Study

CLAIMS, SUMMARY, REFUTED = "claims", "summary", "refuted"
HEADER = ("the paper says", "section", "computed", "verdict", "figure")


def claims_part(modules: Sequence[PaperFigure]) -> Part[Settings]:
    """Return the part whose JSON file holds the claims of each figure that has been finished."""
    return Part(
        CLAIMS,
        "what the paper says, and what was computed",
        measure=partial(_collected, modules=modules),
        markers=tuple(map(marker, (SUMMARY, REFUTED, CLAIMS))),
        sections=lambda measured: {marker(SUMMARY): summary(of(measured), measured.values.get("answers", {})), **_tables(of(measured))},
    )


def _collected(settings: Settings, _known: Json, modules: Sequence[PaperFigure]) -> Steps:
    place, found, missing, answers = Place(settings.folder), list[Claim](), list[str](), dict[str, str]()
    for module in modules:
        path = place.numbers(module.PART.name)
        measured = load(Study((module.PART,)), module.PART, place, "--out") if path is not None and path.exists() else None
        if measured is None or not measured.complete:
            missing.append(module.PART.name)
        else:
            found += module.claims(measured)
            if answer := getattr(module, "answer", None):
                answers[module.PART.name] = answer(measured)
    yield {"claims": [claim.to_plain() for claim in found], "answers": answers, "missing": missing}


def of(measured: Measured) -> list[Claim]:
    """Return the claims of the part's values."""
    return [from_plain(plain) for plain in measured.values["claims"]]


def _tables(claims: Sequence[Claim]) -> dict[str, str]:
    """Return the section of what does not simply hold, with its reasons, and the folded one of the rest with the rule of tolerances."""
    left = [claim for claim in claims if claim.verdict is not Verdict.HOLDS]
    rest = [claim for claim in claims if claim.verdict is Verdict.HOLDS]
    rule = "\n".join(f"| {words} | {allowed} |" for words, allowed in (("words", "allowed"), ("---", "---"), *RULE))
    folded = [(f"{len(rest)} statements that hold", table(rest)), ("The rule of tolerances", rule)]
    return {
        marker(REFUTED): f"{table(left)}{reasons(left)}",
        marker(CLAIMS): "\n\n".join(f"<details><summary>{title}</summary>\n\n{text}\n\n</details>" for title, text in folded),
    }


def counted(claims: Sequence[Claim]) -> str:
    """Return how many there are of each verdict, in words."""
    counts = Counter(claim.verdict for claim in claims)
    return ", ".join(f"{counts[verdict]} {_plural(verdict, counts[verdict])}" for verdict in Verdict if counts[verdict])


def _plural(verdict: Verdict, count: int) -> str:
    return verdict.value if count == 1 else verdict.value.replace("holds", "hold").replace("does not", "do not")


def summary(claims: Sequence[Claim], answers: dict[str, str]) -> str:
    """Return the page's first lines: counts, the substantive statements that do not hold, and the answer to each open question."""
    own, given = ([claim for claim in claims if claim.definitional is definitional] for definitional in (False, True))
    failed = "; ".join(claim.statement for claim in own if claim.verdict is Verdict.NOT)
    lines = [
        f"**{len(own)} substantive statements** were tested: {counted(own)}.",
        f"{len(given)} more follow from definitions or from the linear structure: {counted(given)}." if given else "",
        f"**What does not hold:** {failed}." if failed else "",
        "**In single runs much is chance:** what holds within spread only is true of some members and not of others.",
        *(f"**{answer.partition(': ')[0]}:** {answer.partition(': ')[2]}" for answer in answers.values()),
    ]
    return "\n".join(f"{number}. {line}" for number, line in enumerate(filter(None, lines), 1))


def table(claims: Sequence[Claim]) -> str:
    """Return a row for each claim."""
    rows = [(claim.statement, claim.section, claim.computed, f"**{claim.verdict.value}**", claim.figure) for claim in claims]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in (HEADER, ("---",) * len(HEADER), *rows))


def reasons(claims: Sequence[Claim]) -> str:
    """Return a paragraph for each claim that does not simply hold."""
    left = [claim for claim in claims if claim.verdict is not Verdict.HOLDS]
    return "".join(f"\n\n**{claim.statement[0].upper()}{claim.statement[1:]}: {claim.verdict.value}.** {claim.why}" for claim in left)
