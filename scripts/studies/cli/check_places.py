"""Compare the results of design_place with a brute-force scan on four structures.

The scan covers all places and gaps.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import click
import numpy as np

from impact_env import Beam, Drive, ModalModel, Scene, SlidingAbsorber
from impact_env.drive import linear_sweep
from impact_env.ensemble import Executor, Lane, each_lane
from optimisation.cli.common import (
    cluster_option,
    command,
    rate_option,
    threads_option,
)
from optimisation.executors import workers
from optimisation.gap_advice import MEMBERS, TOLERANCE
from optimisation.place_advice import PlaceAdvice, PlacedDevice, advise_place, expected_gap
from optimisation.place_map import Places, find_places
from studies.cli.check_gaps import level_of
from studies.structures import ALUMINIUM, boom, plate
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

NAME = "check_places"  # also the page's marker
FACTORS = (1 - TOLERANCE, 1.0, 1 + TOLERANCE)  # of the forces, each simulated
STEP = 0.1
FROM = -0.5
TO = 0.6
SCANNED = 20  # places of a beam
CANDIDATES = 6  # pairs of place and gap of the scan that run again
CANDIDATE_RUNS = 4
JUDGES = 12
SEED = 2027
TOLERATED = 1.1


@dataclass(frozen=True)
class Case:
    """Places on a structure, with forces and the mass of the absorber.

    ``places`` is a function that returns the places, ``forces`` has the force in N by resonance,
    and ``mass_ratio`` is the absorber's mass over the structure's.
    """

    name: str
    places: Any  # a function without arguments
    forces: tuple[tuple[int, float], ...]
    mass_ratio: float = 0.02


def panel_places() -> Places:
    """Return a simply supported plate with thirty places for absorbers, in five rows of six."""
    force = (0.3, 0.35)
    level = (0.4, 0.6)
    points = [(x, y) for y in np.linspace(0.1, 0.9, 5) for x in np.linspace(0.1, 0.85, 6)]
    sides = (0.8, 0.5)
    models = [
        plate(("pinned", "pinned"), sides, 0.003, (force, point, level), 0.01, ALUMINIUM)
        for point in points
    ]
    shapes = np.array([model.tip_shape for model in models])
    model = replace(models[0], absorber_shapes=shapes)
    result = find_places(model)
    at = np.zeros((len(points), 3))
    at[:, :2] = np.array(points) * sides
    return replace(result, points=at)


def chain() -> ModalModel:
    """Return a chain of four storeys of 1 kg that are connected by springs.

    The absorber can be at any storey. The force acts on the second, and the level is that of the
    top.
    """
    stiffness = 2 * np.eye(4) - np.eye(4, k=1) - np.eye(4, k=-1)
    stiffness[-1, -1] = 1.0
    squares, shapes = np.linalg.eigh(4e4 * stiffness)
    return ModalModel(
        np.sqrt(squares),
        np.full(4, 0.012),
        shapes[1],
        shapes[0],
        4.0,
        absorber_shapes=shapes,
        response_shape=shapes[3],
    )


CASES = (
    Case("paper's beam", lambda: find_places(Beam()), ((1, 3.5), (2, 35.0))),
    Case("boom", lambda: find_places(boom()), ((1, 10.0),)),
    Case("boom", lambda: find_places(boom()), ((2, 40.0),)),
    Case("boom", lambda: find_places(boom()), ((1, 10.0), (2, 150.0)), 0.03),
    Case("floor panel, 30 places", panel_places, ((1, 1.0),)),
    Case("four storeys", lambda: find_places(chain()), ((2, 1.0),), 0.04),
)


class PlaceSettings(NamedTuple):
    """Settings of the comparison.

    ``members`` are the runs for each gap of the search, ``step`` is the scan's step of ln gap,
    ``scanned`` the number of places on a beam, and ``judges`` the runs with which designs are
    compared.
    """

    cases: tuple[Case, ...]
    members: int = MEMBERS
    step: float = STEP
    scanned: int = SCANNED
    judges: int = JUDGES
    rate: float | None = None
    threads: int | None = None
    executor: Executor | None = None


@dataclass
class BruteForce:
    """Levels of sweeps up and down over those without absorber, with phases of their own.

    ``where`` has the threads and the executor.
    """

    advice: PlaceAdvice
    generator: np.random.Generator
    where: dict[str, Any]

    def shares(
        self,
        devices: Sequence[tuple[ModalModel, SlidingAbsorber]],
        factors: Sequence[float],
        runs: int,
    ) -> Array:
        """Return the largest relative level of all resonances, (devices, factors, runs).

        Levels are relative to those without absorber.
        """
        study = self.advice.study
        lanes = []
        for model, absorber in devices:
            scene = Scene(model, absorber)
            for factor in factors:
                for phase in self.generator.uniform(0, 2 * np.pi, runs):
                    for r, force in study.forces.items():
                        omega = model.resonance_omega(r)
                        low, high = study.ranges[r]
                        for start, stop in ((low, high), (high, low)):
                            schedule = linear_sweep(omega, start, stop, study.rates[r])
                            drive = Drive(factor * force, schedule, float(phase))
                            lanes.append(Lane(scene, drive, steady_start=True))
        values = each_lane(lanes, level_of, **self.where)
        if any(value is None for value in values):
            raise KeyboardInterrupt
        shape = (len(devices), len(factors), runs, len(study.forces), 2)
        levels = np.array(values, dtype=float).reshape(shape).max(axis=-1)
        return np.asarray((levels / [study.without[r] for r in study.forces]).max(axis=-1))


def row(case: Case, settings: PlaceSettings) -> list[Json]:
    """Return a case's one row; raises KeyboardInterrupt if it is stopped."""
    places = case.places()
    where: Json = {"threads": settings.threads, "executor": settings.executor}
    result = advise_place(
        places,
        dict(case.forces),
        mass_ratios=[case.mass_ratio],
        members=settings.members,
        percent_per_100_periods=settings.rate,
        **where,
    )
    if not result.complete or result.recommended is None:
        raise KeyboardInterrupt
    return [judged(case, result, result.recommended, settings, where)]


def judged(
    case: Case, result: PlaceAdvice, best: PlacedDevice, settings: PlaceSettings, where: Json
) -> Json:
    """Return a case's row.

    ``ratio``: the largest median of the recommended device over three forces, over that of the best
    pair of place and gap of the scan, both of fresh runs; ``coverage``: share of the fresh runs at
    the forces themselves that lie in the 90 % interval.
    """
    places = result.places
    every = range(len(places))
    if isinstance(places.structure, Beam):
        every = range(len(places) - 1, -1, -max(1, len(places) // settings.scanned))
    scan = BruteForce(result, np.random.default_rng([SEED, *dict(case.forces)]), where)
    pairs = []
    for place in every:
        model = places.model_at(place)
        own = result.maps[0]
        if not np.isfinite(own.gap[place]):
            continue
        start = expected_gap(model, case.mass_ratio, result.forces)
        gaps = (start * np.exp(np.arange(FROM, TO, settings.step))).tolist()
        pairs += [
            (place, model, result.study.absorber(model, case.mass_ratio, gap)) for gap in gaps
        ]
    single = scan.shares([(model, absorber) for _, model, absorber in pairs], (1.0,), 1)[:, 0, 0]
    chosen = [pairs[k] for k in np.argsort(single)[:CANDIDATES]]
    again = scan.shares([(m, a) for _, m, a in chosen], FACTORS, CANDIDATE_RUNS)
    place, model, absorber = chosen[int(np.argmin(np.median(again, axis=2).max(axis=1)))]

    own_model = places.model_at(best.place)
    fresh = scan.shares([(own_model, best.absorber), (model, absorber)], FACTORS, settings.judges)
    worst = np.median(fresh, axis=2).max(axis=1)
    low, high = best.interval
    inside = (fresh[0, 1] >= low) & (fresh[0, 1] <= high)
    walls = absorber.walls
    assert walls is not None
    return {
        "name": case.name,
        "resonances": [r for r, _ in case.forces],
        "mass_ratio": case.mass_ratio,
        "places": len(places),
        "place": best.name,
        "gap": best.gap,
        "scan_place": places.names[place],
        "scan_gap": walls.gap,
        "scan_share": float(worst[1]),
        "ratio": float(worst[0] / worst[1]),
        "coverage": float(np.mean(inside)),
        "sweeps": result.sweeps,
        "scan_sweeps": 2 * len(case.forces) * len(pairs),
    }


def table(measured: Measurement) -> str:
    """Return a line for each case, how many are good, and the worst."""
    order = [(case.name, [r for r, _ in case.forces]) for case in CASES]
    by_name = {(r["name"], *r["resonances"]): r for r in measured.values["rows"]}
    result = [by_name[name, *rs] for name, rs in order if (name, *rs) in by_name]
    columns = {
        "structure": "{name}",
        "resonances": "{which}",
        "mass, %": "{percent[0]:g}",
        "places": "{places}",
        "place": "{place}",
        "gap, mm": "{mm[0]:.3g}",
        "scan's place": "{scan_place}",
        "scan's gap, mm": "{mm[1]:.3g}",
        "level there, %": "{percent[1]:.1f}",
        "level over the scan's": "{ratio:.2f}",
        "in the 90 % interval, %": "{percent[2]:.0f}",
        "sweeps": "{sweeps}",
        "scan's sweeps": "{scan_sweeps}",
    }
    rows = (
        {
            **r,
            "which": ", ".join(map(str, r["resonances"])),
            "percent": [100 * r[name] for name in ("mass_ratio", "scan_share", "coverage")],
            "mm": [1e3 * r["gap"], 1e3 * r["scan_gap"]],
        }
        for r in result
    )
    good = sum(r["ratio"] <= TOLERATED for r in result)
    worst = max(result, key=lambda r: float(r["ratio"]))
    which = " and ".join(map(str, worst["resonances"]))
    words = (
        f"Within {TOLERATED:g} of the scan's best: {good} of {len(result)}, worst "
        f"{worst['ratio']:.2f} ({worst['name']}, resonance {which}); "
        "fresh runs in the 90 % intervals: "
        f"{100 * float(np.mean([r['coverage'] for r in result])):.0f} %."
    )
    return f"{format_table(columns, rows)}\n\n{words}"


STUDY: Study[PlaceSettings] = make_rows_study(
    NAME,
    "the answers of design_place beside scans by brute force",
    cases=lambda settings: {
        (case.name, *(r for r, _ in case.forces)): partial(row, case, settings)
        for case in settings.cases
    },
    key=lambda r: (r["name"], *r["resonances"]),
    text=table,
    key_values=lambda settings: {
        "members": settings.members,
        "step": settings.step,
        "scanned": settings.scanned,
        "rate": settings.rate,
        "judges": settings.judges,
    },
)
QUICK_CASES = (5,)
QUICK_STEP = 0.3
QUICK_JUDGES = 4
QUICK_MEMBERS = 1


@command()
@click.option("--quick", is_flag=True, help="A look: one structure, with a coarse scan.")
@click.option(
    "--judges",
    type=click.IntRange(min=1),
    help=f"Fresh runs by which a device is judged.  [default: {JUDGES}]",
)
@rate_option
@threads_option
@cluster_option
@add_table_options(NAME, "docs/which_place.md")
def main(quick: bool, cluster: str | None, place: OutputPaths, **options: Any) -> None:
    """Print the loss of design_place's result against a brute-force scan.

    The comparison has four structures, and the scan covers all places and gaps.

    The scan runs each place at gaps 10 % apart, its best again at 0.9, 1 and 1.1 of the forces; its
    best and the answer are judged by fresh runs. Ctrl-C prints, and writes, what is finished; with
    --json the same command goes on from there.
    """
    with workers(options["threads"], cluster) as result:
        options["judges"] = options["judges"] or (QUICK_JUDGES if quick else JUDGES)
        if result is not None:
            options["threads"] = None
        settings = PlaceSettings(
            tuple(CASES[k] for k in QUICK_CASES) if quick else CASES,
            QUICK_MEMBERS if quick else MEMBERS,
            QUICK_STEP if quick else STEP,
            executor=result,
            **options,
        )
        run(STUDY, settings, place)
