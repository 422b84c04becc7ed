"""Recipes of the library's models: mesh, size, mass, number of spheres, source and licence."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..checks.errors import InvalidMeshError, UnknownModelError
from . import household
from . import household_meshes as meshes
from .mesh_pieces import measured_pieces
from .pieces import Lathe, Piece, box
from .revolution import lathe_pieces
from .solid_mesh import SolidMesh, load_solid, make_solid

STANFORD = (
    "Stanford 3D Scanning Repository, Stanford Computer Graphics Laboratory; mesh {} of the data of CGAL's "
    "demos (Debian package libcgal-demo)"
)
STANFORD_TERMS = (
    "terms of the Stanford 3D Scanning Repository: free for research and for redistribution with credit "
    "to the Stanford Computer Graphics Laboratory; no commercial use without its permission"
)
OWN = "parametric mesh, unc_physics/shapes/household_meshes.py"
OWN_TERMS = "Apache-2.0"
STONEWARE, CLAY, POLYPROPYLENE, ABS = 2300.0, 1800.0, 900.0, 1050.0  # kg/m^3


@dataclass(frozen=True)
class Recipe:
    """A model of the library; ``mesh`` is a function or a file name, scaled to metres."""

    mesh: Callable | str
    pieces: Callable[[], Sequence[Piece]] | None  # of the mesh, in its axes; None: by decomposition
    spheres: int
    mass: float | None = None  # kg
    density: float = 0.0  # kg/m^3, where there is no mass
    scale: float = 1.0
    largest_first: bool = False


def _turned(profile, segments, pieces=None):
    """Return functions of mesh and pieces of a surface of revolution."""
    return (
        lambda: meshes.revolved(profile(), segments),
        pieces or (lambda: lathe_pieces(profile(), household.HOLLOW)),
    )


def _box(x, y, z):
    """Return functions of mesh and pieces of a box that stands on z = 0."""
    rectangles = [meshes.rectangle(x, y, height) for height in (0.0, z)]
    return lambda: meshes.lofted(rectangles, 0.0, z), lambda: [box((x, y, z), (0.0, 0.0, 0.5 * z))]


RECIPES = {
    "armadillo": Recipe("armadillo.off", None, 10_000, density=ABS, scale=0.001, largest_first=True),
    "bin": Recipe(meshes.bin, household.bin_pieces, 15_000, density=POLYPROPYLENE),
    "bottle": Recipe(*_turned(meshes.bottle_profile, 96), 4000, mass=0.53),
    "bowl": Recipe(*_turned(meshes.bowl_profile, 128), 4000, density=STONEWARE),
    # a solid clay brick of German normal format
    "brick": Recipe(*_box(0.240, 0.115, 0.071), 4000, density=CLAY),
    "bunny": Recipe("bunny00.off", None, 10_000, density=ABS, scale=0.156, largest_first=True),
    "can": Recipe(*_turned(meshes.can_profile, 128, household.can_pieces), 4000, mass=0.455),
    "mug": Recipe(meshes.mug, household.mug_pieces, 4000, density=STONEWARE),
    "pin": Recipe(*_turned(meshes.pin_profile, 160), 10_000, mass=1.58, largest_first=True),
    "plate": Recipe(*_turned(meshes.plate_profile, 160), 5000, density=STONEWARE),
    "rounded_box": Recipe(meshes.rounded_box, household.rounded_box_pieces, 4000, mass=0.37),
    # a 500 g carton of table salt
    "salt_box": Recipe(*_box(0.078, 0.046, 0.122), 4000, mass=0.52),
}


def recipe_solid(name, folder=None) -> tuple[SolidMesh, dict]:
    """Return the body of a key of `RECIPES`, and the model's ``mass``, ``source``, ``licence`` and pieces.

    ``folder`` is that of the meshes that are no part of the repository; `InvalidMeshError` is raised if
    the model needs one and it is not there.
    """
    if name not in RECIPES:
        raise UnknownModelError(
            f"has no recipe; there are recipes for: {', '.join(RECIPES)}", field="model", value=name
        )
    recipe = RECIPES[name]
    if callable(recipe.mesh):
        solid = make_solid(name, *recipe.mesh())
        source, licence = OWN, OWN_TERMS
    else:
        if folder is None:
            raise InvalidMeshError(
                f"needs the file {recipe.mesh}; name its folder with --meshes", field=f"model {name}"
            )
        solid = replace(load_solid(Path(folder) / recipe.mesh)[0].scaled(recipe.scale), name=name)
        source, licence = STANFORD.format(recipe.mesh), STANFORD_TERMS
    mass = recipe.mass if recipe.mass is not None else recipe.density * solid.volume
    about = {"mass": float(f"{mass:.3g}"), "source": source, "licence": licence}
    if recipe.pieces is not None:
        # hollow sides are flat, as in the files of the library: they hold no arcs
        flat = [replace(piece, arcs=()) if isinstance(piece, Lathe) else piece for piece in recipe.pieces()]
        moved = [piece.moved(solid.origin, np.eye(3)) for piece in flat]
        about |= measured_pieces(moved, "recipe", solid).entries
    return solid, about
