"""First estimate of an impact's contact time, peak force and pressure.

Absorber and wall are two elastic bodies by Hertz' theory.

Source: K. L. Johnson, Contact Mechanics, Cambridge 1985, section 11.4: a sphere that meets a
half-space, quasi-static, with no loss. So contact times are too short and forces too large where
restitution is well below 1, and flat faces or yielding change both. SI units.
"""

from dataclasses import dataclass

import numpy as np

from impact_env.checks import ParameterError, instance, non_negative, positive, require, text
from impact_env.modes import ModalModel

MaterialPair = tuple[str, str, float]  # two materials, and the radius in m of the rounder body
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
ALLOWED = (
    f"one of {', '.join(MATERIALS)}, or E:NU, Young's modulus in Pa above 0 and Poisson's ratio "
    "from 0 to 0.5"
)


@dataclass(frozen=True)
class Contact:
    """Estimate of the contact in an impact.

    ``time``: contact time in s. ``force``: peak force in N. ``pressure``: peak pressure in Pa.
    ``mass``: effective mass in kg of absorber and structure.
    """

    time: float
    force: float
    pressure: float
    mass: float


def material(name: str) -> tuple[float, float]:
    """Return Young's modulus in Pa and Poisson's ratio of a material.

    The name is one of `MATERIALS` or E:NU. Raises ParameterError for any other name.
    """
    name = text("material", name)
    if name in MATERIALS:
        return MATERIALS[name]
    try:
        young, poisson = map(float, name.split(":"))
    except ValueError as error:
        raise ParameterError(f"material = {name!r} is not allowed: {ALLOWED}") from error
    require(np.isfinite(young) and young > 0 and 0 <= poisson <= 0.5, "material", name, ALLOWED)
    return young, poisson


def estimate(first: str, second: str, radius: float, mass: float, speed: float) -> Contact:
    """Return the contact of two materials by Hertz' theory.

    ``radius`` of the rounder body in m, effective ``mass`` in kg, and relative ``speed`` in m/s,
    above 0.
    """
    softness = sum((1 - poisson**2) / young for young, poisson in map(material, (first, second)))
    radius = positive("radius", radius)
    mass = positive("mass", mass)
    speed = positive("speed", speed)
    stiff = 1 / softness
    depth = (15 * mass * speed**2 / (16 * np.sqrt(radius) * stiff)) ** 0.4
    force = 4 / 3 * stiff * np.sqrt(radius) * depth**1.5
    time = 2.87 * (mass**2 / (radius * stiff**2 * speed)) ** 0.2
    return Contact(float(time), float(force), float(3 * force / (2 * np.pi * radius * depth)), mass)


# times the yield stress: the peak pressure at which yield begins below the surface (Johnson 1985)
YIELD_PRESSURE = 1.6


def speed_for_pressure(
    first: str, second: str, radius: float, mass: float, pressure: float
) -> float:
    """Return the relative speed in m/s at which `estimate` gives a peak ``pressure`` in Pa.

    The pressure is proportional to the speed to the power of 2/5.
    """
    one = estimate(first, second, radius, mass, 1.0)
    return (positive("pressure", pressure) / one.pressure) ** 2.5


def meeting_mass(model: ModalModel, absorber_mass: float) -> float:
    """Return the effective mass in kg of absorber and structure in an impact.

    The structure counts with the modes that the model has.
    """
    model = instance("model", model, ModalModel)
    return 1 / (
        1 / positive("absorber mass", absorber_mass)
        + non_negative("mobility", float(np.sum(model.tip_shape**2)))
    )


@dataclass(frozen=True)
class YieldLimit:
    """A limit on impacts: yield must not begin below the surface where two materials touch.

    ``materials`` as in `material`; ``radius`` in m of the rounder one; ``yield_stress`` in Pa of
    the softer one, whose peak pressure stays below `YIELD_PRESSURE` times it.
    """

    materials: tuple[str, str]
    radius: float
    yield_stress: float

    def __post_init__(self) -> None:
        for name in self.materials:
            material(name)
        for name, label in (
            ("radius", "radius of --contact in m"),
            ("yield_stress", "constraint yield_stress"),
        ):
            object.__setattr__(self, name, positive(label, getattr(self, name)))

    def speed(self, model: ModalModel, absorber_mass: float) -> float:
        """Return the impact speed in m/s at which yield begins.

        It is that of an absorber of a mass in kg at the absorber's place of a model.
        """
        mass = meeting_mass(model, absorber_mass)
        pressure = YIELD_PRESSURE * self.yield_stress
        return speed_for_pressure(*self.materials, self.radius, mass, pressure)


def reaches_beyond(model: ModalModel, contact: Contact) -> bool:
    """Return whether a contact pulse has much force above the model's highest mode.

    A pulse has much force at frequencies up to one over its contact time.
    """
    return bool(np.max(model.omega) / (2 * np.pi) < 1 / contact.time)


def check_contact(
    contact: MaterialPair, radius_name: str = "radius of contact in m"
) -> MaterialPair:
    """Return two materials and a radius in m.

    Raises ParameterError for an unknown material, or for a radius that is not positive.
    """
    first, second, radius = contact
    for name in (first, second):
        material(name)
    return first, second, positive(radius_name, radius)
