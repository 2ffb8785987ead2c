"""The figure of the comparison: response level over the force near both resonances, as in the paper's last figure."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from optimisation.comparison import FRICTION, IMPACT, LTVA_PAPER_WIDE, LTVA_TUNED, LTVA_TUNED_WIDE, NONE, Comparison, ResonanceComparison
from optimisation.report.written_figure import write_figure

DPI = 160
MM = 1e3
SHOWN = 0.04  # of the gap: the smallest level in the figure
ORDINALS = {1: "First", 2: "Second", 3: "Third"}


@dataclass(frozen=True)
class Look:
    """How a concept is drawn: colours of Okabe and Ito, which colour-blind readers can tell apart, and a line style as well."""

    label: str
    colour: str
    style: str | tuple[int, tuple[float, ...]] = "-"
    width: float = 1.8


LOOKS = {
    NONE: Look("no absorber", "#000000", "-", 1.3),
    FRICTION: Look("friction damper", "#D55E00"),
    LTVA_PAPER_WIDE: Look("tuned absorber, paper's values", "#CC79A7", (0, (4, 2))),
    LTVA_TUNED_WIDE: Look("tuned absorber, well tuned", "#009E73", (0, (6, 2, 1.5, 2))),
    IMPACT: Look("impact absorber", "#0072B2", "-", 2.4),
}


def save_figure(path: Path, comparison: Comparison) -> None:
    """Draw the comparison; the ending of ``path`` chooses the format."""
    figure = Figure(figsize=(10, 6.4), layout="constrained")
    panels = figure.subplots(1, len(comparison.resonances), squeeze=False, sharey=True)[0]
    top = 0.0
    for panel, part in zip(panels, comparison.resonances, strict=True):
        _draw(panel, part)
        top = max(top, float(np.nanmax(MM * part.curves[NONE].median, initial=0)))
    panels[0].set_ylim(MM * SHOWN * comparison.gap, 1.3 * top if top > 0 else None)
    panels[0].set_ylabel(
        "resonant response level in mm (RMS)" if comparison.own_structure else "resonant response level of the tip in mm (RMS)", fontsize=11
    )
    handles, labels = panels[0].get_legend_handles_labels()
    legend = figure.legend(
        handles, labels, loc="outside lower center", ncols=3, fontsize=10, frameon=False, title=_caption(comparison), alignment="center"
    )
    legend.get_title().set(fontsize=9, color="0.35", ha="center")
    what, whose = ("the structure", "its") if comparison.own_structure else ("the beam's tip", "the beam's")
    title = f"Response of {what} at resonance, with absorbers of {100 * comparison.mass_ratio:.3g} % of {whose} mass"
    figure.suptitle(title, fontsize=13)
    write_figure(figure, path, DPI)


def _caption(comparison: Comparison) -> str:
    runs = "one run" if comparison.members == 1 else f"{comparison.members} runs that differ in when the force begins and by a millionth of it"
    band = f"lines: median, bands: 5 to 95 % of {runs}{'' if comparison.complete else ' (stopped early)'}"
    return f"level: RMS around the largest displacement, the larger of a sweep up and a sweep down\n{band}"


def _draw(panel: Axes, part: ResonanceComparison) -> None:
    for key, look in LOOKS.items():
        # near another resonance than its own a tuned absorber is not swept widely
        curve = part.curves.get(key, part.curves.get(LTVA_TUNED) if key == LTVA_TUNED_WIDE else None)
        if curve is None:
            continue
        low, high = MM * curve.band
        panel.fill_between(part.forces, low, high, color=look.colour, alpha=0.25, lw=0)
        panel.plot(part.forces, MM * curve.median, color=look.colour, ls=look.style, lw=look.width, label=look.label)
    panel.set(xscale="log", yscale="log", xlim=(part.forces[0], part.forces[-1]))
    _draw_limit(panel, part)
    _mark_optimum(panel, part)
    if part.own_force is not None:
        panel.axvline(part.own_force, color="0.4", lw=1.2, ls=":", label=f"the force, {part.own_force:g} N")
    panel.set_title(f"{ORDINALS.get(part.resonance, part.resonance)} resonance, {part.omega / (2 * np.pi):.1f} Hz", fontsize=12)
    panel.set_xlabel("amplitude of the force in N", fontsize=11)
    for axis in (panel.xaxis, panel.yaxis):
        axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
        axis.set_minor_locator(NullLocator())
    panel.grid(True, color="0.88", lw=0.7)
    panel.set_axisbelow(True)


def _draw_limit(panel: Axes, part: ResonanceComparison) -> None:
    """Shade what no device of this mass and gap can reach."""
    forces = np.geomspace(part.forces[0], part.forces[-1], 200)
    limit = np.maximum(MM * part.limit_at(forces), 1e-9)
    label = f"out of reach for the impact absorber: cavity of ±{MM * part.gap:.4g} mm"
    panel.fill_between(forces, 1e-9, limit, facecolor="0.93", edgecolor="0.72", hatch="////", lw=0.8, zorder=0.4, label=label)


def _mark_optimum(panel: Axes, part: ResonanceComparison) -> None:
    optimum = part.curves[IMPACT].optimum(part.curves[NONE])
    if optimum is None:
        return
    colour = LOOKS[IMPACT].colour
    panel.plot(optimum.force, MM * optimum.level, "o", ms=9, mfc="white", mec=colour, mew=2.2, zorder=5)
    panel.plot(0.05, 0.925, "o", ms=9, mfc="white", mec=colour, mew=2.2, transform=panel.transAxes)
    text = f"best point: {optimum.force:.3g} N,\n{100 * optimum.relative:.0f} % of no absorber"
    panel.text(0.085, 0.95, text, fontsize=11, color=colour, ha="left", va="top", transform=panel.transAxes)
