"""Loads of the explorer: a swept force, unbalance or base motion, or a random force.

One table of them serves page, runs and files.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from impact_env.curve import Measure
from impact_env.drive import LEAST_DAMPING, Drive, Excitation, FrequencySchedule
from impact_env.ensemble import Lane
from impact_env.modes import ModalModel
from impact_env.plain import Plain
from impact_env.plain_loads import to_loads
from impact_env.results import Record
from impact_env.sweep import Stop, simulate
from optimisation.bounds import design_gap
from optimisation.measures import SAMPLES, START, read

LOADS = {
    "force": "swept force",
    "unbalance": "swept unbalance",
    "base": "swept base",
    "random": "random force",
}
BAND = (0.5, 1.5)  # of the resonance's frequency: where a random force has its flat spectrum
FULL = Record(events=True, series=True)
FINE = replace(FULL, samples_per_period=SAMPLES)


@dataclass(frozen=True, eq=False)
class Loading:
    """A load of a ``kind`` of `LOADS` near a ``resonance`` of a ``model``.

    Its intensity is in N, kg m, m/s^2, or N (RMS) for a random force.
    """

    kind: str
    model: ModalModel
    resonance: int

    @property
    def swept(self) -> bool:
        """Whether the frequency sweeps through the resonance, up and down."""
        return self.kind != "random"

    def file(self, intensity: float, schedule: FrequencySchedule) -> Plain:
        """Return the load in the form of `docs/loads.md`.

        A random force lasts as long as the ``schedule``.
        """
        sizes = {"force": "amplitude_n", "unbalance": "unbalance_kg_m", "base": "acceleration_m_s2"}
        if self.swept:
            own = {
                "times_s": schedule.times.tolist(),
                "omegas_rad_s": schedule.omegas.tolist(),
                "reference_rad_s": schedule.reference,
            }
            return {"load": {"kind": self.kind, sizes[self.kind]: intensity, "schedule": own}}
        low, high = (share * schedule.reference / (2 * np.pi) for share in BAND)
        density = intensity**2 / (high - low)
        spectrum = [[low, density], [high, density]]
        return {
            "load": {
                "kind": "random",
                "spectrum": spectrum,
                "duration_s": float(schedule.times[-1]),
                "seed": 0,
            }
        }

    def act(self, intensity: float, schedule: FrequencySchedule) -> Excitation:
        """Return the drive of a run."""
        return (
            Drive(intensity, schedule)
            if self.kind == "force"
            else to_loads(self.file(intensity, schedule), schedule.reference)
        )

    @property
    def measure(self) -> Measure | None:
        """Measure of a curve.

        It is the RMS after the start for a random force, and the response level (None) for other
        loads.
        """
        return None if self.swept else measure_rms

    @property
    def record(self) -> Record:
        """What is recorded of the run that is shown."""
        return FULL if self.swept else FINE

    @property
    def worth(self) -> float:
        """The harmonic force in N that moves the resonance's mode as one unit of a swept load does.

        It is infinite if no force does so.
        """
        k = self.resonance - 1
        omega = self.model.resonance_omega(self.resonance)
        if self.kind == "base":
            assert self.model.base_participation is not None
            return (
                float(
                    np.abs(self.model.base_participation[k] / self.model.one_phase_force_shape[k])
                )
                if self.model.one_phase_force_shape[k]
                else float("inf")
            )
        return omega**2 if self.kind == "unbalance" else 1.0

    def rule_gap(self, mass: float, intensity: float) -> float:
        """Return the gap in m from which a search would begin for an absorber of a ``mass`` in kg.

        For a swept load it is the design rule's gap for the equivalent force; for a random force it
        is `START` times the free motion's RMS of the resonance's mode, with a damping ratio of at
        least 1e-4.
        """
        if self.swept:
            return design_gap(self.model, mass, intensity * self.worth, self.resonance)
        k = self.resonance - 1
        omega = self.model.resonance_omega(self.resonance)
        damping = max(float(self.model.damping_ratio[k]), LEAST_DAMPING)
        shapes = self.model.one_phase_force_shape[k] * self.model.tip_shape[k]
        return float(START * intensity * np.abs(shapes) / omega**2 * np.sqrt(np.pi / (4 * damping)))

    def force_model(
        self, omega: NDArray[np.float64]
    ) -> tuple[ModalModel, NDArray[np.float64] | float]:
        """Return a model whose force is this load, and the force per unit of load.

        The force per unit is given at frequencies in rad/s. For a random force it is in N/sqrt(Hz).
        """
        if self.kind == "base":
            assert self.model.base_participation is not None
            return replace(self.model, force_shape=-self.model.base_participation), 1.0
        width = (BAND[1] - BAND[0]) * self.model.resonance_omega(self.resonance) / (2 * np.pi)
        return self.model, {"force": 1.0, "unbalance": omega**2, "random": 1 / np.sqrt(width)}[
            self.kind
        ]


def measure_rms(lane: Lane, stop: Stop) -> tuple[float, ...]:
    """Return the numbers of `LaneLevels` of a run, with the RMS after the start as its level."""
    response = simulate(lane.scene, lane.drive, initial=lane.start, record=FINE, stop=stop)
    return read(response), np.nan, np.nan, np.nan, float(response.impact_count), np.nan
