"""Observers of a run: level, lists of events, states, energies.

Each is a NamedTuple of arrays and records.

What a run does not record has arrays of size 0, but for the energies: they are None, and their
branches are pruned when a kernel is compiled.

Every method hands its observers the same things: the tip displacement at equidistant samples
(level), the state at those samples (series), impacts and contact phases (events), and the terms of
the energy balance (energy).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import jit, vector_code
from impact_env.kernels.compiling.parts import limit_inlining
from impact_env.kernels.compiling.records import FLAG, INTEGER, NUMBER, new_record, record_type
from impact_env.kernels.compiling.vector_code import Code, Index
from impact_env.kernels.motion.level import LEVEL_OFF, LevelObserver

# kinds of contact phase
STUCK_INSIDE = 0
HELD_LOWER = 1
HELD_UPPER = 2
# kinds of what a search can miss
GUARD_PASSED = 0
RATE_TURNED = 1
JOINT_EXCEEDED = 2
# status codes of all integration kernels
DONE, TOO_MANY_EVENTS, NOT_FINITE, NO_PROGRESS, TOO_MANY_EVALUATIONS, SEARCH_GAVE_UP, STOPPED = (
    range(7)
)
JOINTS_UNSOLVED = 7  # no joint forces of several absorbers meet the contact laws
STEP_TOO_LONG = 8  # for the stiffness of a nonlinear spring where it is
ORDER_REFUSED = 9  # of a lane under control, which did nothing
REGIME_FAILED = 10  # the regime of a set of joined absorbers could not be made

# what has been done: impacts, time in joined phases (s), steps or segments between events,
# evaluations, events, time reached (s), which another thread reads while the run goes on; ``stop``
# is its order to end it. What may be used (budget.py): events and evaluations at once, and for each
# second that has passed. Last, the evaluations before the segment under way.
COUNTS = record_type(
    impacts=INTEGER,
    stuck_time=NUMBER,
    steps=INTEGER,
    evaluations=INTEGER,
    events=INTEGER,
    reached=NUMBER,
    stop=FLAG,
    most_events=NUMBER,
    events_per_s=NUMBER,
    most_evaluations=NUMBER,
    evaluations_per_s=NUMBER,
    searched=INTEGER,
)
# next sample of the level (`level.LEVEL_OFF`: none is wanted) and of the series, first sample of
# the series, and the time between two (s)
CLOCK = record_type(level=INTEGER, series=INTEGER, first=INTEGER, interval=NUMBER)
IMPACT_RECORD = record_type(
    time=NUMBER, relative_velocity=NUMBER, impulse=NUMBER, loss=NUMBER, absorber=INTEGER
)
PHASE_RECORD = record_type(start=NUMBER, end=NUMBER, kind=INTEGER, absorber=INTEGER)
REVERSAL_RECORD = record_type(time=NUMBER, absorber=INTEGER)
# used places of the lists of events, and the address of the function that empties them
LIST_COUNTS = record_type(impacts=INTEGER, phases=INTEGER, reversals=INTEGER, empty=INTEGER)
TOTALS = record_type(work=NUMBER, friction_loss=NUMBER, impact_loss=NUMBER, absorber_damping=NUMBER)
CHECK_COUNTS = record_type(searches=INTEGER, misses=INTEGER)
MISS_RECORD = record_type(time=NUMBER, kind=INTEGER, share=NUMBER)
# an absorber's displacement, velocity and acceleration, and which share of the motion that a moving
# base gives a free absorber comes on top of it: 1 or 0
ABSORBER_MOTION = record_type(q=NUMBER, v=NUMBER, a=NUMBER, base_share=NUMBER)
FIRST_MISSES = 16


class CheckObserver(NamedTuple):
    """Result of checking the exact method's searches (check.py).

    ``counts``: a CHECK_COUNTS record. ``worst`` (3,): largest miss of each kind, as a share: depth
    beyond a guard, of the clearance (of the signal's terms, if there is none); rate of the wrong
    sign, of its terms; excess of the joint force, of its terms. ``first`` (FIRST_MISSES,):
    MISS_RECORD records of the first misses; of size 0: searches are not checked.
    """

    counts: Any
    worst: NDArray[np.float64]
    first: NDArray[Any]


class Counters(NamedTuple):
    """Counters of a run.

    ``counts`` is a COUNTS record. ``check`` is None in kernels without energies, which do not check
    searches.
    """

    counts: Any
    check: CheckObserver | None = None


class EventLists(NamedTuple):
    """Events at the contacts.

    ``impacts``, ``phases`` and ``reversals`` (capacity,) are IMPACT_RECORD, PHASE_RECORD and
    REVERSAL_RECORD records.

    Of size 0: not listed. ``counts``, a LIST_COUNTS record: when a list is full, the function at
    its address ``empty`` is called, which takes the records out of all three lists and sets their
    numbers to 0.
    """

    impacts: NDArray[Any]
    phases: NDArray[Any]
    counts: Any
    reversals: NDArray[Any]


class StateSeries(NamedTuple):
    """The states of a run, ``states`` (samples, 2 N_m + 2).

    The columns are modal displacements, absorber displacement, modal velocities and absorber
    velocity.

    Without rows: not recorded. The first row is sample ``clock.first`` of the run.
    """

    states: NDArray[np.float64]


@limit_inlining
class EnergyTotals(NamedTuple):
    """Terms of the energy balance in J.

    ``totals`` (1,) is a TOTALS record: the work of the force and the losses by friction, by impacts
    and in the tuned absorber's damper. ``modal`` (N_m,) is the loss in each mode. ``totals`` is an
    array, because a kernel that returns records does not compile.
    """

    totals: NDArray[Any]
    modal: NDArray[np.float64]


class Observers(NamedTuple):
    """All observers of a run; ``clock`` is a CLOCK record.

    What is recorded is a value: lists and series of size 0 are not filled, so that one kernel
    serves runs with any record. Only energies, and the check of searches, have a kernel of their
    own: ``energy`` is None, or the `EnergyTotals` that the caller reads; between the segments of an
    exact run it is the `energy.account.Account` that fills them. Lanes under control have no lists
    and no series: None.
    """

    clock: Any
    counters: Counters
    level: LevelObserver | None = None
    events: EventLists | None = None
    series: StateSeries | None = None
    energy: Any = None


def new_counters(
    events: float = np.inf,
    events_per_s: float = 0.0,
    evaluations: float = np.inf,
    evaluations_per_s: float = 0.0,
    check: CheckObserver | None = None,
) -> Counters:
    """Return counters at zero, and what the run may use."""
    counts = new_record(
        COUNTS,
        most_events=events,
        events_per_s=events_per_s,
        most_evaluations=evaluations,
        evaluations_per_s=evaluations_per_s,
    )
    return Counters(counts, check)


def new_clock(interval: float, first: int = 0, level: bool = True) -> Any:
    """Return the clock of a run that begins.

    ``interval`` (s) is the time between samples, and ``first`` the number of the first sample of
    the series.
    """
    return new_record(
        CLOCK, interval=interval, series=first, first=first, level=0 if level else LEVEL_OFF
    )


def new_events(contacts: int, reversals: int, empty: int) -> EventLists:
    """Return empty lists with these capacities.

    ``empty`` is the address of the function that empties them.
    """
    return EventLists(
        np.zeros(contacts, IMPACT_RECORD),
        np.zeros(contacts, PHASE_RECORD),
        new_record(LIST_COUNTS, empty=empty),
        np.zeros(reversals, REVERSAL_RECORD),
    )


def new_series(rows: int, states: int) -> StateSeries:
    """Return memory for ``rows`` states of ``states`` numbers each; 0 rows: not recorded."""
    return StateSeries(np.zeros((rows, states)))


def new_energy(modes: int) -> EnergyTotals:
    """Return an energy balance at zero."""
    return EnergyTotals(np.zeros(1, TOTALS), np.zeros(modes))


def new_check(checked: bool) -> CheckObserver:
    """Return a check without misses; not ``checked``: searches are not checked."""
    return CheckObserver(
        new_record(CHECK_COUNTS), np.zeros(3), np.zeros(FIRST_MISSES * checked, MISS_RECORD)
    )


@vector_code()
def call_function(code: Code, address: Index):
    """Call a function without arguments at an address in memory."""
    code.call(address)


@jit
def next_list_index(listed, used, counts):
    """Return the index of a list's next record, of which ``used`` are filled.

    A full list is emptied first. The result is -1 if the list has no capacity.
    """
    if used < listed.shape[0]:
        return used
    if used == 0:
        return -1
    call_function(counts.empty)
    return 0


@jit
def push_impact(events, time, relative_velocity, impulse, loss, absorber):
    """Append an impact of an absorber (its number) to the list, if there is one."""
    if events is None:
        return
    counts = events.counts
    k = next_list_index(events.impacts, counts.impacts, counts)
    if k < 0:
        return
    row = events.impacts[k]
    row.time = time
    row.relative_velocity = relative_velocity
    row.impulse = impulse
    row.loss = loss
    row.absorber = absorber
    counts.impacts = k + 1


@jit
def push_phase(events, start, end, kind, absorber):
    """Append a contact phase of an absorber (its number) to the list, if there is one."""
    if events is None:
        return
    counts = events.counts
    k = next_list_index(events.phases, counts.phases, counts)
    if k < 0:
        return
    row = events.phases[k]
    row.start = start
    row.end = end
    row.kind = kind
    row.absorber = absorber
    counts.phases = k + 1


@jit
def push_reversal(events, time, absorber):
    """Append a time (s) at which an absorber has no relative velocity, if such times are listed.

    At this time friction may change its direction. ``absorber`` is the absorber's number.
    """
    if events is None:
        return
    counts = events.counts
    k = next_list_index(events.reversals, counts.reversals, counts)
    if k < 0:
        return
    row = events.reversals[k]
    row.time = time
    row.absorber = absorber
    counts.reversals = k + 1
