"""What is tuned to the tosses, the same for every engine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from unc_physics.calibration.adjustable import Adjustable, Model, adjustables
from unc_physics.scene.environment import Plane
from unc_physics.scene.scene import Scene

from .recorded_tosses import Tosses, cube, toss_scene

#: The same number of parameters in every engine; the last are what the model does not know.
PLAIN = ("friction", "restitution", "inertia", "floor", "corner_radius", "position_noise", "rotation_noise")
IMPACTS = ("impact_direction_std", "impact_point_std", "impact_friction_std")
SPREADS = ("friction_std", "surface_tilt_std")
TUNED = (*PLAIN, *IMPACTS, *SPREADS)
#: Where the search begins in every engine, if not with the untuned: between a solid cube and a shell, with
#: worn corners, and errors of impacts as `docs/explanation/what_to_believe.md` advises for a body of 10 cm.
FIRST = {
    "inertia": 1.33,
    "corner_radius": 3e-3,
    "impact_direction_std": 0.03,
    "impact_point_std": 5e-3,
    "impact_friction_std": 0.1,
}
_NOISE = 3e-4, 2e-3  # of poses, where the search begins [m], [rad]


def untuned(tosses: Tosses, gravity: np.ndarray | None = None) -> Model:
    """The authors' friction and restitution, a solid cube with sharp corners, gravity (3,) as measured."""
    changes = {} if gravity is None else {"gravity": gravity}
    return Model(toss_scene(tosses, **changes), *_NOISE)


def tuned_parameters(tosses: Tosses, chosen: Sequence[int]) -> list[Adjustable]:
    """What is tuned; a cube whose rest is as high above the floor as that of the chosen tosses."""
    rest = tosses.rest_height(chosen)
    known = adjustables(toss_scene(tosses))
    own = (
        Adjustable("floor", "m", "height of the table", -0.01, 0.005, 5e-4, _floor, _with_floor(rest)),
        Adjustable("corner_radius", "m", "of the cube's corners", 1e-4, 0.02, 1.5e-3, _corner, _with_corner),
    )
    known |= {one.name: one for one in own}
    return [known[name] for name in TUNED]


def _body(scene: Scene):
    return scene.bodies[0]


def _half_width(scene):
    return float(_body(scene).model.bounds[1, 0])


def _floor(model):
    return model.scene.environment[0].offset


def _corner(model):
    return float(_body(model.scene).model.radii[0])


def _inertia(scene):
    body = _body(scene)
    return float(body.unit_inertia[0, 0] / body.model.inertia[0, 0])


def _remade(scene, half_width, corner_radius):
    """The scene with another cube, of the same factor of inertia."""
    factor = _body(scene).unit_inertia[0, 0] / (2.0 / 3.0 * _half_width(scene) ** 2)
    return replace(scene, bodies=[cube(half_width, corner_radius, factor)])


def _with_floor(rest):
    def put(model, value):
        scene = _remade(model.scene, rest - value, _corner(model))
        table = replace(scene.environment[0], offset=value)
        assert isinstance(table, Plane)
        return model._replace(scene=replace(scene, environment=[table]))

    return put


def _with_corner(model, value):
    return model._replace(scene=_remade(model.scene, _half_width(model.scene), value))
