"""Periodic responses over the frequency."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import click

from impact_env.checks import positive, require
from impact_env.drive import default_rate
from impact_env.ensemble import Executor
from impact_env.parameters import CompliantWalls, RigidWalls
from impact_env.periodic.harmonic_balance import PAPER_DAMPER, WEIGHT, harmonic_balance
from impact_env.periodic.overview import (
    Overview,
    OverviewOptions,
    compute_overview,
    require_sliding,
)
from impact_env.periodic.stationary import StationaryRuns
from impact_env.plain import from_scene
from optimisation.checkpoint import Checkpoint
from optimisation.cli import common
from optimisation.cli.options import OptionSpec, number, option, option_values, switch
from optimisation.cli.scene_options import (
    SLIDING_VALUES,
    SceneOptions,
    absorber_specs,
    is_option_set,
    make_scene,
    refuse_parts,
    warn_of_nodes,
)
from optimisation.executors import Bar, workers
from optimisation.report.response_report import make_response_report

FORCE = 1.5  # N, the paper's moderate level of excitation
EXACT = "exact"
BALANCE = "balance"
BOTH = "both"


@dataclass(frozen=True, kw_only=True)
class BranchOptions(SceneOptions):
    """Options of ``periodic branches``; None: not given."""

    absorber: str | None = option(
        OptionSpec(
            names=("--absorber",),
            help="Kind of absorber: impact or friction",
            type=click.Choice(["impact", "friction"]),
            metavar="KIND",
            default_text="impact",
            section="Absorber",
        )
    )
    values: Mapping[str, float] = option_values(
        absorber_specs(*SLIDING_VALUES, "contact_stiffness", "friction_stiffness")
    )
    force: float | None = option(
        "force", default_text=f"{FORCE}, with --structure by the design rule"
    )
    resonance: int = option("resonance")
    start: float = option("start")
    stop: float = option("stop")
    method: str = option(
        OptionSpec(
            names=("--method",),
            help="Exact orbits, harmonic balance, or both",
            more=(
                "Below a restitution of 1 exact orbits only; walls that are springs by harmonic "
                "balance only."
            ),
            type=click.Choice([EXACT, BALANCE, BOTH]),
            metavar="METHOD",
            default=BOTH,
            usual=True,
            section="Runs",
        )
    )
    pairs: bool = option(
        switch(
            "--pairs",
            (
                "With the exact orbits without symmetry, and of longer periods, that leave these "
                "branches"
            ),
        )
    )
    harmonics: int = option(
        number("--harmonics", "Highest harmonic of harmonic balance", type=int, default=20)
    )
    weight: float = option(
        number(
            "--weight",
            "Weight of the rigid contact in harmonic balance",
            unit="m_a omega_1^2",
            default=WEIGHT,
        )
    )
    grounded_damper: bool = option(
        switch(
            "--grounded-damper",
            f"With the paper's damper of {PAPER_DAMPER} N s/m between absorber and ground",
            more="Harmonic balance only.",
        )
    )
    hill: bool = option(
        switch(
            "--hill",
            "With the stability of harmonic balance at walls that are springs, by Hill's method",
        )
    )
    sweeps: bool = option(
        switch(
            "--sweeps/--no-sweeps",
            "With a sweep up and one down by the exact method",
            default=True,
            usual=True,
        )
    )
    rate: float | None = option("rate")
    envelope: int | None = option(
        number(
            "--envelope",
            "With the stationary responses at so many frequencies: median, 5 and 95 %",
            type=int,
            metavar="POINTS",
        )
    )
    members: int = option(
        "members",
        help="Runs of the envelope at each frequency, other in phase",
        default=StationaryRuns.members,
    )
    settle: float = option(
        "settle",
        help="Pseudo periods before the window of the envelope",
        type=float,
        default=StationaryRuns.settle,
        older=(),
    )
    window: int = option(
        "window",
        help="Periods of the force in the window of the envelope",
        default=StationaryRuns.window,
    )
    approach: float | None = option(
        number(
            "--approach",
            "Ratio at which the envelope's runs begin, to come into impact",
            default_text="at rest, at the frequency itself",
        )
    )
    threads: int | None = option("threads")
    cluster: str | None = option("cluster")
    resume: Path | None = option("resume")
    json: Path | None = option(
        "json", more="All curves and their orbits, in SI units; compressed if it ends in .gz."
    )
    csv: Path | None = option("csv", help="Write a row for each point of a curve")
    plot: Path | None = option("plot")


@contextmanager
def following(reference: float) -> Iterator[Callable[[str, int, float], None]]:
    """Yield a function that shows how far a curve has been followed.

    It shows the frequency over the ``reference`` frequency in rad/s.
    """
    with Bar(total=None, bar_format="{desc} [{elapsed}]", leave=False) as bar:

        def show(label: str, points: int, omega: float) -> None:
            bar.set_description_str(f"{label}: {points} points, at {omega / reference:.4f}")
            bar.update()

        yield show


def computed(options: BranchOptions, executor: Executor | None = None) -> Overview:
    """Do what the options ask for, the envelope's runs by an executor as in `run_lanes`.

    Raises BadInput or ParameterError before anything long is done.
    """
    scene, _, force = make_scene(options)
    assert force is not None
    reference = scene.model.resonance_omega(options.resonance)
    warn_of_nodes(scene.model, options.resonance)
    walls = require_sliding(scene).walls
    low = positive("--from", options.start)
    high = positive("--to", options.stop)
    require(high > low, "--to", high, f"above --from = {low}")
    inelastic = isinstance(walls, RigidWalls) and walls.restitution < 1
    require(
        not (inelastic and options.method == BALANCE),
        "--method",
        BALANCE,
        "exact below a restitution of 1: harmonic balance has no impact law",
    )
    hill = options.hill
    springs = options.method != EXACT and isinstance(walls, CompliantWalls)
    require(not hill or springs, "--hill", hill, "with harmonic balance and --contact-stiffness")
    balance = None
    if options.method != EXACT and not inelastic:
        damper = PAPER_DAMPER if options.grounded_damper else 0.0
        balance = harmonic_balance(
            scene,
            low * reference,
            force,
            options.harmonics,
            options.weight,
            grounded_damper=damper,
        )
    sweeps = ((low, high), (high, low)) if options.sweeps else ()
    rate = (
        default_rate(scene.model, (options.resonance,))
        if options.rate is None
        else positive("--rate", options.rate)
    )
    overview_options = OverviewOptions(
        options.method != BALANCE,
        options.pairs,
        balance,
        sweeps,
        rate,
        stationary_runs(options, executor),
        hill,
    )
    basis = {"scene": from_scene(scene), "force": float(force), "reference": reference}
    with closing(Checkpoint(options.resume)) as checkpoint, following(reference) as show:
        return compute_overview(
            scene,
            force,
            reference,
            low,
            high,
            overview_options,
            show,
            checkpoint.section(basis),
        )


def stationary_runs(
    options: BranchOptions, executor: Executor | None = None
) -> StationaryRuns | None:
    """Return the settings of the stationary runs, or None without --envelope.

    Raises BadInput for an option of these runs without --envelope.
    """
    if options.envelope is None:
        for name in ("members", "settle", "window", "approach", "threads", "cluster"):
            if is_option_set(name):
                raise common.BadInput(
                    f"--{name} does not go without --envelope: it is about the runs of the envelope"
                )
        return None
    lengths = options.members, options.settle, options.window
    return StationaryRuns(
        options.envelope,
        *lengths,
        options.approach,
        threads=options.threads,
        executor=executor,
    )


@common.command(
    BranchOptions,
    examples=(
        "periodic branches --modes 2 --method balance --no-sweeps",
        "periodic branches --modes 3 --plot branches.png",
    ),
)
def main(options: BranchOptions) -> None:
    """Follow all periodic responses over the frequency, and print their peaks and folds.

    Exact orbits are the symmetric ones with one impact a wall in each period; each point is
    confirmed by the exact method, which also gives its stability. Harmonic balance has the
    responses without impacts too. Ctrl-C writes what is known so far; --resume keeps what is
    finished for a later run with the same scene, force and range.
    """
    with common.plain_errors(), workers(options.threads, options.cluster) as executor:
        common.check_targets(vars(options), ".json", ".gz")
        refuse_parts(options)
        if options.force is None and options.structure is None:
            options = replace(options, force=FORCE)
        result = computed(options, executor)
        common.write_report(make_response_report(result), options)
    common.end_early(result.complete)
