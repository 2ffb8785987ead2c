"""Absorbers of one mass compared over the force."""

import platform
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import click

from impact_env.curve import DEFAULT_MEMBERS
from impact_env.drive import default_rate
from impact_env.ensemble import Executor, available_cores
from impact_env.modes import Structure
from impact_env.parameters import (
    DEFAULT_MASS_RATIO,
    Beam,
    RigidWalls,
    SlidingAbsorber,
    impact_absorber,
)
from impact_env.scene import Scene
from optimisation.absorber_rules import RESTITUTION
from optimisation.answers.comparison import ComparisonAnswer, complete_comparison
from optimisation.bounds import design_force, design_gap
from optimisation.checkpoint import installed_versions, peak_memory
from optimisation.cli import disk_commands
from optimisation.cli import scene_options as scenes
from optimisation.cli.common import (
    AnswerFiles,
    BadInput,
    command,
    end_early,
    name_files,
    plain_errors,
)
from optimisation.cli.options import at_least, number, option
from optimisation.comparison import (
    DEFAULT_FORCES,
    RESONANCES,
    LoadComparison,
    compare,
    compare_loads,
)
from optimisation.executors import (
    COARSER,
    LONG_S,
    PlannedRuns,
    announce_coarse,
    announce_load_runs,
    announce_runs,
    stages_bar,
    sweeps_bar,
    workers,
)
from optimisation.executors import executor as executor_on
from optimisation.load_cases import AppliedLoads
from optimisation.measures import design_gap_for
from optimisation.mounting import model_with_absorber_at
from optimisation.sweep_range import find_sweep_range, usable_mass_ratio

QUICK_FORCES = 10
QUICK_MEMBERS = 2
COARSE_FORCES = 6
IMPACTED = 2  # concepts with runs at every force: impact absorber and friction damper
LOAD_RUNS = 130  # runs of a member under loads by which all absorbers are chosen, about
CONCEPTS = ("none", "impact", "friction", "tuned")
NOT_OF_DISKS = (
    "structure",
    "load",
    "resonances",
    "mass_ratio",
    "mass_kg",
    "gap",
    "history",
)


@dataclass(frozen=True, kw_only=True)
class CompareOptions(scenes.SummaryOptions, scenes.SweepRunOptions, scenes.DeviceOptions):
    """Options of ``compare``; None: not given."""

    load: Path | None = option("load")
    resonances: tuple[int, int] = option("resonances", default=RESONANCES)
    mass_ratio: float = option("mass_ratio")
    mass_kg: float | None = option("mass_kg")
    force: float | None = option(
        "force",
        help="Force near the first of the resonances, for which the gap is chosen",
        more="By the design rule; with --scene all are compared at it.",
    )
    gap: float | None = option("gap", default=None, default_text=f"by --force, or {RigidWalls.gap}")
    quick: bool = option(
        "quick",
        help=(
            f"A first answer in a few seconds: {QUICK_FORCES} forces, {QUICK_MEMBERS} members, "
            "unless given"
        ),
    )
    members: int | None = option("members", default_text=str(DEFAULT_MEMBERS))
    forces: int | None = option(
        number(
            "--forces",
            "Number of forces for each resonance",
            type=at_least(2),
            default_text=str(DEFAULT_FORCES),
            section="Runs",
        )
    )
    history: Path | None = option(
        "history",
        help="Write or draw the motion of the impact absorber's run with the highest level",
    )
    out: Path = option("out", default=Path("results/compare"))

    @property
    def usual_members(self) -> int:
        """Return the number of runs of each point."""
        return self.members or (QUICK_MEMBERS if self.quick else DEFAULT_MEMBERS)

    @property
    def usual_forces(self) -> int:
        """Return the number of forces for each resonance."""
        return self.forces or (QUICK_FORCES if self.quick else DEFAULT_FORCES)


def conditions(started: float, threads: int | None, cluster: str | None) -> dict[str, object]:
    """Return versions, threads or cluster, elapsed time and used memory.

    ``started``: start of the time, of ``time.perf_counter`` in s.
    """
    return {
        "versions": {
            "python": platform.python_version(),
            **installed_versions(("numpy", "scipy", "numba")),
        },
        **({"cluster": cluster} if cluster else {"threads": threads or available_cores()}),
        "wall_s": round(time.perf_counter() - started, 2),
        "memory_bytes": peak_memory(),
    }


def arguments_of(
    options: CompareOptions, device: SlidingAbsorber | None, structure_mass: float
) -> dict[str, Any]:
    """Return the arguments of `compare` for the options.

    Raises BadInput or ParameterError.
    """
    of_absorber: dict[str, Any] = {"mass_ratio": DEFAULT_MASS_RATIO, "device": device}
    if device is None:
        of_absorber = {
            "mass_ratio": scenes.mass_ratio_of(options.mass_ratio, options.mass_kg, structure_mass)
        }
    return {
        "resonances": options.resonances,
        **of_absorber,
        "force": options.force,
        "gap": options.gap,
        "seed": options.seed,
        "percent_per_100_periods": options.rate,
        "members": options.usual_members,
        "forces": options.usual_forces,
    }


def announce(own: Structure | None, arguments: Mapping[str, Any], threads: int | None) -> float:
    """Estimate how long a comparison takes in s, and print the estimate if it is long.

    Each run counts as a run with the impact absorber.
    """
    model = model_with_absorber_at(Beam() if own is None else own)
    resonances = arguments["resonances"]
    device = arguments.get("device")
    ratio = arguments["mass_ratio"] if device is None else device.mass_ratio
    mass = usable_mass_ratio("mass_ratio", ratio) * model.beam_mass
    planned = []
    for resonance in dict.fromkeys(resonances):
        low, high = find_sweep_range(model, ratio, resonance)
        rate = arguments["percent_per_100_periods"] or default_rate(model, resonances)
        gap = arguments["gap"] or (RigidWalls.gap if device is None else device.walls.gap)
        force = design_force(model, mass, gap, resonance)
        if arguments["force"] is not None and device is None:
            force = arguments["force"]
            gap = design_gap(model, mass, force, resonances[0])
        absorber = device or impact_absorber(gap, RESTITUTION, None, ratio)
        number = 2 * IMPACTED * arguments["forces"] * arguments["members"]
        planned.append(
            PlannedRuns(Scene(model, absorber), force, resonance, 1e4 * (high - low) / rate, number)
        )
    return announce_runs(planned, threads, "A higher --rate or --quick takes less.")


def answer_coarsely(
    own: Structure | None, arguments: Mapping[str, Any], executor: Executor
) -> None:
    """Print the levels of a comparison by few and fast runs."""
    model = model_with_absorber_at(Beam() if own is None else own)
    usual = arguments["percent_per_100_periods"] or default_rate(model, arguments["resonances"])
    fast = {"percent_per_100_periods": COARSER * usual, "members": 1, "forces": COARSE_FORCES}
    with sweeps_bar("looking", leave=False) as show:
        coarse = compare(own, progress=show, executor=executor, **{**arguments, **fast})
    if not coarse.complete:
        raise KeyboardInterrupt
    for part in coarse.resonances:
        k = part.reported_index
        if k is not None:
            levels = ", ".join(
                f"{concept.label} {1e3 * part.curves[concept.key].median[k]:.3g} mm"
                for concept in coarse.concepts
                if concept.key in part.curves
            )
            announce_coarse(f"resonance {part.resonance}, {part.forces[k]:.3g} N: {levels}.")


def compare_under_loads(
    load: Path, structure: Structure | None, options: CompareOptions, mass_ratio: float
) -> None:
    """Compare absorbers under the loads of a file, and write figure, runs and summary.

    The table is printed.
    """
    scenes.refuse_with_load(load, "force", "rate", "resonances")
    scenes.refuse_with_load(load, "history", why="there levels are read from other measures")
    model = model_with_absorber_at(Beam() if structure is None else structure)
    loads = scenes.loads_of(load, model)
    case = AppliedLoads(model, loads)
    members = options.usual_members
    with workers(options.threads, options.cluster) as executor:

        def search(factors: int, members: int) -> LoadComparison:
            with stages_bar("comparing") as show:
                return compare_loads(
                    case,
                    factors=factors,
                    threads=options.threads,
                    executor=executor,
                    progress=show,
                    mass_ratio=mass_ratio,
                    gap=options.gap,
                    members=members,
                    seed=options.seed,
                )

        gap = options.gap or design_gap_for(model, loads) or RigidWalls.gap
        probe = Scene(model, impact_absorber(gap, RESTITUTION, None, mass_ratio))
        number = members * (LOAD_RUNS + len(CONCEPTS) * options.usual_forces)
        long = (
            options.cluster is None
            and announce_load_runs(probe, loads, number, options.threads) > LONG_S
        )
        if long and members > 1:
            coarse = search(2, 1)
            click.echo(f"Coarse answer, of one run each:\n{ComparisonAnswer(coarse)}", err=True)
        comparison = search(options.usual_forces, members)
    name_files(AnswerFiles(options.out, options.json).write(ComparisonAnswer(comparison)))


@command(
    CompareOptions,
    examples=(
        "compare --quick",
        "compare --structure arm.toml --quick --out results/arm",
        "compare --scene disk.toml --quick",
    ),
)
def main(options: CompareOptions) -> None:
    """Compare absorbers of one mass: response level over the force near two resonances.

    The structure is the paper's beam or another one.

    On another structure, and for another mass, gap or force, the absorbers follow from rules: gap
    and forces from the design rule, friction from the scaling law and the energy of a cycle, the
    linear absorber tuned to the first of the resonances. Writes comparison.png, frequency.png (the
    level over the frequency at the force of the table), curves.csv (medians and bands), runs.csv
    (every run), summary.json and a card with curves (card.html, card.json), and prints a table.
    Ctrl-C ends the run early and leaves what is finished.

    With --scene of a bladed disk the file's absorbers are compared with friction dampers and none
    by the level of the worst sector.

    With --load each absorber is at its own best for the loads of a file, and all are compared at
    --forces intensities from 0.2 to 5.
    """
    started = time.perf_counter()
    with plain_errors():
        targets = AnswerFiles(options.out, options.json, history=options.history)
        targets.check()
        disk = scenes.read_disk(options.scene, "structure")
        if disk is not None:
            disk_commands.refuse_with_disk(NOT_OF_DISKS)
            disk_commands.compare_on_file(disk, options)
            return
        if options.load is not None and options.scene is not None:
            raise BadInput(
                "--scene does not go with --load: there each absorber is at its own best; "
                "--structure takes the file of a structure"
            )
        structure, device, file = scenes.read_source(options)
        own = None if device is None and file is None else structure
        model = model_with_absorber_at(Beam() if own is None else own)
        arguments = arguments_of(options, device, model.beam_mass)
        if options.load is not None:
            compare_under_loads(options.load, own, options, arguments["mass_ratio"])
            return
        scenes.warn_of_nodes(model, *options.resonances)
        with executor_on(options.threads, options.cluster) as executor:
            if options.cluster is None and announce(own, arguments, options.threads) > LONG_S:
                answer_coarsely(own, arguments, executor)
            with sweeps_bar("comparing") as show:
                comparison = compare(own, progress=show, executor=executor, **arguments)
            if comparison.empty:
                raise KeyboardInterrupt
            answer = complete_comparison(comparison, executor, with_impacts=device is not None)
        answer = replace(answer, conditions=conditions(started, options.threads, options.cluster))
        files = targets.write(answer)
    name_files(files)
    end_early(comparison.complete, "the files hold the runs that were finished.")
