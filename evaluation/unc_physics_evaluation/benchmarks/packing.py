"""Sphere packing: fill, time and memory beside the goals, and the packings checked by code that is not ours.

    python -m unc_physics_evaluation.benchmarks.packing --meshes DIR              up to 10 000 spheres, about
    two minutes python -m unc_physics_evaluation.benchmarks.packing --meshes DIR --large      100 000 as well
    python -m unc_physics_evaluation.benchmarks.packing                           the pin alone, which needs
    no mesh file

DIR holds bunny00.off and armadillo.off of CGAL's data (Debian package libcgal-demo). Times are those of
packing with warm kernels, without reading the mesh. Up to 10 000 spheres it is CPU time of one thread, the
median of three runs; for 100 000 it is wall time of two threads, and one run. Overlap is checked with SciPy's
k-d tree, protrusion with libigl's exact distances, and that the centres are inside with libigl's winding
numbers.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time

import numpy as np

GOALS = {  # model: spheres: fill [%], time [s]
    "bunny": {1000: (80.0, 2.0), 10_000: (87.8, 8.0), 100_000: (92.3, 60.0)},
    "armadillo": {1000: (76.0, 3.5), 10_000: (85.0, 11.0), 100_000: (90.7, 60.0)},
    "pin": {1000: (85.5, 4.5), 10_000: (91.0, 13.0), 100_000: (94.2, 60.0)},
}
MEMORY_GOAL = 1024  # MiB
COMPILE_GOAL = 30.0  # s
LARGE = 100_000
RUNS = 3


def measure(name, count, meshes):
    """Pack in this process and check the result; returns what was measured."""
    from unc_physics.geometry.packing import GreedyPacker, pack_solid
    from unc_physics.geometry.recipes import recipe_solid

    solid, _ = recipe_solid(name, meshes)
    pack_solid(solid, 20)  # warm
    large = count >= LARGE
    clock = time.perf_counter if large else time.process_time
    unit = solid.bounding_radius
    times, cpu_times = [], []
    for _ in range(1 if large else RUNS):
        start, cpu_start = clock(), time.process_time()
        with GreedyPacker(solid.corners / unit, count, 2 if large else 1) as packer:
            spheres = packer.run(None, solid.volume / unit**3)
        times.append(clock() - start)
        cpu_times.append(time.process_time() - cpu_start)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    volume = 4.0 / 3.0 * np.pi * np.sum(spheres[:, 3] ** 3) * unit**3
    return {
        "triangles": len(solid.corners),
        "placed": len(spheres),
        "fill": 100.0 * volume / solid.volume,
        "time": float(np.median(times)),
        "cpu_time": float(np.median(cpu_times)),
        "memory": memory,
        **checks(solid.corners / unit, spheres),
    }


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
        "overlap": float(deepest_overlap(centers, radii)),
        "protrusion": float(np.max(radii - distance)),
        "outside": int(np.sum(winding < 0.5)),
        "larger_later": float(np.mean(radii[1:] > 1.01 * smallest)) if len(radii) > 1 else 0.0,
    }


def deepest_overlap(centers, radii):
    """Largest r_i + r_j - d_ij; pairs are sought by size, as a sphere meets smaller ones within twice its
    radius.
    """
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


def time_of_compiling(name, meshes):
    """CPU time of a process that packs 10 spheres, with an empty cache of compiled code, and with a full one
    [s].
    """
    code = (
        "import time\n"
        "from unc_physics.geometry.packing import pack_solid\n"
        "from unc_physics.geometry.recipes import recipe_solid\n"
        f"solid, _ = recipe_solid({name!r}, {meshes!r})\npack_solid(solid, 10)\n"
        "print(time.process_time())"
    )
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, "NUMBA_CACHE_DIR": cache}
        runs = [
            subprocess.run(
                [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
            )
            for _ in range(2)
        ]
    return [float(run.stdout) for run in runs]


def distance_ratio(name, meshes):
    """How many times longer libigl takes than our tree for the distance to the mesh, from near its medial
    axis.
    """
    import igl
    from numba import njit

    from unc_physics.geometry.recipes import recipe_solid
    from unc_physics.geometry.triangle_tree import build_triangle_tree, nearest_on_mesh
    from unc_physics_evaluation.timing import paired, ratio

    @njit
    def distances(tree, points, bounds):
        out = np.empty(len(points))
        for i in range(len(points)):
            out[i] = nearest_on_mesh(tree, points[i, 0], points[i, 1], points[i, 2], bounds[i])[0]
        return out

    solid, _ = recipe_solid(name, meshes)
    tree = build_triangle_tree(solid.corners)
    vertices = np.ascontiguousarray(solid.corners.reshape(-1, 3))
    faces = np.arange(len(vertices)).reshape(-1, 3)
    low, high = solid.bounds
    points = np.random.default_rng(0).uniform(low, high, (3000, 3))
    exact = np.sqrt(igl.point_mesh_squared_distance(points, vertices, faces)[0])
    assert (
        np.abs(distances(tree, points, np.full(len(points), np.inf)) - exact).max()
        < 1e-12 * solid.bounding_radius
    )
    near = np.full(
        len(points), 0.02 * solid.bounding_radius
    )  # the packer knows such a bound from the spheres
    far = np.full(len(points), np.inf)
    times = paired(
        {
            "libigl": lambda _: igl.point_mesh_squared_distance(points, vertices, faces),
            "tree": lambda _: distances(tree, points, far),
            "bounded tree": lambda _: distances(tree, points, near),
        },
        5,
    )
    return {
        kind: (1e6 * np.median(times[kind]) / len(points), ratio(times, "libigl", kind)) for kind in times
    }


def inertia_of_spheres_alone(name, count):
    """Largest relative error of a principal moment, if the first spheres made up the body."""
    from unc_physics.geometry.library import load_model
    from unc_physics.geometry.packing_file import solid_spheres_inertia

    packing = load_model(name)
    part = packing.prefix(count)
    moments = np.linalg.eigvalsh(solid_spheres_inertia(part.centers, part.radii)[1])
    return float(np.max(np.abs(moments / np.linalg.eigvalsh(packing.inertia) - 1.0)))


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--meshes", metavar="DIR", help="folder with bunny00.off and armadillo.off")
    parser.add_argument("--large", action="store_true", help="100 000 spheres as well")
    parser.add_argument("--measure", nargs=2, metavar=("MODEL", "N"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.measure:
        print(json.dumps(measure(options.measure[0], int(options.measure[1]), options.meshes)))
        return
    models = list(GOALS) if options.meshes else ["pin"]
    print(
        "| model | triangles | spheres | fill % (goal) | time s (goal) | CPU time s | memory MiB | overlap |"
        " protrusion | outside | out of order |\n|---|---|---|---|---|---|---|---|---|---|---|"
    )
    for count in (10, 100, 1000, 10_000, *([LARGE] if options.large else [])):
        for name in models:
            command = [
                sys.executable,
                "-m",
                "unc_physics_evaluation.benchmarks.packing",
                "--measure",
                name,
                str(count),
            ]
            command += ["--meshes", options.meshes] if options.meshes else []
            got = json.loads(subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout)
            fill, seconds = (
                (f" ({goal:g})" for goal in GOALS[name][count]) if count in GOALS[name] else ("", "")
            )
            memory = f"{got['memory']:.0f}" + (f" ({MEMORY_GOAL})" if count >= LARGE else "")
            print(
                f"| {name} | {got['triangles']} | {got['placed']} | {got['fill']:.2f}{fill} |"
                f" {got['time']:.1f}{seconds} | {got['cpu_time']:.1f} | {memory} | {got['overlap']:.0e} |"
                f" {got['protrusion']:.0e} | {got['outside']} | {100.0 * got['larger_later']:.2f} % |",
                flush=True,
            )
    print(
        "\nOverlap and protrusion are in bounding radii; out of order is the share of spheres more than 1 %"
        " larger than the smallest before them."
    )
    print("\nError of the principal moments, if they were those of the spheres alone:")
    for name in GOALS:
        errors = ", ".join(
            f"{100.0 * inertia_of_spheres_alone(name, k):.0f} % with {k}" for k in (100, 1000, 10_000)
        )
        print(f"- {name}: {errors}")
    cold, warm = time_of_compiling("pin", None)
    print(
        f"\nCompiling takes {cold - warm:.1f} s of CPU time (goal {COMPILE_GOAL:.0f} s): a fresh process"
        f" packs 10 spheres in {cold:.1f} s with nothing compiled yet, in {warm:.1f} s with the compiled code"
        " in the cache."
    )
    print(f"\nDistance from a random point to the mesh of the {models[0]}, one query, CPU time:")
    for kind, (microseconds, faster) in distance_ratio(models[0], options.meshes).items():
        print(
            f"- {kind}: {microseconds:.2f} us"
            + (f", {faster:.0f} times less than libigl" if kind != "libigl" else "")
        )


if __name__ == "__main__":
    main()
