"""What is read from a response under loads: one definition for each kind of load, smaller is better.

- level: loads with a schedule, which sweep. The paper's response level, as everywhere.
- rms: records, random loads and fixed tones. Root mean square of the displacement (relative to the base) where the level is read, after a start that
  is left out: `SETTLING` time constants 1/(D omega) of the first mode, at most half of the record.
- decay: shocks and strikes. The integral of the structure's energy from the end of the pulse on over its value there, in s: 1/(2 D omega) where it
  decays as exp(-2 D omega t).
"""

import hashlib
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from impact_env.energy import mechanical_energy
from impact_env.ensemble import Lane
from impact_env.loads import AnyDrive, Loads, Shock, Strike, schedule_in
from impact_env.modes import ModalModel
from impact_env.parameters import require
from impact_env.response import Record, Response
from impact_env.scene import Scene
from impact_env.sweep import simulate

LEVEL, RMS, DECAY = "level", "rms", "decay"
UNITS = {LEVEL: "m", RMS: "m", DECAY: "s"}
TOLD = {LEVEL: "response level", RMS: "RMS", DECAY: "decay time of the energy"}
SHOWN = {"m": (1e3, "mm"), "s": (1.0, "s")}  # factor and unit for people
SETTLING = 5.0
SAMPLES = 64  # a pseudo period
STRANGE = 1e6  # a gap over the free motion, or this over it
START = 1.5  # of the size of the free motion at the absorber: a gap where there is no rule


def measure_of(loads: Loads) -> str:
    """Return which measure belongs to loads."""
    if any(schedule_in(part) for part in loads.parts):
        return LEVEL
    return DECAY if any(isinstance(part, Shock | Strike) for part in loads.parts) else RMS


def _level(response: Response) -> float:
    assert response.level is not None
    return response.level.value


def settled_after(response: Response) -> float:
    """Return how long the start is that is left out, in s: none of sweeps and shocks."""
    drive, model = response.drive, response.scene.model
    if measure_of(drive) != RMS if isinstance(drive, Loads) else np.ptp(drive.schedule.omegas) > 0:
        return 0.0
    decay, half = float(model.damping_ratio[0] * model.omega[0]), float(drive.schedule.times[-1]) / 2
    return min(SETTLING / decay, half) if decay > 0 else half


def _rms(response: Response) -> float:
    history = response.history
    assert history is not None
    late = (history.modal_displacement @ response.scene.model.level_shape)[history.time >= settled_after(response)]
    return float(np.sqrt(np.mean(late**2)))


def after_pulse(response: Response) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the times (S,) in s from the end of the last pulse on, and the energy in J of each mode then, (S, N_m)."""
    history = response.history
    assert history is not None
    late = history.time >= max(part.width for part in response.drive.parts if isinstance(part, Shock | Strike))
    return history.time[late], mechanical_energy(response.scene, history).modal[late]


def _decay(response: Response) -> float:
    times, modal = after_pulse(response)
    energy = np.sum(modal, axis=1)
    return float(np.trapezoid(energy, times) / energy[0])


MEASURES: dict[str, tuple[Callable[[Response], float], Record]] = {
    LEVEL: (_level, Record()),
    RMS: (_rms, Record(level=False, series=True, samples_per_period=SAMPLES)),
    DECAY: (_decay, Record(level=False, series=True, samples_per_period=SAMPLES)),
}


def record_of(loads: Loads) -> Record:
    """Return what a run under loads must record for their measure."""
    return MEASURES[measure_of(loads)][1]


def read(response: Response) -> float:
    """Return the measure of a run's loads, of a harmonic force the response level."""
    return MEASURES[measure_of(response.drive) if isinstance(response.drive, Loads) else LEVEL][0](response)


def measured(lane: Lane) -> float:
    """Return the measure of a lane's loads."""
    return read(simulate(lane.scene, lane.drive, record=record_of(lane.drive)))


def fingerprint_of(loads: Loads) -> str:
    """Return what is the same for the same loads, and else differs."""
    strikes = [part for part in loads.parts if isinstance(part, Strike)]
    known = hashlib.sha256(f"{loads.reference!r} {loads.start!r} {strikes}".encode())
    for part in loads.on_one_clock():
        known.update(np.ascontiguousarray(part).tobytes())
    return known.hexdigest()


def free_size(lane: Lane) -> float:
    """Return what gaps are measured by (m): the root mean square of the motion of the absorber's place over the whole run.

    Of a shock, whose mean square depends on how long it is looked at, it is the largest displacement over the root of two.
    """
    found = simulate(lane.scene, lane.drive, record=MEASURES[RMS][1]).history
    assert found is not None
    motion = found.tip_displacement
    return float(np.max(np.abs(motion)) / np.sqrt(2) if measure_of(lane.drive) == DECAY else np.sqrt(np.mean(motion**2)))


def design_gap_for(model: ModalModel, loads: Loads) -> float:
    """Return the gap in m from which a search begins where there is no rule: `START` times `free_size` (0 where nothing moves)."""
    return START * free_size(Lane(Scene(model), loads))


def check_size(scene: Scene, drive: AnyDrive) -> None:
    """Raise ParameterError where loads move a place by so little, or so much, beside its absorber's gap that a unit must be wrong."""
    walls = scene.cavity(0)
    if not isinstance(drive, Loads) or walls is None or walls.gap == 0:
        return
    size = free_size(Lane(Scene(scene.model), drive))
    allowed = f"from {1 / STRANGE:g} to {STRANGE:g} times the free motion at the absorber, {size:.3g} m: look at the load's units and scale"
    require(size / STRANGE <= walls.gap <= size * STRANGE, "gap", walls.gap, allowed)
