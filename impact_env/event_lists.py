"""Lists of impacts, contact phases and reversals, which a kernel hands over in chunks while it runs: a run of any number of events is made once."""

import ctypes

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.motion.observers import (
    IMPACT_RECORD,
    PHASE_RECORD,
    REVERSAL_RECORD,
    Counters,
    new_events,
)
from impact_env.response import ContactPhases, Impacts, Reversals

EVENTS_PER_CHUNK = 8192  # records of a kind between two calls of `EventLists.empty`
_FUNCTION = ctypes.CFUNCTYPE(None)


class EventRecorder:
    """The events of one run: ``events`` is what its kernel fills, `found` returns what it has filled.

    A kernel that has used all places of a list calls `empty`, with Python's lock. What goes wrong there, or a KeyboardInterrupt that arrives there,
    ends the run and is raised by `close`.
    """

    def __init__(self, contacts: bool, reversals: bool, counters: Counters) -> None:
        self._counters = counters
        self._contacts = contacts
        self._reversals = reversals
        self._function = _FUNCTION(self._call)  # as long as a kernel may call it
        address = ctypes.cast(self._function, ctypes.c_void_p).value or 0
        self.events = new_events(EVENTS_PER_CHUNK * contacts, EVENTS_PER_CHUNK * reversals, address)
        self._chunks: dict[str, list[NDArray[np.void]]] = {
            "impacts": [np.zeros(0, IMPACT_RECORD)],
            "phases": [np.zeros(0, PHASE_RECORD)],
            "reversals": [np.zeros(0, REVERSAL_RECORD)],
        }
        self._error: BaseException | None = None

    def _call(self) -> None:
        try:
            self.empty()
        except BaseException as error:  # a function that compiled code calls cannot raise
            self._error = error
            self._counters.counts["stop"] = True
            for name in self._chunks:
                self.events.counts[name] = 0

    def empty(self) -> None:
        """Take the records out of all lists."""
        for name, chunks in self._chunks.items():
            used = self.events.counts[name]
            chunks.append(getattr(self.events, name)[:used].copy())
            self.events.counts[name] = 0

    def close(self) -> None:
        """Take the last records, and raise what has gone wrong in `empty`; no kernel may run any more."""
        if self._error is not None:
            raise self._error
        self.empty()

    def found(self) -> tuple[Impacts | None, ContactPhases | None, Reversals | None]:
        """Return impacts, contact phases and reversals, None where they were not listed."""
        impacts, phases, reversals = map(np.concatenate, self._chunks.values())
        return (
            Impacts(
                *(
                    impacts[name].copy()
                    for name in ("time", "relative_velocity", "impulse", "loss", "absorber")
                )
            )
            if self._contacts
            else None,
            ContactPhases(*(phases[name].copy() for name in ("start", "end", "kind", "absorber")))
            if self._contacts
            else None,
            Reversals(reversals["time"].copy(), reversals["absorber"].copy())
            if self._reversals
            else None,
        )
