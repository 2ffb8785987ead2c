"""A load of each kind on two structures: what an impact absorber leaves of the measure that belongs to it, and the motion for a picture."""

from collections.abc import Callable, Sequence

import numpy as np

from impact_env.drive import Drive, FrequencySchedule, linear_sweep
from impact_env.ensemble import Lane, draw_members, drives_of, each_lane
from impact_env.loads import Force, Load, Loads, Random, Samples, ShakenBase, Shock, Tone, Tones, Unbalance
from impact_env.parameters import impact_absorber
from impact_env.response import Record
from impact_env.scene import Scene
from impact_env.sweep import simulate
from optimisation.load_measures import START, free_size, measure_of, measured
from optimisation.page import DOCS
from optimisation.report.markdown import markdown
from studies.load_cases import MASS_RATIO, RESTITUTION, Case, Settings, band_text
from studies.study import Json

POINTS, SAMPLES = 400, 32  # of a picture's envelope, and of a pseudo period
RECORD = DOCS / "examples" / "shaker.csv"


def _sweep(case: Case) -> FrequencySchedule:
    return linear_sweep(float(case.model.omega[0]), 0.9, 1.06)


def _like_force(case: Case) -> float:
    """Return the base's acceleration (m/s^2) that drives the first mode as the force near its resonance does."""
    participation = case.model.base_participation
    assert participation is not None
    return abs(case.forces[0] * float(case.model.force_shape[0] / participation[0]))


def _run_up(case: Case) -> Unbalance:
    omega = float(case.model.omega[0])
    schedule = FrequencySchedule(np.array([0.0, 1200 * 2 * np.pi / omega]), omega * np.array([0.7, 1.3]), omega)
    return Unbalance(case.forces[0] / omega**2, schedule)


def _record(case: Case) -> Samples:
    """Return the example's record, with a time that fits the first frequency and an acceleration that fits the force."""
    times, values = np.loadtxt(RECORD, delimiter=",", skiprows=1).T
    return Samples(times * 250.0 / float(case.model.omega[0]), values * _like_force(case), "base_acceleration")


def _flat(case: Case) -> Random:
    hertz = float(case.model.omega[0]) / (2 * np.pi)
    return Random(np.array([[0.5, case.forces[0] ** 2 / hertz], [1.5, case.forces[0] ** 2 / hertz]]) * [hertz, 1.0], 400 / hertz)


def _orders(case: Case) -> Tones:
    tones = Tone(case.forces[0], order=1.0), Tone(0.1 * case.forces[1], order=float(case.model.omega[1] / case.model.omega[0]))
    return Tones(tones, schedule=_sweep(case))


KINDS: dict[str, Callable[[Case], Load]] = {
    "force": lambda case: Force(Drive(case.forces[0], _sweep(case))),
    "unbalance": _run_up,
    "base": lambda case: ShakenBase(_sweep(case), acceleration=_like_force(case)),
    "tones": _orders,
    "samples": _record,
    "random": _flat,
    "shock": lambda case: Shock("half-sine", 20 * case.forces[0], 0.5 * case.model.pseudo_period(1), 60 * case.model.pseudo_period(1)),
}


def _envelope(lane: Lane) -> list[list[float]]:
    """Return least and largest displacement (mm) in equal parts of a run."""
    seen = simulate(lane.scene, lane.drive, record=Record(level=False, envelope=POINTS, samples_per_period=SAMPLES)).envelope
    assert seen is not None
    return [[float(f"{1e3 * value:.3g}") for value in row] for row in (seen.low, seen.high)]


def kind_rows(case: Case, kind: str, settings: Settings) -> list[Json]:
    """Return what is left of the measure with a gap of `START` times the free motion's size, and envelopes of the first member."""
    part = KINDS[kind](case)
    loads = Loads((part,), float(case.model.omega[0]))
    none, drives = Scene(case.model), drives_of(draw_members(settings.members, 0), loads)
    gap = START * free_size(Lane(none, loads))
    with_one = Scene(case.model, impact_absorber(gap, RESTITUTION, None, MASS_RATIO))
    found = each_lane([Lane(scene, drive) for scene in (none, with_one) for drive in drives], measured)
    if None in found:
        raise KeyboardInterrupt
    values = np.array(found, dtype=np.float64).reshape(2, -1)
    return [
        {
            "structure": case.name, "kind": kind, "measure": measure_of(loads), "duration_s": part.duration, "gap_m": gap,
            "free": values[0].tolist(), "ratio": (values[1] / values[0]).tolist(),
            "envelopes_mm": [_envelope(Lane(scene, loads)) for scene in (none, with_one)],
        }
    ]  # fmt: skip


def kinds_text(rows: Sequence[Json]) -> str:
    """Return a table with a line for each kind and structure."""
    units = {"level": (1e3, "mm"), "rms": (1e3, "mm"), "decay": (1.0, "s")}
    lines = []
    for row in rows:
        factor, unit = units[row["measure"]]
        free = f"{factor * np.median(row['free']):.3g} {unit}"
        lines.append((row["structure"], row["kind"], row["measure"], free, f"{1e3 * row['gap_m']:.3g} mm", band_text(row["ratio"])))
    return markdown(("structure", "kind", "measure", "without absorber", "gap", "impact absorber leaves"), lines)
