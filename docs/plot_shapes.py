"""Draw mesh, pieces and spheres of three models side by side: ``python -m docs.plot_shapes OUT.png``."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

SPHERES = 1000


def bracket():
    """Return vertices and triangles of an L of two plates, 100 x 50 x 10 mm and 10 x 50 x 90 mm."""
    import trimesh

    foot = trimesh.creation.box((0.1, 0.05, 0.01))
    wall = trimesh.creation.box((0.01, 0.05, 0.09))
    wall.apply_translation([-0.045, 0.0, 0.05])
    mesh = foot.union(wall)
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)


def draw(path: Path) -> None:
    """Draw a row for each model."""
    from matplotlib.figure import Figure

    from unc_physics import load_model, pack_solid
    from unc_physics.plots.model_picture import draw_balls, draw_triangles, view_axes
    from unc_physics.shapes.mesh_pieces import mesh_pieces
    from unc_physics.shapes.piece_mesh import piece_mesh
    from unc_physics.shapes.recipes import RECIPES
    from unc_physics.shapes.solid_mesh import make_solid

    solids = {name: make_solid(name, *RECIPES[name].mesh()) for name in ("mug", "bottle")}
    models = {name: load_model(name) for name in solids}
    solids["bracket"] = make_solid("bracket", *bracket())
    models["bracket"] = pack_solid(solids["bracket"], SPHERES, **mesh_pieces(solids["bracket"]).entries)
    turn = view_axes("z")
    figure = Figure(figsize=(8.0, 8.0), layout="constrained")
    for row, (name, solid) in zip(figure.subplots(3, 3), solids.items(), strict=True):
        model = models[name].prefix(SPHERES)
        mesh = solid.corners @ turn.T
        low, high = mesh.min(axis=(0, 1)), mesh.max(axis=(0, 1))
        middle, half = 0.5 * (low + high), 0.53 * float((high - low)[:2].max())
        draw_triangles(row[0], [mesh - middle], half)
        draw_triangles(row[1], [piece_mesh(piece) @ turn.T - middle for piece in model.pieces], half)
        sizes = np.log(model.radii)
        draw_balls(row[2], model, turn, middle, half, (sizes.min(), sizes.max()))
        titles = f"{len(solid.corners)} triangles", f"{len(model.pieces)} pieces", f"{len(model)} spheres"
        for axes, title in zip(row, titles, strict=True):
            axes.set_title(title, fontsize=9)
            axes.set_aspect("equal")
            axes.set_axis_off()
    figure.savefig(path, dpi=130)


if __name__ == "__main__":
    draw(Path(sys.argv[1]))
