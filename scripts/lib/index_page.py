"""The README as a package index shows it: it knows no file beside it, so links lead into the repository that ``PROJECT_URL`` names.

Where that is not set, as in a build by hand, links into the checkout become plain words, figures go, and the package has no addresses.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

LINK = re.compile(r"(!?)\[([^\]]*)\]\((?!https?:|#)([^)\s]+)\)")
MARKER = re.compile(r"^<!-- /?[\w ]+ -->\n", re.MULTILINE)


def page(text: str, address: str, version: str) -> str:
    """Return a README whose links into a checkout lead to those files of a version at an address, or to nothing where that is empty."""

    def link(match: re.Match[str]) -> str:
        figure, words, path = match.groups()
        if not address:
            return "" if figure else words
        return f"{figure}[{words}]({address}/{'raw' if figure else 'blob'}/v{version}/{path})"

    return LINK.sub(link, MARKER.sub("", text))


class IndexPage(MetadataHookInterface):
    """What pyproject.toml leaves to the build: readme and urls."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Fill in both."""
        address = os.environ.get("PROJECT_URL", "").rstrip("/")
        text = Path(self.root, "README.md").read_text(encoding="utf-8")
        metadata["readme"] = {
            "content-type": "text/markdown",
            "text": page(text, address, metadata["version"]),
        }
        tree = f"{address}/blob/v{metadata['version']}"
        names = {
            "Documentation": "docs/README.md",
            "Changelog": "CHANGELOG.md",
            "Security": "SECURITY.md",
        }
        metadata["urls"] = (
            {"Source": address, **{name: f"{tree}/{path}" for name, path in names.items()}}
            if address
            else {}
        )
