"""Loops over a regime's modal amplitudes, as vector code (vector_code.py).

They serve the regime's forced part, the polynomials of the forced part, and the regime's maps.

Arrays are seen flat: ``rows`` (ROWS, size) of `modal_system.ModalSystem`, ``system`` (4, TERMS,
size) and ``signals`` (2, TERMS, 2, 4) of `forced.Forced`, amplitudes ``z`` (2, size), maps ``out``
and ``into`` (2, count, size) of `segments.LinearRegime`. Signal m has the coefficients signals[m //
4, :, :, m % 4].
"""

from __future__ import annotations

from typing import Any

from impact_env.kernels.compiling.jit import NUMBER, vector_code
from impact_env.kernels.compiling.vector_code import Code, Complex, Index, Number
from impact_env.kernels.motion.modal_rows import BASE, DRIVE, S
from impact_env.kernels.motion.search_block import TERMS, coefficient_index


def _spread_pair(
    code: Code, array: Any, at: Any, distance: Any, sign: Number | None = None
) -> Complex:
    imag = code.number(array, at + distance)
    return Complex(
        code.spread(code.number(array, at)), code.spread(imag if sign is None else imag * sign)
    )


def _solve_down(
    code: Code, rows: Any, size: Any, omega: Any, sign: Any, driven: Any, at: Any, out: Any
) -> None:
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
    """Solve for the polynomials P of each modal amplitude, into out[at], out[at + 1].

    The equation is P' + (i sign Omega - s) P = drive * terms.

    ``terms`` (2, TERMS); ``sign`` -1 takes the conjugate terms.
    """
    _solve_down(code, rows, size, omega, sign, ((DRIVE, terms),), at, out)


@vector_code()
def back_substitute_both(
    code: Code, rows, size: Index, omega: Number, sign: Number, terms, base, at: Index, out
):
    """Solve as `back_substitute` does for a force and a base that moves.

    ``terms`` are those of the force, ``base`` those of the base, which has its own response.
    """
    _solve_down(code, rows, size, omega, sign, ((DRIVE, terms), (BASE, base)), at, out)


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
            own = drive.times(_spread_pair(code, terms, n, TERMS, sign))
            real = code.sum(code.lanes)
            imag = code.sum(code.lanes)
            real += own.real
            imag += own.imag
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
    """Write the coefficients of a signal to signals[at].

    They are the sum of w A + conj(w B) with the weights w in ``row``.
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
    """Add (c + i s) A(tau) + (c - i s) B(tau) to z."""
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
    """Return Re((c + i s) polynomial(tau)) of signal ``m``."""
    parts = []
    for part in (0, 1):
        total = code.number(signals, coefficient_index(m, TERMS - 1, part))
        for n in range(TERMS - 2, -1, -1):
            total = total.fma(tau, code.number(signals, coefficient_index(m, n, part)))
        parts.append(total)
    return parts[0].fma(c, -(parts[1] * s))


@vector_code(NUMBER, 3)
def evaluate_first_signals(code: Code, signals, tau: Number, c: Number, s: Number):
    """Return Re((c + i s) polynomial(tau)) of the signals 0, 1 and 2."""
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
    """Write state = Re(out z), ``count`` numbers."""
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
    """Write z = into^T state, from ``count`` numbers."""
    plane = count * size
    for j in code.vectors(size):
        real, imag = (code.sum(code.lanes) for _ in range(2))
        for i in code.loop(count):
            at = i * size + j
            number = code.spread(code.number(state, i))
            real.add_product(code.vector(into, at), number)
            imag.add_product(code.vector(into, at + plane), number)
        code.store_complex(Complex(real.number(), imag.number()), z, j, j + size)
