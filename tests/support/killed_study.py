"""Run as a process that a test kills: a study of `design_studies`, slow enough to be hit anywhere. Arguments: journal, log, number of designs."""

from __future__ import annotations

import sys
import time
from pathlib import Path

from design_studies import Model, problem, settings

from optimisation.search.study import opened


class Slow(Model):
    """The model with a pause after each chunk."""

    def each(self, function, chunks, kinds):
        for result in super().each(function, chunks, kinds):
            yield result
            time.sleep(0.002)


if __name__ == "__main__":
    with opened(problem(), settings(), Path(sys.argv[1])) as study:
        study.run(int(sys.argv[3]), Slow(log=Path(sys.argv[2])))
