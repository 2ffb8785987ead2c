"""From a slider's move to what is drawn, on the explorer's page in a headless Chromium."""

# needs: explore, browser

from __future__ import annotations

import os
import shutil
import statistics
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import click
from PIL import Image

from impact_env.budget import Stop
from impact_env.curve import CurveCase, Pass, curve_passes
from impact_env.parameters import Beam, impact_absorber, require
from impact_env.scene import beam_scene
from optimisation.cli.common import check_target, command
from optimisation.comparison import force_grid
from optimisation.explore.settings import MOST_MEMBERS
from optimisation.report.markdown import markdown
from optimisation.report.written_figure import few_colours
from studies.one_table import table_options, table_place, table_study
from studies.runner import run
from studies.study import Json, Measured

NAME = "benchmark_explorer"
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
REPEATS, QUICK_REPEATS = 15, 2
MARKS = {"first points": "first_ms", "all forces": "all_forces_ms", "all": "everything_ms"}
CASES = tuple((modes, friction) for modes in (3, 10) for friction in (0.0, 0.1))
WAIT = 600_000.0  # ms, with what is compiled
SIZE: Any = {"width": 1280, "height": 800}


class Settings(NamedTuple):
    """Moves of the slider for each case, and where a picture of the page goes (None: nowhere)."""

    repeats: int
    picture: Path | None = None


@contextmanager
def serving() -> Iterator[str]:
    """Serve the page in a process of its own and give its address."""
    words = [sys.executable, "-c", "from optimisation.cli.start import main; main()", "explore", "--port", "0", "--no-browser"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield process.stdout.readline().split()[0]
        finally:
            process.terminate()


@contextmanager
def browsing() -> Iterator[Any]:
    """Give a page of a headless browser; raises ParameterError where there is none."""
    from playwright.sync_api import sync_playwright

    found = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    require(found is not None, "browser", None, f"one of {', '.join(BROWSERS)}, installed by the system")
    with sync_playwright() as player:
        browser = player.chromium.launch(executable_path=found, args=["--no-sandbox"])
        yield browser.new_page(viewport=SIZE)
        browser.close()


def _finished(page: Any) -> None:
    asked = page.evaluate("document.documentElement.dataset.asked") or 1
    page.wait_for_selector(f'html[data-done="{asked}"]', state="attached", timeout=WAIT)


def moved(page: Any, address: str, modes: int, friction: float, repeats: int) -> dict[str, list[float]]:
    """Return the times in ms of each move of the gap's slider, one after the other."""
    page.goto("about:blank")
    page.goto(f"{address}#modes={modes}&friction={friction}&members=1")
    page.wait_for_selector("html[data-asked]", state="attached")
    _finished(page)
    page.get_by_label("Gap to either wall, mm").focus()
    for _ in range(repeats + 1):
        before = int(page.evaluate("document.documentElement.dataset.asked"))
        page.keyboard.press("ArrowRight")
        page.wait_for_selector(f'html[data-asked="{before + 1}"]', state="attached")
        _finished(page)
    found = page.evaluate("performance.getEntriesByType('measure').map((m) => [m.name, m.duration])")
    return {key: [ms for name, ms in found if name == mark][-repeats:] for mark, key in MARKS.items()}


def stopped(modes: int, friction: float, repeats: int) -> list[float]:
    """Return the times in ms from an order to stop to the end of all work on a curve."""
    scene, times = beam_scene(Beam(modes=modes), impact_absorber(restitution=0.7, friction_limit=friction)), []
    for _ in range(repeats):
        stop = Stop()
        passes = curve_passes(CurveCase(scene, force_grid(3.5)), [Pass(members=MOST_MEMBERS)], stop)
        next(passes)
        at = list[float]()
        timer = threading.Timer(0.1, lambda stop=stop, at=at: (at.append(time.perf_counter()), stop.give()))
        timer.start()
        for _ in passes:
            pass
        times.append(1e3 * (time.perf_counter() - at[0]))
    return times


def measure(settings: Settings) -> Json:
    """Return all times of all cases, and the machine's load averages of a minute at the beginning and at the end."""
    rows, load = [], os.getloadavg()[0]
    with serving() as address, browsing() as page:
        for modes, friction in CASES:
            times = moved(page, address, modes, friction, settings.repeats) | {"stopped_ms": stopped(modes, friction, settings.repeats)}
            rows.append({"modes": modes, "friction_limit": friction, **times})
        if settings.picture is not None:
            page.goto("about:blank")
            page.goto(f"{address}#friction=0.1&gap=0.0012&members=8&modes=3")
            page.wait_for_selector("html[data-asked]", state="attached")
            _finished(page)
            page.screenshot(path=settings.picture)
            few_colours(Image.open(settings.picture)).save(settings.picture, optimize=True)
    return {"repeats": settings.repeats, "load": [load, os.getloadavg()[0]], "cases": rows}


def said(found: Measured) -> str:
    """Return the table: medians, and in brackets the largest."""
    header = ("modes, friction in N", "first points, ms", "24 forces both ways, ms", "everything, ms", "stale work ends, ms")
    rows = []
    for row in found.values["cases"]:
        shown = [f"{statistics.median(times):.0f} ({max(times):.0f})" for name in (*MARKS.values(), "stopped_ms") for times in [row[name]]]
        rows.append((f"{row['modes']}, {row['friction_limit']:g}", *shown))
    first, last = found.values["load"]
    return (
        f"{markdown(header, rows)}\n\nMedian of {found.values['repeats']} moves of the gap's slider one after the other, in brackets the longest. "
        f"The machine's load was {first:.1f} when it began and {last:.1f} when it ended, of which the benchmark is one or two."
    )


STUDY = table_study(NAME, "explorer", measure, said)


@command()
@click.option("--quick", is_flag=True, help=f"{QUICK_REPEATS} moves of each case: a look, not a measurement.")
@click.option("--picture", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", help="Keep a picture of the page: .png.")
@table_options(NAME, "docs/explore.md")
def main(quick: bool, picture: Path | None, target: Path | None, page: Path | None) -> None:
    """Move a slider of the page and time what it draws, until the first points, all forces and everything; and how soon stale work ends.

    Run it on an otherwise idle machine. It needs Chromium. The first call compiles kernels, which is not part of the times.
    """
    check_target("--picture", picture, (".png",))
    run(STUDY, Settings(QUICK_REPEATS if quick else REPEATS, None if picture is None else picture.resolve()), table_place(target, page))
