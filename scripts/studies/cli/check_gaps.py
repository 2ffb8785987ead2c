"""Compare the results of design_gap with a brute-force scan of gaps on thirty structures."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from operator import itemgetter
from typing import Any, NamedTuple

import click
import numpy as np

from impact_env import Drive, Scene, SlidingAbsorber, simulate
from impact_env.drive import default_rate, linear_sweep
from impact_env.ensemble import Executor, Lane, each_lane
from optimisation.absorber_rules import scaled_absorber
from optimisation.cli.common import (
    cluster_option,
    command,
    rate_option,
    threads_option,
)
from optimisation.executors import workers
from optimisation.gap_advice import MEMBERS, TOLERANCE, Advice, Answer, expected_factor, search_gap
from optimisation.load_cases import swept_force
from studies.structures import CASES, HARD_CASES, StructureCase
from studies.study import (
    Array,
    Json,
    Measurement,
    OutputPaths,
    Study,
    add_table_options,
    format_table,
    make_rows_study,
    not_none,
    run,
)

FORCE = 1.0  # N; it does not matter, as gap and friction are in proportion to it
FACTORS = (1 - TOLERANCE, 1.0, 1 + TOLERANCE)  # of the force, each simulated
# of ln gap from where a search starts; half a step off the gaps that a search tries
STEP = 0.1
FROM = -0.725
TO = 0.8
CANDIDATES = 4  # gaps of the scan that are run again
CANDIDATE_RUNS = 4
JUDGES = 12  # runs with new phases for each gap that is compared
SEED = 2026


class GapSettings(NamedTuple):
    """Settings of the comparison.

    ``members`` are the runs for each gap of the search, ``step`` is the scan's step of ln gap,
    ``rate`` that of the sweeps (None: the default), and ``judges`` the runs with which designs are
    compared.
    """

    cases: tuple[StructureCase, ...]
    members: int = MEMBERS
    step: float = STEP
    rate: float | None = None
    judges: int = JUDGES
    threads: int | None = None
    executor: Executor | None = None


def level_of(lane: Lane) -> float:
    """Return the response level of a lane in m."""
    return simulate(lane.scene, lane.drive, initial=lane.start).recorded.level.value


@dataclass
class BruteForce:
    """Levels by sweeps up and down with phases of its own; ``where``: threads and executor."""

    advice: Advice
    generator: np.random.Generator
    where: dict[str, Any]

    def levels(
        self, absorbers: Sequence[SlidingAbsorber], factors: Sequence[float], runs: int
    ) -> Array:
        """Return the larger level of the sweeps up and down in m, (absorbers, factors, runs).

        Raises KeyboardInterrupt if it is stopped.
        """
        check = self.advice.check
        omega = check.model.resonance_omega(check.resonance)
        low, high = check.limits
        schedules = [
            linear_sweep(omega, start, stop, check.rate)
            for start, stop in ((low, high), (high, low))
        ]
        lanes = []
        for absorber in absorbers:
            scene = Scene(check.model, absorber)
            for factor in factors:
                for phase in self.generator.uniform(0, 2 * np.pi, runs):
                    for schedule in schedules:
                        drive = Drive(factor * FORCE, schedule, float(phase))
                        lanes.append(Lane(scene, drive, steady_start=True))
        values = each_lane(lanes, level_of, **self.where)
        if any(value is None for value in values):
            raise KeyboardInterrupt
        shape = (len(absorbers), len(factors), runs, 2)
        return np.asarray(np.array(values, dtype=float).reshape(shape).max(axis=-1))


def row(case: StructureCase, settings: GapSettings) -> list[Json]:
    """Return a case's one row; raises KeyboardInterrupt if it is stopped."""
    model = case.model()
    absorber = scaled_absorber(model, FORCE, case.resonance, case.mass_ratio)
    where: Json = {"threads": settings.threads, "executor": settings.executor}
    swept = swept_force(model, FORCE, case.resonance, case.mass_ratio, settings.rate)
    result = search_gap(swept, absorber, members=settings.members, **where)
    if not result.complete:
        raise KeyboardInterrupt
    scan = BruteForce(result, np.random.default_rng([SEED, case.resonance]), where)
    start = np.log(expected_factor(result.check.reach))
    gaps = result.check.rule * np.exp(start + np.arange(FROM, TO, settings.step))
    return [judged(case, result, gaps, scan.levels, settings.judges)]


def scaled(absorber: SlidingAbsorber, gap: float) -> SlidingAbsorber:
    """Return an absorber with another gap in m, its friction limit in proportion."""
    walls = absorber.walls
    friction = absorber.friction
    assert walls is not None
    return replace(
        absorber,
        walls=replace(walls, gap=gap),
        friction=None
        if friction is None
        else replace(friction, limit=friction.limit * gap / walls.gap),
    )


LevelsOf = Callable[[Sequence[SlidingAbsorber], Sequence[float], int], Array]


def judged(case: StructureCase, result: Advice, gaps: Array, levels: LevelsOf, judges: int) -> Json:
    """Return a case's row.

    ``recommended``: the largest median level of the recommended device over three forces, over the
    lowest such of the scan; ``sharp``: its median level over the lowest of the scan. Both are of
    ``judges`` fresh runs, also of the scan's own gaps. ``coverage``: share of the fresh runs of
    both devices in their 90 % intervals. ``best`` is the scan's best gap for three forces over the
    rule's; ``relative``: its level over that without absorber.
    """
    sharp = not_none(result.sharp)
    recommended = not_none(result.recommended)
    devices = [scaled(result.check.absorber, float(gap)) for gap in gaps]

    def best_of(single: Array, worst: bool) -> SlidingAbsorber:
        """Return the device with the lowest median level.

        Devices are first selected by single runs, then by `CANDIDATE_RUNS` runs of the best.
        """
        order = np.argsort(single)[:CANDIDATES]
        chosen = [devices[k] for k in order]
        runs = levels(chosen, FACTORS if worst else (1.0,), CANDIDATE_RUNS)
        medians = np.median(runs, axis=2).max(axis=1)
        return chosen[int(np.argmin(medians))]

    single = levels(devices, FACTORS, 1)[..., 0]
    best_robust = best_of(single.max(axis=1), worst=True)
    best_sharp = best_of(single[:, 1], worst=False)

    robust = levels([recommended.absorber, best_robust], FACTORS, judges)
    at_force = levels([sharp.absorber, best_sharp], (1.0,), judges)[:, 0]
    over_forces = np.median(robust, axis=2).max(axis=1)
    medians = np.median(at_force, axis=1)
    inside = np.concatenate([within(recommended, robust[0, 1]), within(sharp, at_force[0])])
    check = result.check
    assert best_robust.walls is not None
    return {
        "name": case.name,
        "resonance": case.resonance,
        "damping": float(check.model.damping_ratio[case.resonance - 1]),
        "mass_ratio": case.mass_ratio,
        "reach": check.reach,
        "best": best_robust.walls.gap / check.rule,
        "relative": float(np.median(robust[1, 1]) / check.without.median[0]),
        "recommended": float(over_forces[0] / over_forces[1]),
        "sharp": float(medians[0] / medians[1]),
        "coverage": float(np.mean(inside)),
        "sweeps": result.sweeps,
    }


def within(answer: Answer, runs: Array) -> Array:
    """Return which of the new levels lie in a result's interval."""
    return np.asarray((runs >= answer.low) & (runs <= answer.high))


NAME = "check_gaps"  # also the page's marker
QUICK_CASES = (12, 19)
QUICK_STEP = 0.3
QUICK_JUDGES = 4
TOLERATED = 1.1
SHARP_TOLERATED = 1.15


def table(measured: Measurement) -> str:
    """Return a line for each case, how many are good, and the worst."""
    order = [(case.name, case.resonance, case.mass_ratio) for case in CASES + HARD_CASES]
    rows_by_name = {
        (r["name"], r["resonance"], r["mass_ratio"]): r for r in measured.values["rows"]
    }
    result = [rows_by_name[key] for key in order if key in rows_by_name]
    columns = {
        "structure": "{name}",
        "resonance": "{resonance}",
        "damping, %": "{percent[0]:.3g}",
        "mass, %": "{percent[1]:g}",
        "reach": "{reach:.3g}",
        "best gap over rule's": "{best:.2f}",
        "level there, %": "{percent[2]:.1f}",
        "`recommended`": "{recommended:.2f}",
        "`sharp`": "{sharp:.2f}",
        "in the 90 % interval, %": "{percent[3]:.0f}",
        "sweeps": "{sweeps}",
    }
    names = ("damping", "mass_ratio", "relative", "coverage")
    rows = ({**r, "percent": [100 * r[name] for name in names]} for r in result)
    words = []
    for name, most in (("recommended", TOLERATED), ("sharp", SHARP_TOLERATED)):
        worst = max(result, key=lambda r, name=name: float(r[name]))  # type: ignore[misc]
        good = sum(r[name] <= most for r in result)
        words.append(
            f"`{name}` within {most:g} of the scan's best: {good} of {len(result)}, worst "
            f"{worst[name]:.2f} "
            f"({worst['name']}, resonance {worst['resonance']})"
        )
    coverage = 100 * float(np.mean([r["coverage"] for r in result]))
    words.append(f"fresh runs in the 90 % intervals: {coverage:.0f} %")
    return f"{format_table(columns, rows)}\n\n{'; '.join(words)}."


STUDY: Study[GapSettings] = make_rows_study(
    NAME,
    "the answers of design_gap beside scans by brute force",
    cases=lambda settings: {
        (case.name, case.resonance, case.mass_ratio): partial(row, case, settings)
        for case in settings.cases
    },
    key=itemgetter("name", "resonance", "mass_ratio"),
    text=table,
    key_values=lambda settings: {
        "members": settings.members,
        "step": settings.step,
        "rate": settings.rate,
        "judges": settings.judges,
    },
)


@command()
@click.option("--quick", is_flag=True, help="A look: two structures, with a coarse scan.")
@click.option(
    "--members",
    type=click.IntRange(min=1),
    help="Runs for each gap of the search.  [default: those of design_gap]",
)
@click.option(
    "--judges",
    type=click.IntRange(min=1),
    help=f"Fresh runs by which a gap is judged.  [default: {JUDGES}]",
)
@rate_option
@threads_option
@cluster_option
@add_table_options(NAME, "docs/gap_method.md")
def main(quick: bool, cluster: str | None, place: OutputPaths, **options: Any) -> None:
    """Print the loss of design_gap's results against a brute-force scan of gaps.

    The comparison has thirty structures.

    The scan simulates levels at 0.9, 1 and 1.1 of the force with phases of its own; its best gaps
    and the answers are judged by fresh runs. Ctrl-C prints, and writes, what is finished; with
    --json the same command goes on from there.
    """
    with workers(options["threads"], cluster) as result:
        options |= {
            "members": options["members"] or MEMBERS,
            "judges": options["judges"] or (QUICK_JUDGES if quick else JUDGES),
            "threads": options["threads"] if result is None else None,
        }
        # the shortest sweeps first
        every = sorted(
            CASES + HARD_CASES, key=lambda case: -default_rate(case.model(), (case.resonance,))
        )
        settings = GapSettings(
            tuple(CASES[k] for k in QUICK_CASES) if quick else tuple(every),
            step=QUICK_STEP if quick else STEP,
            executor=result,
            **options,
        )
        run(STUDY, settings, place)
