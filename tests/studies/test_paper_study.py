"""The paper's study reuses figures or computes them again, as it should.

A single figure, the claims, wrong input, and cheap claims of the figures are tested too.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import ModuleType

import pytest
from commands import call
from matplotlib.figure import Figure
from places import loaded

from impact_env.checks import ParameterError
from optimisation.files import read_json
from studies.cli import reproduce_paper
from studies.paper import study
from studies.paper.claim import Claim, ClaimVerdict, from_plain, judge_interval
from studies.paper.frame import PaperFigure, PaperSettings, Size, marker, measure_groups
from studies.paper.study import (
    CLAIMED,
    REFUTED,
    SUMMARY,
    draw_verdicts,
    format_reasons,
    format_summary,
    make_claims_part,
)
from studies.study import Json, Steps


def script() -> ModuleType:
    """Return a copy of the command as it is with the figures that there are now."""
    return loaded(Path(reproduce_paper.__file__))


def figure_of(label: str, points: int, begin: Callable[[str], None]) -> PaperFigure:
    """Return a figure of two groups; ``begin`` is told the name of each before it is measured."""

    def group(name: str, settings: PaperSettings) -> dict[str, int]:
        begin(name)
        return {"sum": sum(range(points)) + settings.seed}

    def measure(settings: PaperSettings, _size: Size, known: Json) -> Steps:
        return measure_groups(
            {name: partial(group, f"{label} {name}", settings) for name in ("first", "second")},
            known,
        )

    def describe(values: Json) -> str:
        return f"{label}: {values}"

    def claims(values: Json) -> list[Claim]:
        verdict = judge_interval(values["first"]["sum"], values["second"]["sum"], 3, 3)
        return [
            Claim(
                f"{label} sum",
                "the sum is 3",
                "2.1",
                str(values["second"]["sum"]),
                verdict,
                label,
                "It was another.",
                reason="degree",
            )
        ]

    sizes = Size(points=points), Size(points=0)
    return PaperFigure(
        label,
        label,
        sizes=sizes,
        measure=measure,
        describe=describe,
        draw=lambda _: Figure(),
        claims=claims,
    )


def test_finished_groups_and_figures_are_reused_until_their_parameters_change(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    measured: list[str] = []
    stopped_by = ["two second"]

    def begin(name: str) -> None:
        if name in stopped_by:
            raise KeyboardInterrupt
        measured.append(name)

    def run(*options: object, points: int = 3, code: int = 0) -> list[tuple[str, str]]:
        """Return figure and verdict of each claim."""
        own = tuple(figure_of(label, points, begin) for label in ("one", "two"))
        monkeypatch.setattr(study, "FIGURES", own)
        monkeypatch.setattr(
            study, "STUDY", replace(study.STUDY, parts=tuple(figure.part() for figure in own))
        )
        monkeypatch.setattr(study, "CLAIMS", replace(study.CLAIMS, parts=(make_claims_part(own),)))
        result = call(script(), "--out", tmp_path, *options)
        assert result.exit_code == code, result.output
        return [
            (claim["figure"], claim["verdict"])
            for claim in read_json(tmp_path / "paper" / "claims.json.gz")["claims"]
        ]

    monkeypatch.setattr(study, "LABELS", ("one", "two"))
    (tmp_path / "paper.md").write_text(
        "".join(
            f"<!-- {marker(name)} -->\n<!-- /{marker(name)} -->\n"
            for name in ("one", "two", SUMMARY, REFUTED, CLAIMED)
        )
    )
    every = ["one first", "one second", "two first", "two second"]
    assert run(code=130) == [("one", "holds")]
    stopped_by.clear()
    assert run() == [("one", "holds"), ("two", "holds")]
    assert measured == every
    assert {"one.json.gz", "two.json.gz", "one.png", "two.png", "claims.json.gz"} <= {
        file.name for file in (tmp_path / "paper").iterdir()
    }
    run()
    assert len(measured) == 4
    assert run("--figure", "two", points=4) == [("one", "holds"), ("two", "does not hold")]
    assert measured[4:] == every[2:]
    run("--figure", "two", "--seed", 1, points=4)
    run("--figure", "two", "--seed", 1, "--anew", points=4)
    assert len(measured) == 10


def test_summary_counts_substantive_and_definitional_claims_apart() -> None:
    claims = [
        Claim("a", "x grows", "3", "1", ClaimVerdict.HOLDS, "one"),
        Claim("b", "y falls", "3", "2", ClaimVerdict.NOT, "one", "It grows.", reason="degree"),
        Claim("c", "z is 3", "2", "3", ClaimVerdict.HOLDS, "one", definitional=True),
    ]
    lines = format_summary(claims, {"one": "What z is: three."}).splitlines()
    assert lines[0].startswith(
        "**2 substantive statements** were tested: 1 holds, 1 does not hold. 1 more"
    )
    assert lines[0].endswith("linear structure: 1 holds.")
    assert "- y falls (section 3)" in lines
    assert lines[-1] == "- **What z is:** three."
    figure = draw_verdicts(claims)
    widths = [bar.get_width() for bar in figure.axes[0].patches]
    assert sorted(widths) == [1, 1]


def test_a_claim_that_does_not_hold_says_why() -> None:
    with pytest.raises(ParameterError, match="why of peak"):
        Claim("peak", "the peak is low", "3", "high", ClaimVerdict.NOT, "one")
    with pytest.raises(ParameterError, match="reason of peak = 'luck'"):
        Claim("peak", "low", "3", "high", ClaimVerdict.NOT, "one", "It is.", reason="luck")
    with pytest.raises(ParameterError, match="claim's computed"):
        Claim("peak", "the peak is low", "3", " ", ClaimVerdict.HOLDS, "one")
    claims = [
        Claim("a", "x | y", "3", "1", ClaimVerdict.HOLDS, "one", "hidden"),
        Claim("b", "z", "3", "2", ClaimVerdict.STEP, "one", "The step errs.", reason="step"),
        Claim("c", "w", "4", "5", ClaimVerdict.SPREAD, "one", "It varies.", reason="range"),
    ]
    assert [from_plain(claim.to_plain()) for claim in claims] == [
        replace(claims[0], why=""),
        *claims[1:],
    ]
    assert format_reasons(claims) == (
        "### The step\n\nAt 20 steps per period of the highest mode impacts and reversals of "
        "slip come late.\n\n"
        "- *Z* (section 3, [one](paper/one.png), holds only at the paper's step): 2. "
        "The step errs.\n\n"
        "<details><summary>Within spread (1)</summary>\n\n"
        "Causes are in [claims.csv](paper/claims.csv), column `why`.\n\n"
        "| statement |                 section | computed |\n"
        "| --------- | ----------------------: | -------: |\n"
        "| W         | 4, [one](paper/one.png) |        5 |\n\n"
        "</details>"
    )
