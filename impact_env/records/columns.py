"""Columns of a table as a record: which are times, which is the channel that is meant, and what their labels say."""

import re
from collections.abc import Sequence
from pathlib import Path

from impact_env.parameters import ParameterError, require
from impact_env.records.channels import Array, Channel, choose_channel, require_finite
from impact_env.records.options import RecordOptions
from impact_env.records.units import TIME_DIMENSION, Label, read_label

TIME_HEADERS = re.compile(r"t|time.*|zeit.*|temps|timestamp.*", re.IGNORECASE)
NOT_TIME_HEADERS = re.compile(
    r"(freq|hz\b|hertz|order|rpm|omega|wavelength|sample\b|samples\b|index|no\.?$|nr\.?$|#)",
    re.IGNORECASE,
)
NOT_LOAD_HEADERS = re.compile(
    r"(displ|veloc|position|strain|stress|voltage|psd|spectr|temperature)", re.IGNORECASE
)


def _is_time(label: Label) -> bool:
    return TIME_HEADERS.fullmatch(label.name) is not None or (
        label.unit is not None and label.unit.dimension == TIME_DIMENSION
    )


def _find_times(file: Path, options: RecordOptions, labels: Sequence[Label]) -> int | None:
    """Return the index of the column of times, None where the file has none."""
    named = [k for k, label in enumerate(labels) if _is_time(label)]
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
    """Return the channel of a table that is meant.

    Parameters
    ----------
    file, options
        the table's file, and what the load's table says about it
    columns
        its columns, (K,) each
    names
        their labels, empty where the file has none
    first_row
        row of the file with the first sample

    Raises ParameterError where it is not clear which columns are meant, or where a label has a unit
    that is unknown or no load's.
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
            f"{file.name}: column = {label.text!r} is not allowed: a force, or an acceleration of the base"
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
