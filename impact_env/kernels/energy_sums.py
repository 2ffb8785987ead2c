"""Loops over slots and over velocities that the energies of a stretch need, as vector code (vector_code.py).

Arrays are seen flat: ``rows`` (29, size) of `slots.Slots`, ``slots`` (4, TERMS, size) of `forced.Forced`, slots ``z`` and ``w`` (2, size) at begin
and end of a stretch, ``scratch`` (ROWS, WIDTH) of `energy_account.Account`. What a slot does in powers of time is two polynomials A and B, one on the
force's carrier, one on its conjugate, or two series of moments; ``powers`` (4, TERMS, size) holds Re (A + B), Im (A - B), Re (A - B) and Im (A + B),
so that v A + conj(v B) takes four products. ``shape`` holds the weights v of slots in velocities, ``partner`` (2, TERMS, size) the velocities'
forced parts as factors of the carrier.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from impact_env.kernels.energy_moments import CARRIER, ENDS, FACTORS, FORCE, POWER, PRODUCTS, WIDTH
from impact_env.kernels.slot_sums import INTEGER, NUMBER
from impact_env.kernels.vector import TERMS
from impact_env.kernels.vector_code import INDEX, Code, Complex, Number, Sum

NEGLIGIBLE = 1e-17  # coefficients below this share of the largest one are left out


def _store_powers(code: Code, up: Complex, down: Complex, powers: Any, at: Any, plane: Any) -> None:
    for k, part in enumerate((up.real + down.real, up.imag - down.imag, up.real - down.real, up.imag + down.imag)):
        code.store(part, powers, code.plus(at, code.times(plane, k)))


@intrinsic
def forced_powers(typing_context, slots, size, half, powers):  # type: ignore[no-untyped-def]
    """Write the forced part of all slots to ``powers``, in powers of the time in half windows."""

    def build(context, builder, signature, values):  # type: ignore[no-untyped-def]
        code = Code(context, builder, signature.args, values)
        slots, size, half, powers = code.arguments
        plane = code.times(size, TERMS)
        for j in code.fours(size):
            scale = code.repeated(1.0)
            for n in range(TERMS):
                at = code.plus(code.times(size, n), j)
                a_r, a_i, b_r, b_i = (code.vector(slots, code.plus(at, code.times(plane, k))) * scale for k in range(4))
                _store_powers(code, Complex(a_r, a_i), Complex(b_r, b_i), powers, at, plane)
                scale *= code.spread(half)
        return context.get_dummy_value()

    return types.void(slots, INTEGER, NUMBER, powers), build


@intrinsic
def slot_moments(typing_context, rows, size, omega, half, scratch, z, w, powers):  # type: ignore[no-untyped-def]
    """Write to ``powers`` the integrals of x^k y over a stretch: x the time in half windows, y a slot times the carrier, or its conjugate.

    They are divided by the difference of slot and carrier; where it is almost zero they are to be mended.
    """

    def build(context, builder, signature, values):  # type: ignore[no-untyped-def]
        code = Code(context, builder, signature.args, values)
        rows, size, omega, half, scratch, z, w, powers = code.arguments
        plane, inverse_half = code.times(size, TERMS), code.repeated(1.0, 0) / Number(builder, half)
        ends = [[code.number(scratch, (ENDS + end) * WIDTH + k) for k in range(TERMS)] for end in range(2)]
        for j in code.fours(size):
            s_r, s_i = code.vector(rows, j), code.vector(rows, code.plus(size, j))
            slots = [code.complex(y, j, code.plus(size, j)) for y in (z, w)]
            sides = []
            for sign in (1.0, -1.0):
                l_i = code.spread(omega).fma(code.repeated(sign), s_i)
                scale = code.repeated(1.0) / s_r.fma(s_r, l_i.fma(l_i, code.repeated(1e-300)))
                turns = [Complex(*(code.spread(code.number(scratch, CARRIER * WIDTH + 2 * end + part)) for part in range(2))) for end in range(2)]
                both = [y.times(Complex(turn.real, turn.imag * code.repeated(sign))) for y, turn in zip(slots, turns, strict=True)]
                sides.append((Complex(s_r * scale, -(l_i * scale)), *both))
            moments = []
            for k in range(TERMS):
                p, q = (code.spread(end[k]) for end in ends)
                found = []
                for side, (inverse, first, last) in enumerate(sides):
                    x = [b.fma(q, -(a * p)) for a, b in zip(first, last, strict=True)]
                    if k > 0:
                        factor = code.spread(inverse_half * code.repeated(-float(k), 0))
                        x = [factor.fma(old, new) for old, new in zip(moments[side], x, strict=True)]
                    found.append(Complex(*x).times(inverse))
                moments = found
                _store_powers(code, *moments, powers, code.plus(code.times(size, k), j), plane)
        return context.get_dummy_value()

    return types.void(rows, INTEGER, NUMBER, NUMBER, scratch, z, w, powers), build


def _own_velocities(code: Code, shape: Any, size: Any, powers: Any) -> Iterator[tuple[Any, list[Complex]]]:
    """Repeat what follows for some slots each, with their velocities' powers; ``shape`` (2, size): each slot is a mode."""
    plane = code.times(size, TERMS)
    for j in code.fours(size):
        weight, velocities = code.complex(shape, j, code.plus(size, j)), []
        for n in range(TERMS):
            at = code.plus(code.times(size, n), j)
            p_r, p_i, m_r, m_i = (code.vector(powers, code.plus(at, code.times(plane, k))) for k in range(4))
            velocities.append(Complex(weight.real.fma(p_r, -(weight.imag * m_i)), weight.real.fma(p_i, weight.imag * m_r)))
        yield j, velocities


def _velocities(code: Code, shape: Any, size: Any, powers: Any) -> Iterator[tuple[Any, list[Complex]]]:
    """Repeat what follows for some columns each, with their velocities' powers; ``shape`` (2, size, size)."""
    plane = code.times(size, TERMS)
    for i in code.fours(size):
        sums = [[Sum(code, (code.lanes,)) for _ in range(2)] for _ in range(TERMS)]
        with code.loop(size) as j:
            at = code.plus(code.times(size, j), i)
            weight = code.complex(shape, at, code.plus(at, code.times(size, size)))
            minus = -weight.imag
            for n, (real, imag) in enumerate(sums):
                here = code.plus(code.times(size, n), j)
                p_r, p_i, m_r, m_i = (code.spread(code.number(powers, code.plus(here, code.times(plane, k)))) for k in range(4))
                real.add_product(weight.real, p_r)
                real.add_product(minus, m_i)
                imag.add_product(weight.real, p_i)
                imag.add_product(weight.imag, m_r)
        yield i, [Complex(real.number(), imag.number()) for real, imag in sums]


def _partners(coupled: bool) -> Any:
    def partners(typing_context, shape, size, powers, partner):  # type: ignore[no-untyped-def]
        def build(context, builder, signature, values):  # type: ignore[no-untyped-def]
            code = Code(context, builder, signature.args, values)
            shape, size, powers, partner = code.arguments
            walk = _velocities(code, shape, size, powers) if coupled else _own_velocities(code, shape, size, powers)
            for i, velocities in walk:
                for n, velocity in enumerate(velocities):
                    at = code.plus(code.times(size, n), i)
                    code.store_complex(velocity, partner, at, code.plus(at, code.times(size, TERMS)))
            return context.get_dummy_value()

        return types.void(shape, INTEGER, powers, partner), build

    partners.__doc__ = "Write the velocities' forced parts to ``partner``; ``powers``: of the slots' forced parts."
    return intrinsic(partners)


def _mixed(coupled: bool) -> Any:
    def mixed(typing_context, shape, size, powers, partner, found):  # type: ignore[no-untyped-def]
        def build(context, builder, signature, values):  # type: ignore[no-untyped-def]
            code = Code(context, builder, signature.args, values)
            shape, size, powers, partner, found = code.arguments
            walk = _velocities(code, shape, size, powers) if coupled else _own_velocities(code, shape, size, powers)
            for i, velocities in walk:
                total = code.vector(found, i)
                for n, velocity in enumerate(velocities):
                    at = code.plus(code.times(size, n), i)
                    other = code.complex(partner, at, code.plus(at, code.times(size, TERMS)))
                    total = other.real.fma(velocity.real, (-other.imag).fma(velocity.imag, total))
                code.store(total, found, i)
            return context.get_dummy_value()

        return types.void(shape, INTEGER, powers, partner, found), build

    mixed.__doc__ = "Add the integrals of the velocities' free parts times their partners to ``found`` (size,); ``powers``: the slots' moments."
    return intrinsic(mixed)


own_partners, coupled_partners = _partners(False), _partners(True)
own_mixed, coupled_mixed = _mixed(False), _mixed(True)


@intrinsic
def mixed_power(typing_context, point, size, powers, scratch):  # type: ignore[no-untyped-def]
    """Return the integral of the force times the free velocity of its point; ``point`` (2, size): weights."""

    def build(context, builder, signature, values):  # type: ignore[no-untyped-def]
        code = Code(context, builder, signature.args, values)
        point, size, powers, scratch = code.arguments
        total = Sum(code, (code.lanes,))
        for _, velocities in _own_velocities(code, point, size, powers):
            for n in range(0, TERMS, 2):
                total.add_product(code.spread(code.number(scratch, WIDTH * FORCE + n)), velocities[n].real)
                total.add_product(-code.spread(code.number(scratch, WIDTH * (FORCE + 1) + n)), velocities[n].imag)
        return total.total().value

    return NUMBER(point, INTEGER, powers, scratch), build


@intrinsic
def square_partners(typing_context, partner, size, products):  # type: ignore[no-untyped-def]
    """Write half the squares of ``partner`` to ``products`` (3, PRODUCTS, size), and return how many powers of them count.

    They are sums of products of real parts, of imaginary parts, and of real with imaginary parts.
    """

    def build(context, builder, signature, values):  # type: ignore[no-untyped-def]
        code = Code(context, builder, signature.args, values)
        partner, size, products = code.arguments
        order = cgutils.alloca_once_value(builder, ir.Constant(INDEX, 1))
        for i in code.fours(size):
            reals, imags = ([code.vector(partner, code.plus(code.times(size, TERMS * part + n), i)) for n in range(TERMS)] for part in range(2))
            amounts = []
            for p in range(PRODUCTS):
                found = [_half_square(code, reals, p), _half_square(code, imags, p), _product(reals, imags, p)]
                for k, sum_ in enumerate(found):
                    code.store(sum_, products, code.plus(code.times(size, PRODUCTS * k + p), i))
                amounts.append(found[0].size() + found[1].size() + found[2].size())
            largest = amounts[0]
            for amount in amounts[1:]:
                largest = largest.largest(amount)
            least = largest * code.repeated(NEGLIGIBLE)
            for p in range(1, PRODUCTS):
                none = builder.icmp_unsigned("==", (amounts[p] - least).not_positive(), ir.Constant(INDEX, 2**code.lanes - 1))
                old = builder.load(order)
                more = builder.icmp_signed(">", ir.Constant(INDEX, p + 1), old)
                builder.store(builder.select(builder.and_(builder.not_(none), more), ir.Constant(INDEX, p + 1), old), order)
        return builder.load(order)

    return INTEGER(partner, INTEGER, products), build


@intrinsic
def power_of_point(typing_context, point, size, powers, terms, half, scratch):  # type: ignore[no-untyped-def]
    """Write half the force, in powers of the time in half windows, and its products with the forced velocity of its point to ``scratch``.

    ``point`` (2, size): weights; ``powers``: of the slots' forced parts; ``terms`` (2, TERMS) of `forced.Forced`.
    """

    def build(context, builder, signature, values):  # type: ignore[no-untyped-def]
        code = Code(context, builder, signature.args, values)
        point, size, powers, terms, half, scratch = code.arguments
        sums = [(Sum(code, (code.lanes,)), Sum(code, (code.lanes,))) for _ in range(TERMS)]
        for _, velocities in _own_velocities(code, point, size, powers):
            for (real, imag), velocity in zip(sums, velocities, strict=True):
                real += velocity.real
                imag += velocity.imag
        velocity = [Complex(real.total(), imag.total()) for real, imag in sums]
        scale, square, driven = code.repeated(1.0, 0), Number(builder, half) * Number(builder, half), {}
        for n in range(0, TERMS, 2):
            driven[n] = Complex(*(code.number(terms, TERMS * part + n) * scale for part in range(2)))
            for part in range(2):
                code.put(driven[n][part], scratch, WIDTH * (FORCE + part) + n)
            scale *= square
        for p in range(PRODUCTS):
            places = [n for n in driven if 0 <= p - n < TERMS]
            for k, pairs in enumerate((((0, 0),), ((1, 1),), ((0, 1), (1, 0)))):
                total = code.repeated(0.0, 0)
                for one, other in pairs:
                    for n in places:
                        total = driven[n][one].fma(velocity[p - n][other], total)
                code.put(total, scratch, WIDTH * (POWER + k) + p)
        return context.get_dummy_value()

    return types.void(point, INTEGER, powers, terms, NUMBER, scratch), build


def _half_square(code: Code, numbers: list[Number], p: int) -> Number:
    """Return the coefficient of power p of half the square of a polynomial."""
    total = None
    for k in range(max(0, p - TERMS + 1), (p + 1) // 2):
        total = numbers[k] * numbers[p - k] if total is None else numbers[k].fma(numbers[p - k], total)
    if p % 2 == 1:
        assert total is not None
        return total
    half = numbers[p // 2] * code.repeated(0.5)
    return half * numbers[p // 2] if total is None else half.fma(numbers[p // 2], total)


def _product(one: list[Number], other: list[Number], p: int) -> Number:
    """Return the coefficient of power p of the product of two polynomials."""
    places = range(max(0, p - TERMS + 1), min(p, TERMS - 1) + 1)
    total = one[places[0]] * other[p - places[0]]
    for k in places[1:]:
        total = one[k].fma(other[p - k], total)
    return total


@intrinsic
def add_products(typing_context, products, size, count, scratch, found):  # type: ignore[no-untyped-def]
    """Write the integrals of half the squares of all partners to ``found`` (size,), from ``count`` powers."""

    def build(context, builder, signature, values):  # type: ignore[no-untyped-def]
        code = Code(context, builder, signature.args, values)
        products, size, count, scratch, found = code.arguments
        for i in code.fours(size):
            sums = [Sum(code, (code.lanes,)) for _ in range(3)]
            with code.loop(count) as p:
                for k, total in enumerate(sums):
                    factor = code.number(scratch, code.plus((FACTORS + k) * WIDTH, p))
                    total.add_product(code.vector(products, code.plus(code.times(size, code.plus(PRODUCTS * k, p)), i)), code.spread(factor))
            code.store(sums[0].number() + sums[1].number() + sums[2].number(), found, i)
        return context.get_dummy_value()

    return types.void(products, INTEGER, INTEGER, scratch, found), build
