"""A smooth segment of motion between two events, and its samples.

In: a regime with its maps (`LinearRegime`), its forced response in a window, and the free part of
the modal amplitudes where the segment begins. Out: the tip displacement and the states at the
samples, for the observers. From one sample to the next, modal amplitudes and the force's phasor are
multiplied by fixed factors.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import jit, jit_allocating, jit_inline, vector_code
from impact_env.kernels.compiling.vector_code import Code, Complex, Index, Number
from impact_env.kernels.motion.forced import (
    TIP_SIGNAL,
    Forced,
    add_forced,
    coefficient_index,
    compute_base_motion,
    evaluate_signal,
    solve_forced,
    sum_amplitudes_of_state,
    sum_state,
)
from impact_env.kernels.motion.loads import TERMS, ForceWindow
from impact_env.kernels.motion.modal_system import (
    REST,
    TIP,
    ModalSystem,
    Propagator,
    add_weighted,
    apply_weights,
    copy_amplitudes,
    cos_sin,
    propagate,
    split_time,
    sum_amplitudes,
)
from impact_env.kernels.motion.observers import push_sample, push_samples
from impact_env.kernels.motion.unit_loads import combine_unit_responses

MOST_SINGLE_SAMPLES = 3  # samples up to which each is evaluated for itself
SAMPLES_AT_ONCE = 8  # samples that are computed at once


class SampleTimes(NamedTuple):
    """Times of equidistant samples, and their positions in the block of a level."""

    offset: float  # time of the first sample from the start of a segment (s)
    x: float  # time of the first sample from the window's centre (s)
    interval: float  # time between two samples (s)
    first: int  # position of the first sample in the block
    number: int  # number of samples


Array = NDArray[np.float64]
SAMPLE_TIME_TOL = 1e-12  # of the sampling interval


class LinearRegime(NamedTuple):
    """A modal system with its maps to and from the state.

    The state has modal displacements, displacement of the absorber, modal velocities, velocity of
    the absorber; n absorbers have n displacements and n velocities, 2 N_m + 2 n numbers in all. The
    maps have real and imaginary parts: state = Re(out Z), Z = into^T state.
    """

    system: ModalSystem  # of the modal amplitudes Z (J,)
    out: Array  # (2, 2 N_m + 2, J)
    into: Array  # (2, 2 N_m + 2, J)
    tip_rest: float  # displacement of the tip under a unit constant relative force (m/N)


class Losses(NamedTuple):
    """Constants of a scene for the energy balance."""

    force_shape: Array  # (N_m,) mode shapes at the force (1/sqrt(kg))
    tip_shape: Array  # (N_m,) mode shapes at the tip (1/sqrt(kg))
    rate: Array  # (N_m,) 2 D omega (1/s)
    damper: float  # of the tuned absorber (N s/m); 0 without


class Buffers(NamedTuple):
    """Scratch memory of a run with J modal amplitudes."""

    z: Array  # (2, J) free part of the amplitudes
    u: Array  # (2, J) amplitudes of a signal
    rows: Array  # (2, 2, J) for the observers


class Segment(NamedTuple):
    """A smooth piece of motion without events, for the observers."""

    regime: LinearRegime  # of the segment
    forced: Forced  # forced response in its window
    window: ForceWindow  # the segment's; its centre is the origin of tau and end
    buffers: Buffers  # ``z`` is the free part at tau
    constant: float  # constant relative force, factor of row REST (N)
    deflection: float  # of the tip under this force (m)
    motion: NDArray[Any]  # (n,) ABSORBER_MOTION records, added to the state for each absorber
    tau: float  # start (s)
    end: float  # s


def _compute_powers(factor: Complex, one: Complex) -> list[Complex]:
    """Return factor^0 ... factor^SAMPLES_AT_ONCE.

    Each power is the product of two powers of about half its exponent, so that rounding errors do
    not accumulate.
    """
    powers = [one, factor]
    for k in range(2, SAMPLES_AT_ONCE + 1):
        powers.append(powers[k // 2].times(powers[k - k // 2]))
    return powers


def _put_in_block(
    code: Code, numbers: list[Number], block: Any, place: Any, left: Any, fresh: bool
) -> None:
    """Add SAMPLES_AT_ONCE numbers to the block from position ``place`` on.

    ``fresh``: they are written instead. Only the first ``left`` numbers are used if that is fewer;
    otherwise one instruction stores all.
    """
    for whole in code.either(left >= SAMPLES_AT_ONCE):
        if whole:
            vector = code.gather(numbers)
            code.store(
                vector if fresh else vector + code.vector(block, place, SAMPLES_AT_ONCE),
                block,
                place,
            )
        else:
            for k, number in enumerate(numbers):
                for _ in code.where(left > k, likely=True):
                    at = place + k
                    code.put(number if fresh else number + code.number(block, at), block, at)


@vector_code()
def _fill_forced_part(
    code: Code,
    signals,
    tau: Number,
    interval: Number,
    c: Number,
    s: Number,
    turn_c: Number,
    turn_s: Number,
    rest: Number,
    block,
    first: Index,
    count: Index,
):
    """Write ``rest`` plus the forced tip displacement (m) at ``count`` samples to the block.

    The first sample, at the time ``tau`` (s) from the window's centre, goes to position ``first``.
    c + i s is the force's phasor at ``tau``, which is multiplied by the phasor ``turn_c`` + i
    ``turn_s`` from sample to sample.
    """
    one = Complex(code.repeated(1.0, 0), code.repeated(0.0, 0))
    *powers, block_factor = _compute_powers(Complex(turn_c, turn_s), one)
    turn = Complex(code.gather([p.real for p in powers]), code.gather([p.imag for p in powers]))
    phasor = [code.variable(part) for part in (c, s)]
    steps = code.constant(range(SAMPLES_AT_ONCE))
    for k in code.loop(count, SAMPLES_AT_ONCE):
        current = Complex(*(part.value for part in phasor))
        here = Complex(
            code.spread(current.real, SAMPLES_AT_ONCE), code.spread(current.imag, SAMPLES_AT_ONCE)
        ).times(turn)
        number = code.spread(code.as_number(k), SAMPLES_AT_ONCE) + steps
        x = number.fma(code.spread(interval, SAMPLES_AT_ONCE), code.spread(tau, SAMPLES_AT_ONCE))
        parts = []
        for part in (0, 1):
            total = code.spread(
                code.number(signals, coefficient_index(TIP_SIGNAL, TERMS - 1, part)),
                SAMPLES_AT_ONCE,
            )
            for n in range(TERMS - 2, -1, -1):
                total = total.fma(
                    x,
                    code.spread(
                        code.number(signals, coefficient_index(TIP_SIGNAL, n, part)),
                        SAMPLES_AT_ONCE,
                    ),
                )
            parts.append(total)
        values = Complex(*parts).real_of_product(here) + code.spread(rest, SAMPLES_AT_ONCE)
        _put_in_block(code, values.elements(), block, first + k, count - k, True)
        for place, moved in zip(phasor, current.times(block_factor), strict=True):
            place.value = moved


@vector_code()
def _add_amplitudes(
    code: Code,
    rows,
    table,
    size: Index,
    base: Index,
    d1: Index,
    d2: Index,
    d3: Index,
    x: Number,
    h1: Index,
    h2: Index,
    h3: Index,
    h: Number,
    u,
    block,
    first: Index,
    count: Index,
):
    """Add the sum of Re(u exp(s t)) at ``count`` samples to the block, from ``first`` on.

    The first sample has the offset d1, d2, d3, x, and the step between two samples is h1, h2, h3,
    h, both as `split_time` returns them.
    """
    start, step = (
        Propagator(code, rows, table, size, base, place)
        for place in ([d1, d2, d3, x], [h1, h2, h3, h])
    )
    for j in code.vectors(size):
        amplitude = start.turned(u, j)
        *powers, block_factor = _compute_powers(
            step.factor(j), Complex(code.repeated(1.0), code.repeated(0.0))
        )
        turning = [code.variable(part) for part in amplitude]
        for k in code.loop(count, SAMPLES_AT_ONCE):
            current = Complex(*(part.value for part in turning))
            sums = [current.real_of_product(power).total() for power in powers]
            _put_in_block(code, sums, block, first + k, count - k, False)
            for place, moved in zip(turning, current.times(block_factor), strict=True):
                place.value = moved


@jit
def fill_samples(system, signals, omega, u, rest, samples, block):
    """Write the tip displacement (m) at ``samples``, a `SampleTimes`, to ``block``.

    ``u`` (2, J): contributions of the free amplitudes to the tip displacement at the segment's
    start; ``signals``: `Forced.signals`; ``omega``: carrier (rad/s); ``rest`` (m): constant part.
    From sample to sample modal amplitudes and force turn by fixed factors, whose rounding stays
    below 1e-16 times their number.
    """
    rows = system.rows
    table = system.table
    scale = system.scale
    offset = samples.offset
    x = samples.x
    interval = samples.interval
    first = samples.first
    count = samples.number
    if count <= MOST_SINGLE_SAMPLES:
        for k in range(count):
            t = k * interval
            block[first + k] = (
                sum_amplitudes(rows, table, scale, u, offset + t)
                + evaluate_signal(signals, TIP_SIGNAL, omega, x + t)
                + rest
            )
        return
    c, s = cos_sin(omega * x)
    turn_c, turn_s = cos_sin(omega * interval)
    _fill_forced_part(signals, x, interval, c, s, turn_c, turn_s, rest, block, first, count)
    d1, d2, d3, d = split_time(scale, offset)
    h1, h2, h3, h = split_time(scale, interval)
    _add_amplitudes(
        rows,
        table,
        rows.shape[1],
        table.shape[2],
        d1,
        d2,
        d3,
        d,
        h1,
        h2,
        h3,
        h,
        u,
        block,
        first,
        count,
    )


@jit_allocating
def new_buffers(size):
    """Return `Buffers` for regimes of ``size`` modal amplitudes."""
    return Buffers(np.zeros((2, size)), np.zeros((2, size)), np.zeros((2, 2, size)))


@jit
def compute_state(out, z, state):
    """Write state (n,) = Re(out z), with z (2, J)."""
    sum_state(out, state.shape[0], z.shape[1], z, state)


@jit
def compute_amplitudes(into, state, z):
    """Write z (2, J) = into^T state, with state (n,)."""
    sum_amplitudes_of_state(into, state.shape[0], z.shape[1], state, z)


@jit
def count_samples_before(end, interval):
    """Return how many of the times 0, interval, 2 interval, ... (s) are before ``end``, as a float.

    A time equal to ``end`` within rounding is not counted.
    """
    return max(np.ceil(end / interval - SAMPLE_TIME_TOL), 0.0)


@jit_inline
def sample_level(segment, clock, level):
    """Add the displacement at the samples in [tau, end) of a segment to the level, if there is one.

    It is the displacement of the tip, or of the level's ``place`` if this is given. ``clock.level``
    advances, and ``segment.buffers.u`` and ``rows`` are overwritten.
    """
    if level is None:
        return
    system = segment.regime.system
    signals = segment.forced.signals
    window = segment.window
    tau = segment.tau
    end = segment.end
    n = clock.level
    interval = clock.interval
    u = segment.buffers.u
    if n * interval - window.centre >= end:
        return
    stop = count_samples_before(end + window.centre, interval)
    if stop <= n:
        return
    apply_weights(system.rows, TIP, segment.buffers.z, u)
    while n < stop:
        first = n % level.block.shape[0]
        count = min(int(stop - n), level.block.shape[0] - first)
        x = n * interval - window.centre
        samples = SampleTimes(max(x - tau, 0.0), x, interval, first, count)
        if level.place.shape[0] == 0:
            fill_samples(system, signals, window.omega, u, segment.deflection, samples, level.block)
        else:
            sample_place(segment, level.place, samples, level.block)
        push_samples(level, first, count)
        n += count
    clock.level = n


@jit_inline
def is_observed(window, clock, level, series, energy):
    """Return whether level, series or energies need the motion within a window."""
    if energy is not None:
        return True
    if series is not None:
        if series.states.shape[0] > 0:
            return True
    if level is not None:
        if level.place.shape[0] + level.envelope.low.shape[0] > 0:
            return True
        return clock.level * clock.interval - window.centre < window.half
    return False


@jit
def sample_place(segment, place, samples, block):
    """Write the displacement (m) at the mode shape ``place`` (N_m,) at ``samples`` to ``block``."""
    system = segment.regime.system
    out = segment.regime.out
    w = segment.buffers.rows[0]
    for k in range(samples.number):
        t = samples.offset + k * samples.interval
        copy_amplitudes(segment.buffers.z, w)
        propagate(system.rows, system.table, system.scale, t, w)
        add_forced(segment.forced.polynomials, segment.window.omega, segment.tau + t, 1.0, w)
        add_weighted(system.rows, REST, segment.constant, w)
        q = 0.0
        for i in range(place.shape[0]):
            for j in range(w.shape[1]):
                q += place[i] * (out[0, i, j] * w[0, j] - out[1, i, j] * w[1, j])
        block[samples.first + k] = q


@jit
def compute_state_at(segment, z, tau, offset, w, state):
    """Write the state at tau + offset (s), from the free part z (2, J) at tau.

    Both times are within the segment. The state is that of the regime's map, without
    ``segment.motion``. w (2, J) is scratch.
    """
    system = segment.regime.system
    copy_amplitudes(z, w)
    propagate(system.rows, system.table, system.scale, offset, w)
    add_forced(segment.forced.polynomials, segment.window.omega, tau + offset, 1.0, w)
    add_weighted(system.rows, REST, segment.constant, w)
    compute_state(segment.regime.out, w, state)


@jit_inline
def sample_state(segment, clock, series):
    """Write the states at the samples in [tau, end) of a segment, if states are recorded.

    ``clock.series`` advances.
    """
    if series is None:
        return
    if series.states.shape[0] > 0:
        _write_states(segment, clock, series)


@jit
def _write_states(segment, clock, series):
    """Write the states as `sample_state` does, to the rows of ``series.states``."""
    window = segment.window
    tau = segment.tau
    end = segment.end
    motion = segment.motion
    buffers = segment.buffers
    n = clock.series
    interval = clock.interval
    x = n * interval - window.centre
    half = series.states.shape[1] // 2
    absorbers = motion.shape[0]
    stop = clock.first + series.states.shape[0]
    while x < end and n < stop:
        t = max(x - tau, 0.0)
        row = series.states[n - clock.first]
        compute_state_at(segment, buffers.z, tau, t, buffers.rows[0], row)
        for a in range(absorbers):
            absorber = motion[a]
            row[half - absorbers + a] += absorber.q + t * (absorber.v + 0.5 * t * absorber.a)
            row[2 * half - absorbers + a] += absorber.v + t * absorber.a
        add_base_motion_to_state(segment, tau + t, row)
        n += 1
        x = n * interval - window.centre
    clock.series = n


@jit_inline
def add_base_motion_to_state(segment, tau, state):
    """Add the motion that moving bases give free absorbers at ``tau`` (s) to ``state`` in place."""
    load = segment.window.load
    if load is not None:
        q, v = compute_base_motion(load, segment.forced.signals, segment.window.omega, tau)
        motion = segment.motion
        n = motion.shape[0]
        half = state.shape[0] // 2
        for a in range(n):
            state[half - n + a] += motion[a].base_share * q
            state[2 * half - n + a] += motion[a].base_share * v


@jit
def take_last_sample(state, tip_shape, end, clock, level, series):
    """Add the state at the run's end ``end`` (s) to level and series, if a sample is due there.

    A sample is due within rounding of its time. ``level`` and ``series`` may be None.
    """
    interval = clock.interval
    if series is not None:
        n = clock.series
        row = n - clock.first
        if row < series.states.shape[0] and abs(n * interval - end) < 1e-6 * interval:
            for i in range(state.shape[0]):
                series.states[row, i] = state[i]
    if level is not None:
        if abs(clock.level * interval - end) < 1e-6 * interval:
            if level.place.shape[0] == 0:
                push_sample(level, compute_displacement(tip_shape, state))
            else:
                push_sample(level, compute_displacement(level.place, state))


@jit
def compute_displacement(shape, state):
    """Return the displacement (m) at the point with the mode shape ``shape`` (N_m,)."""
    q = 0.0
    for i in range(shape.shape[0]):
        q += shape[i] * state[i]
    return q


@jit_inline
def update_forced_response(system, window, absorber_mass, forced):
    """Fill ``forced``, a regime's forced response in a window; arguments as in `solve_forced`.

    It is computed from unit responses if the load is linear, and otherwise as in `solve_forced`.
    """
    load = window.load
    if load is not None:
        if combine_unit_responses(load, system, window, absorber_mass, True, forced):
            return
    solve_forced(system, window, absorber_mass, forced)
