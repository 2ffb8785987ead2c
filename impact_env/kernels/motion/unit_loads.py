"""The forced response to loads that are straight lines in a window, such as sampled records.

A window of a record is as short as its step, and its carrier is 0. So the forced part of a regime
is linear in two numbers, value and slope of the force, and in two more for each base that moves and
for each force at a further point. It is solved once for a unit of each of these numbers alone
(`UnitResponses`); in a window it is the sum of these unit responses with the numbers as factors,
and its bounds add up.

In: a load whose ``linear`` is set, a regime's system, a window. Out: `forced.Forced` as
`forced.solve_forced` fills it, or the modal amplitudes at the window's end, in one step.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from impact_env.kernels.compiling.jit import jit, jit_inline, jit_separate, vector_code
from impact_env.kernels.compiling.vector_code import Code, Complex, Index, Number
from impact_env.kernels.motion.forced import compute_force_terms, solve_forced, solve_response
from impact_env.kernels.motion.loads import EQUAL_LENGTH_TOL, TERMS, ForceWindow
from impact_env.kernels.motion.modal_system import BASE, DRIVE, S, copy_amplitudes, propagate

# unit responses are solved for a half window longer by this factor: steps of a record differ by
# rounding
WINDOW_SLACK = 1.001
# of a window's length: where it differs by less from that of the step map, first order suffices
EQUAL_STEP_TOL = 1e-9
# of the half window that unit responses were solved for: in shorter windows more modal amplitudes
# may be near resonance, so the unit responses are solved again
SHORTEST_WINDOW_SHARE = 0.5


def _combination_code(count: int) -> Any:
    """Return vector code for the sum of ``count`` unit responses."""

    @vector_code()
    def combine(code: Code, size: Index, again: Index, shares, units, out):
        """Write the sum of shares[n] units[n], ``size`` numbers each, to ``out``.

        The sum is written a second time from position ``again`` of ``out`` on.
        """
        for j in code.vectors(size):
            total = code.spread(code.number(shares, 0)) * code.vector(units, j)
            for n in range(1, count):
                total = code.spread(code.number(shares, n)).fma(
                    code.vector(units, size * n + j), total
                )
            code.store(total, out, j)
            code.store(total, out, again + j)

    return combine


_combine_of_force, _combine_of_force_and_base = map(_combination_code, (2, 4))


@vector_code()
def _combine_of_all(code: Code, size: Index, again: Index, count: Index, shares, units, out):
    """Write the sum of shares[n] units[n], n below ``count``, as `_combination_code` does."""
    for j in code.vectors(size):
        total = code.sum(code.lanes)
        for n in code.loop(count):
            share = code.spread(code.number(shares, n))
            total.add_product(share, code.vector(units, size * n + j))
        code.store(total.number(), out, j)
        code.store(total.number(), out, again + j)


@jit_inline
def _combine_unit_responses(size, again, base, shares, units, out):
    """Write the sum of shares[n] units[n] to the positions 0 and ``again`` of ``out``.

    Each of the unit responses has ``size`` numbers. The unit loads are those of the force, and of
    the bases if they move.
    """
    if not base.moves:
        _combine_of_force(size, again, shares, units, out)
    elif base.terms.shape[0] == 1:
        _combine_of_force_and_base(size, again, shares, units, out)
    else:
        _combine_of_all(size, again, shares.shape[0], shares, units, out)


@vector_code()
def _store_unit_response(code: Code, size: Index, of_one, units, n: Index):
    """Write the ``size`` numbers of ``of_one``, the response to unit load ``n``, to units[n]."""
    for j in code.vectors(size):
        code.store(code.vector(of_one, j), units, size * n + j)


@jit_inline
def _compute_coefficients(terms, base, shares):
    """Write the coefficients ``shares`` (n,) of a load in the basis of the unit loads."""
    shares[0] = terms[0, 0]
    shares[1] = terms[0, 1]
    if base.moves:
        for c in range(base.terms.shape[0]):
            for n in range(2):
                shares[2 + 2 * c + n] = base.terms[c, 0, n]


@jit_inline
def _set_unit_term(base, terms, n, value):
    """Set the Taylor term of unit load ``n``, in ``terms`` or in ``base.terms``."""
    if n < 2:
        terms[0, n] = value
    else:
        base.terms[n // 2 - 1, 0, n % 2] = value


def _add_scaled(factor: Number, term: Complex, total: Complex) -> Complex:
    """Return factor * term + total."""
    return Complex(factor.fma(term.real, total.real), factor.fma(term.imag, total.imag))


def _step_map_code(count: int) -> Any:
    """Return vector code that applies a step map of ``count`` unit loads to z (2, J) in place.

    Its arguments are those of `_apply_step_map`.
    """

    @vector_code()
    def apply(code: Code, rows, size: Index, step_map, shares, half: Number, remainder: Number, z):
        numbers = [code.number(shares, n) for n in range(count)]
        ends = [
            (value + slope * half) * code.repeated(2.0, 0)
            for value, slope in zip(numbers[::2], numbers[1::2], strict=True)
        ]
        for j in code.vectors(size):
            total = code.complex(z, j, j + size).times(code.complex(step_map, j, j + size))
            for n, share in enumerate(numbers, 1):
                total = _add_scaled(
                    code.spread(share),
                    code.complex(step_map, size * (2 * n) + j, size * (2 * n + 1) + j),
                    total,
                )
            rate = total.times(code.complex(rows, size * S + j, size * (S + 1) + j))
            for row, end in zip((DRIVE, BASE), ends, strict=False):
                rate = _add_scaled(
                    code.spread(end),
                    code.complex(rows, size * row + j, size * (row + 1) + j),
                    rate,
                )
            code.store_complex(_add_scaled(code.spread(remainder), rate, total), z, j, j + size)

    return apply


_step_of_force, _step_of_force_and_base = map(_step_map_code, (2, 4))


@vector_code()
def _step_of_all(
    code: Code,
    rows,
    size: Index,
    step_map,
    count: Index,
    shares,
    half: Number,
    remainder: Number,
    z,
):
    """Apply the step map of ``count`` unit loads as the functions of `_step_map_code` do.

    The rows from DRIVE and from BASE on each belong to a pair of unit loads, value and slope.
    """
    two = code.repeated(2.0, 0)
    for j in code.vectors(size):
        first = code.complex(z, j, j + size).times(code.complex(step_map, j, j + size))
        real = code.sum(code.lanes)
        imag = code.sum(code.lanes)
        real += first.real
        imag += first.imag
        for n in code.loop(count):
            share = code.spread(code.number(shares, n))
            at = size * (n * 2 + 2) + j
            real.add_product(share, code.vector(step_map, at))
            imag.add_product(share, code.vector(step_map, at + size))
        total = Complex(real.number(), imag.number())
        rate = total.times(code.complex(rows, size * S + j, size * (S + 1) + j))
        end = code.spread((code.number(shares, 0) + code.number(shares, 1) * half) * two)
        rate = _add_scaled(end, code.complex(rows, size * DRIVE + j, size * (DRIVE + 1) + j), rate)
        real = code.sum(code.lanes)
        imag = code.sum(code.lanes)
        real += rate.real
        imag += rate.imag
        for n in code.loop(count, 2, 2):
            end = code.spread((code.number(shares, n) + code.number(shares, n + 1) * half) * two)
            at = size * (n + (BASE - 2)) + j
            real.add_product(end, code.vector(rows, at))
            imag.add_product(end, code.vector(rows, at + size))
        rate = Complex(real.number(), imag.number())
        code.store_complex(_add_scaled(code.spread(remainder), rate, total), z, j, j + size)


@jit_inline
def _apply_step_map(base, rows, size, step_map, shares, half, remainder, z):
    """Propagate amplitudes z (2, J), free and forced part, by the step of a step map, in place.

    They are propagated by ``remainder`` (s) more, which is so short that first order suffices.
    ``shares`` (n,): coefficients of the unit loads; ``half`` (s): from the window's centre to its
    end, where the rate for the remainder is computed.
    """
    if not base.moves:
        _step_of_force(rows, size, step_map, shares, half, remainder, z)
    elif base.terms.shape[0] == 1:
        _step_of_force_and_base(rows, size, step_map, shares, half, remainder, z)
    else:
        _step_of_all(rows, size, step_map, shares.shape[0], shares, half, remainder, z)


@jit
def _compute_step_column(system, units, n, half, w):
    """Fill ``units.step_map[n + 1]`` for unit load ``n``, from its response at the window's ends.

    ``half`` (s): half the window; w (2, J) is scratch.
    """
    step_map = units.step_map
    size = w.shape[1]
    for side in range(2):
        w[:] = 0.0
        tau = half if side == 1 else -half
        for j in range(size):
            for part in range(2):
                x = 0.0
                for m in range(TERMS):
                    x = x * tau + units.polynomials[n, part, TERMS - 1 - m, j]
                w[part, j] = 2.0 * x
        if side == 0:
            propagate(system.rows, system.table, system.scale, 2.0 * half, w)
        for j in range(size):
            for part in range(2):
                step_map[n + 1, part, j] = w[part, j] - (
                    step_map[n + 1, part, j] if side == 1 else 0.0
                )


@jit_separate
def _compute_step_map(load, system, window, forced, w):
    """Fill a regime's step map and its length for a window as long as ``window``.

    Unit responses that do not serve this length are solved again. w (2, J) is scratch.
    """
    units = forced.unit_responses
    if not SHORTEST_WINDOW_SHARE * units.half[0] <= window.half <= units.half[0]:
        _solve_unit_responses(load, system, window, None, False, forced)
    w[0, :] = 1.0
    w[1, :] = 0.0
    propagate(system.rows, system.table, system.scale, 2.0 * window.half, w)
    copy_amplitudes(w, units.step_map[0])
    for n in range(units.coefficients.shape[0]):
        _compute_step_column(system, units, n, window.half, w)
    units.step_length[0] = 2.0 * window.half


@jit_inline
def propagate_sampled_load(load, system, window, forced, w, z):
    """Propagate amplitudes z (2, J), free and forced part, over a window of straight lines.

    Returns True, or False with z unchanged if the window's length differs from that of the step map
    by more than EQUAL_STEP_TOL. The step map is computed again where they differ by more than
    EQUAL_LENGTH_TOL. w (2, J) is scratch.
    """
    units = forced.unit_responses
    length = 2.0 * window.half
    _compute_coefficients(load.terms, load.base, units.coefficients)
    if abs(length - units.step_length[0]) > EQUAL_LENGTH_TOL * length:
        _compute_step_map(load, system, window, forced, w)
    if abs(length - units.step_length[0]) > EQUAL_STEP_TOL * length:
        return False
    _apply_step_map(
        load.base,
        system.rows,
        system.rows.shape[1],
        units.step_map,
        units.coefficients,
        window.half,
        length - units.step_length[0],
        z,
    )
    return True


@jit_separate
def _solve_unit_responses(load, system, window, absorber_mass, guarded, forced):
    """Solve the `UnitResponses` of a regime for windows as long as ``window``.

    ``guarded``: with the guard signal, for which ``absorber_mass`` is as in `solve_forced`. The
    other fields of ``forced`` are used as scratch. The load's terms are overwritten and restored
    from ``coefficients``, which must be those of the load.
    """
    units = forced.unit_responses
    half = WINDOW_SLACK * window.half
    wide = ForceWindow(
        window.centre, half, window.omega, window.alpha, window.force_r, window.force_i, load
    )
    for n in range(units.coefficients.shape[0]):
        _set_unit_term(load.base, load.terms, n, 0.0)
    for n in range(units.coefficients.shape[0]):
        _set_unit_term(load.base, load.terms, n, 1.0)
        if guarded:
            solve_forced(system, wide, absorber_mass, forced)
        else:
            solve_response(system, wide, forced)
        _set_unit_term(load.base, load.terms, n, 0.0)
        _store_unit_response(units.polynomials[n].size, forced.polynomials, units.polynomials, n)
        _store_unit_response(forced.signals.size, forced.signals, units.signals, n)
        for m in range(forced.bound.shape[0]):
            units.bound[n, m] = forced.bound[m]
    for n in range(units.coefficients.shape[0]):
        _set_unit_term(load.base, load.terms, n, units.coefficients[n])
    units.half[0] = half


@jit_inline
def combine_unit_responses(load, system, window, absorber_mass, guarded, forced):
    """Fill a regime's forced response from its `UnitResponses`.

    Returns True, or False with nothing done if the load is not linear in the window. Arguments as
    in `solve_forced`; not ``guarded``: without the guard signal, as in `solve_response`.
    """
    units = forced.unit_responses
    if not load.linear[0]:
        return False
    shares = units.coefficients
    bound = forced.bound
    _compute_coefficients(load.terms, load.base, shares)
    if not SHORTEST_WINDOW_SHARE * units.half[0] <= window.half <= units.half[0]:
        _solve_unit_responses(load, system, window, absorber_mass, guarded, forced)
    compute_force_terms(window, forced.terms)
    half = units.polynomials[0].size
    _combine_unit_responses(
        half, half, load.base, shares, units.polynomials, forced.polynomials
    )  # B is A, since the carrier is 0
    _combine_unit_responses(
        forced.signals.size, 0, load.base, shares, units.signals, forced.signals
    )
    bound[:] = 0.0
    for n in range(shares.shape[0]):
        for m in range(bound.shape[0]):
            bound[m] += abs(shares[n]) * units.bound[n, m]
    for level in range(forced.carrier.shape[0]):
        forced.carrier[level, 0, 0] = np.nan
    return True
