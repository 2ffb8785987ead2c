"""The figure SMR: a record of displacements, phase lag and energies, and beside it what all members show."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from impact_env.response import DEFAULT_SAMPLES
from studies.paper.style import FAINT, LOOKS, MM, REFERENCE, finish, panels, signal
from studies.study import Json


def save(path: Path, values: Json, edges: dict[str, Any]) -> None:
    """Draw the paper's own run to the left, and distributions over all members to the right."""
    figure, axes = panels(4, 2, 8.0, width_ratios=(2.4, 1))
    exact, step = values["exact"], values["paper's step"]
    _record(axes[:, 0], exact["record"], values["linear"]["gap_m"])
    _bars(axes[0, 1], 1e3 * edges["tip"], {"exact": exact["counts"]["tip"], "paper's step": step["counts"]["tip"]})
    axes[0, 1].set_xlabel("largest tip of a period, mm")
    for own, what, label in ((axes[1, 1], "lag", "lag of a period, rad"), (axes[2, 1], "impacts", "impacts in a period")):
        _bars(own, edges[f"{what}, high"], {f"{third} third": exact["counts"][f"{what}, {third}"] for third in ("high", "low")})
        own.set_xlabel(label)
    _bars(axes[3, 1], edges["share"], {"exact": exact["counts"]["share"], "paper's step": step["counts"]["share"]})
    axes[3, 1].set_xlabel("largest share in 25 periods")
    for own in axes[:, 1]:
        own.set(ylabel="share of all", ylim=(0, 1.4 * own.dataLim.y1))
        own.legend(loc="upper left", fontsize=6.5)
    finish(axes[:, 0], path, figure)


def _record(axes: Any, record: Json, gap: float) -> None:
    period = np.arange(len(record["tip_m"])) / DEFAULT_SAMPLES
    tip, absorber = (MM * np.array(record[name]) for name in ("tip_m", "absorber_m"))
    for side in (-1, 1):
        axes[0].plot(period, tip + side * MM * gap, color=FAINT, lw=0.5, label="cavity walls" if side > 0 else None)
    signal(axes[0], period, tip, LOOKS[0], "tip", 0.9)
    signal(axes[0], period, absorber, LOOKS[1], "absorber", 0.9)
    axes[0].set_ylabel("displacement, mm")
    lag = np.array(record["lag_rad"])
    axes[1].plot(
        period, np.where(np.abs(np.diff(lag, prepend=lag[0])) > np.pi, np.nan, lag), color=LOOKS[0].colour, lw=0.6, label="Hilbert phase lag"
    )
    turns = np.angle(np.exp(1j * lag).reshape(-1, DEFAULT_SAMPLES).mean(axis=1))
    axes[1].plot(np.arange(len(turns)) + 0.5, turns, "o", ms=3, color=LOOKS[1].colour, label="mean of a period")
    axes[1].set(ylabel="lag of the absorber, rad", ylim=(-np.pi, 1.5 * np.pi), yticks=(-np.pi, 0, np.pi), yticklabels=(r"$-\pi$", "0", r"$\pi$"))
    modal, absorbed = (1e3 * np.array(record[name]) for name in ("modal_j", "absorber_j"))
    signal(axes[2], period, modal, LOOKS[0], "first mode", 0.9)
    signal(axes[2], period, absorbed, LOOKS[1], "absorber", 0.9)
    signal(axes[2], period, modal + absorbed, REFERENCE, "both", 0.9)
    axes[2].set_ylabel("energy, mJ")
    axes[3].fill_between(period, absorbed / (modal + absorbed), color=LOOKS[1].colour, alpha=0.5, lw=0)
    axes[3].axhline(0.9, color="black", ls=":", lw=0.8, label="90 %")
    axes[3].set(ylabel="absorber's share", ylim=(0, 1.2), xlabel="pseudo periods")
    for own in (axes[0], axes[2]):
        low, high = own.get_ylim()
        own.set_ylim(low, high + 0.2 * (high - low))
    for own in axes:
        own.set_xlim(period[0], period[-1])
        own.legend(loc="upper right", ncols=3, fontsize=6.5)


def _bars(axes: Axes, edges: Any, counts: dict[str, Any]) -> None:
    """Draw distributions as steps, each of area one in shares."""
    for look, (label, number) in zip(LOOKS, counts.items(), strict=False):
        share = np.array(number) / max(1, np.sum(number))
        axes.stairs(share, edges, color=look.colour, ls=look.dashes, lw=1.1, label=label)
