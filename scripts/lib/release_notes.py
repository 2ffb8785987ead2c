#!/usr/bin/env python3
"""Print the section of CHANGELOG.md of one version: ``release_notes.py 1.0.0``.

It needs nothing but Python.
"""

import re
import sys
from pathlib import Path

CHANGELOG = Path(__file__).parents[2] / "CHANGELOG.md"


def section_of(version: str, changelog: str) -> str:
    """Return the text below the heading of a version, up to the next version.

    Parameters
    ----------
    version : str
        Version as in the heading ``## [version] - date``.
    changelog : str
        Text of the changelog.

    Raises
    ------
    ValueError
        The changelog has no such section, or an empty one.
    """
    sections = re.split(r"^## \[", changelog, flags=re.MULTILINE)[1:]
    for section in sections:
        heading, _, text = section.partition("\n")
        if heading.partition("]")[0] == version and text.strip():
            return text.strip()
    known = ", ".join(section.partition("]")[0] for section in sections)
    message = f"CHANGELOG.md has no section of version {version}, or an empty one; it has {known}"
    raise ValueError(message)


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: release_notes.py VERSION")
    try:
        print(section_of(sys.argv[1], CHANGELOG.read_text(encoding="utf-8")))
    except ValueError as error:
        sys.exit(f"error: {error}")
