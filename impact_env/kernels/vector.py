"""The two innermost loops of the event search, written as vector code.

LLVM cannot know that a lane's amplitudes and a regime's tables do not overlap, and so would keep neither in registers. A vector of 8 numbers
becomes what the processor has: one, two or four registers.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

POINTS = 8  # times in a block
ROW = 16  # distance of two orders in a block
LANES = 4  # slots in a vector of `turn`: their number is padded to a multiple of it

_DOUBLE = ir.DoubleType()
_FLAGS = ("reassoc", "contract", "nsz")


def _data(context: Any, builder: Any, kind: Any, array: Any) -> Any:
    return context.make_array(kind)(context, builder, array).data


def _vector(builder: Any, pointer: Any, index: Any, size: int) -> Any:
    """Return a pointer to the vector of ``size`` numbers from ``index`` on."""
    return builder.bitcast(builder.gep(pointer, [index]), ir.VectorType(_DOUBLE, size).as_pointer())


def _load(builder: Any, pointer: Any, index: Any, size: int) -> Any:
    return builder.load(_vector(builder, pointer, index, size), align=8)


def _spread(builder: Any, number: Any, size: int) -> Any:
    """Return a vector that repeats a number."""
    undefined = ir.Constant(ir.VectorType(_DOUBLE, size), ir.Undefined)
    first = builder.insert_element(undefined, number, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(first, undefined, ir.Constant(ir.VectorType(ir.IntType(32), size), [0] * size))


def _const(number: int) -> Any:
    return ir.Constant(ir.IntType(64), number)


def _block_sums(orders: int) -> Any:
    def block_sums(typing_context, waves, start, w, size, count, out):  # type: ignore[no-untyped-def]
        signature = types.void(waves, types.int64, w, types.int64, types.int64, out)

        def build(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
            waves_type, _, w_type, _, _, out_type = signature.args
            table = _data(context, builder, waves_type, arguments[0])
            amplitudes = _data(context, builder, w_type, arguments[2])
            target = _data(context, builder, out_type, arguments[5])
            start, size, count = arguments[1], arguments[3], arguments[4]
            zero = ir.Constant(ir.VectorType(_DOUBLE, POINTS), [0.0] * POINTS)
            sums = [cgutils.alloca_once_value(builder, zero) for _ in range(orders)]
            firsts = [cgutils.alloca_once_value(builder, ir.Constant(_DOUBLE, 0.0)) for _ in range(orders)]
            with cgutils.for_range(builder, count) as loop:
                at = builder.add(start, builder.mul(loop.index, _const(2 * POINTS)))
                wave_r, wave_i = _load(builder, table, at, POINTS), _load(builder, table, builder.add(at, _const(POINTS)), POINTS)
                for q in range(orders):
                    index = builder.add(builder.mul(size, _const(2 * q)), loop.index)
                    w_r = builder.load(builder.gep(amplitudes, [index]))
                    w_i = builder.load(builder.gep(amplitudes, [builder.add(index, size)]))
                    real = builder.fmul(_spread(builder, w_r, POINTS), wave_r, flags=_FLAGS)
                    imaginary = builder.fmul(_spread(builder, w_i, POINTS), wave_i, flags=_FLAGS)
                    total = builder.fadd(builder.load(sums[q]), real, flags=_FLAGS)
                    builder.store(builder.fsub(total, imaginary, flags=_FLAGS), sums[q])
                    builder.store(builder.fadd(builder.load(firsts[q]), w_r, flags=_FLAGS), firsts[q])
            for q in range(orders):
                builder.store(builder.load(firsts[q]), builder.gep(target, [_const(ROW * q)]))
                builder.store(builder.load(sums[q]), _vector(builder, target, _const(ROW * q + 1), POINTS), align=8)
            return context.get_dummy_value()

        return signature, build

    block_sums.__doc__ = f"""Write sum_j Re(w[q, j] wave[j, k]) to out[ROW q + 1 + k] and sum_j Re(w[q, j]) to out[ROW q] for q < {orders}, k < POINTS.

    ``waves``: flat table, from ``start`` on POINTS real and POINTS imaginary parts a slot; ``w``: flat (q, 2, size); ``count``: slots to sum.
    """
    return intrinsic(block_sums)


def _turn(orders: int) -> Any:
    def turn(typing_context, turns, start, w, size):  # type: ignore[no-untyped-def]
        signature = types.void(turns, types.int64, w, types.int64)

        def build(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
            turns_type, _, w_type, _ = signature.args
            table = _data(context, builder, turns_type, arguments[0])
            amplitudes = _data(context, builder, w_type, arguments[2])
            start, size = arguments[1], arguments[3]
            with cgutils.for_range_slice(builder, _const(0), size, _const(LANES), inc=True) as (j, _):
                at = builder.add(start, j)
                t_r, t_i = _load(builder, table, at, LANES), _load(builder, table, builder.add(at, size), LANES)
                for q in range(orders):
                    index = builder.add(builder.mul(size, _const(2 * q)), j)
                    other = builder.add(index, size)
                    w_r, w_i = _load(builder, amplitudes, index, LANES), _load(builder, amplitudes, other, LANES)
                    real = builder.fsub(builder.fmul(w_r, t_r, flags=_FLAGS), builder.fmul(w_i, t_i, flags=_FLAGS), flags=_FLAGS)
                    imaginary = builder.fadd(builder.fmul(w_r, t_i, flags=_FLAGS), builder.fmul(w_i, t_r, flags=_FLAGS), flags=_FLAGS)
                    builder.store(real, _vector(builder, amplitudes, index, LANES), align=8)
                    builder.store(imaginary, _vector(builder, amplitudes, other, LANES), align=8)
            return context.get_dummy_value()

        return signature, build

    turn.__doc__ = f"""Multiply w[q, j] by turn[j] for q < {orders}; ``turns``: flat, from ``start`` on ``size`` real, then ``size`` imaginary parts."""
    return intrinsic(turn)


block_sums_2, block_sums_3 = _block_sums(2), _block_sums(3)
turn_2, turn_3 = _turn(2), _turn(3)
