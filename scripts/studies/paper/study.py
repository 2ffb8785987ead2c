"""The study that makes the paper again: its figures in order, their files and page, and the table of claims."""

from __future__ import annotations

import hashlib
import json
import sys
from pathlib import Path
from types import ModuleType
from typing import cast

from impact_env.kernels.compiling.cache import digest
from studies.paper import (
    basics,
    conv,
    dissinf,
    high_low,
    jump,
    m12,
    modes_needed,
    modulation,
    oprange,
    oprange_two,
    optimum,
    scat,
    smr,
    starts,
    vard,
    varom,
)
from studies.paper.claims import claims_part
from studies.paper.frame import NAME, PaperFigure
from studies.paper.settings import Settings
from studies.study import Json, Place, Study, beside

PAPERS: tuple[PaperFigure, ...] = (high_low, jump, smr, oprange, oprange_two, varom, vard, scat, dissinf, m12, conv)
BEYOND: tuple[PaperFigure, ...] = (optimum, modulation, modes_needed, starts)
FIGURES = (basics, *PAPERS, *BEYOND)  # in the order of the page
LABELS = tuple(module.PART.name for module in FIGURES)
PACKAGE = __package__ + "."
WORDS = ("_claims", ".claim", ".claims", ".words", ".frame", ".judging", ".style", ".settings", ".study")
OUT, QUICK_OUT = Path("results/paper"), Path("results/paper/quick")


def place(out: Path) -> Place:
    """Return where files go: the page paper.md into a folder, all else into its folder paper."""
    return beside(out, NAME, out / NAME)


def sources(module: ModuleType, known: frozenset[str] = frozenset()) -> frozenset[str]:
    """Return the modules of this study that a module's numbers come from: itself and what it takes from others, but for what only words or draws."""
    known |= {module.__name__}
    taken = {getattr(value, "__module__", None) or getattr(value, "__name__", "") for value in vars(module).values()}
    for name in sorted(str(name) for name in taken if str(name).startswith(PACKAGE) and not str(name).endswith(WORDS)):
        if name not in known:
            known |= sources(sys.modules[name], known)
    return known


def key(name: str, settings: Settings) -> Json:
    """Return what the numbers of a part depend on: a finished figure is kept as long as it is the same, the sources of its numbers included.

    After a change of words only, --redraw takes the numbers as they are.
    """
    module = next(module for module in FIGURES if module.PART.name == name)
    source = hashlib.sha256()
    for each in sorted(sources(cast(ModuleType, module))):
        source.update(Path(sys.modules[each].__file__ or "").read_bytes())
    own = {"kernels": digest(), "source": source.hexdigest()[:16]}
    plain: Json = json.loads(json.dumps({"quick": settings.quick, "seed": settings.seed, **own, "parameters": module.parameters(settings)}))
    return plain


STUDY: Study[Settings] = Study(
    tuple(module.PART for module in FIGURES), key=key, same=(), kept="finished figures are kept; the same command goes on from here."
)
CLAIMS: Study[Settings] = Study((claims_part(FIGURES),))  # once all figures that are to be made are there
