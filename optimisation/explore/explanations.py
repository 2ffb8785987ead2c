"""Meaning of the numbers on the explorer's page.

Each has a sentence for the page and a paragraph for its help, which needs no network.
"""

import html
from dataclasses import dataclass


@dataclass(frozen=True)
class CardNumber:
    """A number of the page's card, in SI units; the page shows it times ``per`` in ``unit``.

    ``about``: the sentence beneath it; ``more``: the help's paragraph, in HTML.
    """

    key: str
    label: str
    unit: str
    per: float
    about: str
    more: str


@dataclass(frozen=True)
class Question:
    """A question of the help page with its answer in HTML; ``key``: its anchor."""

    key: str
    title: str
    answer: str


CARD_NUMBERS = (
    CardNumber(
        "level",
        "Level",
        "mm",
        1e3,
        "RMS of the displacement around its largest value in the sweep.",
        "The response level is the RMS of the displacement over 10 periods to either side of "
        "its largest value in a sweep through "
        "the resonance. Of several members it is the median; with both directions each member "
        "counts with the larger one. "
        "For a random force it is the RMS of the whole run after the start.",
    ),
    CardNumber(
        "band",
        "90 % of further runs",
        "mm",
        1e3,
        "Range in which the level of another run lies with 90 %.",
        "Impacts make the level a random quantity: runs that differ in the phase and a "
        "millionth of the force end at different levels. "
        "The band is a prediction interval from the spread of the members (Student's "
        "distribution of the logarithm); with one member "
        "there is none.",
    ),
    CardNumber(
        "without",
        "Without absorber",
        "mm",
        1e3,
        "Level of the same structure, load and sweep without absorber.",
        (
            "The percentage at the top of the page is the level over this one. The structure is "
            "linear, so it grows in proportion to the load."
        ),
    ),
    CardNumber(
        "limit",
        "Limit of mass and gap",
        "mm",
        1e3,
        "No device of this mass in this cavity can come below it.",
        "Whatever happens in the cavity, the mass can move by the gap only, so its force on "
        "the structure has a bound. Up to some load "
        "the bound is 0: nothing is ruled out. Above it no device of this mass and gap, also "
        "no controlled one, has a lower level.",
    ),
    CardNumber(
        "share",
        "Share of the possible",
        "%",
        100,
        "Reduction of the level over the largest one that mass and gap allow.",
        "The reduction reached over the reduction down to the limit.",
    ),
    CardNumber(
        "gap",
        "Gap",
        "mm",
        1e3,
        "Distance from the middle of the cavity to either wall.",
        "The clearance: half of the mass's free travel.",
    ),
    CardNumber(
        "rule_gap",
        "Design rule's gap",
        "mm",
        1e3,
        "Gap from which a search for this load begins; it grows with the load.",
        "The design rule is the gap at which the limit begins to bind: with a smaller one "
        "even the best device of this mass cannot "
        "suppress the resonance. The best simulated gaps are somewhat larger. Gap, friction "
        "limit and load times the same factor give "
        "the same motion times this factor, so a gap fits one load. <em>Recommended</em> "
        "searches by simulation.",
    ),
    CardNumber(
        "reach",
        "Free amplitude over gap",
        "",
        1,
        (
            "How far the structure moves without absorber, in gaps; below 1 the mass can miss the "
            "walls."
        ),
        "The amplitude without absorber at the design rule's gap over that gap, times rule "
        "over gap. An impact absorber needs a structure "
        "that moves several gaps; a heavily damped structure or a node leaves too little.",
    ),
    CardNumber(
        "mass",
        "Absorber's mass",
        "kg",
        1,
        "All absorbers together.",
        "Mass ratio times the structure's mass.",
    ),
    CardNumber(
        "impacts_a_period",
        "Impacts a period",
        "",
        1,
        "Of each mass, mean over the sweep; near the level's maximum there are more.",
        "About two impacts in each period of the vibration mean that the mass moves with the "
        "structure: the load is then too strong for "
        "the gap. Fewer and irregular impacts scatter energy into higher modes, where it is lost.",
    ),
    CardNumber(
        "largest_speed",
        "Impact speed, largest",
        "m/s",
        1,
        "Largest relative speed at an impact in the run that is drawn.",
        (
            "With the materials and radii in contact it determines contact force and yield "
            "(design gap --contact)."
        ),
    ),
    CardNumber(
        "rms_speed",
        "Impact speed, RMS",
        "m/s",
        1,
        "RMS over the impacts of the run that is drawn.",
        "As the largest one.",
    ),
    CardNumber(
        "impacts_a_second",
        "Impacts a second",
        "1/s",
        1,
        "Mean over the run that is drawn.",
        "Number of impacts over the duration of the run.",
    ),
    CardNumber(
        "power",
        "Power lost in impacts",
        "mW",
        1e3,
        "Mean power that impacts turn into heat and wear.",
        "Energy lost in all impacts of the run that is drawn over its duration.",
    ),
    CardNumber(
        "acceleration",
        "Acceleration, harmonic",
        "m/s²",
        1,
        "√2 times the level times the square of its frequency; impacts add peaks.",
        "Amplitude of the harmonic part of the acceleration where the level is read.",
    ),
    CardNumber(
        "resonance_hz",
        "Resonance",
        "Hz",
        1,
        "Frequency without absorber.",
        "Natural frequency of the structure's mode in question.",
    ),
    CardNumber(
        "rate",
        "Sweep rate",
        "% / 100 periods",
        1,
        "Change of the load's frequency; sweeps start from the steady state.",
        (
            "Slow enough for the damping: 1 % of the resonance frequency in 100 periods, less by "
            "the square of a damping below 1 %."
        ),
    ),
)

QUESTIONS = (
    Question(
        "did",
        "What did the absorber do?",
        "The large number is the level with the absorber over that without. Green: it at "
        "least halves the level. Amber: it lowers it by "
        "at least a tenth. Red: it hardly helps, or makes it worse. The absorber is a free "
        "mass in a cavity of the structure. Impacts take "
        "energy out of the resonance: a part is lost at the walls and in friction, a part "
        "goes into higher modes, which lose it.",
    ),
    Question(
        "bends",
        "Why does the curve bend?",
        "Without absorber the level is proportional to the load: a straight line. At low "
        "loads the structure moves less than the gap and the "
        "mass hardly hits. Then impacts begin, and the level hardly grows with the load over "
        "a wide range: here the absorber works. Above it "
        "the cavity is too narrow. The mass hits both walls once a period and moves with the "
        "structure, and the level jumps up. The limit "
        "(dashed) says where this must happen for the mass and gap.",
    ),
    Question(
        "which",
        "Which gap should I build?",
        "Set the load that your structure has, then press <em>Recommended</em>: it simulates "
        "many gaps and takes the one with the lowest level "
        "that holds for 10 % more and less load. The lowest level of all is at the edge of "
        "the jump, where a little more load is too much. "
        "The command <code>impact-absorber design gap</code> answers in more detail.",
    ),
)

LINES = (
    (
        "line-absorber",
        "the absorber",
        "Median of the members at each load; the band holds 90 % of further runs.",
    ),
    ("line-none", "no absorber", "The same structure and sweep without absorber."),
    (
        "line-limit",
        "limit",
        "No device of this mass in this cavity comes below it (swept force only).",
    ),
    (
        "line-friction",
        "friction damper",
        (
            "The same mass without walls, with the friction limit that loses most energy at the "
            "middle of the curve."
        ),
    ),
    (
        "line-tuned",
        "tuned absorber",
        (
            "The same mass on a spring and damper, with the lowest peak: best at this resonance, "
            "useless at others."
        ),
    ),
    ("line-pinned", "pinned", "The setting that you pinned, to compare with."),
    (
        "line-stuck",
        "absorber stuck",
        "The mass held in the middle of its cavity: a heavier structure.",
    ),
    (
        "line-orbits",
        "stable and unstable motions",
        "Periodic motions with one impact per wall and period; runs settle on stable ones only.",
    ),
)

PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark"><title>What the explorer shows</title>
<link rel="icon" href="assets/icon.svg"><link rel="stylesheet" href="assets/style.css"></head>
<body class="help"><h1>What the explorer shows</h1>{questions}
<h2>Numbers</h2><dl>{numbers}</dl><h2>Lines</h2><dl>{lines}</dl></body></html>
"""


def format_help() -> str:
    """Return the help page: three questions, all numbers, all lines, each with an anchor."""
    questions = "".join(
        f'<h2 id="{one.key}">{html.escape(one.title)}</h2><p>{one.answer}</p>' for one in QUESTIONS
    )
    numbers = "".join(
        (
            f'<dt id="{row.key}">{html.escape(row.label)}</dt><dd>{html.escape(row.about)} '
            f"{row.more}</dd>"
        )
        for row in CARD_NUMBERS
    )
    lines = "".join(
        f'<dt id="{key}">{html.escape(label)}</dt><dd>{html.escape(text)}</dd>'
        for key, label, text in LINES
    )
    return PAGE.format(questions=questions, numbers=numbers, lines=lines)
