"""What compliant contact says of the paper's appendix A."""

from __future__ import annotations

import numpy as np

from impact_env.curve import BAND, quantiles
from studies.paper.claim import Claim, Verdict, judged
from studies.paper.tolerances import LITTLE, SAME
from studies.paper.words import middle, spread
from studies.study import Json, Measured

FIGURE, SECTION = "conv", "A"
STIFF = 1e3  # over the beam's static stiffness: from here on contact counts as nearly rigid
WORDS = {"walls": "k_n of the walls", "friction": "k_t of the friction damper"}


def claims(measured: Measured) -> list[Claim]:
    """Return the statements that this figure decides."""
    values = measured.values
    return [
        _converges(values["walls"], "walls"),
        _converges(values["friction"], "friction"),
        _alike(values),
        _curves(values["walls, curves"], "walls"),
        _curves(values["friction, curves"], "friction"),
        _optimum(values["walls, curves"]),
        _steps(values),
    ]


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
        f"rigid members {100 * width:.1f} %", judged(worst, worst, 0.0, max(SAME, width)), FIGURE,
        "The medians of compliant contact keep away from that of rigid contact by more than the members of either scatter.",
    )  # fmt: skip


def _alike(values: Json) -> Claim:
    walls, friction = (_from(values[kind], SAME) for kind in ("walls", "friction"))
    apart = abs(float(np.log10(walls / friction)))
    return Claim(
        "alike", "both converge very similarly", SECTION,
        f"within 5 % from {walls:.3g} static stiffnesses on for the walls, from {friction:.3g} on for friction",
        judged(apart, apart, 0.0, float(np.log10(1 + LITTLE))), FIGURE,
        "One needs a stiffer spring than the other for the same closeness.",
    )  # fmt: skip


def _curves(curves: Json, kind: str) -> Claim:
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
        Verdict.HOLDS if close else Verdict.SPREAD if inside.mean() > 0.9 else Verdict.NOT, FIGURE,
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
        FIGURE, "The best force of stiff walls differs from that of rigid ones by more than 5 % in the median.",
    )  # fmt: skip


def _steps(values: Json) -> Claim:
    apart = []
    for kind in ("walls", "friction"):
        exact, stepped = values[kind], values[f"{kind}, paper's method"]
        n = len(stepped["stiffness"])
        apart += (np.median(stepped["level_m"], axis=1) / np.median(exact["level_m"][:n], axis=1) - 1).tolist()
    worst = float(np.max(np.abs(apart)))
    return Claim(
        "twenty samples", "20 samples of the shortest period and of a contact resolve compliant contact", SECTION,
        f"medians of the Runge-Kutta method at that step differ from exact ones by {100 * np.median(np.abs(apart)):.1f} % in the median and "
        f"{100 * worst:.1f} % at most", judged(worst, worst, 0.0, SAME), FIGURE,
        "The few members of the stepped runs fall on either side of the exact median.",
    )  # fmt: skip
