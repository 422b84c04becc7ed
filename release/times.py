"""Measure the time to a first prediction: ``python release/times.py WHAT ... [options]``.

WHAT is ``wheel`` (with kernels, in an empty environment), ``source`` (a checkout), ``demo`` (``make demo`` in
a new clone, with files that were downloaded before) or ``target`` (speed of a wheel's kernels beside kernels
compiled for this processor). The tables are in ``docs/results``. Rows of the same revision are replaced. All
together take ten minutes on an idle machine with two cores.
"""

from __future__ import annotations

import argparse
import csv
import json
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from check import FIRST, ROOT, clean_environment, install_wheel, measured

STARTS = ROOT / "docs" / "results" / "first_prediction.csv"
START_COLUMNS = "installation", "state", "revision", "wall [s]", "CPU [s]"
TARGETS = ROOT / "docs" / "results" / "shipped_target.csv"
TARGET_COLUMNS = "scene", "method", "native [ms]", "shipped [ms]", "ratio"
SCENES = "salt_box_on_table", "table", "two_bunnies"
RUNS = 5
SPEED = f"""
import json, sys, time
from unc_physics import load_scene, make_propagator, predict
times = {{}}
for file in sys.argv[1:]:
    scene, belief, horizon = load_scene(file)
    for name in ("monte_carlo", "sigma_points"):
        few = {{"samples": 100}} if name == "monte_carlo" else {{}}
        taken = []
        for _ in range({RUNS} + 1):
            started = time.process_time()
            predict(scene, belief, make_propagator(name, **few), horizon)
            taken.append(time.process_time() - started)
        times[f"{{file}} {{name}}"] = min(taken[1:])
print(json.dumps(times))
"""


def main():
    """Measure what is named, and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", nargs="+", choices=("wheel", "source", "demo", "target"))
    parser.add_argument("--wheel", type=Path, help="a wheel with kernels for this Python", default=Path())
    parser.add_argument("--revision", default="HEAD", help="of git, for source and demo (default: HEAD)")
    options = parser.parse_args()
    if options.wheel.suffix != ".whl" and {"wheel", "target"} & set(options.what):
        parser.error("--wheel is missing")
    with tempfile.TemporaryDirectory() as folder:
        for what in options.what:
            work = Path(folder) / what
            work.mkdir()
            if what == "target":
                write(TARGETS, TARGET_COLUMNS, list(compare_targets(options.wheel.resolve(), work)), 2)
                continue
            of_wheel = options.wheel.name.split("-")[1] if what == "wheel" else None
            revision = of_wheel or git("rev-parse", "--short", options.revision)
            steps = {"wheel": time_wheel, "source": time_source, "demo": time_demo}
            rows = [(what, state, revision, *times) for state, times in steps[what](options, work)]
            write(STARTS, START_COLUMNS, rows, 3)


def time_wheel(options, folder):
    """Yield the times of the first two processes that predict by an installed wheel."""
    python, env = install_wheel(options.wheel.resolve(), sys.executable, folder)
    scene = python.parents[1] / "share" / "unc_physics" / "examples" / "scenes" / "table.yaml"
    for state in ("cold", "warm"):
        yield state, measured([python, "-c", FIRST, scene], env, folder)


def time_source(options, folder):
    """Yield the times of the first two processes that predict by a checkout, in this environment."""
    clone(options.revision, folder / "checkout")
    env = clean_environment() | {"PYTHONPATH": str(folder / "checkout")}
    command = [sys.executable, "-c", FIRST, folder / "checkout" / "examples" / "scenes" / "table.yaml"]
    for state in ("cold", "warm"):
        yield state, measured(command, env, folder)


def time_demo(options, folder):
    """Yield the times of ``make demo`` in a new clone, and of a second one, without downloads."""
    checkout, downloads = folder / "checkout", folder / "downloads"
    clone(options.revision, checkout)
    requirements = ["-r", "requirements/run.txt", "-r", "requirements/ros.txt", "pip"]
    download = [sys.executable, "-m", "pip", "-q", "download", "-c", "requirements/constraints.txt"]
    subprocess.run([*download, "-d", downloads, *requirements], check=True, cwd=checkout)
    env = clean_environment() | {"PIP_NO_INDEX": "1", "PIP_FIND_LINKS": str(downloads)}
    for state in ("cold", "warm"):
        yield state, measured(["make", "demo", f"PYTHON={sys.executable}"], env, checkout)


def compare_targets(wheel, folder):
    """Yield a row for each of `SCENES` and method: CPU time by native and shipped kernels, and the ratio.

    The processes alternate. Of each process counts the fastest run, of the processes the median.
    """
    python, env = install_wheel(wheel, sys.executable, folder)
    examples = python.parents[1] / "share" / "unc_physics" / "examples" / "scenes"
    scenes = [examples / f"{name}.yaml" for name in SCENES]
    native = env | {"UNC_PHYSICS_COMPILER": "", "PYTHONPATH": str(ROOT)}
    found = {"native": [], "shipped": []}
    for _ in range(3):
        for name, its_env in (("native", native), ("shipped", env)):
            out = subprocess.check_output([python, "-c", SPEED, *scenes], env=its_env, cwd=folder)
            found[name].append(json.loads(out))
    for key in found["native"][0]:
        file, _, method = key.rpartition(" ")
        own, shipped = (1e3 * statistics.median(one[key] for one in found[name]) for name in found)
        yield Path(file).stem, method, f"{own:.2f}", f"{shipped:.2f}", f"{shipped / own:.2f}"


def clone(revision, target):
    """Make a clone of this repository, without ignored files."""
    subprocess.run(["git", "clone", "-q", ROOT, target], check=True)
    subprocess.run(["git", "checkout", "-q", "--detach", git("rev-parse", revision)], check=True, cwd=target)


def git(*arguments):
    """Return the output of a git command in this repository."""
    return subprocess.check_output(["git", *arguments], text=True, cwd=ROOT).strip()


def write(file, columns, rows, keys):
    """Write a table; new rows replace those with the same first columns."""
    texts = [[f"{cell:.1f}" if isinstance(cell, float) else cell for cell in row] for row in rows]
    kept = []
    if file.exists():
        with file.open(newline="") as opened:
            new = {tuple(row[:keys]) for row in texts}
            kept = [row for row in list(csv.reader(opened))[1:] if tuple(row[:keys]) not in new]
    with file.open("w", newline="") as opened:
        csv.writer(opened, lineterminator="\n").writerows([columns, *kept, *texts])
    for row in texts:
        print(*row, sep=", ", flush=True)


if __name__ == "__main__":
    main()
