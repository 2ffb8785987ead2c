"""Steps of linear regimes as Taylor series in numbers of 32 digits, the guards' series, and their first root within a step.

Numbers are unevaluated sums of two doubles, (high, low) with |low| at most half a unit of high's last place. The error-free sum is Knuth's,
the error-free product Dekker's with Veltkamp's splitting (T. J. Dekker, A floating-point technique for extending the available precision,
Numer. Math. 18, 1971). They need IEEE arithmetic as written: no reordering, no contraction.

With q'' = -2 D omega q' - omega^2 q + force_shape f(t) - tip_shape lambda and m_a q_a'' = lambda the coefficients follow order by order. The force
A cos(theta), theta' = Omega + alpha t, has the coefficients that follow from c' = -theta' s, s' = theta' c.
"""

from __future__ import annotations

from fractions import Fraction

import numba
import numpy as np

ORDER = 44
REACH = 2.0  # of the fastest slot's phase in a step: 2^44/44! is below 1e-40
PARTS = 32  # places in a step at which the guards are looked at

# rows of the table of the beam, each a pair: (rows, N_m, 2)
SQUARE, RATE, FORCE, TIP = range(4)
# entries of the constants, each a pair: (entries, 2)
AMPLITUDE, ALPHA, INVERSE_MASS, JOINT_MASS, CONSTANT, STIFFNESS, REST, DAMPING = range(8)
# columns of the series behind those of the modes
ABSORBER, COSINE, SINE, RELATIVE, LAMBDA, EXTRA = 0, 1, 2, 3, 4, 5
_SPLIT = 134217729.0  # 2^27 + 1


def exact(function):  # type: ignore[no-untyped-def]
    """Compile with IEEE arithmetic as written."""
    return numba.njit(cache=True, error_model="numpy", fastmath=False, forceinline=True)(function)


@exact
def renormalised(a, b):  # type: ignore[no-untyped-def]
    """Return a + b as a pair, for |a| >= |b|."""
    s = a + b
    return s, b - (s - a)


@exact
def add(a_hi, a_lo, b_hi, b_lo):  # type: ignore[no-untyped-def]
    s = a_hi + b_hi
    v = s - a_hi
    e = (a_hi - (s - v)) + (b_hi - v)
    t = a_lo + b_lo
    w = t - a_lo
    f = (a_lo - (t - w)) + (b_lo - w)
    s, e = renormalised(s, e + t)
    return renormalised(s, e + f)


@exact
def multiply(a_hi, a_lo, b_hi, b_lo):  # type: ignore[no-untyped-def]
    p = a_hi * b_hi
    t = _SPLIT * a_hi
    a1 = t - (t - a_hi)
    a2 = a_hi - a1
    t = _SPLIT * b_hi
    b1 = t - (t - b_hi)
    b2 = b_hi - b1
    e = ((a1 * b1 - p) + a1 * b2 + a2 * b1) + a2 * b2
    return renormalised(p, e + (a_hi * b_lo + a_lo * b_hi))


def pair(value: Fraction | float | int) -> tuple[float, float]:
    """Return an exact number as a pair."""
    number = Fraction(value)
    high = float(number)
    return high, float(number - Fraction(high))


def fraction(high: float, low: float) -> Fraction:
    """Return a pair as an exact number."""
    return Fraction(float(high)) + Fraction(float(low))


def compiled(function):  # type: ignore[no-untyped-def]
    return numba.njit(cache=True, error_model="numpy", fastmath=False)(function)


@exact
def _phase_order(series, constants, inverse, omega, k, one, other, sign):  # type: ignore[no-untyped-def]
    """Set order k + 1 of the cosine or the sine, column ``one``, from the ``other``."""
    x = multiply(omega[0], omega[1], series[k, other, 0], series[k, other, 1])
    if k > 0:
        y = multiply(constants[ALPHA, 0], constants[ALPHA, 1], series[k - 1, other, 0], series[k - 1, other, 1])
        x = add(x[0], x[1], y[0], y[1])
    x = multiply(x[0], x[1], inverse[k, 0], inverse[k, 1])
    series[k + 1, one, 0], series[k + 1, one, 1] = sign * x[0], sign * x[1]


@exact
def _tip(series, beam, k):  # type: ignore[no-untyped-def]
    """Return order k of the tip's displacement."""
    total = (0.0, 0.0)
    for i in range(beam.shape[1]):
        x = multiply(beam[TIP, i, 0], beam[TIP, i, 1], series[k, i, 0], series[k, i, 1])
        total = add(total[0], total[1], x[0], x[1])
    return total


@exact
def _unforced(series, beam, push, k, rest):  # type: ignore[no-untyped-def]
    """Fill ``rest`` (N_m, 2) with order k of the modes' accelerations without contact, and return the tip's."""
    total = (0.0, 0.0)
    for i in range(beam.shape[1]):
        x = multiply(beam[RATE, i, 0], beam[RATE, i, 1], series[k + 1, i, 0], series[k + 1, i, 1])
        x = multiply(x[0], x[1], -(k + 1.0), 0.0)
        y = multiply(beam[SQUARE, i, 0], beam[SQUARE, i, 1], series[k, i, 0], series[k, i, 1])
        x = add(x[0], x[1], -y[0], -y[1])
        y = multiply(beam[FORCE, i, 0], beam[FORCE, i, 1], push[0], push[1])
        x = add(x[0], x[1], y[0], y[1])
        rest[i, 0], rest[i, 1] = x
        y = multiply(beam[TIP, i, 0], beam[TIP, i, 1], x[0], x[1])
        total = add(total[0], total[1], y[0], y[1])
    return total


@exact
def _law(series, beam, constants, k):  # type: ignore[no-untyped-def]
    """Return order k of a force that depends on the relative motion."""
    n = beam.shape[1]
    x = (series[k, n + RELATIVE, 0], series[k, n + RELATIVE, 1])
    force = (0.0, 0.0)
    if k == 0:
        x = add(x[0], x[1], -constants[REST, 0], -constants[REST, 1])
        force = (constants[CONSTANT, 0], constants[CONSTANT, 1])
    x = multiply(constants[STIFFNESS, 0], constants[STIFFNESS, 1], x[0], x[1])
    force = add(force[0], force[1], -x[0], -x[1])
    tip = _tip(series, beam, k + 1)
    gamma = add(series[k + 1, n + ABSORBER, 0], series[k + 1, n + ABSORBER, 1], -tip[0], -tip[1])
    gamma = multiply(gamma[0], gamma[1], k + 1.0, 0.0)
    x = multiply(constants[DAMPING, 0], constants[DAMPING, 1], gamma[0], gamma[1])
    return add(force[0], force[1], -x[0], -x[1])


@compiled
def taylor_series(series, beam, constants, inverse, omega, joined):  # type: ignore[no-untyped-def]
    """Fill ``series`` (ORDER + 1, N_m + EXTRA, 2) from its displacements at orders 0 and 1 and the cosine and sine at order 0."""
    n = beam.shape[1]
    ab, co, si, re, la = n + ABSORBER, n + COSINE, n + SINE, n + RELATIVE, n + LAMBDA
    rest = np.empty((n, 2))
    for k in range(ORDER + 1):
        tip = _tip(series, beam, k)
        series[k, re, 0], series[k, re, 1] = add(series[k, ab, 0], series[k, ab, 1], -tip[0], -tip[1])
        if k == ORDER:
            break
        _phase_order(series, constants, inverse, omega, k, co, si, -1.0)
        _phase_order(series, constants, inverse, omega, k, si, co, 1.0)
        push = multiply(constants[AMPLITUDE, 0], constants[AMPLITUDE, 1], series[k, co, 0], series[k, co, 1])
        free = _unforced(series, beam, push, k, rest)
        force = multiply(constants[JOINT_MASS, 0], constants[JOINT_MASS, 1], free[0], free[1]) if joined else _law(series, beam, constants, k)
        series[k, la, 0], series[k, la, 1] = force
        if k == ORDER - 1:
            continue
        scale = multiply(inverse[k, 0], inverse[k, 1], inverse[k + 1, 0], inverse[k + 1, 1])
        for i in range(n):
            x = multiply(beam[TIP, i, 0], beam[TIP, i, 1], force[0], force[1])
            x = add(rest[i, 0], rest[i, 1], -x[0], -x[1])
            series[k + 2, i, 0], series[k + 2, i, 1] = multiply(x[0], x[1], scale[0], scale[1])
        x = multiply(constants[INVERSE_MASS, 0], constants[INVERSE_MASS, 1], force[0], force[1])
        series[k + 2, ab, 0], series[k + 2, ab, 1] = multiply(x[0], x[1], scale[0], scale[1])


@compiled
def guard_series(series, guards):  # type: ignore[no-untyped-def]
    """Return the guards' coefficients (G, ORDER - 1, 2); a row of ``guards`` (G, 4) is constant, and weights of y, gamma and lambda."""
    n = series.shape[1] - EXTRA
    terms = series.shape[0] - 2
    result = np.zeros((guards.shape[0], terms, 2))
    for g in range(guards.shape[0]):
        for k in range(terms):
            x = multiply(guards[g, 1], 0.0, series[k, n + RELATIVE, 0], series[k, n + RELATIVE, 1])
            y = multiply(guards[g, 2] * (k + 1.0), 0.0, series[k + 1, n + RELATIVE, 0], series[k + 1, n + RELATIVE, 1])
            x = add(x[0], x[1], y[0], y[1])
            y = multiply(guards[g, 3], 0.0, series[k, n + LAMBDA, 0], series[k, n + LAMBDA, 1])
            x = add(x[0], x[1], y[0], y[1])
            if k == 0:
                x = add(x[0], x[1], guards[g, 0], 0.0)
            result[g, k, 0], result[g, k, 1] = x
    return result


@compiled
def _double_value(row, first, t):  # type: ignore[no-untyped-def]
    value = 0.0
    for k in range(row.shape[0] - 1, first - 1, -1):
        value = value * t + row[k, 0]
    return value


@compiled
def value_at(row, first, t_hi, t_lo):  # type: ignore[no-untyped-def]
    """Return the sum of ``row[k]`` t^(k - first) over k >= first, and its derivative, as pairs."""
    v, d = (0.0, 0.0), (0.0, 0.0)
    for k in range(row.shape[0] - 1, first - 1, -1):
        d = multiply(d[0], d[1], t_hi, t_lo)
        d = add(d[0], d[1], v[0], v[1])
        v = multiply(v[0], v[1], t_hi, t_lo)
        v = add(v[0], v[1], row[k, 0], row[k, 1])
    return v, d


@compiled
def first_root(coefficients, orders, h):  # type: ignore[no-untyped-def]
    """Return (guard, time as a pair) of the first place in (0, h] where a guard turns negative; guard is -1 if there is none.

    ``orders`` (G,): order of the root that a guard has at the start. It is divided out, so that a regime which starts on its guard lasts until the
    guard is met again.
    """
    best, best_time = -1, (h, 0.0)
    for g in range(coefficients.shape[0]):
        row = coefficients[g]
        first = orders[g]
        low = 0.0
        if _double_value(row, first, 0.0) < 0.0:
            return g, (0.0, 0.0)
        for part in range(1, PARTS + 1):
            high = h * part / PARTS
            if low >= best_time[0]:
                break
            if _double_value(row, first, high) < 0.0:
                for _ in range(60):
                    middle = 0.5 * (low + high)
                    if _double_value(row, first, middle) < 0.0:
                        high = middle
                    else:
                        low = middle
                t = (high, 0.0)
                for _ in range(4):
                    v, d = value_at(row, first, t[0], t[1])
                    # a quotient in double precision suffices: each pass gains its digits anew
                    change = -v[0] / d[0]
                    t = add(t[0], t[1], change, 0.0)
                if t[0] < best_time[0] or (t[0] == best_time[0] and t[1] < best_time[1]):
                    best, best_time = g, t
                break
            low = high
    return best, best_time


@compiled
def advanced(series, t_hi, t_lo, displacement, velocity):  # type: ignore[no-untyped-def]
    """Write displacements (N_m + 3, 2) of modes, absorber, cosine and sine at an offset, and their rates."""
    for i in range(displacement.shape[0]):
        v, d = value_at(series[: ORDER + 1, i], 0, t_hi, t_lo)
        displacement[i, 0], displacement[i, 1] = v
        velocity[i, 0], velocity[i, 1] = d
