"""Curves of bifurcations, grazing and loss of contact over the frequency and a second parameter, with their special points."""

from typing import Any

import click

from optimisation.cli.common import (
    check_targets,
    command,
    end_early,
    file_option,
    json_option,
    name_files,
    plain_errors,
    plot_option,
)
from optimisation.cli.orbits import CURVES, PARAMETER_NAMES, case_options, run
from optimisation.files import write_files

ORBIT_OPTIONS = ("at", "along", "folds", "thresholds")  # what `periodic orbits` has beside curves


@command()
@click.option(
    "--kind",
    "curve",
    type=click.Choice(list(CURVES)),
    multiple=True,
    default=tuple(CURVES),
    help="Curves of this kind only; repeatable.  [default: all kinds]",
)
@click.option(
    "--with",
    "second",
    type=click.Choice(list(PARAMETER_NAMES)),
    default="force",
    show_default=True,
    help="The parameter beside the frequency.",
)
@click.option(
    "--over",
    type=float,
    nargs=2,
    metavar="LOW HIGH",
    required=True,
    help="Its range in SI units, around the value at which branches begin.",
)
@case_options
@click.option(
    "--symmetric", is_flag=True, help="Curves of symmetric orbits only, which is quicker."
)
@file_option("--csv", "Write a row for each point, then one for each place located.")
@plot_option
@json_option("Write the curves, in SI units.")
def main(**options: Any) -> None:
    """Follow bifurcations of exact periodic orbits over the frequency and a second parameter.

    Branches over the frequency, at the case that the options describe, have the bifurcations through which the curves lead: folds, broken symmetry,
    doubled periods, tori, grazing, and loss of contact (an impact without speed). A curve says at each of its points whether what is born there is
    supercritical, and has the special points at which a second condition is met: cusp, strong resonances R1 to R4, fold-flip,
    fold-Neimark-Sacker, generalised period doubling, Chenciner, grazing-fold.

    --with damping is the ratio of the first mode, to which the others keep theirs; --with position the place of the absorber on a beam.
    """
    with plain_errors():
        check_targets(options, ".json", ".gz")
        options |= dict.fromkeys(ORBIT_OPTIONS)
        options |= {"points": 2, "starts": 0, "seed": 0}
        text, files, complete = run(options)
        click.echo(text)
        name_files(write_files(files))
    end_early(complete, "what was finished is shown.")
