"""Origin of a study's numbers: date, machine and sources, and the duration of a run."""

import datetime
import hashlib
import platform
import re
import sys
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import llvmlite.binding

import impact_env
from impact_env.drive import Drive, Excitation, constant_frequency
from impact_env.ensemble import available_cores
from impact_env.kernels.compiling.cache import hash_sources
from impact_env.methods import Method
from impact_env.results import Record, Response
from impact_env.scene import Scene
from impact_env.sweep import simulate

PACKAGES = ("numpy", "scipy", "numba", "llvmlite")
UNNAMED = ("kernels", "numpy", "scipy", "llvmlite")  # in the sentence of `sources`


def family() -> str:
    """Return the name by which the compiler knows the processor: what kernels are compiled for."""
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


def installed(packages: Iterable[str]) -> dict[str, str]:
    """Return the versions of packages, of those that are installed."""
    versions_known = {}
    for name in packages:
        with suppress(PackageNotFoundError):
            versions_known[name] = version(name)
    return versions_known


def versions(packages: Iterable[str] = PACKAGES) -> dict[str, str]:
    """Return the versions of the installed packages, and the hash of the kernels' sources."""
    return installed(packages) | {"kernels": hash_sources()}


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
class Timed:
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
    """Return the hash of the sources on which numbers depend, and the versions of packages.

    The hash is ``code``. The versions are those of installed ``packages``.

    Two processes with the same fingerprint run the same instructions on one kind of processor. One
    with another may get other numbers unnoticed: so it does not go on with a study of the first,
    and does no work for it as a cluster's worker.
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
    return {"code": known.hexdigest()[:16], **installed(packages)}


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
