"""Time `calibrate`: three parameters by one sweep of the page's shaker test, with ten modes."""

import runpy
import tempfile
import time
from pathlib import Path

import click

from impact_env import impact_absorber, load_structure, modal_model
from impact_env.ensemble import available_cores
from optimisation.answers.calibration import QUICK_RUNS, CalibrationRuns, calibrate
from optimisation.calibration.measurement import MOVING, Measurement, read_measurements
from optimisation.cli.common import command
from optimisation.files import DOCS
from studies.study import (
    Json,
    OutputPaths,
    Study,
    add_table_options,
    format_table,
    make_table_study,
    run,
)

NAME = "benchmark_calibration"  # also the page's marker
EXAMPLES = DOCS / "examples"
FREE = ("restitution", "friction_limit", "gap")
MASS = 0.03  # kg
LEAST_RUNS = CalibrationRuns(32, 16, 1, 20)  # compile


def time_calibration(measurements: tuple[Measurement, ...], runs: CalibrationRuns) -> Json:
    """Return simulated measurements, and CPU and wall time in s, of a calibration."""
    arm = load_structure(EXAMPLES / "arm.toml")
    absorber = impact_absorber(1e-3, 0.6, 0.1, MASS / modal_model(arm).beam_mass)
    wall = time.perf_counter()
    cpu = time.process_time()
    answer = calibrate(measurements, arm, absorber, FREE, runs=runs, alternatives="never")
    return {
        "sweeps": len(measurements),
        "modes": len(answer.model.scene.model.omega),
        "parameters": len(FREE),
        "simulated": answer.model.inference.runs + runs.replicates,
        "cpu_s": round(time.process_time() - cpu, 1),
        "wall_s": round(time.perf_counter() - wall, 1),
    }


def measure(runs: CalibrationRuns) -> Json:
    """Return the row of one sweep with the absorber, compilation apart."""
    with tempfile.TemporaryDirectory() as folder:
        runpy.run_path(str(EXAMPLES / "shaker_test.py"))["main"](Path(folder))
        both = read_measurements(Path(folder) / "shaker_test.toml")
    own = tuple(one for one in both if one.absorber == MOVING)
    time_calibration(own, LEAST_RUNS)
    return {"threads": available_cores(), "rows": [time_calibration(own, runs)]}


def table(rows: list[Json]) -> str:
    """Return the table of the page."""
    columns = {
        "sweeps": "{sweeps}",
        "modes": "{modes}",
        "parameters": "{parameters}",
        "simulated measurements": "{simulated}",
        "CPU time, s": "{cpu_s:.0f}",
        "wall time, s": "{wall_s:.0f}",
    }
    return format_table(columns, rows)


STUDY: Study[CalibrationRuns] = make_table_study(
    NAME, "cost of a calibration", measure, lambda measured: table(measured.values["rows"])
)


@command()
@click.option("--quick", is_flag=True, help="Fewer simulated measurements.")
@add_table_options(NAME, "docs/calibrate.md")
def main(quick: bool, place: OutputPaths) -> None:
    """Time the calibration of three parameters by a sweep of 12 s, with ten modes.

    CPU and wall time are measured without compilation.
    """
    run(STUDY, QUICK_RUNS if quick else CalibrationRuns(), place)
