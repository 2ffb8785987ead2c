"""Level of the worst blade of randomly mistuned disks in a sweep.

Every blade, every second blade, one blade or no blade has an absorber.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env import Drive, IntegrationError, Scene, impact_absorber, linear_sweep
from impact_env.ensemble import draw_members
from impact_env.sectors import SectorLevels, linear_sector_response, simulate_sectors
from impact_env.structures.cyclic import CyclicStructure, Mistuning, ring_of_masses
from studies.study import Json

Array = NDArray[np.float64]
SECTORS = 10
ENGINE_ORDER = 1
COUPLING = 0.01
FREQUENCY = 100.0  # Hz, of a blade alone
OMEGA = 2 * np.pi * FREQUENCY
DAMPING_RATIO = 3e-3
MASS_RATIO = 0.02  # of an absorber to its blade of 1 kg
RESTITUTION = 0.8
FREQUENCY_DEVIATION = 0.01  # standard deviation of the blades' frequencies
GAP_DEVIATION = 0.05  # of the clearances
AMPLITUDE = 1e-3  # m, of the tuned disk without absorbers at its resonance
FRICTION_SHARE = 0.02  # friction limit over an absorber's inertia at that amplitude
RATE = 1.0  # % of the resonance in 100 periods
MARGINS = (
    0.985,
    1.01,
)  # of the lowest and highest frequency of a disk: where its sweep begins and ends
TUNED_RUNS = 4  # of the tuned disk, with random phases of the force


@dataclass(frozen=True)
class Layout:
    """Which blades have absorbers, and whether these have friction."""

    name: str
    words: str
    step: int  # every so many blades; 0: the worst blade without absorbers alone
    friction: bool = False

    def choose_sectors(self, worst: int) -> list[int]:
        """Return the blades with absorbers of a disk with a worst blade."""
        return list(range(0, SECTORS, self.step)) if self.step else [worst]


LAYOUTS = {
    layout.name: layout
    for layout in (
        Layout("every", "every blade", 1),
        Layout("second", "every second blade", 2),
        Layout("one", "the worst blade alone", 0),
        Layout("friction", "every blade, with friction", 1, friction=True),
    )
}
BARE = "none"


class Case(NamedTuple):
    """A layout (or `BARE`) with a clearance over `AMPLITUDE`, 0 without absorbers."""

    layout: str
    clearance: float


def make_disk(seed: int | None) -> CyclicStructure:
    """Return the disk of a seed, None for the tuned one."""
    mistuning = None
    if seed is not None:
        mistuning = Mistuning(FREQUENCY_DEVIATION, GAP_DEVIATION, seed)
    return ring_of_masses(SECTORS, COUPLING, FREQUENCY, DAMPING_RATIO, mistuning=mistuning)


def make_drive(disk: CyclicStructure, phase: float) -> Drive:
    """Return the sweep through all resonances of a disk."""
    tuned = OMEGA * np.sqrt(1 + 4 * COUPLING * np.sin(np.pi * ENGINE_ORDER / SECTORS) ** 2)
    omegas = disk.model().omega / tuned
    low, high = MARGINS
    schedule = linear_sweep(float(tuned), low * omegas[0], high * omegas[-1], RATE)
    force = AMPLITUDE * 2 * DAMPING_RATIO * float(tuned) ** 2
    return Drive(force, schedule, phase)


def find_worst_blade(disk: CyclicStructure) -> int:
    """Return the blade with the largest stationary amplitude without absorbers."""
    omegas = disk.model().omega
    grid = np.linspace(0.99 * omegas[0], 1.01 * omegas[-1], 1000)
    response = np.abs(linear_sector_response(disk, grid, ENGINE_ORDER))
    return int(np.argmax(np.max(response, axis=0)))


def run_disk(case: Case, seed: int | None, phase: float) -> SectorLevels | None:
    """Return the levels of a disk's blades in its sweep; None where a run breaks down."""
    disk = make_disk(seed)
    if case.layout == BARE:
        scene = Scene(disk.model(ENGINE_ORDER))
    else:
        layout = LAYOUTS[case.layout]
        inertia = MASS_RATIO * OMEGA**2 * AMPLITUDE
        limit = FRICTION_SHARE * inertia if layout.friction else None
        gap = case.clearance * AMPLITUDE
        absorber = impact_absorber(gap, RESTITUTION, limit, MASS_RATIO)
        worst = find_worst_blade(disk) if layout.step == 0 else 0
        scene = disk.scene(absorber, ENGINE_ORDER, sectors=layout.choose_sectors(worst))
    try:
        return simulate_sectors(disk, scene, make_drive(disk, phase)).levels
    except IntegrationError:
        return None


def measure_case(case: Case, first: int, disks: int) -> Json:
    """Return levels and participation ratios of mistuned disks, and levels of the tuned disk.

    Worst and mean level and participation ratio are those of the disks from number ``first`` on.
    The tuned disk has its worst level for several phases of the force.
    """
    phases = draw_members(max(disks, TUNED_RUNS), 0, "phase").phases
    tuned = [] if first else [run_disk(case, None, float(phase)) for phase in phases[:TUNED_RUNS]]
    levels = [run_disk(case, seed, float(phases[seed])) for seed in range(first, disks)]
    whole = [level for level in levels if level is not None]
    return {
        "layout": case.layout,
        "clearance": case.clearance,
        "drawn": disks,
        "worst": [level.worst for level in whole],
        "mean": [level.mean for level in whole],
        "participation": [level.participation for level in whole],
        "tuned": [level.worst for level in tuned if level is not None],
    }


def add_disks(row: Json, disks: int) -> Json:
    """Return a row with so many disks in all."""
    more = measure_case(Case(row["layout"], row["clearance"]), row["drawn"], disks)
    lists = {name: row[name] + more[name] for name in ("worst", "mean", "participation", "tuned")}
    return row | lists | {"drawn": disks}


def summarise(row: Json, bare: Json) -> Json:
    """Return a row's medians and bands relative to the tuned disk without absorbers.

    The bands are from 5 to 95 %. The amplification factor, relative to the tuned disk with the same
    absorbers, is also returned.
    """
    reference = float(np.median(bare["tuned"]))
    worst = np.array(row["worst"])
    tuned = float(np.median(row["tuned"]))

    def band(values: Array) -> list[float]:
        return [float(x) for x in np.quantile(values, [0.5, 0.05, 0.95])]

    return {
        "level": band(worst / reference),
        "tuned": tuned / reference,
        "amplification": band(worst / tuned),
        "participation": band(np.array(row["participation"])),
        "disks": len(worst),
    }


def find_best(rows: list[Json]) -> Mapping[str, Json]:
    """Return, for each layout, the row with the lowest median level of the worst blade.

    Clearances are compared on the disks that all of them have.
    """
    best: dict[str, Json] = {}
    for name in LAYOUTS:
        own = [row for row in rows if row["layout"] == name]
        if own:
            disks = min(len(row["worst"]) for row in own)
            levels = [float(np.median(row["worst"][:disks])) for row in own]
            best[name] = own[int(np.argmin(levels))]
    return best
