"""What numba is spared while it compiles a kernel: results, its own state before and after, and the machine code are as without."""

from __future__ import annotations

import atexit
import gc
import os
import subprocess
import sys

import numpy as np
import pytest
from numba.core import types
from numba.core.compiler_machinery import PassManager
from numba.core.errors import TypingError
from numba.core.registry import cpu_target
from numba.core.typed_passes import NativeLowering, NopythonRewrites, NopythonTypeInference
from numba.core.untyped_passes import InlineClosureLikes, InlineInlinables, IRProcessing
from places import ROOT, SUPPORT

from impact_env.kernels import parts
from impact_env.kernels.lowering import KernelLowering
from impact_env.kernels.parts import kernel
from impact_env.kernels.passes import Flags, PrunePresent, RewriteArrays, kernel_passes
from impact_env.kernels.spared import spared


@pytest.mark.parametrize(("absorber", "method"), [("no absorber", "exact"), ("impact and friction", "moreau"), ("no absorber", "runge-kutta")])
def test_a_lane_has_the_machine_instructions_that_numba_s_own_passes_give(absorber: str, method: str) -> None:
    """In fresh processes; two of these have expressions of whole arrays."""
    code = []
    for way in ("full", "spared"):
        words = [sys.executable, str(SUPPORT / "spared.py"), absorber, method, way]
        done = subprocess.run(words, env=os.environ | {"PYTHONPATH": str(ROOT)}, capture_output=True, text=True, timeout=300)
        assert done.returncode == 0, done.stderr
        code.append(done.stdout.splitlines())
    assert len(code[0]) > 1000
    assert code[0] == code[1]


def test_an_expression_of_whole_arrays_is_rewritten(monkeypatch: pytest.MonkeyPatch) -> None:
    ran: list[str] = []
    rewrite = NopythonRewrites.run_pass
    monkeypatch.setattr(NopythonRewrites, "run_pass", lambda self, state: ran.append(state.func_id.func_name) or rewrite(self, state))
    assert kernel(lambda x: x * x)(3.0) == 9.0
    assert ran == []
    total = kernel(lambda x, y: (2.0 * x + y * y).sum(), _nrt=True)
    x, y = np.arange(5.0), np.linspace(-1, 1, 5)
    assert total(x, y) == pytest.approx((2 * x + y**2).sum(), rel=1e-15)
    assert "<lambda>" in ran  # and in functions of numba's own that it calls


def test_numba_infers_as_before_once_a_kernel_is_compiled_or_refused() -> None:
    assert "get_call_type" not in vars(types.Function)
    product = kernel(lambda x, y: x * y + x)
    assert product(2.0, 3.0) == 8.0
    assert product(2, 3) == 8  # other types: inferred anew
    assert product(2.0, 3) == 8.0
    assert [str(kind) for kind in product.nopython_signatures] == [
        "(float64, float64) -> float64",
        "(int64, int64) -> int64",
        "(float64, int64) -> float64",
    ]
    with pytest.raises(TypingError):
        product("two", 3.0)
    assert "get_call_type" not in vars(types.Function)
    assert gc.isenabled()


def test_calls_are_inferred_once_for_each_types() -> None:
    context, seen = cpu_target.typing_context, []
    context.refresh()
    largest = context.resolve_value_type(max)
    infer = types.BaseFunction.get_call_type
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(types.BaseFunction, "get_call_type", lambda *given: seen.append(given[0::2]) or infer(*given))
        with spared():
            found = [largest.get_call_type(context, (types.float64, kind), {}) for kind in (types.float64, types.int64, types.float64)]
    assert [str(signature.return_type) for signature in found] == ["float64"] * 3
    assert found[0] is found[2]
    assert [kinds for function, kinds in seen if function is largest] == [(types.float64, types.float64), (types.float64, types.int64)]


@pytest.mark.parametrize("collects", [True, False])
def test_garbage_is_looked_for_as_before(collects: bool) -> None:
    was = gc.isenabled()
    try:
        (gc.enable if collects else gc.disable)()
        assert kernel(lambda x: x + 1)(1.0) == 2.0
        assert gc.isenabled() == collects
    finally:
        (gc.enable if was else gc.disable)()


def test_a_process_that_compiled_looks_for_no_garbage_when_it_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    registered: list[object] = []
    monkeypatch.setattr(atexit, "register", registered.append)
    parts._leave_quickly.cache_clear()
    for k in (3, 4):
        assert kernel(lambda x, k=k: x + k)(1.0) == 1.0 + k
    assert registered.count(gc.freeze) == 1


def test_objects_that_a_program_froze_stay_frozen() -> None:
    gc.freeze()
    try:
        frozen = gc.get_freeze_count()
        assert kernel(lambda x: x + 2)(1.0) == 3.0
        assert gc.get_freeze_count() > 0.9 * frozen  # some may have died
    finally:
        gc.unfreeze()


def test_flags_are_equal_if_what_is_set_is() -> None:
    first, same, other = Flags(), Flags(), Flags()
    first.nrt = same.nrt = True
    other.nrt = False
    assert first == same
    assert hash(first) == hash(same)
    assert first != other
    assert len({first, same, other}) == 2


def test_passes_are_numbas_with_one_more_one_replaced_and_one_left_out() -> None:
    given = PassManager("any")
    for one in (IRProcessing, InlineClosureLikes, InlineInlinables, NopythonTypeInference, NopythonRewrites, NativeLowering):
        given.add_pass(one)
    first = [IRProcessing, InlineInlinables, PrunePresent, NopythonTypeInference, RewriteArrays]
    assert [one for one, _ in kernel_passes(given).passes] == [*first, NativeLowering]
    assert [one for one, _ in kernel_passes(given, sparing=True).passes] == [*first, KernelLowering]
