"""Loads as plain data, and the records that they name.

They are the table `[load]`, or several tables `[[load]]`, of a TOML or JSON file. docs/loads.md
describes the format.

Names of other files are relative to the folder of the file. Anything that does not fit raises
ParameterError with key, value and what is allowed.
"""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import ParameterError, finite, flag, instance, one_of, positive, require
from impact_env.drive import LOAD_STARTS, Drive, Load, find_schedule
from impact_env.loads import (
    BASE_QUANTITY,
    FORCE_QUANTITY,
    MOST_RECORD_SAMPLES,
    QUANTITIES,
    Loads,
    Random,
    Samples,
    ShakenBase,
    Shock,
    Strike,
    Tone,
    Tones,
    Unbalance,
)
from impact_env.plain import SCHEDULE_CODEC
from impact_env.plain_files import (
    NUMBER_CODEC,
    ROW_CODEC,
    ROWS_CODEC,
    VALUE_CODEC,
    Codec,
    Keys,
    dataclass_codec,
    dataclass_keys,
    find_unreadable,
    list_codec,
    read_plain,
    require_keys,
)
from impact_env.records import RECORD_READERS, RecordOptions, read_record
from impact_env.records.reading import DIMENSIONS
from impact_env.records.units import (
    STANDARD_GRAVITY,
    TIME_DIMENSION,
    require_density_unit,
    require_unit,
)
from impact_env.scene import InitialState
from impact_env.structures.modal import TEXT_CODEC

Array = NDArray[np.float64]
MOST_RECORD_BYTES = 32 * MOST_RECORD_SAMPLES  # of a record's file


IN_G_CODEC = Codec(
    lambda path, plain: STANDARD_GRAVITY * finite(path, plain),
    lambda value: float(value) / STANDARD_GRAVITY,
)


def _amplitude(name: str, quantity: str, plain: object) -> Keys:
    """Return the key of an amplitude in N, in m/s^2 or in g; in g if the table ``plain`` has it."""
    if quantity == FORCE_QUANTITY:
        return {f"{name}_n": (name, NUMBER_CODEC)}
    if isinstance(plain, Mapping) and f"{name}_g" in plain:
        return {f"{name}_g": (name, IN_G_CODEC)}
    return {f"{name}_m_s2": (name, NUMBER_CODEC)}


def _tones(quantity: str, name: str, plain: object) -> Codec:
    """Return the codec of a list of tones, whose frequency or order is the field ``name``."""
    every = plain if isinstance(plain, list | tuple) else ()
    in_g = [tone for tone in every if isinstance(tone, Mapping) and "amplitude_g" in tone]
    other = "order" if name == "frequency" else "frequency"
    amplitude = _amplitude("amplitude", quantity, in_g[0] if in_g else None)
    keys = dataclass_keys(Tone, without=("amplitude", other))
    return list_codec(Tone, {**amplitude, **keys})


def _read_spectrum(path: str, plain: Mapping[str, Any], quantity: str) -> Codec:
    """Return the codec of a spectrum in the unit that a load's table gives.

    The default unit is N^2/Hz or (m/s^2)^2/Hz.
    """
    if "unit" not in plain:
        return ROWS_CODEC
    dimension = DIMENSIONS[quantity]
    factor = require_density_unit(f"{path}.unit", plain["unit"], dimension)

    def read(key: str, rows: Any) -> Any:
        return [
            [*row[:1], *(factor * value for value in row[1:])] for row in ROWS_CODEC.read(key, rows)
        ]

    return Codec(read, ROWS_CODEC.write)


def _read_place(path: str, plain: Any) -> str:
    """Return the name of a place of the structure's forces, which may be a number."""
    known = isinstance(plain, str | int | float | Mapping) and not isinstance(plain, bool)
    require(known, path, plain, "a place, as the scene's table force has it")
    return str(plain)


PLACE_CODEC = Codec(_read_place, str)


def _load_codec(kind: str, path: str, plain: Mapping[str, Any], quantity: str) -> Codec:
    """Return the codec of a load of any kind except samples.

    Some kinds have two forms, which differ in their keys.
    """
    if kind in ("force", "unbalance"):
        load: type[Load] = Drive if kind == "force" else Unbalance
        return dataclass_codec(
            load, dataclass_keys(load, schedule=SCHEDULE_CODEC, force_place=PLACE_CODEC)
        )
    if kind == "base":
        acceleration = _amplitude("acceleration", BASE_QUANTITY, plain)
        keys = dataclass_keys(ShakenBase, without=("acceleration",), schedule=SCHEDULE_CODEC)
        return dataclass_codec(ShakenBase, {**acceleration, **keys})
    if kind == "random":
        keys = dataclass_keys(
            Random,
            without=("quantity", "number", "factor"),
            spectrum=_read_spectrum(path, plain, quantity),
            force_place=PLACE_CODEC,
        )
        return dataclass_codec(partial(Random, quantity=quantity), keys)
    if kind == "tones":
        if "orders" in plain or "schedule" in plain:
            orders = _tones(quantity, "order", plain.get("orders"))
            more = dataclass_keys(
                Tones,
                without=("tones", "length", "quantity"),
                schedule=SCHEDULE_CODEC,
                force_place=PLACE_CODEC,
            )
            keys = {"orders": ("tones", orders), **more}
            require_keys(path, plain, keys, ("orders", "schedule"))
        else:
            keys = dataclass_keys(
                Tones,
                without=("schedule", "quantity"),
                tones=_tones(quantity, "frequency", plain.get("tones")),
                force_place=PLACE_CODEC,
            )
        return dataclass_codec(partial(Tones, quantity=quantity), keys)
    if "velocity_m_s" in plain:
        require(
            quantity == FORCE_QUANTITY,
            f"{path}.quantity",
            quantity,
            "left out beside velocity_m_s, which is relative to the base",
        )
        return dataclass_codec(Strike, dataclass_keys(Strike, place=TEXT_CODEC))
    keys = dataclass_keys(
        Shock, without=("peak", "quantity"), pulse=TEXT_CODEC, force_place=PLACE_CODEC
    )
    pulse: Keys = {"pulse": keys["pulse"], **_amplitude("peak", quantity, plain)}
    return dataclass_codec(partial(Shock, quantity=quantity), {**pulse, **keys})


ALLOWED_CHANNEL = "the number of a channel, from 1, or its name"


def _read_options(path: str, plain: Mapping[str, Any], quantity: str) -> RecordOptions:
    """Return the options of a load's table for reading its record."""
    numbers = {"scale": finite, "sample_rate_hz": positive}
    arguments: dict[str, Any] = {
        key: check(f"{path}.{key}", plain[key]) for key, check in numbers.items() if key in plain
    }
    arguments |= {
        key: flag(f"{path}.{key}", plain[key])
        for key in ("resample", "allow_clipping")
        if key in plain
    }
    arguments |= {
        key: require_unit(f"{path}.{key}", plain[key], dimension).name
        for key, dimension in (("unit", DIMENSIONS[quantity]), ("time_unit", TIME_DIMENSION))
        if key in plain
    }
    if "channel" in plain:
        channel = plain["channel"]
        ok = isinstance(channel, str | int) and not isinstance(channel, bool)
        require(ok, f"{path}.channel", channel, ALLOWED_CHANNEL)
        arguments["channel"] = channel
    arguments["sample_rate"] = arguments.pop("sample_rate_hz", None)
    return RecordOptions(quantity, **arguments)


SAMPLE_KEYS = (
    "file",
    "scale",
    "unit",
    "time_unit",
    "channel",
    "sample_rate_hz",
    "resample",
    "allow_clipping",
)


def read_record_table(
    path: str, plain: Mapping[str, Any], quantity: str, folder: Path
) -> tuple[Array, Array]:
    """Return times (K,) in s and values (K,) in SI units of the record of a table.

    The table has the keys `SAMPLE_KEYS`. ``path`` is its name in errors, ``quantity`` one of
    `impact_env.records.reading.DIMENSIONS`, and ``folder`` the folder to which the file's name is
    relative. Raises ParameterError for anything that does not fit.
    """
    require_keys(path, plain, dict.fromkeys(SAMPLE_KEYS), ("file",))
    file = folder / TEXT_CODEC.read(f"{path}.file", plain["file"])
    allowed = f"a name that ends in {', '.join(RECORD_READERS)}"
    require(file.suffix.lower() in RECORD_READERS, f"{path}.file", plain["file"], allowed)
    options = _read_options(path, plain, quantity)
    try:
        size = file.stat().st_size
        allowed = (
            f"at most {MOST_RECORD_BYTES / 2**20:.0f} MiB: cut the record, or take every second "
            "sample"
        )
        require(size <= MOST_RECORD_BYTES, f"{file.name}: bytes", size, allowed)
        return read_record(file, options)
    except ParameterError as error:
        if str(error).partition(" = ")[0] in SAMPLE_KEYS:
            raise ParameterError(f"{path}.{error}") from error
        raise error.at_key(path, {}) from error
    except (OSError, ValueError) as error:  # ValueError: a name with a byte of zero
        reason = find_unreadable(file) or getattr(error, "strerror", None) or error
        raise ParameterError(
            f"{path}.file = {plain['file']!r} is not allowed: a file that can be read: {reason}"
        ) from error


def _read_samples(path: str, plain: Mapping[str, Any], quantity: str, folder: Path) -> Samples:
    record = {key: value for key, value in plain.items() if key != "place"}
    times, values = read_record_table(path, record, quantity, folder)
    place = _read_place(f"{path}.place", plain["place"]) if "place" in plain else None
    try:
        return Samples(times, values, quantity, place)
    except ParameterError as error:
        raise error.at_key(path, {"force_place": "place"}) from error


def _read_single_load(path: str, plain: Any, folder: Path) -> Load:
    require(
        isinstance(plain, Mapping),
        path,
        plain,
        f"a table whose kind is one of {', '.join(LOAD_KINDS)}",
    )
    kind = one_of(f"{path}.kind", plain.get("kind"), LOAD_KINDS)
    rest = {key: value for key, value in plain.items() if key not in ("kind", "quantity")}
    if "quantity" in plain:
        require(
            kind not in ("force", "unbalance"),
            f"{path}.quantity",
            plain["quantity"],
            f"left out of a load of the kind {kind}",
        )
    quantity = one_of(
        f"{path}.quantity",
        plain.get("quantity", BASE_QUANTITY if kind == "base" else FORCE_QUANTITY),
        QUANTITIES,
    )
    require(
        kind != "base" or quantity == BASE_QUANTITY,
        f"{path}.quantity",
        quantity,
        f"{BASE_QUANTITY}, or left out, of a base",
    )
    if kind == "base":  # harmonic, or tones, samples, a spectrum or a pulse of its acceleration
        kind = next((other for key, other in OF_BASE.items() if key in rest), kind)
    if kind == "samples":
        return _read_samples(path, rest, quantity, folder)
    codec = _load_codec(kind, path, rest, quantity)
    if kind == "random":
        rest.pop("unit", None)
    return codec.read(path, rest)


LOAD_KINDS = ("force", "unbalance", "base", "tones", "samples", "random", "shock")
OF_BASE = {
    "tones": "tones",
    "orders": "tones",
    "spectrum": "random",
    "pulse": "shock",
    "file": "samples",
}  # by its keys, of which other kind it is
START_KEYS: Keys = {
    **dataclass_keys(InitialState, modal_displacement=ROW_CODEC, modal_velocity=ROW_CODEC),
    "absorber_displacement": ("absorber_displacement", VALUE_CODEC),  # as the class has them, too
    "absorber_velocity": ("absorber_velocity", VALUE_CODEC),
}


def to_loads(plain: Mapping[str, Any], reference: float, folder: Path | None = None) -> Loads:
    """Return the loads of a plain form, a table ``load`` or a list of them.

    The form may have a ``start``, one of `loads.LOAD_STARTS` or a state. ``reference`` is the
    frequency in rad/s of the pseudo period if no load has a schedule. Raises ParameterError for
    anything that does not fit.
    """
    folder = instance("folder", folder, Path | None)
    require_keys("load file", plain, dict.fromkeys(("load", "start")), ("load",))
    several = isinstance(plain["load"], list | tuple)
    every = plain["load"] if several else [plain["load"]]
    parts = tuple(
        _read_single_load(f"load[{i}]" if several else "load", one, folder or Path())
        for i, one in enumerate(every)
    )
    start = plain.get("start", LOAD_STARTS[0])
    if isinstance(start, Mapping):
        start = dataclass_codec(InitialState, START_KEYS).read("start", start)
    return Loads(parts, None if any(find_schedule(part) for part in parts) else reference, start)


def read_loads(path: Path, reference: float) -> Loads:
    """Return the loads of a file; ``reference`` and errors are as in `to_loads`."""
    return to_loads(read_plain(path), reference, path.parent)
