"""Designs with their scores, and the progress of a study."""

from __future__ import annotations

from dataclasses import dataclass

from optimisation.designs import Design
from optimisation.objectives import Score


@dataclass(frozen=True, eq=False)
class Evaluated:
    """A design that was told: its ``number``, what it scored, and on how many ``rungs`` (all of them: it can win)."""

    number: int
    design: Design
    score: Score
    rungs: int


@dataclass(frozen=True, eq=False)
class Progress:
    """How far a study is: ``designs`` told, ``wanted`` in all, and the ``runs`` made in this session."""

    designs: int
    wanted: int
    runs: int
