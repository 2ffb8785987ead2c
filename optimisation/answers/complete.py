"""What every whole answer offers: text, JSON, Markdown, HTML, figure and files, all rendered from its report."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from impact_env.ensemble import LaneProgress
from impact_env.parameters import ParameterError
from optimisation.files import require_writable, write_files
from optimisation.frequency_levels import WorstRun
from optimisation.report.report import (
    Report,
    list_files,
    render_html,
    render_markdown,
    render_text,
)

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
    """An answer; `report` has its content, from which all forms are rendered."""

    @abstractmethod
    def make_report(self) -> Report:
        """Return the content of the answer."""

    @cached_property
    def report(self) -> Report:
        """The content of the answer: text, numbers, tables, figures and card."""
        return self.make_report()

    def __str__(self) -> str:
        """Return what the command prints."""
        return render_text(self.report)

    def to_json(self) -> Json:
        """Return the content of summary.json: plain data in SI units."""
        numbers = self.report.numbers
        assert isinstance(numbers, dict)
        return numbers

    def to_markdown(self) -> str:
        """Return text and card as Markdown."""
        return render_markdown(self.report)

    def to_html(self) -> str:
        """Return the card as one HTML page with curves, which requests nothing; raises ParameterError without a card."""
        if not self.report.groups:
            raise ParameterError("this answer has no card: it was left out, or does not exist here")
        return render_html(self.report)

    def plot(self) -> Figure:
        """Return the answer's first figure, of matplotlib; raises ParameterError where nothing was run that could be drawn."""
        for draw in self.report.figures.values():
            return draw()
        raise ParameterError("this answer has no figure: nothing was run that could be drawn")

    def worst_run(self) -> WorstRun | None:
        """Return the recorded run of the answer's device with the highest level; None where there is none."""
        return None

    def device_scene(self) -> Json | None:
        """Return structure and recommended device as plain data, which other commands read by --scene; None without a device."""
        return None

    def save(self, folder: Path | str) -> list[Path]:
        """Write summary, tables, figures and card into a folder, which is made if need be; return their paths.

        Raises ParameterError if nothing can be written there.
        """
        folder = Path(folder)
        require_writable("folder", folder)
        return write_files(list_files(self.report, folder))
