"""Frequency response of periodic motions: exact branches with their stability, harmonic balance, linear curves, and sweeps over them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from impact_env.periodic.harmonic_balance import PAPER_DAMPER, WEIGHT
from impact_env.periodic.stationary import StationaryRuns
from optimisation.cli.common import RESUME, check_target, command, end_early, json_option, name_files, plain_errors
from optimisation.cli.frequency_curves import BALANCE, BOTH, EXACT, FIGURES, FORCE, computed, written
from optimisation.cli.scene_options import scene_options
from optimisation.cli.sweep_scene import refuse_parts
from optimisation.executors import cluster_option, workers
from optimisation.report.response_table import text


@command()
@click.option("--absorber", type=click.Choice(["impact", "friction"]), help="Impact absorber or friction damper.  [default: impact]")
@scene_options("; below 1 exact orbits only")
@click.option("--contact-stiffness", type=float, help="Makes the walls springs of this stiffness in N/m: harmonic balance only.")
@click.option("--friction-stiffness", type=float, help="Makes friction elastic with this stiffness in N/m.")
@click.option("--force", type=float, help=f"Amplitude of the harmonic force in N.  [default: {FORCE}, with --structure by the design rule]")
@click.option("--resonance", type=int, default=1, show_default=True, help="Resonance, counted from 1, that frequencies refer to.")
@click.option("--from", "start", type=float, default=0.88, show_default=True, help="Lowest frequency over the resonance frequency.")
@click.option("--to", "stop", type=float, default=1.06, show_default=True, help="Highest frequency over the resonance frequency.")
@click.option("--method", type=click.Choice([EXACT, BALANCE, BOTH]), default=BOTH, show_default=True, help="Exact orbits, harmonic balance, both.")
@click.option("--pairs", is_flag=True, help="With the exact orbits without symmetry, and of longer periods, that leave these branches.")
@click.option("--harmonics", type=int, default=20, show_default=True, help="Highest harmonic of harmonic balance.")
@click.option("--weight", type=float, default=WEIGHT, show_default=True, help="Weight of the rigid contact in harmonic balance, in m_a omega_1^2.")
@click.option("--grounded-damper", is_flag=True, help=f"With the paper's damper of {PAPER_DAMPER} N s/m between absorber and ground (balance only).")
@click.option("--sweeps/--no-sweeps", default=True, show_default=True, help="With a sweep up and one down by the exact method.")
@click.option("--rate", type=float, help="Rate of the sweeps.  [default: 1, less by the square of damping below 1 %]")
@click.option("--envelope", type=int, metavar="POINTS", help="With the stationary responses at so many frequencies: median, 5 and 95 %.")
@click.option("--members", type=int, default=StationaryRuns.members, show_default=True, help="Runs at each of them, each with a phase of its own.")
@click.option("--settle", type=float, default=StationaryRuns.settle, show_default=True, help="Pseudo periods before their window.")
@click.option("--window", type=int, default=StationaryRuns.window, show_default=True, help="Periods of the force in their window.")
@click.option("--approach", type=float, help="Ratio at which they begin, to come into impact.  [default: at rest, at the frequency itself]")
@click.option("--threads", type=click.IntRange(min=1), help="Number of threads of these runs; no number depends on it.  [default: all cores]")
@cluster_option
@click.option("--resume", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", help=RESUME)
@json_option("Write all curves, in SI units.")
@click.option("--csv", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", help="Write a row for each point of a curve.")
@click.option("--plot", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", help="Draw it: .png, .pdf or .svg.")
def main(**given: Any) -> None:
    """Follow all periodic responses over the frequency, and print their peaks and folds.

    Exact orbits are the symmetric ones with one impact a wall in each period; each point is confirmed by the exact method, which also gives its
    stability. Harmonic balance has the responses without impacts too. Ctrl-C writes what is known so far; --resume keeps what is finished for a later
    run with the same scene, force and range.
    """
    with plain_errors(), workers(given["threads"], given["cluster"]) as executor:
        for option, suffixes in (("json", (".json",)), ("csv", (".csv",)), ("plot", FIGURES)):
            check_target(f"--{option}", given[option], suffixes)
        check_target("--resume", given["resume"], (".json",))
        given |= {"stiffness": None, "absorber_damping": None}
        refuse_parts(given)
        given["force"] = FORCE if given["force"] is None and given["structure"] is None else given["force"]
        result = computed(given, executor)
        files = written(result, given)
    click.echo(text(result))
    if files:
        name_files(files)
    end_early(result.complete)
