"""Compliant contact against rigid contact (paper, appendix A, its figure conv).

Walls are compared over their stiffness, and friction over that of its spring.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from impact_env.curve import BAND, CurveCase, PerformanceCurve, quantiles
from impact_env.methods import Exact, Method, RungeKutta
from impact_env.parameters import (
    Absorber,
    Beam,
    CompliantWalls,
    SlidingAbsorber,
    friction_damper,
    impact_absorber,
)
from impact_env.scene import beam_scene
from studies.paper.claim import (
    LITTLE,
    SAME,
    Claim,
    ClaimVerdict,
    compute_band,
    format_spread,
    make_claim,
)
from studies.paper.frame import (
    FAINT,
    MM,
    REFERENCE,
    STYLES,
    PaperFigure,
    PaperSettings,
    Size,
    draw_band,
    draw_legends,
    draw_signal,
    make_panels,
    measure_groups,
    shorten_table,
)
from studies.study import CsvTable, Json, Steps

LABEL = "conv"
BEAM = Beam(modes=3)
# N: the paper's force, and the limit of its friction damper
FORCE = 4.0
DAMPER = 0.5
WALLS = "walls"
FRICTION = "friction"
CONTACTS = ((WALLS, "k_n", "walls"), (FRICTION, "k_t", "friction damper"))
# stiffnesses of the performance curves, over the beam's static stiffness
LOW = 3.0
HIGH = 300.0
judge = partial(make_claim, LABEL)
# stiffest contact that the paper's own method is tried with: its step follows the contact's
# duration
STEPPED = 1e4


def absorber(kind: str, stiffness: float | None) -> Absorber:
    """Return the impact absorber, frictionless and conservative, or the friction damper.

    ``stiffness`` is relative to that of the beam. None stands for rigid contact.
    """
    spring = None if stiffness is None else stiffness * BEAM.static_tip_stiffness
    if kind == FRICTION:
        return friction_damper(DAMPER, friction_stiffness=spring)
    rigid = impact_absorber()
    return rigid if spring is None else SlidingAbsorber(rigid.mass_ratio, CompliantWalls(spring))


def sizes(members: int, stiffnesses: int, forces: int) -> Size:
    """Return the sizes of a figure with given numbers of stiffnesses and forces.

    Stiffnesses are relative to the beam's static one. The forces of the curves are closer where the
    curve with walls is flat.
    """
    walls, friction = (
        np.asarray(spaced(0.5, 6.0, forces)).round(3).tolist()
        for spaced in (np.geomspace, np.linspace)
    )
    return Size(
        members=members,
        stiffnesses=np.geomspace(0.1, 1e5, stiffnesses).round(4).tolist(),
        walls=walls,
        friction=friction,
    )


def _levels_to_json(curve: PerformanceCurve) -> Json:
    """Return the levels of a curve in m, (forces, members), the paper's own run first."""
    return {
        "force_n": curve.forces.tolist(),
        "level_m": [[float(f"{x:.6g}") for x in row] for row in curve.combined],
    }


def _over_stiffness(settings: PaperSettings, size: Size, kind: str, method: Method) -> Json:
    """Return the levels at the paper's force for each stiffness, and those of the rigid law."""
    stepped = not isinstance(method, Exact)
    chosen = [k for k in size.stiffnesses if not stepped or k <= STEPPED]
    members, rigid = (min(size.members, 4), ()) if stepped else (size.members, (None,))
    cases = [
        CurveCase(beam_scene(BEAM, absorber(kind, stiffness)), np.array([FORCE]))
        for stiffness in (*chosen, *rigid)
    ]
    levels = [
        _levels_to_json(curve)["level_m"][0]
        for curve in settings.curves(f"{LABEL}: {kind}", cases, members, method)
    ]
    return {
        "stiffness": chosen,
        "level_m": levels[: len(chosen)],
        "rigid_m": None if stepped else levels[-1],
    }


def _curves(settings: PaperSettings, size: Size, kind: str) -> Json:
    """Return performance curves with rigid, stiff and soft contact, and without absorber."""
    force = np.array(size.walls if kind == WALLS else size.friction)
    absorbers = {
        name: absorber(kind, stiffness)
        for name, stiffness in {"rigid": None, "low": LOW, "high": HIGH}.items()
    } | {"none": None}
    cases = [CurveCase(beam_scene(BEAM, own), force) for own in absorbers.values()]
    result = settings.curves(f"{LABEL}: curves, {kind}", cases, size.members)
    return dict(zip(absorbers, map(_levels_to_json, result), strict=True))


def _measure(settings: PaperSettings, size: Size, earlier: Json) -> Steps:
    groups: dict[str, Callable[[], Any]] = {}
    for kind in (WALLS, FRICTION):
        groups[kind] = partial(_over_stiffness, settings, size, kind, Exact())
        groups[f"{kind}, paper's method"] = partial(
            _over_stiffness, settings, size, kind, RungeKutta()
        )
        groups[f"{kind}, curves"] = partial(_curves, settings, size, kind)
    return measure_groups(groups, earlier)


def _table(values: Json) -> CsvTable:
    """Return a row for each stiffness and one for rigid contact.

    A row has the levels of the walls and of the damper, and their ratios to those of rigid contact.
    """
    columns = ["stiffness over 3EI/l^3"]
    rows = [[f"{k:.3g}"] for k in values[WALLS]["stiffness"]] + [["rigid"]]
    for kind, symbol, _ in CONTACTS:
        columns += [f"{kind}, {symbol}: level at {FORCE:g} N, mm", "over rigid"]
        for row, level in zip(
            rows, [*values[kind]["level_m"], values[kind]["rigid_m"]], strict=True
        ):
            row += [
                format_spread(level, "{:.3f}", 1e3),
                f"{np.median(level) / np.median(values[kind]['rigid_m']):.3f}",
            ]
    return CsvTable(f"{LABEL}_stiffness", columns, rows)


def _draw(values: Json) -> Figure:
    """Draw the walls above, friction below."""
    figure, axes = make_panels(2, 2, 5.6)
    for (left, right), (kind, symbol, _), title in zip(
        axes, CONTACTS, ("impact absorber", "friction damper"), strict=True
    ):
        _stiffness(left, values[kind], values[f"{kind}, paper's method"])
        left.set(
            xscale="log",
            xlabel=f"${symbol}/k_\\mathrm{{eff}}$",
            ylabel="level over that of rigid contact",
        )
        named = {"rigid": "rigid"} | {
            name: f"${symbol} = {k:g}\\,k_\\mathrm{{eff}}$"
            for name, k in (("low", LOW), ("high", HIGH))
        }
        curves = values[f"{kind}, curves"]
        draw_signal(
            right,
            curves["none"]["force_n"],
            MM * np.median(curves["none"]["level_m"], axis=1),
            REFERENCE,
            "no absorber",
            1.0,
        )
        for style, (name, label) in zip(STYLES, named.items(), strict=False):
            draw_band(
                right, curves[name]["force_n"], MM * np.array(curves[name]["level_m"]), style, label
            )
        right.set(xlabel="force in N", ylabel="response level in mm")
        left.set_title(title)
        right.set_title(title)
    draw_legends(axes)
    return figure


def _stiffness(axes: Axes, part: Json, stepped: Json) -> None:
    unit = float(np.median(part["rigid_m"]))
    low, high = compute_band(np.array(part["rigid_m"]) / unit)
    axes.axhspan(low, high, color=FAINT, alpha=0.3, lw=0, label="rigid, 5 to 95 %")
    draw_band(
        axes, part["stiffness"], np.array(part["level_m"]) / unit, STYLES[0], "compliant, exact"
    )
    middles = np.median(stepped["level_m"], axis=1) / unit
    axes.plot(
        stepped["stiffness"],
        middles,
        STYLES[1].marker,
        color=STYLES[1].colour,
        mfc="none",
        label="Runge-Kutta, paper's step",
    )


STIFF = 1e3  # over the beam's static stiffness: from here on contact counts as nearly rigid


def _off(part: Json) -> tuple[np.ndarray, np.ndarray]:
    """Return stiffnesses, and the relative error of the median level.

    The error is the relative difference to the level of rigid contact.
    """
    return np.array(part["stiffness"]), np.median(part["level_m"], axis=1) / np.median(
        part["rigid_m"]
    ) - 1


def _from(part: Json, share: float) -> float:
    """Return the least stiffness from which on the median differs by no more than a share."""
    stiffness, off = _off(part)
    outside = np.flatnonzero(np.abs(off) > share)
    first = int(outside[-1]) + 1 if len(outside) else 0
    return float(stiffness[min(first, len(stiffness) - 1)])


def _converges(part: Json, text_values: Json) -> Claim:
    stiffness, off = _off(part)
    worst = float(np.max(np.abs(off[stiffness >= STIFF])))
    low, high = compute_band(part["rigid_m"])
    width = (high - low) / (2 * float(np.median(part["rigid_m"])))
    most = max(SAME, width)
    return judge(
        "convergence, {kind}",
        worst,
        (0.0, most),
        width=width,
        off=off[0],
        at=stiffness[0],
        stiff=STIFF,
        **text_values,
    )


def _curves_claims(curves: Json, text_values: Json) -> Claim:
    rigid, low, high = (np.array(curves[name]["level_m"]) for name in ("rigid", "low", "high"))
    force = np.array(curves["rigid"]["force_n"])
    soft, off = (
        np.abs(np.median(own, axis=1) / np.median(rigid, axis=1) - 1) for own in (low, high)
    )
    (a, b), (c, d) = (quantiles(levels, BAND) for levels in (high, rigid))
    slack = 0.01 * np.median(rigid, axis=1)  # where members hardly differ, a per cent is none
    inside = np.mean((a <= d + slack) & (c <= b + slack))
    worst = int(np.argmax(off))
    result = (
        ClaimVerdict.HOLDS
        if off[worst] < SAME
        else ClaimVerdict.SPREAD
        if inside > 0.9
        else ClaimVerdict.NOT
    )
    return judge(
        "curves, {kind}",
        result,
        median=np.median(off),
        most=off[worst],
        worst=force[worst],
        inside=inside,
        forces=len(force),
        soft=100 * np.median(soft),
        softest=np.max(soft),
        **text_values,
    )


def _claims(values: Json) -> list[Claim]:
    text_values = {
        kind: {"kind": kind, "symbol": symbol, "device": device}
        for kind, symbol, device in CONTACTS
    }
    walls, friction = (_from(values[kind], SAME) for kind in text_values)
    best = {}
    curves = values[f"{WALLS}, curves"]
    apart = []
    for name in ("rigid", "low", "high"):
        relative = np.array(curves[name]["level_m"]) / np.array(curves["none"]["level_m"])
        best[name] = np.array(curves[name]["force_n"])[np.argmin(relative, axis=0)]
    a, b = compute_band(best["high"])
    c, d = compute_band(best["rigid"])
    close = abs(np.median(best["high"]) / np.median(best["rigid"]) - 1) < SAME
    for kind in text_values:
        exact, stepped = (
            np.median(values[f"{kind}{by}"]["level_m"], axis=1) for by in ("", ", paper's method")
        )
        apart += np.abs(stepped / exact[: len(stepped)] - 1).tolist()
    return [
        *(_converges(values[kind], own) for kind, own in text_values.items()),
        judge(
            "alike",
            abs(float(np.log10(walls / friction))),
            (0.0, float(np.log10(1 + LITTLE))),
            walls=walls,
            friction=friction,
        ),
        *(_curves_claims(values[f"{kind}, curves"], own) for kind, own in text_values.items()),
        judge(
            "same optimum",
            ClaimVerdict.HOLDS
            if close
            else ClaimVerdict.SPREAD
            if a <= d and c <= b
            else ClaimVerdict.NOT,
            **best,
        ),
        judge("twenty samples", max(apart), median=np.median(apart)),
    ]


FIGURE = PaperFigure(
    LABEL,
    "compliant contact",
    sizes=(sizes(24, 22, 24), sizes(3, 8, 8)),
    measure=_measure,
    draw=_draw,
    claims=_claims,
    tables=lambda values: (_table(values),),
    describe=lambda values: shorten_table(_table(values)),
)
