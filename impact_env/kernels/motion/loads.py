"""The load in a window: the chirp of one force, or any other loads.

In: a `Schedule`, the breakpoints of the drive with a section between two of them. Out: its windows
(`ForceWindow`), in which the load is expanded around one frequency, the carrier.

The chirp of one force is described by its frequency and the rate of it. Other loads are a list of
pieces, whose sum is one polynomial of time on the carrier. With the time u since it began, a piece
is

    Re((c0 + c1 u + c2 u^2) exp(i (phi + omega u + alpha u^2/2))):

a chirp (c0 alone), the unbalance of a rotor that runs up (the square of its frequency), a base's
displacement (two derivatives of it), straight lines between samples (no carrier), a pulse. In a
window all pieces are expanded around its centre on the carrier halfway between the lowest and the
highest frequency of the pieces that are not zero.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import jit, jit_allocating, jit_inline
from impact_env.kernels.motion.modal_system import cos_sin

TERMS = 9  # coefficients of the forced part's polynomials (forced.py)

Array = NDArray[np.float64]
CHIRP_REMAINDER = 1e-17  # of the force: Taylor remainder of its chirp at a window's end
# rad that a frequency turns against the carrier from a window's centre to its end: to the ninth
# power, over 9!, it is 5e-18
MOST_BEAT_PHASE = 0.049
BEAT_CURVATURE_PHASE = 1e-4  # rad that the rate of a frequency may add to that angle
# rad that the force turns from a window's centre to its end: rounding of time gives an error of
# this times 1e-16 in the forced part
MOST_PHASE = 300.0
EQUAL_LENGTH_TOL = 1e-4  # of the length of a section: sections closer than this are equally long
EQUAL_FREQUENCY_TOL = 1e-12  # of the highest frequency: closer frequencies count as one
# columns of `LoadPieces.pieces`: time at which a piece begins (s), its frequency there (rad/s), the
# rate of the frequency (rad/s^2), the phase (rad), and from POLYNOMIAL on real and imaginary part
# of c0, of c1 and of c2 (N or m/s^2, and per s and s^2)
BEGINS = 0
OMEGA = 1
ALPHA = 2
PHASE = 3
POLYNOMIAL = 4
NUMBERS = 10


class BaseParticipation(NamedTuple):
    """Participation of modes and of n absorbers in the accelerations of C bases.

    The first base is that of the scene. A force (N) at a further point of the structure with the
    mode shape p counts as one more base, with the participation -p and without absorbers.

    ``participation`` Gamma (C, N_m) in sqrt(kg); ``at_absorber`` (C,): displacement at the
    absorbers for a unit rigid motion of the base, 0 for a force; ``carried`` (C, n): each
    absorber's mass times ``at_absorber`` (kg), 0 without an absorber; ``moves``: whether any base
    moves, tested at run time, so that one kernel serves moving bases and bases at rest.
    """

    participation: Array
    at_absorber: Array
    carried: Array
    moves: bool


class LoadPieces(NamedTuple):
    """Loads that act together in a run; each load is a source.

    They are never written to, so that runs in several threads may share them.

    ``pieces`` (P, NUMBERS): pieces in rows, with columns BEGINS to POLYNOMIAL + 5. ``which``
    (K - 1, sources): row of ``pieces`` for each source in each section between K breakpoints.
    ``channel`` (sources,): 0 for a force (N) on the structure, c > 0 for the acceleration (m/s^2)
    of the base with the index c - 1, or for the force (N) that this base stands for. ``base``: the
    bases. Without sources the stepping methods apply the chirp of one force.
    """

    pieces: Array
    which: NDArray[np.int64]
    channel: NDArray[np.int64]
    base: BaseParticipation


class MovingBase(NamedTuple):
    """C bases with their `BaseParticipation` and scratch memory.

    ``terms`` (C, 2, TERMS): Taylor coefficients of their accelerations in the current window, as
    `LoadWorkspace.terms`; ``accelerations`` (C,): scratch, accelerations at one time (m/s^2).
    """

    terms: Array
    accelerations: Array
    participation: Array
    at_absorber: Array
    carried: Array
    moves: bool


class LoadWorkspace(NamedTuple):
    """`LoadPieces` with the scratch memory of one run.

    ``terms`` (2, TERMS): Taylor coefficients, real and imaginary, in the time from the centre of
    the current window, of half the complex force without its carrier. ``linear`` (1,): whether the
    load is a straight line in the current section and the section before was as long; only the real
    parts of the first two terms are not zero then. `expand_load` writes both.
    """

    pieces: Array
    which: NDArray[np.int64]
    channel: NDArray[np.int64]
    terms: Array
    base: MovingBase
    linear: NDArray[np.bool_]


class ForceWindow(NamedTuple):
    """A piece of a section, with the load expanded around one frequency.

    ``alpha`` and the force describe the chirp of one force. They are 0 if there are other loads,
    which are in ``load``.
    """

    centre: float  # s
    half: float  # half length (s)
    omega: float  # frequency of the carrier (rad/s)
    alpha: float  # rate of the frequency (rad/s^2)
    force_r: float  # force at the centre, real part (N)
    force_i: float  # imaginary part (N)
    load: LoadWorkspace | None = None  # with the terms of other loads; None: the chirp of one force


class Schedule(NamedTuple):
    """Breakpoints of the drive; a section lies between two of them.

    ``load`` None: the chirp of one force. With other loads, ``omegas``, ``phases`` and
    ``amplitude`` are not used.
    """

    times: Array  # (K,) s
    omegas: Array  # (K,) circular frequencies (rad/s)
    phases: Array  # (K,) of the force (rad)
    amplitude: float  # of the force (N)
    reach: float  # longest window (s)
    load: LoadPieces | None  # in kernels a `LoadWorkspace` (`copy_schedule`)


def _make_no_loads():
    """Return loads without sources: a run under the chirp of one force."""
    return LoadPieces(
        np.zeros((0, NUMBERS)),
        np.zeros((0, 0), np.int64),
        np.zeros(0, np.int64),
        BaseParticipation(np.zeros((1, 0)), np.zeros(1), np.zeros((1, 0)), False),
    )


NO_LOADS = _make_no_loads()
new_no_loads = jit_allocating(_make_no_loads)  # the same within a kernel


@jit_allocating
def new_load_workspace(pieces):
    """Return a `LoadWorkspace` for `LoadPieces`, None for None: the chirp of one force."""
    if pieces is None:
        return None
    base = pieces.base
    return LoadWorkspace(
        pieces.pieces,
        pieces.which,
        pieces.channel,
        np.zeros((2, TERMS)),
        MovingBase(
            np.zeros((base.at_absorber.shape[0], 2, TERMS)),
            np.zeros(base.at_absorber.shape[0]),
            base.participation,
            base.at_absorber,
            base.carried,
            base.moves,
        ),
        np.zeros(1, np.bool_),
    )


@jit_inline
def has_sources(load):
    """Return whether there are loads other than the chirp of one force."""
    return load.which.shape[1] > 0


@jit
def _is_nonzero(piece):
    """Return whether any coefficient of a piece's polynomial is not zero."""
    size = 0.0
    for n in range(POLYNOMIAL, NUMBERS):
        size += abs(piece[n])
    return size > 0.0


@jit
def is_linear_section(load, k):
    """Return whether all loads are straight lines in section ``k``."""
    for source in range(load.which.shape[1]):
        piece = load.pieces[load.which[k, source]]
        p = POLYNOMIAL
        turns = piece[OMEGA] != 0.0 or piece[ALPHA] != 0.0 or piece[PHASE] != 0.0
        if (
            turns
            or piece[p + 1] != 0.0
            or piece[p + 3] != 0.0
            or piece[p + 4] != 0.0
            or piece[p + 5] != 0.0
        ) and _is_nonzero(piece):
            return False
    return True


@jit
def find_frequency_band(load, k, t):
    """Return (low, high, rate) for the pieces of section ``k`` that are not zero.

    These are the lowest and highest frequency (rad/s) at time ``t`` (s of the run), and the largest
    magnitude of a frequency's rate (rad/s^2). All are 0 without such pieces.
    """
    low = np.inf
    high = 0.0
    rate = 0.0
    for source in range(load.which.shape[1]):
        piece = load.pieces[load.which[k, source]]
        if _is_nonzero(piece):
            omega = piece[OMEGA] + piece[ALPHA] * (t - piece[BEGINS])
            low = min(low, omega)
            high = max(high, omega)
            rate = max(rate, abs(piece[ALPHA]))
    return min(low, high), high, rate


@jit
def count_load_windows(load, times, k, reach):
    """Return the number of windows of section ``k``; ``times`` (K,) are the breakpoints (s).

    Windows are equally long, and at most ``reach`` (s).
    """
    duration = times[k + 1] - times[k]
    longest = reach
    spread = 0.0
    highest = 1e-300
    rate = 0.0
    if duration <= reach and is_linear_section(load, k):
        return 1
    for end in range(2):
        low, high, rate = find_frequency_band(load, k, times[k + end])
        spread = max(spread, 0.5 * (high - low))
        highest = max(highest, high)
    deflection = (120.0 * CHIRP_REMAINDER) ** 0.2
    if spread > EQUAL_FREQUENCY_TOL * highest:
        longest = min(longest, 2.0 * MOST_BEAT_PHASE / spread)
        deflection = BEAT_CURVATURE_PHASE
    if rate > 0.0:
        longest = min(longest, 2.0 * math.sqrt(2.0 * deflection / rate))
    longest = min(longest, 2.0 * MOST_PHASE / highest)
    return max(1, math.ceil(duration / longest * (1.0 - 1e-12)))


@jit
def _expand_piece(piece, t, carrier, terms):
    """Add half of a piece, expanded around time ``t`` (s), to ``terms`` (2, TERMS) in place.

    The terms are Taylor coefficients of the complex load without its ``carrier`` (rad/s).
    """
    u = t - piece[BEGINS]
    alpha = piece[ALPHA]
    delta = piece[OMEGA] + piece[ALPHA] * u - carrier
    phase = piece[PHASE] + (piece[OMEGA] + 0.5 * alpha * u) * u
    c = math.cos(phase)
    s = math.sin(phase)
    p = POLYNOMIAL
    factors_r = (
        piece[p] + (piece[p + 2] + piece[p + 4] * u) * u,
        piece[p + 2] + 2.0 * piece[p + 4] * u,
        piece[p + 4],
    )
    factors_i = (
        piece[p + 1] + (piece[p + 3] + piece[p + 5] * u) * u,
        piece[p + 3] + 2.0 * piece[p + 5] * u,
        piece[p + 5],
    )
    # y = exp(i (delta tau + alpha tau^2/2)): y' = i (delta + alpha tau) y
    e_r = 0.5 * c
    e_i = 0.5 * s
    old_r = 0.0
    old_i = 0.0
    for n in range(TERMS):
        for m in range(3):
            if n + m < TERMS:
                terms[0, n + m] += factors_r[m] * e_r - factors_i[m] * e_i
                terms[1, n + m] += factors_r[m] * e_i + factors_i[m] * e_r
        new_r = -(delta * e_i + alpha * old_i) / (n + 1)
        new_i = (delta * e_r + alpha * old_r) / (n + 1)
        old_r = e_r
        old_i = e_i
        e_r = new_r
        e_i = new_i


@jit
def compute_force(load, k, t):
    """Return the force on the structure (N) at time ``t`` (s of the run), in section ``k``.

    It is the sum of the sources of channel 0; bases and forces at further points are left out.
    """
    total = 0.0
    for source in range(load.which.shape[1]):
        piece = load.pieces[load.which[k, source]]
        if load.channel[source] == 0:
            u = t - piece[BEGINS]
            p = POLYNOMIAL
            phase = piece[PHASE] + (piece[OMEGA] + 0.5 * piece[ALPHA] * u) * u
            total += (piece[p] + (piece[p + 2] + piece[p + 4] * u) * u) * math.cos(phase)
            total -= (piece[p + 1] + (piece[p + 3] + piece[p + 5] * u) * u) * math.sin(phase)
    return total


@jit
def _add_linear_piece(piece, t, terms):
    """Add half of a straight line, expanded around time ``t`` (s), to ``terms`` in place."""
    terms[0, 0] += 0.5 * (piece[POLYNOMIAL] + piece[POLYNOMIAL + 2] * (t - piece[BEGINS]))
    terms[0, 1] += 0.5 * piece[POLYNOMIAL + 2]


@jit
def expand_load(load, times, k, t):
    """Expand the loads of section ``k`` around time ``t`` (s); return their carrier (rad/s).

    ``times`` (K,): breakpoints (s). Written: ``terms``, ``base.terms`` and ``linear`` of ``load``,
    a `LoadWorkspace`.
    """
    load.terms[:] = 0.0
    load.base.terms[:] = 0.0
    load.linear[0] = False
    if k > 0 and is_linear_section(load, k):  # and as long as the section before, as in a record
        change = abs(times[k + 1] - 2.0 * times[k] + times[k - 1])
        load.linear[0] = change <= EQUAL_LENGTH_TOL * (times[k + 1] - times[k])
    if load.linear[0]:
        for source in range(load.which.shape[1]):
            piece = load.pieces[load.which[k, source]]
            channel = load.channel[source]
            if channel > 0:
                _add_linear_piece(piece, t, load.base.terms[channel - 1])
            else:
                _add_linear_piece(piece, t, load.terms)
        return 0.0
    low, high, _ = find_frequency_band(load, k, t)
    carrier = high if high - low <= EQUAL_FREQUENCY_TOL * high else 0.5 * (low + high)
    for source in range(load.which.shape[1]):
        piece = load.pieces[load.which[k, source]]
        if _is_nonzero(piece):
            channel = load.channel[source]
            if channel > 0:
                _expand_piece(piece, t, carrier, load.base.terms[channel - 1])
            else:
                _expand_piece(piece, t, carrier, load.terms)
    return carrier


@jit
def evaluate_load(terms, omega, tau):
    """Return the load (N or m/s^2) at the time ``tau`` (s) from the window's centre.

    ``terms`` (2, TERMS) are its Taylor coefficients, ``omega`` is their carrier (rad/s).
    """
    c, s = cos_sin(omega * tau)
    x = 0.0
    y = 0.0
    for m in range(TERMS):
        n = TERMS - 1 - m
        x = x * tau + terms[0, n]
        y = y * tau + terms[1, n]
    return 2.0 * (x * c - y * s)


@jit_allocating
def copy_schedule(schedule):
    """Return the schedule with a new `LoadWorkspace`, which no other run writes."""
    return Schedule(
        schedule.times,
        schedule.omegas,
        schedule.phases,
        schedule.amplitude,
        schedule.reach,
        new_load_workspace(schedule.load),
    )


@jit
def count_windows(schedule, k):
    """Return the number of windows of section k of the schedule.

    A window's length is limited by ``schedule.reach``, by CHIRP_REMAINDER and by MOST_PHASE.
    """
    load = schedule.load
    if load is not None:
        return count_load_windows(load, schedule.times, k, schedule.reach)
    duration = schedule.times[k + 1] - schedule.times[k]
    alpha = abs(schedule.omegas[k + 1] - schedule.omegas[k]) / duration
    longest = schedule.reach
    if alpha > 0.0:
        longest = min(longest, 2.0 * np.sqrt(2.0 * (120.0 * CHIRP_REMAINDER) ** 0.2 / alpha))
    longest = min(
        longest, 2.0 * MOST_PHASE / max(schedule.omegas[k], schedule.omegas[k + 1], 1e-300)
    )
    return max(1, int(np.ceil(duration / longest * (1.0 - 1e-12))))


@jit
def expand_window(schedule, k, w, count):
    """Return the `ForceWindow` of number w of the ``count`` windows of section k.

    The terms of loads other than a chirp are written to ``schedule.load``; they hold until the next
    window is expanded.
    """
    duration = schedule.times[k + 1] - schedule.times[k]
    load = schedule.load
    if load is not None:
        centre = schedule.times[k] + duration * (w + 0.5) / count
        return ForceWindow(
            centre,
            0.5 * duration / count,
            expand_load(load, schedule.times, k, centre),
            0.0,
            0.0,
            0.0,
            load,
        )
    alpha = (schedule.omegas[k + 1] - schedule.omegas[k]) / duration
    x = duration * (w + 0.5) / count
    phase = schedule.phases[k] + (schedule.omegas[k] + 0.5 * alpha * x) * x
    a = schedule.amplitude
    return ForceWindow(
        schedule.times[k] + x,
        0.5 * duration / count,
        schedule.omegas[k] + alpha * x,
        alpha,
        a * math.cos(phase),
        a * math.sin(phase),
        None,
    )
