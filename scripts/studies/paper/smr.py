"""The strongly modulated response of one mode without losses at its contact (paper, section 3.2, its figure SMR)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.drive import constant_frequency
from impact_env.energy import mechanical_energy
from impact_env.ensemble import Lane, draw_members
from impact_env.frequency import tip_response
from impact_env.methods import Exact, Method, Moreau
from impact_env.modes import ModalModel, modal_model
from impact_env.parameters import Beam, impact_absorber
from impact_env.periodic.stationary import modulation_depth
from impact_env.phase_lag import phase_lag
from impact_env.response import DEFAULT_SAMPLES, History, Record
from impact_env.scene import Scene, beam_scene
from impact_env.sweep import simulate
from optimisation.report.markdown import markdown
from studies.paper.frame import figure_part, has, in_turn
from studies.paper.settings import Settings
from studies.paper.smr_claims import claims as claims
from studies.paper.words import spread
from studies.study import Json, Measured, Saver, Steps

LABEL = "SMR"
FORCE = 1.7  # N
SETTLE, SHOWN, STRETCH = 500, 30, 25  # pseudo periods: left out, drawn, and in which the largest share is looked for
HALF = 3  # pseudo periods to either side without a larger share than that of a transfer
TRANSFER = 0.8  # of the energy: a share that counts as a transfer to the absorber
METHODS: dict[str, Method] = {"exact": Exact(), "paper's step": Moreau()}
RESONANCES, ANYWHERE = (1, 2, 3, 4), "other resonances"  # of a beam of `MODES`, each under `FORCE` times what its free tip asks for
MODES = 10
COUNTS = {  # what is counted in the periods of all members, over which edges
    "tip": np.linspace(0, 1.2e-3, 31),
    "lag, high": np.linspace(-np.pi, np.pi, 37),
    "lag, low": np.linspace(-np.pi, np.pi, 37),
    "impacts, high": np.arange(-0.5, 7.5),
    "impacts, low": np.arange(-0.5, 7.5),
    "share": np.linspace(0.5, 1.0, 26),
}
Array = NDArray[np.float64]


def scene() -> Scene:
    """Return one mode of the paper's beam with its absorber, conservative."""
    return beam_scene(Beam(modes=1), impact_absorber())


def sizes(settings: Settings) -> tuple[int, int]:
    """Return members, and pseudo periods of each that are looked at."""
    return settings.size((32, 2000), (4, 500))


def parameters(settings: Settings) -> Json:
    """Return what the numbers depend on."""
    edges = {name: values.tolist() for name, values in COUNTS.items()}
    return {
        "scene": str(scene()),
        "force": FORCE,
        "periods": [SETTLE, SHOWN, STRETCH, HALF, TRANSFER],
        "sizes": sizes(settings),
        "edges": edges,
        "resonances": RESONANCES,
    }


@dataclass(frozen=True)
class Modulated:
    """What a lane does after it has settled: numbers of all its ``periods``, by the method, and its first ones as a record."""

    method: Method
    periods: int

    def __call__(self, lane: Lane) -> Json:
        """Return plain values; the thirds "high" and "low" are the periods with the largest and the smallest tip displacements."""
        response = simulate(lane.scene, lane.drive, self.method, record=Record(level=False, events=True, series=True))
        assert response.history is not None
        assert response.impacts is not None
        history, first = response.history, SETTLE * DEFAULT_SAMPLES
        rows = slice(first, first + self.periods * DEFAULT_SAMPLES)
        lag, energy = phase_lag(history)[rows].reshape(self.periods, -1), mechanical_energy(lane.scene, history)
        share = energy.absorber_share[rows].reshape(self.periods, -1)
        tip = np.abs(history.tip_displacement[rows]).reshape(self.periods, -1)
        when = response.impacts.time / lane.drive.schedule.pseudo_period - SETTLE
        impacts = np.histogram(when, np.arange(self.periods + 1))[0]
        lags, peaks, order = np.angle(np.exp(1j * lag).mean(axis=1)), tip.max(axis=1), np.argsort(tip.max(axis=1))
        thirds = {"low": order[: self.periods // 3], "high": order[-(self.periods // 3) :]}
        largest = share[: self.periods // STRETCH * STRETCH].reshape(-1, STRETCH * DEFAULT_SAMPLES).max(axis=1)
        counted = {"tip": peaks, "share": largest} | {f"lag, {name}": lags[k] for name, k in thirds.items()}
        counted |= {f"impacts, {name}": impacts[k] for name, k in thirds.items()}
        return {
            "depth": modulation_depth(peaks),
            "rms_m": float(np.sqrt(np.mean(history.tip_displacement[rows] ** 2))),
            "impacts": {name: float(np.mean(impacts[k])) for name, k in thirds.items()},
            "lag": {name: float(np.median(np.abs(lags[k]))) for name, k in thirds.items()},
            "lag_width": {name: float(np.quantile(lags[k], 0.95) - np.quantile(lags[k], 0.05)) for name, k in thirds.items()},
            "lag_at_transfer": float(np.median(np.abs(lag[share > TRANSFER]))),
            "lag_at_all": float(np.median(np.abs(lag))),
            "lag_at_energy": _lag_at_energy(lag, energy.absorber[rows]),
            "energy_and_lag": float(np.corrcoef(energy.absorber[rows].reshape(self.periods, -1).mean(axis=1), np.abs(lags))[0, 1]),
            "share": largest.tolist(),
            "waits": _waits(share.max(axis=1)),
            "counts": {name: np.histogram(counted[name], edges)[0].tolist() for name, edges in COUNTS.items()},
            "record": _record(history, first, lag, energy.modal[rows, 0], energy.absorber[rows]),
        }


def _lag_at_energy(lag: Array, absorber: Array) -> float:
    """Return the mean size of the lag (rad) at the instants at which the absorber's energy (S,) is in its largest third, over that at all of them."""
    size = np.abs(np.angle(np.exp(1j * lag.ravel())))
    return float(np.mean(size[absorber > np.quantile(absorber, 2 / 3)]) / np.mean(size))


def _waits(share: Array) -> list[int]:
    """Return the pseudo periods between transfers: the largest shares of `HALF` periods to either side, where they are above `TRANSFER`."""
    high = [int(k) for k in np.flatnonzero(share > TRANSFER)]
    at = [k for k in high if k == max(0, k - HALF) + int(np.argmax(share[max(0, k - HALF) : k + HALF + 1]))]
    return [later - sooner for sooner, later in pairwise(at)]


def _record(history: History, start: int, lag: Array, modal: Array, absorber: Array) -> Json:
    """Return the first periods, to 5 digits."""
    own = slice(start, start + SHOWN * DEFAULT_SAMPLES)
    rows = {
        "tip_m": history.tip_displacement[own],
        "absorber_m": history.absorber_displacement[own],
        "lag_rad": lag.ravel()[: SHOWN * DEFAULT_SAMPLES],
    }
    rows |= {"modal_j": modal[: SHOWN * DEFAULT_SAMPLES], "absorber_j": absorber[: SHOWN * DEFAULT_SAMPLES]}
    return {name: [float(f"{x:.5g}") for x in values] for name, values in rows.items()}


def _members(settings: Settings, name: str) -> Json:
    """Return the numbers of all members by one of the `METHODS`, and the record of the first, the paper's own run."""
    own, (members, periods) = scene(), sizes(settings)
    schedule = constant_frequency(own.model.resonance_omega(1), 1.0, SETTLE + periods)
    lanes = [Lane(own, drive) for drive in draw_members(members, settings.seed).drives(FORCE, schedule)]
    found = settings.each(f"{LABEL}: {name}", lanes, Modulated(METHODS[name], periods), METHODS[name])
    counts = {what: np.sum([one["counts"][what] for one in found], axis=0).tolist() for what in COUNTS}
    several = ("share", "waits")
    kept = {key: [one[key] for one in found] for key in found[0] if key not in ("counts", "record", *several)}
    return {**kept, **{key: [x for one in found for x in one[key]] for key in several}, "counts": counts, "record": found[0]["record"]}


@dataclass(frozen=True)
class Shares:
    """The absorber's largest share of the energy in each `STRETCH` of a lane's ``periods`` after it has settled."""

    periods: int

    def __call__(self, lane: Lane) -> list[float]:
        """Return them."""
        history = simulate(lane.scene, lane.drive, record=Record(level=False, events=True, series=True)).history
        assert history is not None
        share = mechanical_energy(lane.scene, history).absorber_share[SETTLE * DEFAULT_SAMPLES :]
        return share[: self.periods // STRETCH * STRETCH * DEFAULT_SAMPLES].reshape(-1, STRETCH * DEFAULT_SAMPLES).max(axis=1).tolist()


def _elsewhere(settings: Settings) -> list[Json]:
    """Return the largest shares in the absorber with the resonant mode alone, at each of several resonances of the beam."""
    members, periods = settings.size((4, 500), (2, 100))
    whole, drawn, rows = modal_model(Beam(modes=MODES)), draw_members(members, settings.seed), []
    for resonance in RESONANCES:
        k = slice(resonance - 1, resonance)
        model = ModalModel(whole.omega[k], whole.damping_ratio[k], whole.force_shape[k], whole.tip_shape[k], whole.beam_mass)
        own = Scene(model, impact_absorber())
        force = FORCE * _free_force(own.model) / _free_force(scene().model)
        schedule = constant_frequency(model.resonance_omega(1), 1.0, SETTLE + periods)
        found = settings.each(f"{LABEL}: resonance {resonance}", [Lane(own, drive) for drive in drawn.drives(force, schedule)], Shares(periods))
        rows.append({"resonance": resonance, "force_n": force, "share": [x for one in found for x in one]})
    return rows


def _free_force(model: ModalModel) -> float:
    """Return the force in N at which the tip fills the gap at the first resonance without absorber."""
    return 1e-3 / float(np.abs(tip_response(model, None, np.array([model.resonance_omega(1)])))[0])


def _linear() -> Json:
    own = scene()
    amplitude = FORCE * abs(complex(tip_response(own.model, None, np.array([own.model.resonance_omega(1)]))[0]))
    return {"amplitude_m": amplitude, "gap_m": 1e-3}


def _measure(settings: Settings, known: Json) -> Steps:
    groups: dict[str, Callable[[], Any]] = {name: partial(_members, settings, name) for name in METHODS}
    return in_turn({"linear": _linear, **groups, ANYWHERE: partial(_elsewhere, settings)}, known)


def _words(values: Json) -> str:
    lines = []
    for name in METHODS:
        if name in values:
            part = values[name]
            impacts, lag = ([spread([one[third] for one in part[what]], "{:.2f}") for third in ("high", "low")] for what in ("impacts", "lag"))
            lines.append((name, *impacts, *lag, spread(part["share"], "{:.2f}"), spread(part["waits"], "{:.0f}"), spread(part["depth"], "{:.2f}")))
    columns = (
        "impacts a period, high third",
        "low third",
        "lag, rad, high third",
        "low third",
        "largest share in 25 periods",
        "periods between transfers",
    )
    return markdown(("method", *columns, "modulation depth"), lines)


def _figures(measured: Measured) -> dict[str, Saver]:
    if not has(measured.values, *METHODS):
        return {}
    from studies.paper.figures import smr  # matplotlib is slow to import

    return {LABEL: lambda path: smr.save(path, measured.values, COUNTS)}


PART = figure_part(LABEL, "the strongly modulated response", _measure, _words, _figures)
