"""Check the links of a built site, and that its pages fetch nothing from other sites.

Each link inside the site must lead to an existing file and to an existing place in it.
"""

from __future__ import annotations

import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

FETCHED = {"script": "src", "img": "src", "link": "href", "iframe": "src", "source": "src"}
POINTED_AT = (
    "canonical",
    "alternate",
    "search",
    "next",
    "prev",
    "index",
    "author",
    "help",
)  # <link> that fetches nothing


class Page(HTMLParser):
    """What a page links to, what it fetches, and the names of its places."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.fetched: list[str] = []
        self.places: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        attributes = {name: value or "" for name, value in attrs}
        self.places.update(attributes[name] for name in ("id", "name") if name in attributes)
        if tag == "a" and attributes.get("href"):
            self.links.append(attributes["href"])
        if (
            tag in FETCHED
            and attributes.get(FETCHED[tag])
            and not (tag == "link" and attributes.get("rel") in POINTED_AT)
        ):
            self.fetched.append(attributes[FETCHED[tag]])


def problems(site: Path) -> list[str]:
    """Return a message for each dead link and each external fetch of a site's pages.

    A dead link leads to no file of the site, or to no place in the file. An external fetch is
    something that is loaded from another site when a page is opened.
    """
    pages = {
        file.resolve(): Page(file.read_text(encoding="utf-8")) for file in site.rglob("*.html")
    }
    messages = []
    for file, page in pages.items():
        name = file.relative_to(site.resolve())
        messages += [
            f"{name}: fetches {address}" for address in page.fetched if urlsplit(address).netloc
        ]
        for address in (*page.links, *page.fetched):
            parts = urlsplit(address)
            if parts.scheme or parts.netloc:
                continue
            target = (file.parent / unquote(parts.path)).resolve() if parts.path else file
            if not target.is_file():
                messages.append(f"{name}: {address} leads to no file")
            elif (
                parts.fragment
                and target in pages
                and unquote(parts.fragment) not in pages[target].places
            ):
                messages.append(f"{name}: {address} leads to no place in that page")
    return messages if pages else [f"{site}: no pages"]


def main(site: Path) -> int:
    """Print what is wrong; the exit code is 1 then."""
    messages = problems(site)
    print("\n".join(messages), end="\n" * bool(messages), file=sys.stderr)
    return 1 if messages else 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
