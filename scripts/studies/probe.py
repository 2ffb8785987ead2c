"""Measure a variant in a process of its own, for the specialisation report.

It compiles the kernel, inspects the compiled code, times it and prints JSON.

Arguments: absorber, method, record, "inspect" or "time", pseudo periods, repeats. The kernel cache
is that of IMPACT_ENV_CACHE.
"""

import json
import operator
import statistics
import sys
import time
import tracemalloc
from typing import Any

from impact_env import simulate
from optimisation.checkpoint import peak_memory
from studies.variants import METHODS, RECORDS, KernelVariant

LONGER = 10  # memory is compared between a run and one so many times longer


def _lane() -> Any:
    """Return the one lane kernel that has been compiled."""
    from impact_env.kernels.exact import compliant, linear
    from impact_env.kernels.exact import rigid as exact
    from impact_env.kernels.stepping import moreau, runge_kutta

    lanes: tuple[Any, ...] = (
        linear.linear_lane,
        exact.rigid_lane,
        compliant.compliant_lane,
        moreau.moreau_lane,
        runge_kutta.runge_kutta_lane,
    )
    (used,) = (lane for lane in lanes if lane.signatures)
    return used


def _part(dispatcher: Any, signature: Any) -> Any:
    """Return the compiled code of a kernel for the single lane of this process.

    It is the kernel's ``part``, or its ``limited_part`` with limited inlining.
    """
    parts = [getattr(dispatcher, name, dispatcher) for name in ("part", "limited_part")]
    return next(part for part in parts if signature in part.overloads)


def functions(lane: Any) -> list[dict[str, Any]]:
    """Return the functions that a compiled kernel calls, after numba's dead branch pruning.

    Each has its name and number of arithmetic operations.
    """
    from numba.core import ir, types

    entries: dict[tuple[str, Any], dict[str, Any]] = {}

    def walk(dispatcher: Any, signature: Any) -> None:
        workspace, module = dispatcher.py_func.__module__.split(".")[-2:]
        name = f"{workspace if workspace == 'energy' else module}.{dispatcher.py_func.__name__}"
        if (name, signature) in entries:
            return
        notes = dispatcher.overloads[signature].type_annotation
        entry = entries[name, signature] = {"name": name, "arithmetic": 0}
        for block in notes.blocks.values():
            for statement in block.body:
                value = statement.value if isinstance(statement, ir.Assign) else None
                if not isinstance(value, ir.Expr):
                    continue
                entry["arithmetic"] += value.op in (
                    "binop",
                    "inplace_binop",
                    "unary",
                ) and value.fn not in (operator.is_, operator.is_not)
                if value.op == "call":
                    called = notes.typemap[value.func.name]
                    if isinstance(called, types.Dispatcher):
                        walk(
                            _part(called.dispatcher, notes.calltypes[value].args),
                            notes.calltypes[value].args,
                        )

    walk(lane, lane.signatures[0])
    return list(entries.values())


def instructions(lane: Any) -> int:
    """Return the number of machine instructions of a compiled kernel with all that it calls."""
    text = lane.overloads[lane.signatures[0]].library.get_asm_str()
    return sum(
        line.startswith("\t") and not line.lstrip().startswith((".", "#"))
        for line in text.splitlines()
    )


def _peak_kb(variant: KernelVariant, periods: float) -> float:
    """Return the largest memory in kB that Python and NumPy hold at once during a run."""
    scene = variant.scene()
    drive = variant.drive(periods)
    tracemalloc.start()
    simulate(scene, drive, METHODS[variant.method], record=RECORDS[variant.record])
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return peak / 1e3


def main(
    absorber: str, method: str, record: str, what: str, periods: float, repeats: int
) -> dict[str, Any]:
    """Return the measurements of a variant.

    They are its first run, and its compiled code or the times of its runs.
    """
    variant = KernelVariant(absorber, method, record)
    scene = variant.scene()
    drive = variant.drive(1.0)
    began = time.perf_counter()
    simulate(scene, drive, METHODS[method], record=RECORDS[record])
    values: dict[str, Any] = {"first_s": time.perf_counter() - began}
    if what == "inspect":
        return values | {"functions": functions(_lane()), "instructions": instructions(_lane())}
    drive = variant.drive(periods)
    responses = [
        simulate(scene, drive, METHODS[method], record=RECORDS[record]) for _ in range(repeats)
    ]
    values["ns_per_period"] = (
        1e9 * statistics.median(response.wall_time for response in responses) / periods
    )
    values["impacts_per_period"] = responses[0].impact_count / periods
    values["memory_mb"] = 1e-6 * peak_memory()
    values["peak_kb"] = [_peak_kb(variant, length) for length in (periods, LONGER * periods)]
    return values


if __name__ == "__main__":
    names = sys.argv[1:5]
    print(
        json.dumps(
            main(names[0], names[1], names[2], names[3], float(sys.argv[5]), int(sys.argv[6]))
        )
    )
