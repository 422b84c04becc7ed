"""Compiles or loads kernels before the first request: ``python -m unc_physics.ros.warm_up`` fills numba's
cache.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from unc_physics_msgs.msg import Prediction

from ..checks.validation import covariance
from ..geometry.packing_file import SpherePacking
from ..physics.layout import ERROR, QUATERNION, STATE
from ..physics.origin import at_com, covariance_at_com, inverse_error_map
from ..propagators.registry import PROPAGATORS, make_propagator
from ..scene.belief import Belief
from ..scene.body import RigidBody
from ..scene.presets import with_changes
from ..scene.scene import Scene
from ..scene.stiffness import AUTO
from .parameters import Settings
from .prediction_writer import Wanted
from .requests import Job, run, write_answer

_STEPS = 3
_STIFFNESS = 1e5  # N/m^3
_EXPLICIT = {"integrator": "explicit", "friction": None, "restitution": None, "sleep": None}


def warm_up(settings: Settings) -> None:
    """Predict two bodies in contact by the propagators that are to be warm, and write the answers.

    The physics is the node's; for propagators that do not run on it, it is explicit.
    """
    row = np.arange(20) * 0.02
    centers = np.stack([row - row.mean(), np.zeros(20), np.zeros(20)], axis=1)
    model = SpherePacking(
        "rod", centers, np.full(20, 0.01), np.diag([1e-3, 1e-2, 1e-2]), 1e-4, np.zeros(3), bounding_radius=0.5
    )
    bodies = [RigidBody("a", model, 1.0), RigidBody("b", model, 1.0), RigidBody("floor", model, fixed=True)]
    resting = [
        replace(bodies[0], at_rest=settings.integrator == "implicit" and any(settings.gravity)),
        *bodies[1:],
    ]
    stiffness = _STIFFNESS if settings.stiffness == AUTO else settings.stiffness
    physics = settings.physics | {"stiffness": stiffness, "overlap": None}  # which all propagators take
    own = Scene(resting, **physics)
    explicit = Scene(bodies, **with_changes(physics, _EXPLICIT))
    mean = np.zeros((3, STATE))
    mean[:, QUATERNION] = 0.0, 0.0, 0.0, 1.0
    mean[:, 2] = 0.0, 0.015, -0.015
    P = covariance(1e-6 * np.eye(ERROR), ERROR, "covariance")
    belief = Belief(mean, np.stack([P, P]), own.moving)
    covariance_at_com(np.eye(6), np.eye(6), mean[0], np.zeros(3))  # of each object that is read
    at_com(np.eye(ERROR), mean[0], np.zeros(3))
    inverse_error_map(mean[0], np.zeros(3))
    for name in filter(None, settings.warm_up):
        scene = own if own.integrator in PROPAGATORS[name].integrators else explicit
        few = {"samples": 4} if "samples" in PROPAGATORS[name].options() else {}
        propagator = make_propagator(name, **few)
        wanted = Wanted(True, propagator.traits.cross_body, True, True)
        horizon = _STEPS * scene.dt
        job = Job(scene, belief, (), ("rod",) * 3, propagator, horizon, None, None, 1, 2, wanted, False, {})
        message = Prediction()
        write_answer(message, message.header, settings, job, run(job))


if __name__ == "__main__":
    warm_up(Settings(warm_up=tuple(PROPAGATORS)))
