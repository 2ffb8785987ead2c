"""The tunings of the linear absorber as rows, JSON and a figure. SI units, unless named."""

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from impact_env.drive import PAPER_LIMITS
from impact_env.frequency import tip_response
from optimisation.report.written_figure import write_figure
from optimisation.tuned.table import MINIMAX, MINIMUM_H2, NONE, PAPER_VALUES, RULE, Tuning, TuningTable

Json = dict[str, object]
Bounds = Mapping[str, float]  # certified amplitude in m/N by key
COLUMNS = (
    "tuning",
    "stiffness_n_m",
    "damping_n_s_m",
    "frequency_ratio",
    "damping_ratio",
    "peak_m_n",
    "peak_frequency_ratio",
    "peak_relative",
    "h2_norm_m_n_sqrt_s",
    "h2_relative",
    "certified_amplitude_m_n",
)
DPI = 160
# colours of Okabe and Ito; curves that lie on one another differ in dashes too
LOOKS: dict[str, tuple[str, str | tuple[int, tuple[float, ...]], float]] = {
    NONE: ("#000000", "-", 1.3),
    PAPER_VALUES: ("#CC79A7", "-", 2.0),
    RULE: ("#E69F00", "-", 3.4),
    MINIMAX: ("#009E73", (0, (5, 2)), 2.0),
    MINIMUM_H2: ("#0072B2", (0, (1.5, 1.5)), 2.0),
}


def rows(table: TuningTable, bounds: Bounds) -> Iterator[tuple[object, ...]]:
    """Yield one row of `COLUMNS` for each tuning; an empty cell where there is no absorber or no certificate."""
    for tuning in table.tunings:
        values = _values(table, tuning, bounds)
        yield (tuning.key, *("" if value is None else value for value in values.values()))


def _values(table: TuningTable, tuning: Tuning, bounds: Bounds) -> dict[str, float | None]:
    absorber = tuning.absorber
    frequency, damping = (None, None) if absorber is None else table.ratios(absorber)
    numbers = (
        None if absorber is None else absorber.stiffness,
        None if absorber is None else absorber.damping,
        frequency,
        damping,
        tuning.peak,
        tuning.peak_ratio,
        table.relative_peak(tuning),
        tuning.h2,
        table.relative_h2(tuning),
        bounds.get(tuning.key),
    )
    return dict(zip(COLUMNS[1:], numbers, strict=True))


def summary(table: TuningTable, bounds: Bounds) -> Json:
    """Return settings and tunings as JSON values."""
    return {
        "settings": {
            "resonance": table.resonance,
            "omega_rad_s": table.omega,
            "mass_ratio": table.mass_ratio,
            "modes": table.model.modes,
            "scoring_range": [table.low, table.high],
        },
        "tunings": {tuning.key: {"label": tuning.label, **_values(table, tuning, bounds)} for tuning in table.tunings},
    }


def save_figure(path: Path, table: TuningTable) -> None:
    """Draw the amplitude over the scoring range, relative to the peak without absorber; the ending of ``path`` chooses the format."""
    figure = Figure(figsize=(9, 5.4), layout="constrained")
    axes = figure.subplots()
    ratio = np.unique(np.concatenate([np.linspace(table.low, table.high, 2001), [t.peak_ratio for t in table.tunings]]))
    shown = [tuning for tuning in table.tunings if tuning.key in LOOKS]
    for tuning in shown:
        colour, style, width = LOOKS[tuning.key]
        amplitude = np.abs(tip_response(table.model, tuning.absorber, ratio * table.omega)) / table.tunings[0].peak
        label = f"{tuning.label}: peak {100 * table.relative_peak(tuning):.1f} %"
        axes.plot(ratio, 100 * amplitude, color=colour, ls=style, lw=width, label=label)
    for tuning in shown[1:]:
        axes.plot(tuning.peak_ratio, 100 * table.relative_peak(tuning), "o", ms=7, mfc="white", mec=LOOKS[tuning.key][0], mew=1.8, zorder=5)
    axes.axvspan(*PAPER_LIMITS, color="0.93", zorder=0, label=f"the paper's sweep, {PAPER_LIMITS[0]:g} to {PAPER_LIMITS[1]:g}")
    axes.set(yscale="log", xlim=(table.low, table.high))
    axes.set_xlabel(f"frequency over that of resonance {table.resonance}, {table.omega / (2 * np.pi):.1f} Hz", fontsize=11)
    axes.set_ylabel("amplitude of the tip in %\nof the peak without absorber", fontsize=11)
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{y:g}"))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.grid(True, color="0.88", lw=0.7)
    axes.set_axisbelow(True)
    axes.legend(loc="upper right", fontsize=9.5, framealpha=0.95)
    axes.set_title(f"Tuned absorber of {100 * table.mass_ratio:g} % of the beam's mass (circles: highest peak)", fontsize=12)
    write_figure(figure, path, DPI)
