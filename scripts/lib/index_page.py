"""The README for a package index, with links into the repository at ``PROJECT_URL``.

A package index does not have the files next to the README, so relative links would lead nowhere.

Where that is not set, as in a build by hand, links into the checkout become plain text, figures are
left out, and the package has no addresses.
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
    """Return a README whose links into a checkout are replaced by links to ``address``.

    The links lead to the same files of the given version. If ``address`` is empty, links become
    plain words and figures are removed.
    """

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
