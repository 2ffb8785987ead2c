"""Linear regimes in modal form, and their exact propagation.

In every regime the state is a sum of modal amplitudes Z_j with Z_j' = s_j Z_j + drive_j f(t) +
relative_j F, where f is the external force and F a constant force between beam and absorber
(positive on the absorber). A pair of complex eigenvalues is one modal amplitude, of which real
parts are taken; a real eigenvalue has a modal amplitude of its own. A modal amplitude splits into
z_j exp(s_j t), a forced part (forced.py) and a rest part -relative_j F / s_j.

exp(s_j t) is a product of three table entries and a short Taylor polynomial: t = d1 h1 + d2 h2 + d3
h3 + rest, with the digits d1, d2, d3 from 0 to base - 1, h1 = reach/base, h2 = h1/base, h3 =
h2/base and |s_j| h3 <= TAYLOR_REACH, so that the polynomial is exact to rounding. ``reach`` (s) is
the longest time offset, ``base`` the number of entries of a table. No transcendental function is
called.

In: a `ModalSystem`, the tables of a regime (`regimes.py` makes them), modal amplitudes (2, J), real
and imaginary parts, and a time offset. Out: the amplitudes after this time, or sums over them. The
loops over the amplitudes are vector code (vector_code.py), which sees all arrays flat.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import NUMBER, jit, jit_inline, vector_code
from impact_env.kernels.compiling.vector_code import Code, Complex, Index, Number

# rows of `ModalSystem.rows`; a complex quantity has two, its real part and, in the next one, its
# imaginary part
S = 0  # eigenvalue (1/s)
SQUARE = 2  # square of the eigenvalue (1/s^2)
DRIVE = 4  # response to a unit force of the drive
RELATIVE = 6  # response to a unit force between beam and absorber
REST = 8  # rest part under a unit constant relative force, -RELATIVE/S
GUARD = 10  # weight in the regime's guard signal
TIP = 12  # weight in the tip displacement
TAYLOR = 14  # s^n/n! for n = 1 ... TAYLOR_ROWS
TAYLOR_ROWS = 6
SPEED = TAYLOR + 2 * TAYLOR_ROWS  # |s|, real as the next two
SPEED_SQUARE = SPEED + 1
SPEED_CUBE = SPEED + 2
# response to a unit acceleration of the first base; two more rows for each further base
BASE = SPEED + 3
ROWS = BASE  # number of rows of a regime without moving bases
POINTS = 8  # times in a block of the event search
TAYLOR_TERMS = 1 + TAYLOR_ROWS  # |s h3|^7 / 7! below 1e-16 for TAYLOR_REACH
# largest |s| h3; the rest of a time offset is at most h3/2
TAYLOR_REACH = 0.04

# entries of `ModalSystem.scale`
DIGIT_BITS, FINEST_STEP, INVERSE_FINEST_STEP, LARGEST_RATE = range(4)


class ModalSystem(NamedTuple):
    """One regime with J modal amplitudes, sorted by |s_j| and padded with zeros.

    J, a multiple of four, includes the padding. There are few arrays, because each costs time at
    every call. ``steps`` to ``errors`` serve the event search (search.py), which has L levels of
    time steps h_L.
    """

    rows: NDArray[np.float64]  # (ROWS, J), or (ROWS + 2 C, J) with C moving bases: S to BASE above
    table: NDArray[np.float64]  # (2, 3, base, J) parts of exp(s d h1), exp(s d h2), exp(s d h3)
    scale: NDArray[np.float64]  # (4,) log2 of the base, h3 (s), 1/h3, largest |s|
    steps: NDArray[np.float64]  # (L, 2) h_L (s), and the number of amplitudes that a scan sums
    waves: NDArray[np.float64]  # (L, J, 2, POINTS) exp(k s h_L), k = 1 ... POINTS
    turns: NDArray[np.float64]  # (L, POINTS, 2, J) the same in another order
    errors: NDArray[np.float64]  # (L, J) addition to the error bound E by an amplitude of 1


MOST_QUARTER_TURNS = 2.0**62  # quarter turns that an integer holds
_TWO_OVER_PI = 0.6366197723675814
_HALF_PI_HEAD = 1.5707963267341256  # 33 bits, so that k * head is exact for the k that occur
_HALF_PI_TAIL = 6.077100506506192e-11


@vector_code(NUMBER)
def fma(code: Code, x: Number, y: Number, z: Number):
    """Return x y + z of numbers, rounded once."""
    return x.fma(y, z)


@jit_inline
def cos_sin(x):
    """Return (cos x, sin x) for x (rad) with |x| up to 1e6.

    Taylor polynomials on [-pi/4, pi/4] are used, with an error below 2e-16.
    """
    k = np.floor(fma(x, _TWO_OVER_PI, 0.5))
    r = fma(-k, _HALF_PI_TAIL, fma(-k, _HALF_PI_HEAD, x))
    q = r * r
    s = fma(q, fma(q, -1.0 / 1307674368000.0, 1.0 / 6227020800.0), -1.0 / 39916800.0)
    s = fma(q, fma(q, fma(q, fma(q, s, 1.0 / 362880.0), -1.0 / 5040.0), 1.0 / 120.0), -1.0 / 6.0)
    c = fma(q, fma(q, 1.0 / 20922789888000.0, -1.0 / 87178291200.0), 1.0 / 479001600.0)
    c = fma(q, fma(q, fma(q, fma(q, c, -1.0 / 3628800.0), 1.0 / 40320.0), -1.0 / 720.0), 1.0 / 24.0)
    s = fma(r * q, s, r)
    c = fma(q, fma(q, c, -0.5), 1.0)
    n = np.int64(k if abs(k) < MOST_QUARTER_TURNS else 0.0)  # beyond, or not a number: undefined
    a, b = (s, c) if n & 1 else (c, s)
    return -a if (n + 1) & 2 else a, -b if n & 2 else b


class Propagator:
    """The factor exp(s t) of each modal amplitude, as vector code.

    ``rows`` and ``table`` are those of a `ModalSystem`, flat, with ``size`` J and ``base`` as in
    their shapes. The time offset t is given by ``digits``: (d1, d2, d3, x) with the rest x (s), as
    `split_time` returns them. In the methods j is the number of the first amplitude of a vector.
    """

    def __init__(
        self, code: Code, rows: Any, table: Any, size: Any, base: Any, digits: Sequence[Any]
    ) -> None:
        self.code = code
        self.rows = rows
        self.table = table
        self.size = size
        plane = base * size
        places = [plane * k + digit * size for k, digit in enumerate(digits[:3])]
        self.places = places
        self.imaginary = plane * 3
        self.x = digits[3]

    def row(self, row: int, j: Any) -> Number:
        """Return the numbers of a row from amplitude j on."""
        return self.code.vector(self.rows, self.size * row + j)

    def pair(self, row: int, j: Any) -> Complex:
        """Return complex numbers: real parts in ``row``, imaginary parts in the next row."""
        return Complex(self.row(row, j), self.row(row + 1, j))

    def read_factor(self, k: int, j: Any) -> Complex:
        """Return the table's factor for the digit of number ``k``: 0, 1 or 2 for d1, d2, d3."""
        at = self.places[k] + j
        return self.code.complex(self.table, at, at + self.imaginary)

    def taylor(self, j: Any) -> Complex:
        """Return exp(s x) for the rest x of the offset, by the Taylor polynomial."""
        x = self.code.spread(self.x)
        total = self.pair(TAYLOR + 2 * (TAYLOR_ROWS - 1), j)
        for k in range(TAYLOR_ROWS - 2, -1, -1):
            next_one = self.pair(TAYLOR + 2 * k, j)
            total = Complex(total.real.fma(x, next_one.real), total.imag.fma(x, next_one.imag))
        return Complex(total.real.fma(x, self.code.repeated(1.0)), total.imag * x)

    def factor(self, j: Any) -> Complex:
        """Return exp(s t)."""
        return (
            self.read_factor(0, j)
            .times(self.read_factor(1, j).times(self.read_factor(2, j)))
            .times(self.taylor(j))
        )

    def turned(self, u: Any, j: Any) -> Complex:
        """Return u exp(s t) for amplitudes ``u`` (2, J)."""
        amplitude = self.code.complex(u, j, j + self.size)
        return (
            amplitude.times(self.read_factor(0, j))
            .times(self.read_factor(1, j).times(self.read_factor(2, j)))
            .times(self.taylor(j))
        )


@vector_code()
def propagate_by_digits(
    code: Code,
    rows,
    table,
    size: Index,
    base: Index,
    d1: Index,
    d2: Index,
    d3: Index,
    x: Number,
    u,
    out,
):
    """Write u exp(s t) to ``out``, which may be ``u``; both (2, J).

    Other arguments as in `Propagator`, with (d1, d2, d3, x) from `split_time`.
    """
    propagator = Propagator(code, rows, table, size, base, (d1, d2, d3, x))
    for j in code.vectors(size):
        code.store_complex(propagator.turned(u, j), out, j, j + size)


def _sum(orders: int) -> Any:
    """Return vector code for the sum of Re(u exp(s t)); ``orders`` 4: and three derivatives."""

    @vector_code(NUMBER, orders)
    def sums(
        code: Code,
        rows,
        table,
        size: Index,
        base: Index,
        d1: Index,
        d2: Index,
        d3: Index,
        x: Number,
        u,
    ):
        propagator = Propagator(code, rows, table, size, base, (d1, d2, d3, x))
        totals = [code.sum() for _ in range(orders)]
        for j in code.vectors(size):
            turned = propagator.turned(u, j)
            totals[0] += turned.real
            if orders > 1:
                speed = propagator.pair(S, j)
                square = propagator.pair(SQUARE, j)
                totals[1] += turned.real_of_product(speed)
                totals[2] += turned.real_of_product(square)
                totals[3] += turned.times(speed).real_of_product(square)
        return [total.total() for total in totals]

    sums.__doc__ = (
        "Return the sum of Re(u exp(s t)) and, for four sums, its first three derivatives."
    )
    return sums


sum_value = _sum(1)
sum_three_derivatives = _sum(4)


@vector_code(NUMBER, 6)
def sum_and_bound_derivatives(
    code: Code, rows, table, size: Index, base: Index, d1: Index, d2: Index, d3: Index, x: Number, u
):
    """Return (y, y', y'', b2, b3, b4): the sum y of Re(u exp(s t)), two derivatives, three bounds.

    The bounds hold for the second to fourth derivative at all later times. They are the sums of
    |s|^2, |s|^3 and |s|^4 times |u exp(s t)|.
    """
    propagator = Propagator(code, rows, table, size, base, (d1, d2, d3, x))
    y0, y1, y2, b2, b3, b4 = [code.sum() for _ in range(6)]
    for j in code.vectors(size):
        turned = propagator.turned(u, j)
        speed = propagator.row(SPEED, j)
        y0 += turned.real
        y1 += turned.real_of_product(propagator.pair(S, j))
        y2 += turned.real_of_product(propagator.pair(SQUARE, j))
        second = turned.real.fma(turned.real, turned.imag * turned.imag).root() * (speed * speed)
        b2 += second
        b3 += second * speed
        b4 += second * (speed * speed)
    return [total.total() for total in (y0, y1, y2, b2, b3, b4)]


@vector_code(NUMBER, 3)
def sum_third_to_fifth(code: Code, rows, size: Index, u):
    """Return the sums of Re(s^3 u), Re(s^4 u) and Re(s^5 u).

    They are the third to fifth derivative of the sum of Re(u exp(s t)) at t = 0.
    """
    third = code.sum()
    fourth = code.sum()
    fifth = code.sum()
    for j in code.vectors(size):
        s, square = (
            code.complex(rows, size * row + j, size * (row + 1) + j) for row in (S, SQUARE)
        )
        bend = code.complex(u, j, j + size).times(square)
        third += bend.real_of_product(s)
        fourth += bend.real_of_product(square)
        fifth += bend.times(square).real_of_product(s)
    return [total.total() for total in (third, fourth, fifth)]


@vector_code()
def copy_vectors(code: Code, size: Index, z, w):
    """Write the amplitudes z to w, both (2, J) with J = ``size``, as vectors.

    If single numbers were stored, code that reads w as vectors would have to wait for them.
    """
    for j in code.vectors(size):
        other = j + size
        code.store_complex(code.complex(z, j, other), w, j, other)


@vector_code()
def multiply_by_row(code: Code, rows, row: Index, size: Index, z, u):
    """Write u = w z with the complex weights w in ``row`` and the next row."""
    for j in code.vectors(size):
        at = size * row + j
        other = j + size
        weight = code.complex(rows, at, at + size)
        code.store_complex(code.complex(z, j, other).times(weight), u, j, other)


@vector_code()
def add_row(code: Code, rows, row: Index, size: Index, factor: Number, z):
    """Add factor * w to z in place, with the complex weights w in ``row`` and the next row."""
    for j in code.vectors(size):
        at = size * row + j
        other = j + size
        weight = code.complex(rows, at, at + size)
        old = code.complex(z, j, other)
        code.store_complex(
            Complex(
                *(code.spread(factor).fma(new, part) for new, part in zip(weight, old, strict=True))
            ),
            z,
            j,
            other,
        )


@vector_code(NUMBER)
def sum_magnitudes(code: Code, size: Index, u):
    """Return the sum of |Re u| + |Im u| over ``size`` amplitudes."""
    total = code.sum()
    for j in code.vectors(size):
        amplitude = code.complex(u, j, j + size)
        total += amplitude.real.size() + amplitude.imag.size()
    return total.total()


@jit_inline
def split_time(scale, delta):
    """Return (d1, d2, d3, rest) of a time offset ``delta`` (s) within the reach of the tables.

    ``scale`` is that of the `ModalSystem`. The digits are integers, the rest is in s. The magnitude
    of the rest is at most h3/2, and the rest is 0 on the grid of h3.
    """
    bits = np.int64(scale[DIGIT_BITS])
    mask = (np.int64(1) << bits) - 1
    x = delta * scale[INVERSE_FINEST_STEP] + 0.5
    # limited before the conversion, which is undefined beyond the integers; not a number becomes 0,
    # and the rest is then not a number
    x = x if x > 0.0 else 0.0
    n = np.int64(min(x, float((np.int64(1) << (3 * bits)) - 1)))
    return n >> (2 * bits), (n >> bits) & mask, n & mask, delta - n * scale[FINEST_STEP]


@jit_inline
def propagate(rows, table, scale, delta, z):
    """Multiply z (2, J) by exp(s delta) in place, ``delta`` in s."""
    propagate_to(rows, table, scale, z, delta, z)


@jit
def propagate_to(rows, table, scale, u, delta, out):
    """Write u exp(s delta), ``delta`` in s, to ``out``, both (2, J); ``out`` may be ``u``."""
    d1, d2, d3, x = split_time(scale, delta)
    propagate_by_digits(rows, table, rows.shape[1], table.shape[2], d1, d2, d3, x, u, out)


@jit
def copy_amplitudes(z, w):
    """Write z to w, both (2, J)."""
    copy_vectors(z.shape[1], z, w)


@jit
def sum_amplitudes(rows, table, scale, u, delta):
    """Return sum Re(u_j exp(s_j delta)) over modal amplitudes u (2, J), after ``delta`` (s)."""
    d1, d2, d3, x = split_time(scale, delta)
    return sum_value(rows, table, rows.shape[1], table.shape[2], d1, d2, d3, x, u)[0]


@jit
def apply_weights(rows, row, z, u):
    """Write u = w z, both (2, J), with the complex weights w in ``row`` and the next row."""
    multiply_by_row(rows, row, rows.shape[1], z, u)


@jit
def add_weighted(rows, row, factor, z):
    """Add factor * w to z (2, J) in place; complex weights w in ``row`` and the next row."""
    add_row(rows, row, rows.shape[1], factor, z)
