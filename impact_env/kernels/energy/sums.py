"""Loops for the energies of a segment, as vector code (vector_code.py).

They run over modal amplitudes and over velocities.

Arrays are seen flat: ``rows`` (ROWS, size) of `modal_system.ModalSystem`, ``system`` (4, TERMS,
size) of `forced.Forced`, modal amplitudes ``z`` and ``w`` (2, size) at begin and end of a segment,
powers of time (., WIDTH) of `account.RegimeAccount`. What a modal amplitude does in powers of time
is two polynomials A and B, one on the force's carrier, one on its conjugate, or two series of
moments; ``powers`` (4, TERMS, size) holds Re (A + B), Im (A - B), Re (A - B) and Im (A + B), so
that v A + conj(v B) takes four products. ``shape`` holds the weights v of modal amplitudes in
velocities, ``partner`` (2, TERMS, size) the velocities' forced parts as factors of the carrier.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from impact_env.kernels.compiling.jit import INTEGER, NUMBER, vector_code
from impact_env.kernels.compiling.vector_code import Code, Complex, Index, Number
from impact_env.kernels.energy.moments import PRODUCTS, WIDTH
from impact_env.kernels.motion.search_block import TERMS

NEGLIGIBLE = 1e-17  # coefficients below this share of the largest one are left out


def _store_powers(code: Code, up: Complex, down: Complex, powers: Any, at: Any, plane: Any) -> None:
    for k, part in enumerate(
        (up.real + down.real, up.imag - down.imag, up.real - down.real, up.imag + down.imag)
    ):
        code.store(part, powers, at + plane * k)


@vector_code()
def forced_powers(code: Code, polynomials, size: Index, half: Number, powers):
    """Write the forced part of all modal amplitudes to ``powers``.

    It is written in powers of the time in half windows.
    """
    plane = size * TERMS
    for j in code.single_vectors(size):
        scale = code.repeated(1.0)
        for n in range(TERMS):
            at = size * n + j
            a_r, a_i, b_r, b_i = (
                code.vector(polynomials, at + plane * k) * scale for k in range(4)
            )
            _store_powers(code, Complex(a_r, a_i), Complex(b_r, b_i), powers, at, plane)
            scale *= code.spread(half)


@vector_code()
def slot_moments(
    code: Code, rows, size: Index, omega: Number, half: Number, ends, carrier, z, w, powers
):
    """Write the integrals of x^k y over a segment to ``powers``.

    In these integrals x is the time in half windows, and y is a modal amplitude times the carrier
    or times its conjugate.

    They are divided by the difference of the frequencies of modal amplitude and carrier; where it
    is almost zero they need a correction.
    """
    plane = size * TERMS
    inverse_half = code.repeated(1.0, 0) / half
    times = [[code.number(ends, end * WIDTH + k) for k in range(TERMS)] for end in range(2)]
    for j in code.single_vectors(size):
        s_r = code.vector(rows, j)
        s_i = code.vector(rows, size + j)
        amplitudes = [code.complex(y, j, size + j) for y in (z, w)]
        sides = []
        for sign in (1.0, -1.0):
            l_i = code.spread(omega).fma(code.repeated(sign), s_i)
            scale = code.repeated(1.0) / s_r.fma(s_r, l_i.fma(l_i, code.repeated(1e-300)))
            turns = [
                Complex(*(code.spread(code.number(carrier, 2 * end + part)) for part in range(2)))
                for end in range(2)
            ]
            both = [
                y.times(Complex(turn.real, turn.imag * code.repeated(sign)))
                for y, turn in zip(amplitudes, turns, strict=True)
            ]
            sides.append((Complex(s_r * scale, -(l_i * scale)), *both))
        moments: list[Complex] = []
        for k in range(TERMS):
            p, q = (code.spread(end[k]) for end in times)
            new_moments = []
            for side, (inverse, first, last) in enumerate(sides):
                x = [b.fma(q, -(a * p)) for a, b in zip(first, last, strict=True)]
                if k > 0:
                    factor = code.spread(inverse_half * code.repeated(-float(k), 0))
                    x = [factor.fma(old, new) for old, new in zip(moments[side], x, strict=True)]
                new_moments.append(Complex(*x).times(inverse))
            moments = new_moments
            up, down = moments
            _store_powers(code, up, down, powers, size * k + j, plane)


def _own_velocities(
    code: Code, shape: Any, size: Any, powers: Any
) -> Iterator[tuple[Any, list[Complex]]]:
    """Repeat the following code for some modal amplitudes each, with their velocities' powers.

    ``shape`` (2, size) is used, because each modal amplitude is a mode.
    """
    plane = size * TERMS
    for j in code.single_vectors(size):
        weight = code.complex(shape, j, size + j)
        velocities = []
        for n in range(TERMS):
            at = size * n + j
            p_r, p_i, m_r, m_i = (code.vector(powers, at + plane * k) for k in range(4))
            velocities.append(
                Complex(
                    weight.real.fma(p_r, -(weight.imag * m_i)),
                    weight.real.fma(p_i, weight.imag * m_r),
                )
            )
        yield j, velocities


def _velocities(
    code: Code, shape: Any, size: Any, powers: Any
) -> Iterator[tuple[Any, list[Complex]]]:
    """Repeat the following code for some columns each, with their velocities' powers.

    ``shape`` is (2, size, size).
    """
    plane = size * TERMS
    for i in code.single_vectors(size):
        sums = [[code.sum(code.lanes) for _ in range(2)] for _ in range(TERMS)]
        for j in code.loop(size):
            at = size * j + i
            weight = code.complex(shape, at, at + size * size)
            minus = -weight.imag
            for n, (real, imag) in enumerate(sums):
                here = size * n + j
                p_r, p_i, m_r, m_i = (
                    code.spread(code.number(powers, here + plane * k)) for k in range(4)
                )
                real.add_product(weight.real, p_r)
                real.add_product(minus, m_i)
                imag.add_product(weight.real, p_i)
                imag.add_product(weight.imag, m_r)
        yield i, [Complex(real.number(), imag.number()) for real, imag in sums]


def _partner_code(coupled: bool) -> Any:
    @vector_code()
    def partners(code: Code, shape, size: Index, powers, partner):
        walk = (
            _velocities(code, shape, size, powers)
            if coupled
            else _own_velocities(code, shape, size, powers)
        )
        for i, velocities in walk:
            for n, velocity in enumerate(velocities):
                at = size * n + i
                code.store_complex(velocity, partner, at, at + size * TERMS)

    partners.__doc__ = (
        "Write the velocities' forced parts to ``partner``; ``powers``: of the modal amplitudes' "
        "forced parts."
    )
    return partners


def _mixed_code(coupled: bool) -> Any:
    @vector_code()
    def mixed(code: Code, shape, size: Index, powers, partner, integrals):
        walk = (
            _velocities(code, shape, size, powers)
            if coupled
            else _own_velocities(code, shape, size, powers)
        )
        for i, velocities in walk:
            total = code.vector(integrals, i)
            for n, velocity in enumerate(velocities):
                at = size * n + i
                other = code.complex(partner, at, at + size * TERMS)
                total = other.real.fma(velocity.real, (-other.imag).fma(velocity.imag, total))
            code.store(total, integrals, i)

    mixed.__doc__ = """Add the integrals of the velocities' free parts times their partners.

    ``powers``: the amplitudes' moments; ``integrals`` (size,): what is added to.
    """
    return mixed


own_partners = _partner_code(False)
coupled_partners = _partner_code(True)
own_mixed = _mixed_code(False)
coupled_mixed = _mixed_code(True)


@vector_code(NUMBER)
def mixed_power(code: Code, point, size: Index, powers, force):
    """Return the integral of the force times the free velocity of its point.

    ``point`` (2, size) are weights.
    """
    total = code.sum(code.lanes)
    for _, velocities in _own_velocities(code, point, size, powers):
        for n in range(0, TERMS, 2):
            total.add_product(code.spread(code.number(force, n)), velocities[n].real)
            total.add_product(-code.spread(code.number(force, WIDTH + n)), velocities[n].imag)
    return total.total()


@vector_code(INTEGER)
def square_partners(code: Code, partner, size: Index, products):
    """Write half the squares of ``partner`` to ``products`` (3, PRODUCTS, size).

    Returns how many powers of these squares are not negligible.

    They are sums of products of real parts, of imaginary parts, and of real with imaginary parts.
    """
    order = code.variable(1)
    for i in code.single_vectors(size):
        reals, imags = (
            [code.vector(partner, size * (TERMS * part + n) + i) for n in range(TERMS)]
            for part in range(2)
        )
        amounts = []
        for p in range(PRODUCTS):
            products_of_p = [
                _half_square(code, reals, p),
                _half_square(code, imags, p),
                _product(reals, imags, p),
            ]
            for k, sum_ in enumerate(products_of_p):
                code.store(sum_, products, size * (PRODUCTS * k + p) + i)
            amounts.append(
                products_of_p[0].size() + products_of_p[1].size() + products_of_p[2].size()
            )
        largest = amounts[0]
        for amount in amounts[1:]:
            largest = largest.largest(amount)
        least = largest * code.repeated(NEGLIGIBLE)
        for p in range(1, PRODUCTS):
            some = (amounts[p] - least).not_positive() != 2**code.lanes - 1
            old = order.value
            order.value = code.choose(some & (old < p + 1), code.index(p + 1), old)
    return order.value


@vector_code()
def power_of_point(code: Code, point, size: Index, powers, terms, half: Number, force, power):
    """Write half the force, and its products with the forced velocity of its point.

    Both are written in powers of the time in half windows.

    ``point`` (2, size): weights; ``powers``: of the modal amplitudes' forced parts; ``terms`` (2,
    TERMS) of `forced.Forced`.
    """
    sums = [(code.sum(code.lanes), code.sum(code.lanes)) for _ in range(TERMS)]
    for _, velocities in _own_velocities(code, point, size, powers):
        for (real, imag), velocity in zip(sums, velocities, strict=True):
            real += velocity.real
            imag += velocity.imag
    whole = [Complex(real.total(), imag.total()) for real, imag in sums]
    scale = code.repeated(1.0, 0)
    square = half * half
    driven = {}
    for n in range(0, TERMS, 2):
        driven[n] = Complex(*(code.number(terms, TERMS * part + n) * scale for part in range(2)))
        for part in range(2):
            code.put(driven[n][part], force, WIDTH * part + n)
        scale *= square
    for p in range(PRODUCTS):
        places = [n for n in driven if 0 <= p - n < TERMS]
        for k, pairs in enumerate((((0, 0),), ((1, 1),), ((0, 1), (1, 0)))):
            total = code.repeated(0.0, 0)
            for one, other in pairs:
                for n in places:
                    total = driven[n][one].fma(whole[p - n][other], total)
            code.put(total, power, WIDTH * k + p)


def _half_square(code: Code, numbers: list[Number], p: int) -> Number:
    """Return the coefficient of power p of half the square of a polynomial."""
    total = None
    for k in range(max(0, p - TERMS + 1), (p + 1) // 2):
        total = (
            numbers[k] * numbers[p - k] if total is None else numbers[k].fma(numbers[p - k], total)
        )
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


@vector_code()
def add_products(code: Code, products, size: Index, count: Index, factors, integrals):
    """Write the integrals of half the squares of all partners to ``integrals`` (size,).

    ``count`` powers are used.
    """
    for i in code.single_vectors(size):
        sums = [code.sum(code.lanes) for _ in range(3)]
        for p in code.loop(count):
            for k, total in enumerate(sums):
                factor = code.number(factors, k * WIDTH + p)
                total.add_product(
                    code.vector(products, size * (PRODUCTS * k + p) + i), code.spread(factor)
                )
        code.store(sums[0].number() + sums[1].number() + sums[2].number(), integrals, i)
