"""Lines of Python by part against their budgets, [tool.workbench.lines] of pyproject.toml; the exit code is 1 where one is above.

What is built later raises a budget in a commit that says why.
"""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def counted(root: Path) -> dict[Path, int]:
    """Return the lines of each Python file that is tracked, or about to be."""
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard", "*.py"], cwd=root, check=True, capture_output=True, text=True
    ).stdout
    files = [Path(name) for name in listed.splitlines() if (root / name).is_file()]
    return {file: (root / file).read_text(encoding="utf-8").count("\n") for file in files}


def main(root: Path = ROOT) -> int:
    """Print a line for each part."""
    lines, status = counted(root), 0
    for part, budget in tomllib.loads((root / "pyproject.toml").read_text())["tool"]["workbench"]["lines"].items():
        of = [file for file in lines if part == "everything" or any(file.is_relative_to(folder) for folder in part.split())]
        total = sum(lines[file] for file in of)
        status |= total > budget
        print(f"{part:<28} {len(of):4} files {total:7,} lines of {budget:,}" + ("   ABOVE ITS BUDGET" if total > budget else ""))
    return status


if __name__ == "__main__":
    sys.exit(main())
