"""Execute the notebooks in docs/notebooks and store their outputs in them.

Each docs/notebooks/*.ipynb runs in a kernel of its own, from its own folder.

What stands on stderr (progress, what is being compiled) and times of execution are left out,
figures get a palette: a notebook that says the same is the same file but for digits of figures.
With names of files as arguments only those.
"""

from __future__ import annotations

import base64
import io
import os
import sys
from pathlib import Path
from typing import Any

import nbformat
from nbclient import NotebookClient
from PIL import Image

from optimisation.files import replacing
from optimisation.report.report import few_colours

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "docs" / "notebooks"
TIMEOUT = 3600  # s for one cell: the first one of its kind compiles
# figures into the notebook, also where a shell's setting is another
INLINE = "module://matplotlib_inline.backend_inline"
VOLATILE = ("execution", "widgets", "language_info")


def executed(file: Path) -> Any:
    """Return a notebook with the outputs of the present code.

    Raises nbclient's CellExecutionError if a cell fails.
    """
    notebook = nbformat.read(file, as_version=4)
    client = NotebookClient(
        notebook,
        timeout=TIMEOUT,
        kernel_name="python3",
        resources={"metadata": {"path": str(file.parent)}},
    )
    client.execute(env=os.environ | {"MPLBACKEND": INLINE})
    return tidy(notebook)


def tidy(notebook: Any) -> Any:
    """Leave out what differs from run to run without saying anything, and make figures small."""
    for part in (notebook, *notebook.cells):
        for name in VOLATILE:
            part.metadata.pop(name, None)
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.outputs = merge_streams(cell.outputs)
            for output in cell.outputs:
                if "image/png" in output.get("data", {}):
                    output.data["image/png"] = small(output.data["image/png"])
    return notebook


def merge_streams(outputs: list[Any]) -> list[Any]:
    """Return the outputs of a notebook cell without stderr.

    Printed text that arrived in several consecutive parts is joined to one output.
    """
    merged: list[Any] = []
    for output in outputs:
        if output.get("name") == "stderr":
            continue
        if merged and output.output_type == merged[-1].output_type == "stream":
            merged[-1].text += output.text
        else:
            merged.append(output)
    return merged


def small(image: str) -> str:
    """Return a PNG, in base64, with a palette of 256 colours."""
    drawn = io.BytesIO()
    few_colours(Image.open(io.BytesIO(base64.b64decode(image)))).save(
        drawn, format="png", optimize=True
    )
    return base64.b64encode(drawn.getvalue()).decode()


def main(names: list[str]) -> int:
    """Execute and write."""
    for file in [Path(name).resolve() for name in names] or sorted(FOLDER.glob("*.ipynb")):
        print(f"{file.name} ...", file=sys.stderr, flush=True)
        notebook = executed(file)
        with replacing(file) as temporary:
            temporary.write_text(nbformat.writes(notebook) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
