"""Paths and processes of the tests.

They are the checkout and its folders, copies of its modules, and processes of its Python.
"""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

SUPPORT = Path(__file__).resolve().parent
TRUTHS = SUPPORT.parent / "truths"
ROOT = SUPPORT.parents[1]
SCRIPTS = ROOT / "scripts"
EXAMPLES = ROOT / "docs" / "examples"


def loaded(file: Path) -> ModuleType:
    """Return a copy of a module, by its file."""
    spec = importlib.util.spec_from_file_location(file.stem, file)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def fresh(*words: object, **variables: object) -> subprocess.CompletedProcess[str]:
    """Run Python in a process of its own, which must succeed.

    The process finds the checkout and the shared modules of the tests.
    """
    path = os.pathsep.join(map(str, (ROOT, SCRIPTS, SUPPORT, SUPPORT.parent)))
    environment = (
        os.environ | {"PYTHONPATH": path} | {name: str(value) for name, value in variables.items()}
    )
    done = subprocess.run(
        [sys.executable, *map(str, words)],
        env=environment,
        capture_output=True,
        text=True,
        timeout=580,
    )
    assert done.returncode == 0, done.stderr
    return done
