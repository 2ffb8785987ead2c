"""The comparison of absorbers as its command makes it: with a bar, on threads or a cluster, and its files."""

from __future__ import annotations

import platform
import time
from pathlib import Path
from typing import Any

import numba
import numpy
import scipy

from impact_env.ensemble import available_cores
from impact_env.modes import Structure
from optimisation.comparison import Comparison, compare
from optimisation.executors import workers
from optimisation.files import replacing, write_csv, write_json
from optimisation.memory import peak_memory
from optimisation.progress import sweeps_bar
from optimisation.report.comparison_tables import CURVE_COLUMNS, RUN_COLUMNS, curve_rows, run_rows, summary

QUICK_FORCES, QUICK_MEMBERS = 10, 2


def compared(structure: Structure | None, cluster: str | None, given: dict[str, Any]) -> Comparison:
    """Return what `compare` finds with the arguments ``given``; ``structure`` None is the paper's beam, ``cluster`` an address or None."""
    own: dict[str, Any] = {} if structure is None else {"beam": structure}
    with workers(given["threads"], cluster) as executor, sweeps_bar("comparing") as show:
        return compare(**own, progress=show, executor=executor, **given)


def conditions(started: float, threads: int | None, cluster: str | None) -> dict[str, object]:
    """Return versions, threads or cluster, the time since ``started`` (of ``time.perf_counter``, s) and the memory used."""
    versions = {"python": platform.python_version(), "numpy": numpy.__version__, "scipy": scipy.__version__, "numba": numba.__version__}
    return {
        "versions": versions,
        **({"cluster": cluster} if cluster else {"threads": threads or available_cores()}),
        "wall_s": round(time.perf_counter() - started, 2),
        "memory_bytes": peak_memory(),
    }


def write(out: Path, comparison: Comparison, made: dict[str, object]) -> list[Path]:
    """Write runs, curves, summary (with the conditions ``made``) and figure into a folder, each whole or not at all; return the files."""
    from optimisation.report.comparison_figure import save_figure  # matplotlib is slow to import

    files = [out / name for name in ("runs.csv", "curves.csv", "summary.json", "comparison.png")]
    write_csv(files[0], RUN_COLUMNS, run_rows(comparison))
    write_csv(files[1], CURVE_COLUMNS, curve_rows(comparison))
    write_json(files[2], made | summary(comparison))
    with replacing(files[3]) as temporary:
        save_figure(temporary, comparison)
    return files
