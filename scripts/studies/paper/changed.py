"""A figure over one property of the second mode, as `varom` and `vard` are: what it measures, says and draws."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from impact_env.parameters import Beam
from studies.paper.frame import figure_part, shortened
from studies.paper.second_mode import FORCE, measured, table
from studies.paper.settings import Settings
from studies.study import Json, Measured, Part, Saver, Steps, Table


def name(number: float) -> str:
    """Return the name of a point."""
    return f"{number:g}"


def points(values: Json) -> list[float]:
    """Return the numbers of the points that are known."""
    return [float(key) for key in values if not key.startswith("signal")]


def members_of(settings: Settings) -> int:
    """Return how many members each point has."""
    return settings.size(24, 4)


@dataclass(frozen=True)
class Changed:
    """What is changed from point to point, and how it is called.

    ``numbers(settings)``: the points; ``beam(number)``: the beam of one; ``shown``: those whose energies are drawn over time. ``plural``: the key of
    the points among a run's parameters, beside ``fixed``. ``column``, ``axis`` and ``each`` name the number in the table, below the figure and
    above a drawing over time, ``scale`` times as large as it is; ``about(members)`` is the sentence above the table.
    """

    label: str
    title: str
    plural: str
    numbers: Callable[[Settings], tuple[float, ...]]
    beam: Callable[[float], Beam]
    shown: tuple[float, ...]
    column: str
    axis: str
    each: str
    about: Callable[[int], str]
    scale: float = 1.0
    fixed: tuple[tuple[str, float], ...] = ()
    members: Callable[[Settings], int] = members_of

    def parameters(self, settings: Settings) -> Json:
        """Return what the numbers depend on."""
        counted = {self.plural: self.numbers(settings), "members": self.members(settings)}
        return counted | {"force": FORCE} | dict(self.fixed) | {"shown": self.shown}

    def part(self) -> Part[Settings]:
        """Return the figure's part."""
        return figure_part(self.label, self.title, self._measure, self._words, self._figures, lambda values: (self._table(values),))

    def _measure(self, settings: Settings, known: Json) -> Steps:
        beams = {name(number): self.beam(number) for number in self.numbers(settings)}
        return measured(settings, self.label, beams, self.members(settings), [name(number) for number in self.shown], known)

    def _scaled(self, numbers: list[float]) -> list[float]:
        return [self.scale * number for number in numbers]

    def _words(self, values: Json) -> str:
        numbers = points(values)
        if not numbers:
            return "Not finished."
        names = [name(number) for number in numbers]
        return f"{self.about(len(values[names[0]]['relative']))}\n\n{shortened(self._table(values))}"

    def _table(self, values: Json) -> Table:
        numbers = points(values)
        return table(values, [name(number) for number in numbers], self._scaled(numbers), self.column, self.label)

    def _figures(self, found: Measured) -> dict[str, Saver]:
        from studies.paper.figures.second_mode import save  # matplotlib is slow to import

        numbers = points(found.values)
        if len(numbers) < 2:
            return {}
        signals = [(f"signal, {name(number)}", self.each.format(self.scale * number)) for number in self.shown]
        shown = [(signal, title) for signal, title in signals if signal in found.values]
        names = [name(number) for number in numbers]
        return {self.label: partial(save, values=found.values, names=names, numbers=self._scaled(numbers), label=self.axis, shown=shown)}
