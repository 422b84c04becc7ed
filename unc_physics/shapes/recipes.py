"""Recipes of the library's models: mesh, size, mass, number of spheres, source and licence."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from ..checks.errors import InvalidMeshError, UnknownModelError
from . import household_meshes
from .household import HOUSEHOLD, household_pieces
from .mesh_pieces import PIECES, measured_pieces
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
    """A model of the library; ``mesh`` is a function of ``shapes`` or a file name, scaled to metres."""

    mesh: Callable | str
    spheres: int
    mass: float | None = None  # kg
    density: float = 0.0  # kg/m^3, where there is no mass
    scale: float = 1.0
    largest_first: bool = False
    pieces: int = PIECES  # of a decomposition, at most


RECIPES = {
    "armadillo": Recipe("armadillo.off", 10_000, density=ABS, scale=0.001, largest_first=True),
    "bin": Recipe(household_meshes.bin, 15_000, density=POLYPROPYLENE),
    "bottle": Recipe(household_meshes.bottle, 4000, mass=0.53),
    "bowl": Recipe(household_meshes.bowl, 4000, density=STONEWARE),
    "brick": Recipe(household_meshes.brick, 4000, density=CLAY),
    "bunny": Recipe("bunny00.off", 10_000, density=ABS, scale=0.156, largest_first=True),
    "can": Recipe(household_meshes.can, 4000, mass=0.455),
    "mug": Recipe(household_meshes.mug, 4000, density=STONEWARE),
    "pin": Recipe(household_meshes.pin, 10_000, mass=1.58, largest_first=True),
    "plate": Recipe(household_meshes.plate, 5000, density=STONEWARE),
    "rounded_box": Recipe(household_meshes.rounded_box, 4000, mass=0.37),
    "salt_box": Recipe(household_meshes.salt_box, 4000, mass=0.52),
}


def recipe_solid(name, meshes=None) -> tuple[SolidMesh, dict]:
    """Return the body of a key of `RECIPES`, and the model's ``mass``, ``source``, ``licence`` and pieces.

    ``meshes`` is the folder of the meshes that are no part of the repository; `InvalidMeshError` is raised if
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
        if meshes is None:
            raise InvalidMeshError(
                f"needs the file {recipe.mesh}; name its folder with --meshes", field=f"model {name}"
            )
        solid = replace(load_solid(Path(meshes) / recipe.mesh)[0].scaled(recipe.scale), name=name)
        source, licence = STANFORD.format(recipe.mesh), STANFORD_TERMS
    mass = recipe.mass if recipe.mass is not None else recipe.density * solid.volume
    about = {"mass": float(f"{mass:.3g}"), "source": source, "licence": licence}
    if name in HOUSEHOLD:
        about |= measured_pieces(household_pieces(name, solid.origin), "recipe", solid).entries
    return solid, about
