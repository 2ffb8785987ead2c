"""The interface by which finished pieces of long computations are stored and read again.

They may be stored in a file of an earlier run (`optimisation.files`), for example.
"""

from collections.abc import Callable, Iterator
from typing import Any, Protocol, TypeVar


class Plain(Protocol):
    """A result that has plain values, which can be written to a file."""

    def to_plain(self) -> dict[str, Any]:
        """Return plain values."""


PlainResult = TypeVar("PlainResult", bound=Plain)


class ComputeOrLoad(Protocol):
    """Function that computes finished pieces or reads them from an earlier call."""

    def __call__(
        self,
        name: dict[str, Any],
        make: Callable[[], Iterator[PlainResult]],
        read: Callable[[dict[str, Any]], PlainResult],
        /,
    ) -> Iterator[PlainResult]:
        """Yield the results of ``make``, or the stored results of an earlier call.

        ``name`` identifies the computation by plain values. Results are stored if an earlier call
        with the same ``name`` was completed; ``read`` builds them from their `to_plain`.
        """


def compute_uncached(
    _name: dict[str, Any],
    make: Callable[[], Iterator[PlainResult]],
    _read: Callable[[dict[str, Any]], PlainResult],
    /,
) -> Iterator[PlainResult]:
    """Yield the results of ``make``; nothing is stored."""
    return make()
