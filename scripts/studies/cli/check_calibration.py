"""Test the posteriors of calibrate on simulated measurements.

The truths come from the prior, some measurements are disturbed, and some truths lie outside the
model.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any, NamedTuple

import click
import numpy as np
import scipy

from impact_env import (
    Beam,
    CompliantWalls,
    ElasticCoulombFriction,
    YieldingWalls,
    beam_scene,
    impact_absorber,
    linear_sweep,
)
from impact_env.drive import FrequencySchedule
from impact_env.loads import Samples
from impact_env.parameters import SlidingAbsorber
from impact_env.scene import Scene
from optimisation.calibration.inference import (
    Ensemble,
    infer,
    prior_shares,
    simulate_ensemble,
    values_at,
)
from optimisation.calibration.measurement import (
    ACCELERATION,
    DISPLACEMENT,
    RecordMeasurement,
    Sensor,
)
from optimisation.calibration.parameters import Prior, scene_with
from optimisation.calibration.predictive import check_posterior
from optimisation.calibration.simulation import Simulator
from optimisation.cli.common import command
from studies.study import (
    Array,
    Json,
    Measurement,
    OutputPaths,
    Study,
    add_table_options,
    format_table,
    make_rows_study,
    run,
)

NAME = "check_calibration"  # also the page's marker
SEED = 2028
TRUTHS = 100  # of each structure, in the model
DISTURBED = 20  # of each kind of disturbance
OUTSIDE = 6  # of each kind outside the model
MODEL = "the model"
COMPLIANT = "compliant walls"
YIELDING = "restitution falls with speed"
FRICTIONLESS = "no friction, 0.1 N fixed in the model"
FREE_FRICTION = "no friction, free in the model"
AT_ZERO = 0.02  # of the prior's range: an interval that begins below it reaches 0
SHARE_IN_INTERVAL = 0.9
RANK_BINS = 10
EVERY = 10  # truths in the model between two of each kind
SMALL_PROBABILITY = 0.05  # of the predictive check, below which the model is refused


@dataclass(frozen=True)
class TestRig:
    """A structure with a sensor and swept forces that represents a shaker test.

    The truth is drawn from ``priors``. ``rounds`` is the largest number of rounds of a posterior,
    None: the study's number.
    """

    name: str
    beam: Beam
    forces: tuple[float, ...]
    rate: float  # Hz, of the samples
    sweep: float  # % per 100 pseudo periods
    sensor: Sensor
    gap: float
    priors: tuple[Prior, ...]
    mass_ratio: float = 0.02
    rounds: int | None = None

    @property
    def scene(self) -> Scene:
        """Scene with values in the middle of the priors."""
        return beam_scene(self.beam, impact_absorber(self.gap, 0.6, 0.1, self.mass_ratio))

    @property
    def schedule(self) -> FrequencySchedule:
        """Sweep through the first resonance."""
        return linear_sweep(self.scene.model.resonance_omega(1), 0.92, 1.06, self.sweep)

    def load(self, force: float) -> Samples:
        """Return the record of a force with this amplitude in N."""
        schedule = self.schedule
        end = float(schedule.times[-1])
        times = np.arange(int(end * self.rate) + 1) / self.rate
        return Samples(times, force * np.cos(schedule.phase_at(times)))


def make_rigs() -> tuple[TestRig, ...]:
    """Return three test rigs.

    They are the paper's beam with a displacement sensor, a tube with an accelerometer, and the beam
    with an accelerometer under three forces.

    Each has three modes. The sampling rate of the last is twice that of the others.
    """
    paper = TestRig(
        "paper's beam, displacement",
        Beam(modes=3),
        (3.5,),
        800.0,
        8.0,
        Sensor(DISPLACEMENT, noise=1e-5),
        1e-3,
        (
            Prior("restitution", 0.3, 0.9),
            Prior("friction_limit", 1e-6, 0.3),
            Prior("gap", 0.6e-3, 1.5e-3),
        ),
    )
    tube = TestRig(
        "tube with a tool, acceleration",
        Beam(
            length=1.0,
            bending_stiffness=70e9 * np.pi / 64 * (0.05**4 - 0.044**4),
            mass_per_length=2700.0 * np.pi / 4 * (0.05**2 - 0.044**2),
            tip_mass=0.2,
            damping_ratio=0.006,
            modes=3,
        ),
        (6.0,),
        800.0,
        6.0,
        Sensor(ACCELERATION, noise=0.2),
        1.5e-3,
        (
            Prior("restitution", 0.3, 0.9),
            Prior("friction_limit", 1e-6, 0.5),
            Prior("gap", 0.8e-3, 2.2e-3),
        ),
    )
    loud = replace(
        paper,
        name="paper's beam, acceleration, three forces",
        forces=(2.0, 7.0, 14.0),
        rate=1600.0,
        sensor=Sensor(ACCELERATION, noise=0.2),
        rounds=2,
    )
    return paper, tube, loud


RIGS = make_rigs()
COVERED = RIGS[:2]  # of which coverage is measured
SEVERAL_FORCES = RIGS[2]  # on which the check meets absorbers that the model lacks
Change = Callable[[Array, np.random.Generator], Array]  # of a measured response (K,)


def add_noise(share: float) -> Change:
    """Return a change of the response that adds white noise unknown to the sensor.

    The noise has the given share of the response's root mean square. The sensor's data do not
    contain it.
    """

    def change(response: Array, generator: np.random.Generator) -> Array:
        noise = generator.standard_normal(len(response))
        return response + share * float(np.std(response)) * noise

    return change


def add_drift(response: Array, _generator: np.random.Generator) -> Array:
    """Return a response with a straight drift as large as its largest value."""
    return np.asarray(response + np.linspace(0.0, float(np.max(np.abs(response))), len(response)))


def clip_peaks(response: Array, _generator: np.random.Generator) -> Array:
    """Return a response that is clipped at 80 % of its largest value."""
    limit = 0.8 * float(np.max(np.abs(response)))
    return np.clip(response, -limit, limit)


def scale_by(factor: float) -> Change:
    """Return a wrong scale of the sensor."""
    return lambda response, _generator: np.asarray(factor * response)


class TruthKind(NamedTuple):
    """A kind of truth that differs from the model.

    It has another ``absorber`` or structure (``damping``, ``modes``) than the model, or a
    ``change`` of the measured response. ``outside`` says whether the model lacks it, ``known`` has
    the parameters that are not free in the model.
    """

    absorber: Callable[[SlidingAbsorber], SlidingAbsorber] = lambda absorber: absorber
    change: Change = lambda response, _generator: response
    damping: float = 1.0  # factor
    modes: int = 0  # more than the model has
    outside: bool = False  # whether the model lacks it: on the rig `SEVERAL_FORCES`
    known: tuple[str, ...] = ()  # parameters that the model does not have free


def with_compliant_walls(absorber: SlidingAbsorber) -> SlidingAbsorber:
    """Return the absorber with compliant walls.

    The walls are springs of such a stiffness that a contact lasts a tenth of a period of the beam.
    """
    walls = absorber.walls
    friction = absorber.friction
    assert walls is not None
    assert friction is not None
    stiffness = 300.0
    return replace(
        absorber,
        walls=CompliantWalls(stiffness, walls.gap, max(walls.restitution, 0.01)),
        friction=ElasticCoulombFriction(friction.limit, 100 * stiffness),
    )


def with_yielding_walls(absorber: SlidingAbsorber) -> SlidingAbsorber:
    """Return the absorber whose restitution falls from 0.02 m/s on."""
    walls = absorber.walls
    assert walls is not None
    return replace(absorber, walls=YieldingWalls(0.02, walls.gap, walls.restitution))


def without_friction(absorber: SlidingAbsorber) -> SlidingAbsorber:
    """Return the absorber without friction."""
    return replace(absorber, friction=None)


KINDS: dict[str, TruthKind] = {
    MODEL: TruthKind(),
    "noise of 1 %": TruthKind(change=add_noise(0.01)),
    "noise of 5 %": TruthKind(change=add_noise(0.05)),
    "drift": TruthKind(change=add_drift),
    "peaks clipped at 80 %": TruthKind(change=clip_peaks),
    "sensor's scale 20 % too large": TruthKind(change=scale_by(1.2)),
    "damping 20 % larger": TruthKind(damping=1.2),
    "two more modes": TruthKind(modes=2),
    COMPLIANT: TruthKind(absorber=with_compliant_walls, outside=True),
    YIELDING: TruthKind(absorber=with_yielding_walls, outside=True),
    FRICTIONLESS: TruthKind(absorber=without_friction, outside=True, known=("friction_limit",)),
    FREE_FRICTION: TruthKind(absorber=without_friction),
}


def make_simulator(rig: TestRig, measurements: Sequence[RecordMeasurement]) -> Simulator:
    """Return a simulator of a rig's measurements that runs in one thread."""
    return Simulator(rig.beam, rig.scene, measurements, 1, threads=1)


def measure(
    rig: TestRig,
    kind: TruthKind,
    shares: Array,
    seed: list[int],
    priors: tuple[Prior, ...] | None = None,
) -> list[RecordMeasurement]:
    """Return the measurements of a truth at ``shares`` (1, P) of the priors.

    By default the priors are all of the rig.
    """
    generator = np.random.default_rng(seed)
    own = rig.priors if priors is None else priors
    values = values_at(own, shares)[0]
    names = [one.name for one in own]
    scene = scene_with(rig.scene, dict(zip(names, values.tolist(), strict=True)), 1)
    beam = replace(
        rig.beam,
        modes=rig.beam.modes + kind.modes,
        damping_ratio=rig.beam.damping_ratio * kind.damping,  # type: ignore[operator]
    )
    absorber = scene.absorber
    assert isinstance(absorber, SlidingAbsorber)
    true_scene = beam_scene(beam, kind.absorber(absorber))
    measurements = []
    for force in rig.forces:
        load = rig.load(force)
        start = generator.standard_normal(len(load.values))  # a response whose length counts
        blank = RecordMeasurement(f"{force:g} N", load, start, rig.sensor)
        part = Simulator(beam, true_scene, [blank], 1, threads=1).parts[0]
        (lane,) = part.lanes([true_scene], int(generator.integers(2**31)))
        response = kind.change(part.recorder(lane), generator)
        measurements.append(replace(blank, response=response))
    return measurements


def free_priors(rig: TestRig, kind: TruthKind) -> tuple[Prior, ...]:
    """Return the priors of the parameters that are free."""
    return tuple(one for one in rig.priors if one.name not in kind.known)


@cache
def first_ensemble(name: str, runs: int, known: tuple[str, ...] = ()) -> Ensemble:
    """Return the simulations over the prior that all truths of a rig share."""
    (rig,) = (one for one in RIGS if one.name == name)
    priors = free_priors(rig, TruthKind(known=known))
    loads = [rig.load(force) for force in rig.forces]
    noise = np.random.default_rng(0).standard_normal(len(loads[0].values))
    blanks = [
        RecordMeasurement(f"{force:g} N", load, noise, rig.sensor)
        for force, load in zip(rig.forces, loads, strict=True)
    ]
    simulator = make_simulator(rig, blanks)
    return simulate_ensemble(simulator, priors, prior_shares(priors, runs, SEED), SEED)


def measure_truth(
    rig: TestRig, name: str, number: int, settings: "CalibrationSettings"
) -> list[Json]:
    """Return the row of one truth."""
    seed = [SEED, RIGS.index(rig), list(KINDS).index(name), number]
    kind = KINDS[name]
    priors = free_priors(rig, kind)
    shares = np.random.default_rng(seed).random((1, len(priors)))
    simulator = make_simulator(rig, measure(rig, kind, shares, seed, priors))
    inference = infer(
        simulator,
        priors,
        seed=number,
        first=first_ensemble(rig.name, settings.first_runs, kind.known),
        round_runs=settings.round_runs,
        rounds=settings.rounds if rig.rounds is None else min(rig.rounds, settings.rounds),
    )
    check = check_posterior(simulator, simulator.statistics, inference, number, settings.replicates)
    draws = inference.shares
    return [
        {
            "rig": rig.name,
            "kind": name,
            "number": number,
            "names": list(inference.names),
            "truth": shares[0].round(6).tolist(),
            "rank": np.mean(draws < shares, axis=0).round(4).tolist(),
            "low": np.quantile(draws, 0.05, axis=0).round(4).tolist(),
            "median": np.median(draws, axis=0).round(4).tolist(),
            "deviation": np.std(draws, axis=0).round(4).tolist(),
            "probability": round(check.probability, 4),
            "settled": inference.settled,
            "runs": inference.runs,
        }
    ]


class CalibrationSettings(NamedTuple):
    """Numbers of truths, and of simulated measurements of each posterior."""

    truths: int = TRUTHS
    disturbed: int = DISTURBED
    outside: int = OUTSIDE
    first_runs: int = 256
    round_runs: int = 128
    rounds: int = 3
    replicates: int = 80


def list_cases(settings: CalibrationSettings) -> dict[Any, Callable[[], list[Json]]]:
    """Return all truths, in an order in which each part of them is a smaller study."""
    cases: dict[Any, Callable[[], list[Json]]] = {}

    def add(rig: TestRig, name: str, number: int) -> None:
        cases[rig.name, name, number] = partial(measure_truth, rig, name, number, settings)

    for number in range(max(settings.truths, EVERY * max(settings.disturbed, settings.outside))):
        if number < settings.truths:
            for rig in COVERED:
                add(rig, MODEL, number)
        own, rest = divmod(number, EVERY)
        if rest > 0:
            continue
        for name, kind in KINDS.items():
            disturbs = not (kind.outside or name in (MODEL, FREE_FRICTION))
            if own >= (settings.disturbed if disturbs else settings.outside):
                continue
            if kind.outside or name == MODEL:
                add(SEVERAL_FORCES, name, own)
            if name != MODEL:
                add(RIGS[0], name, own)
    return cases


def coverage_rows(rows: Sequence[Json]) -> list[Json]:
    """Return, for each structure and parameter, the coverage and a test of the ranks.

    The coverage is the share of truths in the 90 % interval. The test is whether the ranks are
    uniform.
    """
    result = []
    for rig in COVERED:
        own = [r for r in rows if r["rig"] == rig.name and r["kind"] == MODEL]
        for k, prior in enumerate(rig.priors):
            ranks = np.array([r["rank"][k] for r in own])
            if len(ranks) == 0:
                continue
            tail = (1 - SHARE_IN_INTERVAL) / 2
            inside = int(np.sum((ranks >= tail) & (ranks <= 1 - tail)))
            interval = scipy.stats.binomtest(inside, len(ranks)).proportion_ci(0.95, "wilson")
            counts = np.histogram(ranks, bins=RANK_BINS, range=(0, 1))[0]
            result.append(
                {
                    "rig": rig.name,
                    "parameter": prior.name,
                    "truths": len(ranks),
                    "inside": 100 * inside / len(ranks),
                    "low": 100 * interval.low,
                    "high": 100 * interval.high,
                    "counts": " ".join(map(str, counts)),
                    "uniform": float(scipy.stats.chisquare(counts).pvalue),
                    "narrowing": float(
                        np.median([r["deviation"][k] for r in own]) / np.sqrt(1 / 12)
                    ),
                }
            )
    return result


def kind_rows(rows: Sequence[Json]) -> list[Json]:
    """Return, for each kind of truth, how often the check rejects the model, and the coverage.

    The coverage is the number of truths that lie in the intervals.
    """
    result = []
    for name in KINDS:
        for rig in RIGS:
            own = [r for r in rows if r["kind"] == name and r["rig"] == rig.name]
            if not own:
                continue
            checked = [r["probability"] for r in own if r["probability"] is not None]
            refused = int(np.sum(np.array(checked) < SMALL_PROBABILITY))
            count = max(len(checked), 1)
            interval = scipy.stats.binomtest(refused, count).proportion_ci(0.95, "wilson")
            result.append(
                {
                    "kind": name,
                    "rig": rig.name,
                    "truths": len(own),
                    "checked": len(checked),
                    "refused": 100 * refused / count,
                    "low": 100 * interval.low,
                    "high": 100 * interval.high,
                    "inside": " / ".join(shares_inside(own, name)),
                }
            )
    return result


def shares_inside(rows: Sequence[Json], name: str) -> list[str]:
    """Return the share of truths in the 90 % interval of each parameter, in percent.

    If the true friction limit is 0, it is the share of intervals that reach 0.
    """
    texts = []
    for prior in RIGS[0].priors:
        if prior.name not in rows[0]["names"]:
            texts.append("fixed")
            continue
        k = rows[0]["names"].index(prior.name)
        if name == FREE_FRICTION and prior.name == "friction_limit":
            held = [r["low"][k] < AT_ZERO for r in rows]
        else:
            held = [0.05 <= r["rank"][k] <= 0.95 for r in rows]
        texts.append(f"{100 * np.mean(held):.0f}")
    return texts


def write_table(measured: Measurement) -> str:
    """Return the table of coverage and that of kinds of truths."""
    rows = measured.values["rows"]
    coverage = {
        "structure and sensor": "{rig}",
        "parameter": "{parameter}",
        "truths": "{truths}",
        "in the 90 % interval, %": "{inside:.0f} ({low:.0f} to {high:.0f})",
        "ranks in ten equal parts": "{counts}",
        "probability if uniform": "{uniform:.2f}",
        "posterior over prior deviation": "{narrowing:.2f}",
    }
    kinds = {
        "truth": "{kind}",
        "structure and sensor": "{rig}",
        "truths": "{truths}",
        "checked": "{checked}",
        "refused by the check, %": "{refused:.0f} ({low:.0f} to {high:.0f})",
        "in the 90 % intervals of restitution / friction / gap, %": "{inside}",
    }
    return (
        f"{format_table(coverage, coverage_rows(rows))}\n\n{format_table(kinds, kind_rows(rows))}"
    )


STUDY: Study[CalibrationSettings] = make_rows_study(
    NAME,
    "posteriors of calibrate beside the truth",
    cases=list_cases,
    key=lambda r: (r["rig"], r["kind"], r["number"]),
    text=write_table,
    key_values=lambda settings: {
        "first_runs": settings.first_runs,
        "round_runs": settings.round_runs,
        "rounds": settings.rounds,
        "replicates": settings.replicates,
    },
)
QUICK = CalibrationSettings(2, 0, 0, 64, 48, 1, 40)


@command()
@click.option("--quick", is_flag=True, help="A look: two truths of each structure, few runs.")
@click.option(
    "--truths",
    type=click.IntRange(min=1),
    default=TRUTHS,
    show_default=True,
    help="Truths from the prior, of each structure.",
)
@click.option(
    "--disturbed",
    type=click.IntRange(min=0),
    default=DISTURBED,
    show_default=True,
    help="Truths of each disturbance of the measurement.",
)
@click.option(
    "--outside",
    type=click.IntRange(min=0),
    default=OUTSIDE,
    show_default=True,
    help="Truths of each kind outside the model.",
)
@add_table_options(NAME, "docs/calibrate.md")
def main(
    quick: bool,
    truths: int,
    disturbed: int,
    outside: int,
    place: OutputPaths,
) -> None:
    """Print how often the 90 % intervals of calibrate contain the truth.

    The table also has how often the predictive check rejects the model.

    Truths are drawn from the prior and measured by simulation; the same is done with disturbed
    measurements and with absorbers that the model lacks. Ctrl-C prints, and writes, what is
    finished; with --json the same command goes on from there.
    """
    settings = QUICK if quick else CalibrationSettings(truths, disturbed, outside)
    run(STUDY, settings, place)
