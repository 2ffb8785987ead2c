"""The results of `design gap` and their basis: text, card, rows, JSON and figures.

Quantities are in SI units unless stated otherwise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from impact_env.modes import ModalModel
from optimisation.bounds import LARGE_REACH, SMALL_REACH
from optimisation.contact import estimate, meeting_mass, reaches_beyond
from optimisation.files import numbers
from optimisation.gap_advice import Advice, Answer
from optimisation.measures import format_number
from optimisation.report.report import (
    BLUE,
    GREEN,
    HATCHED,
    MM,
    NO_DEVICE,
    ORANGE,
    TICKS,
    Chart,
    Column,
    Curve,
    Group,
    Json,
    Row,
    Table,
    assumed_rows,
    baseline_rows,
    between,
    device_rows,
    draw_grid,
    figure_of,
    force_axis,
    service_rows,
    show_span,
)
from optimisation.service import UNCERTAIN_DRAWS, ServiceLoads
from optimisation.sweep_range import LEAST_RATIO, is_at_end
from optimisation.tolerances import Distribution, plain

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLUMNS = (
    Column("gap_m", "gap, mm", scale=MM),
    Column("gap_over_rule", "of the rule's", "{:.3g}"),
    Column("members"),
    Column("level_median_m", "level, mm", scale=MM),
    Column(
        "level_5_percent_m",
        "90 % of runs, mm",
        show_span("level_5_percent_m", "level_95_percent_m", MM),
    ),
    Column("level_95_percent_m"),
    Column("relative_median", "of no absorber, %", "{:.1f}", 100),
    Column("limit_m", "limit, mm", scale=MM),
    Column("share_of_possible_reduction", "share of the possible, %", "{:.1f}", 100),
    Column(heading="members", show=lambda row: str(row["members"])),
)
WARNING = "Warning: "


def gap_table(advice: Advice) -> Table:
    """Return a row for each gap that was run in full."""
    check = advice.check
    rows = []
    for k, gap in enumerate(check.gaps):
        members = int(np.sum(~np.isnan(check.curves[k].combined)))
        levels = (check.level[k], *advice.band[:, k], check.relative[k])
        ends = (float(check.limit[k]), float(check.share[k]))
        rows.append((float(gap), float(gap) / check.rule, members, *map(float, levels), *ends))
    return Table(COLUMNS, rows)


def printed_table(advice: Advice) -> Table:
    """Return the rows of the rule's gap, and of each that more than one member ran."""
    single = {gap for gap, _ in advice.single_runs}
    rows = [
        row for row in gap_table(advice).rows if row[0] not in single or row[0] == advice.check.rule
    ]
    return Table(COLUMNS, rows)


def _percent(answer: Answer, advice: Advice, factor: float) -> str:
    """Return how much more a device's level is under so many times the force, in words."""
    change = 100 * (advice.at_force(answer, factor) / answer.level - 1)
    return "not known" if math.isnan(change) else f"{change:+.0f} %"


def band_in_words(answer: Answer, factor: float = 1e3) -> str:
    """Return the interval that holds 90 % of fresh runs as text in brackets.

    Its ends are multiplied by ``factor``. The text is empty if the interval is not known.
    """
    if answer.prediction is None:
        return ""
    return f" (90 % of runs: {factor * answer.low:.4g} to {factor * answer.high:.4g})"


def _ratio(answer: Answer) -> str:
    """Return the frequency at which a level was read, in words."""
    return f"{answer.frequency_ratio:.4g} of the resonance"


def device(answer: Answer, mass: float) -> str:
    """Return the device to build in words, mass in kg."""
    friction = (
        f"friction limit {answer.friction_limit:.4g} N" if answer.friction_limit else "no friction"
    )
    restitution = answer.absorber.walls.restitution  # type: ignore[union-attr]
    return (
        f"a clearance of {1e3 * answer.gap:.4g} mm to either wall, {friction}, restitution "
        f"{restitution:g}, mass {mass:.4g} kg"
    )


def _worst(answer: Answer) -> str:
    """Return a device's largest level over the tolerance of the force, in words."""
    known = math.isfinite(answer.worst)
    return f"at most {1e3 * answer.worst:.4g} mm" if known else "not known"


def title(advice: Advice) -> str:
    """Return the heading of the card."""
    check = advice.check
    return f"Impact absorber for {format_number(check.force)} N near resonance {check.resonance}"


def answer(advice: Advice) -> list[str]:
    """Return lines on the recommended device and on the one with the lowest level.

    They include the levels of both if the force changes.
    """
    check = advice.check
    best = advice.recommended
    sharp = advice.sharp
    if best is None or sharp is None:
        return ["No gap was simulated in full."]
    without = float(check.without.median[0])
    t = advice.tolerance
    force = f"{check.force:g} N near resonance {check.resonance}"
    lines = [
        f"Recommended: {device(best, check.mass)}, for {force}.",
        (
            f"  Level {1e3 * best.level:.4g} mm{band_in_words(best)}, "
            f"{100 * best.level / without:.1f} % of no absorber, read at {_ratio(best)}; "
            f"{_worst(best)} from {(1 - t) * check.force:.4g} to {(1 + t) * check.force:.4g} N."
        ),
    ]
    if sharp.gap != best.gap:
        lines.append(
            f"Lowest level: {1e3 * sharp.gap:.4g} mm, "
            f"level {1e3 * sharp.level:.4g} mm{band_in_words(sharp)}, "
            f"{100 * sharp.level / without:.1f} % of no absorber; {_worst(sharp)} over that range."
        )
    rows = [
        (
            f"{100 * (factor - 1):+.0f} % force: {_percent(best, advice, factor)}, "
            f"{_percent(sharp, advice, factor)}"
        )
        for factor in (1.1, 1.2, 1.3)
    ]
    lines.append(
        "The cliff, level at the recommended gap and at that of the lowest level: "
        + "; ".join(rows)
        + "."
    )
    runs = len(check.curves[check.at_rule].members) if check.gaps.size else 0
    single = "" if runs >= best.members else f" ({runs} of {best.members} runs)"
    rule = f"Design rule (no simulation): {1e3 * check.rule:.4g} mm"
    at_rule = (
        float(check.level[check.at_rule])
        if check.gaps.size and check.gaps[check.at_rule] == check.rule
        else math.nan
    )
    over_best = ""
    if not math.isnan(at_rule):
        over_best = f", level {at_rule / best.level:.2f} times that of the recommended{single}"
    lines.append(f"{rule}{over_best}.")
    lines.append(
        f"Free amplitude over the rule's gap: {check.reach:.3g}. The friction limit follows "
        "the gap by the scaling law: docs/which_gap.md."
    )
    lines += _limit_lines(advice)
    lines += _tried(advice.tried)
    return lines


def probability(advice: Advice, limit: float | None) -> list[str]:
    """Return the probability that the recommended device's level stays below a limit in m.

    It is a line of text. The list is empty without a limit.
    """
    best = advice.recommended
    if limit is None or best is None:
        return []
    if best.prediction is None:
        return [f"Probability of a level below {1e3 * limit:.4g} mm: not known from single runs."]
    share = best.prediction.probability_below(limit)
    return [
        f"Probability of a level below {1e3 * limit:.4g} mm at this force: {100 * share:.0f} %."
    ]


def _limit_lines(advice: Advice) -> list[str]:
    """Return the line about what the recommended device keeps; none without limits."""
    best = advice.recommended
    words = []
    if advice.limits.stroke is not None and best is not None:
        words.append(f"stroke {1e3 * best.gap:.4g} of at most {1e3 * advice.limits.stroke:.4g} mm")
    if (
        advice.limits.impact_speed is not None
        and best is not None
        and best.impact_speed is not None
    ):
        words.append(
            f"impact speed {best.impact_speed:.4g} of at most {advice.limits.impact_speed:.4g} m/s"
        )
    return [f"Limits at this force: {'; '.join(words)}."] if words else []


def _tried(tried: Sequence[tuple[str, float, float, float]]) -> list[str]:
    """Return the lowest level with each value of a free variable, and its gap.

    Levels are relative to that of the first value.
    """
    lines = []
    for name in dict.fromkeys(name for name, *_ in tried):
        rows = [row for other, *row in tried if other == name]
        words = "; ".join(
            f"{value:.3g}: {level / rows[0][1]:.2f}, {1e3 * gap:.3g} mm"
            for value, level, gap in rows
        )
        softer = (
            " Softer walls take more of each impact: more wear, less stroke."
            if name == "restitution"
            else ""
        )
        lines.append(
            "Lowest level of a coarse search over that of the first value, and its gap, "
            f"{name.replace('_', ' ')} {words}.{softer}"
        )
    return lines


def warnings(advice: Advice) -> list[str]:
    """Return warnings, and the number of sweeps."""
    check = advice.check
    ratio = advice.check.sweep_ratio
    useless = advice.recommended is not None and advice.recommended.level >= float(
        check.without.median[0]
    )
    best = advice.recommended
    read_at_end = best is not None and is_at_end(best.frequency_ratio, check.limits, check.rate)
    conditions = {
        f"the level was read at an end of the sweeps, {_ratio(best) if best else ''}: a "
        "resonance beside this one, or an absorber too heavy for the "
        "range, decides": read_at_end,
        "no gap that ran keeps the limits; the recommended one breaks them least": (
            not advice.keeps_limits
        ),
        (
            f"the free amplitude is {check.reach:.3g} of the rule's gap; below {SMALL_REACH:g} "
            "the rule's gap is too wide"
        ): check.reach < SMALL_REACH,
        (
            f"free amplitude over the rule's gap above {LARGE_REACH:g}: the rule's gap is too "
            "narrow, on the steep side"
        ): check.reach > LARGE_REACH,
        (
            "the best gap is the narrowest or widest that was tried: another mass or place may "
            "suit better"
        ): advice.at_end,
        "no gap brings the level below that without absorber: another place may suit better": (
            useless
        ),
        (
            "in some gaps no device can be sure to lower the level: the response is near a node "
            "of the resonance, or other modes decide there"
        ): bool(check.out_of_reach.any()),
    }
    lines = [f"{WARNING}{words}." for words, so in conditions.items() if so]
    low, high = check.limits
    lines.append(
        f"Sweeps from {low:.3g} to {high:.3g} of the resonance at {check.rate:.3g} % per 100 "
        "pseudo periods "
        f"show {ratio:.3f} of the stationary level without absorber."
    )
    if ratio < LEAST_RATIO:
        lines.append(
            f"{WARNING}below {LEAST_RATIO:g} shares of the possible are left out; sweep more "
            "slowly."
        )
    left_out = (
        f"; {len(advice.single_runs)} other gaps, with one run each, are left out of the table"
        if advice.single_runs
        else ""
    )
    lines.append(f"{advice.sweeps} sweeps{left_out}.")
    return lines


def baselines(service: ServiceLoads) -> str:
    """Return the lines about other absorbers of the same mass."""
    other = service.baselines
    alone = ", for this resonance alone" if other.tuned < service.answer.level else ""
    tuned = f"the best tuned absorber leaves {1e3 * other.tuned:.4g} mm{alone}"
    return (
        f"Of the same mass and over the same range, {tuned}; the best friction damper "
        f"{1e3 * other.damper:.4g} mm."
    )


@dataclass(frozen=True)
class UncertaintyResult:
    """Level in m of the recommended device under uncertainty.

    ``every``: the uncertain quantities, all of which are drawn. ``low``, ``median`` and ``high``:
    5, 50 and 95 % quantiles of the level.
    """

    every: tuple[Distribution, ...]
    low: float
    median: float
    high: float

    @property
    def as_text(self) -> str:
        """What is uncertain, in words."""
        return ", ".join(one.words for one in self.every)

    @property
    def level_words(self) -> str:
        """Median and quantiles, in words."""
        return f"{MM * self.median:.4g} mm ({MM * self.low:.4g} to {MM * self.high:.4g})"

    @property
    def words(self) -> str:
        """One line."""
        return f"With {self.as_text}: {self.level_words}, of {UNCERTAIN_DRAWS} draws."

    def plain(self) -> dict[str, object]:
        """Return it as JSON values."""
        return {
            "given": plain(self.every),
            "draws": UNCERTAIN_DRAWS,
            "level_m": self.median,
            "level_5_m": self.low,
            "level_95_m": self.high,
        }


CONTACT_HEADING = "Contact, estimated after Hertz, without loss"


def contact_rows(
    model: ModalModel, absorber_mass: float, speed: float, contact: tuple[str, str, float]
) -> tuple[tuple[Row, ...], list[str]]:
    """Return the estimated contact of an impact at a speed in m/s, and warnings.

    There is a warning if the impact excites modes that the model lacks.
    """
    first, second, radius = contact
    if not speed > 0:
        return (Row("contact", "no impact"),), []
    one = estimate(first, second, radius, meeting_mass(model, absorber_mass), speed)
    top = float(model.omega.max()) / (2 * math.pi)
    rows = (
        Row(
            "of",
            (
                f"{first} and {second}, radius {1e3 * radius:.4g} mm, {one.mass:.4g} kg at "
                f"{speed:.4g} m/s"
            ),
        ),
        Row("contact time", 1e3 * one.time, "ms"),
        Row("peak force", one.force, "N"),
        Row("peak pressure", 1e-6 * one.pressure, "MPa"),
        Row("force up to about, one over the contact time", 1 / one.time, "Hz"),
        Row("modes kept up to", top, "Hz"),
    )
    text = (
        f"impacts of {1e3 * one.time:.3g} ms reach modes above the {model.modes} kept, up to "
        f"about {1 / one.time:.3g} Hz: try more modes"
    )
    return rows, [text] if reaches_beyond(model, one) else []


def device_groups(
    advice: Advice,
    service: ServiceLoads,
    unsure: UncertaintyResult | None = None,
    contact: tuple[str, str, float] | None = None,
    more: str = "",
) -> tuple[list[Group], list[str]]:
    """Return the card's groups about the recommended device, and its warnings.

    ``contact``: two materials of `optimisation.contact` and the radius in m of the rounder one;
    ``more``: what more modes change, in words.
    """
    check = advice.check
    best = service.answer
    model = advice.check.model
    t = advice.tolerance
    without = float(check.without.median[0])
    low = (1 - t) * check.force
    high = (1 + t) * check.force
    level: tuple[Row, ...] = (
        Row(f"at {check.force:g} N, median of {best.members} runs", MM * best.level, "mm RMS"),
        Row("90 % of further runs", _interval(best)),
        Row("read at", best.frequency_ratio, "of the resonance"),
        Row(f"at most, {low:.4g} to {high:.4g} N", _worst(best).removeprefix("at most ")),
        Row("of no absorber", 100 * best.level / without, "%"),
        Row("no absorber", MM * without, "mm"),
        *baseline_rows(service.baselines),
        Row(NO_DEVICE, MM * check.limit_at(best.gap), "mm"),
    )
    if unsure is not None:
        level = (*level, Row(f"with {unsure.as_text}", unsure.level_words))
    finite = service.forces[~np.isnan(service.levels)]
    forces = (
        Row("halves the level", between(*service.works)),
        Row("lowers the level", between(*service.helps)),
        Row("known by the scaling law", between(finite[0], finite[-1])),
    )
    assumed = (
        *assumed_rows(model, (check.resonance,), check.rate, more),
        Row("over", f"{check.limits[0]:.3g} to {check.limits[1]:.3g} of the resonance"),
        Row("such sweeps show of the stationary level", 100 * check.sweep_ratio, "%"),
        Row("sweeps taken", f"{advice.sweeps}, and two with impacts recorded"),
    )
    touch: tuple[Row, ...] = ()
    reached: list[str] = []
    if contact is not None:
        touch, reached = contact_rows(model, check.mass, service.impacts.largest, contact)
    groups: list[Group] = [
        ("Device", device_rows(best.absorber, model)),
        ("Response level", level),
        ("Forces", forces),
        ("What it bears", service_rows(best.gap, service.impacts, best.level)),
        *(((CONTACT_HEADING, touch),) if touch else ()),
        ("Assumptions", assumed),
    ]
    own = [line.removeprefix(WARNING) for line in warnings(advice) if line.startswith(WARNING)]
    return groups, own + reached


def _interval(answer: Answer) -> str | None:
    """Return the interval that holds 90 % of fresh runs; None where it is not known."""
    if answer.prediction is None:
        return None
    return f"{1e3 * answer.low:.4g} to {1e3 * answer.high:.4g} mm"


def level_charts(advice: Advice, service: ServiceLoads) -> tuple[Chart, ...]:
    """Return the level over the gap, and that of the recommended device over the force."""
    check = advice.check
    mm = 1e3
    gaps = numbers(mm * check.gaps)
    full = Curve(
        "median, 90 % of runs",
        gaps,
        numbers(mm * check.level),
        numbers(mm * advice.band[0]),
        numbers(mm * advice.band[1]),
    )
    curves = [full]
    if advice.single_runs:
        at, level = zip(*advice.single_runs, strict=True)
        curves.append(
            Curve(
                "one run",
                numbers([mm * x for x in at]),
                numbers([mm * x for x in level]),
                points=True,
            )
        )
    marks = [("design rule", mm * check.rule), ("recommended", mm * service.answer.gap)]
    if advice.sharp is not None:
        marks.append(("lowest level", mm * advice.sharp.gap))
    over_gap = Chart(
        "Level over the gap",
        "clearance to either wall in mm",
        "level in mm (RMS)",
        tuple(curves),
        tuple(marks),
        log_x=True,
    )
    force = service.forces
    without = float(check.without.median[0]) / check.force
    both = (
        Curve("recommended device", numbers(force), numbers(mm * service.levels)),
        Curve("no absorber", numbers(force), numbers(mm * without * force)),
        Curve(
            "best tuned absorber",
            numbers(force),
            numbers(mm * service.baselines.tuned / check.force * force),
        ),
    )
    mark = (("the force", check.force),)
    over_force = Chart(
        "Level over the force",
        "force in N",
        "level in mm (RMS)",
        both,
        mark,
        log_x=True,
        log_y=True,
    )
    return over_gap, over_force


def answer_values(
    answer: Answer | None, mass: float, measure: str = "level", unit: str = "m"
) -> Json | None:
    """Return a device and its levels as JSON values, mass in kg; None without device.

    Instead of levels they may be another ``measure`` in its ``unit``.
    """
    if answer is None:
        return None
    levels = {"": answer.level, "_5": answer.low, "_95": answer.high, "_worst": answer.worst}
    return {
        "gap_m": answer.gap,
        "friction_limit_n": answer.friction_limit,
        "restitution": answer.absorber.walls.restitution,  # type: ignore[union-attr]
        "mass_kg": mass,
        **{
            f"{measure}{name}_{unit}": value if math.isfinite(value) else None
            for name, value in levels.items()
        },
        "members": answer.members,
        **(
            {}
            if math.isnan(answer.frequency_ratio)
            else {"frequency_ratio": answer.frequency_ratio}
        ),
        **({} if answer.impact_speed is None else {"impact_speed_m_s": answer.impact_speed}),
    }


def summary(advice: Advice) -> Json:
    """Return answers, settings, the rule and what the simulation says of it as JSON values."""
    check = advice.check
    points: Json = {}
    records = gap_table(advice).records()
    if records:
        ran = check.gaps[check.at_rule] == check.rule
        points["at_rule"] = records[check.at_rule] if ran else None
    if advice.sharp is not None:
        points["best"] = records[int(np.argmin(np.abs(check.gaps - advice.sharp.gap)))]
    device = advice.recommended.absorber if advice.recommended is not None else check.absorber
    without = float(check.without.median[0])
    return {
        "complete": advice.complete,
        "recommended": answer_values(advice.recommended, check.mass),
        "sharp": answer_values(advice.sharp, check.mass),
        "rule_gap_m": check.rule,
        "free_amplitude_over_gap": check.reach,
        "level_without_absorber_m": None if math.isnan(without) else without,
        "sweep_over_stationary_level": None if math.isnan(without) else check.sweep_ratio,
        **points,
        "single_runs": [{"gap_m": gap, "level_m": level} for gap, level in advice.single_runs],
        "tried": [
            dict(zip(("name", "value", "level_m", "gap_m"), one, strict=True))
            for one in advice.tried
        ],
        "settings": {
            "force_n": check.force,
            "force_tolerance": advice.tolerance,
            "resonance": check.resonance,
            "mass_ratio": device.mass_ratio,
            "restitution": getattr(device.walls, "restitution", None),
            "friction_limit_n": None if device.friction is None else device.friction.limit,
            "modes": check.model.modes,
            "percent_per_100_pseudo_periods": check.rate,
            "sweep_limits": list(check.limits),
            "members": advice.members,
            "sweeps": advice.sweeps,
            "level": (
                "larger of sweep up and sweep down; median, and the interval that holds 90 % of "
                "further runs"
            ),
            "limits": {
                name: value
                for name, value in (
                    ("stroke_m", advice.limits.stroke),
                    ("impact_speed_m_s", advice.limits.impact_speed),
                )
                if value is not None
            },
        },
    }


def draw_levels(advice: Advice) -> Figure:
    """Draw level and limit over the gap, with the answers."""
    check = advice.check
    figure, axes = figure_of(8, 5.2)
    gaps = MM * check.gaps
    low, high = MM * advice.band
    every = [*check.gaps] or [check.rule]
    fine = np.geomspace(0.95 * min(every), 1.05 * max(every), 120)
    limit = MM * np.array([check.limit_at(float(gap)) for gap in fine])
    axes.fill_between(
        MM * fine, 0, limit, **HATCHED, label="out of reach for any device in that gap"
    )
    axes.fill_between(gaps, low, high, color=BLUE, alpha=0.25, lw=0)
    most = max((len(curve.members) for curve in check.curves), default=0)
    axes.plot(
        gaps,
        MM * check.level,
        "o-",
        color=BLUE,
        lw=2.2,
        ms=5,
        label=f"median of up to {most} runs, 90 % of further runs",
    )
    if advice.single_runs:
        at, level = MM * np.array(advice.single_runs).T
        axes.plot(at, level, "o", ms=5, mfc="white", mec=BLUE, ls="", label="one run")
    axes.axvline(
        MM * check.rule,
        color=ORANGE,
        lw=1.4,
        ls="--",
        label=f"design rule: {MM * check.rule:.3g} mm",
    )
    for answer, colour, word in (
        (advice.sharp, "black", "lowest level"),
        (advice.recommended, GREEN, "recommended"),
    ):
        if answer is not None:
            axes.axvline(
                MM * answer.gap, color=colour, lw=1.8, label=f"{word}: {MM * answer.gap:.3g} mm"
            )
    if advice.recommended is not None and np.isfinite(advice.recommended.worst):
        best = advice.recommended
        words = f"at most, {format_number(100 * advice.tolerance)} % more or less force"
        axes.plot(MM * best.gap, MM * best.worst, "v", color=GREEN, ms=9, label=words)
    without = MM * float(check.without.median[0])
    stopped = "" if advice.complete else " (stopped early)"
    axes.set_xscale("log")
    top = max(float(np.nanmax([*high, *(MM * check.level)], initial=0)), float(limit.max()))
    axes.set(xlim=(MM * fine[0], MM * fine[-1]), ylim=(0, 1.6 * top if top > 0 else 1))
    force_axis(axes.xaxis, TICKS)
    axes.set_xlabel("clearance to either wall in mm", fontsize=11)
    axes.set_ylabel("resonant response level in mm (RMS)", fontsize=11)
    draw_grid(axes)
    axes.legend(loc="upper center", ncols=2, fontsize=8.5, framealpha=0.95)
    percent = format_number(100 * check.absorber.mass_ratio)
    absorber = (
        f"absorber of {percent} % of the structure's mass; without absorber: {without:.3g} mm"
    )
    force = format_number(check.force)
    axes.set_title(
        f"Gap for {force} N near resonance {check.resonance}{stopped}\n{absorber}", fontsize=11
    )
    return figure
