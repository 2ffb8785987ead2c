"""The site, which ``scripts/docs`` builds without a network.

It has the pages of this repository as they are, a reference from the docstrings, and notebooks.
"""

from __future__ import annotations

import importlib.util
import re
import shutil
import tomllib
from pathlib import Path
from typing import Any

from docutils import nodes
from pygments.lexers.special import TextLexer

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRA = {"Use": ["docs/site/api", "docs/site/notebooks"]}
LAST = ("The project", ["CONTRIBUTING", "CHANGELOG", "SECURITY", "CODE_OF_CONDUCT"])
NUMPY = "https://numpy.org/doc/stable/reference/"
GYMNASIUM = "https://gymnasium.farama.org/api/"
ELSEWHERE = {  # what the reference names and others describe: an inventory would have to be fetched
    "numpy.float64": f"{NUMPY}arrays.scalars.html#numpy.float64",
    "numpy.int64": f"{NUMPY}arrays.scalars.html#numpy.int64",
    "numpy.ndarray": f"{NUMPY}generated/numpy.ndarray.html",
    "numpy.typing.NDArray": f"{NUMPY}typing.html#numpy.typing.NDArray",
    "numpy.typing.ArrayLike": f"{NUMPY}typing.html#numpy.typing.ArrayLike",
    "numpy.random.Generator": f"{NUMPY}random/generator.html#numpy.random.Generator",
    "gymnasium.Env": f"{GYMNASIUM}env/",
    "gymnasium.core.Env": f"{GYMNASIUM}env/",
    "gymnasium.vector.VectorEnv": f"{GYMNASIUM}vector/",
    "gymnasium.vector.vector_env.VectorEnv": f"{GYMNASIUM}vector/",
}

project = "Impact absorber workbench"
author = PROJECT["authors"][0]["name"]
copyright = author  # noqa: A001 - Sphinx's own name
version = release = PROJECT["version"]
extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx.ext.mathjax",
]
autosummary_generate = False  # tables of names, without a page for each
napoleon_google_docstring = False
napoleon_use_rtype = False
include_patterns = [
    "*.md",
    "docs/*.md",
    "docs/internals/*.md",
    "docs/environments/*.md",
    "docs/site/*",
    "docs/notebooks/*.ipynb",
    "impact_env/kernels/README.md",
]
exclude_patterns = [
    ".*",
    "results",
    "build",
    "dist",
    "tests",
    "scripts",
    "requirements",
    "optimisation",
    "**/__pycache__",
    "docs/site/conf.py",
]
root_doc = "README"
default_role = "py:obj"
nb_execution_mode = "off"  # they are committed as executed: scripts/check_all executes them
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
suppress_warnings = ["myst.header"]  # the changelog's and the README's own
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # docstrings have types, units and shapes
python_use_unqualified_type_names = True
autodoc_default_options = {"members": True}
html_theme = "furo"
html_title = f"{project} {version}"
html_static_path: list[str] = []
html_show_sphinx = html_copy_source = False
mathjax_path = "mathjax/tex-chtml.js"


def toctrees() -> str:
    """Return the contents for the end of the first page.

    The headings are those of docs/README.md, which names each page with its question.
    """
    groups: dict[str, list[str]] = {}
    for line in (ROOT / "docs" / "README.md").read_text(encoding="utf-8").splitlines():
        if heading := re.match(r"\| \*\*(.*?)\*\* \|", line):
            groups[heading[1]] = []
        elif page := re.match(r"\| \[.*?\]\((.*?)\.md\)", line):
            groups[list(groups)[-1]].append(f"docs/{page[1]}".replace("docs/../", ""))
    trees = [
        ("Overview", ["docs/README"]),
        *((heading, pages + EXTRA.get(heading, [])) for heading, pages in groups.items()),
        LAST,
    ]
    return "".join(
        f"\n```{{toctree}}\n:hidden:\n:caption: {caption}\n\n" + "\n".join(pages) + "\n```\n"
        for caption, pages in trees
    )


def add_toctrees(app: Any, name: str, source: list[str]) -> None:  # noqa: ARG001 - Sphinx's own signature
    """Append the contents to the first page, and the environments' pages to their overview."""
    if name == root_doc:
        source[0] += toctrees()
    if name == "docs/environments":
        source[0] += "\n```{toctree}\n:hidden:\n:glob:\n\nenvironments/*\n```\n"


def refer(app: Any, env: Any, node: Any, content: Any) -> nodes.reference | None:  # noqa: ARG001
    """Refer to others' pages by their addresses."""
    address = ELSEWHERE.get(node.get("reftarget", ""))
    return (
        None
        if address is None
        else nodes.reference("", "", content, internal=False, refuri=address)
    )


def finish(app: Any, error: Exception | None) -> None:
    """Copy what renders formulas, and name the first page as servers and readers expect it."""
    if error is not None:
        return
    found = importlib.util.find_spec("sphinx-mathjax-offline")
    # type: ignore[union-attr, arg-type]
    source = Path(found.origin).parent / "static" / "mathjax"
    target = Path(app.outdir, "_static", "mathjax")
    shutil.copytree(
        source / "output" / "chtml" / "fonts" / "woff-v2",
        target / "output" / "chtml" / "fonts" / "woff-v2",
        dirs_exist_ok=True,
    )
    shutil.copy2(source / "tex-chtml.js", target)
    shutil.copy2(Path(app.outdir, f"{root_doc}.html"), Path(app.outdir, "index.html"))


def setup(app: Any) -> None:
    """Register what is above."""
    app.add_lexer("mermaid", TextLexer)
    app.connect("source-read", add_toctrees)
    app.connect("missing-reference", refer)
    app.connect("build-finished", finish)
