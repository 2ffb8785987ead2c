"""The interface by which finished pieces of long work are kept and read again, for example in a file of an earlier run (`optimisation.files`)."""

from collections.abc import Callable, Iterator
from typing import Any, Protocol, TypeVar


class Plain(Protocol):
    """A piece that can be written."""

    def to_plain(self) -> dict[str, Any]:
        """Return plain values."""


PlainResult = TypeVar("PlainResult", bound=Plain)


class ComputeOrLoad(Protocol):
    """Finished pieces by name."""

    def __call__(
        self,
        name: dict[str, Any],
        make: Callable[[], Iterator[PlainResult]],
        read: Callable[[dict[str, Any]], PlainResult],
        /,
    ) -> Iterator[PlainResult]:
        """Yield what ``make`` yields, or what it has yielded before to its end for the same ``name``, ``read`` from its `to_plain`."""


def compute_uncached(
    _name: dict[str, Any],
    make: Callable[[], Iterator[PlainResult]],
    _read: Callable[[dict[str, Any]], PlainResult],
    /,
) -> Iterator[PlainResult]:
    """Keep nothing: make each piece."""
    return make()
