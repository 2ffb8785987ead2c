"""How a kernel becomes LLVM's intermediate code: without slots in memory for what is set once, and without taking apart what was just put together.

Kernels hand groups of arrays to each other. A variable that several blocks of a function share numba keeps in memory: every use loads the whole
group, and every call takes it apart, member by member. That is half of the code, which is written as text, read, and thrown away again by LLVM.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any

from llvmlite.ir import IRBuilder, Value
from llvmlite.ir.instructions import InsertValue
from numba.core import ir
from numba.core.analysis import compute_use_defs
from numba.core.compiler_machinery import register_pass
from numba.core.lowering import Lower
from numba.core.typed_passes import NativeLowering


class Builder(IRBuilder):  # type: ignore[misc]
    """llvmlite's builder, which finds a member that was put into a group in the same function without a new instruction."""

    def extract_value(self, agg: Value, idx: int | Sequence[int], name: str = "") -> Value:
        """Return a member of a group."""
        place, group = [idx] if isinstance(idx, int) else list(idx), agg
        while isinstance(group, InsertValue) and len(place) == len(group.indices) == 1:
            if list(group.indices) == place:
                return group.value
            group = group.aggregate
        return super().extract_value(agg, place, name)


class KernelLower(Lower):  # type: ignore[misc]
    """numba's, which also keeps out of memory what only the first block sets, once: it is there in all other blocks, too."""

    def setup_function(self, fndesc: Any) -> None:
        """Declare the function, as numba, with the builder of kernels."""
        super().setup_function(fndesc)
        self.builder = Builder(self.entry_block)
        self.call_helper = self.call_conv.init_call_helper(self.builder)

    def _find_singly_assigned_variable(self) -> None:
        super()._find_singly_assigned_variable()
        if not self.context.enable_nrt and not self.func_ir.func_id.is_generator:  # what counts references counts them in memory
            self._singly_assigned_vars.update(self._set_at_the_start())

    def _set_at_the_start(self) -> Iterator[str]:
        """Yield variables that nothing but the first block sets, once and before it uses them."""
        times = Counter(line.target.name for block in self.blocks.values() for line in block.find_insts(ir.Assign))
        first = self.blocks[self.firstblk]
        used_before = compute_use_defs({self.firstblk: first}).usemap[self.firstblk]
        for line in first.find_insts(ir.Assign):
            name = line.target.name
            if times[name] == 1 and name not in used_before:
                yield name


@register_pass(mutates_CFG=True, analysis_only=False)
class KernelLowering(NativeLowering):  # type: ignore[misc]
    """numba's pass with `KernelLower`."""

    _name = "impact_env_kernel_lowering"

    @property
    def lowering_class(self) -> type[Lower]:
        """What turns numba's code into LLVM's."""
        return KernelLower
