"""Measures of bladed disks by sector.

The measures are response levels, localisation (participation ratio), energies by nodal diameter,
and the amplification by mistuning.

A run of a cyclic structure (`structures.cyclic`) is computed in parts of bounded size. Only sums
over the samples of a part are kept, so that memory does not grow with the duration.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from impact_env.checks import count, instance, positive, require, row
from impact_env.drive import Drive, Excitation
from impact_env.kernels.motion.observers import new_level, push_samples
from impact_env.level import HALF_WINDOW_PERIODS, read_level
from impact_env.loads import Loads
from impact_env.methods import Method
from impact_env.result_files import SavedResult
from impact_env.results import DEFAULT_SAMPLES, MOST_BINS, MOST_SAMPLES_PER_PERIOD, Record, Response
from impact_env.scene import InitialState, Scene
from impact_env.structures.cyclic import CyclicStructure
from impact_env.sweep import Stop, Watcher, simulate

if TYPE_CHECKING:
    from impact_env.plots import Axes

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
PART_BYTES = 2**25  # memory for the samples of a part of a run
WINDOW_TOL = 1e-9  # share of a window: rounding of the time of a sample between two windows


def participation_ratio(amplitudes: ArrayLike) -> Array:
    """Return the participation ratio (sum a^2)^2/(N sum a^4) of the amplitudes a of N sectors.

    It is 1 where all are equal and 1/N where one sector moves alone.

    Parameters
    ----------
    amplitudes : array_like, (..., N)
        Amplitudes of the sectors, in any unit.

    Returns
    -------
    array, (...)
        The ratio; NaN where nothing moves.

    Examples
    --------
    >>> from impact_env.sectors import participation_ratio
    >>> float(participation_ratio([1.0, 1.0, 0.0, 0.0]))
    0.5
    """
    sizes = np.abs(np.asarray(amplitudes, dtype=float))
    with np.errstate(divide="ignore", invalid="ignore"):
        # shares of the largest: fourth powers neither overflow nor underflow
        shares = (sizes / np.max(sizes, axis=-1, keepdims=True)) ** 2
    return np.asarray(np.sum(shares, -1) ** 2 / (shares.shape[-1] * np.sum(shares**2, -1)))


@dataclass(frozen=True, eq=False)
class SectorLevels(SavedResult):
    """Response levels of the N sectors of a disk, each defined like `ResponseLevel`.

    Parameters
    ----------
    value : array, (N,)
        Level of each sector in m: RMS around its largest displacement.
    time, frequency_ratio : array, (N,)
        Time in s of the largest displacement, and the drive's frequency there over the reference
        frequency of the drive's schedule.
    largest : array, (N,)
        Largest absolute displacement in m.
    """

    value: Array
    time: Array
    frequency_ratio: Array
    largest: Array

    @property
    def worst(self) -> float:
        """Highest level of all sectors in m."""
        return float(np.max(self.value))

    @property
    def worst_sector(self) -> int:
        """Sector with the highest level, counted from 0."""
        return int(np.argmax(self.value))

    @property
    def mean(self) -> float:
        """Mean of the sectors' levels in m."""
        return float(np.mean(self.value))

    @property
    def participation(self) -> float:
        """Participation ratio of the levels, see `participation_ratio`."""
        return float(participation_ratio(self.value))


@dataclass(frozen=True, eq=False)
class DiameterEnergies(SavedResult):
    """Energy in J of the modes of the tuned disk, by nodal diameter k.

    The arrays are (..., K + 1), with k from 0 to K = floor(N/2).

    ``forward`` and ``backward`` are the energies of the waves that travel in the direction of
    rising and of falling sector numbers. A standing wave counts half in each. So do the diameters 0
    and N/2, whose modes cannot travel.
    """

    forward: Array
    backward: Array

    @property
    def total(self) -> Array:
        """Energy of each nodal diameter in J, (..., K + 1)."""
        return np.asarray(self.forward + self.backward)

    @property
    def travelling(self) -> Array:
        """Travelling part of the energy in J: absolute difference of both directions."""
        return np.asarray(np.abs(self.forward - self.backward))

    @property
    def standing(self) -> Array:
        """Standing part of the energy in J: the total less the travelling part."""
        return np.asarray(2 * np.minimum(self.forward, self.backward))

    def mean(self) -> DiameterEnergies:
        """Return the mean over the first axis, such as the samples of a run."""
        return DiameterEnergies(np.mean(self.forward, axis=0), np.mean(self.backward, axis=0))


@dataclass(frozen=True, eq=False)
class SectorWindows(SavedResult):
    """Motion of the N sectors and impacts of the n absorbers in each of B equal windows of a run.

    Parameters
    ----------
    edges : array, (B + 1,)
        Times in s at which windows begin and end.
    frequency_ratio : array, (B,)
        Drive's frequency over its schedule's reference, at the middle of each window.
    rms : array, (B, N)
        RMS displacement of each sector in m. It is NaN, like the extremes and the energies, in a
        window without a sample.
    low, high : array, (B, N)
        Least and largest displacement in m, with sign.
    impacts : array of int, (B, n)
        Number of impacts of each absorber.
    energies : DiameterEnergies, (B, K + 1)
        Mean energy by nodal diameter.
    """

    edges: Array
    frequency_ratio: Array
    rms: Array
    low: Array
    high: Array
    impacts: NDArray[np.int64]
    energies: DiameterEnergies

    @property
    def amplitude(self) -> Array:
        """Half of the peak-to-peak displacement in m, (B, N)."""
        return np.asarray((self.high - self.low) / 2)

    @property
    def participation(self) -> Array:
        """Participation ratio of the sectors' RMS displacements, (B,)."""
        return participation_ratio(self.rms)

    def plot(self, axes: Axes | None = None, **options: Any) -> Axes:
        """Draw the RMS displacement of all sectors as a colour map, and return matplotlib's axes.

        Its abscissa is the frequency ratio, or the time if the frequency is constant. ``axes``
        None: new axes. ``options`` go to matplotlib's pcolormesh.
        """
        from impact_env.plots import plot_waterfall

        swept = bool(np.ptp(self.frequency_ratio) > 0)
        middle = (self.edges[1:] + self.edges[:-1]) / 2
        return plot_waterfall(
            self.frequency_ratio if swept else middle, self.rms, swept, axes, options
        )


@dataclass(frozen=True, eq=False)
class SectorResponse(SavedResult):
    """Result of `simulate_sectors`.

    Attributes
    ----------
    levels : SectorLevels
        Response levels by sector.
    windows : SectorWindows or None
        Measures of each window; None if no windows were requested.
    final_state : InitialState
        State at the end.
    impact_count : int
        Number of impacts of all absorbers.
    """

    levels: SectorLevels
    windows: SectorWindows | None
    final_state: InitialState
    impact_count: int


def amplification_factor(mistuned: SectorLevels, tuned: SectorLevels) -> float:
    """Return the level of the worst sector of a mistuned disk over that of the tuned disk.

    Parameters
    ----------
    mistuned, tuned : SectorLevels
        Levels of both disks under the same force.

    Returns
    -------
    float
        The ratio of the two largest levels.

    Raises
    ------
    ParameterError
        The tuned disk does not move.

    Examples
    --------
    >>> import numpy as np
    >>> from impact_env.sectors import SectorLevels, amplification_factor
    >>> zero = np.zeros(3)
    >>> tuned = SectorLevels(np.array([2e-3, 2e-3, 2e-3]), zero, zero, zero)
    >>> mistuned = SectorLevels(np.array([1e-3, 3e-3, 2e-3]), zero, zero, zero)
    >>> amplification_factor(mistuned, tuned)
    1.5
    """
    return mistuned.worst / positive("worst level of the tuned disk", tuned.worst)


def linear_sector_response(
    disk: CyclicStructure,
    omega: ArrayLike,
    engine_order: int = 0,
    direction: str = "forward",
    modes: int | None = None,
) -> Complex:
    """Return the complex amplitude (L, N) in m/N of each sector's displacement, without absorbers.

    The structure vibrates stationarily at L frequencies ``omega`` in rad/s. The other arguments and
    errors are those of `CyclicStructure.model`. The amplitude is infinite or NaN at an undamped
    resonance.
    """
    model = disk.model(engine_order, direction, modes)
    allowed = "finite frequencies in rad/s"
    w = row("omega", np.atleast_1d(np.asarray(omega, dtype=float)), allowed)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        modal = model.force_pattern / (
            model.omega**2 - w**2 + 2j * model.damping_ratio * model.omega * w
        )
        return np.asarray(modal @ disk.response_shapes(modes).T, dtype=np.complex128)


class _DiameterModes:
    """Projection of a run onto the modes of the tuned disk, by nodal diameter.

    The run is given in ``modes`` modal coordinates of the disk, which may be mistuned.
    """

    def __init__(self, disk: CyclicStructure, modes: int) -> None:
        n = disk.sectors
        mass = np.asarray(disk.mass, dtype=float)
        coupling = np.asarray(disk.coupling, dtype=float)
        size = len(mass)
        self.shapes = disk.all_shapes(modes).reshape(n, size, modes)
        self.omegas = np.zeros((n // 2 + 1, size))
        projections = []
        for k in range(n // 2 + 1):
            turn = np.exp(2j * np.pi * k / n) * coupling
            block = np.asarray(disk.stiffness) + (turn + turn.conj().T if n > 1 else 0.0)
            squares, vectors = scipy.linalg.eigh(block, mass)
            self.omegas[k] = np.sqrt(np.maximum(squares, 0.0))
            wave = np.exp(-2j * np.pi * k * np.arange(n) / n) / np.sqrt(n)
            # from the modal coordinates of the run to those of this diameter
            projections.append(
                vectors.conj().T @ mass @ np.tensordot(wave, self.shapes, axes=(0, 0))
            )
        self.projection = np.array(projections)
        half = np.arange(n // 2 + 1)
        self.travels = (half > 0) & (2 * half < n)

    def compute_energies(self, displacement: Array, velocity: Array) -> DiameterEnergies:
        """Return the energies (S, K + 1) of S samples.

        ``displacement`` and ``velocity`` (S, N_m) are modal, as in `diameter_energies`.
        """
        swing = self.omegas * np.einsum("kdm,sm->skd", self.projection, displacement)
        rate = np.einsum("kdm,sm->skd", self.projection, velocity)
        forward = 0.5 * np.sum(np.abs(swing + 1j * rate) ** 2, axis=-1)
        backward = 0.5 * np.sum(np.abs(swing - 1j * rate) ** 2, axis=-1)
        # diameters without a direction have one mode for each freedom of a sector instead of two
        standing = 0.25 * (forward + backward)
        return DiameterEnergies(
            np.where(self.travels, forward, standing), np.where(self.travels, backward, standing)
        )


def diameter_energies(
    disk: CyclicStructure, displacement: ArrayLike, velocity: ArrayLike
) -> DiameterEnergies:
    """Return the energy by nodal diameter of S states of a disk.

    Parameters
    ----------
    disk : CyclicStructure
        The disk. The states refer to its own modes, with mistuning; the energies refer to the modes
        of the disk without mistuning.
    displacement, velocity : array_like, (S, N_m)
        Modal displacements in sqrt(kg) m and velocities in sqrt(kg) m/s, such as those of a
        `History`.

    Returns
    -------
    DiameterEnergies
        Energies in J, (S, K + 1).

    Raises
    ------
    ParameterError
        The arrays differ in size, or have more columns than the disk has modes.

    Examples
    --------
    >>> import numpy as np
    >>> from impact_env.sectors import diameter_energies
    >>> from impact_env.structures.cyclic import ring_of_masses
    >>> disk = ring_of_masses(sectors=4, coupling=0.1, frequency=10.0)
    >>> energies = diameter_energies(disk, np.zeros((1, 4)), np.array([[2.0, 0.0, 0.0, 0.0]]))
    >>> energies.total.round(12).tolist()
    [[2.0, 0.0, 0.0]]
    """
    disk = instance("disk", disk, CyclicStructure)
    allowed = "rows of finite numbers, one for each mode"
    q = row("displacement", displacement, allowed, axes=2)
    v = row("velocity", velocity, allowed, axes=2)
    require(v.shape == q.shape, "velocity", v.shape, f"as many rows and columns: {q.shape}")
    most = disk.sectors * len(np.asarray(disk.mass))
    modes = count("modes in displacement", q.shape[1], 1, most)
    return _DiameterModes(disk, modes).compute_energies(q, v)


class _WindowSums:
    """Sums over the samples of a run, by window and sector.

    ``interval`` is the time in s between two samples.
    """

    def __init__(
        self, disk: CyclicStructure, scene: Scene, drive: Excitation, windows: int, interval: float
    ) -> None:
        n = disk.sectors
        self._diameters = _DiameterModes(disk, scene.model.modes)
        self._end = float(drive.schedule.times[-1])
        self._interval = interval
        self.number = windows
        self.samples = np.zeros(windows)
        self.squares = np.zeros((windows, n))
        self.low = np.full((windows, n), np.inf)
        self.high = np.full((windows, n), -np.inf)
        self.impacts = np.zeros((windows, scene.places), dtype=np.int64)
        self.forward = np.zeros((windows, n // 2 + 1))
        self.backward = np.zeros((windows, n // 2 + 1))

    def _find_windows(self, time: Array) -> NDArray[np.int64]:
        """Return the index of the window of each time in s."""
        window = np.floor(time * (self.number / self._end) + WINDOW_TOL).astype(np.int64)
        return np.minimum(window, self.number - 1)

    def add(self, part: Response, start: float, first: int, values: Array, skip: int) -> None:
        """Add a part of a run.

        ``start`` is the time in s at which the part begins. ``values`` (S, N) are the sectors'
        displacements in m at its new samples, the first of which has the number ``first`` in the
        run. The history of ``part`` has ``skip`` older samples in front of these.
        """
        times = np.asarray(self._interval * (first + np.arange(len(values))), dtype=np.float64)
        which = self._find_windows(times)
        history = part.recorded.history
        energies = self._diameters.compute_energies(
            history.modal_displacement[skip:], history.modal_velocity[skip:]
        )
        np.add.at(self.samples, which, 1.0)
        np.add.at(self.squares, which, values**2)
        np.minimum.at(self.low, which, values)
        np.maximum.at(self.high, which, values)
        np.add.at(self.forward, which, energies.forward)
        np.add.at(self.backward, which, energies.backward)
        impacts = part.recorded.impacts
        np.add.at(self.impacts, (self._find_windows(start + impacts.time), impacts.absorber), 1)

    def finish(self, drive: Excitation) -> SectorWindows:
        """Return the measures of all windows from the sums."""
        edges = np.linspace(0.0, self._end, self.number + 1)
        ratio = drive.schedule.omega_at((edges[1:] + edges[:-1]) / 2) / drive.schedule.reference
        samples = np.where(self.samples > 0, self.samples, np.nan)[:, None]
        return SectorWindows(
            edges,
            ratio,
            np.sqrt(self.squares / samples),
            np.where(samples > 0, self.low, np.nan),
            np.where(samples > 0, self.high, np.nan),
            self.impacts,
            DiameterEnergies(self.forward / samples, self.backward / samples),
        )


def _divide_samples(scene: Scene, drive: Excitation, samples: int) -> list[tuple[float, int]]:
    """Return the start in s of each part of a run, and the number of its first sample.

    ``samples`` is the number of samples in a pseudo period. A run under `Loads` has one part.
    """
    interval = drive.schedule.pseudo_period / samples
    end = float(drive.schedule.times[-1])
    size = 16 * (scene.model.modes + scene.places)
    length = max(samples, PART_BYTES // size)
    if isinstance(drive, Loads):
        return [(0.0, 0)]
    number = max(1, int(np.ceil(end / (interval * length) - WINDOW_TOL)))
    return [(k * length * interval, k * length) for k in range(number)]


def _run_parts(
    scene: Scene,
    drive: Excitation,
    parts: list[tuple[float, int]],
    record: Record,
    state: InitialState | None,
    progress: Watcher | None,
    **options: Any,
) -> Iterator[tuple[float, int, Response]]:
    """Yield start in s, number of the first sample, and response of each part of a run.

    Each part begins in the final state of the one before; the first in ``state``. ``progress`` is
    called with the time in the whole run.
    """
    end = float(drive.schedule.times[-1])
    for number, (start, first) in enumerate(parts):
        own = drive
        if isinstance(drive, Drive) and len(parts) > 1:
            stop = parts[number + 1][0] if number + 1 < len(parts) else end
            own = drive.between(start, stop)

        def report(time: float, _end: float, start: float = start) -> None:
            assert progress is not None
            progress(start + time, end)

        response = simulate(
            scene,
            own,
            initial=state,
            record=record,
            progress=None if progress is None else report,
            **options,
        )
        state = response.final_state
        yield start, first, response


def simulate_sectors(
    disk: CyclicStructure,
    scene: Scene,
    drive: Excitation,
    method: Method | None = None,
    *,
    windows: int | None = None,
    initial: InitialState | None = None,
    samples_per_period: int = DEFAULT_SAMPLES,
    most_events: int | None = None,
    progress: Watcher | None = None,
    stop: Stop | None = None,
) -> SectorResponse:
    """Integrate a scene of a disk and return the levels of all sectors.

    Under a `Drive` the run is computed in parts, each from the final state of the one before. Long
    runs therefore need no more memory than short ones; up to rounding, the result is that of a run
    in one part. Under `Loads` the run has one part.

    Parameters
    ----------
    disk : CyclicStructure
        The disk; levels are those of its ``response`` freedom.
    scene : Scene
        The disk with its absorbers and forces (`CyclicStructure.scene`), or without absorbers.
    drive : Drive or Loads
        Force or loads over time.
    method : Exact, Moreau or RungeKutta, optional
        Integration method (default: `Exact`).
    windows : int, optional
        Number of equal windows into which the run is divided for RMS, extremes, impacts and
        energies (`SectorWindows`). None: levels alone.
    initial, most_events, progress, stop
        As in `simulate`; ``most_events`` holds for each part.
    samples_per_period : int, optional
        Number of samples of the motion in a pseudo period, at least 4.

    Returns
    -------
    SectorResponse
        Levels by sector, windows, and the state at the end.

    Raises
    ------
    ParameterError
        As `simulate`, or the scene has more modes than the disk.
    IntegrationError, Stopped
        As `simulate`; the error carries the response of the part that failed.

    Examples
    --------
    >>> from impact_env import Drive, constant_frequency, impact_absorber
    >>> from impact_env.sectors import simulate_sectors
    >>> from impact_env.structures.cyclic import ring_of_masses
    >>> disk = ring_of_masses(sectors=5, coupling=0.02, frequency=40.0, damping_ratio=0.01)
    >>> scene = disk.scene(impact_absorber(gap=2e-4, restitution=0.8, mass_ratio=0.02))
    >>> drive = Drive(2.0, constant_frequency(scene.model.omega[0], 1.0, 100.0))
    >>> result = simulate_sectors(disk, scene, drive, windows=10)
    >>> result.levels.value.shape, result.windows.rms.shape
    ((5,), (10, 5))
    """
    disk = instance("disk", disk, CyclicStructure)
    scene = instance("scene", scene, Scene)
    drive = instance("drive", drive, Drive | Loads)
    samples = count("samples_per_period", samples_per_period, 4, MOST_SAMPLES_PER_PERIOD)
    most = disk.sectors * len(np.asarray(disk.mass))
    allowed = f"1 to {most} modes, those of the disk"
    require(scene.model.modes <= most, "scene", f"{scene.model.modes} modes", allowed)
    shapes = disk.response_shapes(scene.model.modes)
    interval = drive.schedule.pseudo_period / samples
    sums = None
    if windows is not None:
        number = count("windows", windows, 1, MOST_BINS)
        sums = _WindowSums(disk, scene, drive, number, interval)
    levels = [new_level(samples, HALF_WINDOW_PERIODS) for _ in shapes]
    record = Record(level=True, events=sums is not None, series=True, samples_per_period=samples)
    parts = _divide_samples(scene, drive, samples)
    options = {"method": method, "most_events": most_events, "stop": stop}
    impacts = 0
    runs = _run_parts(scene, drive, parts, record, initial, progress, **options)
    for start, first, part in runs:
        skip = int(first > 0)  # the first sample is the last one of the part before
        values = part.recorded.history.modal_displacement[skip:] @ shapes.T
        for sector, level in enumerate(levels):
            block = np.ascontiguousarray(values[:, sector])
            push_samples(level._replace(block=block), 0, len(block))
        if sums is not None:
            sums.add(part, start, first + skip, values, skip)
        impacts += part.impact_count
        state = part.final_state
    results = [read_level(level, drive, interval) for level in levels]
    columns = (
        np.array([getattr(level, name) for level in results])
        for name in ("value", "time", "frequency_ratio", "max_tip")
    )
    return SectorResponse(
        SectorLevels(*columns), None if sums is None else sums.finish(drive), state, impacts
    )
