"""Where tests find what they read and run: the checkout and its folders, and processes of its Python."""

import os
import subprocess
import sys
from pathlib import Path

SUPPORT = Path(__file__).resolve().parent
TRUTHS = SUPPORT.parent / "truths"
ROOT = SUPPORT.parents[1]
SCRIPTS = ROOT / "scripts"
EXAMPLES = ROOT / "docs" / "examples"


def fresh(*words: object, **variables: object) -> subprocess.CompletedProcess[str]:
    """Run Python in a process of its own, which finds the checkout and what tests share; it must succeed."""
    path = os.pathsep.join(map(str, (ROOT, SCRIPTS, SUPPORT, SUPPORT.parent)))
    environment = os.environ | {"PYTHONPATH": path} | {name: str(value) for name, value in variables.items()}
    done = subprocess.run([sys.executable, *map(str, words)], env=environment, capture_output=True, text=True, timeout=580)
    assert done.returncode == 0, done.stderr
    return done
