"""What a load's table says about its record."""

from dataclasses import dataclass


@dataclass(frozen=True)
class RecordOptions:
    """How a record is read: the keys of a load of the kind ``samples``, None where a key is left out.

    - ``quantity``: "force" or "base_acceleration" of a load; "displacement", "velocity" or "acceleration" of a response
    - ``scale``: factor on the values; ``unit`` of the values, ``time_unit`` of the times
    - ``sample_rate``: in Hz, for files without times
    - ``channel``: the number of a channel, from 1, or its name
    - ``resample``: put samples that are not even in time on even steps; ``allow_clipping``: take a record that stays at its largest value
    """

    quantity: str
    scale: float | None = None
    unit: str | None = None
    time_unit: str | None = None
    sample_rate: float | None = None
    channel: int | str | None = None
    resample: bool = False
    allow_clipping: bool = False
