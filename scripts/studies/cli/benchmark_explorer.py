"""From a slider's move to what is drawn, on the explorer's page in a headless Chromium."""

# needs: explore, browser

import io
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

from impact_env import CurveCase, Pass, Stop, beam_scene, curve_passes
from impact_env.checks import require
from impact_env.parameters import Beam, impact_absorber
from optimisation.cli.common import check_target, command
from optimisation.comparison import force_grid
from optimisation.explore.settings import MOST_MEMBERS
from optimisation.report.report import few_colours
from studies.study import (
    Json,
    Measurement,
    OutputPaths,
    add_table_options,
    format_table,
    make_table_study,
    run,
)

NAME = "benchmark_explorer"
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
REPEATS = 15
QUICK_REPEATS = 2
WHOLE_REPEATS = 2
MARKS = {"first points": "first_ms", "all forces": "all_forces_ms", "all": "everything_ms"}
CASES = tuple((modes, friction) for modes in (3, 10) for friction in (0.0, 0.1))
WAIT = 600_000.0  # ms, with what is compiled
SIZE: Any = {"width": 1280, "height": 800}
FILM = (960, 600)
FILM_COLOURS = 128
PICTURE = 0.3  # s, for which each picture of the film is shown
GAP = "Gap to either wall, mm"
FILE = click.Path(dir_okay=False, path_type=Path)


class ExplorerSettings(NamedTuple):
    """Moves of the slider for each case."""

    repeats: int


@contextmanager
def serving() -> Iterator[str]:
    """Serve the page in a separate process and yield its address."""
    words = [
        sys.executable,
        "-c",
        "from optimisation.cli.start import main; main()",
        "explore",
        "--port",
        "0",
        "--no-browser",
    ]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield process.stdout.readline().split()[0]
        finally:
            process.terminate()


@contextmanager
def browsing() -> Iterator[Any]:
    """Yield a page of a headless browser; raise ParameterError without a browser."""
    from playwright.sync_api import sync_playwright

    result = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    require(
        result is not None,
        "browser",
        None,
        f"one of {', '.join(BROWSERS)}, installed by the system",
    )
    with sync_playwright() as player:
        browser = player.chromium.launch(executable_path=result, args=["--no-sandbox"])
        yield browser.new_page(viewport=SIZE)
        browser.close()


def _finished(page: Any, what: str = "done") -> None:
    request = page.evaluate("document.documentElement.dataset.asked") or 1
    page.wait_for_selector(f'html[data-{what}="{request}"]', state="attached", timeout=WAIT)


def opened(page: Any, address: str, setting: str) -> None:
    """Load the page with a setting, and wait until all is drawn."""
    page.goto("about:blank")
    page.goto(f"{address}#{setting}")
    page.wait_for_selector("html[data-asked]", state="attached")
    _finished(page)


def moved(
    page: Any, address: str, modes: int, friction: float, repeats: int
) -> dict[str, list[float]]:
    """Return the times in ms of each move of the gap's slider.

    The next move follows when all forces are drawn. After each of the last moves the next follows
    when everything is drawn.
    """
    opened(page, address, f"modes={modes}&friction={friction}&members=1")
    page.get_by_label(GAP).focus()
    for k in range(repeats + 1):
        before = int(page.evaluate("document.documentElement.dataset.asked"))
        page.keyboard.press("ArrowRight")
        page.wait_for_selector(f'html[data-asked="{before + 1}"]', state="attached")
        _finished(page, "whole" if k <= repeats - WHOLE_REPEATS else "done")
    result = page.evaluate(
        "performance.getEntriesByType('measure').map((m) => [m.name, m.duration])"
    )
    return {
        key: [ms for name, ms in result if name == mark][
            -(WHOLE_REPEATS if mark == "all" else repeats) :
        ]
        for mark, key in MARKS.items()
    }


CURSOR = """
const style = "position:fixed; width:16px; height:16px; margin:-8px; border-radius:8px; "
  + "background:#c4511ccc; pointer-events:none; z-index:9";
const dot = document.body.appendChild(Object.assign(document.createElement("div"), { style }));
addEventListener("pointermove", (e) => {
  dot.style.left = `${e.clientX}px`;
  dot.style.top = `${e.clientY}px`;
}, true);
"""


def film(target: Path) -> None:
    """Write a film of the page.

    The gap's slider is dragged, a click sets the force, and advice is requested. The waiting time
    for the advice is not in the film.
    """
    frames = list[Image.Image]()

    def shoot(pictures: int) -> None:
        """Take pictures, a moment before each."""
        for _ in range(pictures):
            page.wait_for_timeout(1e3 * PICTURE)
            frames.append(
                Image.open(io.BytesIO(page.screenshot()))
                .convert("RGB")
                .resize(FILM, Image.Resampling.LANCZOS)
            )

    def go(x: float, y: float, steps: int) -> None:
        """Move the pointer so, with a picture at each step."""
        for k in range(1, steps + 1):
            page.mouse.move(at[0] + (x - at[0]) * k / steps, at[1] + (y - at[1]) * k / steps)
            shoot(1)
        at[:] = [x, y]

    def middle(selector: str, share: float) -> tuple[float, float]:
        box = page.locator(selector).bounding_box()
        return box["x"] + share * box["width"], box["y"] + 0.5 * box["height"]

    with serving() as address, browsing() as page:
        opened(page, address, "friction=0.1&gap=0.0005&members=2&modes=3")
        page.evaluate(CURSOR)
        slider = '[data-control="gap"] input[type=range]'
        at = [640.0, 400.0]
        go(*middle(slider, 0.41), 3)
        page.mouse.down()
        go(*middle(slider, 0.55), 10)
        page.mouse.up()
        shoot(4)
        go(*middle("#curve .plot", 0.5), 4)
        page.mouse.click(*at)
        shoot(5)
        go(*middle("#recommend", 0.5), 4)
        page.mouse.click(*at)
        shoot(2)
        page.wait_for_selector("#why:not(:empty)", timeout=WAIT)
        shoot(6)
    palette = frames[0].quantize(
        FILM_COLOURS, Image.Quantize.MAXCOVERAGE
    )  # one for all: what stands still costs nothing
    frames = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    lengths = [*(len(frames) - 1) * [round(1e3 * PICTURE)], 2000]
    frames[0].save(
        target, save_all=True, append_images=frames[1:], duration=lengths, loop=0, optimize=True
    )


def take_picture(target: Path) -> None:
    """Write a picture of the page with the first example."""
    with serving() as address, browsing() as page:
        opened(page, address, "friction=0.1")
        page.screenshot(path=target)
    few_colours(Image.open(target)).save(target, optimize=True)


def stopped(modes: int, friction: float, repeats: int) -> list[float]:
    """Return the times in ms from an order to stop to the end of all work on a curve."""
    scene = beam_scene(Beam(modes=modes), impact_absorber(restitution=0.7, friction_limit=friction))
    times = []
    for _ in range(repeats):
        stop = Stop()
        passes = curve_passes(CurveCase(scene, force_grid(3.5)), [Pass(members=MOST_MEMBERS)], stop)
        next(passes)
        at = list[float]()
        timer = threading.Timer(
            0.1, lambda stop=stop, at=at: (at.append(time.perf_counter()), stop.give())
        )
        timer.start()
        for _ in passes:
            pass
        times.append(1e3 * (time.perf_counter() - at[0]))
    return times


def measure(settings: ExplorerSettings) -> Json:
    """Return all times of all cases, and the machine's load averages.

    The load averages over a minute are those at the beginning and at the end.
    """
    rows = []
    load = os.getloadavg()[0]
    with serving() as address, browsing() as page:
        for modes, friction in CASES:
            times = moved(page, address, modes, friction, settings.repeats) | {
                "stopped_ms": stopped(modes, friction, settings.repeats)
            }
            rows.append({"modes": modes, "friction_limit": friction, **times})
    return {"repeats": settings.repeats, "load": [load, os.getloadavg()[0]], "cases": rows}


def make_summary(result: Measurement) -> str:
    """Return the table: medians, and in brackets the largest."""
    columns = {
        "modes, friction in N": "{modes}, {friction_limit:g}",
        "first points, ms": "{first_ms}",
        "24 forces both ways, ms": "{all_forces_ms}",
        "everything, ms": "{everything_ms}",
        "stale work ends, ms": "{stopped_ms}",
    }
    rows = [
        row
        | {
            name: f"{statistics.median(row[name]):.0f} ({max(row[name]):.0f})"
            for name in (*MARKS.values(), "stopped_ms")
        }
        for row in result.values["cases"]
    ]
    first, last = result.values["load"]
    return (
        f"{format_table(columns, rows)}\n\nMedian of {result.values['repeats']} moves of the "
        "gap's slider, "
        "each when the forces of the one before are "
        f"there, of everything of the last {WHOLE_REPEATS}; in brackets the longest. "
        f"The machine's load was {first:.1f} when it began and {last:.1f} when it ended, of "
        "which the benchmark is one or two."
    )


STUDY = make_table_study(NAME, "explorer", measure, make_summary)


@command()
@click.option(
    "--quick", is_flag=True, help=f"{QUICK_REPEATS} moves of each case: a look, not a measurement."
)
@click.option(
    "--picture",
    type=FILE,
    metavar="FILE",
    help="Take a picture of the page, .png, and nothing else.",
)
@click.option(
    "--film",
    "filmed",
    type=FILE,
    metavar="FILE",
    help="Make a film of the page, .gif, and nothing else.",
)
@add_table_options(NAME, "docs/explore.md")
def main(quick: bool, picture: Path | None, filmed: Path | None, place: OutputPaths) -> None:
    """Move a slider of the page and time the drawing, and the end of outdated computations.

    The times are those until the first points, until all forces and until everything is drawn.

    Run it on an otherwise idle machine. It needs Chromium. The first call compiles kernels, which
    is not part of the times.
    """
    check_target("--picture", picture, (".png",))
    check_target("--film", filmed, (".gif",))
    if picture is not None:
        take_picture(picture)
    if filmed is not None:
        film(filmed)
    if picture is not None or filmed is not None:
        return
    run(
        STUDY,
        ExplorerSettings(QUICK_REPEATS if quick else REPEATS),
        place,
    )
