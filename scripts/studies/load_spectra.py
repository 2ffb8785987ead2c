"""Random loads and shocks on two structures with impact absorbers.

The results are compared with those of the best tuned absorber.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.optimize

from impact_env import InitialState, ModalModel, Record, Scene, modal_model, mode_shapes, simulate
from impact_env.energy import mechanical_energy
from impact_env.ensemble import Lane, draw_members, drives_of
from impact_env.loads import Loads, Random, Shock
from impact_env.parameters import Absorber, Beam, impact_absorber
from optimisation.absorber_rules import scaled_friction
from optimisation.bounds import design_force
from optimisation.files import markdown
from optimisation.load_cases import runs_of
from optimisation.measures import SAMPLES
from optimisation.tuned.under_loads import expected_rms, tune_for_loads
from studies.study import Array, Json

MODES = 5
MASS_RATIO = 0.02
GAP = 1e-3
RESTITUTION = 0.7
BAND = (0.05, 0.5, 0.95)
PERIODS = 800.0  # of a record
SPECTRA = {
    "narrow": (0.9, 1.1),
    "wide": (0.5, 1.5),
    "two modes": (0.5, 7.5),
}  # flat, over the first frequency
GAPS = np.geomspace(0.6, 3.6, 9)  # over the free motion's RMS at the absorber
SHIFTS = (-0.2, -0.1, -0.05, -0.02, 0.0, 0.02, 0.05, 0.1, 0.2)  # of all frequencies
WIDTHS = (0.5, 0.16)  # of a half-sine pulse, in periods of the first mode
PEAKS = (
    0.7,
    1.0,
    1.4,
    2.0,
    2.8,
    4.0,
    5.6,
)  # largest free displacement at the absorber over the gap
SHOCK_PERIODS = 100.0
TENTH = 10  # impacts after which energies are read
SERIES = Record(level=False, series=True, samples_per_period=SAMPLES)


class SpectrumSettings(NamedTuple):
    """Runs for each point, and whether it is only a look."""

    members: int
    quick: bool


@dataclass(frozen=True)
class LoadCase:
    """A beam with its absorber, response position and forces.

    The design rule gives the gap `GAP` for these forces.
    """

    name: str
    beam: Beam

    @cached_property
    def model(self) -> ModalModel:
        """The modal model."""
        return modal_model(self.beam)

    @property
    def mass(self) -> float:
        """Mass of the absorber in kg."""
        return MASS_RATIO * self.model.beam_mass

    @cached_property
    def forces(self) -> tuple[float, float]:
        """Forces in N near the first and the second resonance."""
        return design_force(self.model, self.mass, GAP, 1), design_force(
            self.model, self.mass, GAP, 2
        )

    @cached_property
    def node(self) -> float:
        """Node of the second mode, as a fraction of the length."""
        return float(scipy.optimize.brentq(lambda x: mode_shapes(self.beam, [x])[0, 1], 0.3, 0.95))

    def at(self, *positions: float) -> ModalModel:
        """Return the model with absorbers elsewhere, the response read at the same place."""
        beam = replace(self.beam, response_position=self.beam.absorber_position)
        return modal_model(
            replace(beam, absorber_position=positions[0]), positions if len(positions) > 1 else None
        )


SUPPORTED = Beam(modes=MODES, ends="pinned-pinned", absorber_position=0.35, force_position=0.2)
CASES = {
    case.name: case
    for case in (LoadCase("cantilever", Beam(modes=MODES)), LoadCase("supported beam", SUPPORTED))
}


def band_text(values: Sequence[float] | None) -> str:
    """Return median and band, nothing of None."""
    if values is None:
        return ""
    low, middle, high = np.quantile(values, BAND)
    return f"{middle:.2f} ({low:.2f} to {high:.2f})"


class LoadVariant(NamedTuple):
    """A variant of the random load and of the absorber.

    The defaults are the wide spectrum, a damping ratio of 1 %, the usual mass and restitution, and
    no friction.
    """

    spectrum: str = "wide"
    damping: float = 0.01
    mass_ratio: float = MASS_RATIO
    restitution: float = RESTITUTION
    friction: float = 0.0

    @property
    def name(self) -> str:
        """The name in a table."""
        usual = LoadVariant()._asdict()
        words = {
            "spectrum": "{}",
            "damping": "D = {:g}",
            "mass_ratio": "mass {:g}",
            "restitution": "e = {:g}",
            "friction": "friction {:g}",
        }
        own = [
            words[name].format(value)
            for name, value in self._asdict().items()
            if value != usual[name]
        ]
        return ", ".join(own) or "as it is"


VARIANTS = (
    LoadVariant(),
    *(LoadVariant(spectrum=name) for name in ("narrow", "two modes")),
    *(LoadVariant(damping=value) for value in (0.005, 0.02, 0.05)),
    *(LoadVariant(mass_ratio=value) for value in (0.01, 0.04)),
    *(LoadVariant(restitution=value) for value in (0.4, 0.9)),
    LoadVariant(friction=1.0),
)


def _random(model: ModalModel, spectrum: str) -> Loads:
    low, high = np.array(SPECTRA[spectrum]) * model.omega[0] / (2 * np.pi)
    flat = Random(np.array([[low, 1.0], [high, 1.0]]), PERIODS * 2 * np.pi / float(model.omega[0]))
    return Loads((flat,), float(model.omega[0]))


def _ratios(model: ModalModel, absorbers: Sequence[Absorber], loads: Sequence[Loads]) -> Array:
    """Return absorbers' measures over that without absorber under each load, (absorbers, loads)."""
    values = runs_of(model, [None, *absorbers], loads)
    return np.asarray(values[1:] / values[0])


def random_rows(case: LoadCase, number: int, settings: SpectrumSettings) -> list[Json]:
    """Return the relative RMS under a random load over the gap, for one variant.

    The first variant also has it on structures with shifted frequencies.
    """
    variant = VARIANTS[number]
    damped = replace(case.model, damping_ratio=np.full(case.model.modes, variant.damping))
    mass = variant.mass_ratio * damped.beam_mass
    loads = _random(damped, variant.spectrum)
    (spectrum,) = loads.parts
    assert isinstance(spectrum, Random)
    size = expected_rms(damped, None, spectrum)
    tuned = tune_for_loads(damped, variant.mass_ratio, [loads])
    drives = [
        drive
        for drive in drives_of(draw_members(settings.members, 0), loads)
        if isinstance(drive, Loads)
    ]

    def impact(gap: float) -> Absorber:
        return impact_absorber(
            gap,
            variant.restitution,
            variant.friction * scaled_friction(damped, mass, gap),
            variant.mass_ratio,
        )

    gaps = GAPS[:: 4 if settings.quick else 1]
    result = _ratios(damped, [*(impact(float(gap * size)) for gap in gaps), tuned], drives)
    best = int(np.argmin(np.median(result[:-1], axis=1)))
    shifted = {}
    for shift in SHIFTS if number == 0 else ():
        impacts, tunings = _ratios(
            damped.detuned(shift), [impact(float(gaps[best] * size)), tuned], drives
        )
        shifted[f"{shift:g}"] = {"impact": impacts.tolist(), "tuned": tunings.tolist()}
    left = float(np.median(result[best]))
    return [
        {
            "structure": case.name,
            "variant": variant.name,
            "number": number,
            **variant._asdict(),
            "gaps_over_rms": gaps.tolist(),
            "impact": result[:-1].tolist(),
            "tuned": result[-1].tolist(),
            "best": best,
            "shifted": shifted,
            "added_damping_over_mass": variant.damping
            * (left**-2 - 1)
            / (mass * float(damped.tip_shape[0]) ** 2),
        }
    ]


def _high_share(lane: Lane) -> float:
    """Return the share of the modes above the first in the structure's energy.

    It is taken after the tenth impact. With fewer impacts it is NaN.
    """
    impacts = simulate(lane.scene, lane.drive, record=Record(events=True)).recorded.impacts
    history = simulate(lane.scene, lane.drive, record=SERIES).recorded.history
    if len(impacts.time) < TENTH:
        return float("nan")
    modal = mechanical_energy(lane.scene, history).modal[
        np.searchsorted(history.time, impacts.time[TENTH - 1])
    ]
    return float(1 - modal[0] / np.sum(modal))


def shock_rows(case: LoadCase, width: float, settings: SpectrumSettings) -> list[Json]:
    """Return relative decay times and the energy share of higher modes over the peak.

    Decay times are relative to those without absorber. Members start at different positions in the
    cavity.
    """
    model = case.model
    period = model.pseudo_period(1)
    shock = Shock("half-sine", 1.0, width * period, SHOCK_PERIODS * period)
    unit = Loads((shock,), float(model.omega[0]))
    history = simulate(Scene(model), unit, record=SERIES).recorded.history
    per_newton = float(np.max(np.abs(history.tip_displacement)))
    tuned = tune_for_loads(model, MASS_RATIO, [unit])
    places = np.random.default_rng(0).uniform(-0.95, 0.95, settings.members) * GAP
    rows = []
    for peak in PEAKS[:: 3 if settings.quick else 1]:
        (pulse,) = unit.parts
        assert isinstance(pulse, Shock)
        force = peak * GAP / per_newton
        loads = [
            Loads(
                (replace(pulse, peak=force),),
                unit.reference,
                InitialState(absorber_displacement=float(place)),
            )
            for place in places
        ]
        absorber = impact_absorber(GAP, RESTITUTION, None, MASS_RATIO)
        decay = _ratios(model, [absorber], loads)[0]
        shares = [_high_share(Lane(Scene(model, absorber), load)) for load in loads]
        best = _ratios(model, [tuned], [replace(loads[0], start="middle")])[0, 0]
        rows.append(
            {
                "structure": case.name,
                "width": width,
                "peak_over_gap": peak,
                "peak_n": force,
                "decay": decay.tolist(),
                "tuned": float(best),
                "high_share": [None if np.isnan(share) else share for share in shares],
            }
        )
    return rows


def random_text(rows: Sequence[Json]) -> str:
    """Return a table of the best gaps, and one over the shift of all frequencies."""
    lines = []
    for row in rows:
        best = row["best"]
        gap = row["gaps_over_rms"][best]
        left = row["impact"][best]
        ends = best in (0, len(row["impact"]) - 1)
        edge = f"{gap:.2f}{' (edge)' if ends else ''}"
        added = f"{row['added_damping_over_mass']:.2f}" if row["spectrum"] != "two modes" else ""
        lines.append(
            (
                row["structure"],
                row["variant"],
                edge,
                f"{gap / np.median(left):.2f}",
                band_text(left),
                added,
                band_text(row["tuned"]),
            )
        )
    head = (
        "structure",
        "variant",
        "best gap / free RMS",
        "gap / RMS left",
        "impact absorber",
        "added damping / (m_a phi^2)",
        "tuned for it",
    )
    first = [row for row in rows if row["shifted"]]
    shifts = list(first[0]["shifted"])
    moved = []
    for row, name in itertools.product(first, ("impact", "tuned")):
        moved.append(
            (
                f"{row['structure']}, {name}",
                *(f"{np.median(row['shifted'][shift][name]):.2f}" for shift in shifts),
            )
        )
    return markdown(head, lines) + "\n\n" + markdown(("all frequencies shifted by", *shifts), moved)


def shock_text(rows: Sequence[Json]) -> str:
    """Return a table over the peak."""
    lines = []
    for row in rows:
        shares = [share for share in row["high_share"] if share is not None]
        share = band_text(shares) if 2 * len(shares) > len(row["high_share"]) else "fewer impacts"
        at = f"{row['structure']}, {row['width']:g} periods", f"{row['peak_over_gap']:g}"
        lines.append((*at, band_text(row["decay"]), f"{row['tuned']:.2f}", share))
    head = (
        "structure, pulse",
        "free peak / gap",
        "impact absorber",
        "tuned",
        f"share of higher modes after {TENTH} impacts",
    )
    return markdown(head, lines)
