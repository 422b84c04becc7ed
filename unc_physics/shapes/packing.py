"""Sphere packing of a solid: the spheres that give it its extent, then greedily the largest (in the spirit of
ProtoSphere, Weller and Zachmann 2010).

The first spheres are those of ``supports``. The centre of the largest free ball is a local maximum of the
free distance. Candidates for it are found by climbing (see ``ascent``) from points of the surface and from
the gaps around placed spheres. They are placed in levels of shrinking radius, so that a grid as fine as the
level's radius answers which sphere is nearest; within a level in batches of about equal radius, between which
new candidates are climbed to in parallel. A candidate whose ball is no longer free is climbed from again.
Radii are the free distance itself, so overlap and protrusion are round-off.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np

from ..checks.errors import InvalidMeshError, InvalidOptionError, InvalidRequestError
from ..checks.memory import require_memory
from ..checks.validation import instance
from .ascent import Space, climb_all, place, starts_around, starts_at_surface
from .distance import even_directions
from .mesh_pieces import simple_pieces
from .packing_file import ROUND_OFF, SpherePacking, spheres_reach
from .quality import extent_losses, prefix_lengths
from .solid_mesh import SolidMesh
from .sphere_grid import empty_grid, grown, insert_spheres
from .supports import SupportSpheres, support_spheres
from .surface_gap import surface_gap
from .triangle_tree import build_triangle_tree, nearest_on_mesh

LEVEL = 0.7  # a level's smallest radius, of its largest
BATCH = 0.97  # a batch's smallest radius, of its largest
FIRST_STARTS = 128  # on the surface, while nothing is placed yet
STARTS_PER_AREA = 0.3  # on the surface in each level, per squared radius
MIN_STARTS, MAX_STARTS = 32, 200_000  # on the surface in each level, ...
STARTS_PER_SPHERE = 10  # ... but no more than these for each sphere asked for
MANY_DIRECTIONS, FEW_DIRECTIONS = 32, 12  # around a sphere; many while there are few spheres
FEW_SPHERES = 500
CELLS, CELLS_PER_SPHERE = 1_000_000, 4_000  # of the grid, at most: 240 MB for 60 000 spheres
MAX_LEVELS = 100
SMALLEST = 1e-7  # of the body's size: gaps below are given up
_BYTES_PER_SPHERE = 1_000  # of those asked for, with the candidates for their places
SUPPORTS = 0.5  # of the spheres asked for, at most
ROUND = 0.01  # of the size: extent that a round body's largest ball may lack
TIE = 0.995  # spheres are in order of radius up to this ratio


def pack_solid(
    solid: SolidMesh,
    count: int,
    *,
    largest_first: bool = False,
    supports: SupportSpheres | None = None,
    mass: float | None = None,
    threads: int | None = None,
    progress: Callable[[int, float], None] | None = None,
    **about: Any,
) -> SpherePacking:
    """Pack a solid with disjoint spheres: those that give it its extent and flat faces, then the largest.

    Parameters
    ----------
    solid : SolidMesh
        The body.
    count : int
        Number of spheres.
    largest_first : bool
        Whether all spheres are in order of size. Few spheres then fill the solid best, but edges and rims
        are missing.
    supports : SupportSpheres, optional
        The first spheres, about the centre of mass [m]; by default they are computed from the mesh.
    mass : float, optional
        Default mass for the model file [kg].
    threads : int, optional
        Threads to use; by default one per processor. The result does not depend on it.
    progress : callable, optional
        Called now and then with the number of spheres placed and the part of the volume filled.
    **about
        ``source``, ``licence``, ``pieces``, ``pieces_kind`` and ``pieces_error`` for the model file. Without
        pieces, a solid that is a simple shape or convex gets them (`simple_pieces`); others have none but
        their spheres.

    Returns
    -------
    SpherePacking
        With fewer than ``count`` spheres if no gap was left for a ball of 1e-7 of the body's size. A mesh of
        a ball, which its ``pieces_kind`` says, has one sphere.

    Raises
    ------
    InvalidOptionError
        If ``count`` is not a positive integer.
    InvalidRequestError
        If ``solid`` is no `SolidMesh`, as the pair that `load_solid` returns.
    InvalidMeshError
        If the surface has no inside that holds the spheres, as of a mesh with large holes.
    LimitExceededError
        If there is not memory enough.
    """
    if isinstance(solid, tuple):
        raise InvalidRequestError(
            "must be a SolidMesh, not the pair of a solid and its repairs that load_solid returns: write"
            " solid, repairs = load_solid(file), then pack_solid(solid, count)",
            field="solid",
        )
    instance(solid, SolidMesh, "solid")
    if isinstance(count, bool) or not isinstance(count, (int, np.integer)) or count < 1:
        raise InvalidOptionError("must be a positive integer", field="number of spheres", value=count)
    if "pieces" not in about and (simple := simple_pieces(solid)) is not None:
        about |= {"pieces": simple[0], "pieces_kind": simple[1]}
    require_memory(_BYTES_PER_SPHERE * count, f"packing {count} spheres", "number of spheres", count)
    # A power of two near the size: scaling by it rounds nothing.
    unit = 2.0 ** np.floor(np.log2(solid.bounding_radius))
    corners = solid.corners / unit
    if about.get("pieces_kind") == "sphere":
        center = about["pieces"][0].points[0] / unit
        distance, *_ = nearest_on_mesh(build_triangle_tree(corners), *center, np.inf)
        spheres = np.array([[*center, distance]]) * unit
    else:
        with GreedyPacker(corners, count, threads or os.cpu_count() or 1) as packer:
            if supports is not None:
                packer.put(supports.scaled(1.0 / unit))
            elif not (largest_first or packer.is_round()):
                packer.put(support_spheres(packer.corners, packer.space.tree, int(SUPPORTS * count)))
            spheres = packer.run(progress, solid.volume / unit**3) * unit
    centers, radii = spheres[:, :3], spheres[:, 3]
    reach = spheres_reach(centers, radii) if len(radii) else 0.0
    if len(radii) == 0 or reach > solid.bounding_radius * (1.0 + ROUND_OFF):
        raise InvalidMeshError(
            "has no inside that holds spheres, though each of its edges has two triangles; where a hole was"
            " filled, close it in a mesh editor",
            field=f"mesh {solid.name}",
        )
    lengths = prefix_lengths(len(radii))
    return SpherePacking(
        name=solid.name,
        centers=centers,
        radii=radii,
        inertia=solid.inertia,
        volume=solid.volume,
        origin=solid.origin,
        bounding_radius=solid.bounding_radius,
        mesh_sha256=solid.sha256,
        mass=mass,
        bounds=solid.bounds,
        surface_gap=surface_gap(solid.corners, spheres),
        measured_spheres=lengths,
        extent_losses=extent_losses(solid.corners, spheres, lengths),
        **about,
    )


class GreedyPacker:
    """The packing of one body under way; lengths are of the order of 1."""

    def __init__(self, corners, count, threads):
        self.corners = np.ascontiguousarray(corners)
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        double_areas = np.linalg.norm(cross, axis=1)
        self.inward = -cross / np.where(double_areas > 0.0, double_areas, 1.0)[:, None]
        self.cumulative_area = 0.5 * np.cumsum(double_areas)
        self.lower, self.upper = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
        self.size = float(np.max(self.upper - self.lower))
        self.placed = self.put_first = 0
        self.supports: SupportSpheres | None = None
        self.threads = threads
        self.pool = ThreadPoolExecutor(threads)
        reach = float(np.min(self.upper - self.lower))  # no ball inside has a larger radius than half of it
        grid = empty_grid(self.lower, self.upper, self.size, reach, 1)
        self.space = Space(build_triangle_tree(self.corners), grid, np.zeros((count, 4)))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.pool.shutdown(cancel_futures=True)

    def put(self, supports: SupportSpheres):
        """Place the spheres of supports before all others."""
        self.supports = supports
        self.placed = self.put_first = len(supports.spheres)
        self.space.spheres[: self.placed] = supports.spheres

    def is_round(self):
        """Return whether the largest ball inside has the body's extent, so that it needs no supports."""
        slack = ROUND * self.size
        if np.min(self.upper - self.lower) < self.size - 2.0 * slack:
            return False
        with GreedyPacker(self.corners, 1, self.threads) as packer:
            ball = packer.run(None, 1.0)
        if len(ball) == 0:
            return False
        return np.linalg.norm(self.corners - ball[0, :3], axis=2).max() - ball[0, 3] < slack

    def run(self, progress, volume):
        """Place the spheres and return them (n, 4), in nested order."""
        spheres = self.space.spheres
        bound = self.space.grid.reach  # no free distance exceeds it
        candidates = np.empty((0, 4))
        for level in range(MAX_LEVELS):
            self.refine_grid(bound)
            more = self.climb(self.surface_starts(self.number_of_starts(level, bound), level, bound))
            candidates = np.concatenate([candidates, more])
            if level == 0:
                candidates = np.concatenate([candidates, self.climb(self.starts_around(0))])
            largest = candidates[:, 3].max(initial=0.0)
            if largest < SMALLEST * self.size:
                break
            if largest < LEVEL * bound:  # look again at the scale of what there is
                bound = largest * (1.0 + 1e-9)
                continue
            large = candidates[:, 3] >= LEVEL * bound
            small = [candidates[~large]]
            candidates = candidates[large]
            while len(candidates) and self.placed < len(spheres):
                found, candidates = self.place_batch(candidates)
                large = found[:, 3] >= LEVEL * bound
                small.append(found[~large])
                candidates = np.concatenate([candidates, found[large]])
                if progress:
                    progress(
                        self.placed,
                        float(4.0 / 3.0 * np.pi * np.sum(spheres[: self.placed, 3] ** 3)) / volume,
                    )
            if self.placed == len(spheres):
                break
            candidates = np.concatenate(small)
            bound *= LEVEL
        rest = spheres[self.put_first : self.placed]
        if self.supports is not None:
            rest = self.supports.receded(rest)
        rest = nested_order(rest, self.lower, self.size)
        return np.concatenate([spheres[: self.put_first], rest])

    def number_of_starts(self, level, radius):
        """Return the number of points of the surface from which a level starts to climb."""
        if level == 0:
            return FIRST_STARTS
        wanted = STARTS_PER_AREA * self.cumulative_area[-1] / radius**2
        return int(max(MIN_STARTS, min(wanted, MAX_STARTS, STARTS_PER_SPHERE * len(self.space.spheres))))

    def place_batch(self, candidates):
        """Place the largest candidates (m, 4).

        Returns new candidates (k, 4) and the old ones that were not in the batch. The new ones are found by
        climbing from candidates of the batch that are no longer free, and from around the new spheres.
        """
        batch = candidates[:, 3] >= BATCH * candidates[:, 3].max()
        rest, batch = candidates[~batch], candidates[batch]
        batch = batch[np.argsort(-batch[:, 3], kind="stable")]
        points, values = np.ascontiguousarray(batch[:, :3]), np.ascontiguousarray(batch[:, 3])
        before, done = self.placed, 0
        while True:
            self.placed, more = place(self.space, points[done:], values[done:], self.placed)
            done += more
            if done == len(points) or self.placed == len(self.space.spheres):
                break
            self.space = self.space._replace(grid=grown(self.space.grid))
        around = self.starts_around(before)
        return self.climb(np.concatenate([points[:done][values[:done] > 0.0], around])), rest

    def starts_around(self, first):
        """Return points (m, 3) in the gaps around the spheres from number ``first`` on."""
        directions = even_directions(MANY_DIRECTIONS if self.placed < FEW_SPHERES else FEW_DIRECTIONS)
        return self.parallel(starts_around, np.arange(first, self.placed), common=(directions,))

    def refine_grid(self, radius):
        """Make the grid of a level with cells as wide as its largest radius, the bound of free distances."""
        width, most = radius, max(CELLS, CELLS_PER_SPHERE * len(self.space.spheres))
        while np.prod(np.ceil((self.upper - self.lower) / width)) > most:
            width *= 1.05
        self.space = self.space._replace(
            grid=None
        )  # makes room: two large grids at once would double the memory
        grid = empty_grid(self.lower, self.upper, width, radius, max(1000, 100 * self.placed))
        inserted = 0
        while True:
            inserted = insert_spheres(grid, self.space.spheres, inserted, self.placed)
            if inserted == self.placed:
                break
            grid = grown(grid)
        self.space = self.space._replace(grid=grid)

    def surface_starts(self, count, seed, radius):
        """Return centres (m, 3) of touching balls at random points of the surface, evenly by area."""
        choice, v, w = np.random.default_rng(seed).random((3, count))
        last = len(self.cumulative_area) - 1
        index = np.searchsorted(self.cumulative_area, choice * self.cumulative_area[-1], side="right").clip(
            0, last
        )
        outside = v + w > 1.0
        v, w = np.where(outside, 1.0 - v, v)[:, None], np.where(outside, 1.0 - w, w)[:, None]
        a, b, c = self.corners[index].transpose(1, 0, 2)
        points = a + v * (b - a) + w * (c - a)
        return self.parallel(starts_at_surface, points, self.inward[index], common=(radius,))

    def climb(self, points):
        """Return candidates (m, 4), position and free distance, by climbing from points."""
        values = self.parallel(climb_all, points)
        return np.column_stack([points, values])[values > 0.0]

    def parallel(self, kernel, *arrays, common=()):
        """Run a kernel over slices of arrays in the threads, and join the results in order."""
        count = len(arrays[0])
        pieces = min(count, 8 * self.threads) if self.threads > 1 else 1
        cuts = np.linspace(0, count, max(pieces, 1) + 1).astype(int)
        jobs = [
            self.pool.submit(kernel, self.space, *(array[i:j] for array in arrays), *common)
            for i, j in pairwise(cuts)
        ]
        return np.concatenate([job.result() for job in jobs])


def nested_order(spheres, lower, size):
    """Return spheres by radius, the largest first, with ties in an order in which any first part is spread.

    A wall takes thousands of spheres of its own half thickness. In order of position, the first hundred would
    be in one corner. Spheres of about equal radius are therefore taken along a space-filling curve in
    bit-reversed order: first every 1024th, then those half-way between, and so on.
    """
    spheres = spheres[np.argsort(-spheres[:, 3], kind="stable")]
    tie = np.floor(np.log(spheres[:, 3]) / np.log(TIE))
    cell = np.clip((spheres[:, :3] - lower) / size * 1024.0, 0, 1023).astype(np.int64)
    curve = np.zeros(len(spheres), dtype=np.int64)
    for bit in range(10):
        for axis in range(3):
            curve |= ((cell[:, axis] >> bit) & 1) << (3 * bit + axis)
    spheres, tie = spheres[np.lexsort((curve, tie))], np.sort(tie)
    _, start, length = np.unique(tie, return_index=True, return_counts=True)
    rank = np.arange(len(spheres)) - np.repeat(start, length)
    reversed_rank = np.zeros_like(rank)
    for bit in range(24):
        reversed_rank |= ((rank >> bit) & 1) << (23 - bit)
    return spheres[np.lexsort((reversed_rank, tie))]
