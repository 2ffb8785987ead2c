"""Give the cavity's gap for a force by the design rule, and check it and its neighbours by simulation."""
# needs: files

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import click
from _structure_options import POSITION_HELP, model_of, refuse_beside, structure_option

from impact_env.curve import DEFAULT_MEMBERS
from impact_env.drive import PAPER_LIMITS
from impact_env.modes import ModalModel
from impact_env.parameters import DEFAULT_MASS_RATIO, Beam, SlidingAbsorber, friction_law, non_negative, positive
from optimisation.bounds import LARGE_REACH, SMALL_REACH, design_gap, expected_gap, require_reach
from optimisation.command_line import end_early, name_files, plain_errors
from optimisation.extremes import usable_force, usable_rate
from optimisation.files import replacing, require_writable, write_csv, write_json
from optimisation.friction_rule import PAPER_FRICTION
from optimisation.gap_check import RESTITUTION, GapCheck, check_gap, gap_factors, scaled_absorber, sweep_limits
from optimisation.progress import sweeps_bar
from optimisation.report.markdown import markdown
from optimisation.sweep_rate import LEAST_RATIO, default_rate, sweep_ratio

QUICK_GAPS, QUICK_MEMBERS = 5, 2
DEFAULT_GAPS = 11
HEADER = ("gap, mm", "of the rule's", "level, mm", "5 to 95 %, mm", "of no absorber, %", "limit, mm", "share of the possible, %")


def simulated(
    model: ModalModel,
    force: float,
    resonance: int,
    absorber: SlidingAbsorber,
    gaps: int,
    members: int,
    seed: int,
    rate: float,
    threads: int | None,
) -> GapCheck:
    factors = gap_factors(gaps)
    with sweeps_bar("simulating") as show:
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
    from optimisation.report.gap_report import COLUMNS, rows, save_figure, summary  # matplotlib is slow to import

    files = [out / name for name in ("levels.csv", "summary.json", "levels.png")]
    write_csv(files[0], COLUMNS, rows(check))
    write_json(files[1], summary(check))
    with replacing(files[2]) as temporary:
        save_figure(temporary, check)
    return files


def text(check: GapCheck) -> str:
    lines = []
    for k, gap in enumerate(check.gaps):
        cells = [f"{1e3 * gap:.4g}", f"{gap / check.rule:.3g}"]
        if math.isnan(check.level[k]):
            lines.append([*cells, *["-"] * 5])
            continue
        low, high = 1e3 * check.band[:, k]
        cells += [f"{1e3 * check.level[k]:.4g}", f"{low:.4g} to {high:.4g}", f"{100 * check.relative[k]:.1f}"]
        share = "-" if math.isnan(check.share[k]) else f"{100 * check.share[k]:.1f}"
        lines.append([*cells, f"{1e3 * check.limit[k]:.4g}", share])
    best = check.best
    if best is None or math.isnan(check.level[check.at_rule]):
        return markdown(HEADER, lines)
    verdict = "The rule's gap is the best of these."
    if best != check.at_rule:
        loss = 100 * (check.level[check.at_rule] / check.level[best] - 1)
        verdict = f"Best of these is {check.gaps[best] / check.rule:.3g} times the rule's gap; the level at the rule's is {loss:.1f} % higher."
    return "\n".join([markdown(HEADER, lines), "", verdict])


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
    out: Path,
) -> None:
    """Choose the gap of an impact absorber on the paper's beam, or another structure, for a force near a resonance.

    The design rule answers at once, then sweeps up and down check it. Writes levels.png, levels.csv and summary.json. Ctrl-C ends the
    simulation early and leaves what is finished.
    """
    gaps, members = gaps or (QUICK_GAPS if quick else DEFAULT_GAPS), members or (QUICK_MEMBERS if quick else DEFAULT_MEMBERS)
    with plain_errors():
        refuse_beside(structure, "modes", "damping")
        model = model_of(structure, Beam(modes=modes, absorber_position=position, damping_ratio=damping))
        usable_force("--force", force)
        absorber = scaled_absorber(model, force, resonance, mass_ratio, restitution, 1 if structure is None else resonance)
        if friction_limit is not None:
            absorber = replace(absorber, friction=friction_law(non_negative("friction_limit", friction_limit)))
        gap_factors(gaps)
        require_writable("--out", out)
        rate = default_rate(model, (resonance,)) if rate is None else usable_rate("--rate", rate, [PAPER_LIMITS])
        click.echo("\n".join(answer(model, mass_ratio, force, resonance, rate)))
        check = simulated(model, force, resonance, absorber, gaps, members, seed, rate, threads)
        files = write(out, check)
    click.echo("\n" + text(check))
    name_files(files)
    end_early(check.complete, "the files hold the runs that were finished.")


if __name__ == "__main__":
    main()
