"""Machine instructions of a lane, one a line: argument 1 is the scene, 2 the method, 3 whether numba compiles it "spared" or in "full".

In full: numba's own passes with the one that kernels cannot do without, and nothing remembered.
"""

from __future__ import annotations

import re
import sys
from contextlib import nullcontext
from typing import Any

from numba.core.caching import NullCache
from numba.core.untyped_passes import InlineInlinables

from impact_env import Record, simulate
from impact_env.kernels import linear, moreau, parts, runge_kutta
from impact_env.kernels.passes import PrunePresent
from optimisation.studies.variants import METHODS, Variant

# they count what was compiled before, or are hashes that no two processes share
NAMES = re.compile(
    r'_ZN[\w.$]+|\.L[\w.$]+|NRT_\w+|_Z\w+|v\d+|\.const\.[\w.$]+|"?\.bytes\.-?\d+"?'
)  # these count what was compiled before, or are hashes that no two processes share


def full_passes(given: Any, _sparing: bool) -> Any:
    """Return numba's passes and the one that drops branches for what is there."""
    given.add_pass_after(PrunePresent, InlineInlinables)
    given.finalize()
    return given


def instructions(lane: Any) -> list[str]:
    """Return a compiled lane's instructions with names counted in the order in which they come."""
    lines = lane.overloads[lane.signatures[0]].library.get_asm_str().splitlines()
    code = [line for line in lines if line.startswith("\t") and not line.lstrip().startswith((".", "#"))]
    known: dict[str, str] = {}
    return [NAMES.sub(lambda name: known.setdefault(name.group(), f"n{len(known)}"), line) for line in code]


def main(absorber: str, method: str, way: str) -> None:
    """Print them."""
    if way == "full":
        parts.kernel_passes, parts.spared = full_passes, nullcontext  # type: ignore[assignment]
    lanes = (linear.linear_lane, moreau.moreau_lane, runge_kutta.runge_kutta_lane)
    for lane in lanes:
        lane._cache = NullCache()
    variant = Variant(absorber, method)
    simulate(variant.scene(), variant.drive(1.0), METHODS[method], record=Record())
    (used,) = (lane for lane in lanes if lane.signatures)
    print("\n".join(instructions(used)))


if __name__ == "__main__":
    main(*sys.argv[1:])
