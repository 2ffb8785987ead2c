"""Integrals of squared velocities, each a sum of any modal amplitudes.

The terms with free parts only are integrated here, for each modal amplitude and each pair.

An integral of the product of two modal amplitudes divides the product's change by the sum of their
eigenvalues. What a regime knows of its pairs is the inverse of that sum; pairs for which it would
be almost zero are integrated by series, one by one.
"""

from __future__ import annotations

from impact_env.kernels.compiling.jit import jit, jit_inline, vector_code
from impact_env.kernels.compiling.vector_code import LANES, Code, Complex, Index
from impact_env.kernels.energy.moments import are_close_poles, decay_integrals, pair_integral
from impact_env.kernels.motion.modal_system import SPEED, SPEED_SQUARE, S

# planes of pairs (PLANES J, J), of J rows each, for modal amplitudes j <= k: inverse of s_j + s_k
# and of s_j + conj(s_k), real and imaginary, 0 where a series is needed; which of the two need one
# (1, 2, 3: both); integrals over a segment of the products of real and imaginary parts of both
SUM_PLANE = 0
DIFFERENCE_PLANE = 2
SERIES_PLANE = 4
INTEGRAL_PLANE = 5
PLANES = 9


@jit_inline
def _needs_series(j, k, special):
    """Return whether the integral of a pair needs its own series.

    The pair of an oscillating modal amplitude and its conjugate needs none, because
    `decay_integrals` gives its integral.
    """
    return special > 0 and not (j == k and special == 2)


@jit
def init_pairs(rows, pairs):
    """Fill the quantities of a regime's pairs, and return how many pairs need series.

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
                if l_i == 0.0 or are_close_poles(l_r, l_i, rows[SPEED, j]):
                    special += 1 + side
                    continue
                scale = (0.5 if j == k else 1.0) / (l_r * l_r + l_i * l_i)
                pairs[2 * side * size + j, k] = l_r * scale
                pairs[(2 * side + 1) * size + j, k] = -l_i * scale
            pairs[SERIES_PLANE * size + j, k] = special
            count += 1 if _needs_series(j, k, special) else 0
    return count


@vector_code()
def _pair_integrals(code: Code, pairs, size: Index, z, w):
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
    """Add the squares of the velocities' free parts to ``squares`` (size,)."""
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
    """Add the integrals that are series, pair by pair."""
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
                x, y = pair_integral(l_r, l_i, h, a_r, a_i, b_r, b_i)
                x = factor * x
                y = factor * y
                pairs[INTEGRAL_PLANE * size + j, k] += x
                pairs[(INTEGRAL_PLANE + 1) * size + j, k] -= sign * x
                pairs[(INTEGRAL_PLANE + 2) * size + j, k] += sign * y
                pairs[(INTEGRAL_PLANE + 3) * size + j, k] += y


@jit
def integrate_pairs(rows, pairs, series, h, z, w, decay):
    """Fill INTEGRAL_PLANE for a segment of length ``h`` (s).

    The modal amplitudes are z at its begin and w at its end (2, J).

    ``series``: how many pairs need series, from `init_pairs`; ``decay`` (J,) is scratch.
    """
    size = z.shape[1]
    _pair_integrals(pairs, size, z, w)
    decay_integrals(rows, h, decay)
    for j in range(size):
        if pairs[SERIES_PLANE * size + j, j] == 2.0:
            own = 0.5 * decay[j] * (z[0, j] * z[0, j] + z[1, j] * z[1, j])
            pairs[INTEGRAL_PLANE * size + j, j] += own
            pairs[(INTEGRAL_PLANE + 1) * size + j, j] += own
    if series > 0:
        _add_series(rows, pairs, h, z, w)


@jit
def add_own_squares(rows, velocity, h, z, w, decay, squares):
    """Add the integrals of squared velocities over a segment to ``squares`` (J,).

    Each velocity is that of one modal amplitude. The segment has the length ``h`` (s).

    ``velocity`` (2, J): the modal amplitudes' weights; z and w (2, J): the modal amplitudes at its
    begin and end; ``decay`` (J,) is scratch.
    """
    decay_integrals(rows, h, decay)
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
