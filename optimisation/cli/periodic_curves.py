"""Bifurcations over frequency and a second parameter."""

from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path

import click

from optimisation.cli.common import (
    check_targets,
    command,
    end_early,
    plain_errors,
    write_report,
)
from optimisation.cli.options import OptionSpec, name_parameter, option
from optimisation.cli.periodic_orbits import (
    CURVES,
    PARAMETER_NAMES,
    CaseOptions,
    OrbitOptions,
    run,
)


@dataclass(frozen=True, kw_only=True)
class CurveOptions(CaseOptions):
    """Options of ``periodic curves``."""

    kind: tuple[str, ...] = option(
        OptionSpec(
            names=("--kind",),
            help="Curves of this kind only; may be repeated",
            more=f"{', '.join(CURVES)}.",
            type=click.Choice(list(CURVES)),
            metavar="KIND",
            multiple=True,
            default=tuple(CURVES),
            default_text="all kinds",
            usual=True,
        )
    )
    over: tuple[str, float, float] = option(
        "over",
        help="The parameter that changes with the frequency, and its range in SI units",
        more=(
            f"{', '.join(PARAMETER_NAMES)}; the range is around the value at which branches begin."
        ),
        type=click.Tuple([click.Choice(list(PARAMETER_NAMES)), float, float]),
        required=True,
    )
    symmetric: bool = option(
        "symmetric", help="Curves of symmetric orbits only, which is quicker", usual=True
    )
    csv: Path | None = option("csv", more="Then one for each place that is located.")
    plot: Path | None = option("plot")
    json: Path | None = option("json")


@command(
    CurveOptions,
    examples=("periodic curves --modes 1 --over force 1.4 1.6 --symmetric",),
    rewrite=partial(name_parameter, usual="force"),
)
def main(options: CurveOptions) -> None:
    """Follow bifurcations of exact periodic orbits over the frequency and a second parameter.

    Branches over the frequency, at the case that the options describe, have the bifurcations
    through which the curves lead: folds, broken symmetry, doubled periods, tori, grazing, and loss
    of contact (an impact without speed). A curve says at each of its points whether what is born
    there is supercritical, and has the special points at which a second condition is met: cusp,
    strong resonances R1 to R4, fold-flip, fold-Neimark-Sacker, generalised period doubling,
    Chenciner, grazing-fold.

    --over damping is the ratio of the first mode, to which the others keep theirs; --over position
    the place of the absorber on a beam.
    """
    with plain_errors():
        check_targets(vars(options), ".json", ".gz")
        case = {one.name: getattr(options, one.name) for one in fields(CaseOptions)}
        report, complete = run(
            OrbitOptions(
                **case,
                curve=options.kind,
                over=options.over,
                symmetric=options.symmetric,
                csv=options.csv,
                plot=options.plot,
                json=options.json,
            )
        )
        write_report(report, options)
    end_early(complete, "what was finished is shown.")
