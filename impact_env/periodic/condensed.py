"""The beam seen from the joint: what force a relative displacement of the absorber asks for, harmonic by harmonic, whatever the number of modes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from impact_env.frequency import receptance, receptance_slope
from impact_env.modes import ModalModel
from impact_env.parameters import count, non_negative, positive
from impact_env.periodic.trigonometric import Real

Complex = NDArray[np.complex128]


class Dynamics(NamedTuple):
    """Of harmonics 0 to H, complex (H + 1,): force per relative displacement (N/m), force per newton of the drive, and both derivatives by omega."""

    stiffness: Complex
    drive: Complex
    stiffness_slope: Complex
    drive_slope: Complex


class Linear(Protocol):
    """What harmonic balance asks of a structure."""

    @property
    def harmonics(self) -> int:
        """H."""

    @property
    def multiple(self) -> int:
        """Periods of the drive in one of the response."""

    def dynamics(self, omega: float) -> Dynamics:
        """Return the dynamics at the drive's frequency in rad/s."""

    def tip(self, dynamic: Complex, force: float, omega: float) -> Complex:
        """Return the displacement (H + 1,) in m that is to be reported, from the force on the absorber (H + 1,) and the drive's force in N."""


@dataclass(frozen=True, eq=False)
class JointOfMass:
    """A mass in kg beside a beam's tip: r = absorber less tip. The force on the absorber is lambda = (r + G_tf f)/(G_a + G_tt).

    G_a = 1/(-m w^2 + i c w) with a damper c (N s/m) between absorber and ground; w are the multiples of omega/``multiple``. The mean of the force is
    zero: the absorber hangs on nothing else.
    """

    model: ModalModel
    mass: float
    harmonics: int = 20
    grounded_damper: float = 0.0
    multiple: int = 1

    def __post_init__(self) -> None:
        positive("mass", self.mass)
        count("harmonics", self.harmonics, 1)
        count("multiple", self.multiple, 1, self.harmonics)
        non_negative("grounded_damper", self.grounded_damper)

    def dynamics(self, omega: float) -> Dynamics:
        """See `Linear`; raises ParameterError where an undamped mode is met exactly."""
        share, tip = np.arange(1, self.harmonics + 1) / self.multiple, self.model.tip_shape
        w = share * omega
        own = -self.mass * w**2 + 1j * self.grounded_damper * w
        own_slope = (-2 * self.mass * w + 1j * self.grounded_damper) * share
        joint = 1 / own + receptance(self.model, w, tip, tip)
        joint_slope = -own_slope / own**2 + share * receptance_slope(self.model, w, tip, tip)
        stiffness, stiffness_slope = 1 / joint, -joint_slope / joint**2
        drive, drive_slope = np.zeros_like(stiffness), np.zeros_like(stiffness)
        k = self.multiple - 1
        moved = complex(receptance(self.model, omega, tip, self.model.force_shape))
        moved_slope = complex(receptance_slope(self.model, omega, tip, self.model.force_shape))
        drive[k], drive_slope[k] = stiffness[k] * moved, stiffness_slope[k] * moved + stiffness[k] * moved_slope
        return Dynamics(*(np.append(0.0, part) for part in (stiffness, drive, stiffness_slope, drive_slope)))

    def tip(self, dynamic: Complex, force: float, omega: float) -> Complex:
        """See `Linear`: the tip's displacement."""
        w, tip = np.arange(self.harmonics + 1) * omega / self.multiple, self.model.tip_shape
        moved = -receptance(self.model, w, tip, tip) * dynamic
        moved[self.multiple] += force * complex(receptance(self.model, omega, tip, self.model.force_shape))
        return np.asarray(moved)


def complexes(row: Real) -> Complex:
    """Return X (H + 1,) with row = Re sum X_k exp(i k angle)."""
    h = (len(row) - 1) // 2
    return np.append(row[:1], row[1 : h + 1] - 1j * row[h + 1 :])


def real_row(values: Complex) -> Real:
    """Return the polynomial (2H + 1,) of X (H + 1,): the inverse of `complexes`."""
    return np.concatenate([values[:1].real, values[1:].real, -values[1:].imag])
