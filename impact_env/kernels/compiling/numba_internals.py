"""A kernel that Python calls is compiled in one piece with all the kernels that it calls.

numba optimises every function together with the functions that it calls, and makes machine code of
it; then the same happens to its caller. With calls a dozen deep most of this work is discarded.
Here a kernel that another kernel calls stays LLVM's intermediate code, a `Part`; only the kernel
called from Python, a `Kernel`, is optimised and becomes machine code, with all its parts at once.
So its results do not depend on other kernels that a process has compiled. Two further savings:
branches that the type of an optional argument excludes are removed before types are inferred
(passes.py), and a function is not compiled again for each constant that it is called with.

Inlining. In numba a function called by one that is always inlined is always inlined itself, unless
its decorator says otherwise (`jit_separate`). So most of a lane becomes one function, which is fast
and takes long to compile. A kernel with a `limit_inlining` group among its arguments, such as one
that records energies, has parts of its own, of which only those declared `jit_inline` are always
inlined. Where two kernels share a part, and only one of them inlines it, the one that is compiled
first decides for both.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property, partial
from typing import Any

from numba.core import event, sigutils, types
from numba.core.codegen import CodeLibrary, JITCodeLibrary
from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import _FunctionCompiler
from numba.core.registry import CPUDispatcher

from impact_env.kernels.compiling.numba_check import PruningPipeline
from impact_env.kernels.compiling.parts import (
    COMPILING,
    INLINING_LIMITED,
    ONLY_CACHED,
    NotCached,
    run_in_thread,
)

# changed under the compiler's lock
_nested = 0  # number of kernels that are being compiled, one within the other
_inlining_limited = False  # whether the outermost of them has a `limit_inlining` group


def _limits_inlining(kind: Any) -> bool:
    if isinstance(kind, types.BaseNamedTuple) and kind.instance_class in INLINING_LIMITED:
        return True
    return isinstance(kind, types.BaseTuple) and any(_limits_inlining(element) for element in kind)


@contextmanager
def _compiling(args: Sequence[types.Type]) -> Iterator[None]:
    """Count a kernel that is being compiled, within the context, under numba's compiler lock.

    ``args`` are the types of its arguments; those of the outermost kernel decide for all nested
    ones whether inlining is limited.
    """
    global _nested, _inlining_limited
    with global_compiler_lock:
        if not _nested:
            _inlining_limited = any(map(_limits_inlining, args))
        _nested += 1
        try:
            yield
        finally:
            _nested -= 1


class PartLibrary(JITCodeLibrary):  # type: ignore[misc]
    """The code of one part before LLVM's module passes.

    The libraries of the functions that it calls are stored with it.
    """

    def finalize(self) -> None:
        """Finish the library without machine code, for linking into a `WholeLibrary`."""
        self._raise_if_finalized()
        self._finalize_dynamic_globals()
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage.name == "external":
                # like numba's own functions for linking: may exist twice, be inlined or dropped
                function.linkage = "linkonce_odr"
        self._shared_module = self._final_module
        self._finalized = True


class WholeLibrary(JITCodeLibrary):  # type: ignore[misc]
    """The machine code of a kernel and of all its parts."""

    def finalize(self) -> None:
        """Link all parts and their parts, each once; optimise, and make machine code."""
        self._linking_libraries = order_libraries(self._linking_libraries)
        super().finalize()


def order_libraries(libraries: Sequence[CodeLibrary]) -> list[CodeLibrary]:
    """Return libraries, and all libraries that they link, in the order that LLVM's linker needs.

    A library precedes the libraries that it uses. Each is listed once.
    """
    visited: set[CodeLibrary] = set()
    backwards: list[CodeLibrary] = []

    def visit(library: CodeLibrary) -> None:
        if library in visited:
            return
        visited.add(library)
        if isinstance(library, PartLibrary):
            for used in reversed(library._linking_libraries):
                visit(used)
        backwards.append(library)

    for library in reversed(libraries):
        visit(library)
    return backwards[::-1]


class _Pipeline(PruningPipeline):
    """The passes of kernels, which write into a library of the class ``library_class``."""

    library_class: type[JITCodeLibrary]

    def __init__(self, typingctx: Any, targetctx: Any, library: Any, *others: Any) -> None:
        if library is None:
            library = self.library_class(targetctx.codegen(), self.library_class.__name__)
            library.enable_object_caching()
        super().__init__(typingctx, targetctx, library, *others)


class _PartPipeline(_Pipeline):
    library_class = PartLibrary


class _WholePipeline(_Pipeline):
    library_class = WholeLibrary


class _PartCompiler(_FunctionCompiler):  # type: ignore[misc]
    """A compiler that makes neither machine code nor the wrapper for callers in Python."""

    def _customize_flags(self, flags: Any) -> Any:
        flags.no_compile = flags.no_cpython_wrapper = True
        return flags

    def _compile_core(self, args: Any, return_type: Any) -> Any:
        result = super()._compile_core(args, return_type)
        name = object()  # key by which callers find the part, in place of a pointer to a function
        result.library._ensure_finalized()
        result.target_context.insert_user_function(name, result.fndesc, [result.library])
        return result._replace(entry_point=name)


class _LimitedInliningCompiler(_PartCompiler):
    """A compiler that always inlines a part only if its own decorator says so.

    That its caller is always inlined has no effect.
    """

    def _customize_flags(self, flags: Any) -> Any:
        flags.forceinline = bool(self.targetoptions.get("forceinline"))
        return super()._customize_flags(flags)


class _WholeCompiler(_FunctionCompiler):  # type: ignore[misc]
    def _compile_core(self, args: Any, return_type: Any) -> Any:
        if ONLY_CACHED.get():
            raise NotCached
        with event.trigger_event(COMPILING):
            result = super()._compile_core(args, return_type)
        for environment in (
            result._find_referenced_environments()
        ):  # those of the parts, which have no machine code that would set them
            result.codegen.set_env(environment.env_name, environment)
        return result


class Part(CPUDispatcher):  # type: ignore[misc]
    """A kernel as other kernels call it: LLVM's intermediate code without machine code.

    Python cannot call it.
    """

    def __init__(
        self, function: Callable[..., Any], options: dict[str, Any], compiler: type[_PartCompiler]
    ) -> None:
        super().__init__(function, {}, options, _PartPipeline)
        self._compiler = compiler(function, self.targetdescr, options, {}, _PartPipeline)

    def compile(self, signature: Any) -> Any:
        """Compile for a caller in a kernel, once for each signature; return the key of the part.

        numba's timers are left out, because they would be triggered by every nested part.
        """
        args, result_type = sigutils.normalize_signature(signature)
        if args not in self.overloads:
            with self._compiling_counter:
                self.overloads[args] = self._compiler.compile(
                    args, result_type
                )  # Python cannot call it
        return self.overloads[args].entry_point


class Kernel(CPUDispatcher):  # type: ignore[misc]
    """A kernel as it is called from Python.

    Kernels that call it use its `part` or its `limited_part` instead. ``wait`` is None, or a
    function that returns when another process has finished compiling this kernel.
    """

    def __init__(self, function: Callable[..., Any], _locals: Any, options: dict[str, Any]) -> None:
        super().__init__(function, {}, options, _WholePipeline)
        self._compiler = _WholeCompiler(function, self.targetdescr, options, {}, _WholePipeline)
        self.wait: Callable[[], object] | None = (
            None  # set in prepare.py while another process compiles this kernel
        )

    @cached_property
    def part(self) -> Part:
        """The `Part` that other kernels call."""
        return Part(self.py_func, self.targetoptions, _PartCompiler)

    @cached_property
    def limited_part(self) -> Part:
        """The `Part` that kernels with limited inlining call."""
        return Part(self.py_func, self.targetoptions, _LimitedInliningCompiler)

    @property
    def _called(self) -> Part:
        return self.limited_part if _inlining_limited else self.part

    def compile(self, signature: Any) -> Any:
        """Compile for a caller in Python, or in a numba function that is no kernel.

        Code that is in the cache is loaded instead. Either runs in a separate thread, unless the
        current thread is compiling already. Raises NotCached under `only_cached`, and
        CompilationAbandoned under `abandon_compilations`.
        """
        if global_compiler_lock.is_locked():
            return self._compile(signature)
        return run_in_thread(partial(self._compile, signature))

    def _compile(self, signature: Any) -> Any:
        if self.wait is not None:
            self.wait()
        with _compiling(sigutils.normalize_signature(signature)[0]):
            return super().compile(signature)

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Return numba's template of a call, for a caller's type inference.

        Within kernels the types of constants are replaced by those of numbers, so that one part
        serves all callers.
        """
        if not _nested:
            return super().get_call_template(args, kws)
        return self._called.get_call_template(
            tuple(map(types.unliteral, args)),
            {name: types.unliteral(kind) for name, kind in kws.items()},
        )

    def get_overload(self, signature: Any) -> Any:
        """Return the entry point for a caller: of the `Part` within kernels, else the kernel's."""
        return self._called.get_overload(signature) if _nested else super().get_overload(signature)


def kernel(function: Callable[..., Any], **options: Any) -> Kernel:
    """Return a `Kernel` that is compiled when it is first called; ``options`` as of ``njit``."""
    return Kernel(function, {}, {"nopython": True, "boundscheck": None, **options})
