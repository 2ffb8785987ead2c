"""Give the cavity's gap for a force by the design rule, and check it and its neighbours by simulation."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import click

from impact_env.curve import DEFAULT_MEMBERS
from impact_env.drive import PAPER_LIMITS, default_rate
from impact_env.modes import ModalModel
from impact_env.parameters import DEFAULT_MASS_RATIO, Beam, SlidingAbsorber, friction_law, non_negative, positive
from optimisation.bounds import LARGE_REACH, SMALL_REACH, design_gap, expected_gap, require_reach
from optimisation.cli.common import command, end_early, name_files, plain_errors
from optimisation.cli.structure_option import POSITION_HELP, model_of, refuse_beside, structure_option
from optimisation.executors import cluster_option, workers
from optimisation.extremes import usable_force, usable_rate
from optimisation.files import replacing, require_writable, write_csv, write_json
from optimisation.friction_rule import PAPER_FRICTION
from optimisation.gap_check import RESTITUTION, GapCheck, check_gap, gap_factors, scaled_absorber, sweep_limits
from optimisation.progress import sweeps_bar
from optimisation.report.gap_table import text
from optimisation.sweep_rate import LEAST_RATIO, sweep_ratio

QUICK_GAPS, QUICK_MEMBERS = 5, 2
DEFAULT_GAPS = 11


def simulated(
    model: ModalModel,
    force: float,
    resonance: int,
    absorber: SlidingAbsorber,
    *,
    gaps: int,
    members: int,
    seed: int,
    rate: float,
    threads: int | None,
    cluster: str | None = None,
) -> GapCheck:
    """Simulate the rule's gap and its neighbours under a bar, on a ``cluster`` (host:port) if there is one; the rest as in `check_gap`."""
    factors = gap_factors(gaps)
    with workers(threads, cluster) as executor, sweeps_bar("simulating") as show:
        return check_gap(
            model,
            force,
            resonance,
            absorber,
            factors=factors,
            members=members,
            seed=seed,
            percent_per_100_periods=rate,
            threads=threads,
            progress=show,
            executor=executor,
        )


def answer(model: ModalModel, mass_ratio: float, force: float, resonance: int, rate: float) -> list[str]:
    """Return what is known without a simulation of the absorber; raises ParameterError where the rule says nothing."""
    mass = positive("mass_ratio", mass_ratio) * model.beam_mass
    rule, found = design_gap(model, mass, force, resonance), require_reach(model, mass, force, resonance)
    lines = [
        f"Design rule: a clearance of {1e3 * rule:.4g} mm to either wall for {force:g} N near resonance {resonance}.",
        f"Free amplitude over that gap: {found:.3g}.",
    ]
    expected = expected_gap(model, mass, force, resonance)
    lines.append(f"From simulations of other structures the best gap is expected at {1e3 * expected:.4g} mm, {expected / rule:.3g} times the rule's.")
    if found < SMALL_REACH:
        lines.append(f"Warning: below {SMALL_REACH:g} the rule's gap is too wide (docs/design_rule.md).")
    if found > LARGE_REACH:
        lines.append(f"Warning: above {LARGE_REACH:g} the rule's gap is too narrow, and that side is the steep one (docs/design_rule.md).")
    ratio = sweep_ratio(model, rate, resonance, sweep_limits(model, mass, resonance))
    lines.append(f"Sweeps at {rate:.3g} % per 100 pseudo periods show {ratio:.3f} of the stationary level without absorber.")
    if ratio < LEAST_RATIO:
        lines.append(f"Warning: below {LEAST_RATIO:g} shares of the possible are left out; sweep more slowly.")
    return lines


def write(out: Path, check: GapCheck) -> list[Path]:
    """Write the figure and the tables into a folder, and return the files."""
    from optimisation.report.gap_report import COLUMNS, rows, save_figure, summary  # matplotlib is slow to import

    files = [out / name for name in ("levels.csv", "summary.json", "levels.png")]
    write_csv(files[0], COLUMNS, rows(check))
    write_json(files[1], summary(check))
    with replacing(files[2]) as temporary:
        save_figure(temporary, check)
    return files


@command()
@structure_option
@click.option("--force", type=float, required=True, help="Amplitude of the harmonic force in N.")
@click.option("--resonance", type=click.IntRange(min=1), default=1, show_default=True, help="Resonance near which it acts, counted from 1.")
@click.option("--mass-ratio", type=float, default=DEFAULT_MASS_RATIO, show_default=True, help="Absorber mass over beam mass.")
@click.option(
    "--position",
    type=float,
    default=Beam.absorber_position,
    show_default=True,
    help=POSITION_HELP,
)
@click.option("--modes", type=int, default=Beam.modes, show_default=True, help="Number of modes kept.")
@click.option("--restitution", type=float, default=RESTITUTION, show_default=True, help="Coefficient of restitution in the simulation, 0 to 1.")
@click.option(
    "--friction-limit",
    type=float,
    help=f"Friction limit in N in the simulation; 0: no friction.  [default: the paper's {PAPER_FRICTION} N by the scaling law]",
)
@click.option("--rate", type=float, help="Sweep rate in % per 100 pseudo periods.  [default: 1, less by the square of damping below 1 %]")
@click.option("--damping", type=float, default=Beam.damping_ratio, show_default=True, help="Damping ratio of all modes.")
@click.option("--quick", is_flag=True, help=f"A look in a few seconds: {QUICK_GAPS} gaps, {QUICK_MEMBERS} members, unless given.")
@click.option("--gaps", type=click.IntRange(min=3), help=f"Number of gaps, odd, the rule's in the middle.  [default: {DEFAULT_GAPS}]")
@click.option("--members", type=click.IntRange(min=1), help=f"Runs for each gap, other in phase and 1e-6 of force.  [default: {DEFAULT_MEMBERS}]")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of the phases and forces.")
@click.option("--threads", type=click.IntRange(min=1), help="Number of threads; the result does not depend on it.  [default: all cores]")
@cluster_option
@click.option("--out", type=click.Path(path_type=Path), default=Path("results/design_gap"), show_default=True, help="Folder for figure and tables.")
def main(
    structure: Path | None,
    force: float,
    resonance: int,
    mass_ratio: float,
    position: float,
    modes: int,
    restitution: float,
    friction_limit: float | None,
    rate: float | None,
    damping: float,
    quick: bool,
    gaps: int | None,
    members: int | None,
    seed: int,
    threads: int | None,
    cluster: str | None,
    out: Path,
) -> None:
    """Choose the gap of an impact absorber on the paper's beam, or another structure, for a force near a resonance.

    The design rule answers at once, then sweeps up and down check it. Writes levels.png, levels.csv and summary.json. Ctrl-C ends the
    simulation early and leaves what is finished.
    """
    gaps, members = gaps or (QUICK_GAPS if quick else DEFAULT_GAPS), members or (QUICK_MEMBERS if quick else DEFAULT_MEMBERS)
    with plain_errors():
        refuse_beside(structure, "modes", "damping")
        model = model_of(structure, position, modes=modes, damping_ratio=damping)
        usable_force("--force", force)
        absorber = scaled_absorber(model, force, resonance, mass_ratio, restitution, 1 if structure is None else resonance)
        if friction_limit is not None:
            absorber = replace(absorber, friction=friction_law(non_negative("friction_limit", friction_limit)))
        gap_factors(gaps)
        require_writable("--out", out)
        rate = default_rate(model, (resonance,)) if rate is None else usable_rate("--rate", rate, [PAPER_LIMITS])
        click.echo("\n".join(answer(model, mass_ratio, force, resonance, rate)))
        amount = {"gaps": gaps, "members": members, "seed": seed}
        check = simulated(model, force, resonance, absorber, **amount, rate=rate, threads=threads, cluster=cluster)
        files = write(out, check)
    click.echo("\n" + text(check))
    name_files(files)
    end_early(check.complete, "the files hold the runs that were finished.")
