"""Give the cavity's gap for a force by the design rule, and check it and its neighbours by simulation."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import click

from impact_env.curve import DEFAULT_MEMBERS
from impact_env.drive import PAPER_LIMITS, default_rate
from impact_env.parameters import DEFAULT_MASS_RATIO, Beam, friction_law, non_negative
from optimisation.command_line import end_early, name_files, plain_errors
from optimisation.commands.gap_answer import DEFAULT_GAPS, QUICK_GAPS, QUICK_MEMBERS, answer, simulated, write
from optimisation.commands.structure_option import POSITION_HELP, model_of, refuse_beside, structure_option
from optimisation.executors import cluster_option
from optimisation.extremes import usable_force, usable_rate
from optimisation.files import require_writable
from optimisation.friction_rule import PAPER_FRICTION
from optimisation.gap_check import RESTITUTION, gap_factors, scaled_absorber
from optimisation.report.gap_table import text


@click.command(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120})
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
@click.option("--members", type=click.IntRange(min=1), help=f"Runs for each gap, with other phases and roundings.  [default: {DEFAULT_MEMBERS}]")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of the phases and roundings.")
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


if __name__ == "__main__":
    main()
