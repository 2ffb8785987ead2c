"""Folds of the branches of periodic orbits."""

from dataclasses import dataclass, fields
from pathlib import Path

from optimisation.cli.common import (
    check_targets,
    command,
    end_early,
    plain_errors,
    write_report,
)
from optimisation.cli.options import option, switch
from optimisation.cli.periodic_orbits import CaseOptions, OrbitOptions, run


@dataclass(frozen=True, kw_only=True)
class FoldOptions(CaseOptions):
    """Options of ``periodic folds``."""

    thresholds: bool = option(
        switch("--thresholds", "The forces at which isolas are born and merge instead", usual=True)
    )
    csv: Path | None = option("csv", help="Write a row for each fold", usual=True)
    json: Path | None = option("json")


@command(FoldOptions, examples=("periodic folds --modes 1 --from 0.93 --to 0.96 --json -",))
def main(options: FoldOptions) -> None:
    """Find the folds of the branches of symmetric orbits at one force.

    Each fold is confirmed by the exact method. With --thresholds the forces at which isolas are
    born and merge with their neighbours.
    """
    with plain_errors():
        check_targets(vars(options), ".json", ".gz")
        case = {one.name: getattr(options, one.name) for one in fields(CaseOptions)}
        report, complete = run(
            OrbitOptions(
                **case,
                folds=not options.thresholds,
                thresholds=options.thresholds,
                csv=options.csv,
                json=options.json,
            )
        )
        write_report(report, options)
    end_early(complete, "what was finished is shown.")
