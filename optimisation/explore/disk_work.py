"""Computations of the explorer for a bladed disk.

Levels are those of the worst sector, and the motion of all sectors is drawn.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from impact_env.curve import CurveCase, Measure, Pass
from impact_env.drive import FrequencySchedule, linear_sweep
from impact_env.ensemble import Lane
from impact_env.results import Response
from impact_env.scene import Scene
from impact_env.sectors import linear_sector_response, simulate_sectors
from impact_env.structures.cyclic import BladedDisk
from impact_env.sweep import Stop
from optimisation.comparison import force_grid
from optimisation.explore.control import ControlValues
from optimisation.explore.disk_controls import disk_of, find_disk_amplitude
from optimisation.explore.waiting import Kernels
from optimisation.explore.work import POINTS, Message, Work, round_values

FORCES = 12
CENTRE = 5.0  # of the gap: amplitude without absorber in the middle of the curve
WINDOWS = 300  # of the level over the frequency


@dataclass(frozen=True, eq=False)
class DiskCurveCase(CurveCase):
    """The sweeps of a disk.

    Their frequencies refer to a resonance of the tuned disk at ``reference_omega`` in rad/s.
    """

    reference_omega: float = 1.0

    def schedules(self) -> tuple[FrequencySchedule, FrequencySchedule]:
        """Return the sweeps up and down."""
        low, high = self.limits
        rate = self.percent_per_100_periods
        up = linear_sweep(self.reference_omega, low, high, rate)
        return up, linear_sweep(self.reference_omega, high, low, rate)


class DiskWork(Work):
    """One setting of a page on a bladed disk; see `Work`."""

    def __init__(self, values: ControlValues, disk: BladedDisk, kernels: Kernels) -> None:
        self.disk = disk_of(values, disk)
        super().__init__(values, disk, kernels)

    @cached_property
    def tuned_omega(self) -> float:
        """Circular frequency in rad/s of the resonance of the tuned disk."""
        return self.disk.tuned().model.resonance_omega(self.resonance)

    @property
    def reference_omega(self) -> float:
        """Circular frequency in rad/s to which frequencies refer: that of the tuned disk."""
        return self.tuned_omega

    def case(self) -> DiskCurveCase:
        """Return the curve's case."""
        return DiskCurveCase(
            self.scene,
            force_grid(self.middle(), self.forces),
            self.resonance,
            self.limits,
            load=self.loading.act,
            steady_start=True,
            reference_omega=self.reference_omega,
        )

    @property
    def measure(self) -> Measure:
        """The level of the worst sector."""
        return partial(measure_worst_sector, self.disk)

    @cached_property
    def free_scene(self) -> Scene:
        """The disk without absorbers."""
        return self.disk.with_absorbers(()).scene()

    @property
    def first_pass(self) -> Pass:
        """Few forces, at a faster rate."""
        return Pass(3, 5.0)

    @property
    def forces(self) -> int:
        """Number of forces of the curve."""
        return FORCES

    def middle(self) -> float:
        """Return the force in N in the middle of the curve."""
        gap = self.gap()
        if gap is None:
            return super().middle()
        return CENTRE * gap / find_disk_amplitude(self.disk)

    def rule(self, _intensity: float) -> float | None:
        """Return None: the design rule is that of one absorber."""
        return None

    def _cavity_numbers(self, _level: float) -> Message:
        gap = self.gap()
        return {} if gap is None else {"gap": gap, **self.impacts}

    def _quick_lines(self, case: CurveCase) -> Iterator[Message]:
        yield from self._line("none", self.free_scene, case)

    def _slow_lines(self, _case: CurveCase) -> Iterator[Message]:
        yield from ()

    def _sweep(self, response: Response) -> Message:
        return super()._sweep(response) | {"where": "sector 1"}

    def _shapes(self) -> Message:
        """Return the shapes of all sectors, and the absorbers' gaps."""
        sectors = list(self.disk.absorber_sectors or ())
        shapes = self.disk.response_shapes
        places = self.scene.absorber_shapes if self.disk.absorbers else shapes[:1]
        cavities = [self.scene.cavity(a) for a in range(len(places))] if self.disk.absorbers else []
        return {
            "ring": True,
            "sectors": sectors,
            "places": [1.0] * len(places),
            "place_shapes": round_values(places),
            "gaps": [None if walls is None else walls.gap for walls in cavities] or [None],
            "along": None,
            "shapes": round_values(shapes),
            "level_shape": round_values(self.model.level_shape),
        }

    def responses(self) -> Iterator[Message]:
        """Yield the worst sector's amplitude over the frequency without absorbers.

        Then the levels of the worst sector over the frequency are yielded.
        """
        ratios = np.linspace(*self.limits, POINTS)
        omega = self.reference_omega
        disk = self.disk
        linear = linear_sector_response(
            disk.with_absorbers(()).ring,
            ratios * omega,
            disk.engine_order,
            disk.direction,
            disk.modes,
        )
        worst = self.intensity * np.max(np.abs(linear), axis=-1)
        message: Message = {
            "type": "response",
            "force": self.intensity,
            "swept": True,
            "ratio": round_values(ratios),
            "without": round_values(worst),
            "branches": [],
            "complete": False,
        }
        yield dict(message)
        levels: Message = {}
        for name, scene in {"with": self.scene, "without": self.free_scene}.items():
            if name == "with" and not self.disk.absorbers:
                continue
            yield from self.ready(scene, self.loading.record, "response", self.stop)
            ratio, level = self.worst_levels(scene)
            levels |= {"ratio": round_values(ratio), name: round_values(level)}
        yield dict(message, levels=levels, complete=True)

    def worst_levels(self, scene: Scene) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the frequency over the resonance and the RMS in m of the worst sector.

        They are those of each window of the page's sweep.
        """
        self._go_on()
        schedule = self.case().schedules()[1 if self.values.direction == "down" else 0]
        lane = Lane(scene, self.loading.act(self.intensity, schedule), steady_start=True)
        run = simulate_sectors(
            self.disk.ring, scene, lane.drive, windows=WINDOWS, initial=lane.start, stop=self.stop
        )
        assert run.windows is not None
        order = np.argsort(run.windows.frequency_ratio)
        worst = np.max(run.windows.rms, axis=1)
        return run.windows.frequency_ratio[order], worst[order]


def measure_worst_sector(disk: BladedDisk, lane: Lane, stop: Stop) -> tuple[float, ...]:
    """Return the numbers of `LaneLevels` of a run, with the level of the worst sector."""
    run = simulate_sectors(disk.ring, lane.scene, lane.drive, initial=lane.start, stop=stop)
    worst = run.levels.worst_sector
    return (
        run.levels.worst,
        float(run.levels.time[worst]),
        float(run.levels.frequency_ratio[worst]),
        float(run.levels.largest[worst]),
        float(run.impact_count),
        np.nan,
    )
