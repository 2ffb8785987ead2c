"""The time-stepping methods: Moreau's scheme for rigid contact, Runge-Kutta's for linear scenes and compliant contact."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from impact_env.families.exact import rigid_laws
from impact_env.families.family import Solver, build_schedule, load_law
from impact_env.kernels.control.interval import Batch
from impact_env.kernels.control.lanes import moreau_lanes, runge_kutta_lanes
from impact_env.kernels.control.work_queue import WorkQueue
from impact_env.kernels.motion.observers import Observers
from impact_env.kernels.stepping import feedback, moreau
from impact_env.kernels.stepping.feedback import CompliantLaws
from impact_env.kernels.stepping.grid import BeamModes, DriveForce, TimeStep
from impact_env.kernels.stepping.moreau import moreau_lane
from impact_env.kernels.stepping.moreau_law import RigidLaws, Spring
from impact_env.kernels.stepping.runge_kutta import runge_kutta_lane
from impact_env.loads import AnyDrive, Loads
from impact_env.methods import Moreau, RungeKutta
from impact_env.parameters import (
    NonlinearSink,
    SlidingAbsorber,
    StuckAbsorber,
    TunedAbsorber,
    require,
)
from impact_env.scene import Scene

Array = NDArray[np.float64]


def _writable(row: Array) -> Array:
    """Return a copy: kernels are compiled for writable arrays only, so that no second variant of them is built."""
    return np.array(row, dtype=np.float64, order="C")


def _modes(scene: Scene) -> BeamModes:
    model = scene.model
    return BeamModes(
        _writable(model.omega),
        _writable(model.damping_ratio),
        _writable(model.force_shape),
        _writable(model.tip_shape),
    )


def _force(scene: Scene, drive: AnyDrive) -> DriveForce:
    if isinstance(drive, Loads):
        taken = build_schedule(scene, drive, 1.0)
        return DriveForce(taken.times, taken.omegas, taken.phases, 1.0, 0.0, taken.load)
    schedule = drive.schedule
    phases = schedule.phase_at(schedule.times)
    return DriveForce(
        _writable(schedule.times),
        _writable(schedule.omegas),
        _writable(phases),
        drive.amplitude,
        drive.phase,
        None,
    )


def _spring(scene: Scene) -> Spring | None:
    return load_law(scene.absorber) if isinstance(scene.absorber, TunedAbsorber) else None


def _wide(lanes: int, stride: int) -> int | None:
    padded = 4 * -(-lanes // 4)
    return padded if padded > stride else None


def _moreau_laws(scene: Scene) -> tuple[RigidLaws, int | None]:
    """Return the absorber's laws and the padded width of the table; a stuck absorber is one whose friction has no limit."""
    walls = None
    limit = np.inf if isinstance(scene.absorber, StuckAbsorber) else None
    if isinstance(scene.absorber, SlidingAbsorber):
        walls, limit = rigid_laws(scene)
    return RigidLaws(scene.absorber_mass, walls, limit, _spring(scene)), _wide(
        scene.model.modes, moreau.STRIDE
    )


def _runge_kutta_laws(scene: Scene) -> tuple[CompliantLaws, int | None]:
    """Return the absorber's laws, one that is stuck as a mass added to the tip, and the padded width of the table."""
    absorber = scene.absorber
    mass = scene.absorber_mass
    stops = slider = None
    if isinstance(absorber, SlidingAbsorber):
        stops = load_law(absorber.walls)
        slider = load_law(absorber.friction)
    free_mass, added_mass = (None, mass) if isinstance(absorber, StuckAbsorber) else (mass, None)
    cubic = load_law(absorber) if isinstance(absorber, NonlinearSink) else None
    return CompliantLaws(free_mass, added_mass, stops, slider, _spring(scene), cubic), _wide(
        scene.model.modes + 1, feedback.STRIDE
    )


@dataclass(frozen=True)
class SteppingSolver(Solver):
    """A method with a fixed step; ``laws`` are those of the absorber as its kernels take them, and the padded width of the table."""

    def run(
        self,
        scene: Scene,
        drive: AnyDrive,
        method: Moreau | RungeKutta,
        state: Array,
        observe: Observers,
    ) -> int:
        """Integrate over the whole schedule, see `Family.run`."""
        laws, wide = self.laws(scene)
        return int(
            self.lane(
                _modes(scene),
                laws,
                _force(scene, drive),
                state,
                TimeStep(method.step(scene), wide),
                observe,
            )
        )

    def control(
        self, scene: Scene, method: Moreau | RungeKutta, pseudo_period: float, batch: Batch
    ) -> Callable[[WorkQueue, int, int], bool]:
        """Return the kernel that advances lanes, see `Family.control`."""
        assert self.lanes is not None
        laws, wide = self.laws(scene)
        # a state of steps does not hold the slider
        require(
            getattr(laws, "slider", None) is None,
            "method",
            method,
            "Exact for elastic friction that is controlled in intervals",
        )
        return partial(self.lanes, _modes(scene), laws, TimeStep(method.step(scene), wide), batch)


MOREAU_SOLVER = SteppingSolver("moreau", moreau_lane, moreau_lanes, _moreau_laws, searched=False)
RUNGE_KUTTA_SOLVER = SteppingSolver(
    "runge_kutta", runge_kutta_lane, runge_kutta_lanes, _runge_kutta_laws, searched=False
)
