"""Options of the suite: processor times, other last bits in every modal model, few figures."""

import hashlib
import json
import os
import time
from collections.abc import Generator
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba.core import event

from impact_env.modes import ModalModel

# What each test takes of the processor, which does not depend on what else the machine does, and
# how much of that is compilation of kernels.


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
    """A plugin that writes a line for each test.

    It has the test's name, and the seconds in this process, in child processes, and of compilation.
    """

    def __init__(self, file: Path) -> None:
        self.file = file
        self.compiling = Compiling()
        event.register("numba:compile", self.compiling)

    def now(self) -> dict[str, float]:
        times = os.times()
        return {
            "own": times.user + times.system,
            "children": times.children_user + times.children_system,
            "compiling": self.compiling.seconds,
        }

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, object, object]:
        before = self.now()
        result = yield
        taken = {name: round(value - before[name], 3) for name, value in self.now().items()}
        with self.file.open("a") as file:
            file.write(json.dumps({"test": item.nodeid} | taken) + "\n")
        return result


# Other last bits in every modal model, as other processors and libraries would give them: verdicts
# of tests must not hang on these.


BITS = 3  # of a number's 53 those that differ, a relative change of 1e-15 at most
NAMES = ("omega", "tip_shape", "force_shape", "absorber_shapes")


def rounded(values: Any, pattern: int) -> Any:
    """Return an array with its lowest bits set to a pattern; what has them already stays."""
    bits = np.array(values, dtype=np.float64).view(np.int64)
    rounded_values: Any = ((bits >> BITS << BITS) | pattern % 2**BITS).view(np.float64)
    return np.where(np.asarray(values) == 0, values, rounded_values)


def round_models(pattern: int) -> None:
    """Let all modal models of this process have these last bits."""
    made = ModalModel.__post_init__

    def post_init(self: ModalModel) -> None:
        made(self)
        for name in NAMES:
            values = getattr(self, name)
            if values is not None:
                changed = rounded(values, pattern)
                changed.flags.writeable = False
                object.__setattr__(self, name, changed)

    ModalModel.__post_init__ = post_init


# Figures of tests that do not look at pixels: they read what the artists hold (drawing.py).


COARSE_DPI = 40.0
DRAWN: set[object] = set()  # kinds of figures that this process has drawn


def kind_of_figure(figure: Any) -> object:
    """Return what figures of one kind share: labels, scales and sorts of artists of their axes."""
    return tuple(
        (
            axes.get_xlabel(),
            axes.get_ylabel(),
            axes.get_xscale(),
            axes.get_yscale(),
            frozenset(type(artist).__name__ for artist in axes.get_children()),
        )
        for axes in figure.axes
    )


def seed_of_figure(figure: Any) -> list[int]:
    """Return numbers that follow from a figure's texts and from what its artists hold."""
    from matplotlib.collections import Collection
    from matplotlib.image import AxesImage
    from matplotlib.lines import Line2D
    from matplotlib.text import Text

    digest = hashlib.sha256()
    for artist in figure.findobj():
        if isinstance(artist, Text):
            digest.update(artist.get_text().encode())
        elif isinstance(artist, Line2D):
            digest.update(np.asarray(artist.get_xydata(), dtype=float).tobytes())
        elif isinstance(artist, Collection):
            for path in artist.get_paths():
                digest.update(np.asarray(path.vertices, dtype=float).tobytes())
            digest.update(np.asarray(artist.get_offsets(), dtype=float).tobytes())
        elif isinstance(artist, AxesImage):
            digest.update(np.asarray(artist.get_array(), dtype=float).tobytes())
    return list(digest.digest())


def draw_few_figures(patch: pytest.MonkeyPatch) -> None:
    """Let figures have few pixels, and draw only the first one of each kind in this process.

    PNG files of all others contain noise, which is the same for figures with the same content.
    """
    from matplotlib.backend_bases import FigureCanvasBase
    from PIL import Image

    from optimisation.report.report import write_figure

    print_figure = FigureCanvasBase.print_figure

    def print_first_figure(canvas: Any, file: Any, *arguments: Any, **options: Any) -> Any:
        kind = kind_of_figure(canvas.figure)
        if options.get("format") != "png":
            return print_figure(canvas, file, *arguments, **options)
        seed = seed_of_figure(canvas.figure)  # before it is drawn, which adds labels of ticks
        if kind not in DRAWN:
            print_figure(canvas, BytesIO(), *arguments, **options)
            DRAWN.add(kind)
        size = (canvas.figure.get_size_inches() * options["dpi"]).astype(int)
        noise = np.random.default_rng(seed).bytes(int(np.prod(size)))
        return Image.frombytes("L", tuple(size), noise).save(file, format="png")

    patch.setattr(FigureCanvasBase, "print_figure", print_first_figure)
    patch.setattr(write_figure, "__defaults__", (COARSE_DPI,))
