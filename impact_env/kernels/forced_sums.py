"""Loops over a regime's slots that its forced part and its maps need, and the forced part's polynomials, as vector code (vector_code.py).

Arrays are seen flat: ``rows`` (29, size) of `slots.Slots`, ``slots`` (4, TERMS, size) and ``signals`` (2, TERMS, 2, 4) of `forced.Forced`, amplitudes
``z`` (2, size), maps ``out`` and ``into`` (2, count, size) of `segments.Regime`. Signal m has the coefficients signals[m // 4, :, :, m % 4].
"""

from __future__ import annotations

from typing import Any

from numba.core import types
from numba.extending import intrinsic

from impact_env.kernels.slot_sums import INTEGER, NUMBER
from impact_env.kernels.vector import TERMS, signal_place
from impact_env.kernels.vector_code import Code, Complex, Number, Sum

_DRIVE = 4  # row of Slots.rows


def _spread_pair(code: Code, array: Any, at: Any, distance: Any, sign: Number | None = None) -> Complex:
    imag = code.number(array, code.plus(at, distance))
    return Complex(code.spread(code.number(array, at)), code.spread(imag if sign is None else imag * sign))


@intrinsic
def back_substitute(typing_context, rows, size, omega, sign, terms, at, out):  # type: ignore[no-untyped-def]
    """Solve P' + (i sign Omega - s) P = drive * terms for polynomials P, slot by slot, into out[at], out[at + 1].

    ``terms`` (2, TERMS); ``sign`` -1 takes the conjugate terms.
    """

    def build(context, builder, signature, values):  # type: ignore[no-untyped-def]
        code = Code(context, builder, signature.args, values)
        rows, size, omega, sign, terms, at, out = code.arguments
        sign = Number(builder, sign)
        turn, plane = Number(builder, omega) * sign, code.times(size, TERMS)
        for j in code.slots(size):
            s_r, s_i, d_r, d_i = (code.vector(rows, code.plus(code.times(size, row), j)) for row in (0, 1, _DRIVE, _DRIVE + 1))
            drive, l_r, l_i = Complex(d_r, d_i), -s_r, code.spread(turn) - s_i
            scale = code.repeated(1.0) / l_r.fma(l_r, l_i.fma(l_i, code.repeated(1e-300)))
            inverse = Complex(l_r * scale, -(l_i * scale))
            place = code.plus(code.times(plane, at), j)
            solved = None
            for n in range(TERMS - 1, -1, -1):
                x = drive.times(_spread_pair(code, terms, n, TERMS, sign))
                if solved is not None:
                    factor = code.repeated(-(n + 1.0))
                    x = Complex(factor.fma(solved.real, x.real), factor.fma(solved.imag, x.imag))
                solved = x.times(inverse)
                here = code.plus(place, code.times(size, n))
                code.store_complex(solved, out, here, code.plus(here, plane))
        return context.get_dummy_value()

    return types.void(rows, INTEGER, NUMBER, NUMBER, terms, INTEGER, out), build


@intrinsic
def combine(typing_context, rows, row, size, slots, signals, at):  # type: ignore[no-untyped-def]
    """Write the coefficients of the signal with the weights w in ``row`` to signals[at]: sum of w A + conj(w B)."""

    def build(context, builder, signature, values):  # type: ignore[no-untyped-def]
        code = Code(context, builder, signature.args, values)
        rows, row, size, slots, signals, at = code.arguments
        plane = code.times(size, TERMS)
        sums = [(code.sum(), code.sum()) for _ in range(TERMS)]
        for j in code.slots(size):
            place = code.plus(code.times(size, row), j)
            weight = code.complex(rows, place, code.plus(place, size))
            for n in range(TERMS):
                here = code.plus(code.times(size, n), j)
                a_r, a_i, b_r, b_i = (code.vector(slots, code.plus(code.times(plane, k), here)) for k in range(4))
                sums[n][0].add_product(weight.real, a_r + b_r)
                sums[n][0].add_product(-weight.imag, a_i + b_i)
                sums[n][1].add_product(weight.real, a_i - b_i)
                sums[n][1].add_product(weight.imag, a_r - b_r)
        for n in range(TERMS):
            for part in (0, 1):
                code.put(sums[n][part].total(), signals, signal_place(code, at, n, part))
        return context.get_dummy_value()

    return types.void(rows, INTEGER, INTEGER, slots, signals, INTEGER), build


@intrinsic
def add_response(typing_context, slots, size, tau, c, s, z):  # type: ignore[no-untyped-def]
    """Add (c + i s) A(tau) + (c - i s) B(tau) to z."""

    def build(context, builder, signature, values):  # type: ignore[no-untyped-def]
        code = Code(context, builder, signature.args, values)
        slots, size, tau, c, s, z = code.arguments
        plane = code.times(size, TERMS)
        for j in code.slots(size):
            (x, cos, sin), parts = (code.spread(number) for number in (tau, c, s)), []
            for k in range(4):
                first = code.plus(code.times(plane, k), j)
                total = code.vector(slots, code.plus(first, code.times(size, TERMS - 1)))
                for n in range(TERMS - 2, -1, -1):
                    total = total.fma(x, code.vector(slots, code.plus(first, code.times(size, n))))
                parts.append(total)
            a_r, a_i, b_r, b_i = parts
            old = code.complex(z, j, code.plus(j, size))
            real = (b_i - a_i).fma(sin, (a_r + b_r).fma(cos, old.real))
            imag = (a_r - b_r).fma(sin, (a_i + b_i).fma(cos, old.imag))
            code.store_complex(Complex(real, imag), z, j, code.plus(j, size))
        return context.get_dummy_value()

    return types.void(slots, INTEGER, NUMBER, NUMBER, NUMBER, z), build


@intrinsic
def polynomial_value(typing_context, signals, m, tau, c, s):  # type: ignore[no-untyped-def]
    """Return Re((c + i s) polynomial(tau)) of signal ``m``."""

    def build(context, builder, signature, values):  # type: ignore[no-untyped-def]
        code = Code(context, builder, signature.args, values)
        signals, m, tau, c, s = code.arguments
        tau, parts = Number(builder, tau), []
        for part in (0, 1):
            total = code.number(signals, signal_place(code, m, TERMS - 1, part))
            for n in range(TERMS - 2, -1, -1):
                total = total.fma(tau, code.number(signals, signal_place(code, m, n, part)))
            parts.append(total)
        return parts[0].fma(Number(builder, c), -(parts[1] * Number(builder, s))).value

    return NUMBER(signals, INTEGER, NUMBER, NUMBER, NUMBER), build


@intrinsic
def first_values(typing_context, signals, tau, c, s):  # type: ignore[no-untyped-def]
    """Return Re((c + i s) polynomial(tau)) of the signals 0, 1 and 2."""

    def build(context, builder, signature, values):  # type: ignore[no-untyped-def]
        code = Code(context, builder, signature.args, values)
        signals, tau, c, s = code.arguments
        tau, totals = code.spread(tau), []
        for part in (0, 1):
            total = code.vector(signals, signal_place(code, 0, TERMS - 1, part))
            for n in range(TERMS - 2, -1, -1):
                total = total.fma(tau, code.vector(signals, signal_place(code, 0, n, part)))
            totals.append(total)
        both = totals[0].fma(code.spread(c), -(totals[1] * code.spread(s)))
        return code.result(signature, context, both.elements()[:3])

    return types.UniTuple(NUMBER, 3)(signals, NUMBER, NUMBER, NUMBER), build


@intrinsic
def state_of_slots(typing_context, out, count, size, z, state):  # type: ignore[no-untyped-def]
    """Write state = Re(out z), ``count`` numbers."""

    def build(context, builder, signature, values):  # type: ignore[no-untyped-def]
        code = Code(context, builder, signature.args, values)
        out, count, size, z, state = code.arguments
        plane = code.times(count, size)
        with code.loop(count) as i:
            total, first = code.sum(), code.times(i, size)
            for j in code.slots(size):
                at = code.plus(first, j)
                total += code.complex(z, j, code.plus(j, size)).real_of_product(code.complex(out, at, code.plus(at, plane)))
            code.put(total.total(), state, i)
        return context.get_dummy_value()

    return types.void(out, INTEGER, INTEGER, z, state), build


@intrinsic
def slots_of_state(typing_context, into, count, size, state, z):  # type: ignore[no-untyped-def]
    """Write z = into^T state, from ``count`` numbers."""

    def build(context, builder, signature, values):  # type: ignore[no-untyped-def]
        code = Code(context, builder, signature.args, values)
        into, count, size, state, z = code.arguments
        plane = code.times(count, size)
        for j in code.slots(size):
            real, imag = (Sum(code, (code.lanes,)) for _ in range(2))
            with code.loop(count) as i:
                at, number = code.plus(code.times(i, size), j), code.spread(code.number(state, i))
                real.add_product(code.vector(into, at), number)
                imag.add_product(code.vector(into, code.plus(at, plane)), number)
            code.store_complex(Complex(real.number(), imag.number()), z, j, code.plus(j, size))
        return context.get_dummy_value()

    return types.void(into, INTEGER, INTEGER, state, z), build
