"""The strongly modulated response of one mode (paper, section 3.2, its figure SMR).

The contact has no losses.
"""

from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from impact_env import (
    Beam,
    ModalModel,
    RigidWalls,
    Scene,
    beam_scene,
    constant_frequency,
    impact_absorber,
    modal_model,
    simulate,
)
from impact_env.energy import mechanical_energy
from impact_env.ensemble import Lane, draw_members
from impact_env.frequency import tip_response
from impact_env.methods import Exact, Method, Moreau
from impact_env.periodic.stationary import modulation_depth
from impact_env.phase_lag import phase_lag
from impact_env.results import DEFAULT_SAMPLES
from optimisation.files import markdown
from studies.paper.claim import (
    LEFT,
    Claim,
    compute_band,
    format_spread,
    judge_interval,
    make_claim,
    range_about,
)
from studies.paper.curve import SERIES
from studies.paper.frame import (
    FAINT,
    MM,
    REFERENCE,
    SMALL,
    STYLES,
    LineStyle,
    PaperFigure,
    PaperSettings,
    Size,
    draw_legends,
    draw_signal,
    make_panels,
    measure_groups,
)
from studies.study import Array, Json, Steps

LABEL = "SMR"
FORCE = 1.7  # N
# pseudo periods: left out, drawn, and in which the largest share is searched
SETTLING_PERIODS = 500
DRAWN_PERIODS = 30
SHARE_PERIODS = 25
NEIGHBOUR_PERIODS = (
    3  # pseudo periods to either side without a larger share than that of a transfer
)
TRANSFER = 0.8  # of the energy: a share that counts as a transfer to the absorber
METHODS: dict[str, Method] = {"exact": Exact(), "paper's step": Moreau()}
# of a beam of `MODES`, each under `FORCE` times what its free tip asks for
RESONANCES = (1, 2, 3, 4)
ANYWHERE = "other resonances"
MODES = 10
COUNTS = {  # what is counted in the periods of all members, over which edges
    "tip": np.linspace(0, 1.2e-3, 31),
    "lag, high": np.linspace(-np.pi, np.pi, 37),
    "lag, low": np.linspace(-np.pi, np.pi, 37),
    "impacts, high": np.arange(-0.5, 7.5),
    "impacts, low": np.arange(-0.5, 7.5),
    "share": np.linspace(0.5, 1.0, 26),
}


def make_scene() -> Scene:
    """Return one mode of the paper's beam with its absorber, conservative."""
    return beam_scene(Beam(modes=1), impact_absorber())


def measure_modulation(lane: Lane, method: Method, periods: int) -> Json:
    """Return the stationary motion of a lane.

    The result has numbers of all its ``periods``, computed by the given method, and its first
    periods as a record.

    The thirds "high" and "low" are the periods with the largest and the smallest tip displacements.
    """
    response = simulate(lane.scene, lane.drive, method, record=SERIES)
    history = response.recorded.history
    first = SETTLING_PERIODS * DEFAULT_SAMPLES
    rows = slice(first, first + periods * DEFAULT_SAMPLES)
    energy = mechanical_energy(lane.scene, history)
    displacement = history.tip_displacement[rows]
    lag, share, tip = (
        each.reshape(periods, -1)
        for each in (phase_lag(history)[rows], energy.absorber_share[rows], np.abs(displacement))
    )
    when = response.recorded.impacts.time / lane.drive.schedule.pseudo_period - SETTLING_PERIODS
    impacts = np.histogram(when, np.arange(periods + 1))[0]
    spacing = np.diff(when)
    period_of_spacing = np.floor(when[:-1]).astype(int)
    lags = np.angle(np.exp(1j * lag).mean(axis=1))
    peaks = tip.max(axis=1)
    order = np.argsort(tip.max(axis=1))
    thirds = {"low": order[: periods // 3], "high": order[-(periods // 3) :]}
    largest = _largest(share.ravel(), periods)
    counted = {"tip": peaks, "share": np.array(largest)} | {
        f"lag, {name}": lags[k] for name, k in thirds.items()
    }
    counted |= {f"impacts, {name}": impacts[k] for name, k in thirds.items()}
    # size of the lag (rad) at the instants at which the absorber's energy is in its largest third,
    # over that at all of them
    absorber = energy.absorber[rows]
    size = np.abs(np.angle(np.exp(1j * lag.ravel())))
    most = absorber > np.quantile(absorber, 2 / 3)
    return {
        "depth": modulation_depth(peaks),
        "rms_m": float(np.sqrt(np.mean(displacement**2))),
        "impacts": {name: float(np.mean(impacts[k])) for name, k in thirds.items()},
        "spacing_spread": {
            name: compute_relative_spread(spacing[np.isin(period_of_spacing, k)])
            for name, k in thirds.items()
        },
        "lag": {name: float(np.median(np.abs(lags[k]))) for name, k in thirds.items()},
        "lag_width": {
            name: float(np.quantile(lags[k], 0.95) - np.quantile(lags[k], 0.05))
            for name, k in thirds.items()
        },
        "lag_at_transfer": float(np.median(np.abs(lag[share > TRANSFER]))),
        "lag_at_all": float(np.median(np.abs(lag))),
        "lag_at_energy": float(np.mean(size[most]) / np.mean(size)),
        "energy_and_lag": float(
            np.corrcoef(absorber.reshape(periods, -1).mean(axis=1), np.abs(lags))[0, 1]
        ),
        "share": largest,
        "waits": _waits(share.max(axis=1)),
        "counts": {
            name: np.histogram(counted[name], edges)[0].tolist() for name, edges in COUNTS.items()
        },
        "record": _record(
            tip_m=displacement,
            absorber_m=history.absorber_displacement[rows],
            lag_rad=lag.ravel(),
            modal_j=energy.modal[rows, 0],
            absorber_j=absorber,
        ),
    }


def compute_relative_spread(spacing: Array) -> float:
    """Return the standard deviation of the times between impacts over their mean.

    It is 0 for a regular sequence and 1 for a Poisson process.
    """
    return float(np.std(spacing) / np.mean(spacing))


def _largest(share: Array, periods: int) -> list[float]:
    """Return the absorber's largest share in each `SHARE_PERIODS` of so many pseudo periods."""
    return (
        share[: periods // SHARE_PERIODS * SHARE_PERIODS * DEFAULT_SAMPLES]
        .reshape(-1, SHARE_PERIODS * DEFAULT_SAMPLES)
        .max(axis=1)
        .tolist()
    )


def _waits(share: Array) -> list[int]:
    """Return the pseudo periods between energy transfers.

    A transfer is a share above `TRANSFER` that is the largest within `NEIGHBOUR_PERIODS` to either
    side.
    """
    high = [int(k) for k in np.flatnonzero(share > TRANSFER)]
    at = [
        k
        for k in high
        if k
        == max(0, k - NEIGHBOUR_PERIODS)
        + int(np.argmax(share[max(0, k - NEIGHBOUR_PERIODS) : k + NEIGHBOUR_PERIODS + 1]))
    ]
    return [later - sooner for sooner, later in pairwise(at)]


def _record(**rows: Array) -> Json:
    """Return the first periods, to 5 digits."""
    return {
        name: [float(f"{x:.5g}") for x in values[: DRAWN_PERIODS * DEFAULT_SAMPLES]]
        for name, values in rows.items()
    }


def _members(settings: PaperSettings, size: Size, name: str) -> Json:
    """Return the numbers of all members by one of the `METHODS`, and the record of the first.

    The first member is the paper's own run.
    """
    own = make_scene()
    schedule = constant_frequency(
        own.model.resonance_omega(1), 1.0, SETTLING_PERIODS + size.periods
    )
    lanes = [
        Lane(own, drive)
        for drive in draw_members(size.members, settings.seed).drives(FORCE, schedule)
    ]
    result = settings.each(
        f"{LABEL}: {name}",
        lanes,
        partial(measure_modulation, method=METHODS[name], periods=size.periods),
        METHODS[name],
    )
    counts = {
        what: np.sum([one["counts"][what] for one in result], axis=0).tolist() for what in COUNTS
    }
    several = {key: [x for one in result for x in one[key]] for key in ("share", "waits")}
    selection = {
        key: [one[key] for one in result]
        for key in result[0]
        if key not in ("counts", "record", *several)
    }
    return {**selection, **several, "counts": counts, "record": result[0]["record"]}


def measure_shares(lane: Lane, periods: int) -> list[float]:
    """Return the absorber's largest share of the energy in each `SHARE_PERIODS` of a lane.

    The intervals cover ``periods`` after the lane has become stationary.
    """
    history = simulate(lane.scene, lane.drive, record=SERIES).recorded.history
    return _largest(
        mechanical_energy(lane.scene, history).absorber_share[SETTLING_PERIODS * DEFAULT_SAMPLES :],
        periods,
    )


def _elsewhere(settings: PaperSettings, size: Size) -> list[Json]:
    """Return the largest energy shares of the absorber at several resonances of the beam.

    The model has the resonant mode alone.
    """
    members, periods = size.elsewhere
    whole = modal_model(Beam(modes=MODES))
    drawn = draw_members(members, settings.seed)
    rows = []
    for resonance in RESONANCES:
        k = slice(resonance - 1, resonance)
        model = ModalModel(
            whole.omega[k],
            whole.damping_ratio[k],
            whole.force_shape[k],
            whole.tip_shape[k],
            whole.beam_mass,
        )
        force = FORCE * _filling(model) / _filling(make_scene().model)
        drives = drawn.drives(
            force, constant_frequency(model.resonance_omega(1), 1.0, SETTLING_PERIODS + periods)
        )
        lanes = [Lane(Scene(model, impact_absorber()), drive) for drive in drives]
        result = settings.each(
            f"{LABEL}: resonance {resonance}", lanes, partial(measure_shares, periods=periods)
        )
        rows.append(
            {"resonance": resonance, "force_n": force, "share": [x for one in result for x in one]}
        )
    return rows


def _filling(model: ModalModel) -> float:
    """Return the force in N at which the free tip fills the gap."""
    return RigidWalls.gap / _free_tip(model)


def _free_tip(model: ModalModel) -> float:
    """Return the tip's amplitude in m/N at the first resonance without absorber."""
    return float(np.abs(tip_response(model, None, np.array([model.resonance_omega(1)])))[0])


def _measure(settings: PaperSettings, size: Size, earlier: Json) -> Steps:
    groups: dict[str, Callable[[], object]] = {
        "linear": lambda: {
            "amplitude_m": FORCE * _free_tip(make_scene().model),
            "gap_m": RigidWalls.gap,
        }
    }
    groups |= {name: partial(_members, settings, size, name) for name in METHODS} | {
        ANYWHERE: partial(_elsewhere, settings, size)
    }
    return measure_groups(groups, earlier)


def _describe(values: Json) -> str:
    lines = []
    for name in METHODS:
        part = values[name]
        thirds = [
            format_spread(_third(part, what, third))
            for what in ("impacts", "lag")
            for third in ("high", "low")
        ]
        lines.append(
            (
                name,
                *thirds,
                format_spread(part["share"]),
                format_spread(part["waits"], "{:.0f}"),
                format_spread(part["depth"]),
            )
        )
    columns = (
        "impacts a period, high third",
        "low third",
        "lag, rad, high third",
        "low third",
        "largest share in 25 periods",
        "periods between transfers",
    )
    return markdown(("method", *columns, "modulation depth"), lines)


def _third(part: Json, what: str, name: str) -> list[float]:
    return [one[name] for one in part[what]]


def _draw(values: Json) -> Figure:
    """Draw the paper's own run to the left, and distributions over all members to the right."""
    figure, axes = make_panels(4, 2, 8.0, "aebfcgdh", width_ratios=(2.4, 1))
    exact = values["exact"]
    step = values["paper's step"]
    _draw_record(axes[:, 0], exact["record"], values["linear"]["gap_m"])
    methods = {"exact": exact["counts"], "paper's step": step["counts"]}
    counts = exact["counts"]
    tips, shares = ({name: one[what] for name, one in methods.items()} for what in ("tip", "share"))
    lags, impacts = (
        {f"{third} third": counts[f"{what}, {third}"] for third in ("high", "low")}
        for what in ("lag", "impacts")
    )
    columns = (
        (1e3 * COUNTS["tip"], tips, "largest tip of a period, mm"),
        (COUNTS["lag, high"], lags, "lag of a period, rad"),
        (COUNTS["impacts, high"], impacts, "impacts in a period"),
        (COUNTS["share"], shares, "largest share in 25 periods"),
    )
    for own, (edges, numbers, label) in zip(axes[:, 1], columns, strict=True):
        for style, (name, number) in zip(STYLES, numbers.items(), strict=False):
            own.stairs(
                np.array(number) / max(1, np.sum(number)),
                edges,
                color=style.colour,
                ls=style.dashes,
                lw=1.1,
                label=name,
            )
        own.set(xlabel=label, ylabel="share of all", ylim=(0, 1.4 * own.dataLim.y1))
        own.legend(loc="upper left", fontsize=SMALL)
    draw_legends(axes[:, 0])
    return figure


def _draw_record(axes: Any, record: Json, gap: float) -> None:
    period = np.arange(len(record["tip_m"])) / DEFAULT_SAMPLES
    tip, absorber, modal, absorbed = (
        1e3 * np.array(record[name]) for name in ("tip_m", "absorber_m", "modal_j", "absorber_j")
    )
    for side in (-1, 1):
        draw_signal(
            axes[0],
            period,
            tip + side * MM * gap,
            LineStyle(FAINT),
            "cavity walls" if side > 0 else None,
            0.5,
        )
    draw_signal(axes[0], period, tip, STYLES[0], "tip", 0.9)
    draw_signal(axes[0], period, absorber, STYLES[1], "absorber", 0.9)
    axes[0].set_ylabel("displacement, mm")
    lag = np.array(record["lag_rad"])
    visible = np.where(np.abs(np.diff(lag, prepend=lag[0])) > np.pi, np.nan, lag)
    draw_signal(axes[1], period, visible, STYLES[0], "Hilbert phase lag")
    turns = np.angle(np.exp(1j * lag).reshape(-1, DEFAULT_SAMPLES).mean(axis=1))
    axes[1].plot(
        np.arange(len(turns)) + 0.5,
        turns,
        "o",
        ms=3,
        color=STYLES[1].colour,
        label="mean of a period",
    )
    axes[1].set(
        ylabel="lag of the absorber, rad",
        ylim=(-np.pi, 1.5 * np.pi),
        yticks=(-np.pi, 0, np.pi),
        yticklabels=(r"$-\pi$", "0", r"$\pi$"),
    )
    for energy, style, name in (
        (modal, STYLES[0], "first mode"),
        (absorbed, STYLES[1], "absorber"),
        (modal + absorbed, REFERENCE, "both"),
    ):
        draw_signal(axes[2], period, energy, style, name, 0.9)
    axes[2].set_ylabel("energy, mJ")
    axes[3].fill_between(
        period, absorbed / (modal + absorbed), color=STYLES[1].colour, alpha=0.5, lw=0
    )
    axes[3].axhline(0.9, color="black", ls=":", lw=0.8, label="90 %")
    axes[3].set(ylabel="absorber's share", ylim=(0, 1.2), xlabel="pseudo periods")
    for own in (axes[0], axes[2]):
        low, high = own.get_ylim()
        own.set_ylim(low, high + 0.2 * (high - low))
    for own in axes:
        own.set_xlim(period[0], period[-1])
        own.legend(loc="upper right", ncols=3, fontsize=SMALL)


def compute_stiffening(relative: Array) -> Array:
    """Return the stiffness ratio x that gives one mode a relative amplitude.

    ``relative`` is the amplitude at the old resonance over the old amplitude there, without
    absorber.

    The damping ratio D is kept: (x - 1)^2 + (2D)^2 x = (2D/relative)^2.
    """
    doubled = 2 * make_scene().model.damping_ratio[0]
    half = 1 - doubled**2 / 2
    return np.asarray(half + np.sqrt(half**2 - 1 + (doubled / relative) ** 2))


def _claims(values: Json) -> list[Claim]:
    """Return the statements that this figure decides."""
    exact = values["exact"]
    step = values["paper's step"]
    thirds = (
        [_third(exact, what, name) for name in ("high", "low")]
        for what in ("impacts", "lag", "lag_width")
    )
    (high, low), (lag, lags), (width, widths) = thirds
    relative = np.array(exact["rms_m"]) * np.sqrt(2) / values["linear"]["amplitude_m"]
    near = LEFT * np.pi
    regular, irregular = (
        np.array(_third(exact, "spacing_spread", name)) for name in ("high", "low")
    )
    stiffening = compute_stiffening(relative)
    rows = values[ANYWHERE]
    ends = np.array([compute_band(row["share"]) for row in rows])
    each = ", ".join(
        f"{format_spread(row['share'], '{:.0f}', 100)} % at the {row['resonance']}." for row in rows
    )
    judge = partial(make_claim, LABEL)
    return [
        judge("two impacts in the burst", high, step=_third(step, "impacts", "high")),
        judge("fewer impacts between", np.array(low) / np.array(high), low=low, high=high),
        judge(
            "less regular between",
            irregular / regular,
            low=irregular,
            high=regular,
            share=float(np.mean(irregular > regular)),
        ),
        judge("lag near zero", lag, (0.0, near), width=width, near=near),
        judge("lag arbitrary", widths, range_about(0.9 * 2 * np.pi), size=lags),
        judge("ninety per cent", exact["share"], step=step["share"]),
        judge(
            "transfer during capture", exact["lag_at_energy"], correlation=exact["energy_and_lag"]
        ),
        judge(
            "transfer at any frequency",
            judge_interval(ends[:, 0].min(), ends[:, 1].max(), *range_about(0.9)),
            each=each,
        ),
        judge("effective at resonance", relative, depth=exact["depth"]),
        judge("linear design", stiffening, stiffer=stiffening - 1),
    ]


FIGURE = PaperFigure(
    LABEL,
    "the strongly modulated response",
    measure=_measure,
    describe=_describe,
    draw=_draw,
    claims=_claims,
    # pseudo periods of each member after it has settled; elsewhere: members and periods at each of
    # the other resonances
    sizes=(
        Size(members=32, periods=2000, elsewhere=(4, 500)),
        Size(members=4, periods=500, elsewhere=(2, 100)),
    ),
)
