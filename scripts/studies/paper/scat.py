"""The figure `scat`: the effect of many modes.

It shows the level of the sweeps at 5 N, and the motion near the resonance itself at 1.5 N.
"""

from collections.abc import Callable
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from impact_env import Beam, Scene, beam_scene, simulate
from impact_env.drive import PAPER_LIMITS, PAPER_RATE, linear_sweep
from impact_env.ensemble import Lane, draw_members
from impact_env.level import response_level
from impact_env.methods import Method, Moreau
from impact_env.results import DEFAULT_SAMPLES
from studies.paper.account import find_critical, make_lanes, make_scene, measure_energy_shares
from studies.paper.claim import LEFT, MUCH, Claim, format_spread, make_claim
from studies.paper.curve import FULL_RECORD, compute_curves, read_curve
from studies.paper.frame import (
    MM,
    SMALL,
    STYLES,
    PaperFigure,
    PaperSettings,
    Size,
    draw_band,
    draw_legends,
    draw_signal,
    draw_unit_level,
    make_panels,
    measure_groups,
    shorten_table,
)
from studies.study import Array, CsvTable, Json, Steps

LABEL = "scat"
# N
HIGH = 5.0
LOW = 1.5
NEAR_PERIODS = 130  # pseudo periods around omega_1, 0.9935 to 1.0065 of it
# from this mode on, counted from 0, the paper sees complete dissipation and a uniform distribution
SIXTH = 5
MOST_AT_STEP = 10  # modes up to which the passage is also run at the paper's step


def _measure(settings: PaperSettings, size: Size, earlier: Json) -> Steps:
    groups: dict[str, Callable[[], object]] = {
        f"level, {n}": partial(_level, settings, n, size.members) for n in size.modes
    }
    groups |= {
        f"account, {n}": partial(_account, settings, n, size.members) for n in size.accounted
    }
    groups |= {f"signal, {n}": partial(_signal, n, settings.seed) for n in size.drawn}
    return measure_groups(groups, earlier)


def make_near_lanes(own: Scene, members: int, seed: int) -> list[Lane]:
    """Return each member's sweeps at 1.5 N, up and down, that end with the passage of omega_1."""
    reference = own.model.resonance_omega(1)
    low, high = PAPER_LIMITS
    half = NEAR_PERIODS * PAPER_RATE / 100 / 100 / 2
    schedules = linear_sweep(reference, low, 1 + half), linear_sweep(reference, high, 1 - half)
    drawn = draw_members(members, seed)
    return [
        Lane(own, drawn[m : m + 1].drives(LOW, schedule)[0])
        for m in range(members)
        for schedule in schedules
    ]


def simulate_passage(lane: Lane, method: Method | None = None) -> Array:
    """Return the tip's displacement in m at the samples of the last `NEAR_PERIODS` of a sweep."""
    history = simulate(lane.scene, lane.drive, method, record=FULL_RECORD).recorded.history
    return history.tip_displacement[-(NEAR_PERIODS * DEFAULT_SAMPLES + 1) :]


def compute_near_level(lane: Lane, method: Method | None = None) -> tuple[float, float]:
    """Return the level in m of the passage at a sweep's end, and the RMS of all of it."""
    tip = simulate_passage(lane, method)
    return response_level(tip, DEFAULT_SAMPLES)[0], float(np.sqrt(np.mean(tip**2)))


def _level(settings: PaperSettings, modes: int, members: int) -> Json:
    """Return the members' levels relative to no absorber.

    They are those of the sweeps at 5 N, and of the passage of omega_1 at 1.5 N.
    """
    own = make_scene(Beam(modes=modes))
    label = f"{LABEL}, {modes} modes"
    result = compute_curves(
        settings, label, {"own": own, "none": beam_scene(Beam(modes=modes))}, (HIGH,), members
    )
    level, reference = (read_curve(result[name]).level[0] for name in ("own", "none"))
    near = np.array(
        settings.each(label, make_near_lanes(own, members, settings.seed), compute_near_level)
    )
    neighbour, whole = (
        near[:, k].reshape(members, 2) / (reference * LOW / HIGH)[:, None] for k in (0, 1)
    )
    step = read_curve(
        compute_curves(settings, label, {"own": own}, (HIGH,), 1, Moreau())["own"]
    ).level[0, 0]
    near_step = None
    if modes <= MOST_AT_STEP:  # of one run
        passages = settings.each(
            LABEL,
            make_near_lanes(own, 1, settings.seed),
            partial(compute_near_level, method=Moreau()),
            Moreau(),
        )
        near_step = max(passages)[0] / (reference[0] * LOW / HIGH)
    return {
        "relative": (level / reference).tolist(),
        "near": np.max(neighbour, axis=1).tolist(),
        "near_up": neighbour[:, 0].tolist(),
        "near_down": neighbour[:, 1].tolist(),
        "near_rms": np.max(whole, axis=1).tolist(),
        "step": float(step / reference[0]),
        "near_step": near_step,
    }


def _account(settings: PaperSettings, modes: int, members: int) -> Json:
    """Return the members' accounts at 5 N, of the critical direction."""
    own = make_scene(Beam(modes=modes))
    result = find_critical(
        settings.each(
            f"{LABEL}, energies",
            make_lanes(own, HIGH, members, settings.seed),
            measure_energy_shares,
        )
    )
    return {
        "shares": [account.shares.tolist() for account in result],
        "passed": [account.passed.tolist() for account in result],
        "left": [account.left.tolist() for account in result],
        "contacts": [account.contacts for account in result],
        "tip": [(account.tip / account.tip[0]).tolist() for account in result],
        "omega": (own.model.omega / own.model.omega[0]).tolist(),
    }


def _signal(modes: int, seed: int) -> list[float]:
    """Return the tip's displacement in m while the first member's sweep down passes omega_1."""
    return simulate_passage(make_near_lanes(make_scene(Beam(modes=modes)), 1, seed)[1]).tolist()


def find_measured_modes(values: Json, what: str) -> list[int]:
    """Return the numbers of modes for which there is a group ``what``."""
    return [int(name.split(", ")[1]) for name in values if name.startswith(f"{what}, ")]


def _levels(values: Json) -> CsvTable:
    levels = {n: values[f"level, {n}"] for n in find_measured_modes(values, "level")}
    rows = [
        (
            f"{n}",
            format_spread(x["relative"], "{:.3f}"),
            f"{x['step']:.3f}",
            format_spread(x["near_rms"], "{:.3f}"),
        )
        for n, x in levels.items()
    ]
    return CsvTable(
        f"{LABEL}_levels",
        (
            "modes",
            "level at 5 N",
            "at the paper's step",
            "around omega_1 at 1.5 N, RMS of 130 periods",
        ),
        rows,
    )


def _describe(values: Json) -> str:
    contacts = {
        n: np.median(values[f"account, {n}"]["contacts"])
        for n in find_measured_modes(values, "account")
    }
    counts = ", ".join(
        f"{number:.1f} contacts a pseudo period with {n} modes" for n, number in contacts.items()
    )
    return (
        f"e = 1, no friction, {len(values['level, 1']['relative'])} members; levels over no "
        f"absorber.\n\n{shorten_table(_levels(values))}\n\n"
        f"Where the energy goes at 5 N, {counts} (of what a contact gives to a mode above the "
        "tenth, a part is gone within it):"
        f"\n\n{shorten_table(_energies(values))}"
    )


def _energies(values: Json) -> CsvTable:
    """Return a row for each mode with its energies, for each number of modes.

    They are the energy that the mode dissipates, that it gets from a contact, and the part of it
    that is left before the next contact.
    """
    counts = find_measured_modes(values, "account")
    omega = values[f"account, {max(counts)}"]["omega"]
    columns = ["mode", "omega_i/omega_1", "left after half a period, %"]
    rows = [
        [str(i + 1), f"{ratio:.1f}", f"{100 * compute_decay(ratio):.1f}"]
        for i, ratio in enumerate(omega)
    ]
    for n in counts:
        columns += [
            f"{n} modes: dissipated, %",
            "net from a contact, % of mode 1",
            "left before the next, %",
        ]
        middles = [
            100 * np.median(np.array(values[f"account, {n}"][key]), axis=0)
            for key in ("shares", "passed", "left")
        ]
        for i, row in enumerate(rows):
            row += [
                form.format(x[i]) if i < n else ""
                for x, form in zip(middles, ("{:.1f}", "{:.2f}", "{:.1f}"), strict=True)
            ]
    return CsvTable(f"{LABEL}_energies", columns, rows)


def compute_decay(ratio: float) -> float:
    """Return the share of a mode's energy that is left after half a pseudo period.

    The mode has 1 % damping and the frequency ``ratio`` omega_1.
    """
    return float(np.exp(-2 * 0.01 * ratio * np.pi))


def _claims(values: Json) -> list[Claim]:
    """Return the verdicts on levels and losses over the number of modes."""
    modes = find_measured_modes(values, "level")
    accounts = find_measured_modes(values, "account")
    relative, near = (
        {n: np.array(values[f"level, {n}"][key]) for n in modes} for key in ("relative", "near_rms")
    )
    step = {n: values[f"level, {n}"]["step"] for n in modes}
    many = [n for n in modes if n >= 2 / 3 * modes[-1]]
    gain = 100 * (1 - np.concatenate([relative[n] for n in many]) / np.median(relative[1]))
    stepped = 100 * (1 - float(np.mean([step[n] for n in many])) / step[1])
    own, largest = (values[f"account, {accounts[k]}"] for k in (0, -1))
    shares, left, passed, tip = (np.array(own[key]) for key in ("shares", "left", "passed", "tip"))
    uneven = np.concatenate(
        [_unevenness(np.array(values[f"account, {n}"]["shares"])) for n in accounts]
    )
    complete = [
        i + 1
        for i, share in enumerate(np.median(np.array(largest["left"]), axis=0))
        if i and share < LEFT
    ]
    less = (
        f"of {accounts[-1]} modes it is as of mode {complete[0]} that less is left"
        if complete
        else f"no mode of {accounts[-1]} is left with less"
    )
    influence = np.array([np.median(near[n]) for n in modes]) / np.median(near[1])
    judge = partial(make_claim, LABEL, modes=accounts[0])
    ends = Json(first=many[0], last=many[-1])
    return [
        judge("scat_one_mode", relative[1], at_step=step[1]),
        judge("scat_reduction", gain, **ends, median=np.median(gain), at_step=stepped),
        judge(
            "scat_stabilises",
            [np.median(relative[many[-1]]) / np.median(relative[many[0]])],
            **ends,
        ),
        judge("scat_resonant_most", shares[:, 0] / np.max(shares[:, 1:], axis=1)),
        judge("scat_sum", 100 * (1 - shares[:, 0]), (100 * (1 - MUCH), 100)),
        judge(
            "scat_sixth",
            left[:, SIXTH],
            decayed=compute_decay(own["omega"][SIXTH]),
            contacts=np.median(own["contacts"]),
            less=less,
        ),
        judge("scat_uniform", uneven, accounts=" and ".join(map(str, accounts))),
        judge("scat_passed", _unevenness(passed)),
        judge("scat_near_one", near[1], periods=NEAR_PERIODS, burst=values["level, 1"]["near"]),
        judge(
            "scat_near_all",
            influence,
            first=modes[0],
            last=modes[-1],
            least=np.min(influence),
            most=np.max(influence),
        ),
        judge("scat_off_resonant", np.max(tip[:, 1:], axis=1)),
    ]


def _unevenness(rows: Array) -> Array:
    """Return the largest over the smallest value of the sixth and higher modes, (M,).

    Each member has its ratio.
    """
    high = rows[:, SIXTH:]
    return np.asarray(np.max(high, axis=1) / np.min(high, axis=1))


def _draw(values: Json) -> Figure:
    """Draw levels over the number of modes, losses by mode, and the motion of the tip.

    The motion is that near the resonance.
    """
    visible = find_measured_modes(values, "signal")
    figure, grid = make_panels(3, 2, 7.0, "abc")
    _draw_levels(grid[0, 0], values)
    _losses(grid[0, 1], values)
    for axes, modes in zip(grid[1:].flat, visible, strict=False):
        tip = MM * np.array(values[f"signal, {modes}"])
        draw_signal(axes, np.arange(len(tip)) / DEFAULT_SAMPLES - NEAR_PERIODS / 2, tip, STYLES[0])
        axes.set(
            xlim=(-NEAR_PERIODS / 2, NEAR_PERIODS / 2),
            ylim=(-1.35, 1.35),
            xlabel="pseudo periods from $\\omega_1$, 1.5 N, down",
            ylabel="tip, mm",
        )
        axes.set_title(f"{modes} mode{'s' * (modes > 1)}", fontsize=8.5)
    draw_legends(grid)
    return figure


def _draw_levels(axes: Axes, values: Json) -> None:
    modes = find_measured_modes(values, "level")
    for style, key, name in (
        (STYLES[0], "relative", "5 N, whole sweep"),
        (STYLES[1], "near_rms", "1.5 N, around $\\omega_1$"),
    ):
        draw_band(axes, modes, np.array([values[f"level, {n}"][key] for n in modes]), style, name)
    steps = [values[f"level, {n}"]["step"] for n in modes]
    axes.plot(
        modes,
        steps,
        "x",
        color=STYLES[3].colour,
        ms=4,
        zorder=5,
        label="5 N, one run, the paper's step",
    )
    draw_unit_level(axes)
    axes.set(
        xlim=(0, max(modes) + 1),
        ylim=(0, 1.5),
        xlabel="number of modes $N_m$",
        ylabel="level over no absorber",
    )


def _losses(axes: Axes, values: Json) -> None:
    small = axes.inset_axes((0.34, 0.5, 0.62, 0.38))
    for style, modes in zip(STYLES, find_measured_modes(values, "account"), strict=False):
        own = values[f"account, {modes}"]
        for place, key, first in ((axes, "shares", 0), (small, "left", 1)):
            rows = 100 * np.array(own[key]).T[first:]
            draw_band(
                place,
                np.arange(first, modes) + 1,
                rows,
                style,
                f"{modes} modes",
                nominal=False,
                marked=place is axes,
            )
    axes.legend(loc="center right", bbox_to_anchor=(1, 0.31), ncols=2)
    axes.set(ylim=(0, None), xlabel="mode", ylabel="dissipated, % of all modes")
    small.set(yscale="log", ylim=(0.03, 150))
    small.set_title("left before the next contact, %", fontsize=SMALL, pad=2)
    small.tick_params(labelsize=SMALL)


FIGURE = PaperFigure(
    LABEL,
    "the number of modes",
    measure=_measure,
    describe=_describe,
    draw=_draw,
    claims=_claims,
    tables=lambda values: (_levels(values), _energies(values)),
    # numbers of modes, those whose energies are accounted for, and those whose signals are drawn
    sizes=(
        Size(
            modes=(*range(1, 13), *range(14, 31, 2)),
            accounted=(10, 20),
            drawn=(1, 3, 10, 30),
            members=16,
        ),
        Size(modes=(1, 2, 3, 6, 10, 14), accounted=(10,), drawn=(1, 3, 10, 14), members=3),
    ),
)
