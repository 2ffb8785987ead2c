"""Selection of the channels of a record.

The module has the options for reading a record, the channels of a file before their units are
applied, the selection of a channel, and the search for columns by their labels.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import LARGE, ParameterError, require
from impact_env.records.units import TIME_DIMENSION, Label, Unit, read_label


@dataclass(frozen=True)
class RecordOptions:
    """Options for reading a record: the keys of a load of the kind ``samples``, None if absent.

    Attributes
    ----------
    quantity : str
        "force" or "base_acceleration" of a load; "displacement", "velocity" or "acceleration" of a
        response.
    scale : float or None
        Factor of the values.
    unit, time_unit : str or None
        Units of values and times.
    sample_rate : float or None
        Sample rate in Hz, for files without times.
    channel : int, str or None
        Number of a channel, from 1, or its name.
    resample : bool
        Interpolate uneven samples to even times.
    allow_clipping : bool
        Accept a record that stays at its largest value.
    """

    quantity: str
    scale: float | None = None
    unit: str | None = None
    time_unit: str | None = None
    sample_rate: float | None = None
    channel: int | str | None = None
    resample: bool = False
    allow_clipping: bool = False


Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Channel:
    """A channel of a file, as written in the file.

    Attributes
    ----------
    values : array, (K,)
        Values.
    unit : Unit or None
        Their unit, None if the file has none.
    times : array, (K,), or None
        Times.
    time_unit : Unit or None
        Their unit.
    rate : float or None
        Sample rate in Hz, of a file with a clock. Rate and times are None if the file has neither.
    first_row : int
        Row of the first sample in the file, for errors.
    unit_unknown, time_unit_unknown : str or None
        Labels of units that are not known.
    """

    values: Array
    unit: Unit | None = None
    times: Array | None = None
    time_unit: Unit | None = None
    rate: float | None = None
    first_row: int = 1
    unit_unknown: str | None = None  # what stands where the unit of the values is expected
    time_unit_unknown: str | None = None


def choose_channel(file: Path, options: RecordOptions, names: Sequence[str]) -> int:
    """Return the index of the requested channel.

    Raises ParameterError if the request is ambiguous.
    """
    listed = ", ".join(f"{k} {name!r}" if name else str(k) for k, name in enumerate(names, 1))
    chosen = options.channel
    if chosen is None:
        allowed = f"given, as {file.name} has {len(names)} channels: {listed}"
        require(len(names) == 1, "channel", None, allowed)
        return 0
    if isinstance(chosen, str):
        result = [k for k, name in enumerate(names) if name == chosen]
        if not result:
            result = [k for k, name in enumerate(names) if read_label(name).name == chosen]
        require(
            len(result) == 1, "channel", chosen, f"the name of one channel of {file.name}: {listed}"
        )
        return result[0]
    if not 1 <= chosen <= len(names):
        raise ParameterError(f"channel = {chosen} is not allowed: one in {file.name}: {listed}")
    return chosen - 1


def require_finite(file: Path, values: Array, first_row: int = 1) -> Array:
    """Return values that are all finite numbers.

    Raises ParameterError with the first row that is not a finite number.
    """
    bad = np.flatnonzero(~(np.abs(values) <= LARGE))
    if len(bad):
        row = f"{file.name}: row {int(bad[0]) + first_row}"
        raise ParameterError(f"{row} = {values[bad[0]]:g} is not allowed: a finite number, no gap")
    return values


TIME_HEADERS = re.compile(r"t|time.*|zeit.*|temps|timestamp.*", re.IGNORECASE)
NOT_TIME_HEADERS = re.compile(
    r"(freq|hz\b|hertz|order|rpm|omega|wavelength|sample\b|samples\b|index|no\.?$|nr\.?$|#)",
    re.IGNORECASE,
)
NOT_LOAD_HEADERS = re.compile(
    r"(displ|veloc|position|strain|stress|voltage|psd|spectr|temperature)", re.IGNORECASE
)


def _find_times(file: Path, options: RecordOptions, labels: Sequence[Label]) -> int | None:
    """Return the index of the column of times, None if the file has none."""
    named = [
        k
        for k, label in enumerate(labels)
        if TIME_HEADERS.fullmatch(label.name) is not None
        or (label.unit is not None and label.unit.dimension == TIME_DIMENSION)
    ]
    require(
        len(named) <= 1, f"{file.name}: columns of times", [labels[k].text for k in named], "one"
    )
    if named or len(labels) == 1:
        return named[0] if named else None
    if options.sample_rate is not None and options.channel is not None:
        return None
    first = labels[0]
    unit = first.unit
    ok = unit is None and NOT_TIME_HEADERS.match(first.name) is None
    allowed = (
        "times in the first column, or sample_rate_hz and the channel for columns without times"
    )
    require(ok, f"{file.name}: first column", first.text, allowed)
    return 0


def channel_of_columns(
    file: Path,
    options: RecordOptions,
    columns: Sequence[Array],
    names: Sequence[str],
    first_row: int,
) -> Channel:
    """Return the selected channel of a table.

    Parameters
    ----------
    file : Path
        File of the table.
    options : RecordOptions
        Options of the load's table.
    columns : sequence of array, (K,) each
        Columns of the table.
    names : sequence of str
        Labels of the columns, empty if the file has none.
    first_row : int
        Row of the file with the first sample.

    Raises
    ------
    ParameterError
        The selection is ambiguous, or a label has a unit that is unknown or not a load's.
    """
    labels = [read_label(name) for name in names]
    clock = _find_times(file, options, labels)
    others = [k for k in range(len(columns)) if k != clock]
    require(
        len(others) > 0, f"{file.name}: columns", list(names), "times and values, or values alone"
    )
    chosen = others[choose_channel(file, options, [names[k] for k in others])]
    label = labels[chosen]
    if label.unit is None and options.unit is None and NOT_LOAD_HEADERS.match(label.name):
        raise ParameterError(
            f"{file.name}: column = {label.text!r} is not allowed: a force, or an "
            "acceleration of the base"
        )
    values = require_finite(file, columns[chosen], first_row)
    unknown = label.brackets if label.unit is None else None
    if clock is None:
        return Channel(values, label.unit, first_row=first_row, unit_unknown=unknown)
    time = labels[clock]
    return Channel(
        values,
        label.unit,
        require_finite(file, columns[clock], first_row),
        time.unit,
        first_row=first_row,
        unit_unknown=unknown,
        time_unit_unknown=time.brackets if time.unit is None else None,
    )
