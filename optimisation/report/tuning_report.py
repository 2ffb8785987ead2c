"""All tunings of one absorber mass and one resonance, scored over one range.

The module also makes the content of this result. Quantities are in SI units unless stated
otherwise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from impact_env.drive import PAPER_LIMITS
from impact_env.frequency import coupled_receptance, tip_response
from impact_env.modes import ModalModel
from impact_env.parameters import DEFAULT_MASS_RATIO, TunedAbsorber
from optimisation.files import numbers
from optimisation.measures import format_number
from optimisation.report.report import (
    BLACK,
    BLUE,
    GREEN,
    MM,
    PINK,
    YELLOW,
    Chart,
    Column,
    Curve,
    Group,
    Report,
    Row,
    Table,
    assumed_rows,
    draw_grid,
    figure_of,
    force_axis,
    mass_rows,
)
from optimisation.tuned import (
    HIGH,
    LOW,
    PAPER,
    den_hartog,
    h2_norm,
    minimax,
    minimum_h2,
    paper_rule,
    peak,
    require_wide_range,
    undamped_h2,
    undamped_minimax,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NONE = "none"
PAPER_VALUES = "paper"
RULE = "den_hartog"
EXACT = "undamped_minimax"
EXACT_H2 = "undamped_h2"
MINIMAX = "minimax"
MINIMUM_H2 = "h2"
_PRINTED = 1e-3  # the paper prints its values to this accuracy


@dataclass(frozen=True)
class Tuning:
    """A tuned absorber (None: no absorber) with its scores.

    ``peak`` is in m/N, at ``peak_ratio`` (frequency over omega_r); ``h2`` is the H2 norm in
    m/(N sqrt(s)).
    """

    key: str
    label: str
    absorber: TunedAbsorber | None
    peak: float
    peak_ratio: float
    h2: float


@dataclass(frozen=True, eq=False)
class TuningTable:
    """Tunings, of which the first is without absorber.

    ``low`` and ``high``: ends of the scoring range over omega_r.
    """

    model: ModalModel
    mass_ratio: float
    resonance: int
    low: float
    high: float
    tunings: tuple[Tuning, ...]

    @property
    def omega(self) -> float:
        """Resonance frequency of the free beam in rad/s."""
        return self.model.resonance_omega(self.resonance)

    @property
    def undamped(self) -> bool:
        """Whether the peak without absorber is infinite."""
        return not math.isfinite(self.tunings[0].peak)

    @cached_property
    def reference(self) -> float:
        """Reference amplitude of the peaks in m/N.

        It is the peak without absorber, or the static deflection of an undamped structure.
        """
        if not self.undamped:
            return self.tunings[0].peak
        return float(np.abs(tip_response(self.model, None, np.zeros(1)))[0])

    @property
    def of_what(self) -> str:
        """What peaks are told in % of."""
        return "the static deflection" if self.undamped else "the peak without absorber"

    def relative_peak(self, tuning: Tuning) -> float:
        """Return the peak over `reference`."""
        return tuning.peak / self.reference

    def ratios_drawn(self, points: int) -> NDArray[np.float64]:
        """Return frequencies over omega_r at which to draw.

        They are ``points`` frequencies over the range and those of the peaks, except those of
        infinite peaks.
        """
        endless = [tuning.peak_ratio for tuning in self.tunings if not math.isfinite(tuning.peak)]
        every = np.union1d(
            np.linspace(self.low, self.high, points), [t.peak_ratio for t in self.tunings]
        )
        return every[~np.isclose(every[:, None], endless, rtol=1e-9).any(axis=1)]

    def ratios(self, absorber: TunedAbsorber) -> tuple[float, float]:
        """Return omega_a/omega_r and c/(2 m_a omega_a) of an absorber."""
        mass = absorber.mass_ratio * self.model.beam_mass
        omega = float(np.sqrt(absorber.stiffness / mass))
        return omega / self.omega, absorber.damping / (2 * mass * omega)


def paper_tuning(
    model: ModalModel, mass_ratio: float = DEFAULT_MASS_RATIO, resonance: int = 1
) -> TunedAbsorber:
    """Return the tuning by the paper's rule, or the paper's own values.

    The own values are returned for the paper's beam, mass and first resonance.
    """
    rule = paper_rule(model, mass_ratio, resonance)
    printed = (
        abs(rule.stiffness / PAPER.stiffness - 1) < _PRINTED
        and abs(rule.damping / PAPER.damping - 1) < _PRINTED
    )
    return PAPER if printed and mass_ratio == PAPER.mass_ratio else rule


def tuning_table(
    model: ModalModel,
    mass_ratio: float = DEFAULT_MASS_RATIO,
    resonance: int = 1,
    low: float = LOW,
    high: float = HIGH,
) -> TuningTable:
    """Return all tunings of an absorber of ``mass_ratio`` (over the beam's mass) to a resonance.

    They are scored over low..high times omega_r. Without absorber an undamped structure has an
    infinite peak and H2 norm. Raises ParameterError for numbers out of range, an undamped mode, a
    node at the absorber, and a scoring range that does not contain both split peaks
    (`require_wide_range`).
    """
    require_wide_range(model, mass_ratio, resonance, low, high)
    case = (mass_ratio, resonance)
    paper = paper_tuning(model, *case)
    absorbers: list[tuple[str, str, TunedAbsorber | None]] = [
        (NONE, "no absorber", None),
        (PAPER_VALUES, "paper's values" if paper is PAPER else "paper's rule", paper),
        (RULE, "Den Hartog", den_hartog(model, *case)),
        (EXACT, "minimax of one undamped mode", undamped_minimax(model, *case)),
        (EXACT_H2, "H2 optimum of one undamped mode", undamped_h2(model, *case)),
        (MINIMAX, "smallest peak, all modes", minimax(model, *case, low, high)),
        (MINIMUM_H2, "smallest H2 norm, all modes", minimum_h2(model, *case, low, high)),
    ]
    tunings = []
    for key, label, absorber in absorbers:
        height, ratio = peak(model, absorber, resonance, low, high)
        endless = absorber is None and not math.isfinite(height)
        variance = math.inf if endless else h2_norm(model, absorber, resonance, low, high)
        tunings.append(Tuning(key, label, absorber, height, ratio, variance))
    return TuningTable(model, mass_ratio, resonance, low, high, tuple(tunings))


Bounds = Mapping[str, float]  # certified amplitude in m/N by key
POINTS = 601  # of a curve of the card
# curves that lie on one another differ in dashes too
LOOKS: dict[str, tuple[str, str | tuple[int, tuple[float, ...]], float]] = {
    NONE: (BLACK, "-", 1.3),
    PAPER_VALUES: (PINK, "-", 2.0),
    RULE: (YELLOW, "-", 3.4),
    MINIMAX: (GREEN, (0, (5, 2)), 2.0),
    MINIMUM_H2: (BLUE, (0, (1.5, 1.5)), 2.0),
}


def value_table(table: TuningTable, bounds: Bounds) -> Table:
    """Return a row for each tuning; ``bounds``: proved amplitudes."""
    labels = {tuning.key: tuning.label for tuning in table.tunings}
    proved = 100 / table.reference
    columns = (
        Column("tuning"),
        Column(heading="tuning", show=lambda row: labels[row["tuning"]]),
        Column("stiffness_n_m", "k, N/m", "{:.6g}", unknown=""),
        Column("damping_n_s_m", "c, N s/m", unknown=""),
        Column("frequency_ratio", "omega_a/omega_r", "{:.4f}", unknown=""),
        Column("damping_ratio", "damping ratio", "{:.4f}", unknown=""),
        Column("peak_m_n"),
        Column("peak_frequency_ratio"),
        Column("peak_relative", "peak, %", "{:.2f}", 100, "inf"),
        Column(heading="at", show=lambda row: f"{row['peak_frequency_ratio']:.4f}"),
        Column("h2_norm_m_n_sqrt_s"),
        Column("h2_relative", "H2 norm, %", "{:.2f}", 100, "inf"),
        Column("certified_amplitude_m_n", "proved, %", "{:.3f}", proved, ""),
    )
    # H2 norms are relative to that without absorber, of an undamped structure to the smallest one
    smallest_h2 = min(tuning.h2 for tuning in table.tunings)
    reference_h2 = smallest_h2 if table.undamped else table.tunings[0].h2
    rows = []
    for tuning in table.tunings:
        absorber = tuning.absorber
        own: tuple[float | None, ...] = (None, None, None, None)
        if absorber is not None:
            own = (absorber.stiffness, absorber.damping, *table.ratios(absorber))
        peak = (tuning.peak, tuning.peak_ratio, table.relative_peak(tuning))
        h2 = (tuning.h2, tuning.h2 / reference_h2)
        rows.append((tuning.key, *own, *peak, *h2, bounds.get(tuning.key)))
    return Table(columns, rows)


def list_notes(table: TuningTable, bounds: Bounds) -> list[str]:
    """Return how to read the table."""
    by_key = {tuning.key: tuning for tuning in table.tunings}
    paper = by_key[PAPER_VALUES]
    best = by_key[MINIMAX]
    relative = (
        "peaks in % of the static deflection, H2 norms in % of the smallest"
        if table.undamped
        else "relative to no absorber"
    )
    notes = [
        (
            f"Scored over {table.low:g} to {table.high:g} times omega_{table.resonance} = "
            f"{table.omega:.6g} rad/s, {relative}."
        ),
        (
            f"Mistuning: {paper.label} leave{'s' if paper.label.endswith('rule') else ''} a peak "
            f"{paper.peak / best.peak:.2f} times the smallest one."
        ),
    ]
    if bounds:
        notes.append(
            "Proved: no amplitude in the range is larger, flanks of other resonances and all "
            "between the grid's points included."
        )
    return notes


def make_report(table: TuningTable, bounds: Bounds) -> Report:
    """Return the content of tunings; ``bounds``: proved amplitudes."""
    values = value_table(table, bounds)
    tunings = {
        record.pop("tuning"): {"label": tuning.label, **record}
        for tuning, record in zip(table.tunings, values.records(), strict=True)
    }
    settings = {
        "resonance": table.resonance,
        "omega_rad_s": table.omega,
        "mass_ratio": table.mass_ratio,
        "modes": table.model.modes,
        "scoring_range": [table.low, table.high],
        "peaks_relative_to": table.of_what,
    }
    best = next(tuning for tuning in table.tunings if tuning.key == MINIMAX)
    assert best.absorber is not None
    parameters = f"{best.absorber.stiffness:.6g} N/m and {best.absorber.damping:.4g} N s/m"
    peak = 100 * table.relative_peak(best)
    return Report(
        title="Tuned absorbers of one mass",
        verdict=f"Smallest peak: {parameters}, {peak:.4g} % of {table.of_what}.",
        text=[[values], list_notes(table, bounds)],
        numbers={"settings": settings, "tunings": tunings},
        tables={"tunings.csv": values},
        figures={"tunings.png": partial(draw_tunings, table)},
        groups=card_groups(table, bounds),
        charts=(amplitude_chart(table),),
    )


def draw_tunings(table: TuningTable) -> Figure:
    """Draw the amplitude over the scoring range, relative to the peak without absorber."""
    figure, axes = figure_of(9, 5.4)
    ratio = table.ratios_drawn(2001)
    drawn = [tuning for tuning in table.tunings if tuning.key in LOOKS]
    for tuning in drawn:
        colour, style, width = LOOKS[tuning.key]
        amplitude = (
            np.abs(tip_response(table.model, tuning.absorber, ratio * table.omega))
            / table.reference
        )
        label = f"{tuning.label}: peak {100 * table.relative_peak(tuning):.1f} %"
        axes.plot(ratio, 100 * amplitude, color=colour, ls=style, lw=width, label=label)
    for tuning in drawn[1:]:
        axes.plot(
            tuning.peak_ratio,
            100 * table.relative_peak(tuning),
            "o",
            ms=7,
            mfc="white",
            mec=LOOKS[tuning.key][0],
            mew=1.8,
            zorder=5,
        )
    axes.axvspan(
        *PAPER_LIMITS,
        color="0.93",
        zorder=0,
        label=f"the paper's sweep, {PAPER_LIMITS[0]:g} to {PAPER_LIMITS[1]:g}",
    )
    axes.set(yscale="log", xlim=(table.low, table.high))
    axes.set_xlabel(
        f"frequency over that of resonance {table.resonance}, {table.omega / (2 * np.pi):.1f} Hz",
        fontsize=11,
    )
    axes.set_ylabel(f"amplitude of the tip in %\nof {table.of_what}", fontsize=11)
    force_axis(axes.yaxis)
    draw_grid(axes)
    axes.legend(loc="upper right", fontsize=9.5, framealpha=0.95)
    axes.set_title(
        f"Tuned absorber of {format_number(100 * table.mass_ratio)} % of the beam's mass "
        "(circles: highest peak)",
        fontsize=12,
    )
    return figure


def card_groups(table: TuningTable, bounds: Bounds) -> tuple[Group, ...]:
    """Return the groups of the card of all tunings.

    They are the tunings with their peaks, the service loads of the tuning with the smallest peak,
    and assumptions.
    """
    rows = []
    for tuning in table.tunings:
        own = tuning.absorber
        what = "" if own is None else f", {own.stiffness:.6g} N/m, {own.damping:.4g} N s/m"
        proved = ""
        if tuning.key in bounds:
            proved = f", proved {100 * bounds[tuning.key] / table.reference:.4g} %"
        peak = f"peak {100 * table.relative_peak(tuning):.4g} % at {tuning.peak_ratio:.4g}"
        rows.append(Row(tuning.label, f"{peak}{proved}{what}"))
    assumed = (
        *mass_rows(table.mass_ratio, table.model),
        *assumed_rows(table.model, (table.resonance,), None),
    )
    loads = [
        (
            "What the tuning of the smallest peak bears under 1 N",
            tuned_service_rows(table, tuning.absorber),
        )
        for tuning in table.tunings
        if tuning.key == MINIMAX and tuning.absorber is not None
    ]
    return (("Tunings", tuple(rows)), *loads, ("Assumptions", assumed))


def amplitude_chart(table: TuningTable) -> Chart:
    """Return the amplitude over the frequency, of each tuning."""
    ratios = table.ratios_drawn(POINTS)
    curves = []
    for tuning in table.tunings:
        moved = np.abs(tip_response(table.model, tuning.absorber, ratios * table.omega))
        amplitude = 100 * moved / table.reference
        curves.append(Curve(tuning.label, numbers(ratios), numbers(amplitude)))
    return Chart(
        "Amplitude",
        "frequency over the resonance's",
        f"% of {table.of_what}",
        tuple(curves),
        log_y=True,
    )


def tuned_service_rows(table: TuningTable, absorber: TunedAbsorber) -> tuple[Row, ...]:
    """Return the largest stationary motion and the loss of a tuned absorber under 1 N.

    The rows are stroke, speed, accelerations and loss.
    """
    model = table.model
    omega = table.ratios_drawn(POINTS) * table.omega
    mass = absorber.mass_ratio * table.model.beam_mass
    place = coupled_receptance(model, absorber, omega, model.tip_shape, model.one_phase_force_shape)
    stroke = (
        place
        * mass
        * omega**2
        / (absorber.stiffness + 1j * omega * absorber.damping - mass * omega**2)
    )
    speed = omega * np.abs(stroke)
    accelerations = (
        np.abs(omega**2 * q) for q in (place + stroke, tip_response(model, absorber, omega))
    )
    absorbers, structures = (float(values.max()) for values in accelerations)
    return (
        Row("stroke of the absorber, to either side", MM * float(np.abs(stroke).max()), "mm"),
        Row("largest relative speed", float(speed.max()), "m/s"),
        Row("RMS relative speed", float(speed.max()) / math.sqrt(2), "m/s"),
        Row("power lost in the damper", 1e3 * absorber.damping * float(speed.max()) ** 2 / 2, "mW"),
        Row("largest acceleration of the absorber", absorbers, "m/s^2"),
        Row("largest acceleration of the structure", structures, "m/s^2"),
        Row("under other forces", "in proportion to the force, the power to its square"),
    )
