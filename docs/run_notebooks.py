"""Execute the tutorials' notebooks: ``python docs/run_notebooks.py``; needs nbclient and ipykernel."""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from pathlib import Path

import nbformat
from jupyter_client.manager import AsyncKernelManager
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError
from notebooks import write_notebooks
from run_pages import DATA, ROOT

TIMEOUT = 600  # s, of a cell: the first prediction of a kind compiles


def main() -> int:
    """Execute all notebooks; return the exit status."""
    binaries = os.path.dirname(sys.executable)
    os.environ["PATH"] = f"{binaries}{os.pathsep}{os.environ['PATH']}"
    os.environ["PYTHONPATH"] = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    status = 0
    with tempfile.TemporaryDirectory() as folder:
        for path in write_notebooks(Path(folder) / "notebooks"):
            place = Path(folder) / path.stem
            place.mkdir()
            for name in DATA:
                shutil.copytree(ROOT / name, place / name)
            notebook = nbformat.read(path, as_version=4)
            nbformat.validate(notebook)
            # sockets of an absolute path, as the kernel starts in another folder
            socket = Path(folder) / f"{path.stem}.socket"
            manager = AsyncKernelManager(kernel_name="python3", transport="ipc", ip=str(socket))
            resources = {"metadata": {"path": str(place)}}
            client = NotebookClient(notebook, km=manager, timeout=TIMEOUT, resources=resources)
            try:
                client.execute()
                print(f"{path.name}: well", flush=True)
            except CellExecutionError as error:
                print(f"{path.name}: FAILED\n{error}", flush=True)
                status = 1
    return status


if __name__ == "__main__":
    sys.exit(main())
