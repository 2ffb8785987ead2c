"""Reading of a record from a file, in SI units at evenly spaced times.

`read_record` calls the reader of the file's format, converts units, finds the times, and checks for
clipped values and uneven steps.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from impact_env.checks import ParameterError, require
from impact_env.records.channels import Array, Channel, RecordOptions
from impact_env.records.from_csv import read_csv
from impact_env.records.from_npy import read_npy
from impact_env.records.from_uff import read_uff
from impact_env.records.from_wav import read_wav
from impact_env.records.units import (
    ACCELERATION_DIMENSION,
    EXAMPLES,
    FORCE_DIMENSION,
    LENGTH_DIMENSION,
    TIME_DIMENSION,
    VELOCITY_DIMENSION,
    Unit,
    require_unit,
)
from impact_env.sampling_times import even_times, find_uneven, is_even

Reader = Callable[[Path, RecordOptions], Channel]
RECORD_READERS: dict[str, Reader] = {
    ".csv": read_csv,
    ".wav": read_wav,
    ".npy": read_npy,
    ".uff": read_uff,
    ".unv": read_uff,
}
DIMENSIONS = {
    "force": FORCE_DIMENSION,
    "base_acceleration": ACCELERATION_DIMENSION,
    # of measured responses
    "displacement": LENGTH_DIMENSION,
    "velocity": VELOCITY_DIMENSION,
    "acceleration": ACCELERATION_DIMENSION,
}
# so many samples in a row at a record's largest or smallest value mean a clipped signal
CLIPPED = 8
# time steps over their median: a longer step has lost a sample, and with shorter steps linear
# interpolation would skip samples
LONGEST_STEP = 1.5
SHORTEST_STEP = 0.5


def _choose_unit(
    file: Path, key: str, unit: str | None, own: Unit | None, unknown: str | None, dimension: str
) -> Unit | None:
    """Return the unit of values or times; None if neither user nor file gives one (SI).

    ``unit``: the user's value for ``key``; ``own``: the file's unit; ``unknown``: a label in the
    file that is no known unit. Raises ParameterError for a unit of another dimension, for two units
    that differ, and for an unknown label if ``unit`` is None.
    """
    wanted = None if unit is None else require_unit(key, unit, dimension)
    if own is not None:
        if own.dimension != dimension:
            require_unit(f"{file.name}: unit", own.name, dimension)
        if wanted is not None and not wanted.is_same_as(own):
            raise ParameterError(
                f"{key} = {unit!r} is not allowed: {own.name}, as {file.name} has it, or left out"
            )
        return own
    if unknown is not None and wanted is None:
        allowed = (
            f"a unit of {dimension} in brackets or at the end, as {EXAMPLES[dimension]}, or the "
            f"load's {key}"
        )
        raise ParameterError(f"{file.name}: unit = {unknown!r} is not allowed: {allowed}")
    return wanted


def _factor(file: Path, options: RecordOptions, channel: Channel) -> float:
    """Return the factor from the values of a file to SI units: unit times ``options.scale``.

    Raises ParameterError for a scale without ``options.unit`` if the file has a unit that is not
    SI.
    """
    unit = _choose_unit(
        file, "unit", options.unit, channel.unit, channel.unit_unknown, DIMENSIONS[options.quantity]
    )
    factor = 1.0 if unit is None else unit.factor
    if options.scale is not None and options.unit is None and factor != 1:
        assert unit is not None
        allowed = (
            f"left out, as {file.name} has values in {unit.name}, which are converted; unit = "
            f"{unit.name!r} beside it makes it a factor on top"
        )
        require(False, "scale", options.scale, allowed)
    return factor * (1.0 if options.scale is None else options.scale)


def _times(file: Path, options: RecordOptions, channel: Channel) -> Array:
    """Return the times (K,) of a channel in s, from the file or from a sample rate.

    Raises ParameterError if file and options give both or neither.
    """
    rate = options.sample_rate
    count = len(channel.values)
    if channel.times is not None or channel.rate is not None:
        require(
            rate is None,
            "sample_rate_hz",
            rate,
            f"left out for {file.name}, which has times of its own",
        )
    if channel.times is not None:
        unit = _choose_unit(
            file,
            "time_unit",
            options.time_unit,
            channel.time_unit,
            channel.time_unit_unknown,
            TIME_DIMENSION,
        )
        return channel.times * (1.0 if unit is None else unit.factor)
    require(
        options.time_unit is None,
        "time_unit",
        options.time_unit,
        f"left out for {file.name}, which has no times",
    )
    rate = rate if channel.rate is None else channel.rate
    if rate is None:
        raise ParameterError(
            f"sample_rate_hz = None is not allowed: given for {file.name}, which has no times"
        )
    return np.arange(count) / rate


def _refuse_clipped(file: Path, channel: Channel) -> None:
    """Raise ParameterError if `CLIPPED` samples in a row have the largest or smallest value.

    Zero does not count, nor does a constant record.
    """
    values = channel.values
    for extreme in (float(np.max(values)), float(np.min(values))):
        at = np.flatnonzero(values == extreme)
        runs = np.split(at, np.flatnonzero(np.diff(at) > 1) + 1)
        longest = max(runs, key=len)
        if extreme != 0 and CLIPPED <= len(longest) < len(values):
            row = channel.first_row + int(longest[0])
            allowed = (
                f"fewer than {CLIPPED} samples in a row at the record's limit: it is clipped from "
                f"row {row} on; allow_clipping = true takes it as it is"
            )
            raise ParameterError(f"{file.name}: value = {extreme:g} is not allowed: {allowed}")


def _to_even_times(
    file: Path, options: RecordOptions, channel: Channel, times: Array, values: Array
) -> tuple[Array, Array]:
    """Return evenly spaced times (K,) from 0 and the values (K,) at these times.

    Uneven records are interpolated linearly if ``options.resample`` is set. Raises ParameterError
    for other uneven records, for steps outside `SHORTEST_STEP` to `LONGEST_STEP` times the median,
    and for times that do not increase.
    """
    steps = np.diff(times)
    for k in np.flatnonzero(~(steps > 0))[:1]:
        row = f"{file.name}: time in row {channel.first_row + int(k) + 1}"
        require(False, row, float(times[k + 1]), "later than that in the row before")
    duration = float(times[-1] - times[0])
    if is_even(times):
        return even_times(len(times), duration), values
    usual = float(np.median(steps))
    outside = np.flatnonzero((steps > LONGEST_STEP * usual) | (steps < SHORTEST_STEP * usual))
    k = find_uneven(times) if len(outside) == 0 or not options.resample else int(outside[0]) + 1
    row = f"{file.name}: time in row {channel.first_row + k}"
    step = float(steps[k - 1])
    if not options.resample:
        allowed = (
            f"steps of {usual:g} s as elsewhere, not {step:g} s; resample = true takes straight "
            "lines between samples"
        )
        raise ParameterError(f"{row} = {times[k]:g} is not allowed: {allowed}")
    allowed = (
        f"steps from {SHORTEST_STEP:g} to {LONGEST_STEP:g} times the usual {usual:g} s, not "
        f"{step:g} s: straight lines would bridge a gap or leave out samples"
    )
    require(len(outside) == 0, row, float(times[k]), allowed)
    even = even_times(len(times), duration)
    return even, np.asarray(np.interp(even, times - times[0], values))


def read_record(file: Path, options: RecordOptions) -> tuple[Array, Array]:
    """Return evenly spaced times (K,) in s from 0 and the values (K,) of a record in SI units.

    Raises ParameterError for a record that cannot be used, with the file, the row or dataset, and
    the allowed values; OSError if the file cannot be opened.
    """
    channel = RECORD_READERS[file.suffix.lower()](file, options)
    require(
        len(channel.values) >= 2, f"{file.name}: rows", len(channel.values), "two samples or more"
    )
    factor = _factor(file, options, channel)
    times = _times(file, options, channel)
    if not options.allow_clipping:
        _refuse_clipped(file, channel)
    return _to_even_times(file, options, channel, times, factor * channel.values)
