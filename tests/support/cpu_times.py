"""What each test takes of the processor, which does not depend on what else the machine does, and how much of that is compilation of kernels."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Generator
from pathlib import Path

import pytest
from numba.core import event


class Compiling(event.Listener):
    """Seconds of the processor in compilation; one kernel's contains that of those it calls."""

    def __init__(self) -> None:
        self.seconds = self.began = 0.0
        self.depth = 0

    def on_start(self, _: event.Event) -> None:
        if self.depth == 0:
            self.began = time.process_time()
        self.depth += 1

    def on_end(self, _: event.Event) -> None:
        self.depth -= 1
        if self.depth == 0:
            self.seconds += time.process_time() - self.began


class CPUTimes:
    """A plugin that writes a line for each test: its name, and seconds in this process, in processes that it waited for, and compiling."""

    def __init__(self, file: Path) -> None:
        self.file = file
        self.compiling = Compiling()
        event.register("numba:compile", self.compiling)

    def now(self) -> dict[str, float]:
        times = os.times()
        return {"own": times.user + times.system, "children": times.children_user + times.children_system, "compiling": self.compiling.seconds}

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, object, object]:
        before = self.now()
        result = yield
        taken = {name: round(value - before[name], 3) for name, value in self.now().items()}
        with self.file.open("a") as file:
            file.write(json.dumps({"test": item.nodeid} | taken) + "\n")
        return result
