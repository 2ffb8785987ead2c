"""What every whole answer offers: text, JSON, figure and files."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from impact_env.ensemble import LaneProgress
from optimisation.files import require_writable, write_files
from optimisation.report.card import Card, write_card

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Json = dict[str, Any]
Stages = Callable[[str, int], AbstractContextManager[LaneProgress | None]]
# what is run and the number of runs, about; gives the progress of these runs


@contextmanager
def silent_stages(_label: str, _runs: int) -> Iterator[LaneProgress | None]:
    """Give no progress."""
    yield None


class CompleteAnswer(ABC):
    """An answer with its text (`str`), JSON, figure and files."""

    @cached_property
    def card(self) -> Card | None:
        """The card with curves; None where there is none."""
        return None

    @abstractmethod
    def to_json(self) -> Json:
        """Return the content of summary.json: plain data in SI units."""

    @abstractmethod
    def plot(self) -> Figure:
        """Return the answer's first figure, of matplotlib."""

    @abstractmethod
    def files(self, folder: Path) -> dict[Path | None, object]:
        """Return tables, figures and JSON by their paths, for `optimisation.files.write_files`."""

    def save(self, folder: Path | str) -> list[Path]:
        """Write all files of the answer into a folder, which is made if need be; return their paths.

        Raises ParameterError if nothing can be written there.
        """
        folder = Path(folder)
        require_writable("folder", folder)
        files = write_files(self.files(folder))
        return files if self.card is None else files + write_card(folder, self.card)
