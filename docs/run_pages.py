"""Run the commands and snippets of the pages, as a reader would: ``python docs/run_pages.py [PAGE ...]``.

Each page runs in a folder of its own, from its first block to its last. Python blocks of a page share their
names, as the cells of a notebook do. Blocks of ``sh`` and ``py`` are not run. A block that
begins with ``# file: NAME`` is written to that file. A ``text`` block after a command or snippet is its
output: words must agree, and numbers to 0.03 or 25 %, since processors round differently. ``--update`` writes
the outputs into the pages instead. The first block that fails ends its page.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import traceback
from pathlib import Path

from blocks import blocks

ROOT = Path(__file__).resolve().parents[1]
PAGES = (
    "README.md",
    "docs/tutorials/*.md",
    "docs/how-to/*.md",
    "docs/explanation/shapes.md",
    "docs/explanation/what_to_believe.md",
)
DATA = "examples", "models"
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")
DURATION = re.compile(r"[\d.]+ m?s\)|[\d.]+ s of computing")  # differs from run to run
ABSOLUTE, RELATIVE = 0.03, 0.25


def main(arguments=None) -> int:
    """Run the pages; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("pages", nargs="*", metavar="PAGE", help="by default those for users")
    parser.add_argument("--update", action="store_true", help="write outputs into the pages")
    parser.add_argument("--in-this-folder", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args(arguments)
    pages = [Path(page).resolve() for page in given.pages]
    pages = pages or [path for pattern in PAGES for path in sorted(ROOT.glob(pattern))]
    if given.in_this_folder:
        return 0 if run_page(pages[0], given.update) else 1
    failed = [page for page in pages if not run_apart(page, given.update)]
    return 1 if failed else 0


def run_apart(page: Path, update: bool) -> bool:
    """Run a page in a process and a folder of its own; whether all of it went well."""
    with tempfile.TemporaryDirectory() as folder:
        for name in DATA:
            shutil.copytree(ROOT / name, Path(folder) / name)
        environment = os.environ | {
            "PATH": f"{os.path.dirname(sys.executable)}{os.pathsep}{os.environ['PATH']}",
            "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]),
            "XDG_CACHE_HOME": folder,
        }
        command = [sys.executable, __file__, "--in-this-folder", *["--update"] * update, str(page)]
        child = subprocess.Popen(command, cwd=folder, env=environment, start_new_session=True)
        try:
            return child.wait() == 0
        finally:
            with contextlib.suppress(ProcessLookupError):  # nodes that a page has started and not ended
                os.killpg(child.pid, signal.SIGKILL)


def run_page(page: Path, update: bool) -> bool:
    """Run a page in the current folder."""
    text = page.read_text(encoding="utf-8")
    sys.path.insert(0, "")
    names = {"__name__": "__main__"}
    outputs = {}
    for block in blocks(text):
        if block.kind == "file":
            Path(block.name).write_text(block.text, encoding="utf-8")
            continue
        well, output, errors = run_bash(block.text) if block.kind == "bash" else run_python(block.text, names)
        reason = "" if well else f"{output}{errors}"
        if well and block.output is not None:
            shown = text[slice(*block.output)]
            if update:
                outputs[block.output] = output
            elif not agree(shown, output):
                reason = f"shown:\n{shown}printed:\n{output}"
        place = f"{page.relative_to(ROOT)}:{text.count(chr(10), 0, block.start) + 1}"
        print(f"{place}: {'FAILED' if reason else 'well'}", flush=True)
        if reason:
            print(reason, flush=True)
            return False
    for (start, end), output in sorted(outputs.items(), reverse=True):
        text = text[:start] + output + text[end:]
    if outputs:
        page.write_text(text, encoding="utf-8")
    return True


def run_bash(commands: str) -> tuple[bool, str, str]:
    """Whether commands went well, their output, and their errors."""
    done = subprocess.run(["bash", "-euc", commands], capture_output=True, text=True, check=False)
    return done.returncode == 0, done.stdout, done.stderr


def run_python(code: str, names: dict) -> tuple[bool, str, str]:
    """Whether code went well among names, its output, and its traceback."""
    output = io.StringIO()
    try:
        with contextlib.redirect_stdout(output):
            exec(compile(code, "snippet", "exec"), names)  # noqa: S102 - code of our own pages
    except (Exception, SystemExit):  # noqa: BLE001 - a snippet may fail in any way
        return False, output.getvalue(), traceback.format_exc()
    return True, output.getvalue(), ""


def agree(shown: str, printed: str) -> bool:
    """Whether an output that a page shows is what was printed, but for round-off and durations."""
    shown, printed = (DURATION.sub("s)", text) for text in (shown, printed))
    if NUMBER.sub("#", shown).split() != NUMBER.sub("#", printed).split():
        return False
    pairs = zip(NUMBER.findall(shown), NUMBER.findall(printed), strict=True)
    return all(abs(float(a) - float(b)) <= max(ABSOLUTE, RELATIVE * abs(float(b))) for a, b in pairs)


if __name__ == "__main__":
    sys.exit(main())
