"""What a study says about itself: when, on which machine and from which sources its numbers are."""

import datetime
import platform
import sys
from collections.abc import Iterable, Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import llvmlite.binding

from impact_env.ensemble import available_cores
from impact_env.kernels.compiling.cache import digest

PACKAGES = ("numpy", "scipy", "numba", "llvmlite")


def family() -> str:
    """Return the name by which the compiler knows the processor: what kernels are compiled for."""
    return str(llvmlite.binding.get_host_cpu_name())


def processor() -> str:
    """Return the processor's name as the system gives it, with its `family`."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        name = next(line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        name = platform.processor() or platform.machine()
    return f"{name} ({family()})"


def versions(packages: Iterable[str] = PACKAGES) -> dict[str, str]:
    """Return the versions of the packages that are installed, and of the sources: the hash of the kernels."""
    found = {}
    for name in packages:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found | {"kernels": digest()}


def conditions(packages: Iterable[str] = PACKAGES) -> dict[str, Any]:
    """Return date, machine and versions of a measurement."""
    return {
        "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
        "processor": processor(),
        "cores": available_cores(),
        "system": f"{platform.system()} {platform.machine()}",
        "versions": {"python": platform.python_version(), **versions(packages)},
    }


def machine(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return `conditions` for a benchmark's file, with the versions of numba and Python by their names."""
    return {"processor": values["processor"], **{name: values["versions"][name] for name in ("numba", "python")}, **values}


def sources(values: Mapping[str, Any]) -> str:
    """Say in a sentence when, where and from which sources something was measured: what `conditions` returned then."""
    named = ", ".join(f"{'Python' if name == 'python' else name} {number}" for name, number in values["versions"].items())
    where = (values["date"], values["processor"], f"{values['cores']} cores", values.get("system"))
    return f"Measured on {', '.join(part for part in where if part)}; {named}."


# The largest memory that a process has had, on any system.


if sys.platform == "win32":
    import psutil
else:
    import resource


def peak_memory() -> int:
    """Return the largest resident memory that this process had, in bytes; that of its children is not in it."""
    if sys.platform == "win32":
        return int(psutil.Process().memory_info().peak_wset)
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
