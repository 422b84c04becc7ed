"""Greedy sphere packing of a closed mesh, largest sphere first."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from .ascent import Space, climb_all, climb_around, climb_from_surface, place
from .sphere_grid import empty_grid, grown, insert_spheres
from .triangle_tree import build_triangle_tree

SHRINK = 0.6
BATCH = 0.97
DIRECTIONS = 24
FIRST_SEEDS = 400
import os
SHRINK = float(os.environ.get("SHRINK", SHRINK)); BATCH = float(os.environ.get("BATCH", BATCH))
DIRECTIONS = int(os.environ.get("DIRS", DIRECTIONS)); FIRST_SEEDS=int(os.environ.get("FIRST", FIRST_SEEDS))
LEVEL_SEEDS=float(os.environ.get("LEVEL", 0.3)); WIDTH=float(os.environ.get("WIDTH", 1)); MAXSEEDS=int(os.environ.get("MAXSEEDS",200000))
VERBOSE=int(os.environ.get("VERBOSE",0))

def fibonacci_sphere(n):
    k = np.arange(n) + 0.5
    z = 1.0 - 2.0 * k / n
    phi = np.pi * (1.0 + 5.0**0.5) * k
    s = np.sqrt(1.0 - z * z)
    return np.stack([s * np.cos(phi), s * np.sin(phi), z], axis=1)


def surface_points(corners, areas, n, seed):
    u = np.random.default_rng(seed).random((n, 3))
    cumulative = np.cumsum(areas)
    index = np.searchsorted(cumulative, u[:, 0] * cumulative[-1], side="right").clip(0, len(areas) - 1)
    a, b, c = corners[index].transpose(1, 0, 2)
    flip = u[:, 1] + u[:, 2] > 1.0
    v = np.where(flip, 1.0 - u[:, 1], u[:, 1])[:, None]
    w = np.where(flip, 1.0 - u[:, 2], u[:, 2])[:, None]
    cross = np.cross(b - a, c - a)
    return a + v * (b - a) + w * (c - a), -cross / np.linalg.norm(cross, axis=1, keepdims=True)


def pack(corners, count, threads=1, report=None):
    import time
    T = dict(surface=0., around=0., place=0., again=0., grid=0.)
    N = dict(around=0, again=0, surface=0)
    tree = build_triangle_tree(corners)
    lower, upper = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    areas = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    area = areas.sum()
    spheres = np.zeros((count, 4))
    placed = 0
    pool = ThreadPoolExecutor(threads)
    directions = fibonacci_sphere(DIRECTIONS)

    def parallel(kernel, *arrays, extra=()):
        n = len(arrays[0])
        cuts = np.linspace(0, n, min(n, 8 * threads if threads > 1 else 1) + 1).astype(int)
        jobs = [pool.submit(kernel, space, *[a[i:j] for a in arrays], *extra) for i, j in zip(cuts[:-1], cuts[1:])]
        return [job.result() for job in jobs]

    reach = np.min(upper - lower)
    space = Space(tree, empty_grid(lower, upper, 2*reach, reach, 1), spheres)
    points, inward = surface_points(corners, areas, FIRST_SEEDS, 0)
    t=time.perf_counter()
    values = np.concatenate(parallel(climb_from_surface, points, inward, extra=(reach,)))
    T["surface"]+=time.perf_counter()-t
    later_p, later_v = points, values
    level = 0
    while placed < count:
        level += 1
        t=time.perf_counter()
        R = later_v.max() * (1 + 1e-9)
        floor = SHRINK * R
        grid = empty_grid(lower, upper, WIDTH*R, R, max(1000,65*placed))
        start = 0
        while True:
            start = insert_spheres(grid, spheres, start, placed)
            if start == placed:
                break
            grid = grown(grid)
        space = Space(tree, grid, spheres)
        T["grid"]+=time.perf_counter()-t; t=time.perf_counter()
        if level > 1:
            n = int(min(LEVEL_SEEDS * area / R**2, MAXSEEDS))
            points, inward = surface_points(corners, areas, n, level)
            values = np.concatenate(parallel(climb_from_surface, points, inward, extra=(R,)))
            N["surface"]+=n
            later_p = np.concatenate([later_p, points]); later_v = np.concatenate([later_v, values])
        keep = later_v > 0
        later_p, later_v = later_p[keep], later_v[keep]
        T["surface"]+=time.perf_counter()-t
        if VERBOSE: print(f"level {level} R {R:.5f} placed {placed} pool {len(later_v)} cells {grid.heads.size} entries {grid.used[0]} fill {4/3*np.pi*(spheres[:placed,3]**3).sum():.5f}", {k:round(v,2) for k,v in T.items()}, N)
        high = later_v >= floor
        now_p, now_v = later_p[high], later_v[high]
        laters = [(later_p[~high], later_v[~high])]
        while len(now_v) and placed < count:
            top = now_v.max()
            take = now_v >= BATCH * top
            order = np.argsort(-now_v[take], kind="stable")
            p, v = now_p[take][order], now_v[take][order]
            now_p, now_v = now_p[~take], now_v[~take]
            before = placed
            done = 0
            t=time.perf_counter()
            while done < len(p) and placed < count:
                placed, n = place(space, p[done:], v[done:], placed, 1 - 1e-3)
                if placed >= count: break
                done += n
                if done < len(p):
                    space = space._replace(grid=grown(space.grid))
            T["place"]+=time.perf_counter()-t; t=time.perf_counter()
            again = p[v > 0]
            new = []
            if len(again):
                new += [(again, np.concatenate(parallel(climb_all, again)))]
                N["again"]+=len(again)
            T["again"]+=time.perf_counter()-t; t=time.perf_counter()
            if placed > before:
                new += parallel(climb_around, np.arange(before, placed), extra=(directions,))
                N["around"]+=DIRECTIONS*(placed-before)
            T["around"]+=time.perf_counter()-t
            for q, w in new:
                high = w >= floor
                now_p = np.concatenate([now_p, q[high]]); now_v = np.concatenate([now_v, w[high]])
                low = (w > 0) & ~high
                laters.append((q[low], w[low]))
        later_p = np.concatenate([q for q, _ in laters]); later_v = np.concatenate([w for _, w in laters])
    if VERBOSE: print({k:round(v,2) for k,v in T.items()}, N)
    order = np.argsort(-spheres[:placed, 3], kind="stable")
    return spheres[order]
