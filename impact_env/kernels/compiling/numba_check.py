"""Which of numba's internals the kernels rely on, and how they are compiled without them.

`numba_internals.py` compiles a kernel in one piece with all that it calls, which takes a third of
the time. It relies on internals of numba. Where the installed version is not one of those tested,
or lacks one of these internals, kernels are compiled by documented options of numba alone: the same
results up to rounding, and more time to compile.

Branches on ``is None`` are pruned in both cases (passes.py): without that pass numba cannot infer
the kernels' types.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Callable
from functools import cache
from importlib import import_module
from typing import Any

import numba
from numba.core.compiler import Compiler
from numba.core.untyped_passes import InlineInlinables

from impact_env.kernels.compiling.passes import PrunePresent

LOG = logging.getLogger("impact_env")
OLDEST_TESTED = (0, 65)  # version of numba
FIRST_UNTESTED = (0, 70)
# environment variable; "1": no internals are used
DOCUMENTED_ONLY = "IMPACT_ENV_DOCUMENTED_NUMBA"
# classes of numba with the methods that numba_internals.py calls or replaces
INTERNALS = {
    "numba.core.codegen.JITCodeLibrary": (
        "finalize",
        "_raise_if_finalized",
        "_finalize_dynamic_globals",
        "_ensure_finalized",
    ),
    "numba.core.dispatcher._FunctionCompiler": ("compile", "_compile_core", "_customize_flags"),
    "numba.core.registry.CPUDispatcher": ("compile", "get_call_template", "get_overload"),
    "numba.core.compiler.CompileResult": ("_find_referenced_environments",),
    "numba.core.caching.FunctionCache": ("_load_overload", "_save_overload", "_index_key"),
    "numba.core.caching.IndexDataCacheFile": ("_load_index", "_load_data", "_open_for_write"),
}
# options of `njit` that numba documents
DOCUMENTED_OPTIONS = {"nogil", "error_model", "inline", "forceinline"}


@cache
def find_obstacle() -> str:
    """Return why numba's internals are not used; an empty string if they are."""
    if os.environ.get(DOCUMENTED_ONLY) == "1":
        return f"{DOCUMENTED_ONLY} is set"
    version = tuple(int(number) for number in numba.__version__.split(".")[:2])
    if not OLDEST_TESTED <= version < FIRST_UNTESTED:
        return f"numba {numba.__version__} is not one of the versions tested"
    for name, methods in INTERNALS.items():
        module, _, kind = name.rpartition(".")
        owner = getattr(import_module(module), kind, None)
        missing = [method for method in methods if not hasattr(owner, method)]
        if missing:
            return f"numba {numba.__version__} has no {name}.{missing[0]}"
    return ""


@cache
def warn_of_obstacle() -> None:
    """Log a warning, once, that kernels are compiled by documented options of numba alone."""
    LOG.warning(
        "kernels are compiled by documented options of numba alone, which takes longer: %s",
        find_obstacle(),
    )


class PruningPipeline(Compiler):  # type: ignore[misc]
    """numba's compiler with the additional pass `PrunePresent`."""

    def define_pipelines(self) -> list[Any]:
        """Return numba's pass managers, with `PrunePresent` in each."""
        managers: list[Any] = super().define_pipelines()
        for manager in managers:
            manager.add_pass_after(PrunePresent, InlineInlinables)
            manager.finalize()
        return managers


def compile_documented(function: Callable[..., Any], **options: Any) -> Any:
    """Return a kernel that numba compiles with documented options only.

    Other ``options`` of ``njit`` are ignored. The kernel has no cache: it is compiled again in each
    process.
    """
    warn_of_obstacle()
    known = {name: value for name, value in options.items() if name in DOCUMENTED_OPTIONS}
    return numba.njit(pipeline_class=PruningPipeline, **known)(function)
