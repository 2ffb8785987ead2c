"""What each process of the tests has needed of memory at most, told at the end."""

from __future__ import annotations

import resource
import sys
from typing import Any

import pytest

UNIT = 1 if sys.platform == "darwin" else 1024  # bytes that getrusage counts in


class Peaks:
    """A plugin for the processes of a run and for the one that they report to."""

    def __init__(self) -> None:
        self.found: list[float] = []

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node: Any) -> None:
        self.found.append(getattr(node, "workeroutput", {}).get("peak", float("nan")))

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        if hasattr(session.config, "workeroutput"):
            session.config.workeroutput["peak"] = own()

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        terminalreporter.write_line(f"memory at most, by process: {', '.join(f'{peak:.2f}' for peak in self.found or [own()])} GB")


def own() -> float:
    """Return this process's peak in GB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * UNIT / 1e9
