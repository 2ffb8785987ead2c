"""The figures of the study of regimes, from rows alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from impact_env.periodic.stationary import Kind
from optimisation.report.written_figure import write_figure
from studies.regimes.measured import RESPONSE, STAY, Row
from studies.regimes.tables import NAMES, hazard_of, names, of_case, slownesses, with_sweeps

COLOURS = {Kind.LINEAR: "#BBBBBB", Kind.PERIODIC: "#0072B2", Kind.SUSTAINED: "#E69F00", Kind.MODULATED: "#CC3311"}
DPI = 110


def save_jump(path: Path, rows: list[Row]) -> None:
    """Draw rates of leaving over the frequency, and jumps over the slowness, a row for each case."""
    shown = names(rows)
    figure = Figure(figsize=(11, 4.2 * len(shown)), layout="constrained")
    for case, (left, right) in zip(shown, np.atleast_2d(figure.subplots(len(shown), 2)), strict=True):
        _rates(left, [row for row in of_case(rows, STAY, case) if row["rate"] is not None])
        left.set(xlabel="frequency / resonance", ylabel="rate of leaving per pseudo period", title=f"{case}: constant frequencies")
        _jumps(right, slownesses(rows, case), of_case(rows, STAY, case))
        right.set(xlabel="pseudo periods per 1 %", ylabel="share that jumps", title=f"{case}: sweeps", ylim=(-0.02, 1.02))
    write_figure(figure, path, DPI)


def _bars(panel: Axes, x: list[float], rows: list[Row], value: str, label: str) -> None:
    y = np.array([row[value] for row in rows])
    spread = np.abs(np.array([[row["low"], row["high"]] for row in rows]).T - y)
    panel.errorbar(x, y, spread, fmt="o", ms=4, color="#0072B2", lw=1, capsize=2, label=label)


def _rates(panel: Axes, rows: list[Row]) -> None:
    if rows:
        _bars(panel, [row["at"] for row in rows], rows, "rate", "exits over time at risk, 95 %")
        panel.legend(frameon=False)
    panel.grid(True, color="0.9", lw=0.6)


def _jumps(panel: Axes, sweeps: list[Row], stays: list[Row]) -> None:
    measured, found = [row for row in sweeps if row["share"] is not None], with_sweeps(hazard_of(stays), sweeps)
    if measured and found is not None:
        n = np.geomspace(measured[0]["at"] / 2, measured[-1]["at"] * 2, 200)
        told = np.array([found.probability(each) for each in n]).T
        panel.plot(n, told[0], color="0.2", lw=1.2, label=f"{found.factor:.3f} exp(-N integral of the rate)")
        panel.fill_between(n, told[1], told[2], color="0.85", lw=0)
    if measured:
        _bars(panel, [row["at"] for row in measured], measured, "share", "measured, 95 %")
        panel.legend(frameon=False)
    panel.set_xscale("log")
    panel.grid(True, color="0.9", lw=0.6)


def save_kinds(path: Path, rows: list[Row]) -> None:
    """Draw the members' kinds over the frequency above the envelope of the response, a column for each case."""
    shown = names(rows)
    figure = Figure(figsize=(6.5 * len(shown), 7), layout="constrained")
    panels = figure.subplots(2, len(shown), squeeze=False, sharex="col")
    for case, (top, bottom) in zip(shown, panels.T, strict=True):
        own = of_case(rows, RESPONSE, case)
        x = np.array([row["at"] for row in own])
        shares = [[row[kind.value] / row["runs"] for row in own] for kind in Kind]
        top.stackplot(x, shares, labels=[NAMES[kind] for kind in Kind], colors=[COLOURS[kind] for kind in Kind], step="mid")
        top.set(ylabel="share of members", title=case, ylim=(0, 1))
        top.legend(loc="upper right", fontsize="small")
        low, middle, high = (1e3 * np.array([row[name] for row in own]) for name in ("peak_5", "peak_50", "peak_95"))
        bottom.fill_between(x, low, high, color="0.85", lw=0, label="5 to 95 %")
        bottom.plot(x, middle, color="#0072B2", lw=1.2, label="median")
        bottom.set(xlabel="frequency / resonance", ylabel="largest |q_tip| of a period, mm")
        bottom.legend(frameon=False)
        bottom.grid(True, color="0.9", lw=0.6)
    write_figure(figure, path, DPI)
