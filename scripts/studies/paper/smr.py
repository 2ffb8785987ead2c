"""The strongly modulated response of one mode without losses at its contact (paper, section 3.2, its figure SMR)."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from impact_env.drive import constant_frequency
from impact_env.energy import mechanical_energy
from impact_env.ensemble import Lane, draw_members
from impact_env.frequency import tip_response
from impact_env.methods import Exact, Method, Moreau
from impact_env.modes import ModalModel, modal_model
from impact_env.parameters import Beam, RigidWalls, impact_absorber
from impact_env.periodic.stationary import modulation_depth
from impact_env.phase_lag import phase_lag
from impact_env.response import DEFAULT_SAMPLES, History, Record
from impact_env.scene import Scene, beam_scene
from impact_env.sweep import simulate
from optimisation.page import markdown
from studies.paper.claim import LEFT, MUCH, Claim, about, judged, middle, spread
from studies.paper.frame import PaperFigure, Settings, has, in_turn
from studies.paper.style import FAINT, LOOKS, MM, REFERENCE, legends, panels, signal
from studies.study import Json, Steps

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


class Sizes(NamedTuple):
    """Members, and pseudo periods of each that are looked at; and both at each of the other resonances."""

    members: int
    periods: int
    elsewhere: tuple[int, int]


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
        # size of the lag (rad) at the instants at which the absorber's energy is in its largest third, over that at all of them
        size, most = np.abs(np.angle(np.exp(1j * lag.ravel()))), energy.absorber[rows] > np.quantile(energy.absorber[rows], 2 / 3)
        return {
            "depth": modulation_depth(peaks),
            "rms_m": float(np.sqrt(np.mean(history.tip_displacement[rows] ** 2))),
            "impacts": {name: float(np.mean(impacts[k])) for name, k in thirds.items()},
            "lag": {name: float(np.median(np.abs(lags[k]))) for name, k in thirds.items()},
            "lag_width": {name: float(np.quantile(lags[k], 0.95) - np.quantile(lags[k], 0.05)) for name, k in thirds.items()},
            "lag_at_transfer": float(np.median(np.abs(lag[share > TRANSFER]))),
            "lag_at_all": float(np.median(np.abs(lag))),
            "lag_at_energy": float(np.mean(size[most]) / np.mean(size)),
            "energy_and_lag": float(np.corrcoef(energy.absorber[rows].reshape(self.periods, -1).mean(axis=1), np.abs(lags))[0, 1]),
            "share": largest.tolist(),
            "waits": _waits(share.max(axis=1)),
            "counts": {name: np.histogram(counted[name], edges)[0].tolist() for name, edges in COUNTS.items()},
            "record": _record(history, first, lag, energy.modal[rows, 0], energy.absorber[rows]),
        }


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


def _members(settings: Settings, size: Sizes, name: str) -> Json:
    """Return the numbers of all members by one of the `METHODS`, and the record of the first, the paper's own run."""
    own = scene()
    schedule = constant_frequency(own.model.resonance_omega(1), 1.0, SETTLE + size.periods)
    lanes = [Lane(own, drive) for drive in draw_members(size.members, settings.seed).drives(FORCE, schedule)]
    found = settings.each(f"{LABEL}: {name}", lanes, Modulated(METHODS[name], size.periods), METHODS[name])
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


def _elsewhere(settings: Settings, size: Sizes) -> list[Json]:
    """Return the largest shares in the absorber with the resonant mode alone, at each of several resonances of the beam."""
    members, periods = size.elsewhere
    whole, drawn, rows = modal_model(Beam(modes=MODES)), draw_members(members, settings.seed), []
    for resonance in RESONANCES:
        k = slice(resonance - 1, resonance)
        model = ModalModel(whole.omega[k], whole.damping_ratio[k], whole.force_shape[k], whole.tip_shape[k], whole.beam_mass)
        own = Scene(model, impact_absorber())
        free = [RigidWalls.gap / _free_tip(each) for each in (model, scene().model)]  # N at which the free tip fills the gap
        force = FORCE * free[0] / free[1]
        schedule = constant_frequency(model.resonance_omega(1), 1.0, SETTLE + periods)
        found = settings.each(f"{LABEL}: resonance {resonance}", [Lane(own, drive) for drive in drawn.drives(force, schedule)], Shares(periods))
        rows.append({"resonance": resonance, "force_n": force, "share": [x for one in found for x in one]})
    return rows


def _free_tip(model: ModalModel) -> float:
    """Return the tip's amplitude in m/N at the first resonance without absorber."""
    return float(np.abs(tip_response(model, None, np.array([model.resonance_omega(1)])))[0])


def _measure(settings: Settings, size: Sizes, known: Json) -> Steps:
    groups: dict[str, Callable[[], Any]] = {name: partial(_members, settings, size, name) for name in METHODS}
    return in_turn(
        {
            "linear": lambda: {"amplitude_m": FORCE * _free_tip(scene().model), "gap_m": RigidWalls.gap},
            **groups,
            ANYWHERE: partial(_elsewhere, settings, size),
        },
        known,
    )


def _words(values: Json) -> str:
    lines = []
    for name in METHODS:
        if name in values:
            part = values[name]
            impacts, lag = ([spread([one[third] for one in part[what]], "{:.2f}") for third in ("high", "low")] for what in ("impacts", "lag"))
            lines.append((name, *impacts, *lag, spread(part["share"], "{:.2f}"), spread(part["waits"], "{:.0f}"), spread(part["depth"], "{:.2f}")))
    columns = (
        "impacts a period, high third", "low third", "lag, rad, high third", "low third", "largest share in 25 periods", "periods between transfers",
    )  # fmt: skip
    return markdown(("method", *columns, "modulation depth"), lines)


def _draw(values: Json) -> Figure:
    """Draw the paper's own run to the left, and distributions over all members to the right."""
    figure, axes = panels(4, 2, 8.0, "aebfcgdh", width_ratios=(2.4, 1))
    exact, step = values["exact"], values["paper's step"]
    _draw_record(axes[:, 0], exact["record"], values["linear"]["gap_m"])
    _bars(axes[0, 1], 1e3 * COUNTS["tip"], {"exact": exact["counts"]["tip"], "paper's step": step["counts"]["tip"]})
    axes[0, 1].set_xlabel("largest tip of a period, mm")
    for own, what, label in ((axes[1, 1], "lag", "lag of a period, rad"), (axes[2, 1], "impacts", "impacts in a period")):
        _bars(own, COUNTS[f"{what}, high"], {f"{third} third": exact["counts"][f"{what}, {third}"] for third in ("high", "low")})
        own.set_xlabel(label)
    _bars(axes[3, 1], COUNTS["share"], {"exact": exact["counts"]["share"], "paper's step": step["counts"]["share"]})
    axes[3, 1].set_xlabel("largest share in 25 periods")
    for own in axes[:, 1]:
        own.set(ylabel="share of all", ylim=(0, 1.4 * own.dataLim.y1))
        own.legend(loc="upper left", fontsize=6.5)
    legends(axes[:, 0])
    return figure


def _draw_record(axes: Any, record: Json, gap: float) -> None:
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


SECTION = "3.2"


def _claims(values: Json) -> list[Claim]:
    """Return the statements that this figure decides."""
    exact, step, linear = (values[name] for name in ("exact", "paper's step", "linear"))
    return [*_rhythm(exact, step), *_lag(exact), *_energy(exact, step), _anywhere(values["other resonances"]), _level(exact, linear)]


def _third(part: Json, what: str, name: str) -> list[float]:
    return [one[name] for one in part[what]]


def _rhythm(exact: Json, step: Json) -> list[Claim]:
    high, low = (_third(exact, "impacts", name) for name in ("high", "low"))
    coarse = _third(step, "impacts", "high")
    fewer = middle(np.array(low) / np.array(high))
    return [
        Claim("two impacts in the burst", "where amplitudes are high, about two impacts a period", SECTION,
              f"{spread(high, '{:.2f}')} in the third of periods with the largest; at the paper's step {spread(coarse, '{:.2f}')}",
              judged(*middle(high), *about(2.0)), LABEL, "There are more of them, since the absorber strikes a wall twice in some periods."),
        Claim("fewer impacts between", "where amplitudes are low, impacts are less frequent", SECTION,
              f"{spread(low, '{:.2f}')} in the third with the smallest, against {spread(high, '{:.2f}')}", judged(*fewer, 0.0, 1.0), LABEL,
              "They are as frequent there."),
    ]  # fmt: skip


def _lag(exact: Json) -> list[Claim]:
    high, low = (_third(exact, "lag", name) for name in ("high", "low"))
    wide, wider = (np.array(_third(exact, "lag_width", name)) for name in ("high", "low"))
    return [
        Claim("lag near zero", "where amplitudes are high, the phase lag approaches zero", SECTION,
              f"size of a period's lag {spread(high, '{:.2f}')} rad; 90 % of periods within {spread(wide, '{:.1f}')} rad",
              judged(*middle(high), 0.0, LEFT * np.pi), LABEL,
              f"Its size in the median period; a tenth of pi, {LEFT * np.pi:.2f} rad, counts as close to zero."),
        Claim("lag arbitrary", "where amplitudes are low, the phase lag takes arbitrary values", SECTION,
              f"size {spread(low, '{:.2f}')} rad; 90 % of periods within {spread(wider, '{:.1f}')} rad (arbitrary: 5.7)",
              judged(*middle(wider), *about(0.9 * 2 * np.pi)), LABEL,
              "Arbitrary would be evenly from -pi to pi. In some members it prefers a side."),
    ]  # fmt: skip


def _energy(exact: Json, step: Json) -> list[Claim]:
    return [
        Claim("ninety per cent", "up to 90 % of the mechanical energy is in the absorber for a while", SECTION,
              f"largest share in 25 pseudo periods {spread(exact['share'], '{:.0f}', 100)} %; at the paper's step "
              f"{spread(step['share'], '{:.0f}', 100)} %", judged(*middle(exact["share"]), *about(0.9)), LABEL,
              "In some stretches of 25 pseudo periods the largest share stays lower."),
        Claim(
            "every twelve periods", "the transfer comes again, after about 12 pseudo periods (at 8 and 20)", SECTION,
            f"{spread(exact['waits'], '{:.0f}')} pseudo periods between shares above 80 %", judged(*middle(exact["waits"]), *about(12.0)), LABEL,
            "The response is chaotic: the wait is of that size, but from one transfer to the next it varies severalfold. Two transfers of one record "
            "do not show a period.",
        ),
        Claim("transfer during capture", "the span of effective transfer coincides with that of a lag near zero", SECTION,
              f"mean size of the lag while the absorber's energy is in its highest third over that at all times "
              f"{spread(exact['lag_at_energy'], '{:.2f}')}; correlation of energy and size {spread(exact['energy_and_lag'], '{:.2f}')}",
              judged(*middle(exact["lag_at_energy"]), 0.0, MUCH), LABEL, "The lag is no smaller then."),
    ]  # fmt: skip


def _anywhere(rows: list[Json]) -> Claim:
    shares = [spread(row["share"], "{:.0f}", 100) for row in rows]
    said = ", ".join(f"{share} % at the {row['resonance']}." for share, row in zip(shares, rows, strict=True))
    low, high = (each(middle(row["share"])[k] for row in rows) for k, each in ((0, min), (1, max)))
    return Claim("transfer at any frequency", "the transfer of energy to the absorber can take place at any frequency", SECTION,
                 f"largest share in 25 pseudo periods at the beam's resonances, each mode alone under 1.7 N scaled as its free tip asks: {said}",
                 judged(low, high, *about(0.9)), LABEL, "In some stretches of 25 pseudo periods the largest share stays lower.")  # fmt: skip


def _level(exact: Json, linear: Json) -> Claim:
    relative = np.array(exact["rms_m"]) * np.sqrt(2) / linear["amplitude_m"]
    return Claim("effective at resonance", "without any loss but that of one mode, the absorber is particularly effective at omega_1", SECTION,
                 f"RMS {spread(relative, '{:.0f}', 100)} % of that without absorber, modulation depth {spread(exact['depth'], '{:.2f}')}",
                 judged(*middle(relative), 0.0, MUCH), LABEL, "The RMS is not that low in all members.")  # fmt: skip


FIGURE = PaperFigure(
    LABEL, "the strongly modulated response", measure=_measure, words=_words, draw=_draw, claims=_claims, needs=has(*METHODS),
    sizes=(Sizes(32, 2000, (4, 500)), Sizes(4, 500, (2, 100))),
)  # fmt: skip
