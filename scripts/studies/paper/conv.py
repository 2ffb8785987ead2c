"""Compliant contact against rigid (paper, appendix A, its figure conv): walls over their stiffness, and friction over that of its spring."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from impact_env.curve import BAND, CurveCase, PerformanceCurve, quantiles
from impact_env.methods import Exact, Method, RungeKutta
from impact_env.parameters import Absorber, Beam, CompliantWalls, SlidingAbsorber, friction_damper, impact_absorber
from impact_env.scene import Scene, beam_scene
from studies.paper.claim import LITTLE, SAME, Claim, Verdict, judged, middle, spread
from studies.paper.frame import PaperFigure, Settings, has, in_turn, shortened
from studies.paper.style import FAINT, LOOKS, MM, REFERENCE, legends, line, panels
from studies.study import Json, Steps, Table

LABEL = "conv"
BEAM = Beam(modes=3)
FORCE, DAMPER = 4.0, 0.5  # N: the paper's force, and the limit of its friction damper
WALLS, FRICTION = "walls", "friction"
LOW, HIGH = 3.0, 300.0  # stiffnesses of the performance curves, over the beam's static stiffness
STEPPED = 1e4  # stiffest contact that the paper's own method is tried with: its step follows the contact's duration


def absorber(kind: str, stiffness: float | None) -> Absorber:
    """Return the impact absorber, frictionless and conservative, or the friction damper; ``stiffness`` over the beam's, None: rigid."""
    spring = None if stiffness is None else stiffness * BEAM.static_tip_stiffness
    if kind == FRICTION:
        return friction_damper(DAMPER, friction_stiffness=spring)
    rigid = impact_absorber()
    return rigid if spring is None else SlidingAbsorber(rigid.mass_ratio, CompliantWalls(spring))


class Sizes(NamedTuple):
    """Members, stiffnesses over the beam's static one, and forces (N) of the curves with walls and with friction."""

    members: int
    stiffnesses: tuple[float, ...]
    walls: tuple[float, ...]
    friction: tuple[float, ...]


def sizes(members: int, stiffnesses: int, forces: int) -> Sizes:
    """Return the sizes of so many; forces are closer together where the curve with walls is flat."""
    walls, friction = (np.asarray(spaced(0.5, 6.0, forces)).round(3).tolist() for spaced in (np.geomspace, np.linspace))
    return Sizes(members, np.geomspace(0.1, 1e5, stiffnesses).round(4).tolist(), walls, friction)


def _scene(kind: str, stiffness: float | None) -> Scene:
    return beam_scene(BEAM, absorber(kind, stiffness))


def _kept(curve: PerformanceCurve) -> Json:
    """Return the levels of a curve in m, (forces, members), the paper's own run first."""
    return {"force_n": curve.forces.tolist(), "level_m": [[float(f"{x:.6g}") for x in row] for row in curve.combined]}


def _over_stiffness(settings: Settings, size: Sizes, kind: str, method: Method) -> Json:
    """Return the levels at the paper's force for each stiffness, and those of the rigid law."""
    stepped = not isinstance(method, Exact)
    chosen = [k for k in size.stiffnesses if not stepped or k <= STEPPED]
    members = min(size.members, 4) if stepped else size.members
    names: list[float | None] = [*chosen, *(() if stepped else (None,))]
    cases = [CurveCase(_scene(kind, stiffness), np.array([FORCE])) for stiffness in names]
    curves = settings.curves(f"{LABEL}: {kind}", cases, members, method)
    levels = [_kept(curve)["level_m"][0] for curve in curves]
    return {"stiffness": chosen, "level_m": levels[: len(chosen)], "rigid_m": None if stepped else levels[-1]}


def _curves(settings: Settings, size: Sizes, kind: str) -> Json:
    """Return performance curves with rigid, stiff and soft contact, and without absorber."""
    force = np.array(size.walls if kind == WALLS else size.friction)
    named = {"rigid": None, "low": LOW, "high": HIGH}
    cases = [CurveCase(_scene(kind, stiffness), force) for stiffness in named.values()] + [CurveCase(beam_scene(BEAM), force)]
    found = settings.curves(f"{LABEL}: curves, {kind}", cases, size.members)
    return dict(zip([*named, "none"], map(_kept, found), strict=True))


def _measure(settings: Settings, size: Sizes, known: Json) -> Steps:
    groups: dict[str, Callable[[], Any]] = {}
    for kind in (WALLS, FRICTION):
        groups[kind] = partial(_over_stiffness, settings, size, kind, Exact())
        groups[f"{kind}, paper's method"] = partial(_over_stiffness, settings, size, kind, RungeKutta())
        groups[f"{kind}, curves"] = partial(_curves, settings, size, kind)
    return in_turn(groups, known)


def _table(values: Json) -> Table:
    """Return a row for each stiffness and one for rigid contact: levels of walls and of the damper, and those over rigid contact."""
    columns, rows = ["stiffness over 3EI/l^3"], [[f"{k:.3g}"] for k in values[WALLS]["stiffness"]] + [["rigid"]]
    for kind, said in ((WALLS, "walls, k_n"), (FRICTION, "friction, k_t")):
        columns += [f"{said}: level at {FORCE:g} N, mm", "over rigid"]
        for row, level in zip(rows, [*values[kind]["level_m"], values[kind]["rigid_m"]], strict=True):
            row += [spread(level, "{:.3f}", 1e3), f"{np.median(level) / np.median(values[kind]['rigid_m']):.3f}"]
    return Table(f"{LABEL}_stiffness", columns, rows)


def _long(values: Json) -> list[Table]:
    return [_table(values)] if WALLS in values and FRICTION in values else []


ROWS = (("walls", "k_n", "impact absorber"), ("friction", "k_t", "friction damper"))


def _draw(values: Json) -> Figure:
    """Draw the walls above, friction below."""
    figure, axes = panels(2, 2, 5.6)
    for (left, right), (kind, symbol, title) in zip(axes, ROWS, strict=True):
        _stiffness(left, values[kind], values[f"{kind}, paper's method"])
        left.set(xscale="log", xlabel=f"${symbol}/k_\\mathrm{{eff}}$", ylabel="level over that of rigid contact")
        left.set_title(title)
        named = {"rigid": "rigid", "low": f"${symbol} = {LOW:g}\\,k_\\mathrm{{eff}}$"}
        named["high"] = f"${symbol} = {HIGH:g}\\,k_\\mathrm{{eff}}$"
        _draw_curves(right, values[f"{kind}, curves"], named)
        right.set(xlabel="force in N", ylabel="response level in mm")
        right.set_title(title)
    legends(axes)
    return figure


def _edges(levels: Any) -> tuple[Any, Any, Any, Any]:
    rows = np.array(levels, dtype=float)
    low, middle, high = quantiles(rows, (BAND[0], 0.5, BAND[1]))
    return low, middle, high, rows[:, 0]


def _stiffness(axes: Axes, part: Json, stepped: Json) -> None:
    unit = float(np.median(part["rigid_m"]))
    low, high = (x / unit for x in quantiles(np.array(part["rigid_m"]), BAND))
    axes.axhspan(float(low), float(high), color=FAINT, alpha=0.3, lw=0, label="rigid, 5 to 95 %")
    below, middle, above, own = (x / unit for x in _edges(part["level_m"]))
    line(axes, part["stiffness"], middle, LOOKS[0], "compliant, exact", band=(below, above), nominal=own)
    middle = _edges(stepped["level_m"])[1] / unit
    axes.plot(stepped["stiffness"], middle, LOOKS[1].marker, color=LOOKS[1].colour, mfc="none", label="Runge-Kutta, paper's step")


def _draw_curves(axes: Axes, curves: Json, named: dict[str, str]) -> None:
    alone = curves["none"]
    axes.plot(alone["force_n"], MM * np.median(alone["level_m"], axis=1), color=REFERENCE.colour, ls=REFERENCE.dashes, lw=1.0, label="no absorber")
    for look, (name, label) in zip(LOOKS, named.items(), strict=False):
        below, middle, above, own = (MM * x for x in _edges(curves[name]["level_m"]))
        line(axes, curves[name]["force_n"], middle, look, label, band=(below, above), nominal=own)


SECTION = "A"
STIFF = 1e3  # over the beam's static stiffness: from here on contact counts as nearly rigid
WORDS = {"walls": "k_n of the walls", "friction": "k_t of the friction damper"}


def _off(part: Json) -> tuple[np.ndarray, np.ndarray]:
    """Return stiffnesses, and by which share the median level differs from that of rigid contact."""
    return np.array(part["stiffness"]), np.median(part["level_m"], axis=1) / np.median(part["rigid_m"]) - 1


def _from(part: Json, share: float) -> float:
    """Return the least stiffness from which on the median differs by no more than a share."""
    stiffness, off = _off(part)
    outside = np.flatnonzero(np.abs(off) > share)
    first = int(outside[-1]) + 1 if len(outside) else 0
    return float(stiffness[min(first, len(stiffness) - 1)])


def _converges(part: Json, kind: str) -> Claim:
    stiffness, off = _off(part)
    worst = float(np.max(np.abs(off[stiffness >= STIFF])))
    low, high = middle(part["rigid_m"])
    width = (high - low) / (2 * float(np.median(part["rigid_m"])))
    return Claim(
        f"convergence, {kind}", f"with growing {WORDS[kind]} the level at 4 N approaches that of rigid contact", SECTION,
        f"median within {100 * worst:.1f} % of it from {STIFF:g} static stiffnesses on, {100 * off[0]:+.0f} % at {stiffness[0]:g}; half the band of "
        f"rigid members {100 * width:.1f} %", judged(worst, worst, 0.0, max(SAME, width)), LABEL,
        "The medians of compliant contact keep away from that of rigid contact by more than the members of either scatter.",
    )  # fmt: skip


def _alike(values: Json) -> Claim:
    walls, friction = (_from(values[kind], SAME) for kind in ("walls", "friction"))
    apart = abs(float(np.log10(walls / friction)))
    return Claim("alike", "both converge very similarly", SECTION,
                 f"within 5 % from {walls:.3g} static stiffnesses on for the walls, from {friction:.3g} on for friction",
                 judged(apart, apart, 0.0, float(np.log10(1 + LITTLE))), LABEL,
                 "One needs a stiffer spring than the other for the same closeness.")  # fmt: skip


def _curves_claims(curves: Json, kind: str) -> Claim:
    rigid, low, high = (np.array(curves[name]["level_m"]) for name in ("rigid", "low", "high"))
    force = np.array(curves["rigid"]["force_n"])
    off = {name: np.abs(np.median(own, axis=1) / np.median(rigid, axis=1) - 1) for name, own in (("low", low), ("high", high))}
    inside = _overlap(high, rigid)
    worst = int(np.argmax(off["high"]))
    symbol, _, device = WORDS[kind].partition(" of the ")
    close = off["high"][worst] < SAME
    return Claim(
        f"curves, {kind}", f"with stiff {symbol} ({device}) the curve is that of rigid contact at all forces", SECTION,
        f"medians differ by {100 * np.median(off['high']):.1f} % in the median and {100 * off['high'][worst]:.0f} % at most, at "
        f"{force[worst]:.2g} N; bands overlap at {100 * np.mean(inside):.0f} % of {len(force)} forces; "
        f"with the soft one medians differ by {100 * np.median(off['low']):.0f} and {100 * np.max(off['low']):.0f} %",
        Verdict.HOLDS if close else Verdict.SPREAD if inside.mean() > 0.9 else Verdict.NOT, LABEL,
        f"At {force[worst]:.2g} N members fall into two groups, those that reach the high branch and those that do not, and the median of either "
        "contact lies in one or the other: bands overlap, medians do not agree.",
    )  # fmt: skip


def _overlap(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    (a, b), (c, d) = (quantiles(levels, BAND) for levels in (one, other))
    slack = 0.01 * np.median(other, axis=1)  # where members hardly differ, a per cent is none
    return (a <= d + slack) & (c <= b + slack)


def _optimum(curves: Json) -> Claim:
    best = {}
    for name in ("rigid", "low", "high"):
        relative = np.array(curves[name]["level_m"]) / np.array(curves["none"]["level_m"])
        best[name] = np.array(curves[name]["force_n"])[np.argmin(relative, axis=0)]
    (a, b), (c, d) = middle(best["high"]), middle(best["rigid"])
    return Claim(
        "same optimum", "what was found with rigid contact holds for slightly compliant contact", SECTION,
        f"best force of a member {spread(best['high'], '{:.2f}')} N with stiff, {spread(best['rigid'], '{:.2f}')} N with rigid, "
        f"{spread(best['low'], '{:.2f}')} N with soft walls",
        Verdict.HOLDS if abs(np.median(best["high"]) / np.median(best["rigid"]) - 1) < SAME else Verdict.SPREAD if a <= d and c <= b else Verdict.NOT,
        LABEL, "The best force of stiff walls differs from that of rigid ones by more than 5 % in the median.",
    )  # fmt: skip


def _steps(values: Json) -> Claim:
    apart = []
    for kind in ("walls", "friction"):
        exact, stepped = values[kind], values[f"{kind}, paper's method"]
        n = len(stepped["stiffness"])
        apart += (np.median(stepped["level_m"], axis=1) / np.median(exact["level_m"][:n], axis=1) - 1).tolist()
    worst = float(np.max(np.abs(apart)))
    return Claim("twenty samples", "20 samples of the shortest period and of a contact resolve compliant contact", SECTION,
                 f"medians of the Runge-Kutta method at that step differ from exact ones by {100 * np.median(np.abs(apart)):.1f} % in the median and "
                 f"{100 * worst:.1f} % at most", judged(worst, worst, 0.0, SAME), LABEL,
                 "The few members of the stepped runs fall on either side of the exact median.")  # fmt: skip


def _claims(values: Json) -> list[Claim]:
    each = (*(_converges(values[kind], kind) for kind in WORDS), _alike(values), *(_curves_claims(values[f"{kind}, curves"], kind) for kind in WORDS))
    return [*each, _optimum(values["walls, curves"]), _steps(values)]


FIGURE = PaperFigure(
    LABEL, "compliant contact", sizes=(sizes(24, 22, 24), sizes(3, 8, 8)), measure=_measure, tables=_long, draw=_draw, claims=_claims,
    words=lambda values: "\n\n".join(map(shortened, _long(values))),
    needs=has(*(f"{kind}{part}" for kind in (WALLS, FRICTION) for part in ("", ", paper's method", ", curves"))),
)  # fmt: skip
