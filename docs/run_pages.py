"""Runs the commands and snippets of the pages, as a reader would: ``python docs/run_pages.py [PAGE ...]``.

Each page runs in a folder of its own, from its first block to its last. Of ``bash`` and ``python`` blocks
all are run but those that begin with ``# not run here``; a YAML block that begins with ``# file: NAME`` is
written there. The first block that fails ends it with its output.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGES = (
    "docs/tutorial.md",
    "docs/view.md",
    "docs/how_to/bin.md",
    "docs/how_to/push.md",
    "docs/how_to/import.md",
    "docs/actions.md",
    "docs/choosing.md",
    "docs/propagators.md",
    "README.md",
)
BLOCK = re.compile(r"^```(bash|python|yaml)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
SKIPPED, FILE = "# not run here", "# file: "


def main(arguments=None) -> int:
    """Run the pages; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("pages", nargs="*", default=PAGES, metavar="PAGE", help="by default those for users")
    for page in parser.parse_args(arguments).pages:
        if not run_page(page):
            return 1
    return 0


def run_page(page) -> bool:
    """Run the blocks of a page; whether all of them went well."""
    text = (ROOT / page).read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder:
        for name in ("examples", "models"):
            shutil.copytree(ROOT / name, Path(folder) / name)
        for kind, block in BLOCK.findall(text):
            line = text[: text.index(block)].count("\n") + 1
            if block.startswith(SKIPPED) or (kind == "yaml" and not block.startswith(FILE)):
                continue
            if kind == "yaml":
                (Path(folder) / block.split("\n")[0].removeprefix(FILE)).write_text(block)
                continue
            done = run_block(kind, block, folder)
            print(f"{page}:{line}: {'well' if done.returncode == 0 else 'FAILED'}", flush=True)
            if done.returncode:
                print(done.stdout + done.stderr)
                return False
    return True


def run_block(kind, block, folder):
    """Run one block in a folder, with this Python first on the path."""
    binaries = os.path.dirname(sys.executable)
    environment = os.environ | {
        "PATH": f"{binaries}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]),
        "XDG_CACHE_HOME": folder,
    }
    command = ["bash", "-euc", block] if kind == "bash" else [sys.executable, "-c", block]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


if __name__ == "__main__":
    sys.exit(main())
