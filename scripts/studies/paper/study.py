"""The study that reproduces the paper: its figures in order, their files and page.

The table of claims also belongs to it.

The claims are read from the figures' files: a summary of some lines, what does not hold with the
reasons, and the rest.
"""

import hashlib
import json
import sys
from collections import Counter
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from types import ModuleType

import numpy as np
from matplotlib.figure import Figure

from impact_env.kernels.compiling.cache import hash_sources
from optimisation.files import markdown
from studies.paper import (
    basics,
    conv,
    dissinf,
    further,
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
from studies.paper.claim import REASONS, RULE, Claim, ClaimVerdict, from_plain
from studies.paper.frame import (
    NAME,
    SMALL,
    PaperFigure,
    PaperSettings,
    format_details,
    make_panels,
    make_saver,
    marker,
)
from studies.study import (
    CsvTable,
    Json,
    Measurement,
    OutputPaths,
    Part,
    Steps,
    Study,
    paths_next_to_page,
    read_measurement,
)

FIGURES: tuple[
    PaperFigure, ...
] = (  # in the order of the page: the paper's own, then what goes beyond it
    basics.FIGURE,
    high_low.FIGURE,
    jump.FIGURE,
    further.FIGURE,
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
TEXT_MODULES = (".claim", ".frame", ".study")
OUT = Path("results/paper")
QUICK_OUT = Path("results/paper/quick")
CLAIMED = "claims"
SUMMARY = "summary"
REFUTED = "refuted"
CSV_COLUMNS = (
    "statement",
    "section",
    "verdict",
    "value",
    "low",
    "high",
    "least",
    "most",
    "computed",
    "why",
    "reason",
    "definitional",
    "figure",
    "name",
)
SECTIONS = {
    "1": "1 introduction",
    "2": "2 model",
    "3": "3 regimes, ranges",
    "4": "4 modes",
    "5": "5 dissipation",
    "6": "6 comparison",
    "7": "7 conclusions",
    "A": "A compliant contact",
}
VERDICT_COLOURS = {  # which differ in lightness, for print in grey
    ClaimVerdict.HOLDS: "#0b3c6f",
    ClaimVerdict.SPREAD: "#f2c57c",
    ClaimVerdict.STEP: "0.85",
    ClaimVerdict.NOT: "#c1440e",
}


def make_paths(out: Path) -> OutputPaths:
    """Return where files go: the page paper.md into a folder, all else into its folder paper."""
    return paths_next_to_page(out, NAME, out / NAME)


def find_sources(module: ModuleType, earlier: frozenset[str] = frozenset()) -> frozenset[str]:
    """Return the modules of this study on which a module's numbers depend.

    They are the module itself and those from which it imports, without modules that only contain
    text or drawing functions.
    """
    earlier |= {module.__name__}
    taken = {
        getattr(value, "__module__", None) or getattr(value, "__name__", "")
        for value in vars(module).values()
    }
    for name in sorted(
        str(name)
        for name in taken
        if str(name).startswith(PACKAGE) and not str(name).endswith(TEXT_MODULES)
    ):
        if name not in earlier:
            earlier |= find_sources(sys.modules[name], earlier)
    return earlier


def make_key(name: str, settings: PaperSettings) -> Json:
    """Return the key of a part's numbers.

    A finished figure stays valid as long as its key is the same. The key includes the sources of
    its numbers.

    After a change of words only, --redraw takes the numbers as they are.
    """
    figure = next(figure for figure in FIGURES if figure.label == name)
    source = hashlib.sha256()
    for each in sorted(find_sources(sys.modules[figure.describe.__module__])):
        source.update(Path(sys.modules[each].__file__ or "").read_bytes())
    own = {
        "kernels": hash_sources(),
        "source": source.hexdigest()[:16],
        "parameters": vars(settings.size(*figure.sizes)),
    }
    plain: Json = json.loads(json.dumps({"quick": settings.quick, "seed": settings.seed, **own}))
    return plain


def make_claims_part(figures: Sequence[PaperFigure]) -> Part[PaperSettings]:
    """Return the part whose JSON file has the claims of all finished figures."""
    return Part(
        CLAIMED,
        "what the paper says, and what was computed",
        measure=partial(_collected, figures=figures),
        markers=tuple(map(marker, (SUMMARY, REFUTED, CLAIMED))),
        sections=_sections,
        figures=lambda measured: {CLAIMED: make_saver(lambda: draw_verdicts(_read(measured)))},
        tables=lambda measured: (make_claims_table(_read(measured)),),
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


def _read(measured: Measurement) -> list[Claim]:
    return [from_plain(plain) for plain in measured.values["claims"]]


def _sections(measured: Measurement) -> dict[str, str]:
    """Return the sections of the page on the claims.

    They are the summary, the statements that do not simply hold, by their causes, and the rule of
    tolerances.
    """
    claims = _read(measured)
    rule = "\n".join(
        f"| {words} | {allowed} |"
        for words, allowed in (("words", "allowed"), ("---", "---"), *RULE)
    )
    path = f"{NAME}/{CLAIMED}.csv"
    table = (
        f"All {len(claims)} statements with their numbers: [{CLAIMED}.csv]({path}). Its "
        "columns `low` to `high` are the 5 to 95 % of the "
        "members, `least` to `most` what the statement allows; they are empty where several "
        "numbers decide."
    )
    return {
        marker(SUMMARY): format_summary(claims, measured.values.get("answers", {})),
        marker(REFUTED): format_reasons(claims),
        marker(CLAIMED): f"{table}\n\n{format_details('The rule of tolerances', rule)}",
    }


def make_claims_table(claims: Sequence[Claim]) -> CsvTable:
    """Return a row for each claim, numbers with five digits."""

    def cell(value: object) -> object:
        if isinstance(value, float):
            return f"{value:.5g}"
        return "" if value is None else value

    rows = [[cell(claim.to_plain()[column]) for column in CSV_COLUMNS] for claim in claims]
    return CsvTable(CLAIMED, CSV_COLUMNS, rows)


def draw_verdicts(claims: Sequence[Claim]) -> Figure:
    """Draw for each section of the paper how many substantive statements have each verdict."""
    figure, axes = make_panels(1, 1, 2.5)
    own = axes[0, 0]
    counted = [claim for claim in claims if not claim.definitional]
    sections = [name for name in SECTIONS if any(claim.section[0] == name for claim in counted)]
    left = np.zeros(len(sections))
    for verdict, colour in VERDICT_COLOURS.items():
        counts = [
            sum(claim.section[0] == name and claim.verdict is verdict for claim in counted)
            for name in sections
        ]
        if not any(counts):
            continue
        label = f"{_plural(verdict)} ({sum(counts)})"
        bars = own.barh(
            range(len(sections)),
            counts,
            left=left,
            color=colour,
            ec="white",
            label=label,
        )
        dark = verdict in (ClaimVerdict.HOLDS, ClaimVerdict.NOT)
        own.bar_label(
            bars,
            [f"{n}" if n else "" for n in counts],
            label_type="center",
            color="white" if dark else "black",
            fontsize=SMALL,
            fontweight="bold",
        )
        left += counts
    own.set_yticks(range(len(sections)), [SECTIONS[name] for name in sections])
    own.invert_yaxis()
    own.grid(visible=False, axis="y")
    own.set(xlabel="substantive statements of the paper's section")
    own.legend(loc="lower right")
    return figure


def _plural(verdict: ClaimVerdict) -> str:
    return verdict.value.replace("holds", "hold").replace("does not", "do not")


def _counted(claims: Sequence[Claim]) -> str:
    """Return the number of claims with each verdict, as text."""
    counts = Counter(claim.verdict for claim in claims)
    return ", ".join(
        f"{counts[verdict]} {verdict.value if counts[verdict] == 1 else _plural(verdict)}"
        for verdict in ClaimVerdict
        if counts[verdict]
    )


def format_summary(claims: Sequence[Claim], answers: dict[str, str]) -> str:
    """Return the summary of the page.

    It has the counts of verdicts, the substantive statements that do not hold, and answers to the
    open questions.
    """
    own, definitional = (
        [claim for claim in claims if claim.definitional is wanted] for wanted in (False, True)
    )
    failed = [claim for claim in own if claim.verdict is ClaimVerdict.NOT]
    count = f"**{len(own)} substantive statements** were tested: {_counted(own)}."
    if definitional:
        count += (
            f" {len(definitional)} more follow from definitions or from the linear structure: "
            f"{_counted(definitional)}."
        )
    blocks = [count]
    if failed:
        lines = [f"- {claim.statement} (section {claim.section})" for claim in failed]
        blocks.append("These [do not hold](#what-does-not-hold):\n\n" + "\n".join(lines))
    if answers:
        split = (answer.partition(": ") for answer in answers.values())
        lines = [f"- **{question}:** {answer}" for question, _, answer in split]
        blocks.append("Beyond the paper:\n\n" + "\n".join(lines))
    return "\n\n".join(blocks)


def format_reasons(claims: Sequence[Claim]) -> str:
    """Return the claims that do not hold, by their causes, and those that hold within spread.

    The latter are a folded table; their causes are in the file of claims.
    """
    spread = [claim for claim in claims if claim.verdict is ClaimVerdict.SPREAD]
    held = (ClaimVerdict.HOLDS, ClaimVerdict.SPREAD)
    failed = [claim for claim in claims if claim.verdict not in held]
    blocks = []
    for key, text in REASONS.items():
        own = [claim for claim in failed if claim.reason == key]
        if own:
            name, _, rest = text.partition(". ")
            lines = "\n".join(_format_failed(claim) for claim in own)
            blocks.append(f"### {name}\n\n{rest}\n\n{lines}")
    if spread:
        causes = f"Causes are in [{CLAIMED}.csv]({NAME}/{CLAIMED}.csv), column `why`."
        rows = [
            (_capitalised(claim), _format_place(claim), claim.computed)
            for order in REASONS
            for claim in spread
            if claim.reason == order
        ]
        table = markdown(("statement", "section", "computed"), rows)
        title = f"Within spread ({len(spread)})"
        blocks.append(format_details(title, f"{causes}\n\n{table}"))
    return "\n\n".join(blocks)


def _capitalised(claim: Claim) -> str:
    return f"{claim.statement[0].upper()}{claim.statement[1:]}"


def _format_place(claim: Claim) -> str:
    return f"{claim.section}, [{claim.figure}]({NAME}/{claim.figure}.png)"


def _format_failed(claim: Claim) -> str:
    """Return a line on a claim that does not hold: statement, place, numbers and cause."""
    only = "" if claim.verdict is ClaimVerdict.NOT else f", {claim.verdict.value}"
    place = f"(section {_format_place(claim)}{only})"
    return f"- *{_capitalised(claim)}* {place}: {claim.computed}. {claim.why}"


STUDY: Study[PaperSettings] = Study(
    tuple(figure.part() for figure in FIGURES),
    key=make_key,
    same=(),
    stopped_message="finished figures are kept; the same command goes on from here.",
)
CLAIMS: Study[PaperSettings] = Study(
    (make_claims_part(FIGURES),)
)  # once all figures that are to be made are there
