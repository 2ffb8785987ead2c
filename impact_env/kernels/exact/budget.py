"""Limits of a run.

They are limits of events and of evaluations of the searches, and the order to stop that another
thread gives.
"""

from __future__ import annotations

import numpy as np

from impact_env.kernels.compiling.jit import jit_inline
from impact_env.kernels.motion.observers import (
    DONE,
    NO_PROGRESS,
    NOT_FINITE,
    SEARCH_GAVE_UP,
    STOPPED,
    TOO_MANY_EVALUATIONS,
    TOO_MANY_EVENTS,
)

# Default limits of a run. Friction with 60 undamped modes can turn a few thousand
# times a pseudo period; the usual is below 100. A million events take some ten seconds, and events
# that pile up at one time have no more than that, since the budget grows only with the time
# reached.
FIRST_EVENTS = 1_000_000
EVENTS_PER_PERIOD = 5_000
EVALUATIONS_PER_EVENT = 40  # of the search, where ten are usual

MOST_STALLED_EVENTS = 10_000  # events in a row without progress in time
LONG_SEARCH_EVALUATIONS = 2_000_000  # evaluations after which a search gives up


@jit_inline
def limit_searches(memory, counters):
    """Limit the evaluations of each search to those that the run may use.

    ``memory`` is that of `signals.Signal`.
    """
    memory[1] = min(memory[1], counters.counts.most_evaluations)


@jit_inline
def count_progress(counters, window, tau, last, stalled):
    """Count a segment from ``last`` to ``tau`` (s from the window's centre).

    Return the events in a row without progress in time, and a status code.
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
