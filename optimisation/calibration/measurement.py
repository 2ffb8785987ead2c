"""Measurements: a TOML file that names and describes records or levels.

docs/calibrate.md describes its format.

A record is a force, or a base acceleration, and a response over the same time. A level table is the
response level at several force amplitudes, with repeats. A decay is a response alone, of a
structure that was struck or released.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import (
    ParameterError,
    finite,
    fraction,
    non_negative,
    numbers,
    one_of,
    positive,
    require,
)
from impact_env.loads import BASE_QUANTITY, QUANTITIES, Samples
from impact_env.plain_files import read_plain, require_keys
from impact_env.plain_loads import SAMPLE_KEYS, read_record_table

Array = NDArray[np.float64]
DISPLACEMENT = "displacement"
VELOCITY = "velocity"
ACCELERATION = "acceleration"
RESPONSE_QUANTITIES = (DISPLACEMENT, VELOCITY, ACCELERATION)
RESPONSE_UNITS = {DISPLACEMENT: "m", VELOCITY: "m/s", ACCELERATION: "m/s^2"}
MOVING = "moving"
STUCK = "stuck"
REMOVED = "removed"
ABSORBER_STATES = (MOVING, STUCK, REMOVED)  # of the absorber during a measurement
BASE_MOTION = "base"  # what a response is relative to
SPACE_MOTION = "space"
KINDS = ("record", "levels", "decay")
LEAST_SAMPLES = 64  # of a record
RESPONSE_KEYS = ("noise", "noise_share", "place", "direction", "relative_to")


@dataclass(frozen=True, eq=False)
class Sensor:
    """The sensor of a response.

    Attributes
    ----------
    quantity : str
        One of `RESPONSE_QUANTITIES`.
    noise : float
        Standard deviation of the sensor's white noise, in SI units.
    place : float, optional
        Position on a beam over its length; None: the structure's place of the response.
    direction : int
        1, or -1 for a sensor with the opposite direction.
    relative : bool
        Whether the response is relative to the base.
    limit : float, optional
        Absolute value at which the record is clipped; None: not clipped.
    """

    quantity: str
    noise: float = 0.0
    place: float | None = None
    direction: int = 1
    relative: bool = True
    limit: float | None = None


@dataclass(frozen=True, eq=False)
class RecordMeasurement:
    """A load and a response (K,) on one clock; the structure is at rest at the first sample."""

    name: str
    load: Samples
    response: Array
    sensor: Sensor
    absorber: str = MOVING

    @property
    def rate(self) -> float:
        """Sampling rate in Hz."""
        return 1 / float(self.load.times[1])


@dataclass(frozen=True, eq=False)
class LevelMeasurement:
    """Response levels (F, R) in m of R repeated sweeps at forces (F,) in N.

    Each sweep lasts ``duration`` s between the frequencies ``start_hz`` and ``stop_hz`` in Hz.
    """

    name: str
    forces: Array
    levels: Array
    start_hz: float
    stop_hz: float
    duration: float
    sensor: Sensor
    absorber: str = MOVING


@dataclass(frozen=True, eq=False)
class DecayMeasurement:
    """A free response (K,) of the structure without a moving absorber, at a ``rate`` in Hz."""

    name: str
    response: Array
    rate: float
    sensor: Sensor
    absorber: str = REMOVED


Measurement = RecordMeasurement | LevelMeasurement | DecayMeasurement


def read_measurements(path: Path) -> tuple[Measurement, ...]:
    """Return the measurements of a file.

    Raises ParameterError with key, value and what is allowed for anything that does not fit.
    """
    return to_measurements(read_plain(path), path.parent)


def to_measurements(plain: Mapping[str, Any], folder: Path) -> tuple[Measurement, ...]:
    """Return the measurements of plain data, as `read_measurements` does.

    The names of files are relative to ``folder``.
    """
    require_keys("measurement file", plain, dict.fromkeys(("measurement",)), ("measurement",))
    tables = plain["measurement"]
    several = isinstance(tables, list | tuple)
    every = tables if several else [tables]
    require(len(every) > 0, "measurement", tables, "one table or more")
    measurements = tuple(
        _read_measurement(f"measurement[{k}]" if several else "measurement", table, folder, k)
        for k, table in enumerate(every)
    )
    names = [one.name for one in measurements]
    require(len(set(names)) == len(names), "measurement names", names, "another name for each")
    return measurements


def _read_measurement(path: str, plain: Any, folder: Path, index: int) -> Measurement:
    require(isinstance(plain, Mapping), path, plain, "a table")
    kind = one_of(f"{path}.kind", plain.get("kind", KINDS[0]), KINDS)
    rest = {key: value for key, value in plain.items() if key != "kind"}
    name = str(rest.pop("name", f"{kind} {index + 1}"))
    usual = REMOVED if kind == "decay" else MOVING
    absorber = one_of(f"{path}.absorber", rest.pop("absorber", usual), ABSORBER_STATES)
    if kind == "levels":
        return _read_levels(path, rest, name, absorber)
    if kind == "decay":
        return _read_decay(path, rest, folder, name, absorber)
    return _read_pair(path, rest, folder, name, absorber)


def _read_sensor(
    path: str, plain: Mapping[str, Any], moves_base: bool, response: Array | None
) -> Sensor:
    """Return the sensor that a response's table describes.

    A ``noise_share`` is a share of the response's root mean square.
    """
    usual = None if response is not None else DISPLACEMENT
    quantity = one_of(f"{path}.quantity", plain.get("quantity", usual), RESPONSE_QUANTITIES)
    place = plain.get("place")
    direction = finite(f"{path}.direction", plain.get("direction", 1))
    require(direction in (-1, 1), f"{path}.direction", direction, "1 or -1")
    relative_to = plain.get("relative_to")
    if relative_to is None:
        relative_to = SPACE_MOTION if quantity == ACCELERATION else BASE_MOTION
    relative_to = one_of(f"{path}.relative_to", relative_to, (BASE_MOTION, SPACE_MOTION))
    in_space = moves_base and relative_to == SPACE_MOTION
    require(
        not in_space or quantity == ACCELERATION,
        f"{path}.relative_to",
        relative_to,
        (
            f"{BASE_MOTION!r}, unless an acceleration is measured: the integrated motion of a "
            "base drifts"
        ),
    )
    noise = non_negative(f"{path}.noise", plain.get("noise", 0.0))
    if response is not None:
        most = float(np.std(response))
        allowed = (
            f"less than the response's standard deviation, {most:.4g} {RESPONSE_UNITS[quantity]}"
        )
        require(noise < most, f"{path}.noise", noise, allowed)
    if "noise_share" in plain:
        require("noise" not in plain, f"{path}.noise", noise, "left out beside noise_share")
        share = non_negative(f"{path}.noise_share", plain["noise_share"], most=1.0)
        noise = share * (1.0 if response is None else float(np.std(response)))
    limit = None
    if plain.get("allow_clipping", False) and response is not None:
        limit = float(np.max(np.abs(response)))
    return Sensor(
        quantity,
        noise,
        None if place is None else fraction(f"{path}.place", place),
        int(direction),
        not in_space,
        limit,
    )


def _read_response(
    path: str, plain: Any, folder: Path, moves_base: bool
) -> tuple[Array, Array, Sensor]:
    """Return times (K,) in s and values (K,) in SI units of a response, and its sensor."""
    allowed = f"a table with quantity ({', '.join(RESPONSE_QUANTITIES)}) and file"
    require(isinstance(plain, Mapping), path, plain, allowed)
    require_keys(
        path, plain, dict.fromkeys((*SAMPLE_KEYS, "quantity", *RESPONSE_KEYS)), ("file", "quantity")
    )
    quantity = one_of(f"{path}.quantity", plain["quantity"], RESPONSE_QUANTITIES)
    record = {key: value for key, value in plain.items() if key in SAMPLE_KEYS}
    times, values = read_record_table(path, record, quantity, folder)
    require(
        len(values) >= LEAST_SAMPLES,
        f"{path}: samples",
        len(values),
        f"{LEAST_SAMPLES} or more",
    )
    require(float(np.std(values)) > 0, f"{path}: values", 0.0, "a response that moves")
    sensor = _read_sensor(path, plain, moves_base, values)
    return times, sensor.direction * values, sensor


def _read_pair(
    path: str, plain: Mapping[str, Any], folder: Path, name: str, absorber: str
) -> RecordMeasurement:
    """Return a load and a response on one clock."""
    require_keys(path, plain, dict.fromkeys(("load", "response")), ("load", "response"))
    load_table = plain["load"]
    allowed = f"a table with quantity ({', '.join(QUANTITIES)}) and file"
    require(isinstance(load_table, Mapping), f"{path}.load", load_table, allowed)
    quantity = one_of(
        f"{path}.load.quantity", load_table.get("quantity", QUANTITIES[0]), QUANTITIES
    )
    record = {key: value for key, value in load_table.items() if key != "quantity"}
    times, values = read_record_table(f"{path}.load", record, quantity, folder)
    response_times, response, sensor = _read_response(
        f"{path}.response", plain["response"], folder, quantity == BASE_QUANTITY
    )
    require_one_clock(path, times, response_times)
    require(float(np.std(values)) > 0, f"{path}.load: values", 0.0, "a load that is not constant")
    return RecordMeasurement(name, Samples(times, values, quantity), response, sensor, absorber)


def require_one_clock(path: str, load_times: Array, response_times: Array) -> None:
    """Raise ParameterError unless load and response have the same number of samples and rate."""
    own = 1 / float(load_times[1])
    other = 1 / float(response_times[1])
    drift = abs(other / own - 1) * len(load_times)  # samples, over the whole record
    require(
        drift < 0.5,
        f"{path}.response: sampling rate",
        f"{other:.6g} Hz",
        f"{own:.6g} Hz, as the load has: records of one clock",
    )
    require(
        len(response_times) == len(load_times),
        f"{path}.response: samples",
        len(response_times),
        f"{len(load_times)}, as many as the load has: cut both to one start and one end",
    )


def _read_levels(path: str, plain: Mapping[str, Any], name: str, absorber: str) -> LevelMeasurement:
    """Return levels over force."""
    keys = ("forces_n", "levels_m", "from_hz", "to_hz", "duration_s", "place", "noise_share")
    needed = keys[:5]
    require_keys(path, plain, dict.fromkeys(keys), needed)
    forces = numbers(f"{path}.forces_n", plain["forces_n"], "forces in N above 0")
    require(
        forces.ndim == 1 and len(forces) > 0 and bool(np.all(forces > 0)),
        f"{path}.forces_n",
        plain["forces_n"],
        "a list of forces in N above 0",
    )
    allowed = f"{len(forces)} levels in m above 0, or for each force a list of repeats"
    levels = numbers(f"{path}.levels_m", plain["levels_m"], allowed)
    levels = levels[:, None] if levels.ndim == 1 else levels
    require(
        levels.ndim == 2 and len(levels) == len(forces) and bool(np.all(levels > 0)),
        f"{path}.levels_m",
        plain["levels_m"],
        allowed,
    )
    start = positive(f"{path}.from_hz", plain["from_hz"])
    stop = positive(f"{path}.to_hz", plain["to_hz"])
    duration = positive(f"{path}.duration_s", plain["duration_s"])
    share = non_negative(f"{path}.noise_share", plain.get("noise_share", 0.0), most=1.0)
    place = plain.get("place")
    sensor = Sensor(
        DISPLACEMENT, share, None if place is None else fraction(f"{path}.place", place)
    )
    return LevelMeasurement(name, forces, levels, start, stop, duration, sensor, absorber)


def _read_decay(
    path: str, plain: Mapping[str, Any], folder: Path, name: str, absorber: str
) -> DecayMeasurement:
    """Return a free decay."""
    require_keys(path, plain, dict.fromkeys(("response",)), ("response",))
    require(
        absorber != MOVING,
        f"{path}.absorber",
        absorber,
        (
            f"{REMOVED!r} or {STUCK!r}: a decay serves for frequencies and damping of the linear "
            "structure"
        ),
    )
    times, response, sensor = _read_response(f"{path}.response", plain["response"], folder, False)
    return DecayMeasurement(name, response, 1 / float(times[1]), sensor, absorber)


def require_moving(measurements: tuple[Measurement, ...]) -> None:
    """Raise ParameterError unless a record or levels were measured with the moving absorber."""
    if not any(one.absorber == MOVING for one in measurements):
        raise ParameterError(
            f"measurement.absorber = {measurements[0].absorber!r} is not allowed: "
            f"{MOVING!r} in one measurement or more, which the absorber's parameters follow from"
        )
