"""Consistent systems of units of finite element programs, whose files do not name them."""

from dataclasses import dataclass

from impact_env.checks import require


@dataclass(frozen=True)
class ConsistentUnits:
    """A consistent system of units in SI.

    Its ``mass`` is in kg, ``length`` in m and ``time`` in s. Its force is mass times length over
    time squared.
    """

    mass: float
    length: float
    time: float


INCH = 0.0254
FOOT = 0.3048
POUND_FORCE = 4.4482216152605  # N
# the units of force are N, N, kN, mN, kN, lbf and lbf
UNIT_SYSTEMS = {
    "kg, m, s": ConsistentUnits(1.0, 1.0, 1.0),
    "t, mm, s": ConsistentUnits(1e3, 1e-3, 1.0),
    "t, m, s": ConsistentUnits(1e3, 1.0, 1.0),
    "kg, mm, s": ConsistentUnits(1.0, 1e-3, 1.0),
    "kg, mm, ms": ConsistentUnits(1.0, 1e-3, 1e-3),
    "lbf s2/in, in, s": ConsistentUnits(POUND_FORCE / INCH, INCH, 1.0),
    "slug, ft, s": ConsistentUnits(POUND_FORCE / FOOT, FOOT, 1.0),
}


def read_units(name: str) -> ConsistentUnits:
    """Return a system of units by its name; raise ParameterError for an unknown name."""
    known = ", ".join(repr(key) for key in UNIT_SYSTEMS)
    require(name in UNIT_SYSTEMS, "units", name, f"one of {known}, those of the file")
    return UNIT_SYSTEMS[name]
