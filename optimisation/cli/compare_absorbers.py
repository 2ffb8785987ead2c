"""The main job: impact absorber, friction damper and tuned absorbers compared over the force, near two resonances."""

import platform
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import click

from impact_env.curve import DEFAULT_MEMBERS
from impact_env.drive import default_rate
from impact_env.ensemble import Executor, available_cores
from impact_env.modes import Structure
from impact_env.parameters import DEFAULT_MASS_RATIO, Beam, RigidWalls, impact_absorber
from impact_env.scene import Scene
from optimisation.absorber_rules import RESTITUTION
from optimisation.answers.comparison import ComparisonAnswer, complete_comparison
from optimisation.bounds import design_force, design_gap
from optimisation.cli import disk_commands
from optimisation.cli import scene_options as scenes
from optimisation.cli.common import (
    BadInput,
    check_target,
    command,
    end_early,
    file_option,
    name_files,
    out_option,
    plain_errors,
    rate_option,
    seed_option,
    threads_option,
)
from optimisation.comparison import (
    DEFAULT_FORCES,
    RESONANCES,
    LoadComparison,
    compare,
    compare_loads,
)
from optimisation.duration import (
    COARSER,
    LONG_S,
    PlannedRuns,
    announce_coarse,
    announce_load_runs,
    announce_runs,
)
from optimisation.executors import cluster_option, workers
from optimisation.executors import executor as executor_on
from optimisation.extremes import usable_mass_ratio
from optimisation.files import require_writable, write_files
from optimisation.load_cases import AppliedLoads
from optimisation.machine import installed, peak_memory
from optimisation.measures import design_gap_for
from optimisation.mounting import model_with_absorber_at
from optimisation.progress import stages_bar, sweeps_bar
from optimisation.report import comparison_tables as tables
from optimisation.report.frequency_report import (
    HISTORY_FORMATS,
    HISTORY_HELP,
    save_history,
)
from optimisation.sweep_range import find_sweep_range

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
FORCE_HELP = "Force in N near the first of the resonances: the design rule gives the gap for it; with --scene all are compared at it."


def conditions(started: float, threads: int | None, cluster: str | None) -> dict[str, object]:
    """Return versions, threads or cluster, the time since ``started`` (of ``time.perf_counter``, s) and the memory used."""
    return {
        "versions": {"python": platform.python_version(), **installed(("numpy", "scipy", "numba"))},
        **({"cluster": cluster} if cluster else {"threads": threads or available_cores()}),
        "wall_s": round(time.perf_counter() - started, 2),
        "memory_bytes": peak_memory(),
    }


def announce(own: Structure | None, options: dict[str, Any], threads: int | None) -> float:
    """Return about how long a comparison takes in s, and print it where it is long: all runs count as those of the impact absorber."""
    model = model_with_absorber_at(Beam() if own is None else own)
    first = options["resonances"][0]
    device = options.get("device")
    ratio = options["mass_ratio"] if device is None else device.mass_ratio
    mass = usable_mass_ratio("mass_ratio", ratio) * model.beam_mass
    planned = []
    for resonance in dict.fromkeys(options["resonances"]):
        low, high = find_sweep_range(model, ratio, resonance)
        rate = options["percent_per_100_periods"] or default_rate(model, options["resonances"])
        gap = options["gap"] or (RigidWalls.gap if device is None else device.walls.gap)
        force = design_force(model, mass, gap, resonance)
        if options["force"] is not None and device is None:
            force = options["force"]
            gap = design_gap(model, mass, force, first)
        absorber = device or impact_absorber(gap, RESTITUTION, None, ratio)
        number = 2 * IMPACTED * options["forces"] * options["members"]
        planned.append(
            PlannedRuns(Scene(model, absorber), force, resonance, 1e4 * (high - low) / rate, number)
        )
    return announce_runs(planned, threads, "A higher --rate or --quick takes less.")


def answer_coarsely(own: Structure | None, options: dict[str, Any], executor: Executor) -> None:
    """Print the levels of a comparison by few and fast runs."""
    model = model_with_absorber_at(Beam() if own is None else own)
    usual = options["percent_per_100_periods"] or default_rate(model, options["resonances"])
    fast = {"percent_per_100_periods": COARSER * usual, "members": 1, "forces": COARSE_FORCES}
    with sweeps_bar("looking", leave=False) as show:
        coarse = compare(own, progress=show, executor=executor, **options | fast)
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


def compared_under_loads(
    load: Path, structure: Structure | None, out: Path, cluster: str | None, options: dict[str, Any]
) -> None:
    """Compare absorbers under the loads of a file, print the table, and write figure, runs and summary."""
    scenes.refuse_with_load(load, "force", "rate", "resonances")
    scenes.refuse_with_load(load, "history", why="there levels are read from other measures")
    model = model_with_absorber_at(Beam() if structure is None else structure)
    chosen = {name: options[name] for name in ("mass_ratio", "gap", "members", "seed")}
    loads = scenes.loads_of(load, model)
    case = AppliedLoads(model, loads)
    with workers(options["threads"], cluster) as executor:

        def search(factors: int, **how: Any) -> LoadComparison:
            with stages_bar("comparing") as show:
                return compare_loads(
                    case,
                    factors=factors,
                    threads=options["threads"],
                    executor=executor,
                    progress=show,
                    **chosen | how,
                )

        gap = options["gap"] or design_gap_for(model, loads) or RigidWalls.gap
        probe = Scene(model, impact_absorber(gap, RESTITUTION, None, options["mass_ratio"]))
        number = options["members"] * (LOAD_RUNS + len(CONCEPTS) * options["forces"])
        long = (
            cluster is None
            and announce_load_runs(probe, loads, number, options["threads"]) > LONG_S
        )
        if long and options["members"] > 1:
            coarse = search(2, members=1)
            click.echo(f"Coarse answer, of one run each:\n{tables.load_table(coarse)}", err=True)
        comparison = search(options["forces"])
    answer = ComparisonAnswer(comparison)
    click.echo(str(answer))
    name_files(answer.save(out))


@command()
@scenes.structure_option
@scenes.scene_option
@scenes.load_option
@click.option(
    "--resonances",
    type=(int, int),
    default=RESONANCES,
    show_default=True,
    help=scenes.RESONANCES_HELP,
)
@click.option(
    "--mass-ratio",
    type=float,
    default=DEFAULT_MASS_RATIO,
    show_default=True,
    help="Mass of each absorber over the structure's.",
)
@scenes.mass_option
@click.option("--force", type=float, help=FORCE_HELP)
@click.option(
    "--gap",
    type=float,
    help=f"Clearance to either wall in m.  [default: by --force, or {RigidWalls.gap}]",
)
@rate_option
@click.option(
    "--quick",
    is_flag=True,
    help=f"A look in a few seconds: {QUICK_FORCES} forces, {QUICK_MEMBERS} members, unless given.",
)
@click.option(
    "--members",
    type=click.IntRange(min=1),
    help=f"Runs for each point, other in phase and 1e-6 of force.  [default: {DEFAULT_MEMBERS}]",
)
@seed_option
@click.option(
    "--forces",
    type=click.IntRange(min=2),
    help=f"Number of forces for each resonance.  [default: {DEFAULT_FORCES}]",
)
@threads_option
@cluster_option
@file_option("--history", f"{HISTORY_HELP} Of the impact absorber near the first resonance.")
@out_option("results/compare_absorbers")
def main(
    structure: Path | None,
    scene: Path | None,
    load: Path | None,
    quick: bool,
    out: Path,
    cluster: str | None,
    history: Path | None,
    **options: Any,
) -> None:
    """Compare absorbers of one mass on the paper's beam, or another structure: response level over the force near two resonances.

    On another structure, and for another mass, gap or force, the absorbers follow from rules: gap and forces from the design rule, friction from the
    scaling law and the energy of a cycle, the linear absorber tuned to the first of the resonances. Writes comparison.png, frequency.png (the level
    over the frequency at the force of the table), curves.csv (medians and bands), runs.csv (every run), summary.json and a card with curves
    (card.html, card.json), and prints a table.
    Ctrl-C ends the run early and leaves what is finished.

    With --scene of a bladed disk the file's absorbers are compared with friction dampers and none by the level of the worst sector.

    With --load each absorber is at its own best for the loads of a file, and all are compared at --forces intensities from 0.2 to 5.
    """
    started = time.perf_counter()
    options["members"] = options["members"] or (QUICK_MEMBERS if quick else DEFAULT_MEMBERS)
    options["forces"] = options["forces"] or (QUICK_FORCES if quick else DEFAULT_FORCES)
    options["percent_per_100_periods"] = options.pop("rate")
    with plain_errors():
        require_writable("--out", out)
        check_target("--history", history, HISTORY_FORMATS)
        disk = scenes.read_disk(scene)
        if disk is not None:
            disk_commands.refuse_with_disk(NOT_OF_DISKS)
            disk_commands.compare_on_file(disk, out, quick, cluster, options)
            return
        if load is not None and scene is not None:
            raise BadInput(
                "--scene does not go with --load: there each absorber is at its own best; --structure takes the file of a structure"
            )
        mass_kg = options.pop("mass_kg")
        own: Structure | None = None
        if scene is not None:
            own, options["device"] = scenes.read_device(
                scene, "structure", "mass_ratio", "mass_kg", "gap"
            )
            options |= {"mass_ratio": DEFAULT_MASS_RATIO}
        else:
            if structure is not None:
                own = scenes.read_structure(structure)
            own_mass = model_with_absorber_at(Beam() if own is None else own).beam_mass
            options["mass_ratio"] = scenes.mass_ratio_of(options["mass_ratio"], mass_kg, own_mass)
        if load is not None:
            compared_under_loads(load, own, out, cluster, options)
            return
        scenes.warn_of_nodes(
            model_with_absorber_at(Beam() if own is None else own), *options["resonances"]
        )
        threads = options.pop("threads")
        with executor_on(threads, cluster) as executor:
            if cluster is None and announce(own, options, threads) > LONG_S:
                answer_coarsely(own, options, executor)
            with sweeps_bar("comparing") as show:
                comparison = compare(own, progress=show, executor=executor, **options)
            if comparison.empty:
                raise KeyboardInterrupt
            answer = complete_comparison(comparison, executor, with_impacts=scene is not None)
        answer = replace(answer, conditions=conditions(started, threads, cluster))
        click.echo(str(answer))
        files = answer.save(out)
        if history is not None and (run := answer.worst_run()) is not None:
            files += write_files({history: partial(save_history, run=run)})
    name_files(files)
    end_early(comparison.complete, "the files hold the runs that were finished.")
