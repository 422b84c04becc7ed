"""Sphere packing: fill, time and memory."""

from __future__ import annotations

import multiprocessing
import os
import resource
import time
from concurrent.futures import ProcessPoolExecutor

import numpy as np

from unc_physics.shapes.packing import GreedyPacker, pack_solid
from unc_physics.shapes.recipes import RECIPES, recipe_solid

from ..comparison import CPU_TIME, WALL_TIME
from ..jobs import Job, Outcome, Row, Settings
from ..results import Results
from ..scenarios import LARGE, MODELS
from ..tables import number

TITLE = "Sphere packing"
SPHERES = (10, 100, 1000, 10_000, LARGE)
RUNS = 3
NO_MESHES = "none"
PACKER = "packer"
FILL, MEMORY, TRIANGLES, PLACED = "fill", "memory", "triangles", "placed"


def jobs(settings: Settings) -> list[Job]:
    """Return a job for every available mesh with every number of spheres, alone on the machine."""
    models = _models(settings)
    counts = SPHERES[:3] if settings.quick else SPHERES
    return [
        Job(
            "packing",
            settings.parameters(model=model, spheres=count, meshes=settings.meshes or NO_MESHES),
            cost=5.0 + 1e-3 * count,
            alone=True,
        )
        for count in counts
        for model in models
    ]


def missing(settings: Settings) -> list[str]:
    """Return missing meshes that are not in the repository."""
    absent = [model for model in MODELS if model not in _models(settings)]
    files = " and ".join(str(RECIPES[model].mesh) for model in absent)
    return [f"packing of {' and '.join(absent)}: --meshes DIR names no folder of {files}"] if absent else []


def run(job: Job) -> Outcome:
    """Pack in a separate process, to measure its memory."""
    p = job.parameters
    meshes = None if p["meshes"] == NO_MESHES else p["meshes"]
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as executor:
        return Outcome(executor.submit(measure, p["model"], p["spheres"], meshes).result())


def report(results: Results) -> str:
    """Return a table of all measurements of each packing."""
    rows = results.rows("packing")
    lines = []
    for selected in (rows.where(model=model, spheres=n) for n in rows.unique("spheres") for model in MODELS):
        if not selected:
            continue
        mean_of = {name: selected.where(quantity=name).mean() for name in selected.unique("quantity")}
        times = [number(selected.where(quantity=name).median()) for name in (WALL_TIME, CPU_TIME)]
        counts = [f"{mean_of[name]:.0f}" for name in (TRIANGLES, PLACED)]
        lines.append(
            [selected[0]["model"], *counts, f"{mean_of[FILL]:.2f}", *times, f"{mean_of[MEMORY]:.0f}"]
        )
    head = ["model", "triangles", "spheres", "fill [%]", "wall time [s]", "CPU time [s]", "memory [MiB]"]
    return results.table("packing", head, lines)


def _models(settings):
    """Return the models with a built-in mesh or one in the folder of meshes."""
    folder = settings.meshes
    return [
        model
        for model in MODELS
        if callable(RECIPES[model].mesh)
        or (folder is not None and os.path.isfile(os.path.join(folder, str(RECIPES[model].mesh))))
    ]


def measure(model: str, count: int, meshes: str | None) -> list[Row]:
    """Pack in this process."""
    solid, _ = recipe_solid(model, meshes)
    pack_solid(solid, 20)  # warm
    unit = solid.bounding_radius
    rows = []
    for k in range(1 if count >= LARGE else RUNS):
        started, cpu_started = time.perf_counter(), time.process_time()
        with GreedyPacker(solid.corners / unit, count, 2 if count >= LARGE else 1) as packer:
            spheres = packer.run(None, solid.volume / unit**3)
        rows.append(Row(PACKER, WALL_TIME, "s", time.perf_counter() - started, None, k))
        rows.append(Row(PACKER, CPU_TIME, "s", time.process_time() - cpu_started, None, k))
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    volume = 4.0 / 3.0 * np.pi * np.sum(spheres[:, 3] ** 3) * unit**3
    found = {
        MEMORY: ("MiB", memory),
        FILL: ("%", 100.0 * volume / solid.volume),
        TRIANGLES: ("1", len(solid.corners)),
        PLACED: ("1", len(spheres)),
    }
    return rows + [Row(PACKER, name, unit, float(value)) for name, (unit, value) in found.items()]
