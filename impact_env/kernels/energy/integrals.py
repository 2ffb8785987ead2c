"""Integrals over a segment, of which the energies are sums.

They are integrals of products: of two modal amplitudes; of a modal amplitude and a power of time on
the force's carrier; and of two such powers. Each is a difference of an antiderivative between the
segment's ends, or a series where that would divide by almost zero. Its error is a few roundings of
the antiderivative: small compared with the energy of the modal amplitude, though not always
compared with the integral over a very short segment. No integral uses the equations of motion.

In: modal amplitudes ``z`` and ``w`` (2, size) at begin and end of a segment, the polynomials of
`forced.Forced`, weights of modal amplitudes in velocities. Out: the integral of each velocity's
square, and of the force times the velocity of its point.

The loops are vector code (vector_code.py), which sees all arrays flat: ``rows`` (ROWS, size) of
`modal_system.ModalSystem`, ``system`` (4, TERMS, size) of `forced.Forced`, powers of time
(., WIDTH) of `energies.RegimeAccount`. A modal amplitude in powers of time is two polynomials A and
B, one on the force's carrier, one on its conjugate, or two series of moments; ``powers`` (4, TERMS,
size) holds Re (A + B), Im (A - B), Re (A - B) and Im (A + B), so that v A + conj(v B) takes four
products. ``shape`` holds the weights v of modal amplitudes in velocities, ``partner`` (2, TERMS,
size) the velocities' forced parts as factors of the carrier.

An integral of the product of two modal amplitudes divides the product's change by the sum of their
eigenvalues. The inverses of these sums are kept for each pair; pairs for which the sum is almost
zero are integrated by series, one by one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from impact_env.kernels.compiling.jit import INTEGER, NUMBER, jit, jit_inline, vector_code
from impact_env.kernels.compiling.vector_code import LANES, Code, Complex, Index, Number
from impact_env.kernels.motion.loads import TERMS
from impact_env.kernels.motion.modal_system import SPEED, SPEED_SQUARE, S

SERIES_DECAY = 0.125  # exponent up to which a decay is a series
# two modal amplitudes are close if their difference turns less than this over the segment, and is
# below this share of them
SERIES_TURN = 0.3
CLOSE_POLES_TOL = 0.05
SERIES_PHASE = 0.5  # rad over half a window: what turns less is integrated by series
_F = tuple(1.0 / math.factorial(n + 1) for n in range(11))
# orders above the wanted ones at which the series begins: the neglected share, SERIES_PHASE to the
# power EXTRA_ORDERS times 8!/(8 + EXTRA_ORDERS)!, is far below rounding
EXTRA_ORDERS = 10
PRODUCTS = 2 * TERMS - 1  # coefficients of a product of two polynomials
WIDTH = PRODUCTS + EXTRA_ORDERS + 1  # powers of the time that series need
_INVERSE = 1.0 / np.maximum(np.arange(2.0 * EXTRA_ORDERS + 20.0), 1.0)

NEGLIGIBLE = 1e-17  # coefficients below this share of the largest one are left out

# planes of pairs (PLANES J, J), of J rows each, for modal amplitudes j <= k: inverse of s_j + s_k
# and of s_j + conj(s_k), real and imaginary, 0 where a series is needed; which of the two need one
# (1, 2, 3: both); integrals over a segment of the products of real and imaginary parts of both
SUM_PLANE = 0
DIFFERENCE_PLANE = 2
SERIES_PLANE = 4
INTEGRAL_PLANE = 5
PLANES = 9


@jit_inline
def sum_decay_series(y):
    """Return (exp(y) - 1)/y for -SERIES_DECAY <= y <= 0."""
    f = _F[6] + y * (_F[7] + y * (_F[8] + y * (_F[9] + y * _F[10])))
    return 1.0 + y * (_F[1] + y * (_F[2] + y * (_F[3] + y * (_F[4] + y * (_F[5] + y * f)))))


@jit
def integrate_decay(rate, h):
    """Return the integral of exp(rate t) over [0, h] (s) for rate <= 0 (1/s).

    A series gives the integral over a part of h, which is then doubled repeatedly. No table is
    used.
    """
    y = rate * h
    doublings = 0
    while y < -SERIES_DECAY:
        y *= 0.5
        doublings += 1
    f = sum_decay_series(y)
    for _ in range(doublings):
        f *= 1.0 + 0.5 * y * f
        y *= 2.0
    return h * f


@jit
def integrate_decays(rows, h, decay):
    """Write the integral of |exp(s t)|^2 over [0, h] for each modal amplitude to decay (J,)."""
    fastest = 0.0
    part = 2.0 * h
    doublings = 0
    for j in range(decay.shape[0]):
        fastest = min(fastest, rows[S, j])
    while fastest * part < -SERIES_DECAY:
        part *= 0.5
        doublings += 1
    for j in range(decay.shape[0]):
        decay[j] = sum_decay_series(rows[S, j] * part)
    for _ in range(doublings):
        for j in range(decay.shape[0]):
            decay[j] *= 1.0 + 0.5 * part * rows[S, j] * decay[j]
        part *= 2.0
    for j in range(decay.shape[0]):
        decay[j] *= h


@jit
def integrate_pair(l_r, l_i, h, a_r, a_i, b_r, b_i):
    """Return real and imaginary part of the integral of a exp(l t) over [0, h].

    l = l_r + i l_i (1/s) and a = a_r + i a_i; b = b_r + i b_i is the value a exp(l h) at the end.
    A real or almost zero l has a series.
    """
    if l_i == 0.0:
        f = integrate_decay(l_r, h)
        return f * a_r, f * a_i
    square = l_r * l_r + l_i * l_i
    if square * h * h < SERIES_TURN * SERIES_TURN:
        x_r = l_r * h
        x_i = l_i * h
        f_r = 1.0
        f_i = 0.0
        for n in range(11):
            scale = 1.0 / (12.0 - n)
            f_r, f_i = 1.0 + (f_r * x_r - f_i * x_i) * scale, (f_r * x_i + f_i * x_r) * scale
        return h * (a_r * f_r - a_i * f_i), h * (a_r * f_i + a_i * f_r)
    d_r = b_r - a_r
    d_i = b_i - a_i
    return (d_r * l_r + d_i * l_i) / square, (d_i * l_r - d_r * l_i) / square


@jit_inline
def fill_powers(first, last, ends):
    """Write the powers of the times of the segment's ends to ``ends`` (2, WIDTH).

    The times are in half windows from the window's centre.
    """
    p = 1.0
    q = 1.0
    for k in range(WIDTH):
        ends[0, k] = p
        ends[1, k] = q
        p = p * first
        q = q * last


@jit
def fill_moments(exponent, half, ends, first, last, out_r, out_i):
    """Write the integrals of x^k y, k = 0 ... len(out_r) - 1, over the segment to out_r and out_i.

    x is the time in half windows. y turns as exp(exponent t), from ``first`` at the start of the
    segment to ``last`` at its end, complex numbers all three. ``ends``: from `fill_powers`.
    """
    count = out_r.shape[0]
    square = exponent.real * exponent.real + exponent.imag * exponent.imag
    moment = complex(0.0, 0.0)
    if square * half * half < SERIES_PHASE * SERIES_PHASE:
        for m in range(count + EXTRA_ORDERS):
            k = count + EXTRA_ORDERS - m
            moment = (
                half * _INVERSE[k] * (ends[1, k] * last - ends[0, k] * first - exponent * moment)
            )
            if k <= count:
                out_r[k - 1] = moment.real
                out_i[k - 1] = moment.imag
        return
    inverse = complex(exponent.real / square, -exponent.imag / square)
    for k in range(count):
        moment = (ends[1, k] * last - ends[0, k] * first - k / half * moment) * inverse
        out_r[k] = moment.real
        out_i[k] = moment.imag


@jit_inline
def fill_factors(omega, half, count, first, last, ends, factors):
    """Write the factors for products of two factors of the carrier to ``factors`` (3, WIDTH).

    ``count`` powers are filled. Twice the product of Re(a E) and Re(b E) is Re a Re b + Im a Im b
    without a carrier, and a b on its square, which turns from ``first`` to ``last``.
    """
    fill_moments(
        complex(0.0, 2.0 * omega), half, ends, first, last, factors[0, :count], factors[2, :count]
    )
    for k in range(count):
        plain = half * (ends[1, k + 1] - ends[0, k + 1]) * _INVERSE[k + 1]
        x = factors[0, k]
        factors[0, k], factors[1, k], factors[2, k] = plain + x, plain - x, -factors[2, k]


def _store_powers(code: Code, up: Complex, down: Complex, powers: Any, at: Any, plane: Any) -> None:
    """Write the four combinations of A (``up``) and B (``down``) that ``powers`` holds."""
    for k, part in enumerate(
        (up.real + down.real, up.imag - down.imag, up.real - down.real, up.imag + down.imag)
    ):
        code.store(part, powers, at + plane * k)


@vector_code()
def write_forced_powers(code: Code, polynomials, size: Index, half: Number, powers):
    """Write the forced part of all modal amplitudes to ``powers`` (4, TERMS, size).

    It is written in powers of the time in half windows; ``half`` (s) is the half window,
    ``polynomials`` those of `forced.Forced`, in powers of the time in seconds.
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
def compute_amplitude_moments(
    code: Code, rows, size: Index, omega: Number, half: Number, ends, carrier, z, w, powers
):
    """Write the moments of all modal amplitudes over a segment to ``powers`` (4, TERMS, size).

    They are the integrals of x^k y with the time x in half windows and y a modal amplitude times
    the carrier or its conjugate. Their divisor, the difference of the frequencies of amplitude and
    carrier, can be almost zero: such moments must be computed again (`fill_moments`). ``ends``
    and ``carrier`` (4,) are those of `energies.RegimeAccount`.
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


def _walk_own_velocities(
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


def _walk_velocities(
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
    """Return vector code that writes the velocities' forced parts to ``partner``.

    ``coupled``: velocities are sums over all amplitudes, else each amplitude is a mode.
    """

    @vector_code()
    def partners(code: Code, shape, size: Index, powers, partner):
        walk = (
            _walk_velocities(code, shape, size, powers)
            if coupled
            else _walk_own_velocities(code, shape, size, powers)
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
    """Return vector code that adds the integrals of free velocities times their partners.

    ``coupled`` as in `_partner_code`.
    """

    @vector_code()
    def mixed(code: Code, shape, size: Index, powers, partner, integrals):
        walk = (
            _walk_velocities(code, shape, size, powers)
            if coupled
            else _walk_own_velocities(code, shape, size, powers)
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


write_own_partners = _partner_code(False)
write_coupled_partners = _partner_code(True)
add_own_mixed = _mixed_code(False)
add_coupled_mixed = _mixed_code(True)


@vector_code(NUMBER)
def compute_mixed_power(code: Code, point, size: Index, powers, force):
    """Return the integral of the force times the free velocity of its point.

    ``point`` (2, size): the amplitudes' weights in this velocity; ``powers``: their moments;
    ``force`` (2, WIDTH): half the force.
    """
    total = code.sum(code.lanes)
    for _, velocities in _walk_own_velocities(code, point, size, powers):
        for n in range(0, TERMS, 2):
            total.add_product(code.spread(code.number(force, n)), velocities[n].real)
            total.add_product(-code.spread(code.number(force, WIDTH + n)), velocities[n].imag)
    return total.total()


@vector_code(INTEGER)
def square_partners(code: Code, partner, size: Index, products):
    """Write half the squares of ``partner`` to ``products`` (3, PRODUCTS, size).

    They are sums of products of real parts, of imaginary parts, and of real with imaginary parts.
    Returns how many of their powers are not negligible.
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
                _compute_half_square(code, reals, p),
                _compute_half_square(code, imags, p),
                _compute_product(reals, imags, p),
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
def compute_point_power(code: Code, point, size: Index, powers, terms, half: Number, force, power):
    """Write half the force, and its products with the forced velocity of its point.

    Both are written in powers of the time in half windows. ``point`` (2, size): weights;
    ``powers``: of the modal amplitudes' forced parts; ``terms`` (2, TERMS) of `forced.Forced`.
    """
    sums = [(code.sum(code.lanes), code.sum(code.lanes)) for _ in range(TERMS)]
    for _, velocities in _walk_own_velocities(code, point, size, powers):
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


def _compute_half_square(code: Code, numbers: list[Number], p: int) -> Number:
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


def _compute_product(one: list[Number], other: list[Number], p: int) -> Number:
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


@jit_inline
def _needs_series(j, k, special):
    """Return whether the integral of a pair needs its own series.

    The pair of an oscillating modal amplitude and its conjugate needs none, because
    `integrate_decays` gives its integral.
    """
    return special > 0 and not (j == k and special == 2)


@jit
def init_pairs(rows, pairs):
    """Fill the constants of a regime's pairs (PLANES J, J); return how many pairs need series.

    A modal amplitude that decays with its own conjugate is not counted.
    """
    count = 0
    size = rows.shape[1]
    for j in range(size):
        for k in range(j, size):
            if rows[SPEED, j] == 0.0 or rows[SPEED, k] == 0.0:
                continue
            special = 0
            for side in range(2):
                l_r = rows[S, j] + rows[S, k]
                l_i = rows[S + 1, j] + (1.0 - 2.0 * side) * rows[S + 1, k]
                close = CLOSE_POLES_TOL * rows[SPEED, j]
                if l_i == 0.0 or l_r * l_r + l_i * l_i < close * close:
                    special += 1 + side
                    continue
                scale = (0.5 if j == k else 1.0) / (l_r * l_r + l_i * l_i)
                pairs[2 * side * size + j, k] = l_r * scale
                pairs[(2 * side + 1) * size + j, k] = -l_i * scale
            pairs[SERIES_PLANE * size + j, k] = special
            count += 1 if _needs_series(j, k, special) else 0
    return count


@vector_code()
def _fill_pair_integrals(code: Code, pairs, size: Index, z, w):
    """Fill INTEGRAL_PLANE for modal amplitudes z at begin and w at end of the segment.

    Integrals that need a series are set to zero.
    """
    plane = size * size
    for j in code.loop(size):
        one = [
            Complex(*(code.spread(code.number(y, j + part), LANES) for part in (0, size)))
            for y in (z, w)
        ]
        first = j & -LANES
        for k in code.loop(size, LANES, first):
            other = [code.complex(y, k, k + size, LANES) for y in (z, w)]
            at = j * size + k
            places = [at + plane * m for m in range(PLANES)]
            both = []
            for side, start in enumerate((SUM_PLANE, DIFFERENCE_PLANE)):
                partners = other if side == 0 else [Complex(y.real, -y.imag) for y in other]
                begin, end = (a.times(b) for a, b in zip(one, partners, strict=True))
                change = Complex(end.real - begin.real, end.imag - begin.imag)
                both.append(
                    change.times(code.complex(pairs, places[start], places[start + 1], LANES))
                )
            p, m = both
            for n, number in enumerate(
                (m.real + p.real, m.real - p.real, p.imag - m.imag, p.imag + m.imag)
            ):
                code.store(number, pairs, places[INTEGRAL_PLANE + n])


@vector_code()
def add_pairs(code: Code, shape, size: Index, pairs, squares):
    """Add the integrals of the squares of the velocities' free parts to ``squares`` (size,).

    They follow from ``shape`` (2, size, size) and INTEGRAL_PLANE of ``pairs`` (`integrate_pairs`).
    """
    plane = size * size
    for i in code.single_vectors(size):
        total = code.sum(code.lanes)
        for j in code.loop(size):
            sums = [code.sum(code.lanes) for _ in range(4)]
            for k in code.loop(size, 1, j):
                at = size * k + i
                here = j * size + k
                other = code.complex(shape, at, at + plane)
                for n, part in enumerate((other.real, other.imag, other.imag, other.real)):
                    sums[n].add_product(
                        part, code.spread(code.number(pairs, here + plane * (INTEGRAL_PLANE + n)))
                    )
            at = size * j + i
            one = code.complex(shape, at, at + plane)
            rr, ii, ri, ir = (each.number() for each in sums)
            total.add_product(one.real, rr - ri)
            total.add_product(one.imag, ii - ir)
        code.store(code.vector(squares, i) + total.number(), squares, i)


@jit
def _add_series(rows, pairs, h, z, w):
    """Add the integrals that need a series to INTEGRAL_PLANE of ``pairs``, pair by pair."""
    size = z.shape[1]
    for j in range(size):
        for k in range(j, size):
            special = pairs[SERIES_PLANE * size + j, k]
            if not _needs_series(j, k, special):
                continue
            factor = 0.5 if j == k else 1.0
            for side in range(2):
                if special != 1.0 + side and special != 3.0:
                    continue
                sign = 1.0 - 2.0 * side
                l_r = rows[S, j] + rows[S, k]
                l_i = rows[S + 1, j] + sign * rows[S + 1, k]
                a_r = z[0, j] * z[0, k] - sign * z[1, j] * z[1, k]
                a_i = sign * z[0, j] * z[1, k] + z[1, j] * z[0, k]
                b_r = w[0, j] * w[0, k] - sign * w[1, j] * w[1, k]
                b_i = sign * w[0, j] * w[1, k] + w[1, j] * w[0, k]
                x, y = integrate_pair(l_r, l_i, h, a_r, a_i, b_r, b_i)
                x = factor * x
                y = factor * y
                pairs[INTEGRAL_PLANE * size + j, k] += x
                pairs[(INTEGRAL_PLANE + 1) * size + j, k] -= sign * x
                pairs[(INTEGRAL_PLANE + 2) * size + j, k] += sign * y
                pairs[(INTEGRAL_PLANE + 3) * size + j, k] += y


@jit
def integrate_pairs(rows, pairs, series, h, z, w, decay):
    """Fill INTEGRAL_PLANE for a segment of ``h`` (s), amplitudes z at its start, w at its end.

    ``series``: how many pairs need series, from `init_pairs`; ``decay`` (J,) is scratch.
    """
    size = z.shape[1]
    _fill_pair_integrals(pairs, size, z, w)
    integrate_decays(rows, h, decay)
    for j in range(size):
        if pairs[SERIES_PLANE * size + j, j] == 2.0:
            square = 0.5 * decay[j] * (z[0, j] * z[0, j] + z[1, j] * z[1, j])
            pairs[INTEGRAL_PLANE * size + j, j] += square
            pairs[(INTEGRAL_PLANE + 1) * size + j, j] += square
    if series > 0:
        _add_series(rows, pairs, h, z, w)


@jit
def add_own_squares(rows, velocity, h, z, w, decay, squares):
    """Add the integrals of squared velocities of single modal amplitudes to ``squares`` (J,).

    ``velocity`` (2, J): the amplitudes' weights; z and w (2, J): the amplitudes at start and end of
    a segment of length ``h`` (s); ``decay`` (J,) is scratch.
    """
    integrate_decays(rows, h, decay)
    for j in range(decay.shape[0]):
        v = complex(velocity[0, j], velocity[1, j])
        a = v * complex(z[0, j], z[1, j])
        b = v * complex(w[0, j], w[1, j])
        change = b * b - a * a
        turning = (
            0.5
            * (change.real * rows[S, j] + change.imag * rows[S + 1, j])
            / (rows[SPEED_SQUARE, j] + 1e-300)
        )
        squares[j] += 0.5 * ((a.real * a.real + a.imag * a.imag) * decay[j] + turning)
