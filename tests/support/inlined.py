"""Print the machine code of a kernel that takes a group of arguments.

The words of the command line are bare (no group), plain (a plain group) or sparing (a group that
limits inlining), in the order of the output.

Prints a line for each word: what the kernel returns, and its instructions without their operands.
"""

import sys
from typing import Any, NamedTuple

import numpy as np
from numba.core.caching import NullCache

from impact_env.kernels.compiling.jit import jit, jit_inline
from impact_env.kernels.compiling.parts import limit_inlining


class Plain(NamedTuple):
    """A group that changes nothing."""

    values: Any


@limit_inlining
class Sparing(NamedTuple):
    """A group whose kernels are inlined sparingly."""

    values: Any


@jit
def far(x, values):
    """Return a sum that LLVM itself would not inline twice."""
    total = 0.0
    for k in range(7):
        total += (
            np.hypot(max(x, k), np.sin(x * k)) / (1.0 + np.cos(x + k))
            + np.exp(-x * k) * np.sqrt(x + k)
            + np.tan(total)
        )
        total += (
            np.hypot(min(x, k), np.cos(x * k)) / (1.0 + np.sin(x + k))
            + np.exp(x / (k + 1)) * np.log(x + k)
            + np.tan(total)
        )
    if values is not None:
        values[0] += total
    return total


@jit_inline
def near(x, values):
    """A function that is inlined at each call, with all that it calls but for a sparing group."""
    return far(x, values) + far(2.0 * x, values)


@jit
def whole(x, group):
    """Call it from Python."""
    return (
        near(x, None) * near(x + 1.0, None)
        if group is None
        else near(x, group.values) * near(x + 1.0, group.values)
    )


def main(kernel: Any) -> None:
    """Print the lines."""
    kernel._cache = NullCache()
    groups = {"bare": None, "plain": Plain(np.zeros(1)), "sparing": Sparing(np.zeros(1))}
    for word in sys.argv[1:]:
        value = kernel(1.5, groups[word])
        code = kernel.inspect_asm(kernel.signatures[-1])
        lines = [
            line.split()[0]
            for line in code.splitlines()
            if line.startswith("\t") and not line.startswith("\t.")
        ]
        print(value.hex(), *lines, flush=True)


if __name__ == "__main__":
    main(whole)
