"""Runs of bladed disks through the resonance of an engine order, and levels of the worst sector.

They are runs of one disk, or of many disks with random mistuning. From their levels follow the best
common clearance, and how absorbers compare.

Frequencies refer to a resonance of the tuned disk, so that disks of one ensemble are compared at
the same ones.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import ParameterError, count, instance, non_negative, positive, require
from impact_env.drive import Drive, Excitation, FrequencySchedule, default_rate, linear_sweep
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
from impact_env.modes import ModalModel
from impact_env.parameters import CoulombFriction, SlidingAbsorber
from impact_env.sectors import SectorResponse, simulate_sectors
from impact_env.solvers import kernel_key
from impact_env.structures.cyclic import BladedDisk
from impact_env.sweep import IntegrationError, Watcher
from optimisation.absorber_rules import best_friction, rigid_walls
from optimisation.bounds import design_gap, free_amplitude
from optimisation.gap_search import PAIRS, STEP, LevelSamples, find_best, search_gaps

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


# Levels of the worst sector of bladed disks: best common clearance, absorbers compared.
#
# The level of a disk is that of the sector with the highest one, the larger of a sweep up and a
# sweep down. Each member of an ensemble is another disk, mistuned by chance.

Array = NDArray[np.float64]
MEMBERS = 3
TOLERANCE = 0.1  # of the force
MOST_TOLERANCE = 0.3
SAME_FREQUENCY_TOL = 1e-9  # of the resonance: modes of one nodal diameter
START = 0.4  # of the free amplitude: the widest gap at which a search starts
FORCES = 3  # of a comparison
FORCE_SPAN = (
    2.0  # the largest force of a comparison over the force, and the force over the smallest
)


def equivalent_sector(disk: BladedDisk, resonance: int | None = None) -> ModalModel:
    """Return a model of one mode that moves as the most excited sector of the tuned disk.

    The motion is the stationary one at a resonance. All modes at the frequency of the resonance are
    included, a pair of modes under a travelling force. The shapes are those of a unit wave of
    forces at the sectors' places of force and absorber; the mass is that of a sector. Rules for one
    absorber then hold for an absorber in every sector.
    """
    resonance = find_excited_resonance(disk) if resonance is None else resonance
    tuned = disk.tuned()
    model = tuned.model
    omega = model.resonance_omega(resonance)
    same = np.abs(model.omega - omega) <= SAME_FREQUENCY_TOL * omega
    n = disk.ring.sectors
    at_absorber = model.places[:, same]
    at_response = tuned.response_shapes[:, same]
    # the response of each place to the force, over the square of the frequency
    absorber_motion = np.abs(at_absorber @ model.force_pattern[same])
    level_motion = np.abs(at_response @ model.force_pattern[same])
    worst = int(np.argmax(absorber_motion))
    require(
        float(absorber_motion[worst]) > 0,
        "resonance",
        resonance,
        "one that the force excites and that moves the absorbers",
    )
    wave = np.exp(-2j * np.pi * disk.engine_order * np.arange(n) / n)
    own = float(np.sqrt(np.abs((at_absorber @ (at_absorber.T @ wave))[worst])))
    force = float(absorber_motion[worst]) / own
    response = float(np.max(level_motion)) / force
    return ModalModel(
        np.array([omega]),
        np.array([float(model.damping_ratio[resonance - 1])]),
        np.array([force]),
        np.array([own]),
        float(disk.ring.sector_mass or 0.0),
        response_shape=None if response == own else np.array([response]),
    )


def friction_dampers(disk: BladedDisk, force: float, resonance: int | None = None) -> BladedDisk:
    """Return the disk with friction dampers of the same masses in place of the absorbers.

    Their friction limits follow from the energy of a cycle (`best_friction`).
    """
    sector = equivalent_sector(disk, resonance)
    dampers = []
    for absorber in disk.absorbers:
        limit, _ = best_friction(sector, absorber.mass_ratio * sector.beam_mass, force)
        dampers.append(SlidingAbsorber(absorber.mass_ratio, None, CoulombFriction(limit)))
    return disk.with_absorbers(tuple(dampers))


@dataclass(frozen=True)
class DiskCase:
    """Sweeps of disks near a ``resonance`` of the tuned disk.

    ``force`` is the amplitude in N on each sector, ``limits`` are the ends of the sweep over the
    resonance's frequency, and ``rate`` is in % per 100 pseudo periods.
    """

    disk: BladedDisk
    force: float
    resonance: int
    limits: tuple[float, float]
    rate: float

    def schedules(self) -> tuple[FrequencySchedule, FrequencySchedule]:
        """Return the sweep up and the sweep down."""
        omega = self.disk.tuned().model.resonance_omega(self.resonance)
        low, high = self.limits
        return linear_sweep(omega, low, high, self.rate), linear_sweep(omega, high, low, self.rate)

    def runs(self, disk: BladedDisk, force: float, members: range, seed: int) -> list[DiskRun]:
        """Return the runs of some members of a disk, up and down for each."""
        result = []
        for schedule in self.schedules():
            run = DiskRun(disk, Drive(force, schedule), steady_start=True)
            result.append(draw_disk_runs(run, members.stop, seed)[members.start :])
        return [run for pair in zip(*result, strict=True) for run in pair]


def disk_case(
    disk: BladedDisk,
    force: float | None = None,
    resonance: int | None = None,
    rate: float | None = None,
) -> DiskCase:
    """Return the case of a disk.

    Defaults (None) are the disk's own force, the resonance that this force excites most, and the
    rate that suits the disk's damping.
    """
    amplitude = force_of(disk, force)
    number = find_excited_resonance(disk) if resonance is None else resonance
    schedule = disk_schedule(disk, number, None, rate)
    low, high = (float(x) for x in schedule.omegas / schedule.reference)
    speed = 1e4 * (high - low) / schedule.periods
    return DiskCase(disk, amplitude, number, (low, high), speed)


def worst_levels(
    case: DiskCase,
    disk: BladedDisk,
    force: float,
    members: range,
    seed: int = 0,
    *,
    progress: LaneProgress | None = None,
    executor: Executor | None = None,
) -> Array:
    """Return the level in m of the worst sector of each member.

    The level is the larger of a sweep up and a sweep down. Raises KeyboardInterrupt if the runs are
    stopped.
    """
    responses = run_disks(
        case.runs(disk, force, members, seed), progress=progress, executor=executor
    )
    levels = [response.levels.worst for response in responses if response is not None]
    if len(levels) < len(responses):
        raise KeyboardInterrupt
    return np.max(np.array(levels).reshape(-1, 2), axis=1)


@dataclass(frozen=True, eq=False)
class DiskGapChoice:
    """Which clearance is best for all sectors.

    Attributes
    ----------
    case : DiskCase
        The disk with absorbers, and how it was swept.
    samples : LevelSamples
        Levels in m of the worst sector by steps of the gap from ``reference``.
    reference : float
        The design rule's gap in m.
    sharp, recommended : float
        Steps of the gap with the lowest level, and of the one whose largest level over the
        tolerance of the force is lowest.
    without : array, (M,)
        Levels in m of the worst sector without absorbers.
    tolerance : float
        Share by which the force may be larger or smaller.
    """

    case: DiskCase
    samples: LevelSamples
    reference: float
    sharp: float
    recommended: float
    without: Array
    tolerance: float

    def gap(self, step: float) -> float:
        """Return the clearance in m at a step."""
        return float(self.reference * np.exp(STEP * step))

    def disk(self, step: float) -> BladedDisk:
        """Return the disk with this common clearance."""
        return with_common_gap(self.case.disk, self.gap(step))


def with_common_gap(disk: BladedDisk, gap: float, friction_factor: float = 1.0) -> BladedDisk:
    """Return the disk with one clearance in m for all absorbers.

    Their friction limits are multiplied by ``friction_factor``.
    """
    absorbers = []
    for absorber in disk.absorbers:
        friction = absorber.friction
        if isinstance(friction, CoulombFriction):
            friction = replace(friction, limit=friction.limit * friction_factor)
        walls = replace(rigid_walls(absorber), gap=gap)
        absorbers.append(replace(absorber, walls=walls, friction=friction))
    return disk.with_absorbers(tuple(absorbers))


def count_gap_runs(members: int) -> int:
    """Return about the number of sweeps of `choose_disk_gap`."""
    return 2 * (PAIRS + members)


def choose_disk_gap(
    disk: BladedDisk,
    force: float | None = None,
    *,
    resonance: int | None = None,
    tolerance: float = TOLERANCE,
    members: int = MEMBERS,
    seed: int = 0,
    rate: float | None = None,
    progress: Callable[[int, int], None] | None = None,
    executor: Executor | None = None,
) -> DiskGapChoice:
    """Search one clearance for all absorbers of a disk by simulation.

    The search is described in `optimisation.gap_search`.

    Parameters
    ----------
    disk : BladedDisk
        The disk with impact absorbers; their gaps are replaced by one, of which the mistuning draws
        each. Friction limits of the file belong to the design rule's gap and go with the gap.
    force : float, optional
        Amplitude in N of the force on each sector. None: that of the disk.
    resonance : int, optional
        Resonance of the tuned disk, from 1. None: the one that the force excites most.
    tolerance : float
        Force tolerance: relative range of the force in which the recommended gap is robust.
    members, seed : int
        Disks at each gap of a result, mistuned by further seeds, and the seed of phases and
        forces.
    rate : float, optional
        Sweep rate in % per 100 pseudo periods.
    progress : callable, optional
        Takes the number of finished sweeps and about that of all.
    executor : Executor, optional
        Where the runs are made; default: threads of this process.

    Raises
    ------
    ParameterError
        Numbers out of range, a disk without impact absorbers.
    KeyboardInterrupt
        The runs were stopped.
    """
    require(len(disk.absorbers) > 0, "absorbers", 0, "impact absorbers in the disk's file")
    for absorber in disk.absorbers:
        rigid_walls(absorber)
    tolerance = non_negative("force_tolerance", tolerance, MOST_TOLERANCE)
    members = count("members", members, 1)
    case = disk_case(disk, force, resonance, rate)
    sector = equivalent_sector(disk, case.resonance)
    heaviest = max(absorber.mass_ratio for absorber in disk.absorbers) * sector.beam_mass
    rule = design_gap(sector, heaviest, case.force)
    free = free_amplitude(sector, heaviest, case.force)
    start = round(float(np.log(min(1.0, START * free / rule))) / STEP)
    expected = count_gap_runs(members)
    finished = 0

    def run(step: float, number: int) -> Array:
        nonlocal finished
        known = samples.levels.get(step, np.zeros(0))
        scale = float(np.exp(STEP * step))
        levels = worst_levels(
            case,
            with_common_gap(disk, rule * scale, scale),
            case.force,
            range(len(known), number),
            seed,
            executor=executor,
        )
        finished += 2 * len(levels)
        if progress is not None:
            progress(finished, max(expected, finished))
        return np.concatenate([known, levels])

    samples = LevelSamples()
    without = worst_levels(
        case, disk.with_absorbers(()), case.force, range(members), seed, executor=executor
    )
    finished += 2 * members
    search_gaps(run, start, tolerance, members, PAIRS, samples, None, 0.0)
    sharp, recommended = find_best(samples, tolerance, members)
    return DiskGapChoice(case, samples, rule, sharp, recommended, without, tolerance)


@dataclass(frozen=True, eq=False)
class DiskComparisonLevels:
    """Levels in m of the worst sector of M disks under F forces.

    ``levels`` (F, M) are those of each absorber, by name. ``tuned`` is the level in m without
    absorbers and without mistuning at the first force, and ``dampers`` the disk with friction
    dampers.
    """

    case: DiskCase
    forces: Array
    levels: dict[str, Array]
    tuned: float
    dampers: BladedDisk


WITHOUT = "no absorbers"
IMPACT = "the file's absorbers"
FRICTION = "friction dampers"


def count_comparison_runs(forces: int, members: int) -> int:
    """Return the number of sweeps of `compare_on_disk`."""
    return 2 * (1 + members * (1 + 2 * forces))


def compare_on_disk(
    disk: BladedDisk,
    force: float | None = None,
    *,
    forces: int = FORCES,
    resonance: int | None = None,
    members: int = MEMBERS,
    seed: int = 0,
    rate: float | None = None,
    progress: Callable[[int, int], None] | None = None,
    executor: Executor | None = None,
) -> DiskComparisonLevels:
    """Compare a disk with its absorbers, without absorbers and with friction dampers.

    The friction dampers have the same masses as the absorbers of the disk's file.

    Parameters and errors as `choose_disk_gap`; ``forces``: number of forces, from half to twice the
    force.
    """
    require(len(disk.absorbers) > 0, "absorbers", 0, "absorbers in the disk's file")
    case = disk_case(disk, force, resonance, rate)
    number = count("forces", forces, 1)
    amplitudes = case.force * np.geomspace(1 / FORCE_SPAN, FORCE_SPAN, number)
    if number == 1:
        amplitudes = np.array([case.force])
    dampers = friction_dampers(disk, case.force, case.resonance)
    total = count_comparison_runs(number, members)
    finished = 0

    def run(which: BladedDisk, amplitude: float, number_of_disks: int) -> Array:
        nonlocal finished
        levels = worst_levels(
            case, which, amplitude, range(number_of_disks), seed, executor=executor
        )
        finished += 2 * number_of_disks
        if progress is not None:
            progress(finished, total)
        return levels

    bare = disk.with_absorbers(())
    tuned = float(run(bare.tuned(), amplitudes[0], 1)[0])
    linear = run(bare, amplitudes[0], members)
    levels = {WITHOUT: linear * (amplitudes / amplitudes[0])[:, None]}
    for name, which in ((IMPACT, disk), (FRICTION, dampers)):
        levels[name] = np.array([run(which, amplitude, members) for amplitude in amplitudes])
    return DiskComparisonLevels(case, amplitudes, levels, tuned, dampers)
