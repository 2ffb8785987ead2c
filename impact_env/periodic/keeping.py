"""The interface by which finished pieces of long computations are stored and read again.

They may be stored in a file of an earlier run (`optimisation.files`), for example.
"""

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
        """Yield the results of ``make``, or the stored results of an earlier call.

        Results are stored if an earlier call with the same ``name`` was completed. They are made
        from their `to_plain` by ``read``.
        """


def compute_uncached(
    _name: dict[str, Any],
    make: Callable[[], Iterator[PlainResult]],
    _read: Callable[[dict[str, Any]], PlainResult],
    /,
) -> Iterator[PlainResult]:
    """Keep nothing: make each piece."""
    return make()
