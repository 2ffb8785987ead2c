"""CPU time of a bladed disk with an absorber in every sector, over the number of sectors.

Compilation is not counted.
"""

import statistics
import time

import click
import numpy as np

from impact_env import Drive, FrequencySchedule, Record, impact_absorber, simulate
from impact_env.scene import Scene
from impact_env.structures.cyclic import ring_of_masses
from optimisation.cli.common import command
from optimisation.files import markdown
from studies.study import Json, OutputPaths, Study, add_table_options, make_table_study, run

NAME = "benchmark_sectors"
SECTORS = (5, 10, 20, 32, 64)
QUICK_SECTORS = (5, 10)
REPEATS = 3
QUICK_REPEATS = 1
PERIODS = 100
QUICK_PERIODS = 10
FREQUENCY = 100.0  # Hz, of a sector alone
COUPLING = 0.02
DAMPING_RATIO = 1e-3
AMPLITUDE = 1e-3  # m, of the ring without absorbers at its resonance of nodal diameter 0
GAP_SHARE = 0.05  # of that amplitude
RESTITUTION = 0.8
MASS_RATIO = 0.02  # of an absorber to its sector, of 1 kg
RECORD = Record(level=True)
FRICTION_SHARE = 0.01  # friction limit over an absorber's force of inertia at that amplitude


def disk(sectors: int, friction: bool) -> tuple[Scene, Drive]:
    """Return the ring and a sweep through the resonance of nodal diameter 0."""
    omega = 2 * np.pi * FREQUENCY
    gap = GAP_SHARE * AMPLITUDE
    limit = FRICTION_SHARE * MASS_RATIO * omega**2 * AMPLITUDE if friction else None
    ring = ring_of_masses(sectors, COUPLING, FREQUENCY, DAMPING_RATIO)
    times = np.array([0.0, PERIODS / FREQUENCY])
    schedule = FrequencySchedule(times, omega * np.array([0.99, 1.01]), omega)
    force = 2 * DAMPING_RATIO * omega**2 * AMPLITUDE
    return ring.scene(impact_absorber(gap, RESTITUTION, limit, MASS_RATIO)), Drive(force, schedule)


def time_cpu(scene: Scene, drive: Drive, periods: int) -> float:
    """Return the CPU time in ms of a pseudo period of a run."""
    began = time.process_time()
    simulate(scene, drive, record=RECORD)
    return 1e3 * (time.process_time() - began) / periods


def row(sectors: int, friction: bool, periods: int, repeats: int) -> Json:
    """Return events and computing time of a pseudo period of a disk.

    The time is given for a new disk, whose regimes have to be set up, and for a second run of the
    same disk.
    """
    scene, drive = disk(sectors, friction)
    drive = drive.between(0.0, periods / FREQUENCY)
    simulate(scene, drive.between(0.0, 1.0 / FREQUENCY), record=RECORD)  # compiles
    new = []
    again = []
    for _ in range(repeats):
        scene, _ = disk(sectors, friction)
        new.append(time_cpu(scene, drive, periods))
        again.append(time_cpu(scene, drive, periods))
    response = simulate(scene, drive, record=RECORD)
    return {
        "sectors": sectors,
        "friction": friction,
        "impacts": response.impact_count / periods,
        "new_ms": statistics.median(new),
        "again_ms": statistics.median(again),
        "each_new_ms": new,
        "each_again_ms": again,
    }


def measure(quick: bool) -> list[Json]:
    """Return the rows of all disks."""
    sectors = QUICK_SECTORS if quick else SECTORS
    periods, repeats = (QUICK_PERIODS, QUICK_REPEATS) if quick else (PERIODS, REPEATS)
    return [row(n, friction, periods, repeats) for friction in (False, True) for n in sectors]


def table(rows: list[Json]) -> str:
    """Return the table of the page."""
    head = ["sectors", "friction", "impacts a period", "new disk, ms a period", "again"]
    return markdown(
        head,
        [
            [
                str(line["sectors"]),
                "yes" if line["friction"] else "no",
                f"{line['impacts']:.0f}",
                f"{line['new_ms']:.2f}",
                f"{line['again_ms']:.2f}",
            ]
            for line in rows
        ],
    )


STUDY: Study[bool] = make_table_study(
    NAME,
    "cost of a bladed disk",
    lambda quick: {"rows": measure(quick)},
    lambda measured: table(measured.values["rows"]),
)


@command()
@click.option("--quick", is_flag=True, help="Two sizes and short sweeps.")
@add_table_options(NAME, "docs/many_absorbers.md")
def main(quick: bool, place: OutputPaths) -> None:
    """Time sweeps of bladed disks with an absorber in every sector.

    The table has CPU times as medians of repeats, without compilation.
    """
    run(STUDY, quick, place)
