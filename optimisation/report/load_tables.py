"""A comparison under loads as a table, rows of a CSV file, and a figure."""

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from impact_env.laws import values, words
from impact_env.loads import amplitude_in_words
from optimisation.load_comparison import LoadComparison, TunedUnder
from optimisation.load_measures import TOLD, UNITS

BAND = (0.05, 0.5, 0.95)
COLUMNS = ("concept", "factor", "member", "band", "value")
LOOKS = {"impact": ("impact absorber", "#0072B2", "-"), "friction": ("friction damper", "#D55E00", "-"), "tuned": ("tuned absorber", "#009E73", "--")}


def rows(comparison: LoadComparison) -> Iterator[tuple[object, ...]]:
    """Yield every run."""
    for concept, found in comparison.values.items():
        for factor, runs in zip(comparison.factors, found, strict=True):
            yield from ((concept, float(factor), *place, float(value)) for place, value in np.ndenumerate(runs))


def summary(comparison: LoadComparison) -> dict[str, Any]:
    """Return the comparison's medians and bands of what is left of the measure without absorber, and the absorbers."""
    return {
        "measure": comparison.measure,
        "unit": UNITS[comparison.measure],
        "band_edges_hz": comparison.edges[:-1].tolist(),
        "factors": comparison.factors.tolist(),
        "free_size_m": comparison.free_size,
        "absorbers": {name: values(absorber) for name, absorber in comparison.absorbers.items() if absorber is not None},
        "without_absorber": np.median(comparison.values["none"], axis=1).T.tolist(),
        "ratio_5_50_95": {name: np.quantile(comparison.ratio(name), BAND, axis=1).transpose(2, 1, 0).tolist() for name in LOOKS},
    }


def _heads(comparison: LoadComparison) -> list[str]:
    """Return what each band is called; nothing where there is but one."""
    if len(comparison.edges) < 3:
        return [""]
    return [f"{low:.3g} Hz and above" if np.isinf(high) else f"{low:.3g} to {high:.3g} Hz" for low, high in pairwise(comparison.edges)]


def text_table(comparison: LoadComparison) -> str:
    """Return the lines that are printed."""
    lines = [f"{TOLD[comparison.measure]} under {amplitude_in_words(comparison.loads)}, over that without absorber: median (5 to 95 %)"]
    lines += [f"  {words(absorber)}" for absorber in comparison.absorbers.values() if absorber is not None]
    bands = {name: np.quantile(comparison.ratio(name), BAND, axis=1) for name in LOOKS}
    for band, head in enumerate(_heads(comparison)):
        lines += [f"  {head}"] if head else []
        lines.append("  intensity" + "".join(f"{LOOKS[name][0]:>24}" for name in LOOKS))
        for k, factor in enumerate(comparison.factors):
            cells = (f"{middle:.3f} ({low:.2f} to {high:.2f})" for low, middle, high in (bands[name][:, k, band] for name in LOOKS))
            lines.append(f"  {factor:9.3g}" + "".join(f"{cell:>24}" for cell in cells))
    return "\n".join(lines)


def tuned_summary(found: TunedUnder) -> dict[str, Any]:
    """Return the tunings and what they leave of the measure without absorber, the median over the members."""
    ratios = np.median(found.ratios, axis=1)
    tunings = zip(("best", "least_peak"), (found.best, found.peak), ratios, strict=True)
    return {"measure": found.measure} | {name: values(absorber) | {"ratio": float(ratio)} for name, absorber, ratio in tunings}


def tuned_text(found: TunedUnder) -> str:
    """Return the lines that are printed of tunings."""
    ratios = 100 * found.ratios
    lines = [f"{TOLD[found.measure]} under {amplitude_in_words(found.loads)}, in % of that without absorber: median of {ratios.shape[1]} runs"]
    for name, absorber, row in zip(("best for it", "least peak"), (found.best, found.peak), ratios, strict=True):
        lines.append(f"  {name}: {np.median(row):.4g} ({row.min():.4g} to {row.max():.4g}), {words(absorber)}")
    return "\n".join(lines)


def save_figure(path: Path, comparison: LoadComparison) -> None:
    """Draw what each absorber leaves over the loads' intensity; the ending of ``path`` chooses the format."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import NullLocator

    from optimisation.report.written_figure import write_figure

    heads = _heads(comparison)
    figure = Figure(figsize=(5.2 * len(heads) + 1.0, 3.8), layout="constrained")
    panels = figure.subplots(1, len(heads), sharey=True, squeeze=False)[0]
    for band, (axes, head) in enumerate(zip(panels, heads, strict=True)):
        for name, (label, colour, style) in LOOKS.items():
            low, middle, high = np.quantile(comparison.ratio(name)[:, :, band], BAND, axis=1)
            axes.fill_between(comparison.factors, low, high, color=colour, alpha=0.18, linewidth=0)
            axes.plot(comparison.factors, middle, style, color=colour, label=label)
        axes.axhline(1.0, color="black", linewidth=0.8)
        axes.set_xscale("log")
        axes.set_xticks(comparison.factors, [f"{factor:.3g}" for factor in comparison.factors])
        axes.xaxis.set_minor_locator(NullLocator())
        axes.set_ylim(0, None)
        axes.set_xlabel("intensity of the load, 1: as given")
        axes.set_title(", ".join(filter(None, (f"Under {amplitude_in_words(comparison.loads)}", head))), fontsize=11)
    panels[0].set_ylabel(f"{TOLD[comparison.measure]} over that without absorber")
    panels[0].legend(frameon=False)
    write_figure(figure, path)
