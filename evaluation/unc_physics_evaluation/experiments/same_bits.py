"""Comparison of all methods by the explicit step with release 0.2, to the last bit."""

from __future__ import annotations

import hashlib
import io
import json
import os
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np

import unc_physics
from unc_physics.checks.errors import UncPhysicsError

from .. import served_predictions
from ..jobs import Job, Outcome, Row, Settings
from ..results import Results
from ..tables import table

TITLE = "Same bits"
ROOT = Path(unc_physics.__file__).resolve().parents[1]
BEFORE = "e60fe270"
_COST = 60.0  # s, on one thread
SAME = "same_bits_as_before"


def jobs(settings: Settings) -> list[Job]:
    """Return a job, alone on the machine, whose key depends on the sources."""
    if missing(settings):
        return []
    trees = {"before": BEFORE, "after": fingerprint(ROOT)}
    return [Job("same_bits", settings.parameters(**trees), _COST, alone=True)]


def missing(settings: Settings) -> list[str]:
    """Return the reference revision if the checkout does not contain it."""
    command = ["git", "-C", str(ROOT), "cat-file", "-e", f"{BEFORE}^{{commit}}"]
    try:
        known = subprocess.run(command, capture_output=True, check=False).returncode == 0
    except OSError:
        known = False
    return [] if known else [f"same_bits: {ROOT} is no git checkout that has the commit {BEFORE}"]


def run(job: Job) -> Outcome:
    """Compare every array that both trees predict.

    Each tree runs in its own process; both read the examples of the reference revision.
    """
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        old = _tree(job.parameters["before"])
        with _served(old, old) as before, _served(ROOT, old) as after:
            for scene, name in before.cases:
                if (scene, name) not in after.cases:
                    continue
                request = {"scene": scene, "propagator": name}
                found, expected = (
                    tree.arrays(Path(folder) / "arrays.npz", request) for tree in (after, before)
                )
                for array in expected:  # newer parts of a carry have no counterpart
                    same = array in found and _same(found[array], expected[array])
                    rows.append(Row(name, f"{SAME}, {scene}, {array}", "1", int(same)))
    return Outcome(rows)


def report(results: Results) -> str:
    """Return a table with a line for each prediction."""
    rows = _latest(results)
    lines = []
    for scene, name, arrays in _predictions(rows):
        different = [array for array, same in arrays.items() if not same]
        verdict = f"**different: {', '.join(different)}**" if different else "same bits"
        lines.append([scene, name.replace("_", " "), str(len(arrays)), verdict])
    return table(["scene", "propagator", "arrays", f"beside {rows[0]['before']}"], lines)


def verdict(results: Results) -> str:
    """Return whether all arrays are equal."""
    found = list(_predictions(_latest(results)))
    different = [f"{scene} by {name}" for scene, name, arrays in found if not all(arrays.values())]
    if different:
        return f"NOT THE SAME: {'; '.join(different)}"
    return f"all the same: {sum(len(arrays) for *_, arrays in found)} arrays of {len(found)} predictions"


def fingerprint(folder: Path) -> str:
    """Return a hash of the sources of a tree's package."""
    digest = hashlib.sha256()
    for path in sorted((folder / "unc_physics").rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _latest(results):
    """Return rows of the present tree; without any, all rows."""
    rows = results.rows("same_bits")
    return rows.where(after=fingerprint(ROOT)) or rows


def _predictions(rows) -> Iterator[tuple[str, str, Mapping[str, bool]]]:
    """Yield scene, propagator, and whether each array is equal."""
    found = {}
    for row in rows:
        if row["quantity"].startswith(SAME):
            _, scene, array = row["quantity"].split(", ", 2)
            found.setdefault((scene, row["method"]), {})[array] = bool(row["value"])
    for (scene, name), arrays in found.items():
        yield scene, name, arrays


class _Tree:
    """A process that serves one tree."""

    def __init__(self, process):
        self._process = process
        self.cases = [tuple(case) for case in json.loads(self._answer())]

    def arrays(self, file, request) -> dict[str, np.ndarray]:
        """Return all arrays of a prediction by name."""
        self.ask(**request, file=str(file))
        with np.load(file) as content:
            return dict(content)

    def ask(self, **request) -> str:
        """Return the answer to a request."""
        self._process.stdin.write(json.dumps(request) + "\n")
        self._process.stdin.flush()
        return self._answer()

    def _answer(self):
        line = self._process.stdout.readline()
        if not line:
            raise UncPhysicsError(f"a process that predicts ended with status {self._process.wait()}")
        return line


@contextmanager
def _served(package, examples) -> Iterator[_Tree]:
    # the trees share compiled kernels, whose files are named by what they depend on
    cache = ROOT / "unc_physics" / "__pycache__"
    process = subprocess.Popen(
        [sys.executable, served_predictions.__file__],
        cwd=examples,
        env=os.environ | {"PYTHONPATH": str(package), "NUMBA_CACHE_DIR": str(cache)},
        text=True,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    with process:
        yield _Tree(process)


def _tree(revision) -> Path:
    """Return the folder of a revision's files; its place is always the same, as numba caches by it."""
    place = ROOT / ".pytest_cache" / "same_bits" / revision
    if not place.exists():
        command = ["git", "-C", str(ROOT), "archive", revision]
        archive = subprocess.run(command, capture_output=True, check=True).stdout
        place.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=place.parent) as folder:
            with tarfile.open(fileobj=io.BytesIO(archive)) as files:
                files.extractall(Path(folder) / "tree", filter="data")
            (Path(folder) / "tree").rename(place)
    return place


def _same(found, expected):
    return found.shape == expected.shape and found.tobytes() == expected.tobytes()
