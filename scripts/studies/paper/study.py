"""The study that makes the paper again: its figures in order, their files and page, and the table of claims.

The claims are read from the figures' files: a summary of some lines, what does not hold with the reasons, and the rest.
"""

import hashlib
import json
import sys
from collections import Counter
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from types import ModuleType

from impact_env.kernels.compiling.cache import hash_sources
from studies.paper import (
    basics,
    conv,
    dissinf,
    high_low,
    jump,
    m12,
    modes_needed,
    modulation,
    oprange,
    oprange_two,
    optimum,
    scat,
    second_mode,
    smr,
    starts,
)
from studies.paper.claim import RULE, Claim, ClaimVerdict, from_plain
from studies.paper.frame import NAME, PaperFigure, PaperSettings, format_details, marker
from studies.study import (
    Json,
    Measurement,
    OutputPaths,
    Part,
    Steps,
    Study,
    paths_beside_page,
    read_measurement,
)

FIGURES: tuple[
    PaperFigure, ...
] = (  # in the order of the page: the paper's own, then what goes beyond it
    basics.FIGURE,
    high_low.FIGURE,
    jump.FIGURE,
    smr.FIGURE,
    oprange.FIGURE,
    oprange_two.FIGURE,
    second_mode.FREQUENCY,
    second_mode.DAMPING,
    scat.FIGURE,
    dissinf.FIGURE,
    m12.FIGURE,
    conv.FIGURE,
    optimum.FIGURE,
    modulation.FIGURE,
    modes_needed.FIGURE,
    starts.FIGURE,
)
LABELS = tuple(figure.label for figure in FIGURES)
PACKAGE = __package__ + "."
WORDS = (".claim", ".frame", ".study")
OUT = Path("results/paper")
QUICK_OUT = Path("results/paper/quick")
CLAIMED = "claims"
SUMMARY = "summary"
REFUTED = "refuted"
HEADER = ("the paper says", "section", "computed", "verdict", "figure")


def make_paths(out: Path) -> OutputPaths:
    """Return where files go: the page paper.md into a folder, all else into its folder paper."""
    return paths_beside_page(out, NAME, out / NAME)


def find_sources(module: ModuleType, earlier: frozenset[str] = frozenset()) -> frozenset[str]:
    """Return the modules of this study that a module's numbers come from: itself and what it takes from others, but for what only words or draws."""
    earlier |= {module.__name__}
    taken = {
        getattr(value, "__module__", None) or getattr(value, "__name__", "")
        for value in vars(module).values()
    }
    for name in sorted(
        str(name)
        for name in taken
        if str(name).startswith(PACKAGE) and not str(name).endswith(WORDS)
    ):
        if name not in earlier:
            earlier |= find_sources(sys.modules[name], earlier)
    return earlier


def make_key(name: str, settings: PaperSettings) -> Json:
    """Return the key of a part's numbers: a finished figure is kept as long as it is the same, the sources of its numbers included.

    After a change of words only, --redraw takes the numbers as they are.
    """
    figure = next(figure for figure in FIGURES if figure.label == name)
    source = hashlib.sha256()
    for each in sorted(find_sources(sys.modules[figure.words.__module__])):
        source.update(Path(sys.modules[each].__file__ or "").read_bytes())
    own = {
        "kernels": hash_sources(),
        "source": source.hexdigest()[:16],
        "parameters": vars(settings.size(*figure.sizes)),
    }
    plain: Json = json.loads(json.dumps({"quick": settings.quick, "seed": settings.seed, **own}))
    return plain


def make_claims_part(figures: Sequence[PaperFigure]) -> Part[PaperSettings]:
    """Return the part whose JSON file holds the claims of each figure that has been finished."""
    return Part(
        CLAIMED,
        "what the paper says, and what was computed",
        measure=partial(_collected, figures=figures),
        markers=tuple(map(marker, (SUMMARY, REFUTED, CLAIMED))),
        sections=_sections,
    )


def _collected(settings: PaperSettings, _earlier: Json, figures: Sequence[PaperFigure]) -> Steps:
    where = OutputPaths(settings.folder)
    result = list[Claim]()
    missing = list[str]()
    answers = dict[str, str]()
    for figure in figures:
        path = where.numbers(figure.label)
        part = figure.part()
        measured = (
            read_measurement(part, where, "--out") if path is not None and path.exists() else None
        )
        if measured is None or not measured.complete:
            missing.append(figure.label)
        else:
            result += figure.claims(measured.values)
            if figure.answer:
                answers[figure.label] = figure.answer(measured.values)
    yield {"claims": [claim.to_plain() for claim in result], "answers": answers, "missing": missing}


def _sections(measured: Measurement) -> dict[str, str]:
    """Return the summary, the section of what does not simply hold, with its reasons, and the folded one of the rest with the rule of tolerances."""
    claims = [from_plain(plain) for plain in measured.values["claims"]]
    left = [claim for claim in claims if claim.verdict is not ClaimVerdict.HOLDS]
    rest = [claim for claim in claims if claim.verdict is ClaimVerdict.HOLDS]
    rule = "\n".join(
        f"| {words} | {allowed} |"
        for words, allowed in (("words", "allowed"), ("---", "---"), *RULE)
    )
    return {
        marker(SUMMARY): format_summary(claims, measured.values.get("answers", {})),
        marker(REFUTED): f"{format_claims(left)}{format_reasons(left)}",
        marker(
            CLAIMED
        ): f"{format_details(f'{len(rest)} statements that hold', format_claims(rest))}\n\n{format_details('The rule of tolerances', rule)}",
    }


def _counted(claims: Sequence[Claim]) -> str:
    """Return how many there are of each verdict, in words."""
    counts = Counter(claim.verdict for claim in claims)
    many = {
        verdict: verdict.value.replace("holds", "hold").replace("does not", "do not")
        for verdict in ClaimVerdict
    }
    return ", ".join(
        f"{counts[verdict]} {verdict.value if counts[verdict] == 1 else many[verdict]}"
        for verdict in ClaimVerdict
        if counts[verdict]
    )


def format_summary(claims: Sequence[Claim], answers: dict[str, str]) -> str:
    """Return the page's first lines: counts, the substantive statements that do not hold, and the answer to each open question."""
    own, settings = (
        [claim for claim in claims if claim.definitional is definitional]
        for definitional in (False, True)
    )
    failed = "; ".join(claim.statement for claim in own if claim.verdict is ClaimVerdict.NOT)
    lines = [
        f"**{len(own)} substantive statements** were tested: {_counted(own)}.",
        f"{len(settings)} more follow from definitions or from the linear structure: {_counted(settings)}."
        if settings
        else "",
        f"**What does not hold:** {failed}." if failed else "",
        "**In single runs much is chance:** what holds within spread only is true of some members and not of others.",
        *(
            f"**{answer.partition(': ')[0]}:** {answer.partition(': ')[2]}"
            for answer in answers.values()
        ),
    ]
    return "\n".join(f"{number}. {line}" for number, line in enumerate(filter(None, lines), 1))


def format_claims(claims: Sequence[Claim]) -> str:
    """Return a row for each claim."""
    rows = [
        (claim.statement, claim.section, claim.computed, f"**{claim.verdict.value}**", claim.figure)
        for claim in claims
    ]
    return "\n".join(
        "| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |"
        for row in (HEADER, ("---",) * len(HEADER), *rows)
    )


def format_reasons(claims: Sequence[Claim]) -> str:
    """Return a paragraph for each claim that does not simply hold."""
    left = [claim for claim in claims if claim.verdict is not ClaimVerdict.HOLDS]
    return "".join(
        f"\n\n**{claim.statement[0].upper()}{claim.statement[1:]}: {claim.verdict.value}.** {claim.why}"
        for claim in left
    )


STUDY: Study[PaperSettings] = Study(
    tuple(figure.part() for figure in FIGURES),
    key=make_key,
    same=(),
    kept="finished figures are kept; the same command goes on from here.",
)
CLAIMS: Study[PaperSettings] = Study(
    (make_claims_part(FIGURES),)
)  # once all figures that are to be made are there
