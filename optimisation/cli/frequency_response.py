"""Frequency response of periodic motions: exact branches with their stability, harmonic balance, linear curves, and sweeps over them."""

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from typing import Any

import click

from impact_env.drive import default_rate
from impact_env.ensemble import Executor
from impact_env.parameters import CompliantWalls, RigidWalls, positive, require
from impact_env.periodic.bifurcations import PERIOD_DOUBLING, SYMMETRY_BREAKING, TORUS
from impact_env.periodic.harmonic_balance import PAPER_DAMPER, WEIGHT, harmonic_balance
from impact_env.periodic.orbit_table import ORBIT_COLUMNS, branch_rows
from impact_env.periodic.overview import (
    Overview,
    OverviewOptions,
    compute_overview,
    require_sliding,
)
from impact_env.periodic.stationary import QUANTILES, StationaryRuns
from impact_env.plain import from_scene
from optimisation.checkpoint import Checkpoint
from optimisation.cli import common
from optimisation.cli.scene_options import (
    is_option_set,
    make_scene,
    refuse_parts,
    scene_options,
    warn_of_nodes,
)
from optimisation.executors import cluster_option, workers
from optimisation.files import write_files
from optimisation.page import markdown
from optimisation.progress import Bar
from optimisation.report.periodic_figures import save_figure

FORCE = 1.5  # N, the paper's moderate level of excitation
EXACT = "exact"
BALANCE = "balance"
BOTH = "both"


@contextmanager
def following(reference: float) -> Iterator[Callable[[str, int, float], None]]:
    """Give a function that shows how far a curve has been followed, over a ``reference`` frequency in rad/s."""
    with Bar(total=None, bar_format="{desc} [{elapsed}]", leave=False) as bar:

        def show(label: str, points: int, omega: float) -> None:
            bar.set_description_str(f"{label}: {points} points, at {omega / reference:.4f}")
            bar.update()

        yield show


def computed(options: dict[str, Any], executor: Executor | None = None) -> Overview:
    """Do what the options ask for, the envelope's runs by an executor as in `run_lanes`.

    Raises BadInput or ParameterError before anything long is done.
    """
    scene, _ = make_scene(options)
    reference = scene.model.resonance_omega(options["resonance"])
    warn_of_nodes(scene.model, options["resonance"])
    walls = require_sliding(scene).walls
    low = positive("--from", options["start"])
    high = positive("--to", options["stop"])
    require(high > low, "--to", high, f"above --from = {low}")
    inelastic = isinstance(walls, RigidWalls) and walls.restitution < 1
    require(
        not (inelastic and options["method"] == BALANCE),
        "--method",
        BALANCE,
        "exact below a restitution of 1: harmonic balance has no impact law",
    )
    hill = options["hill"]
    springs = options["method"] != EXACT and isinstance(walls, CompliantWalls)
    require(not hill or springs, "--hill", hill, "with harmonic balance and --contact-stiffness")
    balance = None
    if options["method"] != EXACT and not inelastic:
        damper = PAPER_DAMPER if options["grounded_damper"] else 0.0
        balance = harmonic_balance(
            scene,
            low * reference,
            options["force"],
            options["harmonics"],
            options["weight"],
            grounded_damper=damper,
        )
    sweeps = ((low, high), (high, low)) if options["sweeps"] else ()
    rate = (
        default_rate(scene.model, (options["resonance"],))
        if options["rate"] is None
        else positive("--rate", options["rate"])
    )
    overview_options = OverviewOptions(
        options["method"] != BALANCE,
        options["pairs"],
        balance,
        sweeps,
        rate,
        stationary_runs(options, executor),
        hill,
    )
    basis = {"scene": from_scene(scene), "force": float(options["force"]), "reference": reference}
    with closing(Checkpoint(options["resume"])) as checkpoint, following(reference) as show:
        return compute_overview(
            scene,
            options["force"],
            reference,
            low,
            high,
            overview_options,
            show,
            checkpoint.section(basis),
        )


def stationary_runs(
    options: dict[str, Any], executor: Executor | None = None
) -> StationaryRuns | None:
    """Return the settings of the stationary runs, None without --envelope; raises BadInput for an option of theirs without it."""
    if options["envelope"] is None:
        for name in ("members", "settle", "window", "approach", "threads", "cluster"):
            if is_option_set(name):
                raise common.BadInput(
                    f"--{name} does not go without --envelope: it is about the runs of the envelope"
                )
        return None
    lengths = options["members"], options["settle"], options["window"]
    return StationaryRuns(
        options["envelope"],
        *lengths,
        options["approach"],
        threads=options["threads"],
        executor=executor,
    )


def text(result: Overview) -> str:
    """Return a table of the curves, and what was refused."""
    rows = []
    notes = []
    for number, curve in enumerate(result.curves, 1):
        peak = curve.peak
        folds = ", ".join(
            f"{fold.omega_ratio:.9g}"
            for fold in sorted(curve.folds, key=lambda point: point.omega_ratio)
        )
        stable = "" if curve.stable is None else f"{100 * curve.stable.mean():.0f}"
        where = (
            ["", ""] if peak is None else [f"{1e3 * peak.tip_max:.4f}", f"{peak.omega_ratio:.4f}"]
        )
        rows.append(
            [
                str(number),
                curve.method,
                "closed" if curve.closed else "open",
                str(len(curve.tip_max)),
                *where,
                folds,
                stable,
            ]
        )
        notes += [f"Curve {number}: {curve.message}." if not curve.closed else ""]
        if curve.refused:
            reason, most = max(curve.refused, key=lambda pair: pair[1])
            total = sum(points for _, points in curve.refused)
            more = "" if total == most else f", and {len(curve.refused) - 1} more reasons"
            notes.append(f"Curve {number}: {total} points are no orbit: {reason}{more}.")
        rows[-1] += [str(curve.period), "symmetric" if curve.symmetric else "a pair"]
        marks = sorted(
            (mark.omega_ratio, mark.kind)
            for mark in curve.located
            if mark.kind in (TORUS, PERIOD_DOUBLING, SYMMETRY_BREAKING)
        )
        rows[-1].append(", ".join(f"{kind} {ratio:.6g}" for ratio, kind in marks))
    header = (
        "curve",
        "method",
        "",
        "points",
        "peak, mm",
        "at",
        "folds",
        "stable, %",
        "period",
        "",
        "bifurcates at",
    )
    blocks = [
        str(result.scene) + f", {result.force:g} N",
        "",
        markdown(header, rows),
        "",
        *[note for note in notes if note],
    ]
    if result.stationary:
        rows = [
            [
                f"{at.omega_ratio:.5f}",
                *(f"{1e3 * tip:.4f}" for tip in at.tip_max),
                f"{at.impacts:.2f}",
            ]
            for at in result.stationary
        ]
        blocks += [
            "",
            markdown(
                ("runs at", *(f"{100 * q:g} %, mm" for q in QUANTILES), "impacts a period"), rows
            ),
        ]
    return "\n".join(blocks)


@common.command()
@click.option(
    "--absorber",
    type=click.Choice(["impact", "friction"]),
    help="Impact absorber or friction damper.  [default: impact]",
)
@scene_options("; below 1 exact orbits only")
@click.option(
    "--contact-stiffness",
    type=float,
    help="Makes the walls springs of this stiffness in N/m: harmonic balance only.",
)
@click.option(
    "--friction-stiffness", type=float, help="Makes friction elastic with this stiffness in N/m."
)
@click.option(
    "--force",
    type=float,
    help=f"Amplitude of the harmonic force in N.  [default: {FORCE}, with --structure by the design rule]",
)
@click.option(
    "--resonance",
    type=int,
    default=1,
    show_default=True,
    help="Resonance, counted from 1, that frequencies refer to.",
)
@click.option(
    "--from",
    "start",
    type=float,
    default=0.88,
    show_default=True,
    help="Lowest frequency over the resonance frequency.",
)
@click.option(
    "--to",
    "stop",
    type=float,
    default=1.06,
    show_default=True,
    help="Highest frequency over the resonance frequency.",
)
@click.option(
    "--method",
    type=click.Choice([EXACT, BALANCE, BOTH]),
    default=BOTH,
    show_default=True,
    help="Exact orbits, harmonic balance, both.",
)
@click.option(
    "--pairs",
    is_flag=True,
    help="With the exact orbits without symmetry, and of longer periods, that leave these branches.",
)
@click.option(
    "--harmonics",
    type=int,
    default=20,
    show_default=True,
    help="Highest harmonic of harmonic balance.",
)
@click.option(
    "--weight",
    type=float,
    default=WEIGHT,
    show_default=True,
    help="Weight of the rigid contact in harmonic balance, in m_a omega_1^2.",
)
@click.option(
    "--grounded-damper",
    is_flag=True,
    help=f"With the paper's damper of {PAPER_DAMPER} N s/m between absorber and ground (balance only).",
)
@click.option(
    "--hill",
    is_flag=True,
    help="With the stability of harmonic balance at walls that are springs, by Hill's method.",
)
@click.option(
    "--sweeps/--no-sweeps",
    default=True,
    show_default=True,
    help="With a sweep up and one down by the exact method.",
)
@click.option(
    "--rate",
    type=float,
    help="Rate of the sweeps.  [default: 1, less by the square of damping below 1 %]",
)
@click.option(
    "--envelope",
    type=int,
    metavar="POINTS",
    help="With the stationary responses at so many frequencies: median, 5 and 95 %.",
)
@click.option(
    "--members",
    type=int,
    default=StationaryRuns.members,
    show_default=True,
    help="Runs at each of them, each with a phase of its own.",
)
@click.option(
    "--settle",
    type=float,
    default=StationaryRuns.settle,
    show_default=True,
    help="Pseudo periods before their window.",
)
@click.option(
    "--window",
    type=int,
    default=StationaryRuns.window,
    show_default=True,
    help="Periods of the force in their window.",
)
@click.option(
    "--approach",
    type=float,
    help="Ratio at which they begin, to come into impact.  [default: at rest, at the frequency itself]",
)
@click.option(
    "--threads",
    type=click.IntRange(min=1),
    help="Number of threads of these runs; no number depends on it.  [default: all cores]",
)
@cluster_option
@common.resume_option
@common.json_option("Write all curves and their orbits, in SI units; compressed if it ends in .gz.")
@common.file_option("--csv", "Write a row for each point of a curve.")
@common.plot_option
def main(**options: Any) -> None:
    """Follow all periodic responses over the frequency, and print their peaks and folds.

    Exact orbits are the symmetric ones with one impact a wall in each period; each point is confirmed by the exact method, which also gives its
    stability. Harmonic balance has the responses without impacts too. Ctrl-C writes what is known so far; --resume keeps what is finished for a later
    run with the same scene, force and range.
    """
    with common.plain_errors(), workers(options["threads"], options["cluster"]) as executor:
        common.check_targets(options, ".json", ".gz")
        options |= {"stiffness": None, "absorber_damping": None}
        refuse_parts(options)
        options["force"] = (
            FORCE if options["force"] is None and options["structure"] is None else options["force"]
        )
        result = computed(options, executor)
        rows = (ORBIT_COLUMNS, branch_rows(curve.to_plain() for curve in result.curves))
        click.echo(text(result))
        files = write_files(
            {
                options["json"]: result.to_plain(),
                options["csv"]: rows,
                options["plot"]: lambda path: save_figure(path, result),
            }
        )
    common.name_files(files)
    common.end_early(result.complete)
