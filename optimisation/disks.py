"""Runs of bladed disks: sweeps through the resonance of an engine order.

They are runs of one disk, or of many disks with random mistuning.

Frequencies refer to a resonance of the tuned disk, so that disks of one ensemble are compared at
the same ones.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from impact_env.checks import ParameterError, count, instance, positive, require
from impact_env.drive import Excitation, FrequencySchedule, default_rate, linear_sweep
from impact_env.ensemble import (
    Executor,
    Lane,
    LaneProgress,
    Threads,
    draw_members,
    drives_of,
    find_first_of_each,
)
from impact_env.methods import Exact, Method
from impact_env.sectors import SectorResponse, simulate_sectors
from impact_env.solvers import kernel_key
from impact_env.structures.cyclic import BladedDisk
from impact_env.sweep import IntegrationError, Watcher

WINDOWS = 400  # of a run, whose RMS by sector a figure shows
MARGIN = 0.01  # beyond the frequencies of the disk, at least: of the resonance
HALF_WIDTHS = 5.0  # the same in half-widths of the resonance
SPREAD = 3.0  # standard deviations of the sectors' frequencies, by which a range is wider


def find_excited_resonance(disk: BladedDisk) -> int:
    """Return the resonance of the tuned disk, from 1, that its force excites most.

    It is the resonance of the mode with the largest modal amplitude.
    """
    model = instance("disk", disk, BladedDisk).tuned().model
    damping = np.maximum(model.damping_ratio, 1e-12)
    amplitudes = np.abs(model.force_pattern) / (2 * damping * model.omega**2)
    return int(np.argmax(amplitudes * (1 + 1e-9 * np.arange(model.modes, 0, -1)))) + 1


def find_disk_range(disk: BladedDisk, resonance: int) -> tuple[float, float]:
    """Return (low, high) over a resonance of the tuned disk as the range of a sweep.

    The range contains the resonances that absorbers and mistuning shift.

    Absorbers that stick lower the frequencies by their mass; mistuning lets the force excite all
    frequencies of the family of N modes, three standard deviations wider.
    """
    model = disk.tuned().model
    omega = model.resonance_omega(resonance)
    deviation = disk.ring.mistuning.frequency
    low = high = omega
    if deviation > 0:
        first = (resonance - 1) // disk.ring.sectors * disk.ring.sectors
        family = model.omega[first : first + disk.ring.sectors]
        low = float(family[0]) * max(0.1, 1 - SPREAD * deviation)
        high = float(family[-1]) * (1 + SPREAD * deviation)
    heaviest = max((one.mass_ratio for one in disk.absorbers), default=0.0)
    margin = max(MARGIN, HALF_WIDTHS * float(model.damping_ratio[resonance - 1]))
    stuck = float(np.sqrt(1 + heaviest))
    return max(0.05, low / omega / stuck - margin), high / omega + margin


def disk_schedule(
    disk: BladedDisk,
    resonance: int | None = None,
    limits: tuple[float, float] | None = None,
    rate: float | None = None,
) -> FrequencySchedule:
    """Return a sweep up through a resonance of the tuned disk.

    Parameters
    ----------
    disk : BladedDisk
        The disk.
    resonance : int, optional
        Resonance of the tuned disk, counted from 1. None: `find_excited_resonance`.
    limits : (float, float), optional
        First and last frequency over the resonance. None: `find_disk_range`.
    rate : float, optional
        Sweep rate in % per 100 pseudo periods. None: `impact_env.drive.default_rate`.
    """
    if resonance is None:
        resonance = find_excited_resonance(disk)
    model = disk.tuned().model
    low, high = find_disk_range(disk, resonance) if limits is None else limits
    speed = default_rate(model, (resonance,)) if rate is None else rate
    return linear_sweep(model.resonance_omega(resonance), low, high, speed)


@dataclass(frozen=True, eq=False)
class DiskRun:
    """One run of a disk.

    Parameters
    ----------
    disk : BladedDisk
        The disk.
    drive : Drive or Loads
        Force or loads over time; its amplitude is that of the force on each sector.
    steady_start : bool, optional
        Start from the steady state of the linear structure, as in `impact_env.ensemble.Lane`.
    windows : int, optional
        Windows of `impact_env.sectors.simulate_sectors`. None: levels alone.
    method : Exact, Moreau or RungeKutta, optional
        Integration method. None: `Exact`.
    most_events : int, optional
        Budget of each part of the run.
    """

    disk: BladedDisk
    drive: Excitation
    steady_start: bool = False
    windows: int | None = None
    method: Method | None = None
    most_events: int | None = None

    def simulate(self, progress: Watcher | None = None) -> SectorResponse:
        """Make the run."""
        scene = self.disk.scene()
        lane = Lane(scene, self.drive, self.steady_start)
        return simulate_sectors(
            self.disk.ring,
            scene,
            self.drive,
            self.method,
            windows=self.windows,
            initial=lane.start,
            most_events=self.most_events,
            progress=progress,
        )


def draw_disk_runs(run: DiskRun, members: int, seed: int = 0) -> list[DiskRun]:
    """Return the runs of an ensemble; the first is ``run`` itself, the others have no windows.

    Each other member is another disk, with the mistuning of the next seed, and has a phase and
    force of its own as in `draw_members`.
    """
    run = instance("run", run, DiskRun)
    drives = drives_of(draw_members(count("members", members, 1), seed), run.drive)
    others = [
        DiskRun(run.disk.member(k), drive, run.steady_start, None, run.method, run.most_events)
        for k, drive in enumerate(drives)
    ]
    return [run, *others[1:]]


def run_disks(
    runs: Sequence[DiskRun],
    *,
    progress: LaneProgress | None = None,
    executor: Executor | None = None,
) -> list[SectorResponse | None]:
    """Make runs in parallel and return their responses.

    The response is None for a run that was not made because of a KeyboardInterrupt.

    Raises ParameterError and IntegrationError with the run named.
    """
    executor = Threads() if executor is None else executor
    responses: list[SectorResponse | None] = [None] * len(runs)
    kinds = [kernel_key(run.disk.scene(), run.method or Exact(), run.drive) for run in runs]
    # threads compile kernels once if the first run of each kind is made alone
    alone = find_first_of_each(kinds) if isinstance(executor, Threads) else []
    others = [number for number in range(len(runs)) if number not in alone]
    done = 0
    try:
        for batch in (*([number] for number in alone), others):
            items = [(number, runs[number]) for number in batch]
            for k, response in executor.each(
                _simulate_run, items, [kinds[number] for number in batch]
            ):
                responses[batch[k]] = response
                done += 1
                if progress is not None:
                    progress(done, len(runs))
    except KeyboardInterrupt:
        return responses
    return responses


def _simulate_run(item: tuple[int, DiskRun]) -> SectorResponse:
    """Make a run; its errors name its number."""
    number, run = item
    try:
        return run.simulate()
    except IntegrationError as error:
        raise IntegrationError(f"disk {number}: {error}", error.time, error.response) from error
    except ParameterError as error:
        raise ParameterError(f"disk {number}: {error}") from error


def force_of(disk: BladedDisk, force: float | None) -> float:
    """Return the amplitude in N of the force on each sector.

    It is ``force``, or that of the disk. Raises ParameterError if neither is given.
    """
    amplitude = disk.amplitude if force is None else force
    require(amplitude is not None, "force", None, "given in N, or amplitude_n in the file")
    return positive("force", amplitude)
