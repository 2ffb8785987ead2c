"""Sweeps through resonance, and the probability of the jump to the high branch.

Source: paper, section 3.1, figure jump.
"""

from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from impact_env import (
    Beam,
    FrequencySchedule,
    Scene,
    beam_scene,
    impact_absorber,
    linear_sweep,
    simulate,
)
from impact_env.ensemble import Lane, draw_members
from impact_env.methods import Exact, Method, Moreau
from impact_env.periodic.residence import (
    SILENT_PERIODS,
    Approach,
    ExitRate,
    Hazard,
    Jumps,
    Range,
    exit_rate,
    hazard,
    jumps,
    residence_times,
)
from impact_env.results import DEFAULT_SAMPLES, Record
from optimisation.executors import sweeps_bar
from optimisation.files import markdown
from studies.paper.branches import compute_responses, draw_responses
from studies.paper.claim import (
    INFINITY,
    MUCH,
    Claim,
    Interval,
    compute_bands,
    format_interval,
    format_spread,
    judge_cases,
    judge_interval,
    judge_share,
    make_claim,
)
from studies.paper.curve import compute_level_value
from studies.paper.frame import (
    MM,
    SMALL,
    STYLES,
    LineStyle,
    PaperFigure,
    PaperSettings,
    Size,
    draw_legend_below,
    draw_legends,
    make_panels,
    measure_groups,
)
from studies.study import Json, Steps, not_none

LABEL = "jump"
MODES = 2
FRICTION = 0.025  # N
FORCES = {"medium": 1.5, "high": 3.0}  # N
GAP = 1e-3  # m
# limits of the sweeps, over the first resonance
LOW = 0.9
HIGH = 1.06
RATE = 725.0  # the paper's faster sweep, in pseudo periods per 1 %; the other takes twice as long
EDGES = np.linspace(
    LOW, HIGH, 81
)  # of the intervals in which a sweep's largest displacement is recorded
# intervals of the frequency ratio for the high branch, and for the response at resonance
ON_BRANCH = (0.935, 0.945)
AT_RESONANCE = (0.995, 1.005)
SWEEPS: dict[
    str, tuple[float, float, float, float, Method]
] = {  # name: force in N, pseudo periods per 1 %, from, to, method
    "down": (1.5, RATE, HIGH, LOW, Exact()),
    "down, half the rate": (1.5, 2 * RATE, HIGH, LOW, Exact()),
    "down, paper's step": (1.5, RATE, HIGH, LOW, Moreau()),
    "down, half the rate, paper's step": (1.5, 2 * RATE, HIGH, LOW, Moreau()),
    "high force, down": (3.0, RATE, HIGH, LOW, Exact()),
    "high force, up": (3.0, RATE, LOW, HIGH, Exact()),
}
OVER = Range(
    1.0, 0.988, 0.952, LOW
)  # of the sweeps in which jumps are counted, which begin at the resonance
HIGH_LEVEL = 0.75e-3  # m: at 1.5 N response levels are near 0.55 and 1.05 mm
HIGH_BRANCH = 1.5e-3  # m: at 3 N the high branch is above it, all else below
DRIFT = (0.96, 0.97, 0.1)  # a slow sweep without impacts: from, to, % per 100 pseudo periods
BLOCK = 100  # pseudo periods over which the absorber's position is averaged
EVERY = "exact"
STEP = "paper's step"
FINER = "ten times finer"
METHODS: dict[str, Method] = {
    EVERY: Exact(),
    STEP: Moreau(),
    FINER: Moreau(200),
}  # steps a period of the highest mode; the paper's are 20
BURN_IN = 100.0  # pseudo periods at the start of a run that the exit rate leaves out
PAPER_PERIODS = 100.0  # pseudo periods per 1 % of the paper's sweeps for response levels


def make_scene() -> Scene:
    """Return the paper's beam and absorber of this figure."""
    return beam_scene(Beam(modes=MODES), impact_absorber(friction_limit=FRICTION))


def follow_sweep(lane: Lane, method: Method) -> tuple[list[float], float, float]:
    """Return displacements |q_tip| in m of a sweep.

    They are the largest one in each interval of the frequency ratio between `EDGES`; the median of
    the largest values of the pseudo periods in `ON_BRANCH`; and the largest one in `AT_RESONANCE`.
    """
    schedule: FrequencySchedule = lane.drive.schedule
    history = simulate(
        lane.scene, lane.drive, method, record=Record(level=False, series=True)
    ).recorded.history
    first = np.flatnonzero(np.diff(np.floor(history.time / schedule.pseudo_period), prepend=-1))
    largest = np.maximum.reduceat(np.abs(history.tip_displacement), first)
    ratio = np.asarray(schedule.omega_at(history.time[first])) / schedule.reference
    place = np.clip(np.digitize(ratio, EDGES) - 1, 0, len(EDGES) - 2)
    binned = [float(f"{np.max(largest[place == k]):.5g}") for k in range(len(EDGES) - 1)]
    branch, resonance = (
        largest[(low <= ratio) & (ratio <= high)] for low, high in (ON_BRANCH, AT_RESONANCE)
    )
    return binned, float(np.median(branch)), float(np.max(resonance))


def _sweeps(settings: PaperSettings, size: Size) -> Json:
    """Return the results of `follow_sweep` for each of `SWEEPS`, by name.

    The displacements between `EDGES` are given for the nominal member and as 5 and 95 % of all
    members, those on the branch and at resonance for each member.
    """
    own = make_scene()
    result = {}
    members = draw_members(size.sweeps, settings.seed)
    for name, (force, slowness, start, stop, method) in SWEEPS.items():
        schedule = linear_sweep(own.model.resonance_omega(1), start, stop, 100 / slowness)
        lanes = [Lane(own, drive) for drive in members.drives(force, schedule)]
        binned, branch, resonance = zip(
            *settings.each(f"{LABEL}: {name}", lanes, partial(follow_sweep, method=method), method),
            strict=True,
        )
        low, _, high = compute_bands(np.array(binned).T).tolist()
        result[name] = {
            "force_n": force,
            "periods_per_percent": slowness,
            "nominal_m": binned[0],
            "low_m": low,
            "high_m": high,
            "on_branch_m": branch,
            "at_resonance_m": resonance,
        }
    return result


def _rates(settings: PaperSettings, size: Size) -> list[Json]:
    """Return exits from the impact regime and time at risk at constant frequencies.

    Each row also has the exit rate per pseudo period and its interval, None without time at risk.
    """
    own = make_scene()
    rows = []
    to = Json(threads=settings.threads, executor=settings.executor)
    phases = draw_members(size.stays, settings.seed, "phase").phases.tolist()
    approach = Approach(own.model.resonance_omega(1), 1.0)
    for ratio in np.round(np.linspace(OVER.first, OVER.last, size.ratios), 6).tolist():
        with sweeps_bar(f"{LABEL}: stays at {ratio:g}", leave=False) as show:
            result = residence_times(
                own, FORCES["medium"], approach, ratio, size.periods, phases, progress=show, **to
            )
        rate = exit_rate(result, BURN_IN)
        limits = {
            name: None if np.isnan(value := getattr(rate, name)) else float(value)
            for name in ("rate", "low", "high")
        }
        rows.append(
            {"omega_ratio": ratio, "exits": rate.exits, "exposure": rate.exposure, **limits}
        )
    return rows


def _jumps(settings: PaperSettings, size: Size, name: str) -> list[Json]:
    """Return how many sweeps down reach the high branch, by the method ``name`` of `METHODS`.

    There is a row for each slowness, in pseudo periods per 1 %. It also has the number of sweeps
    that did not leave the impact regime.
    """
    own = make_scene()
    rows = []
    to = Json(threads=settings.threads, executor=settings.executor)
    phases = draw_members(
        size.finer if name == FINER else size.jumps, settings.seed + 1, "phase"
    ).phases.tolist()
    approach = Approach(own.model.resonance_omega(1), 1.0)
    for slowness in (n for n in size.slownesses if name != FINER or n in (RATE, 2 * RATE)):
        with sweeps_bar(f"{LABEL}: {name}, {slowness:g} periods a percent", leave=False) as show:
            result = jumps(
                own,
                FORCES["medium"],
                approach,
                OVER,
                slowness,
                phases,
                SILENT_PERIODS,
                HIGH_LEVEL,
                METHODS[name],
                progress=show,
                **to,
            )
        high = not_none(result.high)
        low, most = Jumps(high, result.runs, result.runs).interval()
        share = {"share": high / result.runs, "low": low, "high": most}
        rows.append(
            {
                "periods_per_percent": slowness,
                "reached": high,
                "runs": result.runs,
                "stayed": result.jumped,
                **share,
            }
        )
    return rows


def measure_drift(lane: Lane, method: Method) -> tuple[float, int]:
    """Return the range of the absorber's mean position in a sweep, in m, and the number of impacts.

    Without impacts, friction over whole periods should not change the mean position.
    """
    response = simulate(lane.scene, lane.drive, method, record=Record(level=False, series=True))
    place = (
        response.recorded.history.absorber_displacement - response.recorded.history.tip_displacement
    )
    each = DEFAULT_SAMPLES * BLOCK
    means = place[: len(place) // each * each].reshape(-1, each).mean(axis=1)
    return float(np.ptp(means)), response.impact_count


def _drift(settings: PaperSettings, size: Size) -> Json:
    """Return drift (m) and impacts of all members, by each of the `METHODS`."""
    own = make_scene()
    start, stop, rate = DRIFT
    result = {}
    phases = draw_members(size.sweeps, settings.seed, "phase")
    lanes = [
        Lane(own, drive)
        for drive in phases.drives(
            FORCES["medium"], linear_sweep(own.model.resonance_omega(1), start, stop, rate)
        )
    ]
    for name, method in METHODS.items():
        drift, impacts = zip(
            *settings.each(
                f"{LABEL}: drift, {name}", lanes, partial(measure_drift, method=method), method
            ),
            strict=True,
        )
        result[name] = {"drift_m": drift, "impacts": impacts}
    return result


def _levels(settings: PaperSettings, size: Size) -> list[Json]:
    """Return the members' response levels in m of sweeps down, a row for each slowness.

    Slowness is in pseudo periods per 1 %.
    """
    own = make_scene()
    rows = []
    members = draw_members(size.sweeps, settings.seed)
    for slowness in size.fast:
        schedule = linear_sweep(own.model.resonance_omega(1), HIGH, LOW, 100 / slowness)
        lanes = [Lane(own, drive) for drive in members.drives(FORCES["medium"], schedule)]
        rows.append(
            {
                "periods_per_percent": slowness,
                "level_m": settings.each(f"{LABEL}: levels", lanes, compute_level_value),
            }
        )
    return rows


def _measure(settings: PaperSettings, size: Size, earlier: Json) -> Steps:
    groups: dict[str, Callable[[], Any]] = {
        name: partial(compute_responses, make_scene(), force, LOW, HIGH)
        for name, force in FORCES.items()
    }
    groups |= {"sweeps": partial(_sweeps, settings, size), "rates": partial(_rates, settings, size)}
    groups |= {f"jumps, {name}": partial(_jumps, settings, size, name) for name in METHODS}
    return measure_groups(
        {
            **groups,
            "drift": partial(_drift, settings, size),
            "levels": partial(_levels, settings, size),
        },
        earlier,
    )


def hazard_of(values: Json) -> Hazard | None:
    """Return the integral of the exit rates over the frequency, which predicts the jumps.

    Its factor A is estimated from the exact sweeps if, at some slowness, some of them reach the
    high branch and some do not. The result is None if fewer than two frequencies have a rate.
    """
    earlier = [row for row in values["rates"] if row["rate"] is not None]
    if len(earlier) < 2:
        return None
    counts = [
        ExitRate(row["exits"], row["exposure"], row["rate"], row["low"], row["high"])
        for row in earlier
    ]
    result = hazard([row["omega_ratio"] for row in earlier], counts)
    sweeps = {
        row["periods_per_percent"]: Jumps(row["reached"], row["runs"], row["runs"])
        for row in values[f"jumps, {EVERY}"]
    }
    informative = any(0 < one.jumped < one.runs for one in sweeps.values())
    return result.with_sweeps(sweeps) if informative else result


def _share(row: Json) -> str:
    return format_interval(row["share"], row["low"], row["high"])


def _describe(values: Json) -> str:
    blocks = []
    result = hazard_of(values)
    if result is not None:
        inverses = [
            f"{1 / x:.0f}" if x > 0 else "no end" for x in (result.value, result.high, result.low)
        ]
        blocks.append(
            f"Integral of the rate of leaving from {result.first:g} to {result.last:g}, at "
            f"{len(values['rates'])} frequencies: P(jump) = A exp(-N/"
            f"{inverses[0]}) (95 %: {inverses[1]} to {inverses[2]}) for N pseudo periods per "
            "1 %, A = "
            f"{format_interval(result.factor, result.factor_low, result.factor_high)} from "
            "the exact sweeps. "
            "The same case with more frequencies and runs: [regimes](regimes.md)."
        )
    by = {
        name: {row["periods_per_percent"]: row for row in values[f"jumps, {name}"]}
        for name in METHODS
    }
    lines = []
    for n in by[EVERY]:
        probability = "" if result is None else format_interval(*result.probability(n))
        shares = [
            f"{rows[n]['reached']} of {rows[n]['runs']}: {_share(rows[n])}" if n in rows else ""
            for rows in by.values()
        ]
        lines.append((f"{n:g}", probability, *shares))
    sums = {
        name: [sum(row[key] for row in rows.values()) for key in ("reached", "stayed", "runs")]
        for name, rows in by.items()
    }
    names = ", ".join("{} {} and {} of {}".format(name, *counts) for name, counts in sums.items())
    drifts = ", ".join(
        f"{name} {format_spread(one['drift_m'], '{:.3f}', 1e3)} mm"
        for name, one in values["drift"].items()
    )
    levels = [
        (f"{row['periods_per_percent']:g}", format_spread(row["level_m"], "{:.2f}", 1e3))
        for row in values["levels"]
    ]
    blocks += [
        "Share of sweeps down that reach the high branch:",
        markdown(("pseudo periods per 1 %", "predicted from rates", *METHODS), lines),
        (
            "Of all these runs, reached the high branch, and never without impact for "
            f"{SILENT_PERIODS:g} pseudo periods: {names}."
        ),
        (
            f"Drift of the absorber's place in a slow sweep from {DRIFT[0]:g} to {DRIFT[1]:g} "
            f"that begins at rest, without impacts: {drifts}."
        ),
        markdown(("pseudo periods per 1 %, down", "response level, mm"), levels),
    ]
    return "\n\n".join(blocks)


PANELS = (  # name of the force, name of the sweep, style, title
    ("medium", "down", STYLES[2], "1.5 N, down, 725 periods per 1 %"),
    ("medium", "down, half the rate", STYLES[2], "1.5 N, down, 1450"),
    ("medium", "down, paper's step", STYLES[3], "1.5 N, down, 725, paper's step"),
    ("high", "high force, down", STYLES[2], "3 N, 725"),
)


def _draw(values: Json) -> Figure:
    """Draw sweeps, exit rates and jumps.

    Panels with sweeps also show the periodic responses. The last panel shows the share of sweeps
    that jump as a function of their slowness.
    """
    figure, axes = make_panels(3, 2, 8.2)
    for own, (name, sweep, style, title) in zip(axes.flat, PANELS, strict=False):
        draw_responses(own, values[name])
        _draw_sweep(own, values["sweeps"][sweep], style, "sweep: 5 to 95 %, phase 0")
        own.set_title(title, fontsize=SMALL, loc="right")
    _draw_sweep(axes[1, 1], values["sweeps"]["high force, up"], STYLES[4], "sweep up")
    for own in axes[:2].flat:
        own.set(xlim=EDGES[[0, -1]], xlabel=r"frequency $\Omega/\omega_1$")
        own.set_ylabel("largest tip displacement in mm")
    for own, (name, *_) in zip(axes.flat, PANELS, strict=False):
        own.set_ylim(0, 1.2 * MM * max(curve["peak"][1] for curve in values[name]["exact"]))
    _draw_rates(axes[2, 0], values["rates"])
    _shares(axes[2, 1], values)
    draw_legend_below(figure, axes[:2], 3)
    draw_legends(axes[2])
    return figure


def _draw_sweep(axes: Axes, sweep: Json, style: LineStyle, label: str) -> None:
    middles = 0.5 * (EDGES[1:] + EDGES[:-1])
    low, high, nominal = (MM * np.array(sweep[key]) for key in ("low_m", "high_m", "nominal_m"))
    axes.fill_between(middles, low, high, color=style.colour, alpha=0.3, lw=0)
    axes.plot(middles, nominal, color=style.colour, lw=0.8, drawstyle="steps-mid", label=label)


def _draw_rates(axes: Axes, rates: Sequence[Json]) -> None:
    rows = [
        [row[name] for name in ("omega_ratio", "rate", "low", "high")]
        for row in rates
        if row["rate"] is not None
    ]
    x, y, low, high = np.array(rows).T
    style: Json = {"fmt": "o", "ms": 3, "lw": 0.9, "color": STYLES[0].colour}
    axes.errorbar(
        x,
        1e4 * y,
        1e4 * np.array([y - low, high - y]),
        label="exits over time at risk, 95 %",
        **style,
    )
    axes.set_ylim(top=1.3e4 * float(high.max()))
    axes.locator_params(axis="x", nbins=5)
    axes.set(
        xlabel=r"constant frequency $\Omega/\omega_1$",
        ylabel=r"rate of leaving, $10^{-4}$ per pseudo period",
    )


def _shares(axes: Axes, values: Json) -> None:
    result = hazard_of(values)
    n = np.geomspace(80, 4000, 200)
    if result is not None:
        curve = np.array([result.probability(float(each)) for each in n]).T
        axes.plot(n, curve[0], color="black", lw=0.9, label="from the rates, times A")
        axes.fill_between(n, curve[1], curve[2], color="0.8", lw=0)
    for k, (name, style) in enumerate(zip(METHODS, STYLES, strict=False)):
        rows = [
            [row[column] for column in ("periods_per_percent", "share", "low", "high")]
            for row in values[f"jumps, {name}"]
        ]
        x, y, low, high = np.array(rows).T
        aside = 1.04 ** (k - 1)
        axes.errorbar(
            aside * x,
            y,
            [y - low, high - y],
            fmt=style.marker,
            ls=style.dashes if k else "",
            ms=4,
            lw=0.9,
            color=style.colour,
            label=name,
        )
    axes.set(
        xscale="log",
        ylim=(-0.02, 1.05),
        xlabel="pseudo periods per 1 % of a sweep down",
        ylabel="share that jumps",
    )


judge = partial(make_claim, LABEL)


def _jump_claims(values: Json) -> list[Claim]:
    exact, step, finer = (
        {row["periods_per_percent"]: row for row in values[f"jumps, {name}"]}
        for name in ("exact", "paper's step", "ten times finer")
    )
    fast, slow, first, last = (
        exact[725.0],
        exact[1450.0],
        *(values["jumps, exact"][k] for k in (0, -1)),
    )
    both, coarse = (rows[725.0]["share"] * (1 - rows[1450.0]["share"]) for rows in (exact, step))
    pair = [fast[low] * (1 - slow[high]) for low, high in (("low", "high"), ("high", "low"))]
    own = [
        1e3 * max(values["sweeps"][name]["nominal_m"])
        for name in ("down, paper's step", "down, half the rate, paper's step")
    ]
    cells = "; ".join(
        f"share at {n:g} exact {_share(exact[n])}, at the paper's step {_share(step[n])}"
        for n in (725.0, 1450.0)
    )
    some = ", ".join(f"{_share(finer[n])} at {n:g}" for n in (725.0, 1450.0) if n in finer)
    back, none = (
        sum(row["reached"] - row["stayed"] for row in rows.values()) for rows in (step, exact)
    )
    drift = [
        format_spread(values["drift"][name]["drift_m"], "{:.3f}", 1e3)
        for name in ("paper's step", "ten times finer", "exact")
    ]
    dropped = ", ".join(
        f"{1 - row['share']:.2f} at {row['periods_per_percent']:g}" for row in (first, last)
    )
    return [
        judge(
            "jump",
            judge_share(*pair),
            exact=both,
            step=coarse,
            pair=pair,
            cells=cells,
            own=own,
            finer=some,
            back=back,
            none=none,
            drift=drift,
            runs=sum(row["runs"] for row in step.values()),
        ),
        judge(
            "slower jumps less",
            Interval(slow["share"], slow["low"], slow["high"]),
            (0.0, fast["low"]),
            slow=_share(slow),
            fast=_share(fast),
        ),
        judge(
            "slow sweeps find the sliding response", first["low"] > last["high"], dropped=dropped
        ),
        judge(
            "conservative rate",
            Interval(first["share"], first["low"], first["high"]),
            (fast["high"], 1.0),
            first=_share(first),
            at=first["periods_per_percent"],
            fast=_share(fast),
        ),
    ]


def _claims(values: Json) -> list[Claim]:
    """Return the paper's statements on this figure with their verdicts.

    The statement "modulation beyond sliding" concerns frequencies at which the response without
    impacts stays within the gap. The shortest mean time in the impact regime there, the inverse of
    the exit rate, is compared with the time in which a sweep at the paper's rate covers 1 %.
    """
    alone = values["medium"]["linear"]
    rows = values["levels"]
    free = np.interp(
        [row["omega_ratio"] for row in values["rates"]],
        alone["omega_ratio"],
        np.array(alone["alone"], dtype=float),
    )
    below = [
        row
        for row, height in zip(values["rates"], free, strict=True)
        if height < GAP and row["rate"]
    ]
    stay = min(1 / row["rate"] for row in below)
    begin, end = (below[k]["omega_ratio"] for k in (0, -1))
    middles = [float(np.median(row["level_m"])) for row in rows]
    slowness = [row["periods_per_percent"] for row in rows]
    visible = ", ".join(
        f"{n:g}: {format_spread(row['level_m'], '{:.2f}', 1e3)}"
        for n, row in zip(slowness, rows, strict=True)
    )
    over = np.array(rows[0]["level_m"]) / min(middles[1:])
    worst = slowness[int(np.argmax(middles))]
    return [
        *_jump_claims(values),
        judge(
            "modulation beyond sliding",
            [stay],
            (PAPER_PERIODS, INFINITY),
            stay=stay,
            begin=begin,
            end=end,
        ),
        _judge_faster(values, worst),
        judge("fast may be worse", over, visible=visible, first=slowness[0], worst=worst),
        *_sweep_claims(values),
    ]


def _judge_faster(values: Json, worst: float) -> Claim:
    """Return the claim that more of the faster sweeps reach the high branch.

    Each slowness is compared with the next lower one, down to ``worst``: the slowness, in pseudo
    periods per 1 %, with the highest median level.
    """
    rows = sorted(
        (row for row in values["jumps, exact"] if row["periods_per_percent"] >= worst),
        key=lambda row: -row["periods_per_percent"],
    )
    cases = [
        judge_interval(fast["low"], fast["high"], slow["high"], 1.0)
        for slow, fast in pairwise(rows)
    ]
    shares = ", ".join(f"{_share(row)} at {row['periods_per_percent']:g}" for row in rows)
    return judge("faster is worse", judge_cases(cases), shares=shares)


def _sweep_claims(values: Json) -> list[Claim]:
    sweeps = values["sweeps"]
    medium = values["medium"]
    alone = float(np.max(medium["linear"]["alone"]))
    smr = np.array(sweeps["down"]["at_resonance_m"])
    points = [
        pair
        for curve in medium["exact"]
        for pair in zip(curve["omega_ratio"], curve["tip_max"], strict=True)
    ]
    orbit = max(y for x, y in points if y and AT_RESONANCE[0] < x < AT_RESONANCE[1])
    down, up = (np.array(sweeps[f"high force, {way}"]["on_branch_m"]) for way in ("down", "up"))
    nominal, low = (
        {way: max(sweeps[f"high force, {way}"][key]) for way in ("down", "up")}
        for key in ("nominal_m", "low_m")
    )
    least = min(*nominal.values(), *low.values())
    return [
        judge(
            "modulated maxima",
            1e3 * smr,
            (1e3 * orbit, 1e3 * MUCH * alone),
            orbit=1e3 * orbit,
            alone=1e3 * alone,
        ),
        judge(
            "high force reaches it",
            [1e3 * least],
            (1e3 * HIGH_BRANCH, 10.0),
            down=1e3 * low["down"],
            up=1e3 * low["up"],
        ),
        judge("hysteresis", np.median(up) < MUCH * np.median(down), down=1e3 * down, up=1e3 * up),
    ]


FIGURE = PaperFigure(
    LABEL,
    "sweeps through resonance, and the jump",
    measure=_measure,
    describe=_describe,
    draw=_draw,
    claims=_claims,
    # full and quick. Members of sweeps, jumps, jumps with the finer step, and runs at constant
    # frequency; pseudo periods of these; number of frequencies; slownesses of jumps, and of levels
    sizes=(
        Size(
            sweeps=16,
            jumps=200,
            finer=100,
            stays=100,
            periods=6000.0,
            ratios=17,
            slownesses=(100.0, 300.0, RATE, 2 * RATE, 4 * RATE),
            fast=(1.0, 5.0, 20.0, 100.0, 300.0, RATE, 2 * RATE),
        ),
        Size(
            sweeps=4,
            jumps=40,
            finer=12,
            stays=24,
            periods=1500.0,
            ratios=9,
            slownesses=(100.0, RATE, 2 * RATE),
            fast=(1.0, 20.0, 100.0, 2 * RATE),
        ),
    ),
)
