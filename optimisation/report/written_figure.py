"""Figures written to files: the format by the ending, PNG with a palette."""

from io import BytesIO
from pathlib import Path

from matplotlib.figure import Figure
from PIL import Image  # which matplotlib needs

COLOURS = 256


def write_figure(figure: Figure, path: Path, dpi: float = 160) -> None:
    """Write a figure in the format that the ending of its path names (PNG where it has none).

    A PNG has a palette of 256 colours: less than half as large, and off by less than one of 255 steps of a colour in the mean, at edges of lines.
    """
    kind = path.suffix[1:] or "png"
    if kind != "png":
        figure.savefig(path, dpi=dpi, format=kind)
        return
    drawn = BytesIO()
    figure.savefig(drawn, dpi=dpi, format=kind)
    few_colours(Image.open(drawn)).save(path, format=kind, optimize=True, dpi=(dpi, dpi))


def few_colours(image: Image.Image) -> Image.Image:
    """Return an image with a palette, without a pattern of dots in place of colours that are left out."""
    return image.convert("RGB").quantize(COLOURS, Image.Quantize.MEDIANCUT, kmeans=2, dither=Image.Dither.NONE)
