"""Images of an episode.

They show the bent beam with its cavity and absorber, and strips of level and frequency over time.

Displacements are exaggerated, all by the same factor. A frame shows the end of a control interval,
so that the motion is seen as under a stroboscope; the pale band is the amplitude over the interval.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import ParameterError
from impact_env.envs.task import Task
from impact_env.extras import how_to_install, optional
from impact_env.modes import ModalModel, mode_shapes
from impact_env.parameters import SlidingAbsorber

with optional():
    from PIL import Image, ImageDraw, ImageFont

Array = NDArray[np.float64]
Point = tuple[float, float]
# an image is drawn FINE times larger, and reduced: smooth edges
IMAGE_WIDTH = 640
IMAGE_HEIGHT = 420
SUPERSAMPLING = 2
POSITIONS = 24  # places at which the beam's deflection is computed
# of the beam, in pixels
BEAM_LEFT = 50.0
BEAM_RIGHT = 520.0
MIDDLE = 140.0
LARGEST_DISPLACEMENT = 95.0  # pixels that the largest expected displacement gets
STRIPS = ((285.0, 335.0), (360.0, 410.0))  # top and bottom of the strips
STRIP_LEFT = 60.0
STRIP_RIGHT = 620.0
NODE_SHARE = (
    0.05  # of the largest mode shape at a place: less is a node, whose band would fill the picture
)
UNKNOWN_PLACE = 0.5  # of the force, as a share of the length, where it is not known
PAPER = "white"
INK = "#303030"
PALE = "#d8e4f0"
BLUE = "#1f5fa8"
RED = "#c03028"
GREEN = "#2f7d4f"
MASS_SIZE = 9.0  # half the side of the absorber in pixels


def straight_shapes(model: ModalModel) -> Array:
    """Return shapes for a model of which only the modes are known, (POSITIONS + 1, N_m).

    The shape of each mode is a straight line from 0 at the support to the mode's value at the
    absorber.
    """
    return np.linspace(0, 1, POSITIONS + 1)[:, None] * np.array(model.tip_shape)


def relative_amplitudes(shapes: Array, level_shape: Array, resonance: int) -> Array:
    """Return a mode's amplitude at each position relative to that at the level's place.

    ``shapes`` (POSITIONS + 1, N_m) are the mode shapes, and ``level_shape`` (N_m,) are their values
    at the level's place. The mode is that of ``resonance``, or, if this mode has a node at the
    level's place, the mode that moves the place most. The result is (POSITIONS + 1,).
    """
    moved = np.abs(level_shape)
    mode = resonance - 1
    if moved[mode] <= NODE_SHARE * moved.max():
        mode = int(np.argmax(moved))
    return np.abs(shapes[:, mode]) / moved[mode] if moved[mode] > 0 else np.zeros(len(shapes))


class Strip:
    """A diagram of one quantity over the time of the episode, between ``low`` and ``high``."""

    def __init__(self, label: str, low: float, high: float, colour: str) -> None:
        self.label = label
        self.low = low
        self.high = high
        self.colour = colour
        self.times: list[float] = []
        self.values: list[float] = []

    def push(self, time: float, value: float) -> None:
        """Append a value; a time that is not later than the last one empties the diagram first."""
        if self.times and time <= self.times[-1]:
            self.times = []
            self.values = []
        self.times.append(time)
        self.values.append(value)
        self.low, self.high = min(self.low, value), max(self.high, value)


class Picture:
    """An image that is drawn FINE times larger than it is returned, so that lines are smooth.

    Lengths and coordinates are in pixels of the returned image.
    """

    def __init__(self) -> None:
        self.image = Image.new(
            "RGB", (IMAGE_WIDTH * SUPERSAMPLING, IMAGE_HEIGHT * SUPERSAMPLING), PAPER
        )
        self.pen = ImageDraw.Draw(self.image)

    def line(self, points: Iterable[Point], colour: str, width: float) -> None:
        """Draw a line through points (x, y)."""
        self.pen.line(
            [(SUPERSAMPLING * x, SUPERSAMPLING * y) for x, y in points],
            fill=colour,
            width=round(SUPERSAMPLING * width),
            joint="curve",
        )

    def polygon(self, points: Iterable[Point], colour: str) -> None:
        """Fill a polygon."""
        self.pen.polygon([(SUPERSAMPLING * x, SUPERSAMPLING * y) for x, y in points], fill=colour)

    def box(
        self,
        left: float,
        top: float,
        right: float,
        bottom: float,
        fill: str | None,
        outline: str | None = None,
    ) -> None:
        """Draw a rectangle."""
        self.pen.rectangle(
            (
                SUPERSAMPLING * left,
                SUPERSAMPLING * top,
                SUPERSAMPLING * right,
                SUPERSAMPLING * bottom,
            ),
            fill=fill,
            outline=outline,
            width=SUPERSAMPLING,
        )

    def text(self, x: float, y: float, words: str, size: float = 12, anchor: str = "la") -> None:
        """Write a line of text."""
        self.pen.text(
            (SUPERSAMPLING * x, SUPERSAMPLING * y),
            words,
            fill=INK,
            font=ImageFont.load_default(SUPERSAMPLING * size),
            anchor=anchor,
        )

    def pixels(self) -> NDArray[np.uint8]:
        """Return the image, (HEIGHT, WIDTH, 3)."""
        return np.asarray(
            self.image.resize((IMAGE_WIDTH, IMAGE_HEIGHT), Image.Resampling.LANCZOS), dtype=np.uint8
        ).copy()


class Screen:
    """Images of a task's lanes, and a window for the first one."""

    def __init__(self, task: Task, window: bool, fps: int) -> None:
        self.task = task
        self.fps = fps
        settings = task.settings
        self.beam = settings.beam_parameters
        self.shapes = (
            straight_shapes(settings.scene.model)
            if self.beam is None
            else mode_shapes(self.beam, np.linspace(0, 1, POSITIONS + 1))
        )
        self.sliding = (
            settings.scene.absorber
            if isinstance(settings.scene.absorber, SlidingAbsorber)
            else None
        )
        self.strips: dict[int, tuple[Strip, Strip]] = {}
        self._wanted = window
        self._window: _Window | None = None

    def __getstate__(self) -> dict[str, Any]:
        """Leave out the window, which cannot be copied; a copy opens its own."""
        return self.__dict__ | {"_window": None}

    def show(self, lane: int) -> NDArray[np.uint8] | None:
        """Return a lane's image (height, width, 3), or show it in the window."""
        info = self.task.info()
        new = (
            Strip(f"{self.task.reward.level_name} (1)", 0.0, 1.0, RED),
            Strip("frequency ratio (1)", 0.98, 1.02, GREEN),
        )
        level, frequency = self.strips.setdefault(lane, new)
        level.push(float(info["time"][lane]), float(self.task.reward.level()[lane]))
        frequency.push(float(info["time"][lane]), float(info["frequency_ratio"][lane]))
        pixels = self._draw(lane, info, level, frequency)
        if not self._wanted:
            return pixels
        if self._window is None:
            self._window = _Window()
        self._window.show(pixels, self.fps)
        return None

    def _draw(
        self, lane: int, info: dict[str, Any], level: Strip, frequency: Strip
    ) -> NDArray[np.uint8]:
        picture = Picture()
        self._draw_beam(picture, lane)
        picture.text(10, 8, f"time {info['time'][lane]:.0f} pseudo periods", 13)
        friction = (
            f"friction {info['friction_limit'][lane]:.3g} N,  " if "friction_limit" in info else ""
        )
        picture.text(
            IMAGE_WIDTH - 10,
            8,
            f"force {info['force'][lane]:.2f} N,  {friction}score {info['score'][lane]:.3f}",
            13,
            "ra",
        )
        for strip, (top, bottom) in zip((level, frequency), STRIPS, strict=True):
            _draw_strip(picture, strip, top, bottom)
        return picture.pixels()

    def _draw_beam(self, picture: Picture, lane: int) -> None:
        task = self.task
        modes = self.shapes.shape[1]
        scale = LARGEST_DISPLACEMENT / max(
            1.5 * task.lanes.length, float(task.reward.expected_amplitude()[lane])
        )
        state = task.runs.state[lane]
        report = task.runs.reports[lane]
        x = np.linspace(BEAM_LEFT, BEAM_RIGHT, POSITIONS + 1)
        model = task.lanes.model(lane)
        own = task.settings.scene.model
        is_beam = np.array_equal(model.omega, own.omega) and np.array_equal(
            model.tip_shape, own.tip_shape
        )
        shapes = self.shapes if is_beam else straight_shapes(model)
        y = MIDDLE - scale * (shapes @ state[:modes])
        amplitude = float(np.hypot(report["in_phase"], report["quadrature"]))
        resonance = task.settings.resonance
        band = scale * amplitude * relative_amplitudes(shapes, model.level_shape, resonance)
        upper = list(zip(x, MIDDLE - band, strict=True))
        lower = list(zip(x, MIDDLE + band, strict=True))
        picture.polygon([*upper, *reversed(lower)], PALE)
        picture.line([(BEAM_LEFT, MIDDLE), (BEAM_RIGHT, MIDDLE)], "#b0b0b0", 1)
        picture.box(BEAM_LEFT - 14, MIDDLE - 60, BEAM_LEFT, MIDDLE + 60, "#909090")
        place = BEAM_LEFT + (UNKNOWN_PLACE if self.beam is None else self.beam.force_position) * (
            BEAM_RIGHT - BEAM_LEFT
        )
        self._draw_force(picture, place, float(np.interp(place, x, y)), lane)
        picture.line(zip(x, y, strict=True), BLUE, 5)
        if task.settings.scene.absorber is not None:
            place = BEAM_LEFT + (1.0 if self.beam is None else self.beam.absorber_position) * (
                BEAM_RIGHT - BEAM_LEFT
            )
            self._draw_absorber(picture, place, float(np.interp(place, x, y)), scale, lane)

    def _draw_force(self, picture: Picture, x: float, y: float, lane: int) -> None:
        size = 45 * np.cos(self.task.runs.orders["phase"][lane])
        tip = y - size
        picture.line([(x, y), (x, tip)], INK, 2)
        if abs(size) > 8:
            head = 6 * np.sign(size)
            picture.polygon(
                [(x - 4, tip + head), (x + 4, tip + head), (x, tip - 2 * np.sign(size))], INK
            )

    def _draw_absorber(self, picture: Picture, x: float, y: float, scale: float, lane: int) -> None:
        """Draw the absorber next to the tip and, if it has walls, the cavity around it.

        The distance between absorber and cavity is the clearance to scale.
        """
        half = (
            0.0
            if self.sliding is None or self.sliding.walls is None
            else scale * self.task.runs.orders["gap"][lane]
        )
        x += MASS_SIZE + 16
        picture.line([(x - MASS_SIZE - 16, y), (x - MASS_SIZE - 6, y)], BLUE, 5)
        if half > 0:
            top = y - half - MASS_SIZE - 3
            bottom = y + half + MASS_SIZE + 3
            picture.line(
                [
                    (x + MASS_SIZE + 6, top),
                    (x - MASS_SIZE - 6, top),
                    (x - MASS_SIZE - 6, bottom),
                    (x + MASS_SIZE + 6, bottom),
                ],
                BLUE,
                4,
            )
        else:
            picture.line([(x - MASS_SIZE - 6, y - 20), (x - MASS_SIZE - 6, y + 20)], BLUE, 4)
        centre = y - scale * self.task.runs.reports["distance"][lane]
        picture.box(x - MASS_SIZE, centre - MASS_SIZE, x + MASS_SIZE, centre + MASS_SIZE, RED, INK)

    def close(self) -> None:
        """Close the window."""
        if self._window is not None:
            self._window.close()


def _draw_strip(picture: Picture, strip: Strip, top: float, bottom: float) -> None:
    picture.text(STRIP_LEFT, top - 17, strip.label)
    picture.box(STRIP_LEFT, top, STRIP_RIGHT, bottom, None, "#a0a0a0")
    span = strip.high - strip.low
    for value, y in ((strip.high, top), (strip.low, bottom)):
        picture.text(STRIP_LEFT - 6, y, f"{value:.2f}", 11, "rm")
    last = max(strip.times[-1], 1e-9)
    points = [
        (
            STRIP_LEFT + (STRIP_RIGHT - STRIP_LEFT) * time / last,
            bottom - (bottom - top) * (value - strip.low) / span,
        )
        for time, value in zip(strip.times, strip.values, strict=True)
    ]
    if len(points) > 1:
        picture.line(points, strip.colour, 2)


class _Window:
    """A window on the screen, with pygame."""

    def __init__(self) -> None:
        try:
            import pygame
        except ImportError as error:
            raise ParameterError(
                f'render_mode = "human" is not allowed: it needs pygame-ce; {how_to_install("env")}'
            ) from error
        self._pygame = pygame
        pygame.display.init()
        self._surface = pygame.display.set_mode((IMAGE_WIDTH, IMAGE_HEIGHT))
        pygame.display.set_caption("impact absorber")
        self._clock = pygame.time.Clock()

    def show(self, pixels: NDArray[np.uint8], fps: int) -> None:
        """Show an image, at most ``fps`` a second."""
        self._pygame.event.pump()
        self._surface.blit(self._pygame.surfarray.make_surface(np.swapaxes(pixels, 0, 1)), (0, 0))
        self._pygame.display.flip()
        self._clock.tick(fps)

    def close(self) -> None:
        """Close the window."""
        self._pygame.display.quit()
