"""What the parts of the study share: how much to compute, rows of results, and files that hold them together with the machine."""

from __future__ import annotations

import json
import platform
import statistics
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

import numba

from impact_env.ensemble import available_cores
from impact_env.kernels.cache import digest
from optimisation.files import write_csv, write_json

Row = dict[str, Any]


@dataclass(frozen=True)
class Settings:
    """How much to compute. Steps are per period of the highest mode; rates in pseudo periods per 1 % of the resonance frequency."""

    modes: tuple[int, ...] = (1, 3, 10, 30)
    kinds: tuple[str, ...] = ()  # empty: all
    steps: tuple[int, ...] = (20, 40, 100, 200, 400, 1000, 2000, 4000, 10000, 20000)
    peers: bool = True
    scipy_tolerances: tuple[float, ...] = (1e-6, 1e-9, 1e-12)
    heyoka_tolerances: tuple[float, ...] = (1e-9, 1e-15)
    starts: int = 5  # places in the motion over whose errors the median is taken
    repeats: int = 5
    timed_seconds: float = 0.05  # wanted length of a timed run
    patience: float = 2.0  # no further repeat of a run once its repeats have taken this many seconds
    sweep: tuple[float, float] = (0.92, 1.0)  # of the ensembles, times the first resonance
    sweep_steps: tuple[int, ...] = (20, 80, 320)
    truth_members: int = 64
    members: int = 32
    budget: float = 8.0  # seconds for the ensemble of one method
    band_members: int = 200
    band_phases: int = 20
    band_repeats: int = 10
    stretches: int = 200
    twins: int = 12
    jump_rates: tuple[float, ...] = (100.0, 200.0, 400.0, 725.0, 1450.0)
    jump_steps: tuple[int, ...] = (20, 60, 200)
    jump_members: int = 60
    cost_modes: tuple[int, ...] = (1, 2, 3, 5, 7, 10, 14, 20, 30, 40, 50, 60)
    cost_lanes: tuple[int, ...] = (1, 4, 16, 64, 256, 1024)
    cost_periods: tuple[int, ...] = (10, 100, 1000, 10_000, 100_000)
    seed: int = 0


FULL = Settings()
QUICK = Settings(
    modes=(3, 10),
    kinds=("no absorber", "impact, e = 1", "impact, e = 0.7, with friction", "compliant walls, stiff"),
    steps=(20, 200, 2000),
    scipy_tolerances=(1e-9,),
    heyoka_tolerances=(1e-15,),
    starts=3,
    repeats=3,
    timed_seconds=0.02,
    patience=0.5,
    sweep_steps=(20, 80),
    truth_members=16,
    members=12,
    budget=1.5,
    band_members=20,
    band_phases=5,
    band_repeats=4,
    stretches=40,
    twins=4,
    jump_rates=(100.0, 200.0),
    jump_steps=(20, 60),
    jump_members=12,
    cost_modes=(1, 3, 10, 30),
    cost_lanes=(1, 16, 64),
    cost_periods=(10, 100, 1000),
)


@dataclass
class Result:
    """The rows of one part, and the circumstances under which they were made."""

    part: str
    rows: list[Row]
    circumstances: Row = field(default_factory=dict)

    @property
    def complete(self) -> bool:
        return bool(self.circumstances.get("complete", True))


def median_time(run: Callable[[], float], repeats: int, patience: float) -> float:
    """Return the median of several times in s; slow runs are repeated less often."""
    began = time.perf_counter()
    times = [run()]
    while len(times) < repeats and time.perf_counter() - began < patience:
        times.append(run())
    return statistics.median(times)


def circumstances(quick: bool, seconds: float, complete: bool) -> Row:
    packages = ("numpy", "scipy", "numba", "mpmath", "heyoka")
    versions = {name: metadata.version(name) for name in packages if _installed(name)} | {"kernels": digest()}
    return {
        "machine": processor(),
        "cores": available_cores(),
        "python": platform.python_version(),
        "versions": versions,
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
        "quick": quick,
        "complete": complete,
        "seconds": round(seconds, 1),
    }


def _installed(name: str) -> bool:
    try:
        metadata.version(name)
    except metadata.PackageNotFoundError:
        return False
    return True


def processor() -> str:
    """Return the processor's name as the system gives it, with the family that the kernels are compiled for."""
    name = ""
    info = Path("/proc/cpuinfo")
    if info.exists():
        name = next((line.partition(":")[2].strip() for line in info.read_text().splitlines() if line.startswith("model name")), "")
    family = numba.core.config.CPU_NAME or platform.machine()
    return f"{name or platform.processor() or platform.machine()} ({family})" if name != family else name


def save(folder: Path, result: Result) -> list[Path]:
    """Write a part's rows as JSON, with their circumstances, and as CSV."""
    files = [folder / f"{result.part}.json", folder / f"{result.part}.csv"]
    write_json(files[0], {"part": result.part, **result.circumstances, "rows": result.rows})
    columns = list(dict.fromkeys(name for row in result.rows for name in row))
    write_csv(files[1], columns, ([_cell(row.get(name)) for name in columns] for row in result.rows))
    return files


def _cell(value: object) -> object:
    return " ".join(map(str, value)) if isinstance(value, list) else "" if value is None else value


def load(folder: Path, part: str) -> Result | None:
    """Read a part's rows back; None if there are none. Raises ValueError if the file is not what `save` writes."""
    path = folder / f"{part}.json"
    if not path.exists():
        return None
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        rows = content.pop("rows")
        if content.pop("part") != part or not isinstance(rows, list):
            raise KeyError(part)
    except (KeyError, AttributeError, json.JSONDecodeError) as error:
        raise ValueError(f"{path} is not a file of the part {part}: made by another script, or changed by hand") from error
    return Result(part, rows, content)


def with_scenes(old: Result, new: Result, order: Sequence[tuple[str, int]]) -> Result:
    """Return the old rows with those of the scenes (name, number of modes) in ``new`` replaced or added; complete when all of ``order`` are there."""

    def scene(row: Row) -> tuple[str, int]:
        return row["scene"], row["modes"]

    fresh = {scene(row) for row in new.rows}
    rows = [row for row in old.rows if scene(row) not in fresh] + new.rows
    rows.sort(key=lambda row: order.index(scene(row)))  # stable: a scene's rows keep their order
    seconds = round(old.circumstances["seconds"] + new.circumstances["seconds"], 1)
    return Result(new.part, rows, new.circumstances | {"complete": {scene(row) for row in rows} == set(order), "seconds": seconds})


def unique(values: Iterable[Any]) -> list[Any]:
    """Return the values without repetition, in the order in which they appear."""
    return list(dict.fromkeys(values))
