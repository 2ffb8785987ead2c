"""Run as a process that a test kills: a study of `design_studies`, slow enough to be hit anywhere. Arguments: journal, log, number of designs."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from design_studies import Array, Model, problem, settings

from optimisation.measures import Chunk
from optimisation.search.study import opened


class Slow(Model):
    """The model with a pause after each chunk."""

    def run(self, chunks: Sequence[Chunk]) -> Iterator[tuple[int, Array]]:
        for result in super().run(chunks):
            yield result
            time.sleep(0.002)


if __name__ == "__main__":
    with opened(problem(), settings(), Path(sys.argv[1])) as study:
        study.run(int(sys.argv[3]), Slow(log=Path(sys.argv[2])))
