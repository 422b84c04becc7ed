"""Compiles kernels, or loads compiled ones, before the first prediction that needs them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ..checks.validation import covariance
from ..geometry.packing_file import SpherePacking
from ..propagators.registry import PROPAGATORS, make_propagator
from ..scene.belief import Belief
from ..scene.body import RigidBody
from ..scene.presets import PRESETS
from ..scene.scene import Scene
from ..spatial.layout import ERROR, POSITION, QUATERNION, STATE
from ..spatial.origin import at_com, covariance_at_com, inverse_error_map, moved
from .predict import predict
from .status import assess

#: The model of the bodies, as answers name it.
MODEL = "rod"
_STEPS = 3
_STIFFNESS = 1e5  # N/m^3
_EVERYDAY = PRESETS["everyday"]


def warm_up(
    names: Iterable[str] = tuple(PROPAGATORS),
    physics: Mapping[str, Any] = _EVERYDAY,
    answer: Callable | None = None,
) -> None:
    """Predict two bodies in contact by each propagator, so that what it needs is compiled or loaded.

    Parameters
    ----------
    names : iterable of str
        Of propagators; by default all.
    physics : mapping
        Arguments of `Scene`. Propagators of other packages that do not run on its integrator are left out.
    answer : callable, optional
        What is done with a scene, a belief, a propagator and a horizon [s]; by default they are predicted and
        the prediction is judged.

    Raises
    ------
    UnknownPropagatorError
        If there is no such propagator.
    """
    stiffness = physics.get("stiffness")
    own_physics = {**physics, "overlap": None}  # which all propagators take
    if not isinstance(stiffness, float):
        own_physics["stiffness"] = _STIFFNESS
    scene = _scene(own_physics)
    mean = np.zeros((3, STATE))
    mean[:, QUATERNION] = 0.0, 0.0, 0.0, 1.0
    mean[:, POSITION][:, 2] = 0.0, 0.015, -0.015
    P = covariance(1e-6 * np.eye(ERROR), ERROR, "covariance")
    belief = Belief(mean, np.stack([P, P]), scene.moving)
    moved(mean[0], np.zeros(3), -1.0)
    covariance_at_com(np.eye(6), np.eye(6), mean[0], np.zeros(3))  # of what is given at its model's origin
    at_com(np.eye(ERROR), mean[0], np.zeros(3))
    inverse_error_map(mean[0], np.zeros(3))
    for name in names:
        few = {"samples": 4} if name in PROPAGATORS and "samples" in PROPAGATORS[name].options() else {}
        propagator = make_propagator(name, **few)
        if scene.integrator in propagator.integrators:
            (answer or _judged)(scene, belief, propagator, _STEPS * scene.dt)


def _judged(scene, belief, propagator, horizon):
    assess(predict(scene, belief, propagator, horizon))


def _scene(physics):
    """A rod between two others, of which the lower one is fixed."""
    row = np.arange(20) * 0.02
    centers = np.stack([row - row.mean(), np.zeros(20), np.zeros(20)], axis=1)
    inertia = np.diag([1e-3, 1e-2, 1e-2])
    model = SpherePacking(MODEL, centers, np.full(20, 0.01), inertia, 1e-4, np.zeros(3), bounding_radius=0.5)
    first, second = RigidBody("a", model, 1.0), RigidBody("b", model, 1.0)
    gravity = physics.get("gravity")
    if physics.get("integrator") == "implicit" and gravity is not None and any(gravity):
        first = replace(first, at_rest=True)
    return Scene([first, second, RigidBody("floor", model, fixed=True)], **physics)
