"""Build a wheel for Linux with compiled kernels, for the Python that builds it.

The compiled kernels come from the folder that the environment variable ``KERNELS`` names. Without
this variable the wheel is a pure one.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

# as llvmlite's own wheels: kernels call nothing but what that and the C library's mathematics have
SYSTEM = "manylinux_2_27_x86_64"


class CompiledWheel(BuildHookInterface[Any]):
    """What the build adds."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:  # noqa: ARG002 - hatchling's interface
        """Add the kernels, and say in the wheel's name what they are for."""
        if not os.environ.get("KERNELS"):
            return
        (made,) = Path(os.environ["KERNELS"]).iterdir()  # named by the digest of their sources
        kernels = {
            str(file): f"impact_env/kernels/shipped/{file.relative_to(made.parent).as_posix()}"
            for file in made.rglob("*.nb[ci]")
        }
        python = f"cp{sys.version_info[0]}{sys.version_info[1]}"
        build_data |= {"pure_python": False, "tag": f"{python}-{python}-{SYSTEM}"}
        build_data["force_include"] |= kernels
