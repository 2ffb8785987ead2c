"""An additional numba pass on a kernel before its types are inferred.

It removes branches on whether an optional argument is None if the argument's type decides this.
"""

from __future__ import annotations

import operator
from collections.abc import Sequence
from typing import Any

from numba.core import ir, ir_utils, types
from numba.core.compiler_machinery import register_pass
from numba.core.consts import ConstantInference
from numba.core.untyped_passes import DeadBranchPrune


@register_pass(mutates_CFG=True, analysis_only=False)
class PrunePresent(DeadBranchPrune):  # type: ignore[misc]
    """Prune branches on ``is None`` before type inference, also for arguments that are not None.

    numba's pass removes the branch for a value if the argument is None. This pass also removes the
    branch for None if the argument has a value, and does both for a field of a named tuple,
    ``group.part`` or ``part = group.part``.
    """

    _name = "impact_env_prune_present"

    def run_pass(self, state: Any) -> bool:
        """Replace each test that the types decide by a constant, then run numba's pass.

        numba's pass removes branches on constants. Returns whether it changed the code.
        """
        code = state.func_ir
        for block in code.blocks.values():
            for line in block.find_insts(ir.Assign):
                outcome = _is_none(code, state.args, line.value)
                if outcome is not None:
                    known = ir.Const(outcome, line.loc)
                    definitions = code._definitions[line.target.name]
                    definitions[definitions.index(line.value)] = line.value = known
        code._consts = ConstantInference(code)
        return bool(super().run_pass(state))


def _kind_of(code: ir.FunctionIR, args: Sequence[types.Type], value: Any) -> types.Type | None:
    """Return the numba type of an argument or of a named tuple's field, None for other values.

    The named tuple is an argument, or itself a field of such a named tuple. ``args`` are the types
    of the arguments.
    """
    source = ir_utils.guard(ir_utils.get_definition, code, value)
    if isinstance(source, ir.Arg):
        return args[source.index]
    if isinstance(source, ir.Expr) and source.op == "getattr":
        group = _kind_of(code, args, source.value)
        if isinstance(group, types.BaseNamedTuple) and source.attr in group.fields:
            return group.types[group.fields.index(source.attr)]
    return None


def _is_none(code: ir.FunctionIR, args: Sequence[types.Type], test: Any) -> bool | None:
    """Return the value of a test ``x is None`` or ``x is not None``, if types decide it.

    The result is None if they do not, and for any other expression.
    """
    if not (
        isinstance(test, ir.Expr)
        and test.op == "binop"
        and test.fn in (operator.is_, operator.is_not)
    ):
        return None
    none = ir_utils.guard(ir_utils.get_definition, code, test.rhs)
    kind = _kind_of(code, args, test.lhs)
    if (
        not (isinstance(none, ir.Const) and none.value is None)
        or kind is None
        or isinstance(kind, types.Optional)
    ):
        return None
    absent = (
        kind.value is None if isinstance(kind, types.Omitted) else isinstance(kind, types.NoneType)
    )
    return absent is (test.fn is operator.is_)
