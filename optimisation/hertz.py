"""A first estimate of what an impact does where absorber and wall touch: contact time, peak force and pressure of two elastic bodies by Hertz.

Source: K. L. Johnson, Contact Mechanics, Cambridge 1985, section 11.4: a sphere that meets a half-space, quasi-static, with no loss. So contact times
are too short and forces too large where restitution is well below 1, and flat faces or yielding change both. SI units.
"""

from dataclasses import dataclass

import numpy as np

from impact_env.modes import ModalModel
from impact_env.parameters import ParameterError, non_negative, positive, require

# usual values: Young's modulus in Pa, Poisson's ratio
MATERIALS = {
    "steel": (210e9, 0.3),
    "aluminium": (70e9, 0.33),
    "brass": (100e9, 0.35),
    "titanium": (110e9, 0.34),
    "glass": (70e9, 0.22),
    "pom": (2.8e9, 0.37),
    "nylon": (2.5e9, 0.4),
}
ALLOWED = f"one of {', '.join(MATERIALS)}, or E:NU, Young's modulus in Pa above 0 and Poisson's ratio from 0 to 0.5"


@dataclass(frozen=True)
class Contact:
    """Contact ``time`` in s, peak ``force`` in N and ``pressure`` in Pa, and the ``mass`` in kg with which absorber and structure meet."""

    time: float
    force: float
    pressure: float
    mass: float


def material(name: str) -> tuple[float, float]:
    """Return Young's modulus in Pa and Poisson's ratio of a name of `MATERIALS` or of E:NU; raises ParameterError for all else."""
    if name in MATERIALS:
        return MATERIALS[name]
    try:
        young, poisson = map(float, name.split(":"))
    except ValueError as error:
        raise ParameterError(f"material = {name!r} is not allowed: {ALLOWED}") from error
    require(np.isfinite(young) and young > 0 and 0 <= poisson <= 0.5, "material", name, ALLOWED)
    return young, poisson


def estimate(first: str, second: str, radius: float, mass: float, speed: float) -> Contact:
    """Return the contact of two materials: ``radius`` in m of the rounder one, effective ``mass`` in kg and relative ``speed`` in m/s above 0."""
    softness = sum((1 - poisson**2) / young for young, poisson in map(material, (first, second)))
    radius, mass, speed, stiff = positive("radius", radius), positive("mass", mass), positive("speed", speed), 1 / softness
    depth = (15 * mass * speed**2 / (16 * np.sqrt(radius) * stiff)) ** 0.4
    force = 4 / 3 * stiff * np.sqrt(radius) * depth**1.5
    time = 2.87 * (mass**2 / (radius * stiff**2 * speed)) ** 0.2
    return Contact(float(time), float(force), float(3 * force / (2 * np.pi * radius * depth)), mass)


def meeting_mass(model: ModalModel, absorber_mass: float) -> float:
    """Return the mass in kg with which an absorber and the place of the structure meet, by the modes kept."""
    return 1 / (1 / positive("absorber mass", absorber_mass) + non_negative("mobility", float(np.sum(model.tip_shape**2))))


def reaches_beyond(model: ModalModel, contact: Contact) -> bool:
    """Return whether a pulse of this time has much force above the highest mode kept: at frequencies up to one over its time."""
    return bool(np.max(model.omega) / (2 * np.pi) < 1 / contact.time)
