"""Loads as plain data: `[load]`, or `[[load]]` several times, of a TOML or JSON file, and the records that they name. docs/loads.md has the form.

Names of other files are relative to the folder of the file. Everything that does not fit is a ParameterError with key, value and what is allowed.
"""

import csv
import math
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from impact_env.drive import Drive, FrequencySchedule
from impact_env.forms import NUMBER, ROW, ROWS, WHOLE, Keys, Sort, form, require_keys, tables
from impact_env.loads import (
    BASE,
    FORCE,
    MOST_SAMPLES,
    QUANTITIES,
    STARTS,
    Force,
    Load,
    Loads,
    Random,
    Samples,
    ShakenBase,
    Shock,
    Strike,
    Tone,
    Tones,
    Unbalance,
    schedule_in,
)
from impact_env.parameters import ParameterError, finite, instance, one_of, positive, require
from impact_env.plain import SCHEDULE
from impact_env.plain_files import read_plain
from impact_env.scene import InitialState
from impact_env.structures.modal import TEXT
from impact_env.structures.universal import read_record

Array = NDArray[np.float64]
MOST_BYTES = 32 * MOST_SAMPLES  # of a record's file
CLIPPED = 8  # samples in a row at a record's largest or smallest value: what a converter gives beyond its range
UNEVEN = 1e-3  # of the sampling interval: what written times are rounded to


def _tones(quantity: str, name: str, key: str) -> Sort:
    """Return the sort of a list of tones, whose frequency or order (``name``) is called ``key``."""
    amplitude = "amplitude_n" if quantity == FORCE else "amplitude_m_s2"
    return tables(
        Tone,
        {amplitude: ("amplitude", NUMBER), key: (name, NUMBER), "phase_rad": ("phase", NUMBER)},
    )


def _force(amplitude: float, schedule: FrequencySchedule, phase: float = 0.0) -> Force:
    return Force(Drive(amplitude, schedule, phase))


WITH_SCHEDULE: Keys = {"phase_rad": ("phase", NUMBER), "schedule": ("schedule", SCHEDULE)}
LENGTH: Keys = {"duration_s": ("length", NUMBER)}
SHAKEN: Keys = {
    "acceleration_m_s2": ("acceleration", NUMBER),
    "displacement_m": ("displacement", NUMBER),
    **WITH_SCHEDULE,
}


def _form_of(kind: str, path: str, plain: Mapping[str, Any], quantity: str) -> Sort:
    """Return the form of a load of any kind but samples; some kinds have two, which their keys tell apart."""
    if kind == "force":
        return form(_force, {"amplitude_n": ("amplitude", NUMBER), **WITH_SCHEDULE})
    if kind == "unbalance":
        return form(Unbalance, {"unbalance_kg_m": ("unbalance", NUMBER), **WITH_SCHEDULE})
    if kind == "base":
        return form(ShakenBase, SHAKEN)
    if kind == "random":
        return form(
            partial(Random, quantity=quantity),
            {"spectrum": ("spectrum", ROWS), **LENGTH, "seed": ("seed", WHOLE)},
        )
    if kind == "tones":
        keys: Keys = {"tones": ("tones", _tones(quantity, "frequency", "frequency_hz")), **LENGTH}
        if "orders" in plain or "schedule" in plain:
            keys = {
                "orders": ("tones", _tones(quantity, "order", "order")),
                "schedule": ("schedule", SCHEDULE),
            }
            require_keys(path, plain, keys, ("orders", "schedule"))
        return form(partial(Tones, quantity=quantity), keys)
    if "velocity_m_s" in plain:
        require(
            quantity == FORCE,
            f"{path}.quantity",
            quantity,
            "left out beside velocity_m_s, which is relative to the base",
        )
        return form(
            Strike, {"velocity_m_s": ("velocity", NUMBER), "place": ("place", TEXT), **LENGTH}
        )
    peak: Keys = {
        "pulse": ("pulse", TEXT),
        "peak_n" if quantity == FORCE else "peak_m_s2": ("peak", NUMBER),
    }
    return form(
        partial(Shock, quantity=quantity),
        {**peak, "pulse_s": ("width", NUMBER), "rise_s": ("rise", NUMBER), **LENGTH},
    )


SAMPLE_KEYS = ("file", "scale", "sample_rate_hz", "resample")


def _read_samples(path: str, plain: Mapping[str, Any], quantity: str, folder: Path) -> Samples:
    require_keys(path, plain, dict.fromkeys(SAMPLE_KEYS), ("file",))
    file = folder / TEXT.read(f"{path}.file", plain["file"])
    reader = RECORDS.get(file.suffix.lower())
    if reader is None:
        raise ParameterError(
            f"{path}.file = {plain['file']!r} is not allowed: a name that ends in {', '.join(RECORDS)}"
        )
    resample = instance(f"{path}.resample", plain.get("resample", False), bool)
    rate = (
        None
        if "sample_rate_hz" not in plain
        else positive(f"{path}.sample_rate_hz", plain["sample_rate_hz"])
    )
    allowed = f"given for {file.name}, in N or m/s^2 for full scale: a sound has no unit"
    require("scale" in plain or file.suffix.lower() != ".wav", f"{path}.scale", None, allowed)
    try:
        size = file.stat().st_size
        require(
            size <= MOST_BYTES,
            f"{file.name}: bytes",
            size,
            f"at most {MOST_BYTES / 2**20:.0f} MiB: cut the record, or take every second sample",
        )
        times, values = reader(file, rate)
        times, values = _evened(file, times, values, resample)
        _refuse_clipped(file, values)
        return Samples(times, finite("scale", plain.get("scale", 1.0)) * values, quantity)
    except OSError as error:
        raise ParameterError(
            f"{path}.file = {plain['file']!r} is not allowed: a file that can be read ({error.strerror or error})"
        ) from error
    except ParameterError as error:
        raise error.at_key(path, {}) from error


def _row(file: Path, sample: int) -> int:
    """Return the row, from 1, of a sample, from 0: a table has a header."""
    return sample + 1 + (file.suffix.lower() == ".csv")


def _evened(file: Path, times: Array, values: Array, resample: bool) -> tuple[Array, Array]:
    """Return a record from time 0 at even steps; one that is not even is refused unless it is to be resampled, by straight lines."""
    require(len(times) >= 2, f"{file.name}: rows", len(times), "two samples or more")
    times = times - times[0]
    steps = np.diff(times)
    step = float(np.median(steps))

    def place(sample: int) -> str:
        return f"{file.name}: time in row {_row(file, sample + 1)}"

    for k in np.flatnonzero(~(steps > 0))[:1]:
        require(False, place(k), float(times[k + 1]), "later than that in the row before")
    odd = np.flatnonzero(np.abs(steps - step) > UNEVEN * step)
    if len(odd) == 0:
        return np.asarray(float(times[-1]) / len(steps) * np.arange(len(times))), values
    if resample:
        even = np.linspace(0, float(times[-1]), 1 + round(float(times[-1]) / step))
        return even, np.asarray(np.interp(even, times, values))
    k = int(odd[0])
    allowed = f"steps of {step:g} s as elsewhere, not {steps[k]:g} s; resample = true takes straight lines between samples"
    raise ParameterError(f"{place(k)} = {times[k + 1]:g} is not allowed: {allowed}")


def _refuse_clipped(file: Path, values: Array) -> None:
    """Refuse a record that stays at its largest or smallest value: it was cut off."""
    for extreme in (float(np.max(values)), float(np.min(values))):
        at = np.flatnonzero(values == extreme)
        runs = np.split(at, np.flatnonzero(np.diff(at) > 1) + 1)
        longest = max(runs, key=len)
        if extreme != 0 and CLIPPED <= len(longest) < len(values):
            allowed = f"fewer than {CLIPPED} samples in a row at the record's limit: it is clipped from row {_row(file, int(longest[0]))} on"
            raise ParameterError(f"{file.name}: value = {extreme:g} is not allowed: {allowed}")


def _on_clock(file: Path, rate: float | None, values: Array) -> tuple[Array, Array]:
    """Return times and values of a record without times."""
    require(rate is not None, "sample_rate_hz", rate, f"given for {file.name}, which has no times")
    assert rate is not None
    return np.arange(len(values)) / rate, values


def _no_rate(file: Path, rate: float | None, has: str) -> None:
    require(rate is None, "sample_rate_hz", rate, f"left out for {file.name}, which has {has}")


def _checked(file: Path, values: Any) -> Array:
    array = np.asarray(values, dtype=np.float64)
    bad = np.argwhere(~np.isfinite(array))
    where = f"{file.name}: row {int(bad[0][0]) + 1}" if len(bad) else file.name
    require(
        len(bad) == 0,
        where,
        float(array[tuple(bad[0])]) if len(bad) else 0.0,
        "a finite number, no gap",
    )
    return array


def _read_csv(file: Path, rate: float | None) -> tuple[Array, Array]:
    """Return times and values of a table with a header: time in s, value; or values alone, which need a rate."""
    rows = []
    with file.open(newline="", encoding="utf-8") as text:
        lines = csv.reader(text)
        header = next(lines, [])
        try:
            [float(cell) for cell in header]
        except ValueError:
            pass
        else:
            raise ParameterError(
                f"{file.name}: row 1 = {header!r} is not allowed: a header, as time_s,value"
            )
        for number, cells in enumerate(lines, 2):
            if not cells:
                continue
            try:
                found = [float(cell) for cell in cells]
            except ValueError:
                raise ParameterError(
                    f"{file.name}: row {number} = {cells!r} is not allowed: numbers, no gap"
                ) from None
            require(
                len(found) == len(header) <= 2 and all(map(math.isfinite, found)),
                f"{file.name}: row {number}",
                cells,
                "time in s and a finite value",
            )
            rows.append(found)
    table = np.array(rows).reshape(len(rows), len(header))
    if len(header) == 1:
        return _on_clock(file, rate, table[:, 0])
    _no_rate(file, rate, "times")
    return table[:, 0], table[:, 1]


def _read_wav(file: Path, rate: float | None) -> tuple[Array, Array]:
    """Return times and values of the one channel of a sound file, whose full scale is 1."""
    _no_rate(file, rate, "its own")
    try:
        own, values = scipy.io.wavfile.read(file)
    except ValueError as error:
        raise ParameterError(
            f"file = {file.name!r} is not allowed: a WAV file that can be read ({error})"
        ) from error
    require(
        values.ndim == 1,
        f"{file.name}: channels",
        values.shape[-1] if values.ndim > 1 else 1,
        "one",
    )
    full, middle = (
        (1.0, 0.0) if values.dtype.kind == "f" else (float(np.iinfo(values.dtype).max) + 1, 0.0)
    )
    if values.dtype == np.uint8:
        full = 128.0
        middle = 128.0
    return np.arange(len(values)) / own, (_checked(file, values) - middle) / full


def _read_npy(file: Path, rate: float | None) -> tuple[Array, Array]:
    """Return times and values of an array (K, 2), or of values (K,) that need a rate."""
    try:
        values = _checked(file, np.load(file, allow_pickle=False))
    except ValueError as error:
        if isinstance(error, ParameterError):
            raise
        raise ParameterError(
            f"file = {file.name!r} is not allowed: an array of numbers ({error})"
        ) from error
    if values.ndim == 1:
        return _on_clock(file, rate, values)
    require(
        values.ndim == 2 and values.shape[1] == 2,
        f"{file.name}: shape",
        values.shape,
        "(K,) values, or (K, 2) times and values",
    )
    _no_rate(file, rate, "times")
    return values[:, 0], values[:, 1]


def _read_uff(file: Path, rate: float | None) -> tuple[Array, Array]:
    """Return times and values of the one record of a Universal File, data set 58."""
    _no_rate(file, rate, "its own")
    times, values = read_record(file)
    return times, _checked(file, values)


Reader = Callable[[Path, float | None], tuple[Array, Array]]
RECORDS: dict[str, Reader] = {
    ".csv": _read_csv,
    ".wav": _read_wav,
    ".npy": _read_npy,
    ".uff": _read_uff,
    ".unv": _read_uff,
}


def _read_one(path: str, plain: Any, folder: Path) -> Load:
    require(
        isinstance(plain, Mapping), path, plain, f"a table whose kind is one of {', '.join(KINDS)}"
    )
    kind = one_of(f"{path}.kind", plain.get("kind"), KINDS)
    rest = {key: value for key, value in plain.items() if key not in ("kind", "quantity")}
    if "quantity" in plain:
        require(
            kind not in ("force", "unbalance"),
            f"{path}.quantity",
            plain["quantity"],
            f"left out of a load of the kind {kind}",
        )
    quantity = one_of(
        f"{path}.quantity", plain.get("quantity", BASE if kind == "base" else FORCE), QUANTITIES
    )
    require(
        kind != "base" or quantity == BASE,
        f"{path}.quantity",
        quantity,
        f"{BASE}, or left out, of a base",
    )
    if kind == "base":  # harmonic, or tones, samples, a spectrum or a pulse of its acceleration
        kind = next((other for key, other in OF_BASE.items() if key in rest), kind)
    if kind == "samples":
        return _read_samples(path, rest, quantity, folder)
    return _form_of(kind, path, rest, quantity).read(path, rest)


KINDS = ("force", "unbalance", "base", "tones", "samples", "random", "shock")
OF_BASE = {
    "tones": "tones",
    "orders": "tones",
    "spectrum": "random",
    "pulse": "shock",
    "file": "samples",
}  # by its keys, of which other kind it is
START_KEYS: Keys = {
    "modal_displacement": ("modal_displacement", ROW),
    "modal_velocity": ("modal_velocity", ROW),
    "absorber_displacement_m": ("absorber_displacement", NUMBER),
    "absorber_velocity_m_s": ("absorber_velocity", NUMBER),
    "absorber_displacement": ("absorber_displacement", NUMBER),  # as the class has them, too
    "absorber_velocity": ("absorber_velocity", NUMBER),
}


def to_loads(plain: Mapping[str, Any], reference: float, folder: Path | None = None) -> Loads:
    """Return the loads of a plain form, a table ``load`` or a list of them, with its ``start``, one of `loads.STARTS` or a state.

    ``reference``: frequency in rad/s of the pseudo period where no load has a schedule. Raises ParameterError for all that does not fit.
    """
    require_keys("load file", plain, dict.fromkeys(("load", "start")), ("load",))
    several = isinstance(plain["load"], list | tuple)
    every = plain["load"] if several else [plain["load"]]
    parts = tuple(
        _read_one(f"load[{i}]" if several else "load", one, folder or Path())
        for i, one in enumerate(every)
    )
    start = plain.get("start", STARTS[0])
    if isinstance(start, Mapping):
        start = form(InitialState, START_KEYS).read("start", start)
    return Loads(parts, None if any(schedule_in(part) for part in parts) else reference, start)


def read_loads(path: Path, reference: float) -> Loads:
    """Return the loads of a file; ``reference`` and errors as of `to_loads`."""
    return to_loads(read_plain(path), reference, path.parent)
