"""What numba is spared while it compiles a kernel: what it would find out again and again, count, or tell nobody.

All is put in place of numba's own under the compiler's lock, and back afterwards. The machine code is the same.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

from numba.core import event, transforms, types
from numba.core.base import BaseContext
from numba.core.postproc import PostProcessor, VariableLifetime
from numba.core.targetconfig import ConfigStack

_PLAIN = (types.Number, types.Boolean, types.NoneType, types.Literal, types.Array, types.Record, types.BaseTuple, types.DType)


@contextmanager
def spared() -> Iterator[None]:
    """Spare numba all of it meanwhile."""
    with ExitStack() as stack:
        for owner, name, what in (
            (types.Function, "get_call_type", remembered_calls(types.Function.get_call_type)),
            (BaseContext, "get_arg_packer", remembered_packers(BaseContext.get_arg_packer)),
            (PostProcessor, "run", lazily_tidied(PostProcessor.run)),
            (event, "start_event", if_heard(event.start_event)),
            (event, "end_event", if_heard(event.end_event)),
        ):
            stack.enter_context(replaced(owner, name, what))
        yield


@contextmanager
def replaced(owner: Any, name: str, what: Any) -> Iterator[None]:
    """Put ``what`` in the place of an attribute meanwhile; one that was inherited is inherited again."""
    own, before = name in vars(owner), getattr(owner, name)
    setattr(owner, name, what)
    try:
        yield
    finally:
        if own:
            setattr(owner, name, before)
        else:
            delattr(owner, name)


def remembered_calls(infer: Callable[..., Any]) -> Callable[..., Any]:
    """Infer the type of each call of numba's own functions once for the same types and flags: operators are tried one after another every time."""
    known: dict[tuple[Any, ...], Any] = {}

    def get_call_type(self: Any, context: Any, args: Any, kws: Any) -> Any:
        if kws or not all(isinstance(kind, _PLAIN) for kind in args):
            return infer(self, context, args, kws)
        call = (self, tuple(args), ConfigStack.top_or_none())
        if call not in known:
            known[call] = infer(self, context, args, kws)
        return known[call]

    return get_call_type


def remembered_packers(find: Callable[..., Any]) -> Callable[..., Any]:
    """Find out once for the same types how a function's arguments are handed on, member by member: every call of it asks."""
    known: dict[tuple[Any, ...], Any] = {}

    def get_arg_packer(self: Any, kinds: Any) -> Any:
        call = (self.data_model_manager, *kinds)
        if call not in known:
            known[call] = find(self, kinds)
        return known[call]

    return get_arg_packer


def lazily_tidied(tidy: Callable[..., None]) -> Callable[..., None]:
    """After a pass, only tidy up the blocks: how long variables live is found out if asked for, and at the end, when what is dead is deleted."""

    def run(self: Any, emit_dels: bool = False, extend_lifetimes: bool = False) -> None:
        code = self.func_ir
        if emit_dels or code.is_generator:
            tidy(self, emit_dels, extend_lifetimes)
            return
        code.blocks = transforms.canonicalize_cfg(code.blocks)
        code.variable_lifetime, code.generator_info = VariableLifetime(code.blocks), None

    return run


def if_heard(tell: Callable[..., None]) -> Callable[..., None]:
    """Tell of an event, of which there are a hundred thousand, only if someone listens."""

    def told(kind: str, *about: Any, **more: Any) -> None:
        if event._registered[kind]:
            tell(kind, *about, **more)

    return told
