"""Finished work saved in files, from which a stopped run continues, and the origin of numbers.

The origin of a study's numbers is date, machine and sources. The saved work consists of pieces of
long work, and of the runs of a search.

The file is a SQLite database with one table. SQLite writes each piece completely or not at all, and
locks the file for other processes. A killed process loses nothing; after a power failure the last
pieces may be missing.

All searches are determined by their seed and by the results of their runs. Started again, a search
requests the same runs in the same order, and runs in the file are not made again. A run is
identified by all its inputs, so a search with other inputs finds no stored run and makes its own.
"""

from __future__ import annotations

import datetime
import errno
import hashlib
import json
import platform
import re
import sqlite3
import sys
from collections.abc import Callable, Generator, Hashable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field, fields, is_dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import llvmlite.binding
import numpy as np

import impact_env
from impact_env.checks import ParameterError
from impact_env.drive import Drive, Excitation, constant_frequency
from impact_env.ensemble import Executor, available_cores
from impact_env.kernels.compiling.cache import hash_sources
from impact_env.methods import Method
from impact_env.periodic.keeping import ComputeOrLoad, PlainResult
from impact_env.results import Record, Response
from impact_env.scene import Scene
from impact_env.sweep import simulate
from optimisation.measures import Chunk

# Origin of a study's numbers: date, machine and sources, and the duration of a run.

PACKAGES = ("numpy", "scipy", "numba", "llvmlite")
UNNAMED = ("kernels", "numpy", "scipy", "llvmlite")  # in the sentence of `sources`


def family() -> str:
    """Return the compiler's name of the processor, for which kernels are compiled."""
    return str(llvmlite.binding.get_host_cpu_name())


def processor() -> str:
    """Return the processor's name as the system gives it, with its `family`."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        name = next(
            line.partition(":")[2].strip() for line in lines if line.startswith("model name")
        )
    except (OSError, StopIteration):
        name = platform.processor() or platform.machine()
    return f"{name} ({family()})"


def installed_versions(packages: Iterable[str]) -> dict[str, str]:
    """Return the versions of those packages that are installed, by name."""
    versions_known = {}
    for name in packages:
        with suppress(PackageNotFoundError):
            versions_known[name] = version(name)
    return versions_known


def versions(packages: Iterable[str] = PACKAGES) -> dict[str, str]:
    """Return the versions of the installed packages, and the hash of the kernels' sources."""
    return installed_versions(packages) | {"kernels": hash_sources()}


def conditions(packages: Iterable[str] = PACKAGES) -> dict[str, Any]:
    """Return date, machine and versions of a measurement."""
    return {
        "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
        "release": impact_env.__version__,
        "processor": processor(),
        "cores": available_cores(),
        "system": f"{platform.system()} {platform.machine()}",
        "versions": {"python": platform.python_version(), **versions(packages)},
    }


def sources(values: Mapping[str, Any]) -> str:
    """Return a sentence with the origin of a measurement, from its `conditions`.

    The sentence has date, release, processor, cores, and the versions of Python, numba and
    packages that were compared. Files of numbers have all conditions.
    """
    named = ", ".join(
        f"{'Python' if name == 'python' else name} {number}"
        for name, number in values["versions"].items()
        if name not in UNNAMED
    )
    release = f"version {values['release']}" if "release" in values else ""
    name = re.sub(r"\((R|TM)\)| Processor| CPU", "", values["processor"])
    cores = f"{values['cores']} core{'' if values['cores'] == 1 else 's'}"
    where = (values["date"], release, name, cores)
    text = ", ".join(part for part in where if part)
    return f"Measured on {text}; {named}." if named else f"Measured on {text}."


if sys.platform == "win32":
    import psutil
else:
    import resource


def peak_memory() -> int:
    """Return the largest resident memory of this process so far, in bytes.

    That of its child processes is not included.
    """
    if sys.platform == "win32":
        return int(psutil.Process().memory_info().peak_wset)
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (
        1 if sys.platform == "darwin" else 1024
    )


BARE = Record(level=False)


@dataclass(frozen=True)
class TimedRun:
    """A run that can be timed repeatedly.

    Its kernels are compiled and its tables made in advance, by one pseudo period at the resonance
    or by a run.
    """

    scene: Scene
    drive: Excitation
    method: Method
    most_events: int | None = None
    record: Record = BARE

    def __post_init__(self) -> None:
        if not isinstance(self.drive, Drive):
            self.run()
            return
        schedule = constant_frequency(self.drive.schedule.reference, 1.0, 1.0)
        simulate(
            self.scene,
            Drive(self.drive.amplitude, schedule, self.drive.phase),
            self.method,
            record=self.record,
        )

    def run(self) -> Response:
        """Return a response; its ``wall_time`` is the time in s."""
        return simulate(
            self.scene, self.drive, self.method, record=self.record, most_events=self.most_events
        )


ROOT = Path(__file__).resolve().parents[1]
LEFT_OUT = (
    "cli",
    "envs",
    "explore",
    "report",
    "rl",
)  # commands, pages, figures and environments: no number of a search or a run is theirs
SEARCHING = (*PACKAGES, "optuna", "cmaes")  # a search is proposed by these as well


@cache
def source_hash(packages: tuple[str, ...] = PACKAGES, root: Path = ROOT) -> dict[str, str]:
    """Return the fingerprint of the sources on which numbers depend.

    It has the hash ``code`` and the versions of installed ``packages``. Two processes with equal
    fingerprints run the same instructions on the same kind of processor. Others may compute
    different numbers, so a process with another fingerprint neither continues a study nor works for
    it in a cluster.
    """
    known = hashlib.sha256()
    for file in sorted(
        file
        for name in ("impact_env", "optimisation")
        for file in root.joinpath(name).rglob("*.py")
    ):
        place = file.relative_to(root)
        if place.parts[1] not in LEFT_OUT:
            known.update(
                place.as_posix().encode()
                + b"\0"
                + file.read_bytes().replace(b"\r\n", b"\n")
                + b"\0"
            )
    return {"code": known.hexdigest()[:16], **installed_versions(packages)}


def difference(held: object, wanted: object, path: str = "") -> str:
    """Name the first place where two descriptions of JSON values differ."""
    if isinstance(held, dict) and isinstance(wanted, dict):
        for key in sorted({*held, *wanted}):
            if held.get(key) != wanted.get(key):
                return difference(held.get(key), wanted.get(key), f"{path}.{key}" if path else key)
    if isinstance(held, list) and isinstance(wanted, list) and len(held) == len(wanted):
        for k, (a, b) in enumerate(zip(held, wanted, strict=True)):
            if a != b:
                return difference(a, b, f"{path}[{k}]")
    return f"{path or 'identity'} is {held!r} there and {wanted!r} here"


Json = dict[str, Any]
FORM = 0x696D7031  # SQLite's application_id: the file is of this package and of this form
WRITABLE = "is not allowed: a file that can be written to, in a folder that exists"
REFUSALS = {
    "SQLITE_BUSY": "is in use by another process: wait for it, or choose another file",
    "SQLITE_CANTOPEN": WRITABLE,
    "SQLITE_READONLY": WRITABLE,
}


class Checkpoint:
    """JSON values by name, in memory and in a file.

    ``known`` has the values, ``path`` is the file, or None for memory alone. The file is locked by
    this process until `close`. Raises ParameterError, which begins with the name of the ``option``,
    for a file that is no checkpoint or an old one, that is damaged, in use, or not writable.
    """

    def __init__(self, path: Path | None = None, option: str = "--resume") -> None:
        self.path = path
        self.known = dict[str, Any]()
        self.something_else = (
            f"{option} = {path} is not allowed: a file that this option has written before, or "
            "none yet"
        )
        if path is None:
            return
        try:
            self._file = sqlite3.connect(path, timeout=0, isolation_level=None)
            self._file.execute("PRAGMA locking_mode = EXCLUSIVE")
            self._file.execute("BEGIN EXCLUSIVE")
            (tables,) = self._file.execute("SELECT count(*) FROM sqlite_master").fetchone()
            (form,) = self._file.execute("PRAGMA application_id").fetchone()
            if tables and form != FORM:
                raise ParameterError(
                    f"{self.something_else} (of another program, or of another version of this one)"
                )
            if not tables:
                self._file.execute(
                    "CREATE TABLE pieces (name TEXT PRIMARY KEY, value TEXT NOT NULL)"
                )
                self._file.execute(f"PRAGMA application_id = {FORM}")
            self._file.execute("COMMIT")
            self._file.execute(
                "PRAGMA journal_mode = WAL"
            )  # a piece then costs no wait for the disk
            self._file.execute("PRAGMA synchronous = NORMAL")
            self.known |= {
                name: json.loads(value)
                for name, value in self._file.execute("SELECT name, value FROM pieces")
            }
        except (sqlite3.Error, ValueError) as error:
            if isinstance(error, ParameterError):
                raise
            refusal = REFUSALS.get(getattr(error, "sqlite_errorname", ""))
            raise ParameterError(
                f"{option} = {path} {refusal}" if refusal else f"{self.something_else} ({error})"
            ) from error

    def store(self, name: str, value: object) -> None:
        """Store a value that JSON can express, or NaN, permanently.

        Raises OSError if the file cannot be written. The file then has its old content.
        """
        self.known[name] = value
        if self.path is not None:
            try:
                self._file.execute(
                    "INSERT OR REPLACE INTO pieces VALUES (?, ?)", (name, json.dumps(value))
                )
            except sqlite3.Error as error:
                raise OSError(errno.EIO, str(error), str(self.path)) from error

    def close(self) -> None:
        """Close the file."""
        if self.path is not None:
            self._file.close()

    def section(self, basis: Json) -> ComputeOrLoad:
        """Return the `ComputeOrLoad` for the work that ``basis`` and the kernels' sources describe.

        Other work may have its pieces in the same file.
        """
        basis = basis | {"kernels": hash_sources()}

        def compute_or_load(
            name: Json,
            make: Callable[[], Iterator[PlainResult]],
            read: Callable[[Json], PlainResult],
            /,
        ) -> Iterator[PlainResult]:
            key = json.dumps(basis | name, sort_keys=True)
            if key not in self.known:
                done = []
                for piece in make():
                    done.append(piece.to_plain())
                    yield piece
                self.store(key, done)
                return
            try:
                pieces = [read(value) for value in self.known[key]]
            except (ValueError, KeyError, TypeError, AttributeError) as error:
                raise ParameterError(f"{self.something_else} ({error})") from error
            yield from pieces

        return compute_or_load


FILE = "study file"
IDENTITY = "identity"


@dataclass(eq=False)
class RunCache:
    """An executor that makes only the runs that ``checkpoint`` lacks, and stores them.

    ``runs``: number of lanes that were made.
    """

    executor: Executor
    checkpoint: Checkpoint = field(default_factory=Checkpoint)
    runs: int = 0

    def each(
        self, function: Callable[[Any], Any], items: Sequence[Any], kinds: Sequence[Hashable]
    ) -> Generator[tuple[int, Any], None, None]:
        """Yield the results of all items, see `impact_env.ensemble.Executor`.

        Raises OSError if the file cannot be written. The file then has its old content.
        """
        same: dict[str, list[int]] = {}
        for k, chunk in enumerate(items):
            same.setdefault(key_of(chunk), []).append(k)
        new = [key for key in same if key not in self.checkpoint.known]
        first = [same[key][0] for key in new]
        for i, values in (
            self.executor.each(function, [items[k] for k in first], [kinds[k] for k in first])
            if new
            else ()
        ):
            self.runs += len(values)
            self.checkpoint.store(new[i], values.tolist())
            yield from ((k, values) for k in same.pop(new[i]))
        for key, numbers in same.items():  # those that were known
            yield from (
                (k, np.array(self.checkpoint.known[key], dtype=np.float64)) for k in numbers
            )


def key_of(chunk: Chunk) -> str:
    """Return a key of the runs and their measures, the same in any process."""
    known = hashlib.sha256()
    _fold(chunk, known)
    return known.hexdigest()[:24]


def _fold(value: object, known: hashlib._Hash) -> None:
    if is_dataclass(value):
        known.update(type(value).__name__.encode() + b"(")
        for part in fields(value):
            _fold(getattr(value, part.name), known)
    elif isinstance(value, np.ndarray):
        known.update(f"{value.dtype}{value.shape}".encode() + np.ascontiguousarray(value).tobytes())
    elif isinstance(value, Mapping):
        _fold(sorted(value.items()), known)
    elif isinstance(value, tuple | list):
        known.update(f"[{len(value)}".encode())
        for part in value:
            _fold(part, known)
    else:
        known.update(repr(value).encode() + b";")


def check_study_file(file: Path) -> None:
    """Raise ParameterError if a file cannot take a study."""
    Checkpoint(file, FILE).close()


@contextmanager
def open_run_cache(
    executor: Executor, identity: dict[str, object], file: Path | None
) -> Iterator[RunCache]:
    """Yield an executor that reuses the runs of a file; None stores them in memory.

    The file is locked until the end of the context. Raises ParameterError if it cannot be used, or
    if it has another ``identity``.
    """
    with closing(Checkpoint(file, FILE)) as checkpoint:
        wanted = json.loads(json.dumps(identity))
        held = checkpoint.known.get(IDENTITY)
        if held is None:
            checkpoint.store(IDENTITY, wanted)
        elif held != wanted:
            raise ParameterError(
                f"{FILE} = {file} is not allowed: it is another study: "
                f"{difference(held, wanted)}; choose another file"
            )
        yield RunCache(executor, checkpoint)
