"""Units of time, acceleration and force as files write them, and the factor of each to SI units."""

import math
import re
import unicodedata
from dataclasses import dataclass

from impact_env.checks import ParameterError

STANDARD_GRAVITY = 9.80665  # m/s^2
POUND_FORCE = 4.4482216152605  # N
TIME_DIMENSION = "time"
ACCELERATION_DIMENSION = "acceleration"
FORCE_DIMENSION = "force"
LENGTH_DIMENSION = "length"
VELOCITY_DIMENSION = "velocity"
OTHER_DIMENSION = "other"  # a unit that is known, of a quantity that no record here may have
EXAMPLES = {
    TIME_DIMENSION: "s, ms, us, min, h",
    ACCELERATION_DIMENSION: "m/s^2, mm/s^2, cm/s^2, g",
    FORCE_DIMENSION: "N, mN, kN, lbf, kgf",
    LENGTH_DIMENSION: "m, mm, um, in",
    VELOCITY_DIMENSION: "m/s, mm/s, cm/s, in/s",
}
AGREEMENT_TOL = 1e-6  # of a factor: units written in two places of a file are one unit


@dataclass(frozen=True)
class Unit:
    """A unit of a record.

    ``name`` is as written, ``dimension`` is that of time, acceleration or force, and ``factor`` is
    the factor to s, m/s^2 or N.
    """

    name: str
    dimension: str
    factor: float

    def is_same_as(self, other: "Unit") -> bool:
        """Return whether two units have the same dimension and factor."""
        same = math.isclose(self.factor, other.factor, rel_tol=AGREEMENT_TOL)
        return self.dimension == other.dimension and same


LENGTH_UNITS = {
    "mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254, "inch": 0.0254, "ft": 0.3048,
    "um": 1e-6, "nm": 1e-9, "km": 1e3,
}  # fmt: skip
TIME_UNITS = {
    "s": 1.0, "sec": 1.0, "secs": 1.0, "second": 1.0, "seconds": 1.0,
    "ms": 1e-3, "msec": 1e-3, "millisecond": 1e-3, "milliseconds": 1e-3,
    "us": 1e-6, "usec": 1e-6, "microsecond": 1e-6, "microseconds": 1e-6,
    "ns": 1e-9, "nsec": 1e-9, "nanosecond": 1e-9, "nanoseconds": 1e-9,
    "min": 60.0, "minute": 60.0, "minutes": 60.0,
    "h": 3600.0, "hr": 3600.0, "hour": 3600.0, "hours": 3600.0,
}  # fmt: skip
ACCELERATION_UNITS = {
    "g": STANDARD_GRAVITY, "gn": STANDARD_GRAVITY, "g0": STANDARD_GRAVITY,
    "mg": 1e-3 * STANDARD_GRAVITY, "ug": 1e-6 * STANDARD_GRAVITY,
    "gal": 1e-2, "mgal": 1e-5,
}  # fmt: skip
FORCE_UNITS = {
    "N": 1.0, "uN": 1e-6, "mN": 1e-3, "cN": 1e-2, "daN": 10.0, "kN": 1e3, "MN": 1e6,
    "newton": 1.0, "newtons": 1.0,
    "lbf": POUND_FORCE, "klbf": 1e3 * POUND_FORCE, "kip": 1e3 * POUND_FORCE,
    "ozf": POUND_FORCE / 16, "pdl": POUND_FORCE * 0.3048 / STANDARD_GRAVITY, "dyn": 1e-5,
    "kgf": STANDARD_GRAVITY, "kp": STANDARD_GRAVITY, "gf": 1e-3 * STANDARD_GRAVITY,
}  # fmt: skip
VELOCITY_UNITS = {
    "m/s": 1.0, "mm/s": 1e-3, "cm/s": 1e-2, "um/s": 1e-6,
    "in/s": 0.0254, "ft/s": 0.3048, "km/h": 1 / 3.6,
}  # fmt: skip
MOTION_UNITS = (  # an exact name, or any letters from two on: M is no metre
    (
        LENGTH_DIMENSION,
        {name: LENGTH_UNITS[name] for name in ("m", "mm", "cm", "um", "nm", "in", "inch", "ft")},
    ),
    (LENGTH_DIMENSION, {"mil": 2.54e-5}),
    (VELOCITY_DIMENSION, VELOCITY_UNITS),
)  # fmt: skip
OTHER_UNITS = (
    "Hz", "kHz", "MHz", "rpm", "rad/s", "rad", "deg", "°", "%", "V", "mV", "uV", "kV", "A",
    "mA", "C", "pC", "Pa", "kPa", "MPa", "GPa", "bar", "psi", "Nm", "N*m", "ue", "strain", "dB",
    "K", "°C", "rad/s2", "m/s3", "N/m", "kg", "lb", "lbs", "W", "J", "Ohm", "T", "(m/s2)2/Hz",
    "g2/Hz", "N2/Hz", "m2/s4/Hz", "counts", "lsb",
)  # fmt: skip
LENGTH_OVER_TIME_SQUARED = re.compile(
    r"(mm|cm|um|nm|km|m|inch|in|ft)"
    r"(?:/\(?s(?:ec)?2\)?|/s(?:ec)?/s(?:ec)?|[.*/]?s(?:ec)?-2|ps2)",
    re.IGNORECASE,
)
PER_PATTERN = re.compile(r"[\s_]+per[\s_]+", re.IGNORECASE)
MULTIPLE_PATTERN = re.compile(r"(\d+\.?\d*(?:[eE][+-]?\d+)?)([a-zA-Z].*)")  # as in 0.1 g


def _plain_text(text: str) -> str:
    """Return a unit's text in a common form.

    Superscripts become digits, the sign of micro becomes u and "per" becomes a slash; spaces and
    signs of powers are left out.
    """
    result = (
        unicodedata.normalize("NFKC", PER_PATTERN.sub("/", text.strip()))
        .replace("\u03bc", "u")
        .replace("\u2212", "-")
    )
    result = result.replace("**", "").replace("^", "").replace("·", "*").replace("⋅", "*")
    return "".join(result.split()).replace("_", "/")


def _in_table(table: dict[str, float], text: str) -> float | None:
    """Return a unit's factor by its exact name, or by its name without regard to case.

    Without regard to case the name must belong to one unit only.
    """
    if text in table:
        return table[text]
    alike = [factor for name, factor in table.items() if name.casefold() == text.casefold()]
    return alike[0] if len(alike) == 1 else None


def find_unit(text: str) -> Unit | None:
    """Return the unit that a text denotes, None for an unknown one."""
    plain = _plain_text(text)
    for dimension, table in (
        (TIME_DIMENSION, TIME_UNITS),
        (ACCELERATION_DIMENSION, ACCELERATION_UNITS),
        (FORCE_DIMENSION, FORCE_UNITS),
    ):
        factor = _in_table(table, plain)
        if factor is not None:
            return Unit(text.strip(), dimension, factor)
    known = LENGTH_OVER_TIME_SQUARED.fullmatch(plain)
    if known is not None:
        return Unit(text.strip(), ACCELERATION_DIMENSION, LENGTH_UNITS[known[1].lower()])
    multiple = MULTIPLE_PATTERN.fullmatch(plain)
    if multiple is not None and float(multiple[1]) > 0:
        unit = find_unit(multiple[2])
        return unit and Unit(text.strip(), unit.dimension, float(multiple[1]) * unit.factor)
    for dimension, table in MOTION_UNITS:
        factor = _in_table(table, plain) if len(plain) > 1 else table.get(plain)
        if factor is not None:
            return Unit(text.strip(), dimension, factor)
    if plain in OTHER_UNITS or plain.casefold() in {
        name.casefold() for name in OTHER_UNITS if len(name) > 1
    }:
        return Unit(text.strip(), OTHER_DIMENSION, math.nan)
    return None


def name_unit(dimension: str, factor: float) -> Unit:
    """Return a unit of acceleration or force with a factor to SI, among those of `find_unit`."""
    base = "m/s^2" if dimension == ACCELERATION_DIMENSION else "N"
    names = (
        [f"{length}/s^2" for length in LENGTH_UNITS]
        if dimension == ACCELERATION_DIMENSION
        else list(FORCE_UNITS)
    )
    for name in (base, *names):
        unit = find_unit(name)
        if unit is not None and math.isclose(unit.factor, factor, rel_tol=AGREEMENT_TOL):
            return Unit(name, dimension, factor)
    return Unit(f"{factor!r} {base}", dimension, factor)


def require_unit(name: str, text: object, dimension: str) -> Unit:
    """Return the unit of a dimension that a text denotes.

    Raise ParameterError for any other text.
    """
    result = find_unit(text) if isinstance(text, str) else None
    if result is None or result.dimension != dimension:
        allowed = f"a unit of {dimension}, as {EXAMPLES[dimension]}"
        raise ParameterError(f"{name} = {text!r} is not allowed: {allowed}")
    return result


def require_density_unit(name: str, text: object, dimension: str) -> float:
    """Return the factor from a unit of a spectral density, such as g^2/Hz, to SI units.

    The SI unit is (m/s^2)^2/Hz or N^2/Hz. Raises ParameterError for any other unit.
    """
    plain = _plain_text(text) if isinstance(text, str) else ""
    squared = DENSITY_PATTERN.fullmatch(plain)
    unit = None if squared is None else find_unit(squared[1] or squared[2])
    if unit is None or unit.dimension != dimension:
        allowed = "N^2/Hz" if dimension == FORCE_DIMENSION else "(m/s^2)^2/Hz or g^2/Hz"
        raise ParameterError(f"{name} = {text!r} is not allowed: a unit of density, as {allowed}")
    return unit.factor**2


DENSITY_PATTERN = re.compile(
    r"(?:\(([^()]+)\)|([a-zA-Z]+))2/Hz", re.IGNORECASE
)  # powers without their sign
SEPARATOR = re.compile(r"[\s_,;:/|-]+")
CLOSING = {"(": ")", "[": "]", "{": "}", "<": ">"}
PREFIX = re.compile(  # of a unit, in a word of its own
    r"(?<![a-z])(?:nano|micro|milli|centi|deca|kilo|mega)$", re.IGNORECASE
)
# T is a time, and A and C are channels, not tesla, ampere and coulomb
CHANNEL = re.compile(r"T|(?:ch|chan|channel|kanal)[\s_.:-]*[AC]", re.IGNORECASE)
POWERS = "^*/²0123456789"  # after a bracket: it is a part of a unit
MOST_WORDS = 3  # of a unit whose parts are separated, as m_s2
LOADS = (TIME_DIMENSION, ACCELERATION_DIMENSION, FORCE_DIMENSION)


@dataclass(frozen=True)
class Label:
    """The label of a column.

    ``text`` is the whole label, ``name`` the label without its unit, ``unit`` the unit (None: none)
    and ``brackets`` the text in its brackets (None: no brackets).
    """

    text: str
    name: str
    unit: Unit | None
    brackets: str | None = None


def _bracketed(label: str) -> list[str]:
    """Return the texts in the outer brackets of a label.

    If the brackets are a part of a unit, the whole label is returned.
    """
    result = []
    expected: list[str] = []
    start = 0
    for k, letter in enumerate(label):
        if letter in CLOSING:
            start = start if expected else k + 1
            expected.append(CLOSING[letter])
        elif expected and letter == expected[-1]:
            expected.pop()
            if not expected:
                is_part = label[k + 1 : k + 2] in tuple(POWERS)
                result.append(label if is_part else label[start:k].strip())
    return result if not expected else [label]


def _unit_between(label: str) -> str | None:
    """Return a unit of loads that is followed by other words in a label, or None."""
    words = [word for word in SEPARATOR.split(label) if word]
    for first in range(len(words)):
        for last in range(min(first + MOST_WORDS, len(words) - 1), first, -1):
            result = find_unit("_".join(words[first:last]))
            if result is not None and result.dimension in LOADS:
                return result.name
    return None


CLOCK_NAMES = re.compile(
    r"t|time.*|zeit.*|temps|timestamp.*|elapsed.*|.*time|.*zeit", re.IGNORECASE
)
LOAD_NAMES = re.compile(r"(acc|beschl|force|kraft|load)", re.IGNORECASE)


def read_label(text: str) -> Label:
    """Return a column's label with its name and unit.

    ``acc (g)``, ``time [ms]``, ``force_kN``, ``a / m/s^2``, ``Time ms`` and ``g`` alone have units.

    A unit that stands elsewhere, or is not known, is in ``brackets``.

    >>> read_label("time (ms)").unit.factor
    0.001
    """
    label = text.strip()
    inside = _bracketed(label)
    if inside:
        units = [unit for unit in map(find_unit, inside) if unit is not None]
        name = re.split(r"[(\[{<]", label)[0].strip(" _/") or label
        if len(units) == 1:
            return Label(label, name, units[0], units[0].name)
        return Label(label, name, None, " and ".join(inside))
    if CHANNEL.fullmatch(label):
        return Label(label, label, None)
    alone = find_unit(label)
    if alone is not None:
        return Label(label, label, alone)
    for separator in SEPARATOR.finditer(label):  # the longest tail first: m/s^2 before s^2
        tail = label[separator.end() :].strip()
        if not tail or separator.start() == 0:
            continue
        before = label[: separator.start()]
        unit = find_unit(tail)
        if unit is not None and unit.dimension == TIME_DIMENSION:
            # acc_h is a horizontal acceleration, acc_min a smallest one
            is_clock = CLOCK_NAMES.fullmatch(before.strip(" _")) is not None
            if LOAD_NAMES.match(before) or (tail.lower() in ("h", "min") and not is_clock):
                continue
        prefix = PREFIX.search(before)
        if unit is not None and prefix is not None:
            return Label(label, before, None, label[prefix.start() :])
        # a number is a factor after a slash, as in t / 0.1 ms; the 2 of "Ch 2 g" may be a channel's
        is_divided = "/" in separator[0] and not before[-1].isdigit()
        is_factor = is_divided or MULTIPLE_PATTERN.fullmatch(_plain_text(tail)) is None
        if unit is not None:
            return Label(label, before, unit if is_factor else None, None if is_factor else tail)
        # the name of two units if case is ignored: mn is millinewton and meganewton
        plain = _plain_text(tail)
        alike = [name for name in FORCE_UNITS if name.casefold() == plain.casefold()]
        if plain not in FORCE_UNITS and len(alike) > 1:
            return Label(label, before, None, tail)
    return Label(label, label, None, _unit_between(label))
