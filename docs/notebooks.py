"""Write the tutorials as Jupyter notebooks: ``python docs/notebooks.py FOLDER``.

The page is the source: its commands, files and Python become cells, its text becomes markdown between them.
``run_pages.py`` runs the same cells.
"""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

from blocks import blocks

TUTORIALS = Path(__file__).resolve().parent / "tutorials"
MAGIC = {"bash": "%%bash\n", "file": "%%writefile {name}\n", "python": ""}
DOWNLOAD = re.compile(r"^.*\{download\}.*\n", re.MULTILINE)  # a link to the notebook itself


def notebook(page: str) -> dict:
    """The notebook of a page, in the format of nbformat 4.5."""
    cells, place = [], 0
    for block in blocks(page):
        cells += _markdown(page[place : block.start], len(cells))
        source = MAGIC[block.kind].format(name=block.name) + block.text
        outputs = []
        place = block.end
        if block.output is not None:
            shown = page[slice(*block.output)]
            outputs = [{"output_type": "stream", "name": "stdout", "text": _lines(shown)}]
        cells.append(
            {
                "cell_type": "code",
                "id": f"cell-{len(cells)}",
                "metadata": {},
                "execution_count": None,
                "source": _lines(source),
                "outputs": outputs,
            }
        )
    cells += _markdown(page[place:], len(cells))
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    return {"cells": cells, "metadata": {"kernelspec": kernel}, "nbformat": 4, "nbformat_minor": 5}


def _markdown(text: str, number: int) -> list[dict]:
    """One cell of text, or none where there is none."""
    text = DOWNLOAD.sub("", text).strip()
    if not text:
        return []
    return [{"cell_type": "markdown", "id": f"cell-{number}", "metadata": {}, "source": _lines(text)}]


def _lines(text: str) -> list[str]:
    """The lines of a cell, as notebooks store them."""
    return text.rstrip("\n").splitlines(keepends=True)


def write_notebooks(folder: Path) -> list[Path]:
    """Write a notebook for each tutorial; returns the files."""
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for page in sorted(TUTORIALS.glob("*.md")):
        path = folder / f"{page.stem}.ipynb"
        path.write_text(
            json.dumps(notebook(page.read_text(encoding="utf-8")), indent=1) + "\n", encoding="utf-8"
        )
        written.append(path)
    return written


if __name__ == "__main__":
    for path in write_notebooks(Path(sys.argv[1])):
        print(path)
