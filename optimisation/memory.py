"""The largest memory that a process has had, on any system."""

from __future__ import annotations

import sys

if sys.platform == "win32":
    import psutil
else:
    import resource


def peak_memory() -> int:
    """Return the largest resident memory that this process had, in bytes; that of its children is not in it."""
    if sys.platform == "win32":
        return int(psutil.Process().memory_info().peak_wset)
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
