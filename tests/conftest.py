from __future__ import annotations

import os
import shutil
from pathlib import Path

from hypothesis import settings

settings.register_profile("workbench", derandomize=True, deadline=None)
settings.load_profile("workbench")


def _own_kernel_cache() -> None:
    """Give each test process its own copy of the kernel cache: two that write one cache can spoil each other's entries."""
    shared, worker = os.environ.get("IMPACT_ENV_CACHE"), os.environ.get("PYTEST_XDIST_WORKER")
    if not shared or not worker:
        return
    own = Path(shared) / f"test-{worker}"
    for folder in Path(shared).glob("[0-9a-f]" * 16):
        if not (own / folder.name).exists():
            shutil.copytree(folder, own / folder.name)
    os.environ["IMPACT_ENV_CACHE"] = str(own)


_own_kernel_cache()  # before any test module imports the package
