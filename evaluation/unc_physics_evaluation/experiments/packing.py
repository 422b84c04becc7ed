"""Sphere packing: fill, time and memory beside their goals, checked by code that is not ours."""

from __future__ import annotations

import multiprocessing
import os
import resource
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from importlib.util import find_spec

import numpy as np

from unc_physics.geometry.library import load_model
from unc_physics.geometry.packing import GreedyPacker, pack_solid
from unc_physics.geometry.packing_file import solid_spheres_inertia
from unc_physics.geometry.recipes import RECIPES, recipe_solid

from ..comparison import CPU_TIME, WALL_TIME
from ..goals import Figure, goal_tables, goals_met_by
from ..jobs import Job, Outcome, Row, Settings
from ..results import Results
from ..scenarios import LARGE, MODELS
from ..tables import number, table

TITLE = "Sphere packing"
GOALS = {  # model: spheres: fill [%], time [s]
    "bunny": {1000: (80.0, 2.0), 10_000: (87.8, 8.0), LARGE: (92.3, 60.0)},
    "armadillo": {1000: (76.0, 3.5), 10_000: (85.0, 11.0), LARGE: (90.7, 60.0)},
    "pin": {1000: (85.5, 4.5), 10_000: (91.0, 13.0), LARGE: (94.2, 60.0)},
}
MEMORY_GOAL = 1024.0  # MiB, of a packing of `LARGE` spheres
COMPILE_GOAL = 30.0  # s
SPHERES = (10, 100, 1000, 10_000, LARGE)
RUNS = 3
NO_MESHES = "none"
PACKER, SPHERES_ALONE = "packer", "spheres_alone"
FILL, MEMORY, TRIANGLES, PLACED = "fill", "memory", "triangles", "placed"
OVERLAP, PROTRUSION, OUTSIDE, LATER = "overlap", "protrusion", "outside", "larger_later"
NAMES = {CPU_TIME: "CPU time", WALL_TIME: "wall time"}
COLD, WARM = "nothing compiled", "compiled"


def jobs(settings: Settings) -> list[Job]:
    """Every model whose mesh is there with every number of spheres, alone on the machine."""
    if find_spec("igl") is None:
        return []
    models = _models(settings)
    counts = SPHERES[:3] if settings.quick else SPHERES
    cases = [("pack", model, count) for count in counts for model in models]
    cases += [("inertia", model, 10_000) for model in MODELS]
    if not settings.quick:
        cases.append(("compiling", "pin", 10))
    return [
        Job(
            "packing",
            settings.parameters(
                section=section, model=model, spheres=count, meshes=settings.meshes or NO_MESHES
            ),
            cost=5.0 + 1e-3 * count,
            alone=True,
        )
        for section, model, count in cases
    ]


def missing(settings: Settings) -> list[str]:
    """Meshes that are no part of the repository, and libigl."""
    if find_spec("igl") is None:
        return ["packing: libigl, which checks it, is not installed; pip install libigl"]
    absent = [model for model in MODELS if model not in _models(settings)]
    files = " and ".join(str(RECIPES[model].mesh) for model in absent)
    return [f"packing of {' and '.join(absent)}: --meshes DIR names no folder of {files}"] if absent else []


def run(job: Job) -> Outcome:
    """One section for one model."""
    p = job.parameters
    meshes = None if p["meshes"] == NO_MESHES else p["meshes"]
    return Outcome(SECTIONS[p["section"]](p["model"], p["spheres"], meshes))


def report(results: Results) -> str:
    """Goals, then all that was measured of each packing."""
    rows = results.rows("packing").where(section="pack")
    lines = []
    for here in _packings(rows):
        of = {name: here.where(quantity=name).mean() for name in here.unique("quantity")}
        times = [number(here.where(quantity=name).median()) for name in (WALL_TIME, CPU_TIME)]
        counts = [f"{of[name]:.0f}" for name in (TRIANGLES, PLACED)]
        errors = [f"{of[name]:.0e}" for name in (OVERLAP, PROTRUSION)]
        lines.append(
            [here[0]["model"], *counts, f"{of[FILL]:.2f}", *times, f"{of[MEMORY]:.0f}", *errors]
            + [f"{of[OUTSIDE]:.0f}", f"{100.0 * of[LATER]:.2f} %"]
        )
    head = ["", "triangles", "spheres", "fill [%]", "wall time [s]", "CPU time [s]", "memory [MiB]"]
    head += ["overlap", "protrusion", "outside", "out of order"]
    return f"{goal_tables(_figures(results))}\n{table(head, lines)}"


def _models(settings):
    """Models whose mesh is made here, or is in the folder of meshes."""
    folder = settings.meshes
    return [
        model
        for model in MODELS
        if callable(RECIPES[model].mesh)
        or (folder is not None and os.path.isfile(os.path.join(folder, str(RECIPES[model].mesh))))
    ]


def _pack(model, spheres, meshes) -> list[Row]:
    """In a process of its own, whose memory nothing else has used."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as executor:
        return executor.submit(measure, model, spheres, meshes).result()


def measure(model: str, count: int, meshes: str | None) -> list[Row]:
    """Pack in this process and check the result."""
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
        **{name: ("1", value) for name, value in checks(solid.corners / unit, spheres).items()},
    }
    return rows + [Row(PACKER, name, unit, float(value)) for name, (unit, value) in found.items()]


def checks(corners, spheres):
    """Deepest overlap and protrusion, in bounding radii; spheres outside; share of spheres out of order."""
    import igl

    centers, radii = np.ascontiguousarray(spheres[:, :3]), spheres[:, 3]
    vertices = np.ascontiguousarray(corners.reshape(-1, 3))
    faces = np.arange(len(vertices)).reshape(-1, 3)
    distance = np.sqrt(igl.point_mesh_squared_distance(centers, vertices, faces)[0])
    winding = igl.fast_winding_number(vertices, faces, centers)
    smallest = np.minimum.accumulate(radii)[:-1]
    return {
        OVERLAP: float(deepest_overlap(centers, radii)),
        PROTRUSION: float(np.max(radii - distance)),
        OUTSIDE: int(np.sum(winding < 0.5)),
        LATER: float(np.mean(radii[1:] > 1.01 * smallest)) if len(radii) > 1 else 0.0,
    }


def deepest_overlap(centers, radii):
    """Largest r_i + r_j - d_ij; a sphere meets smaller ones within twice its radius."""
    from scipy.spatial import cKDTree

    order = np.argsort(-radii)
    centers, radii = centers[order], radii[order]
    tree = cKDTree(centers)
    deepest = -np.inf
    for i, near in enumerate(tree.query_ball_point(centers, 2.0 * radii)):
        near = np.array([j for j in near if j > i], dtype=int)
        if len(near):
            depth = radii[i] + radii[near] - np.linalg.norm(centers[near] - centers[i], axis=1)
            deepest = max(deepest, depth.max())
    return deepest


def _compiling(model, spheres, meshes) -> list[Row]:
    """CPU time of a process that packs a few spheres, with nothing compiled and with all."""
    code = (
        "import time\n"
        "from unc_physics.geometry.packing import pack_solid\n"
        "from unc_physics.geometry.recipes import recipe_solid\n"
        f"solid, _ = recipe_solid({model!r}, {meshes!r})\npack_solid(solid, {spheres})\n"
        "print(time.process_time())"
    )
    rows = []
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, "NUMBA_CACHE_DIR": cache}
        for state in (COLD, WARM):
            command = [sys.executable, "-c", code]
            done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
            rows.append(Row(state, CPU_TIME, "s", float(done.stdout)))
    return rows


def _inertia(model, spheres, meshes) -> list[Row]:
    """Largest relative error of a principal moment, if the first spheres made up the body."""
    packing = load_model(model)
    rows = []
    for count in (100, 1000, spheres):
        part = packing.prefix(count)
        moments = np.linalg.eigvalsh(solid_spheres_inertia(part.centers, part.radii)[1])
        error = np.max(np.abs(moments / np.linalg.eigvalsh(packing.inertia) - 1.0))
        rows.append(Row(SPHERES_ALONE, f"{SPHERES_ALONE}_{count}", "1", float(error)))
    return rows


SECTIONS = {"pack": _pack, "inertia": _inertia, "compiling": _compiling}


def _packings(rows):
    found = (rows.where(model=model, spheres=n) for n in rows.unique("spheres") for model in MODELS)
    return [here for here in found if here]


def _figures(results) -> dict[str, list[Figure]]:
    rows = results.rows("packing")
    of = {section: rows.where(section=section) for section in SECTIONS}
    goals = []
    for here in _packings(of["pack"]):
        model, spheres = here[0]["model"], here[0]["spheres"]
        if spheres not in GOALS[model]:
            continue
        case, (fill, seconds) = f"{model} {spheres}", GOALS[model][spheres]
        clock = WALL_TIME if spheres >= LARGE else CPU_TIME
        taken = here.where(quantity=clock).median()
        goals.append(Figure("fill", case, here.where(quantity=FILL).mean(), "%", fill))
        goals.append(Figure(NAMES[clock], case, taken, "s", seconds, at_most=True))
        if spheres >= LARGE:
            memory = here.where(quantity=MEMORY).mean()
            goals.append(Figure("memory", case, memory, "MiB", MEMORY_GOAL, at_most=True))
    if of["compiling"]:
        cold, warm = (of["compiling"].where(method=state).mean() for state in (COLD, WARM))
        note = f"a process takes {number(cold)} s with nothing compiled, then {number(warm)} s"
        goals.append(
            Figure(
                "compiling, CPU time", "10 spheres", cold - warm, "s", COMPILE_GOAL, at_most=True, note=note
            )
        )
    return {
        "What was to be reached": goals,
        "Error of a principal moment, if it were that of the spheres alone": [
            Figure(f"{row['quantity'].rpartition('_')[2]} spheres", row["model"], 100.0 * row["value"], "%")
            for row in of["inertia"]
        ],
    }


verdict = goals_met_by(_figures)
