"""One channel of a file as it is read, before its units are applied; and which of several channels is meant."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impact_env.parameters import LARGE, ParameterError, require
from impact_env.records.options import RecordOptions
from impact_env.records.units import Unit, read_label

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Channel:
    """A channel of a file.

    - ``values`` (K,) as written, and their ``unit``; None: the file has none
    - ``times`` (K,) as written, and their ``time_unit``; or, where the file has a clock, its ``rate`` in Hz. Both None: no times
    - ``first_row``: number of the first sample in the file, as an error names it
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
    """Return the index of the channel that is meant; raises ParameterError where it is not clear which."""
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
    """Return values that are all finite numbers; raises ParameterError that names the first other row."""
    bad = np.flatnonzero(~(np.abs(values) <= LARGE))
    if len(bad):
        row = f"{file.name}: row {int(bad[0]) + first_row}"
        raise ParameterError(f"{row} = {values[bad[0]]:g} is not allowed: a finite number, no gap")
    return values
