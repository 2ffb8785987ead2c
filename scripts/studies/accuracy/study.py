"""The study of error against run time: its parts, its files and its page."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import ModuleType

from matplotlib.figure import Figure

from optimisation.page import published
from optimisation.report.figures import write_figure
from studies.accuracy import bands, cost, distribution, growth, jumps, trajectory
from studies.accuracy.cases import Row, Settings, made_with
from studies.study import Json, Measured, Part, Saver, Study, rows_part

QUICK_OUT = Path("results/error_vs_runtime")
OUT = published(Path("docs/methods"), QUICK_OUT)
DPI = 110


def _part(
    module: ModuleType, title: str, table: Callable[[list[Row]], str], draw: Callable[[list[Row]], dict[str, Figure]] = lambda _: {}
) -> Part[Settings]:
    """Return a part of the study: a module with its ``cases`` and the ``key`` of a row's case, a table and figures by file name, of its rows."""

    def text(measured: Measured) -> str:
        return f"{table(measured.values['rows'])}\n\n{made_with(measured)}"

    def figures(measured: Measured) -> dict[str, Saver]:
        return {file: partial(write_figure, figure, dpi=DPI) for file, figure in draw(measured.values["rows"]).items()}

    return rows_part(module.NAME, title, module.cases, module.key, text, figures=figures)


RENAMED = {"processor": "machine", "wall_s": "seconds"}  # in the file


def pack(name: str, measured: Measured) -> Json:
    """Return the content of PART.json.gz."""
    made = {"failure": "", **measured.conditions}
    versions = dict(made.pop("versions"))
    python = versions.pop("python")
    kept = {RENAMED.get(word, word): value for word, value in made.items()}
    return {"part": name, "python": python, "versions": versions, "complete": measured.complete, **kept, "rows": measured.values["rows"]}


def unpack(name: str, content: Json) -> Measured:
    """Return the values in the content of a file; raises KeyError or ValueError if it was another."""
    if content.pop("part") != name:
        raise ValueError(f"not the part {name}")
    rows, complete = content.pop("rows"), content.pop("complete")
    if not isinstance(rows, list):
        raise TypeError("rows are no list")
    made = {word: content.pop(file) for word, file in RENAMED.items()}
    return Measured({"rows": rows}, made | {"versions": {"python": content.pop("python"), **content.pop("versions")}} | content, bool(complete))


STUDY: Study[Settings] = Study(
    (
        _part(trajectory, "errors over the first impacts", trajectory.trajectory_table, trajectory.trajectory_figures),
        _part(distribution, "errors of the level's distribution", distribution.distribution_table, distribution.distribution_figures),
        _part(bands, "what a band stands for", bands.band_table),
        _part(growth, "how fast errors grow", growth.growth_table, growth.growth_figures),
        _part(jumps, "the jump of the two-mode absorber", jumps.jump_table, jumps.jump_figures),
        _part(cost, "what a pseudo period costs", cost.cost_table, cost.cost_figures),
    ),
    notes=lambda settings: {"quick": settings.quick, "seed": settings.seed, "peers": settings.peers},
    pack=pack,
    unpack=unpack,
    packages=("numpy", "scipy", "numba", "mpmath", "heyoka"),
    same=("processor", "versions", "quick", "seed", "peers"),
)
PARTS = tuple(part.name for part in STUDY.parts)
