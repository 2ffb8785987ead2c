"""The content of the result of `design place`.

It has a picture of the structure coloured by reach. Quantities are in SI units unless stated
otherwise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from impact_env.modes import mode_shapes
from impact_env.parameters import Beam
from optimisation.absorber_rules import Baselines
from optimisation.files import number, numbers
from optimisation.frequency_levels import ResonanceCurves
from optimisation.measures import format_number
from optimisation.place_advice import (
    FLAT,
    LIGHTEST,
    SURE,
    PlaceAdvice,
    PlacedDevice,
    ResonanceLevel,
    probability_lower,
)
from optimisation.place_map import PlaceMap, Places
from optimisation.report.frequency_report import (
    frequency_charts,
    frequency_figures,
    frequency_tables,
)
from optimisation.report.gap_report import CONTACT_HEADING, contact_rows
from optimisation.report.report import (
    BLUE,
    GREEN,
    GREY,
    MM,
    NO_DEVICE,
    ORANGE,
    Chart,
    Curve,
    Group,
    Json,
    Report,
    Row,
    Table,
    assumed_rows,
    baseline_rows,
    device_rows,
    draw_grid,
    figure_of,
    service_rows,
)
from optimisation.service import ImpactLoads

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
HEADINGS = (
    *("place", "mass, %", "gap, mm", "level, % of no absorber", "90 % of runs, %", "at most, %"),
    *("gaps within 10 %, mm", "reach", "members"),
)
MOST_BARS = 60
SHAPE_TOL = 1e-9  # of mode shapes at one place, read twice from one file
FINE = 201  # points of a beam that are drawn


def _interval(ends: tuple[float, float], factor: float, unit: str = "") -> str:
    """Return the interval that holds 90 % of further runs in words."""
    if math.isnan(ends[0]):
        return "not known from single runs"
    return f"{factor * ends[0]:.4g} to {factor * ends[1]:.4g}{unit}"


def _runs(number: int) -> str:
    """Return a number of runs in words."""
    return "one run" if number == 1 else f"{number} runs"


def level_line(part: ResonanceLevel) -> str:
    """Return a device's level near one resonance in words."""
    return (
        f"{part.force:g} N near resonance {part.resonance}: level {MM * part.level:.4g} mm "
        f"(90 % of runs: {_interval(part.interval, MM)}), "
        f"{100 * part.share:.1f} % of no absorber, read at {part.frequency_ratio:.4g} of the "
        f"resonance; at most {MM * part.worst:.4g} mm."
    )


def answer(advice: PlaceAdvice) -> list[str]:
    """Return the recommended place, mass and gap with their certainty."""
    best = advice.recommended
    if best is None:
        return ["No device was simulated in full."]
    mass = best.mass_ratio * advice.places.model.beam_mass
    friction = (
        f"friction limit {best.friction_limit:.4g} N" if best.friction_limit else "no friction"
    )
    restitution = best.absorber.walls.restitution  # type: ignore[union-attr]
    tolerance = 100 * advice.tolerance
    lines = [
        (
            f"Recommended: at {advice.places.word(best.place)}, mass {mass:.4g} kg "
            f"({100 * best.mass_ratio:.4g} %), a clearance of "
            f"{MM * best.gap:.4g} mm to either wall, {friction}, restitution {restitution:g}."
        ),
        *(f"  {level_line(part)}" for part in best.parts),
    ]
    if len(best.parts) > 1:
        lines.append(
            f"  The worse of them: {100 * best.share:.1f} % of no absorber (90 % of runs: "
            f"{_interval(best.interval, 100, ' %')}); "
            f"at most {100 * best.worst:.1f} % with {tolerance:g} % more or less force."
        )
    lines.append(
        f"Gap: from {MM * best.gaps[0]:.4g} to {MM * best.gaps[1]:.4g} mm the level is at "
        f"most {FLAT:g} times that."
    )
    lines += _place_lines(advice, best)
    lines += _mass_lines(advice, best)
    return lines


def _place_lines(advice: PlaceAdvice, best: PlacedDevice) -> list[str]:
    """Return how certain the place is: against the others that ran, and by the linear structure."""
    words = []
    for rival in advice.rivals:
        if best.prediction is None or rival.prediction is None:
            chance = "not known from single runs"
        else:
            chance = f"{100 * probability_lower(best.prediction, rival.prediction):.0f} %"
        words.append(
            f"{advice.places.word(rival.place)} leaves {100 * rival.share:.1f} % with "
            f"{MM * rival.gap:.4g} mm; "
            f"probability that a run of the recommended is lower: {chance}"
        )
    tried = {trial.place for trial in advice.trials if trial.mass_ratio == best.mass_ratio}
    others = sorted(tried - {best.place} - {rival.place for rival in advice.rivals})
    if others:
        names = ", ".join(advice.places.names[place] for place in others)
        words.append(f"single runs at {names} left more")
    if not words:
        words = ["no other place was simulated"]
    return [f"Place: {'; '.join(words)}."]


def _mass_lines(advice: PlaceAdvice, best: PlacedDevice) -> list[str]:
    """Return why this mass, and the others."""
    if len(advice.maps) == 1:
        return []
    if advice.limit_level is not None:
        chance = best.probability_below(advice.limit_level)
        odds = "not known from single runs" if math.isnan(chance) else f"{100 * chance:.0f} %"
        kind = "the lightest that stays" if advice.keeps_limit else "the most likely to stay"
        return [
            (
                f"Mass: {kind} below {MM * advice.limit_level:.4g} mm with {100 * SURE:.0f} %; "
                f"its probability: {odds}."
            )
        ]
    others = ", ".join(
        f"{100 * one.mass_ratio:.4g} %: {100 * one.worst:.1f} %"
        for one in advice.best_by_mass
        if one.mass_ratio != best.mass_ratio
    )
    return [
        (
            f"Mass: the lightest within {LIGHTEST:g} of the lowest level; level at most with "
            f"others: {others or 'none was finished'}."
        )
    ]


def warnings(advice: PlaceAdvice) -> list[str]:
    """Return warnings, and the number of sweeps."""
    best = advice.recommended
    lines = []
    if best is not None:
        for part in best.parts:
            low, high = part.sweep_range
            near = max(1e-3 * part.rate, 0.01 * (high - low))
            if not low + near < part.frequency_ratio < high - near:
                lines.append(
                    f"the level near resonance {part.resonance} was read at an end of the "
                    f"sweeps, {part.frequency_ratio:.4g} of it: a resonance "
                    "beside this one, or an absorber too heavy for the range, decides"
                )
            if part.share > 1:
                lines.append(
                    f"near resonance {part.resonance} the level is above that without "
                    "absorber: one gap cannot serve these forces together"
                )
        if not advice.keeps_limit:
            lines.append(
                f"no device that ran stays below {MM * (advice.limit_level or 0):.4g} mm with "
                f"{100 * SURE:.0f} %"
            )
        if not advice.keeps_speed(best):
            lines.append("no gap that ran keeps the impact speed")
    return lines


def sweeps_line(advice: PlaceAdvice) -> str:
    """Return how many sweeps were made over which ranges."""
    ranges = "; ".join(
        (
            f"{low:.3g} to {high:.3g} of resonance {r} at {advice.study.rates[r]:.3g} % per 100 "
            "pseudo periods"
        )
        for r, (low, high) in advice.study.ranges.items()
    )
    return f"{advice.sweeps} sweeps, {ranges}. {len(advice.places)} places by the linear structure."


def device_table(advice: PlaceAdvice) -> Table:
    """Return a line for each device whose gap was searched."""
    lines = []
    for one in advice.devices:
        reaches = advice.map_of(one).reach[:, one.place]
        ends = (
            "-"
            if one.prediction is None
            else f"{100 * one.interval[0]:.3g} to {100 * one.interval[1]:.3g}"
        )
        lines.append(
            (
                advice.places.names[one.place],
                f"{100 * one.mass_ratio:.4g}",
                f"{MM * one.gap:.4g}",
                f"{100 * one.share:.1f}",
                ends,
                f"{100 * one.worst:.1f}",
                f"{MM * one.gaps[0]:.3g} to {MM * one.gaps[1]:.3g}",
                ", ".join(f"{x:.3g}" for x in reaches),
                str(one.members),
            )
        )
    return Table.of_words(HEADINGS, lines)


def device_values(advice: PlaceAdvice, one: PlacedDevice) -> Json:
    """Return a device as JSON values."""
    places = advice.places
    return {
        "place": one.name,
        "place_m": None if places.points is None else places.points[one.place].tolist(),
        "mass_kg": one.mass_ratio * places.model.beam_mass,
        "mass_ratio": one.mass_ratio,
        "gap_m": one.gap,
        "gap_range_m": list(one.gaps),
        "friction_limit_n": one.friction_limit,
        "restitution": one.absorber.walls.restitution,  # type: ignore[union-attr]
        "relative_level": one.share,
        "relative_level_5": number(one.interval[0]),
        "relative_level_95": number(one.interval[1]),
        "relative_level_worst": one.worst,
        "members": one.members,
        "sweeps": one.sweeps,
        **({} if one.impact_speed is None else {"impact_speed_m_s": one.impact_speed}),
        "resonances": [
            {
                "resonance": part.resonance,
                "force_n": part.force,
                "level_m": part.level,
                "level_5_m": number(part.interval[0]),
                "level_95_m": number(part.interval[1]),
                "level_worst_m": part.worst,
                "level_without_absorber_m": part.without,
                "limit_m": part.limit,
                "frequency_ratio": part.frequency_ratio,
                "sweep_limits": list(part.sweep_range),
                "percent_per_100_pseudo_periods": part.rate,
            }
            for part in one.parts
        ],
    }


def summary(advice: PlaceAdvice) -> Json:
    """Return answer, devices, trials and settings as JSON values."""
    best = advice.recommended
    rivals = []
    for rival in advice.rivals:
        known = best is not None and best.prediction is not None and rival.prediction is not None
        chance = (
            probability_lower(best.prediction, rival.prediction)  # type: ignore[union-attr, arg-type]
            if known
            else None
        )
        rivals.append({"place": rival.name, "probability_recommended_is_lower": chance})
    return {
        "complete": advice.complete,
        "recommended": None if best is None else device_values(advice, best),
        "rivals": rivals,
        "devices": [device_values(advice, one) for one in advice.devices],
        "trials": [
            {
                "place": advice.places.names[trial.place],
                "mass_ratio": trial.mass_ratio,
                "gap_m": trial.gap,
                "relative_level": trial.share,
            }
            for trial in advice.trials
        ],
        "level_without_absorber_m": {str(r): x for r, x in advice.without.items()},
        "settings": {
            "forces_n": {str(r): force for r, force in advice.forces.items()},
            "force_tolerance": advice.tolerance,
            "mass_ratios": [one.mass_ratio for one in advice.maps],
            "members": advice.members,
            "sweeps": advice.sweeps,
            "places": len(advice.places),
            "modes": advice.places.model.modes,
            "limit_level_m": advice.limit_level,
            "limits": {
                name: value
                for name, value in (
                    ("stroke_m", advice.limits.stroke),
                    ("impact_speed_m_s", advice.limits.impact_speed),
                    ("yield_stress_pa", getattr(advice.study.yield_limit, "yield_stress", None)),
                )
                if value is not None
            },
            "level": "larger of sweep up and sweep down; relative: of the worst resonance over no "
            "absorber; median, and the interval that holds 90 % "
            "of further runs",
        },
    }


def map_table(advice: PlaceAdvice) -> Table:
    """Return a row for each mass and place: what the linear structure says."""
    reaches = [f"reach_{r}" for r in advice.forces]
    gaps = [f"rule_gap_{r}_m" for r in advice.forces]
    more = ("expected_gap_m", "expected_relative_level", "relative_limit")
    points = advice.places.points
    rows = []
    for one in advice.maps:
        for k, name in enumerate(advice.places.names):
            point: Sequence[float] = (math.nan,) * 3 if points is None else points[k].tolist()
            values = (*point, one.mass_ratio, *one.reach[:, k], *one.rule[:, k])
            values = (*values, one.gap[k], one.share[k], one.limit[k])
            rows.append((name, *map(float, values)))
    keys = ("place", "x_m", "y_m", "z_m", "mass_ratio", *reaches, *gaps, *more)
    return Table.of_values(keys, rows)


@dataclass(frozen=True)
class PlaceService:
    """Service loads of a recommended device, and baselines.

    ``impacts``: its impacts near its worst resonance. ``baselines``: other absorbers by resonance.
    """

    impacts: ImpactLoads
    baselines: Mapping[int, Baselines]
    contact: tuple[str, str, float] | None = None


def make_report(
    advice: PlaceAdvice,
    curves: Sequence[ResonanceCurves] = (),
    service: PlaceService | None = None,
) -> Report:
    """Return the content of the result.

    Without ``service`` there is no card. ``curves``: levels over the frequency.
    """
    where = " and ".join(
        f"{format_number(force)} N near resonance {r}" for r, force in advice.forces.items()
    )
    groups: tuple[Group, ...] = ()
    charts: tuple[Chart, ...] = ()
    own = warnings(advice)
    reached: list[str] = []
    if service is not None and advice.recommended is not None:
        groups, reached = card_groups(advice, advice.recommended, service)
        charts = (*frequency_charts(curves), *_place_charts(advice, advice.recommended))
    lines = answer(advice)
    notes = [*(f"Warning: {line}." for line in own), sweeps_line(advice)]
    return Report(
        title=f"Place, mass and gap of an impact absorber for {where}",
        verdict=lines[0],
        text=[lines, [device_table(advice)], notes],
        numbers=summary(advice),
        tables={"places.csv": map_table(advice), **frequency_tables(curves)},
        figures={"places.png": partial(draw_places, advice), **frequency_figures(curves)},
        groups=groups,
        charts=charts,
        warnings=(*own, *reached),
        prints_card=True,
    )


def card_groups(
    advice: PlaceAdvice, best: PlacedDevice, service: PlaceService
) -> tuple[tuple[Group, ...], list[str]]:
    """Return the card's groups about the recommended device, and warnings.

    There is a warning if its impacts excite modes that the model lacks.
    """
    model = advice.places.model_at(best.place)
    impacts = service.impacts
    contact = service.contact
    groups: list[Group] = [
        (
            "Device",
            (
                Row("place", advice.places.word(best.place)),
                *device_rows(best.absorber, model),
                Row(
                    f"gaps that leave at most {FLAT:g} times the level",
                    f"{MM * best.gaps[0]:.4g} to {MM * best.gaps[1]:.4g} mm",
                ),
            ),
        )
    ]
    for part in best.parts:
        name = f"Response level, {part.force:g} N near resonance {part.resonance}"
        groups.append(
            (
                name,
                (
                    Row(f"median of {_runs(best.members)}", MM * part.level, "mm RMS"),
                    Row("90 % of further runs", _interval(part.interval, MM, " mm")),
                    Row("read at", part.frequency_ratio, "of the resonance"),
                    Row(
                        f"at most, {100 * advice.tolerance:g} % more or less force",
                        MM * part.worst,
                        "mm",
                    ),
                    Row("of no absorber", 100 * part.share, "%"),
                    Row("no absorber", MM * part.without, "mm"),
                    *baseline_rows(service.baselines[part.resonance]),
                    Row(NO_DEVICE, MM * part.limit, "mm"),
                ),
            )
        )
    by_place = [
        Row(
            f"{advice.places.word(one.place)}, {100 * one.mass_ratio:.4g} %, {MM * one.gap:.4g} mm",
            f"{100 * one.share:.3g} % ({_interval(one.interval, 100, ' %')})",
        )
        for one in advice.devices
    ]
    worst = max(best.parts, key=lambda part: part.share)
    mass = best.mass_ratio * model.beam_mass
    touch, reached = (
        ((), []) if contact is None else contact_rows(model, mass, impacts.largest, contact)
    )
    groups += [
        ("Places and masses that were searched, level over no absorber", tuple(by_place)),
        (
            f"What it bears near resonance {worst.resonance}",
            service_rows(best.gap, impacts, worst.level),
        ),
        *(((CONTACT_HEADING, touch),) if touch else ()),
        (
            "Assumptions",
            (
                *assumed_rows(model, list(advice.forces), None),
                *(
                    Row(
                        f"swept near resonance {part.resonance}",
                        (
                            f"{part.sweep_range[0]:.3g} to {part.sweep_range[1]:.3g} of it, "
                            f"{part.rate:.3g} % per 100 pseudo periods"
                        ),
                    )
                    for part in best.parts
                ),
                Row("sweeps taken", str(advice.sweeps)),
            ),
        ),
    ]
    return tuple(groups), reached


def _place_charts(advice: PlaceAdvice, best: PlacedDevice) -> tuple[Chart, ...]:
    """Return reach and expected level over the place; none where places have no order."""
    if not isinstance(advice.places.structure, Beam):
        return ()
    x = [float(name) for name in advice.places.names]
    own = advice.map_of(best)
    marks = (("recommended", float(best.name)),)
    reaches = tuple(
        Curve(f"resonance {r}", x, numbers(own.reach[k])) for k, r in enumerate(advice.forces)
    )
    shares = tuple(
        Curve(f"mass {100 * one.mass_ratio:.4g} %", x, numbers(100 * one.share))
        for one in advice.maps
    )
    place = "place over the length"
    return (
        Chart("Reach", place, "free amplitude over the rule's gap", reaches, marks),
        Chart("Level to expect, no simulation", place, "% of no absorber", shares, marks),
    )


def draw_places(advice: PlaceAdvice) -> Figure:
    """Draw the structure coloured by reach, and the expected and simulated levels below.

    Each resonance has a panel.

    A beam is drawn by its mode shapes, nodes with coordinates at their points, places without as
    bars.
    """
    best = advice.recommended
    own = advice.maps[-1] if best is None else advice.map_of(best)
    count = len(advice.forces)
    number_of_rows = count + 1
    figure, panels = figure_of(8.6, 2.5 * count + 3.4, number_of_rows, 1)
    panels = np.ravel(panels)
    for k, resonance in enumerate(advice.forces):
        _draw_reach(figure, panels[k], advice, own, k, resonance)
    _draw_levels(panels[-1], advice)
    return figure


def _draw_reach(
    figure: Any, axes: Any, advice: PlaceAdvice, own: PlaceMap, k: int, resonance: int
) -> None:
    places = advice.places
    reach = np.where(np.isfinite(own.reach[k]), own.reach[k], 0.0)
    hertz = places.model.resonance_omega(resonance) / (2 * np.pi)
    words = (
        f"resonance {resonance}, {hertz:.4g} Hz; absorber of {100 * own.mass_ratio:.4g} % of the "
        "structure's mass"
    )
    axes.set_title(words, fontsize=10, loc="left")
    if isinstance(places.structure, Beam):
        drawn = _draw_beam(axes, places, reach, resonance)
    elif places.points is not None:
        drawn = _draw_nodes(axes, places, reach)
    else:
        _draw_bars(axes, places, reach)
        return
    best = advice.recommended
    if best is not None:
        x, y = _point_of(places, best.place, resonance)
        axes.plot([x], [y], "s", ms=12, mfc="none", mec="black", mew=1.8, label="recommended")
    axes.legend(fontsize=8, loc="best", framealpha=0.9)
    figure.colorbar(drawn, ax=axes, label="reach: free amplitude\nover the rule's gap")


def _draw_beam(axes: Any, places: Places, reach: Array, resonance: int) -> Any:
    """Draw a beam's mode shape, coloured by reach, with force and level."""
    from matplotlib.collections import LineCollection

    beam = places.structure
    assert isinstance(beam, Beam)
    x = np.linspace(0, 1, FINE)
    shape = mode_shapes(beam, x)[:, resonance - 1]
    scale = float(np.max(np.abs(shape))) or 1.0
    shape = shape / scale
    at = np.array([float(name) for name in places.names])
    colour = np.interp(x, at, reach)
    points = np.column_stack([x, shape])
    segments = np.stack([points[:-1], points[1:]], axis=1)
    drawn = LineCollection(segments.tolist(), cmap="viridis", linewidths=7, capstyle="round")
    drawn.set_array((colour[1:] + colour[:-1]) / 2)
    axes.axhline(0, color="0.8", lw=0.8)
    axes.add_collection(drawn)
    level = beam.absorber_position if beam.response_position is None else beam.response_position
    for place, mark, tint, name in (
        (beam.force_position, "v", ORANGE, "force"),
        (level, "o", "#F0E442", "level"),
    ):
        y = float(np.interp(place, x, shape))
        axes.plot([place], [y], mark, color=tint, mec="black", ms=9, label=name)
    axes.set(xlim=(-0.03, 1.03), ylim=(-1.35, 1.35))
    axes.set_xlabel("place over the length")
    axes.set_ylabel("mode shape")
    return drawn


def _point_of(places: Places, k: int, resonance: int) -> tuple[float, float]:
    """Return where a place is drawn."""
    if isinstance(places.structure, Beam):
        x = float(places.names[k])
        shape = mode_shapes(places.structure, np.linspace(0, 1, FINE))[:, resonance - 1]
        scale = float(np.max(np.abs(shape))) or 1.0
        return x, float(mode_shapes(places.structure, [x])[0, resonance - 1]) / scale
    assert places.points is not None
    first, second = _widest_axes(places.points)
    return float(places.points[k, first]), float(places.points[k, second])


def place_with(places: Places, shape: Array) -> int | None:
    """Return the index of the place with given mode shapes (N_m,).

    The result is None if no place moves in this way, for example because the shapes are in another
    direction.
    """
    distance = np.linalg.norm(places.shapes - shape, axis=1)
    k = int(np.argmin(distance))
    return k if distance[k] <= SHAPE_TOL * np.linalg.norm(shape) else None


def _widest_axes(points: Array) -> tuple[int, int]:
    """Return the two axes over which points extend furthest, in their order."""
    extent = np.ptp(points, axis=0)
    first, second = sorted(np.argsort(-extent, kind="stable")[:2].tolist())
    return first, second


def _draw_nodes(axes: Any, places: Places, reach: Array) -> Any:
    """Draw places at their coordinates, coloured by reach.

    They are drawn in the plane of the two axes with the largest extent.
    """
    assert places.points is not None
    first, second = _widest_axes(places.points)
    order = np.argsort(reach, kind="stable")
    x = places.points[order, first]
    y = places.points[order, second]
    drawn = axes.scatter(x, y, c=reach[order], cmap="viridis", s=36, edgecolor="0.3", lw=0.3)
    for shape, mark, tint, name in (
        (places.model.one_phase_force_shape, "v", ORANGE, "force"),
        (places.model.level_shape, "o", "#F0E442", "level"),
    ):
        k = place_with(places, shape)
        if k is not None:
            at = places.points[k]
            axes.plot(at[first], at[second], mark, color=tint, mec="black", ms=9, ls="", label=name)
    axes.set_xlabel(f"{'xyz'[first]} in m")
    axes.set_ylabel(f"{'xyz'[second]} in m")
    if np.ptp(places.points[:, second]) > 0:
        axes.set_aspect("equal", adjustable="datalim")
    return drawn


def _draw_bars(axes: Any, places: Places, reach: Array) -> None:
    """Draw a bar for each place, the highest of them where there are too many."""
    largest = np.sort(np.argsort(-reach, kind="stable")[:MOST_BARS])
    axes.bar(np.arange(len(largest)), reach[largest], color=BLUE)
    axes.set_xticks(np.arange(len(largest)), [places.names[k] for k in largest], fontsize=8)
    if len(largest) > 12:
        axes.tick_params(axis="x", rotation=90)
    axes.set_xlabel(places.kind)
    axes.set_ylabel("reach")
    draw_grid(axes)


def _draw_levels(axes: Any, advice: PlaceAdvice) -> None:
    """Draw the expected level of each place and mass, and the simulated levels.

    The simulated levels have their intervals.
    """
    beam = isinstance(advice.places.structure, Beam)
    chosen = sorted(
        {trial.place for trial in advice.trials} | {one.place for one in advice.devices}
    )
    position = (
        {k: float(name) for k, name in enumerate(advice.places.names)}
        if beam
        else {place: float(k) for k, place in enumerate(chosen)}
    )
    colours = (BLUE, GREEN, ORANGE, "#CC79A7", "#56B4E9", GREY)
    for k, one in enumerate(advice.maps):
        colour = colours[k % len(colours)]
        name = f"{100 * one.mass_ratio:.4g} % of the mass"
        if beam:
            x = [position[place] for place in range(len(advice.places))]
            axes.plot(x, 100 * one.share, color=colour, lw=1.5, label=f"{name}, to expect")
        else:
            expected = [100 * float(one.share[place]) for place in chosen]
            axes.plot(
                range(len(chosen)), expected, "_", color=colour, ms=16, label=f"{name}, to expect"
            )
        trials = [trial for trial in advice.trials if trial.mass_ratio == one.mass_ratio]
        axes.plot(
            [position[trial.place] for trial in trials],
            [100 * trial.share for trial in trials],
            "o",
            mfc="white",
            mec=colour,
            ms=5,
            ls="",
        )
        for device in advice.devices:
            if device.mass_ratio != one.mass_ratio:
                continue
            ends = device.interval
            share = 100 * device.share
            spread = (
                [[0.0], [0.0]]
                if math.isnan(ends[0])
                else [[max(share - 100 * ends[0], 0)], [max(100 * ends[1] - share, 0)]]
            )
            axes.errorbar(
                [position[device.place]], [share], spread, fmt="s", color=colour, ms=6, capsize=4
            )
    axes.plot(
        [], [], "o", mfc="white", mec="black", ms=5, ls="", label="one run, best of three gaps"
    )
    axes.plot([], [], "s", color="black", ms=6, ls="", label="gap searched, 90 % of further runs")
    if beam:
        axes.set_xlabel("place over the length")
        axes.set_xlim(-0.03, 1.03)
    else:
        axes.set_xticks(range(len(chosen)), [advice.places.names[place] for place in chosen])
        axes.set_xlabel(f"{advice.places.kind}, the simulated ones")
    axes.set_ylabel("level, % of no absorber")
    axes.set_ylim(0, 105)
    stopped = "" if advice.complete else " (stopped early)"
    which = "Larger level of the resonances" if len(advice.forces) > 1 else "Level"
    axes.set_title(f"{which}{stopped}", fontsize=10, loc="left")
    draw_grid(axes)
    axes.legend(fontsize=8, ncols=2, framealpha=0.9)
