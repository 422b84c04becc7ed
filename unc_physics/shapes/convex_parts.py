"""Program that cuts a closed mesh into nearly convex parts with the library coacd.

Usage: ``python -m unc_physics.shapes.convex_parts FOLDER``. It reads ``mesh.npz`` there and writes
``parts.npz``. A process of its own can be stopped, and no mesh that crashes the library ends ours.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ..checks.errors import InvalidMeshError

#: Random numbers of the search begin here, so that the same mesh has the same parts.
_SEED = 0
#: Size of coacd's search for the next cut: a tenth of its time of the defaults, at about the same errors.
_PERIOD = 0.1  # s, between looks at whether the program is to be stopped
_SEARCH: dict[str, Any] = {"mcts_iterations": 20, "mcts_nodes": 10, "resolution": 1000}


def convex_parts(
    vertices: np.ndarray,
    faces: np.ndarray,
    threshold: float,
    most: int,
    go_on: Callable[[], bool] = lambda: True,
    threads: int | None = None,
) -> list[np.ndarray]:
    """Return the corners (k, 3) of nearly convex parts of a closed mesh [m].

    Parameters
    ----------
    vertices, faces : (n, 3), (m, 3) arrays
    threshold : float
        Concavity at which coacd stops to cut, of a mesh scaled to 2.
    most : int
        Number of parts, at most.
    go_on : callable, optional
        The program is stopped when this returns False.
    threads : int, optional
        Threads; the parts do not depend on it.

    Raises
    ------
    InvalidMeshError
        If coacd fails.
    TimeoutError
    """
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    if threads is not None:
        environment["OMP_NUM_THREADS"] = str(threads)
    with tempfile.TemporaryDirectory(prefix="unc_physics_parts_") as folder:
        np.savez(Path(folder) / "mesh.npz", vertices=vertices, faces=faces, threshold=threshold, most=most)
        with (Path(folder) / "errors").open("w+b") as errors:
            with subprocess.Popen(
                [sys.executable, "-m", __name__, folder],
                env=environment,
                stdout=subprocess.DEVNULL,
                stderr=errors,
            ) as process:
                try:
                    while _is_running(process):
                        if not go_on():
                            raise TimeoutError("coacd was stopped")
                finally:
                    process.kill()
            if process.returncode != 0:
                errors.seek(0)
                lines = errors.read().decode(errors="replace").strip().splitlines()
                reason = lines[-1] if lines else process.returncode
                raise InvalidMeshError(f"cannot be cut into convex parts: coacd ends with {reason}")
        with np.load(Path(folder) / "parts.npz") as found:
            return np.split(found["points"], np.cumsum(found["sizes"])[:-1])


def _is_running(process):
    """Wait a moment for a process, and return whether it goes on."""
    try:
        process.wait(_PERIOD)
    except subprocess.TimeoutExpired:
        return True
    return False


def main(folder: Path) -> None:
    """Cut the mesh of a folder."""
    import coacd  # pyright: ignore[reportMissingImports]  # optional

    coacd.set_log_level("error")
    with np.load(folder / "mesh.npz") as given:
        parts = coacd.run_coacd(
            coacd.Mesh(given["vertices"], given["faces"]),
            threshold=float(given["threshold"]),
            max_convex_hull=int(given["most"]),
            seed=_SEED,
            **_SEARCH,
        )
    points = [np.asarray(vertices, float) for vertices, _ in parts]
    np.savez(folder / "parts.npz", points=np.concatenate(points), sizes=[len(some) for some in points])


if __name__ == "__main__":
    main(Path(sys.argv[1]))
