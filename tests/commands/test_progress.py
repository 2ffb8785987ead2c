"""How far a command is: a bar on a terminal, and where there is none a line now and then, of whole lines only."""

from __future__ import annotations

import io
import re
import sys

import pytest

from optimisation import progress
from optimisation.progress import Bar, counting_bar, stages_bar


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def shown(monkeypatch: pytest.MonkeyPatch, stderr: io.StringIO, every: float) -> str:
    """Return what all kinds of bars write, each of which is drawn twice."""
    monkeypatch.setattr(sys, "stderr", stderr)
    monkeypatch.setattr(progress, "EVERY", every)
    with (
        Bar(total=4, desc="one", unit="run", leave=False, mininterval=0) as bar,
        counting_bar("two", "designs") as show,
        stages_bar("three") as stage,
    ):
        for done in (1, 2):
            bar.update()
            bar.refresh()
            show(done, 5)
            stage("deep", done, 7)
    return stderr.getvalue()


def test_without_a_terminal_lines_tell_how_far_it_is_and_what_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    text = shown(monkeypatch, io.StringIO(), 0.0)
    assert text.endswith("\n")
    assert not set(text) & {"\r", "\x1b", "|"}
    lines = text.splitlines()
    assert any(re.fullmatch(r"one: +50% 2/4 run \[\d\d:\d\d, \d\d:\d\d left\]", line) for line in lines)
    assert any(line.startswith("three: deep, 2 of 7 [") for line in lines)
    assert all(re.match(r"one: |two: |three", line) for line in lines)


def test_lines_come_now_and_then_only(monkeypatch: pytest.MonkeyPatch) -> None:
    assert shown(monkeypatch, io.StringIO(), 1e9) == ""
    assert progress.EVERY == 1e9


def test_a_terminal_has_bars(monkeypatch: pytest.MonkeyPatch) -> None:
    text = shown(monkeypatch, Terminal(), 0.0)
    assert "\r" in text
    assert "|" in text
