"""The fenced blocks of a page: files, commands, Python, and the outputs that the page shows."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple

FENCE = re.compile(r"^```(\w*)\n(.*?)^```$\n?", re.MULTILINE | re.DOTALL)
FILE = "# file: "
RUN = "bash", "python"  # as opposed to `sh` and `py`


class Block(NamedTuple):
    """A part of a page that is written to a file or run.

    Attributes
    ----------
    kind : {'file', 'bash', 'python'}
    text : str
        The file's content, the commands or the code.
    name : str
        Of the file; empty for commands and code.
    start, end : int
        Characters of the page from the opening fence to behind the closing one, of the output where there is
        one.
    output : tuple of int or None
        Characters of the page that hold the output: the content of the next block, where that is ``text``.
    """

    kind: str
    text: str
    name: str
    start: int
    end: int
    output: tuple[int, int] | None


def blocks(page: str) -> Iterator[Block]:
    """Yield the blocks of a page that are written or run, in order."""
    fences = list(FENCE.finditer(page))
    for k, fence in enumerate(fences):
        kind, text = fence.groups()
        output, end = None, fence.end()
        if k + 1 < len(fences) and fences[k + 1][1] == "text":
            output, end = fences[k + 1].span(2), fences[k + 1].end()
        if text.startswith(FILE):
            name, _, text = text.removeprefix(FILE).partition("\n")
            yield Block("file", text, name, *fence.span(), None)
        elif kind in RUN:
            yield Block(kind, text, "", fence.start(), end, output)
