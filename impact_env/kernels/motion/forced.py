"""The forced response in one window, exact up to a bounded Taylor remainder.

Around a window's centre the swept force is Re(F exp(i phi + i Omega tau) exp(i alpha tau^2/2)). The
last factor is expanded to alpha^4; its remainder is below (alpha tau^2/2)^5/120, and the windows
are cut so that this is below CHIRP_REMAINDER. The particular solution of a modal amplitude is then
A(tau) exp(i Omega tau) + B(tau) exp(-i Omega tau) with polynomials A, B of degree 8 (TERMS
coefficients, alpha^4 tau^8), found by back-substitution. Other loads (loads.py) are such
polynomials on a common carrier, too.

In: a regime's `ModalSystem` and a window of the load. Out: `Forced`, the polynomials of the modal
amplitudes, of the tip displacement and of the guard signal with its derivatives and bounds. The
loops over the amplitudes are vector code (vector_code.py), which sees all arrays flat.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import (
    NUMBER,
    jit,
    jit_allocating,
    jit_inline,
    jit_separate,
    vector_code,
)
from impact_env.kernels.compiling.vector_code import Code, Complex, Index, Number
from impact_env.kernels.motion.loads import TERMS
from impact_env.kernels.motion.modal_system import BASE, DRIVE, GUARD, POINTS, TIP, S, cos_sin

SCAN_TERMS = 7  # coefficients of a polynomial that the event search sums in a block
# of |i Omega - s| times half the window, below which a polynomial is solved from its lowest
# coefficient upwards
NEAR_RESONANCE = 0.05
DERIVATIVES = 6  # bounds: of the guard signal and of its first five derivatives
SCANNED = 3  # the guard signal and its first two derivatives, which the event search scans
SIGNALS = (2, TERMS, 2, 4)  # shape of Forced.signals
BOUND_REACH = 1.25  # times half a window: distance from the centre up to which bounds hold
# numbers of the signals in Forced.signals: the guard signal and its derivatives, of which the scan
# reads 0 to 2 as one vector, the tip displacement, and as number 7 the displacement that a moving
# base gives a free absorber
GUARD_SIGNALS = (0, 1, 2, 4, 5, 6)
TIP_SIGNAL = 3
THIRD, FOURTH, FIFTH = GUARD_SIGNALS[3:]


class UnitResponses(NamedTuple):
    """A regime's forced responses to n unit loads without a carrier (unit_loads.py).

    The unit loads are a constant and the time from the window's centre, first as forces, then as
    the accelerations of each of C bases that move: n = 2 + 2 C.
    """

    polynomials: NDArray[np.float64]  # (n, 2, TERMS, J) A, which B equals
    signals: NDArray[np.float64]  # (n, 2, TERMS, 2, 4) as `Forced.signals`
    bound: NDArray[np.float64]  # (n, DERIVATIVES + SCANNED) as `Forced.bound`
    coefficients: NDArray[np.float64]  # (n,) of the load in a window
    half: NDArray[np.float64]  # (1,) longest half window of the bounds (s); 0: not solved yet
    # (n + 1, 2, J) map over a step: [0] factor of the amplitudes, [1 + n] addition by unit load n
    step_map: NDArray[np.float64]
    step_length: NDArray[np.float64]  # (1,) of the step map (s); 0: not computed yet


class Forced(NamedTuple):
    """One regime's forced response in one window.

    The polynomials of modal amplitudes are A and B; those of signals are factors of exp(i Omega
    tau). The coefficients of signal m, real and imaginary, are signals[m // 4, :, :, m % 4].
    """

    polynomials: NDArray[np.float64]  # (4, TERMS, J) A and B, real and imaginary in turn
    # (2, TERMS, 2, 4) of guard signal, derivatives, tip displacement and base motion
    signals: NDArray[np.float64]
    # (DERIVATIVES + SCANNED,) bounds up to BOUND_REACH half windows from the centre: of the guard
    # signal and its first five derivatives, then, of the SCANNED ones among them, of the terms
    # beyond SCAN_TERMS
    bound: NDArray[np.float64]
    # (L, 2, POINTS) exp(i Omega k h_L), k = 1 ... POINTS, for the levels of `ModalSystem`; a level
    # that is not computed yet begins with NaN
    carrier: NDArray[np.float64]
    # (2, TERMS) Taylor coefficients in tau of half the complex force without its carrier
    terms: NDArray[np.float64]
    unit_responses: UnitResponses | None  # where the load is linear in a window; None: a chirp


def coefficient_index(m: Any, n: int, part: int) -> Any:
    """Return the index of coefficient n of signal m in the flat array `Forced.signals`.

    ``part`` selects its real (0) or imaginary (1) part.
    """
    return (m >> 2) * (8 * TERMS) + (m & 3) + (8 * n + 4 * part)


def _spread_pair(
    code: Code, array: Any, at: Any, distance: Any, sign: Number | None = None
) -> Complex:
    """Return the complex number in array[at] and array[at + distance], as vectors.

    Its imaginary part is multiplied by ``sign``.
    """
    imag = code.number(array, at + distance)
    return Complex(
        code.spread(code.number(array, at)), code.spread(imag if sign is None else imag * sign)
    )


def _write_back_substitution(
    code: Code, rows: Any, size: Any, omega: Any, sign: Any, driven: Any, at: Any, out: Any
) -> None:
    """Write the code of `back_substitute`, from the highest coefficient down.

    ``driven``: for each load a pair of its row of unit responses and its terms (2, TERMS).
    """
    turn = omega * sign
    plane = size * TERMS
    for j in code.vectors(size):
        s_r, s_i = (code.vector(rows, size * row + j) for row in (S, S + 1))
        drives = []
        for row, _ in driven:
            drives.append(Complex(*(code.vector(rows, size * (row + part) + j) for part in (0, 1))))
        l_r = -s_r
        l_i = code.spread(turn) - s_i
        scale = code.repeated(1.0) / l_r.fma(l_r, l_i.fma(l_i, code.repeated(1e-300)))
        inverse = Complex(l_r * scale, -(l_i * scale))
        place = plane * at + j
        solved = None
        for n in range(TERMS - 1, -1, -1):
            shares = [
                drive.times(_spread_pair(code, terms, n, TERMS, sign))
                for drive, (_, terms) in zip(drives, driven, strict=True)
            ]
            x = shares[0]
            for share in shares[1:]:
                x = Complex(x.real + share.real, x.imag + share.imag)
            if solved is not None:
                factor = code.repeated(-(n + 1.0))
                x = Complex(factor.fma(solved.real, x.real), factor.fma(solved.imag, x.imag))
            solved = x.times(inverse)
            here = place + size * n
            code.store_complex(solved, out, here, here + plane)


@vector_code()
def back_substitute(
    code: Code, rows, size: Index, omega: Number, sign: Number, terms, at: Index, out
):
    """Solve P' + (i sign Omega - s) P = drive * terms for each modal amplitude's polynomial P.

    The real part of P is written to out[at], the imaginary part to out[at + 1], each (TERMS, J).
    ``terms`` (2, TERMS): of the force; ``sign`` 1 gives A, -1 with the conjugate terms B.
    """
    _write_back_substitution(code, rows, size, omega, sign, ((DRIVE, terms),), at, out)


@vector_code()
def back_substitute_both(
    code: Code, rows, size: Index, omega: Number, sign: Number, terms, base, at: Index, out
):
    """Solve as `back_substitute` does for a force and a base that moves.

    ``terms`` (2, TERMS) are those of the force, ``base`` (2, TERMS) those of the base, whose unit
    response is in row BASE.
    """
    _write_back_substitution(code, rows, size, omega, sign, ((DRIVE, terms), (BASE, base)), at, out)


@vector_code()
def back_substitute_all(
    code: Code,
    rows,
    size: Index,
    omega: Number,
    sign: Number,
    terms,
    count: Index,
    bases,
    at: Index,
    out,
):
    """Solve as `back_substitute_both` does for a force and ``count`` bases.

    ``terms`` are those of the force, ``bases`` (count, 2, TERMS) those of the bases, whose rows
    start at BASE.
    """
    plane = size * TERMS
    for j in code.vectors(size):
        s_r, s_i = (code.vector(rows, size * row + j) for row in (S, S + 1))
        l_r = -s_r
        l_i = code.spread(omega * sign) - s_i
        scale = code.repeated(1.0) / l_r.fma(l_r, l_i.fma(l_i, code.repeated(1e-300)))
        inverse = Complex(l_r * scale, -(l_i * scale))
        drive = code.complex(rows, size * DRIVE + j, size * (DRIVE + 1) + j)
        place = plane * at + j
        solved = None
        for n in range(TERMS - 1, -1, -1):
            driven = drive.times(_spread_pair(code, terms, n, TERMS, sign))
            real = code.sum(code.lanes)
            imag = code.sum(code.lanes)
            real += driven.real
            imag += driven.imag
            for c in code.loop(count):
                row = size * (c * 2 + BASE) + j
                share = code.complex(rows, row, row + size).times(
                    _spread_pair(code, bases, c * (2 * TERMS) + n, TERMS, sign)
                )
                real += share.real
                imag += share.imag
            x = Complex(real.number(), imag.number())
            if solved is not None:
                factor = code.repeated(-(n + 1.0))
                x = Complex(factor.fma(solved.real, x.real), factor.fma(solved.imag, x.imag))
            solved = x.times(inverse)
            here = place + size * n
            code.store_complex(solved, out, here, here + plane)


@vector_code()
def combine_signal(code: Code, rows, row: Index, size: Index, system, signals, at: Index):
    """Write the coefficients of a signal to number ``at`` of ``signals``.

    They are the sum of w A + conj(w B) with the complex weights w in ``row`` and the next row.
    ``system`` (4, TERMS, J): the polynomials A and B (`Forced.polynomials`).
    """
    plane = size * TERMS
    sums = [(code.sum(), code.sum()) for _ in range(TERMS)]
    for j in code.vectors(size):
        place = size * row + j
        weight = code.complex(rows, place, place + size)
        for n in range(TERMS):
            here = size * n + j
            a_r, a_i, b_r, b_i = (code.vector(system, plane * k + here) for k in range(4))
            sums[n][0].add_product(weight.real, a_r + b_r)
            sums[n][0].add_product(-weight.imag, a_i + b_i)
            sums[n][1].add_product(weight.real, a_i - b_i)
            sums[n][1].add_product(weight.imag, a_r - b_r)
    for n in range(TERMS):
        for part in (0, 1):
            code.put(sums[n][part].total(), signals, coefficient_index(at, n, part))


@vector_code()
def add_polynomials(code: Code, system, size: Index, tau: Number, c: Number, s: Number, z):
    """Add (c + i s) A(tau) + (c - i s) B(tau) to z (2, J) in place.

    ``system`` (4, TERMS, J): the polynomials A and B (`Forced.polynomials`).
    """
    plane = size * TERMS
    for j in code.vectors(size):
        x, cos, sin = (code.spread(number) for number in (tau, c, s))
        parts = []
        for k in range(4):
            first = plane * k + j
            total = code.vector(system, first + size * (TERMS - 1))
            for n in range(TERMS - 2, -1, -1):
                total = total.fma(x, code.vector(system, first + size * n))
            parts.append(total)
        a_r, a_i, b_r, b_i = parts
        old = code.complex(z, j, j + size)
        real = (b_i - a_i).fma(sin, (a_r + b_r).fma(cos, old.real))
        imag = (a_r - b_r).fma(sin, (a_i + b_i).fma(cos, old.imag))
        code.store_complex(Complex(real, imag), z, j, j + size)


@vector_code(NUMBER)
def evaluate_polynomial(code: Code, signals, m: Index, tau: Number, c: Number, s: Number):
    """Return Re((c + i s) p(tau)) with the polynomial p of signal ``m``."""
    parts = []
    for part in (0, 1):
        total = code.number(signals, coefficient_index(m, TERMS - 1, part))
        for n in range(TERMS - 2, -1, -1):
            total = total.fma(tau, code.number(signals, coefficient_index(m, n, part)))
        parts.append(total)
    return parts[0].fma(c, -(parts[1] * s))


@vector_code(NUMBER, 3)
def evaluate_first_signals(code: Code, signals, tau: Number, c: Number, s: Number):
    """Return Re((c + i s) p(tau)) with the polynomials p of the signals 0, 1 and 2."""
    tau = code.spread(tau)
    totals = []
    for part in (0, 1):
        total = code.vector(signals, coefficient_index(0, TERMS - 1, part))
        for n in range(TERMS - 2, -1, -1):
            total = total.fma(tau, code.vector(signals, coefficient_index(0, n, part)))
        totals.append(total)
    both = totals[0].fma(code.spread(c), -(totals[1] * code.spread(s)))
    return both.elements()[:3]


@vector_code()
def sum_state(code: Code, out, count: Index, size: Index, z, state):
    """Write state (count,) = Re(out z), with the map ``out`` (2, count, J) and z (2, J)."""
    plane = count * size
    for i in code.loop(count):
        total = code.sum()
        first = i * size
        for j in code.vectors(size):
            at = first + j
            total += code.complex(z, j, j + size).real_of_product(code.complex(out, at, at + plane))
        code.put(total.total(), state, i)


@vector_code()
def sum_amplitudes_of_state(code: Code, into, count: Index, size: Index, state, z):
    """Write z (2, J) = into^T state, with the map ``into`` (2, count, J) and state (count,)."""
    plane = count * size
    for j in code.vectors(size):
        real, imag = (code.sum(code.lanes) for _ in range(2))
        for i in code.loop(count):
            at = i * size + j
            number = code.spread(code.number(state, i))
            real.add_product(code.vector(into, at), number)
            imag.add_product(code.vector(into, at + plane), number)
        code.store_complex(Complex(real.number(), imag.number()), z, j, j + size)


@jit
def add_base_drive(base, rows, j, row, sign, n, x_r, x_i):
    """Return (x_r, x_i) plus the drive of amplitude ``j`` by the bases' accelerations, term ``n``.

    The response to a unit acceleration of the first base is in ``row`` and the next row; those to
    further bases follow. ``sign`` -1 takes the conjugate terms.
    """
    if not base.moves:
        return x_r, x_i
    for c in range(base.terms.shape[0]):
        t_r = base.terms[c, 0, n]
        t_i = sign * base.terms[c, 1, n]
        d_r = rows[row + 2 * c, j]
        d_i = rows[row + 2 * c + 1, j]
        x_r = x_r + d_r * t_r - d_i * t_i
        x_i = x_i + d_r * t_i + d_i * t_r
    return x_r, x_i


@jit_allocating
def new_unit_responses(load, size):
    """Return memory for the `UnitResponses` of ``size`` amplitudes, None for the chirp."""
    if load is None:
        return None
    # a constant and a line, of the force and of each base that moves
    base = load.base
    n = 2 + 2 * base.terms.shape[0] if base.moves else 2
    polynomials = np.zeros((n, 2, TERMS, size))
    signals = np.zeros((n, *SIGNALS))
    bound = np.zeros((n, DERIVATIVES + SCANNED))
    leap = np.zeros((n + 1, 2, size))
    return UnitResponses(polynomials, signals, bound, np.zeros(n), np.zeros(1), leap, np.zeros(1))


@jit_allocating
def new_forced(system, load):
    """Return memory for the forced response of a regime under a load, None: under a chirp."""
    size = system.rows.shape[1]
    levels = system.steps.shape[0]
    signals = np.zeros(SIGNALS)
    bound = np.zeros(DERIVATIVES + SCANNED)
    carrier = np.zeros((levels, 2, POINTS))
    return Forced(
        np.zeros((4, TERMS, size)),
        signals,
        bound,
        carrier,
        np.zeros((2, TERMS)),
        new_unit_responses(load, size),
    )


@jit
def compute_force_terms(window, terms):
    """Write the Taylor terms of the force in a window to ``terms`` (`Forced.terms`).

    The terms of a chirp have even powers only.
    """
    load = window.load
    if load is not None:
        for n in range(TERMS):
            terms[0, n], terms[1, n] = load.terms[0, n], load.terms[1, n]
        return
    c_r = 0.5 * window.force_r
    c_i = 0.5 * window.force_i
    terms[0, 0] = c_r
    terms[1, 0] = c_i
    for m in range(1, 5):
        factor = 0.5 * window.alpha / m
        c_r, c_i = -c_i * factor, c_r * factor
        terms[0, 2 * m] = c_r
        terms[1, 2 * m] = c_i


@jit_separate
def forward_substitute(rows, j, window, sign, terms, at, out):
    """Solve the equation of `back_substitute` for one modal amplitude near resonance.

    Arguments as there, and ``j``: number of the amplitude. Back-substitution would divide by almost
    zero.
    """
    load = window.load
    l_r = -rows[S, j]
    l_i = sign * window.omega - rows[S + 1, j]
    p_r = 0.0
    p_i = 0.0
    for n in range(TERMS):
        out[at, n, j] = p_r
        out[at + 1, n, j] = p_i
        t_r = terms[0, n]
        t_i = sign * terms[1, n]
        x_r = rows[DRIVE, j] * t_r - rows[DRIVE + 1, j] * t_i - (l_r * p_r - l_i * p_i)
        x_i = rows[DRIVE, j] * t_i + rows[DRIVE + 1, j] * t_r - (l_r * p_i + l_i * p_r)
        if load is not None:
            x_r, x_i = add_base_drive(load.base, rows, j, BASE, sign, n, x_r, x_i)
        p_r = x_r / (n + 1)
        p_i = x_i / (n + 1)


@jit_separate
def _differentiate_signal(omega, signals, start, at):
    """Write the derivative p' + i omega p of signal number ``start`` to signal number ``at``."""
    for n in range(TERMS):
        d_r = -omega * signals[start // 4, n, 1, start % 4]
        d_i = omega * signals[start // 4, n, 0, start % 4]
        if n + 1 < TERMS:
            d_r += (n + 1) * signals[start // 4, n + 1, 0, start % 4]
            d_i += (n + 1) * signals[start // 4, n + 1, 1, start % 4]
        signals[at // 4, n, 0, at % 4] = d_r
        signals[at // 4, n, 1, at % 4] = d_i


@jit_separate
def _fill_bounds(signals, reach, bound):
    """Fill `Forced.bound` for times up to ``reach`` (s) from the window's centre."""
    for m in range(DERIVATIVES):
        whole = 0.0
        rest = 0.0
        power = 1.0
        for n in range(TERMS):
            at = GUARD_SIGNALS[m]
            size = (
                abs(signals[at // 4, n, 0, at % 4]) + abs(signals[at // 4, n, 1, at % 4])
            ) * power
            whole += size
            if n >= SCAN_TERMS:
                rest += size
            power *= reach
        bound[m] = whole
        if m < SCANNED:
            bound[DERIVATIVES + m] = rest


@jit
def fill_carrier(steps, omega, level, carrier):
    """Fill `Forced.carrier` of one level if it is not computed yet: a search needs few levels."""
    if not np.isnan(carrier[level, 0, 0]):
        return
    c, s = cos_sin(omega * steps[level, 0])
    x = 1.0
    y = 0.0
    for k in range(POINTS):
        x, y = x * c - y * s, x * s + y * c
        carrier[level, 0, k] = x
        carrier[level, 1, k] = y


@jit_separate
def _solve_polynomials(rows, window, sign, terms, at, out):
    """Write the polynomials A (``sign`` 1) or B (-1) of all modal amplitudes to ``out``.

    ``at``: 0 for A, 2 for B, as in `Forced.polynomials`.

    Back-substitution divides by the difference between modal amplitude and carrier. Amplitudes near
    resonance are solved again by forward substitution.
    """
    size = rows.shape[1]
    omega = window.omega
    load = window.load
    if load is None:
        back_substitute(rows, size, omega, sign, terms, at, out)
    else:
        base = load.base
        if not base.moves:
            back_substitute(rows, size, omega, sign, terms, at, out)
        elif base.terms.shape[0] == 1:
            back_substitute_both(rows, size, omega, sign, terms, base.terms, at, out)
        else:
            count = base.terms.shape[0]
            back_substitute_all(rows, size, omega, sign, terms, count, base.terms, at, out)
    limit = NEAR_RESONANCE / window.half
    for j in range(size):
        if abs(rows[S, j]) < limit and abs(sign * omega - rows[S + 1, j]) < limit:
            forward_substitute(rows, j, window, sign, terms, at, out)


@jit_separate
def solve_response(system, window, forced):
    """Fill ``forced`` for a window: terms, polynomials of the amplitudes, and the tip signal.

    A regime without guards needs nothing else.
    """
    compute_force_terms(window, forced.terms)
    _solve_polynomials(system.rows, window, 1.0, forced.terms, 0, forced.polynomials)
    _solve_polynomials(system.rows, window, -1.0, forced.terms, 2, forced.polynomials)
    solve_tip_signal(system, forced)


@jit
def solve_forced(system, window, absorber_mass, forced):
    """Fill ``forced``, a regime's forced response in a window, with the guard signal.

    ``absorber_mass`` None: the guard signal is a displacement with the weights in row GUARD. A
    number (kg): it is the joint force (N), this mass times the tip acceleration, whose direct share
    of the force only the displacement's derivatives contain.
    """
    solve_response(system, window, forced)
    solve_guard(system, window, absorber_mass, forced)


@jit_separate
def solve_tip_signal(system, forced):
    """Fill the signal TIP_SIGNAL, the displacement with the weights in row TIP (m)."""
    combine_signal(
        system.rows, TIP, system.rows.shape[1], forced.polynomials, forced.signals, TIP_SIGNAL
    )


@jit_separate
def integrate_base(window, forced):
    """Fill signal 7, the displacement Y (m) that moving bases give a free absorber.

    Y'' = -r a_b, with the acceleration a_b of a base and r its ``at_absorber``, is integrated twice
    by P' + i Omega P = F, the equation of `back_substitute` with s = 0. Where Omega is small the
    polynomial is solved from its lowest coefficient upwards. `compute_base_motion` uses this
    signal.
    """
    load = window.load
    if load is None:
        return
    base = load.base
    if not base.moves:
        return
    omega = window.omega
    signals = forced.signals
    for n in range(TERMS):
        for part in range(2):
            signals[1, n, part, 3] = -2.0 * base.at_absorber[0] * base.terms[0, part, n]
            for c in range(1, base.terms.shape[0]):
                signals[1, n, part, 3] -= 2.0 * base.at_absorber[c] * base.terms[c, part, n]
    for _ in range(2):
        if omega * window.half < NEAR_RESONANCE:
            p_r = 0.0
            p_i = 0.0
            for n in range(TERMS):
                x_r = signals[1, n, 0, 3] + omega * p_i
                x_i = signals[1, n, 1, 3] - omega * p_r
                signals[1, n, 0, 3] = p_r
                signals[1, n, 1, 3] = p_i
                p_r = x_r / (n + 1)
                p_i = x_i / (n + 1)
        else:
            p_r = 0.0
            p_i = 0.0
            for m in range(TERMS):
                n = TERMS - 1 - m
                x_r = signals[1, n, 0, 3] - (n + 1) * p_r
                x_i = signals[1, n, 1, 3] - (n + 1) * p_i
                p_r = x_i / omega
                p_i = -x_r / omega
                signals[1, n, 0, 3] = p_r
                signals[1, n, 1, 3] = p_i


@jit
def compute_base_motion(load, signals, omega, tau):
    """Return displacement (m) and velocity (m/s) that a moving base gives a free absorber.

    ``signals``: `Forced.signals`; ``tau``: time from the window's centre (s). Both are 0 if the
    base is at rest.
    """
    if load is None:
        return 0.0, 0.0
    if not load.base.moves:
        return 0.0, 0.0
    c, s = cos_sin(omega * tau)
    x = 0.0
    y = 0.0
    dx = 0.0
    dy = 0.0
    for m in range(TERMS):
        n = TERMS - 1 - m
        dx = dx * tau + x
        dy = dy * tau + y
        x = x * tau + signals[1, n, 0, 3]
        y = y * tau + signals[1, n, 1, 3]
    dx = dx - omega * y
    dy = dy + omega * x
    return x * c - y * s, dx * c - dy * s


@jit
def _add_base_inertia(base, mass, signals):
    """Add m_a a_base, the absorber's inertia under moving bases, to signal 0, the joint force."""
    if base.moves:
        for c in range(base.terms.shape[0]):
            for n in range(TERMS):
                for part in range(2):
                    inertia = 2.0 * mass * base.at_absorber[c] * base.terms[c, part, n]
                    signals[0, n, part, 0] += inertia


@jit_separate
def solve_guard(system, window, absorber_mass, forced):
    """Fill the guard signal, its derivatives and bounds, after `solve_response`.

    ``absorber_mass`` as in `solve_forced`. The carriers of the levels are marked as not computed.
    """
    signals = forced.signals
    load = window.load
    if absorber_mass is None:
        combine_signal(system.rows, GUARD, system.rows.shape[1], forced.polynomials, signals, 0)
        integrate_base(window, forced)
        if load is not None:
            if load.base.moves:
                for n in range(TERMS):
                    for part in range(2):
                        signals[0, n, part, 0] += signals[1, n, part, 3]
    else:
        _differentiate_signal(window.omega, signals, TIP_SIGNAL, 1)
        _differentiate_signal(window.omega, signals, 1, 0)
        for n in range(TERMS):
            signals[0, n, 0, 0] *= absorber_mass
            signals[0, n, 1, 0] *= absorber_mass
        if load is not None:
            _add_base_inertia(load.base, absorber_mass, signals)
    for m in range(1, DERIVATIVES):
        _differentiate_signal(window.omega, signals, GUARD_SIGNALS[m - 1], GUARD_SIGNALS[m])
    # the last step of a search may begin in the window and end beyond it: by a quarter of its half,
    # or by the finest step where that is longer
    _fill_bounds(
        signals, max(BOUND_REACH * window.half, window.half + system.steps[0, 0]), forced.bound
    )
    for level in range(system.steps.shape[0]):
        forced.carrier[level, 0, 0] = np.nan


@jit_inline
def evaluate_signal(signals, m, omega, tau):
    """Return signal number m at the time ``tau`` (s) from the window's centre.

    It is Re(p(tau) exp(i omega tau)) with the polynomial p of the signal.
    """
    c, s = cos_sin(omega * tau)
    return evaluate_polynomial(signals, m, tau, c, s)


@jit_separate
def add_forced(polynomials, omega, tau, factor, z):
    """Add factor * (A exp(i omega tau) + B exp(-i omega tau)), the forced part, to z in place.

    z (2, J) are modal amplitudes at the time ``tau`` (s) from the window's centre; a factor of -1
    leaves their free part.
    """
    c, s = cos_sin(omega * tau)
    add_polynomials(polynomials, z.shape[1], tau, c * factor, s * factor, z)
