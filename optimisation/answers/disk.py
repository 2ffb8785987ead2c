"""Bladed disks: levels by sector, one clearance for all sectors, absorbers compared.

Each result is a complete answer with text, figures and files.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

from impact_env.checks import require
from impact_env.drive import Drive, Excitation, FrequencySchedule
from impact_env.ensemble import Executor, Lane, LaneProgress
from impact_env.methods import Exact, Method
from impact_env.plain import from_disk
from impact_env.sectors import SectorResponse
from impact_env.structures.cyclic import BladedDisk
from impact_env.sweep import Watcher
from optimisation.disks import (
    WINDOWS,
    DiskComparisonLevels,
    DiskGapChoice,
    DiskRun,
    choose_disk_gap,
    compare_on_disk,
    disk_schedule,
    draw_disk_runs,
    find_excited_resonance,
    force_of,
    run_disks,
)
from optimisation.report import disk_report
from optimisation.report.disk_report import make_comparison_report, make_gap_report
from optimisation.report.report import CompleteAnswer, Json, Report


@dataclass(frozen=True, eq=False)
class DiskSweep(CompleteAnswer):
    """Levels by sector of a disk, or of an ensemble of mistuned disks, under one load.

    Attributes
    ----------
    disk : BladedDisk
        The first disk.
    drive : Drive or Loads
        Load of the first disk.
    responses : tuple of SectorResponse
        Response of each disk; the first has windows.
    resonance : int
        Resonance of the tuned disk that frequencies refer to, from 1.
    steady : bool
        Whether runs start from the steady state of the linear structure, not from rest.
    method : str
        Integration method, in words.

    """

    disk: BladedDisk
    drive: Excitation
    responses: tuple[SectorResponse, ...]
    resonance: int
    steady: bool = False
    method: str = str(Exact())

    @property
    def _title(self) -> list[str]:
        start = "the steady state" if self.steady else "rest"
        run = disk_report.describe_disk_run(
            self.disk, self.drive, self.resonance, start, self.method
        )
        disk = self.disk
        return [disk_report.describe_disk(disk), disk_report.describe_disk_absorbers(disk), run]

    def make_report(self) -> Report:
        """Return the content of the answer: plain data with an entry for each disk."""
        schedule = self.drive.schedule
        absorbers = self.disk.absorber_sectors if self.disk.absorbers else ()
        lines = disk_report.level_lines(self.responses, schedule.periods)
        numbers = {
            **disk_report.levels_to_json(self.responses),
            "pseudo_periods": schedule.periods,
            "reference_rad_s": schedule.reference,
            "start": "steady state" if self.steady else "rest",
            "omega_rad_s": self.disk.model.omega.tolist(),
            "scene": from_disk(self.disk),
        }
        title = "\n".join(self._title)
        return Report(
            title=self._title[0],
            text=[[*self._title, *lines], [disk_report.sector_table(self.responses, absorbers)]],
            numbers=numbers,
            figures={"sectors.png": partial(disk_report.draw_disk_sweep, title, self.responses)},
            resolution=130,
        )


def sweep_disk(
    disk: BladedDisk,
    force: float | None = None,
    schedule: FrequencySchedule | None = None,
    *,
    drive: Excitation | None = None,
    resonance: int | None = None,
    members: int = 1,
    seed: int = 0,
    steady_start: bool = False,
    method: Method | None = None,
    most_events: int | None = None,
    watch: Watcher | None = None,
    progress: LaneProgress | None = None,
    executor: Executor | None = None,
) -> DiskSweep:
    """Sweep a bladed disk through a resonance and return the levels of all sectors.

    The command `sweep` does the same.

    Parameters
    ----------
    disk : BladedDisk
        The disk, as `impact_env.plain.to_disk` reads it from a file.
    force : float, optional
        Amplitude in N of the force on each sector. None: that of the disk.
    schedule : FrequencySchedule, optional
        Frequency over time. None: a sweep up through the resonance,
        `optimisation.disks.disk_schedule`.
    drive : Drive or Loads, optional
        Load in place of force and schedule.
    resonance : int, optional
        Resonance of the tuned disk, from 1. None: the one that the force excites most.
    members : int
        Number of disks: each after the first has the mistuning of the next seed, and another phase
        of the force.
    seed : int
        Seed of phases and forces.
    steady_start : bool
        Start from the steady state of the linear structure.
    method, most_events
        As in `impact_env.simulate`.
    watch : callable, optional
        ``watch(time, end)`` during the first run.
    progress : callable, optional
        ``progress(done, total)`` after each further run.
    executor : Executor, optional
        Where the further runs are made; default: threads of this process.

    Returns
    -------
    DiskSweep
        With `str`, `to_json`, `plot` and `save`.

    Raises
    ------
    ParameterError, IntegrationError
        As `impact_env.simulate`.
    KeyboardInterrupt
        The runs were stopped.

    Examples
    --------
    >>> from impact_env import impact_absorber
    >>> from impact_env.structures.cyclic import BladedDisk, ring_of_masses
    >>> ring = ring_of_masses(sectors=3, coupling=0.02, frequency=40.0, damping_ratio=0.01)
    >>> disk = BladedDisk(ring, 1).with_absorbers(impact_absorber(2e-4, 0.8))
    >>> answer = sweep_disk(disk, force=5.0)  # doctest: +SKIP
    """
    resonance = find_excited_resonance(disk) if resonance is None else resonance
    if drive is None:
        sweep = disk_schedule(disk, resonance) if schedule is None else schedule
        drive = Drive(force_of(disk, force), sweep)
    first = DiskRun(disk, drive, steady_start, WINDOWS, method, most_events)
    allowed = "False here: it needs a harmonic load, damping at its frequency and no gravity"
    lane = Lane(disk.scene(), drive, steady_start)
    require(not steady_start or lane.start is not None, "steady_start", steady_start, allowed)
    runs = draw_disk_runs(first, members, seed)
    responses = [first.simulate(watch)]
    if members > 1:
        others = run_disks(runs[1:], progress=progress, executor=executor)
        finished = [response for response in others if response is not None]
        if len(finished) < len(others):
            raise KeyboardInterrupt
        responses += finished
    words = str(Exact() if method is None else method)
    return DiskSweep(disk, drive, tuple(responses), resonance, steady_start, words)


@dataclass(frozen=True, eq=False)
class DiskGapAnswer(CompleteAnswer):
    """One clearance for all absorbers of a disk, by the level of the worst sector.

    Attributes
    ----------
    choice : DiskGapChoice
        The search: levels at all gaps that were run, and the answers.

    """

    choice: DiskGapChoice

    @property
    def device(self) -> BladedDisk:
        """The disk with the recommended clearance."""
        return self.choice.disk(self.choice.recommended)

    def make_report(self) -> Report:
        """Return the content of the answer."""
        return make_gap_report(self.choice)

    def device_scene(self) -> Json:
        """Return the disk with the recommended clearance as plain data."""
        return from_disk(self.device)


@dataclass(frozen=True, eq=False)
class DiskComparisonAnswer(CompleteAnswer):
    """Absorbers of a disk compared by the level of the worst sector.

    Attributes
    ----------
    comparison : DiskComparisonLevels
        Levels by absorber, force and disk.

    """

    comparison: DiskComparisonLevels

    def make_report(self) -> Report:
        """Return the content of the answer."""
        return make_comparison_report(self.comparison)


def advise_disk(disk: BladedDisk, force: float | None = None, **options: Any) -> DiskGapAnswer:
    """Choose one clearance for all absorbers of a disk, as the command `design gap` does.

    The arguments are those of `optimisation.disks.choose_disk_gap`.
    """
    return DiskGapAnswer(choose_disk_gap(disk, force, **options))


def compare_disk(
    disk: BladedDisk, force: float | None = None, **options: Any
) -> DiskComparisonAnswer:
    """Compare the absorbers of a disk, as the command `compare` does.

    The arguments are those of `optimisation.disks.compare_on_disk`.
    """
    return DiskComparisonAnswer(compare_on_disk(disk, force, **options))
