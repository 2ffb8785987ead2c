"""Functions of single numbers that a compiler would make slower.

They are a product and a sum in one rounding, the lowest bit of a mask, cosine and sine.
"""

from __future__ import annotations

import numpy as np

from impact_env.kernels.compiling.jit import INTEGER, NUMBER, jit_inline, vector_code
from impact_env.kernels.compiling.vector_code import Code, Index, Number


@vector_code(NUMBER)
def fma(code: Code, x: Number, y: Number, z: Number):
    """Return x y + z, rounded once."""
    return x.fma(y, z)


@vector_code(INTEGER)
def lowest_bit(code: Code, mask: Index):
    """Return the place of the lowest bit that is set; 64 where there is none."""
    return code.lowest_bit(mask)


MOST_QUARTER_TURNS = 2.0**62  # quarter turns that an integer holds
_TWO_OVER_PI = 0.6366197723675814
_HALF_PI_HEAD = 1.5707963267341256  # 33 bits, so that k * head is exact for the k that occur
_HALF_PI_TAIL = 6.077100506506192e-11


@jit_inline
def cos_sin(x):
    """Return (cos x, sin x) for |x| up to 1e6.

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
