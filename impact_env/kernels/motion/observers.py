"""What a run records, counts and may use.

`Observers` has the response level (windowed RMS around the maximum: paper, Eqs. tmax and barqtip),
lists of impacts, contact phases and reversals, states, energies, and counters with the limits of
the run. Each is a NamedTuple of arrays and records.

Every method passes the same quantities: the tip displacement at equidistant samples (level), the
state at those samples (series), impacts and contact phases (events), and the terms of the energy
balance (energy). In a run, lists and series that are not recorded have size 0; energies are None,
and their branches are pruned when a kernel is compiled. Lanes under control have no lists and no
series: None.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import jit, jit_inline, vector_code
from impact_env.kernels.compiling.parts import limit_inlining
from impact_env.kernels.compiling.records import FLAG, INTEGER, NUMBER, new_record, record_type
from impact_env.kernels.compiling.vector_code import Code, Index

SAMPLE_BLOCK = 64
# state of a `LevelObserver`; q is the displacement (m)
LEVEL_STATE = record_type(
    next=INTEGER,  # number of the next sample
    total=NUMBER,  # running sum of q^2 (m^2)
    largest=NUMBER,  # largest |q| so far (m)
    at=INTEGER,  # number of the sample with the largest |q|
    first_sum=NUMBER,  # running sum at the first sample of the window
    last_sum=NUMBER,  # running sum at the last sample of the window
    left=NUMBER,  # |q| of the sample before the maximum (m)
    right=NUMBER,  # |q| of the sample after the maximum (m)
    previous=NUMBER,  # last |q| (m)
    due=FLAG,  # whether the next sample is the one after the maximum
    bin=INTEGER,  # current bin of the envelope
)
LEVEL_OFF = 2**62  # `CLOCK.level` of a level that is not computed


class EnvelopeObserver(NamedTuple):
    """Smallest and largest displacement of each of B bins of a run; B = 0: not computed."""

    low: NDArray[np.float64]  # (B,) m, NaN in a bin without a sample
    high: NDArray[np.float64]  # (B,) m
    ends: NDArray[np.int64]  # (B,) number of the first sample after each bin


class LevelObserver(NamedTuple):
    """Windowed RMS around the maximum of a stream of samples (paper, Eqs. tmax and barqtip).

    The memory does not grow with the run. Sample n of a run is stored at position n, modulo the
    size, of ``block``, so the latest samples can be read there.
    """

    ring: NDArray[np.float64]  # (W + 1,) last running sums of q^2; W: samples in half the window
    state: Any  # a LEVEL_STATE record
    block: NDArray[np.float64]  # latest samples q (m), of any size
    place: NDArray[np.float64]  # (N_m,) mode shape where q is sampled; of size 0: at the tip
    envelope: EnvelopeObserver  # extremes of the same samples


# kinds of contact phase: held by friction between the walls, or at the lower or upper wall
STUCK_INSIDE = 0
HELD_LOWER = 1
HELD_UPPER = 2
# kinds of a miss of a search: guard passed, rate of the wrong sign, joint force out of its bounds
GUARD_PASSED = 0
RATE_TURNED = 1
JOINT_EXCEEDED = 2
# status codes of all integration kernels; each but DONE ends a run early (`count_progress`)
DONE, TOO_MANY_EVENTS, NOT_FINITE, NO_PROGRESS, TOO_MANY_EVALUATIONS, SEARCH_GAVE_UP, STOPPED = (
    range(7)
)
JOINTS_UNSOLVED = 7  # no joint forces of several absorbers meet the contact laws
STEP_TOO_LONG = 8  # for the tangent stiffness of a nonlinear spring
ORDER_REFUSED = 9  # of a lane under control, which did nothing
REGIME_FAILED = 10  # the regime of a set of joined absorbers could not be made

# counters of a run: what has been done, and what may be used (`count_progress`)
COUNTS = record_type(
    impacts=INTEGER,  # impacts
    stuck_time=NUMBER,  # total time in joined phases (s)
    steps=INTEGER,  # time steps, or segments between events
    evaluations=INTEGER,  # evaluations of guard signals
    events=INTEGER,  # events
    reached=NUMBER,  # time reached (s); another thread reads it while the run goes on
    stop=FLAG,  # order of another thread to end the run
    most_events=NUMBER,  # events that may be used at once
    events_per_s=NUMBER,  # further events for each second of the run's time
    most_evaluations=NUMBER,  # evaluations that may be used at once
    evaluations_per_s=NUMBER,  # further evaluations for each second of the run's time
    searched=INTEGER,  # evaluations before the current segment
)
# clock of the samples
CLOCK = record_type(
    level=INTEGER,  # next sample of the level; `LEVEL_OFF`: the level is not computed
    series=INTEGER,  # next sample of the series
    first=INTEGER,  # first sample of the series
    interval=NUMBER,  # time between two samples (s); sample n is at n times this time
)
# an impact
IMPACT_RECORD = record_type(
    time=NUMBER,  # s
    relative_velocity=NUMBER,  # before the impact, absorber minus beam (m/s)
    impulse=NUMBER,  # on the absorber (N s)
    loss=NUMBER,  # of energy (J)
    absorber=INTEGER,  # number of the absorber
)
# a contact phase
PHASE_RECORD = record_type(
    start=NUMBER,  # s
    end=NUMBER,  # s
    kind=INTEGER,  # STUCK_INSIDE, HELD_LOWER or HELD_UPPER
    absorber=INTEGER,  # number of the absorber
)
# a slip reversal: its time (s), number of the absorber
REVERSAL_RECORD = record_type(time=NUMBER, absorber=INTEGER)
# numbers of filled records of the lists of events
LIST_COUNTS = record_type(
    impacts=INTEGER,  # of `EventLists.impacts`
    phases=INTEGER,  # of `EventLists.phases`
    reversals=INTEGER,  # of `EventLists.reversals`
    empty=INTEGER,  # address of the function that empties the lists
)
# energies of a run in J
TOTALS = record_type(
    work=NUMBER,  # of the loads
    friction_loss=NUMBER,  # loss by friction
    impact_loss=NUMBER,  # loss by impacts
    absorber_damping=NUMBER,  # loss in the damper of a tuned absorber
)
# number of checked searches, number of their misses
CHECK_COUNTS = record_type(searches=INTEGER, misses=INTEGER)
# a miss: its time in the run (s), its kind, its size as a share as in `CheckObserver.worst`
MISS_RECORD = record_type(time=NUMBER, kind=INTEGER, share=NUMBER)
# an absorber's motion at the start of a segment
ABSORBER_MOTION = record_type(
    q=NUMBER,  # displacement (m)
    v=NUMBER,  # velocity (m/s)
    a=NUMBER,  # constant acceleration (m/s^2)
    base_share=NUMBER,  # share of a free absorber's motion under a moving base to add: 1 or 0
)
FIRST_MISSES = 16  # most misses that are listed


class CheckObserver(NamedTuple):
    """Result of checking the searches of the exact method (check.py)."""

    counts: Any  # a CHECK_COUNTS record
    # (3,) largest miss of each kind, as a share: depth beyond a guard, of the clearance (without
    # one, of the signal's terms); rate of the wrong sign, of its terms; excess of the joint force,
    # of its terms
    worst: NDArray[np.float64]
    first: NDArray[Any]  # (FIRST_MISSES,) MISS_RECORD records; of size 0: not checked


class Counters(NamedTuple):
    """Counters of a run.

    ``counts`` is a COUNTS record. ``check`` is None in kernels without energies, which do not check
    searches.
    """

    counts: Any
    check: CheckObserver | None = None


class EventLists(NamedTuple):
    """Lists of events at the contacts. A list of size 0 is not filled.

    When a list is full, the function at the address ``counts.empty`` is called, which copies the
    records of all three lists and sets the numbers of filled records to 0.
    """

    impacts: NDArray[Any]  # (capacity,) IMPACT_RECORD records
    phases: NDArray[Any]  # (capacity,) PHASE_RECORD records
    counts: Any  # a LIST_COUNTS record
    reversals: NDArray[Any]  # (capacity,) REVERSAL_RECORD records


class StateSeries(NamedTuple):
    """The states of a run, ``states`` (samples, 2 N_m + 2); without rows: not recorded.

    The columns are modal displacements, absorber displacement, modal velocities and absorber
    velocity; n absorbers have n displacements and n velocities. The first row is sample
    ``clock.first`` of the run.
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

    Whether lists and series are recorded is decided at run time, by their size, so that one kernel
    serves all runs. Energies, and the check of searches, need a kernel of their own: ``energy`` is
    None, or the `EnergyTotals` that the caller reads. Within an exact run it is the
    `energies.Account` that fills these totals. Lanes under control have no lists and no series:
    None. ``level`` None: not computed.
    """

    clock: Any
    counters: Counters
    level: LevelObserver | None = None
    events: EventLists | None = None
    series: StateSeries | None = None
    energy: Any = None


# Default limits of a run. Friction with 60 undamped modes can reverse a few thousand times a pseudo
# period; fewer than 100 are usual. A million events take some ten seconds. Events that accumulate
# at one time have no more than that, since the budget grows only with the time reached.
FIRST_EVENTS = 1_000_000
EVENTS_PER_PERIOD = 5_000
EVALUATIONS_PER_EVENT = 40  # most evaluations of a guard signal per event; ten are usual

MOST_STALLED_EVENTS = 10_000  # events in a row without progress in time
LONG_SEARCH_EVALUATIONS = 2_000_000  # evaluations after which a search gives up


def new_envelope(ends: Sequence[int] | NDArray[np.int64] = ()) -> EnvelopeObserver:
    """Return an envelope without samples.

    Bin b ends before the sample of number ``ends[b]``; ``ends`` (B,), of size 0: no envelope.
    """
    last = np.array(ends, dtype=np.int64)
    return EnvelopeObserver(np.full(len(last), np.nan), np.full(len(last), np.nan), last)


def new_level(
    samples_per_period: int,
    half_window_periods: int = 10,
    place: NDArray[np.float64] | None = None,
    envelope: EnvelopeObserver | None = None,
) -> LevelObserver:
    """Return an empty level observer for a window of +- ``half_window_periods`` pseudo periods.

    ``place`` (N_m,): mode shape at the point where the level is read, None: at the tip.
    """
    return LevelObserver(
        np.zeros(half_window_periods * samples_per_period + 1),
        new_record(LEVEL_STATE, largest=-1.0),
        np.zeros(SAMPLE_BLOCK),
        np.zeros(0) if place is None else np.array(place, dtype=np.float64),
        new_envelope() if envelope is None else envelope,
    )


@jit
def reset_level(level):
    """Reset the level and the envelope's bin to those before the first sample.

    The envelope's extremes stay.
    """
    state = level.state
    state.next = 0
    state.at = 0
    state.due = False
    state.total = 0.0
    state.largest = -1.0
    state.first_sum = 0.0
    state.last_sum = 0.0
    state.left = 0.0
    state.right = 0.0
    state.previous = 0.0
    state.bin = 0


@jit
def push_sample(level, q):
    """Add the next sample ``q`` (m) of the displacement to level and envelope."""
    level.block[0] = q
    push_samples(level, 0, 1)


@jit
def update_envelope(level, first, count):
    """Add ``count`` samples (m), from position ``first`` of the block on, to the envelope."""
    block = level.block
    low, high, ends = level.envelope
    n = level.state.next
    last = low.shape[0] - 1
    b = level.state.bin
    for k in range(first, first + count):
        while b < last and n >= ends[b]:
            b += 1
        q = block[k]
        if not low[b] <= q:
            low[b] = q
        if not high[b] >= q:
            high[b] = q
        n += 1
    level.state.bin = b


@jit
def push_samples(level, first, count):
    """Add the next ``count`` samples of the displacement (m) to level and envelope.

    They are in the block from position ``first`` on.
    """
    ring = level.ring
    state = level.state
    block = level.block
    if level.envelope.low.shape[0] > 0:
        update_envelope(level, first, count)
    size = ring.shape[0]
    width = size - 1
    n = state.next
    at = state.at
    due = state.due
    place = n % size
    total = state.total
    largest = state.largest
    previous = state.previous
    for k in range(first, first + count):
        q = block[k]
        total += q * q
        q = abs(q)
        ring[place] = total
        # now where the sum at n - width is: the first sample of the window
        place = place + 1 if place < width else 0
        if due:
            state.right = q
            due = False
        if q > largest:
            largest = q
            at = n
            due = True
            state.left = previous
            state.right = q
            state.first_sum = ring[place] if n >= width else ring[0]
        if n <= at + width:
            state.last_sum = total
        previous = q
        n += 1
    state.next = n
    state.at = at
    state.due = due
    state.total = total
    state.largest = largest
    state.previous = previous


@jit
def compute_level(level):
    """Return (response level in m, sample of the maximum, largest |q| in m).

    The sample of the maximum is a number with a fraction: a parabola through the maximum and its
    two neighbours gives the fraction and the largest |q|. The window is cut at the run's start and
    end. The response level is the RMS over the samples after the window's first.
    """
    ring = level.ring
    state = level.state
    width = ring.shape[0] - 1
    if state.next < 2:
        only = max(state.largest, 0.0)  # of one sample; 0 without any
        return only, 0.0, only
    at = state.at
    first = max(0, at - width)
    last = min(state.next - 1, at + width)
    mean = (state.last_sum - state.first_sum) / max(last - first, 1)
    left = state.left
    peak = state.largest
    right = state.right
    bend = left - 2.0 * peak + right
    shift = 0.0
    if bend < 0.0 and at > 0:
        shift = 0.5 * (left - right) / bend
        peak -= 0.25 * (left - right) * shift
    return np.sqrt(max(mean, 0.0)), at + shift, peak


def new_counters(
    events: float = np.inf,
    events_per_s: float = 0.0,
    evaluations: float = np.inf,
    evaluations_per_s: float = 0.0,
    check: CheckObserver | None = None,
) -> Counters:
    """Return counters at zero, with the limits of a run.

    It may use ``events`` and ``evaluations``, and more for each second (s) of the time reached.
    """
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
    the series. ``level`` False: the level is not computed.
    """
    return new_record(
        CLOCK, interval=interval, series=first, first=first, level=0 if level else LEVEL_OFF
    )


def new_events(contacts: int, reversals: int, empty: int) -> EventLists:
    """Return empty lists: capacities ``contacts`` of impacts and phases each, and ``reversals``.

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
    """Return a `CheckObserver` without misses; ``checked`` False: searches are not checked."""
    return CheckObserver(
        new_record(CHECK_COUNTS), np.zeros(3), np.zeros(FIRST_MISSES * checked, MISS_RECORD)
    )


@vector_code()
def call_function(code: Code, address: Index):
    """Call a function without arguments at an address in memory."""
    code.call(address)


@jit
def find_list_index(listed, used, counts):
    """Return the index of the next record of a list with ``used`` filled records.

    If the list is full, all lists are emptied first. The result is -1 if it has no capacity.
    """
    if used < listed.shape[0]:
        return used
    if used == 0:
        return -1
    call_function(counts.empty)
    return 0


@jit
def push_impact(events, time, relative_velocity, impulse, loss, absorber):
    """Append an IMPACT_RECORD to the list, if there is one; ``absorber``: its number."""
    if events is None:
        return
    counts = events.counts
    k = find_list_index(events.impacts, counts.impacts, counts)
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
    """Append a PHASE_RECORD to the list, if there is one; ``absorber``: its number."""
    if events is None:
        return
    counts = events.counts
    k = find_list_index(events.phases, counts.phases, counts)
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
    """Append a REVERSAL_RECORD to the list, if there is one; ``absorber``: its number."""
    if events is None:
        return
    counts = events.counts
    k = find_list_index(events.reversals, counts.reversals, counts)
    if k < 0:
        return
    row = events.reversals[k]
    row.time = time
    row.absorber = absorber
    counts.reversals = k + 1


@jit_inline
def limit_searches(memory, counters):
    """Limit the evaluations of each search to those that the run may use.

    ``memory`` (2,): `signals.Signal.memory`, whose second number is changed.
    """
    memory[1] = min(memory[1], counters.counts.most_evaluations)


@jit_inline
def count_progress(counters, window, tau, last, stalled):
    """Count a segment from ``last`` to ``tau`` (s from the window's centre) and its event.

    Return (stalled, status): the number of events in a row without progress in time, of which
    ``stalled`` came before, and a status code. A ``tau`` that is not finite is a failed search.
    """
    counts = counters.counts
    counts.steps += 1
    searched = counts.evaluations - counts.searched
    counts.searched = counts.evaluations
    if not np.isfinite(tau):
        if searched >= counts.most_evaluations:
            return stalled, TOO_MANY_EVALUATIONS
        return stalled, SEARCH_GAVE_UP if searched >= LONG_SEARCH_EVALUATIONS else NOT_FINITE
    time = window.centre + tau
    counts.reached = time
    if tau < window.half:
        counts.events += 1
    stalled = stalled + 1 if tau == last else 0
    status = DONE
    if stalled > MOST_STALLED_EVENTS:
        status = NO_PROGRESS
    if counts.events > counts.most_events + counts.events_per_s * time:
        status = TOO_MANY_EVENTS
    if counts.evaluations > counts.most_evaluations + counts.evaluations_per_s * time:
        status = TOO_MANY_EVALUATIONS
    if counts.stop:
        status = STOPPED
    return stalled, status


@jit_inline
def record_time(counters, time):
    """Record the time reached (s) of a run without events; return a status code."""
    counters.counts.reached = time
    return STOPPED if counters.counts.stop else DONE
