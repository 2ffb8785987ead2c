"""Pages whose text is written by hand and whose tables are written by a script, between markers; and what a page says about the machine."""

from __future__ import annotations

import datetime
import json
import platform
from collections.abc import Callable, Iterable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import TypeVar

import llvmlite.binding
from _command_line import BadInput

from impact_env.ensemble import available_cores
from impact_env.kernels.cache import digest
from optimisation.files import replacing

T = TypeVar("T")
ROOT = Path(__file__).resolve().parents[1]  # of the checkout, or of what a wheel brings of it


def published(docs: Path, results: Path) -> Path:
    """Return where a whole study is written by default: into the checkout's docs, or where there is no checkout among other results."""
    return docs if (ROOT / "pyproject.toml").is_file() else results


def require_markers(path: Path, template: Path, names: Iterable[str]) -> str:
    """Return the text of the page that `fill` starts from; raises BadInput unless it has the markers of each section, once and in order."""
    source = path if path.exists() else template
    try:
        text = source.read_text(encoding="utf-8")
    except OSError as error:
        raise BadInput(f"{source} is not allowed: a page that can be read ({error})") from error
    for name in names:
        start, end = _markers(name)
        if text.count(start) != 1 or text.count(end) != 1 or text.index(start) > text.index(end):
            raise BadInput(f"{source} is not allowed: a page with one pair of markers {start} and {end}")
    return text


def _markers(name: str) -> tuple[str, str]:
    return f"<!-- {name} -->", f"<!-- /{name} -->"


def fill(path: Path, template: Path, sections: Mapping[str, str]) -> None:
    """Write ``template`` (or ``path`` itself where it exists) to ``path`` with the text between the markers of each section replaced.

    A marker is a line ``<!-- NAME -->``, its end ``<!-- /NAME -->``. Raises BadInput, before anything is written, if one is missing.
    """
    text = require_markers(path, template, sections)
    for name, body in sections.items():
        start, end = _markers(name)
        head, rest = text.split(start)
        text = head + start + "\n" + body.strip("\n") + "\n" + end + rest.split(end)[1]
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def load_results(path: Path, kind: Callable[..., T]) -> T:
    """Read results that were saved as JSON; raises BadInput if they are not of this kind."""
    try:
        return kind(**json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError) as error:
        raise BadInput(f"--redraw: {path} is not allowed: a file that an earlier run wrote ({error})") from error


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        return next(line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def conditions() -> dict[str, object]:
    """Return date, machine and versions of a measurement; the version of the kernels is the hash of their sources."""
    packages = {name: version(name) for name in ("numpy", "scipy", "numba", "llvmlite")}
    return {
        "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
        "processor": f"{_processor()} ({llvmlite.binding.get_host_cpu_name()})",
        "cores": available_cores(),
        "system": f"{platform.system()} {platform.machine()}",
        "versions": {"python": platform.python_version(), **packages, "kernels": digest()},
    }


def conditions_line(values: Mapping[str, object]) -> str:
    """Say in a sentence where and when something was measured."""
    versions = values["versions"]
    assert isinstance(versions, Mapping)
    named = ", ".join(f"{'Python' if name == 'python' else name} {number}" for name, number in versions.items())
    return f"Measured on {values['date']}, {values['processor']}, {values['cores']} cores, {values['system']}; {named}."
