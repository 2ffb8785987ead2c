"""A comparison under loads as a table, rows of a CSV file, and a figure."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from impact_env.laws import values, words
from impact_env.loads import amplitude_in_words
from optimisation.load_comparison import LoadComparison, TunedUnder
from optimisation.load_measures import TOLD, UNITS

BAND = (0.05, 0.5, 0.95)
COLUMNS = ("concept", "factor", "member", "value")
LOOKS = {"impact": ("impact absorber", "#0072B2", "-"), "friction": ("friction damper", "#D55E00", "-"), "tuned": ("tuned absorber", "#009E73", "--")}


def rows(comparison: LoadComparison) -> Iterator[tuple[object, ...]]:
    """Yield every run."""
    for concept, found in comparison.values.items():
        for factor, runs in zip(comparison.factors, found, strict=True):
            yield from ((concept, float(factor), member, float(value)) for member, value in enumerate(runs))


def summary(comparison: LoadComparison) -> dict[str, Any]:
    """Return the comparison's medians and bands of what is left of the measure without absorber, and the absorbers."""
    return {
        "measure": comparison.measure,
        "unit": UNITS[comparison.measure],
        "factors": comparison.factors.tolist(),
        "free_size_m": comparison.free_size,
        "absorbers": {name: values(absorber) for name, absorber in comparison.absorbers.items() if absorber is not None},
        "without_absorber": np.median(comparison.values["none"], axis=1).tolist(),
        "ratio_5_50_95": {name: np.quantile(comparison.ratio(name), BAND, axis=1).T.tolist() for name in LOOKS},
    }


def text_table(comparison: LoadComparison) -> str:
    """Return the lines that are printed."""
    lines = [f"{TOLD[comparison.measure]} under {amplitude_in_words(comparison.loads)}, over that without absorber: median (5 to 95 %)"]
    lines += [f"  {words(absorber)}" for absorber in comparison.absorbers.values() if absorber is not None]
    lines.append("  intensity" + "".join(f"{LOOKS[name][0]:>24}" for name in LOOKS))
    bands = {name: np.quantile(comparison.ratio(name), BAND, axis=1) for name in LOOKS}
    for k, factor in enumerate(comparison.factors):
        cells = (f"{bands[name][1, k]:.3f} ({bands[name][0, k]:.2f} to {bands[name][2, k]:.2f})" for name in LOOKS)
        lines.append(f"  {factor:9.3g}" + "".join(f"{cell:>24}" for cell in cells))
    return "\n".join(lines)


def tuned_summary(found: TunedUnder) -> dict[str, Any]:
    """Return the tunings and what they leave of the measure without absorber, the median over the members."""
    ratios = np.median(found.values[:2] / found.values[2], axis=1)
    tunings = zip(("best", "least_peak"), (found.best, found.peak), ratios, strict=True)
    return {"measure": found.measure} | {name: values(absorber) | {"ratio": float(ratio)} for name, absorber, ratio in tunings}


def tuned_text(found: TunedUnder) -> str:
    """Return the lines that are printed of tunings."""
    ratios = 100 * found.values[:2] / found.values[2]
    lines = [f"{TOLD[found.measure]} under {amplitude_in_words(found.loads)}, in % of that without absorber: median of {ratios.shape[1]} runs"]
    for name, absorber, row in zip(("best for it", "least peak"), (found.best, found.peak), ratios, strict=True):
        lines.append(f"  {name}: {np.median(row):.4g} ({row.min():.4g} to {row.max():.4g}), {words(absorber)}")
    return "\n".join(lines)


def save_figure(path: Path, comparison: LoadComparison) -> None:
    """Draw what each absorber leaves over the loads' intensity; the ending of ``path`` chooses the format."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import NullLocator

    from optimisation.report.written_figure import write_figure

    figure = Figure(figsize=(6.4, 4.4), layout="constrained")
    axes = figure.subplots()
    for name, (label, colour, style) in LOOKS.items():
        low, middle, high = np.quantile(comparison.ratio(name), BAND, axis=1)
        axes.fill_between(comparison.factors, low, high, color=colour, alpha=0.18, linewidth=0)
        axes.plot(comparison.factors, middle, style, color=colour, label=label)
    axes.axhline(1.0, color="black", linewidth=0.8)
    axes.set_xscale("log")
    axes.set_xticks(comparison.factors, [f"{factor:.3g}" for factor in comparison.factors])
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_ylim(0, None)
    axes.set_xlabel("intensity of the load, 1: as given, for which each absorber is at its best")
    axes.set_ylabel(f"{TOLD[comparison.measure]} over that without absorber")
    axes.set_title(f"Under {amplitude_in_words(comparison.loads)}", fontsize=11)
    axes.legend(frameon=False)
    write_figure(figure, path)
