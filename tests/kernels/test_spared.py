"""What numba is spared while it compiles a kernel is put back, and is told all the same to who asks; groups stay out of memory where that is safe."""

from __future__ import annotations

from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
import pytest
from numba.core import analysis, event, types
from numba.core.base import BaseContext
from numba.core.codegen import JITCodeLibrary
from numba.core.datamodel import ArgPacker
from numba.core.lowering import Lower
from numba.core.postproc import PostProcessor
from numba.core.registry import cpu_target
from numpy.typing import NDArray

from impact_env.kernels.parts import kernel, sparing
from impact_env.kernels.spared import spared


class Bare(NamedTuple):
    """A group of arrays."""

    x: NDArray[np.float64]
    y: NDArray[np.float64]


@sparing
class Recorded(NamedTuple):
    """The same, of kernels that are inlined sparingly."""

    x: NDArray[np.float64]
    y: NDArray[np.float64]


def product(group: Any, scale: float) -> float:
    """Use arguments in several blocks, and variables that are set once, twice, or in one branch only."""
    first, total = group.x[0], 0.0
    twice = scale
    for k in range(group.x.shape[0]):
        if group.x[k] > 1.0:
            late = group.y[k]
            total += late * scale
        twice = twice + first
    return total + twice + group.y[0]


def _state() -> list[Any]:
    return [types.Function.get_call_type, BaseContext.get_arg_packer, PostProcessor.run, event.start_event, event.end_event, *vars(types.Function)]


def test_numba_is_as_before_afterwards_even_after_an_error() -> None:
    before = _state()
    meanwhile = before
    with suppress(ZeroDivisionError), spared():
        meanwhile = _state()
        raise ZeroDivisionError
    assert all(one is not another for one, another in zip(meanwhile[:5], before[:5], strict=True))
    assert _state() == before


@pytest.mark.parametrize("of", [Bare, Recorded])
def test_a_kernel_gives_what_python_gives(of: Any) -> None:
    inner = kernel(product, _nrt=False)
    outer = kernel(lambda group, scale: inner(group, scale) - 2.0 * inner(group, 3.0), _nrt=False)
    group = of(np.array([0.5, 2.0, 3.0]), np.array([1.0, 4.0, 5.0]))
    assert outer(group, 0.25) == product(group, 0.25) - 2.0 * product(group, 3.0)


def test_a_kernel_that_records_keeps_no_group_in_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    kept: dict[type, set[str]] = {Bare: set(), Recorded: set()}
    members = dict.fromkeys(kept, 0)
    alloca, add = Lower.alloca, JITCodeLibrary.add_ir_module
    for of in kept:
        monkeypatch.setattr(Lower, "alloca", lambda self, name, kind, of=of: kept[of].add(name) or alloca(self, name, kind))

        def count(self: Any, module: Any, of: type = of) -> None:
            members[of] += str(module).count("extractvalue")
            add(self, module)

        monkeypatch.setattr(JITCodeLibrary, "add_ir_module", count)
        kernel(product, _nrt=False)(of(np.ones(3), np.ones(3)), 0.5)
    assert {"group", "scale"} <= kept[Bare]
    assert not {"group", "scale"} & kept[Recorded]
    assert {name.split(".")[0] for name in kept[Recorded]} >= {"total", "twice"}  # set more than once
    assert 0 < members[Recorded] < members[Bare]


def test_how_arguments_are_handed_on_is_found_out_once(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Any] = []
    begin = ArgPacker.__init__
    monkeypatch.setattr(ArgPacker, "__init__", lambda self, manager, kinds: made.append(tuple(kinds)) or begin(self, manager, kinds))
    context = cpu_target.target_context
    with spared():
        found = [context.get_arg_packer(kinds) for kinds in ([types.int64], (types.int64,), [types.float64])]
    assert made == [(types.int64,), (types.float64,)]
    assert found[0] is found[1]
    assert found[0] is not found[2]


def test_who_listens_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[str] = []
    tell = event.broadcast
    monkeypatch.setattr(event, "broadcast", lambda one: told.append(one.kind) or tell(one))
    with spared():
        event.start_event("numba:llvm_lock")
        event.end_event("numba:llvm_lock")
        assert told == []
        with event.install_recorder("numba:llvm_lock") as heard:
            event.start_event("numba:llvm_lock", data={"what": 1})
            event.end_event("numba:llvm_lock", exc_details=(None, None, None))
    assert [(one.is_start, one.is_end) for _, one in heard.buffer] == [(True, False), (False, True)]
    assert heard.buffer[0][1].data == {"what": 1}


def test_how_long_variables_live_is_found_out_at_the_end_only(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []
    live = analysis.compute_live_variables
    monkeypatch.setattr(analysis, "compute_live_variables", lambda *given: asked.append(1) or live(*given))
    assert kernel(lambda x, y: x + 2.0 * y)(1.0, 3.0) == 7.0
    assert len(asked) == 1
