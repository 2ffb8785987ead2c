"""Test of calibrate's plan of further measurements.

It compares intervals after sweeps at the recommended forces with those after sweeps at equally
spaced forces.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import Any, NamedTuple

import click
import numpy as np

from optimisation.calibration.inference import (
    Ensemble,
    Inference,
    infer,
    prior_shares,
    simulate_ensemble,
)
from optimisation.calibration.measurement import RecordMeasurement
from optimisation.calibration.plan import MeasurementPlan, plan_measurement
from optimisation.calibration.posterior import Posterior
from optimisation.checkpoint import sources
from optimisation.cli.common import command
from studies.cli.check_calibration import (
    RIGS,
    SEED,
    TestRig,
    TruthKind,
    make_simulator,
    measure,
)
from studies.study import (
    Json,
    Measurement,
    OutputPaths,
    Study,
    add_table_options,
    format_table,
    make_rows_study,
    run,
)

NAME = "check_plan"  # also the page's marker of the first table
BY_FORCE = "widths_by_force"  # marker of the second
FORCE = 3.5  # N, of the first sweep
RIG = replace(RIGS[0], forces=(FORCE,), sweep=16.0)
TRUTHS = 10
FACTORS = (0.35, 1.0, 1.575, 2.8)  # of that force, among which the plan chooses
LARGEST = FACTORS[-1]
BELOW_LARGEST = (
    0.35,
    0.7,
    1.0,
    1.4,
    2.0,
)  # among which it chooses after a first sweep at the largest
FIRST_RUNS = 256
ROUND_RUNS = 64
ROUNDS = 2
ONE = "one sweep"
RECOMMENDED = "first at 3.5 N, then the recommended forces"
FROM_LARGEST = "first at 9.8 N, then the recommended forces"
SPACED = "equally spaced, from the least force to the largest"


def rig_at(factor: float) -> TestRig:
    """Return the rig with a force that is a factor times the first sweep's."""
    return replace(RIG, forces=(factor * FORCE,))


@cache
def prior_ensemble(factor: float, repeat: int) -> Ensemble:
    """Return simulations of one sweep over the prior, which all truths share.

    Each repeat has its own initial states and noise.
    """
    rig = rig_at(factor)
    (force,) = rig.forces
    load = rig.load(force)
    noise = np.random.default_rng(0).standard_normal(len(load.values))
    blank = RecordMeasurement(f"{force:g} N", load, noise, rig.sensor)
    seed = np.random.SeedSequence([SEED, 8, round(1000 * factor), repeat])
    own = int(seed.generate_state(1)[0])
    return simulate_ensemble(
        make_simulator(rig, [blank]), RIG.priors, prior_shares(RIG.priors, FIRST_RUNS, SEED), own
    )


class PlannedTruth:
    """Absorber number ``number``, with parameters from the prior and its simulated sweeps."""

    def __init__(self, number: int) -> None:
        self.number = number
        seed = [SEED, 9, number]
        self.shares = np.random.default_rng(seed).random((1, len(RIG.priors)))

    def measure(self, factors: Sequence[float]) -> list[RecordMeasurement]:
        """Return the measured sweeps at factors of the first force.

        A factor that occurs again gives a new measurement.
        """
        measurements = []
        for k, factor in enumerate(factors):
            repeat = list(factors[:k]).count(factor)
            seed = [SEED, 9, self.number, round(1000 * factor), repeat]
            (one,) = measure(rig_at(factor), TruthKind(), self.shares, seed)
            measurements.append(replace(one, name=f"{one.name}, {repeat + 1}"))
        return measurements

    def infer(self, factors: Sequence[float]) -> Inference:
        """Return the posterior of the sweeps at factors of the first force."""
        parts = [
            prior_ensemble(factor, list(factors[:k]).count(factor))
            for k, factor in enumerate(factors)
        ]
        first = replace(
            parts[0], statistics=np.concatenate([one.statistics for one in parts], axis=1)
        )
        return infer(
            make_simulator(RIG, self.measure(factors)),
            RIG.priors,
            seed=self.number,
            first=first,
            round_runs=ROUND_RUNS,
            rounds=ROUNDS,
        )

    def plan(
        self, inference: Inference, first_factor: float, factors: Sequence[float]
    ) -> MeasurementPlan:
        """Return the plan after a first sweep, among factors of the force of the rig."""
        posterior = Posterior(inference.names, inference.values)
        (first,) = self.measure([first_factor])
        return plan_measurement(
            RIG.beam,
            RIG.scene,
            first,
            posterior,
            1,
            factors=np.divide(factors, first_factor).tolist(),
            seed=self.number,
            threads=1,
        )

    def row(self, way: str, factors: Sequence[float], inference: Inference) -> Json:
        """Return the row of a posterior; numbers of parameters are shares of their priors."""
        draws = inference.shares
        low, median, high = np.quantile(draws, [0.05, 0.5, 0.95], axis=0)
        return {
            "number": self.number,
            "way": way,
            "factors": [round(float(one), 4) for one in factors],
            "truth": self.shares[0].round(6).tolist(),
            "low": low.round(5).tolist(),
            "median": median.round(5).tolist(),
            "high": high.round(5).tolist(),
            "deviation": np.std(draws, axis=0).round(5).tolist(),
            "correlation": round(float(np.corrcoef(draws[:, 0], draws[:, 1])[0, 1]), 4),
        }


def measure_truth(number: int) -> list[Json]:
    """Return the rows of one truth.

    They are one sweep at each force, and each way to choose the forces of two and three sweeps.
    """
    truth = PlannedTruth(number)
    alone = {factor: truth.infer([factor]) for factor in FACTORS}
    rows = [truth.row(ONE, [factor], one) for factor, one in alone.items()]
    plan = truth.plan(alone[1.0], 1.0, FACTORS)
    recommended = [1.0, *plan.next_factors[:2].tolist()]
    for count in (2, 3):
        spaced = np.linspace(FACTORS[0], FACTORS[-1], count).tolist()
        rows.append(truth.row(SPACED, spaced, truth.infer(spaced)))
        own = truth.row(RECOMMENDED, recommended[:count], truth.infer(recommended[:count]))
        expected = plan.together[count - 2] / plan.now
        rows.append(own | {"expected": expected.round(4).tolist()})
    return rows


def measure_from_largest(number: int) -> list[Json]:
    """Return the rows of one truth whose first sweep is at the largest force."""
    truth = PlannedTruth(number)
    plan = truth.plan(truth.infer([LARGEST]), LARGEST, BELOW_LARGEST)
    recommended = [LARGEST, *(BELOW_LARGEST[k] for k in plan.order[:2])]
    return [
        truth.row(FROM_LARGEST, recommended[:count], truth.infer(recommended[:count]))
        for count in (2, 3)
    ]


def list_cases(truths: int) -> dict[Any, Callable[[], list[Json]]]:
    """Return all truths, those with a first sweep at the largest force last."""
    parts = {False: measure_truth, True: measure_from_largest}
    return {
        (largest, number): partial(function, number)
        for largest, function in parts.items()
        for number in range(truths)
    }


class Widths(NamedTuple):
    """Mean widths of intervals, in percent of the prior, of some posteriors."""

    each: str
    together: str
    inside: str


def summarise_widths(rows: Sequence[Json]) -> Widths:
    """Return the mean widths of the parameters' intervals, and their coverage.

    The widths are those of each parameter, and the geometric mean of all parameters with its
    standard error.
    """
    low, high, truth = (np.array([row[name] for row in rows]) for name in ("low", "high", "truth"))
    width = 100 * (high - low)
    together = np.exp(np.mean(np.log(width), axis=1))
    error = np.std(together, ddof=1) / np.sqrt(len(rows)) if len(rows) > 1 else np.nan
    inside = (low <= truth) & (truth <= high)
    return Widths(
        " / ".join(f"{one:.1f}" for one in np.mean(width, axis=0)),
        f"{np.mean(together):.1f} +- {error:.1f}",
        f"{100 * np.mean(inside):.0f}",
    )


WAYS = (
    (1, ONE),
    *((count, way) for count in (2, 3) for way in (RECOMMENDED, SPACED, FROM_LARGEST)),
)


def way_rows(rows: Sequence[Json]) -> list[Json]:
    """Return a row for each number of sweeps and each way to choose their forces.

    The row of one sweep is that of the first sweep.
    """
    result = []
    for count, way in WAYS:
        own = [row for row in rows if row["way"] == way and len(row["factors"]) == count]
        if way == ONE:
            own = [row for row in own if row["factors"] == [1.0]]
        if own:
            widths = summarise_widths(own)
            words = f"{way} at {FORCE:g} N" if way == ONE else way
            result.append({"sweeps": count, "way": words, "truths": len(own), **widths._asdict()})
    return result


def force_rows(rows: Sequence[Json]) -> list[Json]:
    """Return a row for each force of one sweep.

    A row has the widths, and the correlation of restitution and friction limit.
    """
    result = []
    for factor in FACTORS:
        own = [row for row in rows if row["way"] == ONE and row["factors"] == [factor]]
        if own:
            correlations = [row["correlation"] for row in own]
            result.append(
                {
                    "force": factor * FORCE,
                    "truths": len(own),
                    "correlation": float(np.median(correlations)),
                    "low": float(np.min(correlations)),
                    "high": float(np.max(correlations)),
                    **summarise_widths(own)._asdict(),
                }
            )
    return result


def write_ways(measured: Measurement) -> str:
    """Return the table of ways to choose forces."""
    columns = {
        "sweeps": "{sweeps}",
        "forces": "{way}",
        "truths": "{truths}",
        "width of restitution / friction / gap, % of the prior": "{each}",
        "together (geometric mean)": "{together}",
        "in the 90 % intervals, %": "{inside}",
    }
    return format_table(columns, way_rows(measured.values["rows"]))


def write_forces(measured: Measurement) -> str:
    """Return the table of forces of one sweep."""
    columns = {
        "force, N": "{force:.3g}",
        "truths": "{truths}",
        "width of restitution / friction / gap, % of the prior": "{each}",
        "correlation of restitution and friction, median (least to largest)": (
            "{correlation:+.2f} ({low:+.2f} to {high:+.2f})"
        ),
    }
    return format_table(columns, force_rows(measured.values["rows"]))


STUDY: Study[int] = make_rows_study(
    NAME,
    "intervals by the forces of the sweeps",
    cases=list_cases,
    key=lambda row: (row["way"] == FROM_LARGEST, row["number"]),
    text=write_ways,
    key_values=lambda _: {
        "first_runs": FIRST_RUNS,
        "round_runs": ROUND_RUNS,
        "rounds": ROUNDS,
    },
    markers=(NAME, BY_FORCE),
    sections=lambda result: {
        NAME: f"{write_ways(result)}\n\n{sources(result.conditions)}",
        BY_FORCE: write_forces(result),
    },
    summary=lambda result: f"{write_ways(result)}\n\n{write_forces(result)}",
)


@command()
@click.option("--quick", is_flag=True, help="A look: one truth.")
@click.option(
    "--truths",
    type=click.IntRange(min=1),
    default=TRUTHS,
    show_default=True,
    help="Truths from the prior.",
)
@add_table_options(NAME, "docs/calibrate.md")
def main(quick: bool, truths: int, place: OutputPaths) -> None:
    """Print the width of calibrate's intervals after sweeps at recommended forces.

    The comparison is with sweeps at equally spaced forces.

    Truths are drawn from the prior and measured by simulation on the paper's beam with a
    displacement sensor. A second table has the widths after one sweep, by its force. Ctrl-C prints,
    and writes, what is finished; with --json the same command goes on.
    """
    run(STUDY, 1 if quick else truths, place)
