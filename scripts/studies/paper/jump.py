"""Sweeps through resonance, and the jump to the high branch as a probability (paper, section 3.1, its figure jump)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from impact_env.curve import BAND, quantiles
from impact_env.drive import FrequencySchedule, linear_sweep
from impact_env.ensemble import Lane, draw_members
from impact_env.methods import Exact, Method, Moreau
from impact_env.parameters import Beam, impact_absorber
from impact_env.periodic.residence import SILENCE, Approach, ExitRate, Hazard, Jumps, Range, exit_rate, hazard, jumps, stays
from impact_env.response import DEFAULT_SAMPLES, Record
from impact_env.scene import Scene, beam_scene
from impact_env.sweep import simulate
from optimisation.page import markdown
from optimisation.progress import sweeps_bar
from studies.paper import jump_claims
from studies.paper.branches import draw, responses
from studies.paper.claim import spread
from studies.paper.frame import PaperFigure, Settings, has, in_turn
from studies.paper.style import LOOKS, MM, legend_below, legends, panels
from studies.study import Json, Steps

LABEL = "jump"
MODES, FRICTION, FORCES = 2, 0.025, {"medium": 1.5, "high": 3.0}  # N
LOW, HIGH = 0.9, 1.06
RATE = 725.0  # the paper's faster sweep, in pseudo periods per 1 %; the other takes twice as long
EDGES = np.linspace(LOW, HIGH, 81)  # of the stretches in which a sweep's largest displacement is kept
ON_BRANCH, AT_RESONANCE = (0.935, 0.945), (0.995, 1.005)  # where the high branch, and the response at resonance, are read off
SWEEPS: dict[str, tuple[float, float, float, float, Method]] = {  # name: force in N, pseudo periods per 1 %, from, to, method
    "down": (1.5, RATE, HIGH, LOW, Exact()),
    "down, half the rate": (1.5, 2 * RATE, HIGH, LOW, Exact()),
    "down, paper's step": (1.5, RATE, HIGH, LOW, Moreau()),
    "down, half the rate, paper's step": (1.5, 2 * RATE, HIGH, LOW, Moreau()),
    "high force, down": (3.0, RATE, HIGH, LOW, Exact()),
    "high force, up": (3.0, RATE, LOW, HIGH, Exact()),
}
OVER = Range(1.0, 0.988, 0.952, LOW)  # of the sweeps that are counted: they come from impact at resonance
HIGH_LEVEL = 0.75e-3  # m: at 1.5 N response levels are near 0.55 and 1.05 mm
DRIFT, BLOCK = (0.96, 0.97, 0.1), 100  # a slow sweep without impacts: from, to, % per 100 pseudo periods; over which the absorber's place is averaged
FINER = 200  # steps a period of the highest mode: ten times the paper's
EVERY = "exact"
METHODS: dict[str, Method] = {EVERY: Exact(), "paper's step": Moreau(), "ten times finer": Moreau(FINER)}
BURN_IN = 100.0  # pseudo periods of a stay that are left out of its rate


class Sizes(NamedTuple):
    """How much is computed: members of sweeps, of jumps (with ten times finer steps) and of stays, their length, frequencies, and slownesses."""

    sweeps: int
    jumps: int
    finer: int
    stays: int
    periods: float
    ratios: int
    slownesses: tuple[float, ...]
    fast: tuple[float, ...]


def scene() -> Scene:
    """Return the paper's beam and absorber of this figure."""
    return beam_scene(Beam(modes=MODES), impact_absorber(friction_limit=FRICTION))


@dataclass(frozen=True)
class Followed:
    """Of a sweep: the largest |q_tip| in m between `EDGES`, the median of the periods' largest on the high branch, the largest at resonance."""

    method: Method

    def __call__(self, lane: Lane) -> tuple[list[float], float, float]:
        """Return all three of a lane."""
        schedule: FrequencySchedule = lane.drive.schedule
        history = simulate(lane.scene, lane.drive, self.method, record=Record(level=False, series=True)).history
        assert history is not None
        period = np.floor(history.time / schedule.pseudo_period)
        first = np.flatnonzero(np.diff(period, prepend=-1))
        largest = np.maximum.reduceat(np.abs(history.tip_displacement), first)
        ratio = np.asarray(schedule.omega_at(history.time[first])) / schedule.reference
        place = np.clip(np.digitize(ratio, EDGES) - 1, 0, len(EDGES) - 2)
        binned = [float(f"{np.max(largest[place == k]):.5g}") for k in range(len(EDGES) - 1)]
        branch, resonance = (largest[(low <= ratio) & (ratio <= high)] for low, high in (ON_BRANCH, AT_RESONANCE))
        return binned, float(np.median(branch)), float(np.max(resonance))


def _sweeps(settings: Settings, size: Sizes) -> Json:
    """Return for each of `SWEEPS` the paper's own run, the band of all members, and where they are on the branch and at resonance."""
    own, result = scene(), {}
    members = draw_members(size.sweeps, settings.seed)
    for name, (force, slowness, start, stop, method) in SWEEPS.items():
        schedule = linear_sweep(own.model.resonance_omega(1), start, stop, 100 / slowness)
        lanes = [Lane(own, drive) for drive in members.drives(force, schedule)]
        binned, branch, resonance = zip(*settings.each(f"{LABEL}: {name}", lanes, Followed(method), method), strict=True)
        low, high = quantiles(np.array(binned).T, BAND)
        result[name] = {
            "force_n": force, "periods_per_percent": slowness, "nominal_m": binned[0], "low_m": low.tolist(), "high_m": high.tolist(),
            "on_branch_m": branch, "at_resonance_m": resonance,
        }  # fmt: skip
    return result


def _rates(settings: Settings, size: Sizes) -> list[Json]:
    """Return exits and time at risk at constant frequencies."""
    own = scene()
    phases = draw_members(size.stays, settings.seed, "phase").phases.tolist()
    rows = []
    for ratio in np.round(np.linspace(OVER.first, OVER.last, size.ratios), 6).tolist():
        with sweeps_bar(f"{LABEL}: stays at {ratio:g}", leave=False) as show:
            approach = Approach(own.model.resonance_omega(1), 1.0)
            found = stays(
                own, FORCES["medium"], approach, ratio, size.periods, phases, threads=settings.threads, progress=show, executor=settings.executor
            )  # fmt: skip
        rate = exit_rate(found, BURN_IN)
        interval = {name: None if np.isnan(value := getattr(rate, name)) else float(value) for name in ("rate", "low", "high")}
        rows.append({"omega_ratio": ratio, "exits": rate.exits, "exposure": rate.exposure, **interval})
    return rows


def _jumps(settings: Settings, size: Sizes, name: str) -> list[Json]:
    """Return at each slowness how many sweeps reach the high branch, by one of the `METHODS`, and how many stayed in impact all the way."""
    own, rows = scene(), []
    slownesses: Sequence[float] = size.slownesses if name != "ten times finer" else [n for n in size.slownesses if n in (RATE, 2 * RATE)]
    phases = draw_members(size.finer if name == "ten times finer" else size.jumps, settings.seed + 1, "phase").phases.tolist()
    for slowness in slownesses:
        with sweeps_bar(f"{LABEL}: {name}, {slowness:g} periods a percent", leave=False) as show:
            approach = Approach(own.model.resonance_omega(1), 1.0)
            found = jumps(
                own, FORCES["medium"], approach, OVER, slowness, phases, SILENCE, HIGH_LEVEL, METHODS[name],
                threads=settings.threads, progress=show, executor=settings.executor,
            )  # fmt: skip
        assert found.high is not None
        low, high = Jumps(found.high, found.runs, found.runs).interval()
        share = {"share": found.high / found.runs, "low": low, "high": high}
        rows.append({"periods_per_percent": slowness, "reached": found.high, "runs": found.runs, "stayed": found.jumped, **share})
    return rows


@dataclass(frozen=True)
class Drifted:
    """How far the absorber's mean place wanders in a sweep without impacts, in m: the friction of whole periods should leave it where it is."""

    method: Method

    def __call__(self, lane: Lane) -> tuple[float, int]:
        """Return that of a lane, and the number of its impacts."""
        response = simulate(lane.scene, lane.drive, self.method, record=Record(level=False, series=True))
        assert response.history is not None
        place = response.history.absorber_displacement - response.history.tip_displacement
        each = DEFAULT_SAMPLES * BLOCK
        means = place[: len(place) // each * each].reshape(-1, each).mean(axis=1)
        return float(np.ptp(means)), response.impact_count


def _drift(settings: Settings, size: Sizes) -> Json:
    """Return drift (m) and impacts of all members, by each of the `METHODS`."""
    own, (start, stop, rate) = scene(), DRIFT
    phases = draw_members(size.sweeps, settings.seed, "phase")
    lanes = [Lane(own, drive) for drive in phases.drives(FORCES["medium"], linear_sweep(own.model.resonance_omega(1), start, stop, rate))]
    result = {}
    for name, method in METHODS.items():
        drift, impacts = zip(*settings.each(f"{LABEL}: drift, {name}", lanes, Drifted(method), method), strict=True)
        result[name] = {"drift_m": drift, "impacts": impacts}
    return result


def _level(lane: Lane) -> float:
    level = simulate(lane.scene, lane.drive).level
    assert level is not None
    return level.value


def _levels(settings: Settings, size: Sizes) -> list[Json]:
    """Return response levels of sweeps down over their slowness."""
    own, rows = scene(), []
    members = draw_members(size.sweeps, settings.seed)
    for slowness in size.fast:
        schedule = linear_sweep(own.model.resonance_omega(1), HIGH, LOW, 100 / slowness)
        lanes = [Lane(own, drive) for drive in members.drives(FORCES["medium"], schedule)]
        rows.append({"periods_per_percent": slowness, "level_m": settings.each(f"{LABEL}: levels", lanes, _level)})
    return rows


def _measure(settings: Settings, size: Sizes, known: Json) -> Steps:
    groups: dict[str, Callable[[], Any]] = {name: partial(responses, scene(), force, LOW, HIGH) for name, force in FORCES.items()}
    groups |= {"sweeps": partial(_sweeps, settings, size), "rates": partial(_rates, settings, size)}
    groups |= {f"jumps, {name}": partial(_jumps, settings, size, name) for name in METHODS}
    return in_turn({**groups, "drift": partial(_drift, settings, size), "levels": partial(_levels, settings, size)}, known)


def hazard_of(values: Json) -> Hazard | None:
    """Return the integral of the rates of leaving, with the factor of the exact sweeps; None where fewer than two frequencies have a rate."""
    known = [row for row in values["rates"] if row["rate"] is not None]
    if len(known) < 2:
        return None
    counts = [ExitRate(row["exits"], row["exposure"], row["rate"], row["low"], row["high"]) for row in known]
    found = hazard([row["omega_ratio"] for row in known], counts)
    sweeps = {row["periods_per_percent"]: Jumps(row["reached"], row["runs"], row["runs"]) for row in values.get(f"jumps, {EVERY}", ())}
    told = any(0 < one.jumped < one.runs for one in sweeps.values())
    return found.with_sweeps(sweeps) if told else found


def _words(values: Json) -> str:
    blocks = []
    found = hazard_of(values) if "rates" in values else None
    if found is not None:
        inverses = [f"{1 / x:.0f}" if x > 0 else "no end" for x in (found.value, found.high, found.low)]
        blocks.append(
            f"Integral of the rate of leaving from {found.first:g} to {found.last:g}, at {len(values['rates'])} frequencies: P(jump) = A exp(-N/"
            f"{inverses[0]}) (95 %: {inverses[1]} to {inverses[2]}) for N pseudo periods per 1 %, A = {found.factor:.2f} ({found.factor_low:.2f} to "
            f"{found.factor_high:.2f}) from the exact sweeps. The same case with more frequencies and runs: [regimes](regimes.md)."
        )
    if has(*(f"jumps, {name}" for name in METHODS))(values):
        lines = []
        for row in values[f"jumps, {EVERY}"]:
            n = row["periods_per_percent"]
            told = "" if found is None else "{:.2f} ({:.2f} to {:.2f})".format(*found.probability(n))
            own = [next((x for x in values[f"jumps, {name}"] if x["periods_per_percent"] == n), None) for name in METHODS]
            shares = ["{reached} of {runs}: {share:.2f} ({low:.2f} to {high:.2f})".format(**x) if x else "" for x in own]
            lines.append((f"{n:g}", told, *shares))
        blocks.append("Share of sweeps down that reach the high branch:")
        blocks.append(markdown(("pseudo periods per 1 %", "predicted from rates", *METHODS), lines))
        names = ", ".join(
            f"{name} {sum(row['reached'] for row in rows)} and {sum(row['stayed'] for row in rows)} of {sum(row['runs'] for row in rows)}"
            for name in METHODS
            for rows in (values[f"jumps, {name}"],)
        )
        blocks.append(f"Of all these runs, reached the high branch, and never without impact for {SILENCE:g} pseudo periods: {names}.")
    if "drift" in values:
        drifts = ", ".join(f"{name} {spread(one['drift_m'], '{:.3f}', 1e3)} mm" for name, one in values["drift"].items())
        blocks.append(
            f"Drift of the absorber's place in a slow sweep from {DRIFT[0]:g} to {DRIFT[1]:g} that begins at rest, without impacts: {drifts}."
        )
    if "levels" in values:
        rows = [(f"{row['periods_per_percent']:g}", spread(row["level_m"], "{:.2f}", 1e3)) for row in values["levels"]]
        blocks.append(markdown(("pseudo periods per 1 %, down", "response level, mm"), rows))
    return "\n\n".join(blocks)


SHOWN = (  # of the panels above: force, title, and sweeps with their looks and words
    (
        "medium",
        "1.5 N",
        (
            ("down", LOOKS[2], "down, 725 periods a percent"),
            ("down, half the rate", LOOKS[4], "down, 1450"),
            ("down, paper's step", LOOKS[3], "down, 725, paper's step"),
        ),
    ),
    ("high", "3 N", (("high force, down", LOOKS[2], "down, 725 periods a percent"), ("high force, up", LOOKS[5], "up, 725"))),
)


def _draw(values: Json) -> Figure:
    """Draw the sweeps over the periodic responses, rates of leaving, and the share of sweeps that jump over their slowness."""
    figure, axes = panels(2, 2, 6.6)
    middles = 0.5 * (EDGES[1:] + EDGES[:-1])
    for own, (name, title, sweeps) in zip(axes[0], SHOWN, strict=True):
        draw(own, values[name])
        for sweep, look, label in sweeps:
            part = values["sweeps"][sweep]
            own.fill_between(middles, MM * np.array(part["low_m"]), MM * np.array(part["high_m"]), color=look.colour, alpha=0.3, lw=0)
            own.plot(middles, MM * np.array(part["nominal_m"]), color=look.colour, lw=0.8, drawstyle="steps-mid", label=label)
        top = 1.2 * MM * max(curve["peak"][1] for curve in values[name]["exact"])
        own.set(xlim=EDGES[[0, -1]], ylim=(0, top), xlabel=r"frequency $\Omega/\omega_1$")
        own.set_title(title)
    axes[0, 0].set_ylabel("largest tip displacement in mm")
    _draw_rates(axes[1, 0], values["rates"])
    _shares(axes[1, 1], values)
    legend_below(figure, axes[0], 3)
    legends(axes[1])
    return figure


def _draw_rates(axes: Axes, rates: Sequence[Json]) -> None:
    known = [row for row in rates if row["rate"] is not None]
    x, y, low, high = (np.array([row[name] for row in known]) for name in ("omega_ratio", "rate", "low", "high"))
    axes.errorbar(
        x, 1e4 * y, 1e4 * np.array([y - low, high - y]), fmt="o", ms=3, lw=0.9, color=LOOKS[0].colour, label="exits over time at risk, 95 %"
    )
    axes.set_ylim(top=1.3e4 * float(high.max()))
    axes.locator_params(axis="x", nbins=5)
    axes.set(xlabel=r"constant frequency $\Omega/\omega_1$", ylabel=r"rate of leaving, $10^{-4}$ per pseudo period")


def _shares(axes: Axes, values: Json) -> None:
    found = hazard_of(values)
    n = np.geomspace(80, 4000, 200)
    if found is not None:
        told = np.array([found.probability(float(each)) for each in n]).T
        axes.plot(n, told[0], color="black", lw=0.9, label="from the rates, times A")
        axes.fill_between(n, told[1], told[2], color="0.8", lw=0)
    for k, name in enumerate(METHODS):
        rows = values.get(f"jumps, {name}", ())
        x, y, low, high = (np.array([row[column] for row in rows]) for column in ("periods_per_percent", "share", "low", "high"))
        look, aside = LOOKS[k], 1.04 ** (k - 1)
        axes.errorbar(aside * x, y, [y - low, high - y], fmt=look.marker, ls=look.dashes if k else "", ms=4, lw=0.9, color=look.colour, label=name)
    axes.set(xscale="log", ylim=(-0.02, 1.05), xlabel="pseudo periods per 1 % of a sweep down", ylabel="share that jumps")


FIGURE = PaperFigure(
    LABEL, "sweeps through resonance, and the jump", measure=_measure, words=_words, draw=_draw, claims=jump_claims.claims,
    needs=has(*FORCES, "sweeps", "rates", "levels"),
    sizes=(
        Sizes(16, 200, 100, 100, 6000.0, 17, (100.0, 300.0, RATE, 2 * RATE, 4 * RATE), (1.0, 5.0, 20.0, 100.0, 300.0, RATE, 2 * RATE)),
        Sizes(4, 40, 12, 24, 1500.0, 9, (100.0, RATE, 2 * RATE), (1.0, 20.0, 100.0, 2 * RATE)),
    ),
)  # fmt: skip
