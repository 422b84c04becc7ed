"""Scenes without the uncertain parts that a propagator cannot carry, or that have no effect."""

from __future__ import annotations

from dataclasses import replace
from weakref import WeakKeyDictionary

import numpy as np

from ..propagators.base import Propagator
from ..scene.belief import Belief
from ..scene.materials import Materials
from ..scene.scene import IMPACT_STDS, Scene
from ..spatial.layout import ERR_POSITION, ERR_VELOCITY, POSITION, VELOCITY

#: Fields of uncertain parts that a propagator may leave out.
MATERIAL_STDS = tuple(f"{name}_std" for name in Materials._fields)
_FAR = 6.0  # standard deviations within which no body may reach anything
_TIMES = 64  # at which distances are computed
#: Cache of scenes without some fields, which hold the kernels' arrays.
_reduced: WeakKeyDictionary[Scene, dict[tuple[str, ...], Scene]] = WeakKeyDictionary()


def left_out(scene: Scene, propagator: Propagator) -> tuple[str, ...]:
    """Return the fields of the scene's uncertain materials and impacts that a propagator cannot carry."""
    uncertain = {f"{parameter.name}_std" for parameter in scene.uncertain}
    carried = {f"{name}_std" for name in propagator.supports.parameters}
    found = [name for name in MATERIAL_STDS if name in uncertain - carried]
    if scene.draws_impacts and not propagator.supports.impact_errors:
        found += [name for name in IMPACT_STDS if getattr(scene, name) > 0.0]
    return tuple(found)


def without(scene: Scene, names: tuple[str, ...]) -> Scene:
    """Return the scene with these fields zero, also in its surfaces; cached."""
    if not names:
        return scene
    known = _reduced.setdefault(scene, {})
    if names not in known:
        known[names] = _without(scene, names)
    return known[names]


def _without(scene, names):
    """Return a new scene, as `without`."""
    of_surfaces = dict.fromkeys([name for name in names if name in MATERIAL_STDS], 0.0)

    def certain(surfaces):
        return [
            replace(surface, **of_surfaces)
            if any(getattr(surface, name) for name in of_surfaces)
            else surface
            for surface in surfaces
        ]

    return replace(
        scene,
        bodies=certain(scene.bodies),
        environment=certain(scene.environment),
        **dict.fromkeys(names, 0.0),
    )


def without_idle_parts(scene: Scene, belief: Belief, horizon: float) -> Scene:
    """Return the scene without uncertain materials and errors of impacts if nothing can touch.

    The belief is that at time 0, and the horizon is in seconds.
    """
    idle = scene.draws_impacts or any(parameter.name in Materials._fields for parameter in scene.uncertain)
    if not idle or scene.acts or not _stay_apart(scene, belief, horizon):
        return scene
    return without(scene, (*MATERIAL_STDS, *IMPACT_STDS))


def _stay_apart(scene, belief, horizon):
    """Return whether all bodies fly without a contact until the horizon [s], within `_FAR` deviations."""
    if any(body.at_rest or body.center_of_mass_std.any() for body in scene.bodies):
        return False
    if (
        scene.damping
        or scene.gravity_direction_std
        or any(getattr(one, "surface_tilt_std", 0.0) for one in scene.environment)
    ):
        return False
    times = np.linspace(0.0, horizon, _TIMES)
    radius = np.array([body.model.bounding_radius for body in scene.bodies])
    spreads = [
        np.sqrt(np.linalg.eigvalsh(belief.blocks[:, part, part])[:, -1].clip(0.0))
        for part in (ERR_POSITION, ERR_VELOCITY)
    ]
    places, margins = [], []
    for k in range(len(scene.bodies)):
        position, velocity = belief.mean[k, POSITION], belief.mean[k, VELOCITY]
        if not scene.bodies[k].free:
            places.append(np.tile(position, (_TIMES, 1)))
            margins.append(np.full(_TIMES, radius[k]))
            continue
        path = position + times[:, None] * velocity + 0.5 * times[:, None] ** 2 * scene.gravity
        own = np.searchsorted(belief.moving, k)
        fastest = np.linalg.norm(velocity) + horizon * np.linalg.norm(scene.gravity)
        between = 0.5 * fastest * times[1]
        places.append(path)
        margins.append(radius[k] + _FAR * (spreads[0][own] + times * spreads[1][own]) + between)
    for k in scene.moving.tolist():
        for element in scene.environment:
            if (element.surface(places[k])[0] <= margins[k]).any():
                return False
        for j in range(len(scene.bodies)):
            apart = np.linalg.norm(places[k] - places[j], axis=1)
            if j != k and (apart <= margins[k] + margins[j]).any():
                return False
    return True
