"""Sweeps through resonance, and the jump to the high branch as a probability (paper, section 3.1, its figure jump)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from impact_env.curve import BAND, quantiles
from impact_env.drive import FrequencySchedule, linear_sweep
from impact_env.ensemble import Lane, draw_members
from impact_env.methods import Exact, Method, Moreau
from impact_env.parameters import Beam, impact_absorber
from impact_env.periodic.approach import Approach
from impact_env.periodic.jump import Hazard, Range, hazard, jumps
from impact_env.periodic.residence import SILENCE, ExitRate, exit_rate, stays
from impact_env.response import Record
from impact_env.scene import Scene, beam_scene
from impact_env.sweep import simulate
from optimisation.progress import sweeps_bar
from optimisation.report.markdown import markdown
from optimisation.studies.paper.frame import figure_part, has, in_turn
from optimisation.studies.paper.jump_claims import claims as claims
from optimisation.studies.paper.responses import responses
from optimisation.studies.paper.settings import Settings
from optimisation.studies.paper.words import spread
from optimisation.studies.study import Json, Measured, Saver, Steps, Table

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
FINER = 200  # steps a period of the highest mode: ten times the paper's
EVERY = "exact"
METHODS: dict[str, Method] = {EVERY: Exact(), "paper's step": Moreau(), "ten times finer": Moreau(FINER)}
BURN_IN = 100.0  # pseudo periods of a stay that are left out of its rate


@dataclass(frozen=True)
class Sizes:
    """How much is computed: members of sweeps, of jumps (with ten times finer steps) and of stays, their length, frequencies, and slownesses."""

    sweeps: int = 16
    jumps: int = 200
    finer: int = 100
    stays: int = 100
    periods: float = 6000.0
    ratios: int = 17
    slownesses: tuple[float, ...] = (100.0, 300.0, RATE, 2 * RATE, 4 * RATE)
    fast: tuple[float, ...] = (1.0, 5.0, 20.0, 100.0, 300.0, RATE, 2 * RATE)


QUICK = Sizes(4, 40, 12, 24, 1500.0, 9, (100.0, RATE, 2 * RATE), (1.0, 20.0, 100.0, RATE))


def scene() -> Scene:
    """Return the paper's beam and absorber of this figure."""
    return beam_scene(Beam(modes=MODES), impact_absorber(friction_limit=FRICTION))


def sizes(settings: Settings) -> Sizes:
    """Return how much is computed."""
    return settings.size(Sizes(), QUICK)


def parameters(settings: Settings) -> Json:
    """Return what the numbers depend on."""
    return {"scene": str(scene()), "sweeps": str(SWEEPS), "over": str(OVER), "sizes": str(sizes(settings)), "silence": SILENCE, "burn_in": BURN_IN}


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


def _sweeps(settings: Settings) -> Json:
    """Return for each of `SWEEPS` the paper's own run, the band of all members, and where they are on the branch and at resonance."""
    own, result = scene(), {}
    members = draw_members(sizes(settings).sweeps, settings.seed)
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


def _rates(settings: Settings) -> list[Json]:
    """Return exits and time at risk at constant frequencies."""
    size, own = sizes(settings), scene()
    phases = draw_members(size.stays, settings.seed, "phase").phases.tolist()
    rows = []
    for ratio in np.round(np.linspace(OVER.first, OVER.last, size.ratios), 6).tolist():
        with sweeps_bar(f"{LABEL}: stays at {ratio:g}", leave=False) as show:
            approach = Approach(own.model.resonance_omega(1), 1.0)
            found = stays(
                own, FORCES["medium"], approach, ratio, size.periods, phases, threads=settings.threads, progress=show, executor=settings.executor
            )  # fmt: skip
        rate = exit_rate(found, BURN_IN)
        rows.append(
            {"omega_ratio": ratio, "exits": rate.exits, "exposure": rate.exposure} | {k: _plain(getattr(rate, k)) for k in ("rate", "low", "high")}
        )
    return rows


def _plain(value: float) -> float | None:
    return None if np.isnan(value) else float(value)


def _jumps(settings: Settings, name: str) -> list[Json]:
    """Return how many sweeps jump at each slowness, by one of the `METHODS`."""
    size, own, rows = sizes(settings), scene(), []
    slownesses: Sequence[float] = size.slownesses if name != "ten times finer" else [n for n in size.slownesses if n in (RATE, 2 * RATE)]
    phases = draw_members(size.finer if name == "ten times finer" else size.jumps, settings.seed + 1, "phase").phases.tolist()
    for slowness in slownesses:
        with sweeps_bar(f"{LABEL}: {name}, {slowness:g} periods a percent", leave=False) as show:
            approach = Approach(own.model.resonance_omega(1), 1.0)
            found = jumps(
                own, FORCES["medium"], approach, OVER, slowness, phases, method=METHODS[name],
                threads=settings.threads, progress=show, executor=settings.executor,
            )  # fmt: skip
        low, high = found.interval()
        rows.append({"periods_per_percent": slowness, "jumped": found.jumped, "present": found.present, "share": _plain(found.share)})
        rows[-1] |= {"low": low, "high": high}
    return rows


@dataclass(frozen=True)
class Level:
    """The response level of a lane in m."""

    def __call__(self, lane: Lane) -> float:
        """Return it."""
        level = simulate(lane.scene, lane.drive).level
        assert level is not None
        return level.value


def _levels(settings: Settings) -> list[Json]:
    """Return response levels of sweeps down over their slowness."""
    own, rows = scene(), []
    members = draw_members(sizes(settings).sweeps, settings.seed)
    for slowness in sizes(settings).fast:
        schedule = linear_sweep(own.model.resonance_omega(1), HIGH, LOW, 100 / slowness)
        lanes = [Lane(own, drive) for drive in members.drives(FORCES["medium"], schedule)]
        rows.append({"periods_per_percent": slowness, "level_m": settings.each(f"{LABEL}: levels", lanes, Level())})
    return rows


def _measure(settings: Settings, known: Json) -> Steps:
    groups: dict[str, Callable[[], Any]] = {name: partial(responses, scene(), force, LOW, HIGH) for name, force in FORCES.items()}
    groups |= {"sweeps": partial(_sweeps, settings), "rates": partial(_rates, settings)}
    groups |= {f"jumps, {name}": partial(_jumps, settings, name) for name in METHODS}
    return in_turn({**groups, "levels": partial(_levels, settings)}, known)


def hazard_of(rates: Sequence[Json]) -> Hazard | None:
    """Return the integral of the rates of leaving, None where fewer than two frequencies have one."""
    known = [row for row in rates if row["rate"] is not None]
    if len(known) < 2:
        return None
    counts = [ExitRate(row["exits"], row["exposure"], row["rate"], row["low"], row["high"]) for row in known]
    return hazard([row["omega_ratio"] for row in known], counts)


def _words(values: Json) -> str:
    blocks = []
    found = hazard_of(values["rates"]) if has(values, "rates") else None
    if found is not None:
        inverses = [f"{1 / x:.0f}" if x > 0 else "no end" for x in (found.value, found.high, found.low)]
        blocks.append(
            f"Integral of the rate of leaving from {found.first:g} to {found.last:g}: P(jump) = exp(-N/{inverses[0]}) "
            f"(95 %: {inverses[1]} to {inverses[2]}) for N pseudo periods per 1 %."
        )
    if has(values, *(f"jumps, {name}" for name in METHODS)):
        lines = []
        for row in values[f"jumps, {EVERY}"]:
            n = row["periods_per_percent"]
            told = "" if found is None else "{:.2f} [{:.2f}, {:.2f}]".format(*found.probability(n))
            shares = [next((_share(own) for own in values[f"jumps, {name}"] if own["periods_per_percent"] == n), "") for name in METHODS]
            lines.append((f"{n:g}", told, *shares))
        blocks.append(markdown(("pseudo periods per 1 %", "predicted from rates", *METHODS), lines))
    if has(values, "levels"):
        rows = [(f"{row['periods_per_percent']:g}", spread(row["level_m"], "{:.2f}", 1e3)) for row in values["levels"]]
        blocks.append(markdown(("pseudo periods per 1 %, down", "response level, mm"), rows))
    return "\n\n".join(blocks)


def _share(row: Json) -> str:
    return f"{row['jumped']} of {row['present']}: " + ("" if row["share"] is None else f"{row['share']:.2f} [{row['low']:.2f}, {row['high']:.2f}]")


def _tables(measured: Measured) -> list[Table]:
    values, tables = measured.values, []
    counted = [(name, row) for name in METHODS for row in values.get(f"jumps, {name}", ())]
    if counted:
        tables.append(Table(f"{LABEL}_shares", ("method", *counted[0][1]), [(name, *row.values()) for name, row in counted]))
    if values.get("rates"):
        tables.append(Table(f"{LABEL}_rates", tuple(values["rates"][0]), [tuple(row.values()) for row in values["rates"]]))
    return tables


def _figures(measured: Measured) -> dict[str, Saver]:
    if not has(measured.values, *FORCES, "sweeps", "rates", "levels"):
        return {}
    from optimisation.studies.paper.figures import jump  # matplotlib is slow to import

    return {LABEL: lambda path: jump.save(path, measured.values, hazard_of(measured.values["rates"]), EDGES, tuple(METHODS))}


PART = figure_part(LABEL, "sweeps through resonance, and the jump", _measure, _words, _figures, _tables)
