"""What numba does to a kernel before LLVM: its passes, with what kernels need more and less.

Two thirds of the time of a first compilation are numba's own Python code: here it is spared what no kernel has.
"""

from __future__ import annotations

import operator
from collections.abc import Sequence
from typing import Any

from numba.core import ir, ir_utils, types
from numba.core.compiler import Flags as NumbaFlags
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.consts import ConstantInference
from numba.core.typed_passes import NativeLowering, NopythonRewrites
from numba.core.untyped_passes import DeadBranchPrune, InlineClosureLikes, InlineInlinables

from impact_env.kernels.lowering import KernelLowering

_MAKING = ("binop", "inplace_binop", "unary", "call")


class Passes(PassManager):  # type: ignore[misc]
    """numba's manager of passes without its records of each: to write down all arguments' types before every pass takes time."""

    def _runPass(self, _index: int, one: Any, state: Any) -> None:  # noqa: N802 - numba's name
        one.analysis = self._analysis
        one.run_initialization(state)
        one.run_pass(state)
        one.run_finalizer(state)


def kernel_passes(given: PassManager, sparing: bool = False) -> Passes:
    """Return numba's passes with `PrunePresent`, our own in place of some, and without that for functions within, which no kernel has.

    ``sparing``: with `KernelLowering`, for kernels that record much. The bare ones keep numba's, whose machine code differs by a few instructions.
    """
    own = Passes(given.pipeline_name)
    instead = {NopythonRewrites: RewriteArrays} | ({NativeLowering: KernelLowering} if sparing else {})
    own.passes = [(instead.get(one, one), what) for one, what in given.passes if one is not InlineClosureLikes]
    own.add_pass_after(PrunePresent, InlineInlinables)
    own.finalize()
    return own


@register_pass(mutates_CFG=True, analysis_only=False)
class RewriteArrays(NopythonRewrites):  # type: ignore[misc]
    """numba's rewriting of expressions of whole arrays, where there may be one: it prepares and tidies up each function at length before it looks."""

    _name = "impact_env_rewrite_arrays"

    def run_pass(self, state: Any) -> bool:
        """Run numba's pass if an operation or a call has an array for a result."""
        assigned = (line for block in state.func_ir.blocks.values() for line in block.find_insts(ir.Assign))
        found = (state.typemap[line.target.name] for line in assigned if isinstance(line.value, ir.Expr) and line.value.op in _MAKING)
        return any(isinstance(kind, types.Array) for kind in found) and bool(super().run_pass(state))


@register_pass(mutates_CFG=True, analysis_only=False)
class PrunePresent(DeadBranchPrune):  # type: ignore[misc]
    """numba's pass drops the branch for a part that is there where the argument is None.

    This one also drops that for None where it is there, and does both for a field of a named tuple, ``group.part`` or ``part = group.part``.
    """

    _name = "impact_env_prune_present"

    def run_pass(self, state: Any) -> bool:
        """Put a constant for each test whose outcome the types tell, then run numba's pass, which drops branches on constants."""
        code = state.func_ir
        for block in code.blocks.values():
            for line in block.find_insts(ir.Assign):
                outcome = _is_none(code, state.args, line.value)
                if outcome is not None:
                    known, definitions = ir.Const(outcome, line.loc), code._definitions[line.target.name]
                    definitions[definitions.index(line.value)] = line.value = known
        code._consts = ConstantInference(code)
        return bool(super().run_pass(state))


def _kind_of(code: ir.FunctionIR, args: Sequence[types.Type], value: Any) -> types.Type | None:
    """Return the type of what is an argument or, read by its name, a field of a named tuple that is one (or a field of one); None of all else."""
    source = ir_utils.guard(ir_utils.get_definition, code, value)
    if isinstance(source, ir.Arg):
        return args[source.index]
    if isinstance(source, ir.Expr) and source.op == "getattr":
        group = _kind_of(code, args, source.value)
        if isinstance(group, types.BaseNamedTuple) and source.attr in group.fields:
            return group.types[group.fields.index(source.attr)]
    return None


def _is_none(code: ir.FunctionIR, args: Sequence[types.Type], test: Any) -> bool | None:
    """Return what ``x is None`` or ``x is not None`` comes to; None where types do not tell, or for any other expression."""
    if not (isinstance(test, ir.Expr) and test.op == "binop" and test.fn in (operator.is_, operator.is_not)):
        return None
    none = ir_utils.guard(ir_utils.get_definition, code, test.rhs)
    kind = _kind_of(code, args, test.lhs)
    if not (isinstance(none, ir.Const) and none.value is None) or kind is None or isinstance(kind, types.Optional):
        return None
    absent = kind.value is None if isinstance(kind, types.Omitted) else isinstance(kind, types.NoneType)
    return absent is (test.fn is operator.is_)


class Flags(NumbaFlags):  # type: ignore[misc]
    """numba's flags as keys of its caches: compared by those that are set, in one word each. numba asks each of 30 options at every look-up."""

    def _word(self) -> str:
        word: str | None = self.__dict__.get("word")
        if word is None:  # keys do not change
            word = self.word = str(sorted((name, str(value)) for name, value in self._values.items()))
        return word

    def __hash__(self) -> int:
        return hash(self._word())

    def __eq__(self, other: object) -> bool:
        return self._word() == other._word() if isinstance(other, Flags) else bool(super().__eq__(other))
