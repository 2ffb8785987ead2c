"""The figure `scat`: what many modes do, at 5 N for the level of the sweeps and at 1.5 N near the resonance itself."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from impact_env.drive import PAPER_LIMITS, PAPER_RATE, linear_sweep
from impact_env.ensemble import Lane, draw_members
from impact_env.level import response_level
from impact_env.methods import Method, Moreau
from impact_env.modes import ModalModel
from impact_env.parameters import Beam
from impact_env.response import DEFAULT_SAMPLES
from impact_env.scene import beam_scene
from impact_env.sweep import simulate
from studies.paper.account import accounted, critical, lanes_of, scene
from studies.paper.claim import EVEN, INFINITY, LEFT, LITTLE, MUCH, SAME, Claim, about, claim, spread, within
from studies.paper.curve import WATCHED, curve_of, curves
from studies.paper.frame import PaperFigure, Settings, in_turn, shortened
from studies.paper.style import LOOKS, MM, REFERENCE, legends, line, panels, signal
from studies.study import Json, Steps, Table

LABEL = "scat"
Array = NDArray[np.float64]
HIGH, LOW = 5.0, 1.5  # N
NEAR_PERIODS = 130  # pseudo periods around omega_1, 0.9935 to 1.0065 of it
SIXTH = 5  # from this mode on, counted from 0, the paper sees complete dissipation and a uniform distribution
MOST_AT_STEP = 10  # modes up to which the passage is also run at the paper's step


class Sizes(NamedTuple):
    """How much to compute: numbers of modes, those whose energies are accounted for, those whose signals are shown, and members."""

    modes: tuple[int, ...]
    accounted: tuple[int, ...]
    shown: tuple[int, ...]
    members: int


def _measure(settings: Settings, size: Sizes, known: Json) -> Steps:
    groups: dict[str, Callable[[], object]] = {f"level, {n}": partial(_level, settings, n, size.members) for n in size.modes}
    groups |= {f"account, {n}": partial(_account, settings, n, size.members) for n in size.accounted}
    groups |= {f"signal, {n}": partial(_signal, n, settings.seed) for n in size.shown}
    return in_turn(groups, known)


def near_lanes(model: ModalModel, lane: Callable[..., Lane], members: int, seed: int) -> list[Lane]:
    """Return each member's sweeps at 1.5 N, up and down, that end with the passage of omega_1."""
    reference, (low, high), half = model.resonance_omega(1), PAPER_LIMITS, NEAR_PERIODS * PAPER_RATE / 100 / 100 / 2
    schedules = linear_sweep(reference, low, 1 + half), linear_sweep(reference, high, 1 - half)
    drawn = draw_members(members, seed)
    return [lane(drive=drawn[m : m + 1].drives(LOW, schedule)[0]) for m in range(members) for schedule in schedules]


def passage(lane: Lane, method: Method | None = None) -> Array:
    """Return the tip's displacement in m at the samples of the last `NEAR_PERIODS` of a sweep."""
    history = simulate(lane.scene, lane.drive, method, record=WATCHED).history
    assert history is not None
    return history.tip_displacement[-(NEAR_PERIODS * DEFAULT_SAMPLES + 1) :]


def near_level(lane: Lane, method: Method | None = None) -> tuple[float, float]:
    """Return the level in m of the passage at a sweep's end, and the RMS of all of it."""
    tip = passage(lane, method)
    return response_level(tip, DEFAULT_SAMPLES)[0], float(np.sqrt(np.mean(tip**2)))


def _level(settings: Settings, modes: int, members: int) -> Json:
    """Return the members' levels over no absorber: of the sweeps at 5 N, and of the passage of omega_1 at 1.5 N."""
    own, none = scene(Beam(modes=modes)), beam_scene(Beam(modes=modes))
    label = f"{LABEL}, {modes} modes"
    found = curves(settings, label, {"own": own, "none": none}, (HIGH,), members)
    level, reference = (curve_of(found[name]).level[0] for name in ("own", "none"))
    near = np.array(settings.each(label, near_lanes(own.model, partial(Lane, own), members, settings.seed), near_level))
    beside, whole = (near[:, k].reshape(members, 2) / (reference * LOW / HIGH)[:, None] for k in (0, 1))
    step, near_step = curve_of(curves(settings, label, {"own": own}, (HIGH,), 1, Moreau())["own"]).level[0, 0], None
    if modes <= MOST_AT_STEP:  # of one run
        passages = settings.each(LABEL, near_lanes(own.model, partial(Lane, own), 1, settings.seed), partial(near_level, method=Moreau()), Moreau())
        near_step = max(passages)[0] / (reference[0] * LOW / HIGH)
    return {
        "relative": (level / reference).tolist(),
        "near": np.max(beside, axis=1).tolist(),
        "near_up": beside[:, 0].tolist(),
        "near_down": beside[:, 1].tolist(),
        "near_rms": np.max(whole, axis=1).tolist(),
        "step": float(step / reference[0]),
        "near_step": near_step,
    }


def _account(settings: Settings, modes: int, members: int) -> Json:
    """Return the members' accounts at 5 N, of the critical direction."""
    found = critical(settings.each(f"{LABEL}, energies", lanes_of(scene(Beam(modes=modes)), HIGH, members, settings.seed), accounted))
    return {
        "shares": [account.shares.tolist() for account in found],
        "passed": [account.passed.tolist() for account in found],
        "left": [account.left.tolist() for account in found],
        "contacts": [account.contacts for account in found],
        "tip": [(account.tip / account.tip[0]).tolist() for account in found],
        "omega": (scene(Beam(modes=modes)).model.omega / scene(Beam(modes=modes)).model.omega[0]).tolist(),
    }


def _signal(modes: int, seed: int) -> list[float]:
    """Return the tip's displacement in m while the first member's sweep down passes omega_1."""
    own = scene(Beam(modes=modes))
    return passage(near_lanes(own.model, partial(Lane, own), 1, seed)[1]).tolist()


def known_modes(values: Json, what: str) -> list[int]:
    """Return the numbers of modes for which there is a group ``what``."""
    return [int(name.split(", ")[1]) for name in values if name.startswith(f"{what}, ")]


def _levels(values: Json) -> Table:
    rows = [
        (
            str(n),
            spread(values[f"level, {n}"]["relative"], "{:.3f}"),
            f"{values[f'level, {n}']['step']:.3f}",
            spread(values[f"level, {n}"]["near_rms"], "{:.3f}"),
        )
        for n in known_modes(values, "level")
    ]
    return Table(f"{LABEL}_levels", ("modes", "level at 5 N", "at the paper's step", "around omega_1 at 1.5 N, RMS of 130 periods"), rows)


def _words(values: Json) -> str:
    levels = known_modes(values, "level")
    if not levels:
        return "Not finished."
    members = len(values[f"level, {levels[0]}"]["relative"])
    blocks = [f"e = 1, no friction, {members} members; levels over no absorber.", shortened(_levels(values))]
    counts = known_modes(values, "account")
    if counts:
        contacts = ", ".join(f"{np.median(values[f'account, {n}']['contacts']):.1f} contacts a pseudo period with {n} modes" for n in counts)
        blocks.append(
            f"Where the energy goes at 5 N, {contacts} (of what a contact gives to a mode above the tenth, a part is gone within it):"
            f"\n\n{shortened(_energies(values))}"
        )
    return "\n\n".join(blocks)


def _energies(values: Json) -> Table:
    """Return a row for each mode: what it dissipates, gets from a contact and still has before the next, for each number of modes."""
    counts = known_modes(values, "account")
    omega = values[f"account, {max(counts)}"]["omega"]
    columns = ["mode", "omega_i/omega_1", "left after half a period, %"]
    rows = [[str(i + 1), f"{ratio:.1f}", f"{100 * decayed(ratio):.1f}"] for i, ratio in enumerate(omega)]
    for n in counts:
        columns += [f"{n} modes: dissipated, %", "net from a contact, % of mode 1", "left before the next, %"]
        middles = [100 * np.median(np.array(values[f"account, {n}"][key]), axis=0) for key in ("shares", "passed", "left")]
        for i, row in enumerate(rows):
            row += [form.format(x[i]) if i < n else "" for x, form in zip(middles, ("{:.1f}", "{:.2f}", "{:.1f}"), strict=True)]
    return Table(f"{LABEL}_energies", columns, rows)


def _long(values: Json) -> list[Table]:
    found = [(_levels, "level"), (_energies, "account")]
    return [table(values) for table, what in found if known_modes(values, what)]


def decayed(ratio: float) -> float:
    """Return the share of its energy that a mode of 1 % damping and frequency ``ratio`` omega_1 keeps over half a pseudo period."""
    return float(np.exp(-2 * 0.01 * ratio * np.pi))


def _claims(values: Json) -> list[Claim]:
    """Return what the number of modes does to levels and losses."""
    modes, accounts = known_modes(values, "level"), known_modes(values, "account")
    relative, near = ({n: np.array(values[f"level, {n}"][key]) for n in modes} for key in ("relative", "near_rms"))
    step = {n: values[f"level, {n}"]["step"] for n in modes}
    many = [n for n in modes if n >= 2 / 3 * modes[-1]]
    gain = 100 * (1 - np.concatenate([relative[n] for n in many]) / np.median(relative[1]))
    own = values[f"account, {accounts[0]}"]
    shares, left, passed = (np.array(own[key]) for key in ("shares", "left", "passed"))
    uneven = np.concatenate([_unevenness(np.array(values[f"account, {n}"]["shares"])) for n in accounts])
    given = _unevenness(passed)
    largest = values[f"account, {accounts[-1]}"]
    complete = [i + 1 for i, share in enumerate(np.median(np.array(largest["left"]), axis=0)) if i and share < LEFT]
    less = f"of {accounts[-1]} modes it is as of mode {complete[0]} that less is left" if complete else f"no mode of {accounts[-1]} is left with less"
    influence = np.array([np.median(near[n]) for n in modes]) / np.median(near[1])
    said, count = partial(claim, LABEL), f"{accounts[0]} modes: "
    return [
        said("one_mode", "5 N, one mode: the level is that without absorber", "4.2", relative[1], within(SAME),
             "It is that of the absorber as a fixed mass.", about="over no absorber ", at_step=step[1]),
        said("reduction", "5 N: many modes lower the level by about 60 % against one", "4.2", gain, about(60),
             f"Members with {many[0]} to {many[-1]} modes; their median is {np.median(gain):.0f} %.",
             about=f"{many[0]} to {many[-1]} modes: lower by ",
             form="{:.0f}", unit=" %", at_step=100 * (1 - float(np.mean([step[n] for n in many])) / step[1])),
        said("stabilises", "the level stabilises with the number of modes", "4.2",
             [np.median(relative[many[0]]) - np.median(relative[many[-1]])], (-SAME, SAME), "Medians; 5 % of no absorber are allowed.",
             about=f"from {many[0]} to {many[-1]} modes the median falls by ", form="{:.3f}"),
        said("resonant_most", "of all modes the resonant one dissipates most", "4.2", shares[:, 0] / np.max(shares[:, 1:], axis=1), (1.0, INFINITY),
             "Another mode dissipates more in some members.", about=f"{count}the resonant mode's loss over the largest other ", form="{:.1f}"),
        said("sum", "the off-resonant modes' losses add up to a significant share", "4.2", 100 * (1 - shares[:, 0]), (100 * (1 - MUCH), 100),
             "A fifth is asked for.", about=f"{count}off-resonant modes dissipate ", form="{:.0f}", unit=" %"),
        said("sixth", "as of about mode 6 all that an impact passes on is dissipated before the next", "4.2", left[:, SIXTH], (0.0, LEFT),
             f"Less than {100 * LEFT:g} % left is what counts as complete. With two impacts a period "
             f"{100 * decayed(own['omega'][SIXTH]):.1f} % of mode 6 would be left, as the paper has it; but there are "
             f"{np.median(own['contacts']):.1f} contacts a pseudo period, not evenly spaced, and "
             f"{less}.", about=f"{count}left of mode 6 before the next contact "),
        said("uniform", "modes 6 and higher dissipate nearly the same", "4.2", uneven, (1.0, EVEN),
             "The largest share of these modes over the smallest, in single members. With more than ten modes their "
             "shares differ more, and are smaller.",
             about=f"{' and '.join(map(str, accounts))} modes: largest over smallest share from mode 6 on "),
        said("passed", "impacts pass about the same energy to each of modes 6 and higher", "4.2", given, (1.0, EVEN),
             "The net sum over all contacts of a window, largest over smallest.", about=f"{count}largest over smallest from mode 6 on "),
        said("near_one", "1.5 N, one mode: around omega_1 the level is reduced to about 20 %", "4.2", near[1], about(0.2),
             f"As the paper has it, the RMS of all {NEAR_PERIODS} pseudo periods, of the larger direction. Around the largest burst of this "
             f"modulated response, 20 of them, it is {spread(values['level, 1']['near'])}.", about="over no absorber "),
        said("near_all", "1.5 N: the number of modes has no considerable influence on the level around omega_1", "4.2", influence, within(LITTLE),
             f"Medians over the members: from {np.min(influence):.2f} to {np.max(influence):.2f} of one mode's.",
             about=f"{modes[0]} to {modes[-1]} modes, over one mode: "),
        said("off_resonant", "off-resonant modes respond at least an order of magnitude less (known for smooth absorbers)", "1",
             np.max(np.array(own["tip"])[:, 1:], axis=1), (0.0, LEFT), "Impacts excite them, unlike a smooth spring.",
             about=f"{count}5 N, the largest of their parts in the tip's displacement over the resonant mode's, RMS ", form="{:.3f}"),
    ]  # fmt: skip


def _unevenness(rows: Array) -> Array:
    """Return the largest over the smallest of the sixth and higher modes' values, by member, (M,)."""
    high = rows[:, SIXTH:]
    return np.asarray(np.max(high, axis=1) / np.min(high, axis=1))


def _draw(values: Json) -> Figure:
    """Draw levels over the number of modes, losses by mode, and below them the motion of the tip near the resonance."""
    shown = known_modes(values, "signal")
    figure, grid = panels(3, 2, 7.0, "abc")
    _draw_levels(grid[0, 0], values)
    _losses(grid[0, 1], values)
    for axes, modes in zip(grid[1:].flat, shown, strict=False):
        tip = MM * np.array(values[f"signal, {modes}"])
        signal(axes, np.arange(len(tip)) / DEFAULT_SAMPLES - NEAR_PERIODS / 2, tip, LOOKS[0])
        axes.set(
            xlim=(-NEAR_PERIODS / 2, NEAR_PERIODS / 2), ylim=(-1.35, 1.35), xlabel="pseudo periods from $\\omega_1$, 1.5 N, down", ylabel="tip, mm"
        )
        axes.set_title(f"{modes} mode{'s' * (modes > 1)}", fontsize=8.5)
    legends(grid)
    return figure


def _draw_levels(axes: Axes, values: Json) -> None:
    modes = known_modes(values, "level")
    for look, key, name in ((LOOKS[0], "relative", "5 N, whole sweep"), (LOOKS[1], "near_rms", "1.5 N, around $\\omega_1$")):
        rows = np.array([values[f"level, {n}"][key] for n in modes])
        low, middle, high = np.quantile(rows, (0.05, 0.5, 0.95), axis=1)
        line(axes, modes, middle, look, name, band=(low, high), nominal=rows[:, 0])
    axes.plot(
        modes, [values[f"level, {n}"]["step"] for n in modes], "x", color=LOOKS[3].colour, ms=4, zorder=5, label="5 N, one run, the paper's step"
    )
    axes.axhline(1, color=REFERENCE.colour, ls=REFERENCE.dashes, lw=0.9)
    axes.set(xlim=(0, max(modes) + 1), ylim=(0, 1.5), xlabel="number of modes $N_m$", ylabel="level over no absorber")


def _losses(axes: Axes, values: Json) -> None:
    small = axes.inset_axes((0.34, 0.5, 0.62, 0.38))
    for look, modes in zip(LOOKS, known_modes(values, "account"), strict=False):
        own = values[f"account, {modes}"]
        number = np.arange(1, modes + 1)
        for place, key, first in ((axes, "shares", 0), (small, "left", 1)):
            low, middle, high = 100 * np.quantile(np.array(own[key]), (0.05, 0.5, 0.95), axis=0)[:, first:]
            line(place, number[first:], middle, look, f"{modes} modes", band=(low, high), marked=place is axes)
    axes.legend(loc="center right", bbox_to_anchor=(1, 0.31), ncols=2)
    axes.set(ylim=(0, None), xlabel="mode", ylabel="dissipated, % of all modes")
    small.set(yscale="log", ylim=(0.03, 150))
    small.set_title("left before the next contact, %", fontsize=6.5, pad=2)
    small.tick_params(labelsize=6)


FIGURE = PaperFigure(
    LABEL, "the number of modes", measure=_measure, words=_words, draw=_draw, claims=_claims, tables=_long,
    needs=lambda values: len(known_modes(values, "level")) > 1,
    sizes=(
        Sizes((*range(1, 13), *range(14, 31, 2)), (10, 20), (1, 3, 10, 30), 16),
        Sizes((1, 2, 3, 6, 10, 14), (10,), (1, 3, 10, 14), 3),
    ),
)  # fmt: skip
