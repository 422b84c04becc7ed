"""Compiles kernels, or loads compiled ones, before the first prediction that needs them."""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from dataclasses import replace
from typing import Any

import numpy as np

from ..checks.validation import covariance
from ..compiler.compile_time import CompiledKernels
from ..propagators.registry import PROPAGATORS, make_propagator
from ..propagators.sobol import quantile
from ..scene.actions import PosePath
from ..scene.belief import Belief
from ..scene.body import RigidBody
from ..scene.body_belief import BodyBelief
from ..scene.environment import Plane
from ..scene.presets import PRESETS
from ..scene.scene import Scene
from ..shapes.packing_file import SpherePacking
from ..spatial.layout import ANGULAR_VELOCITY, ERROR, POSITION, QUATERNION, STATE
from ..spatial.moments import boxminus
from ..spatial.origin import at_com, at_origin, congruent, error_map, inverse_error_map, moved
from ..spatial.rotation import exp, multiply
from .predict import predict
from .status import assess

#: The model of the bodies, as answers name it.
MODEL = "rod"
#: Approximate number of kernels that `warm_up` of all propagators compiles, for progress bars.
TYPICAL_KERNELS = {"everyday": 445, "paper": 170}
_LOOK = 0.2  # s, between reports
_STEPS = 3
_FLOOR = Plane((0.0, 0.0, 1.0), 0.0)
_EVERYDAY = PRESETS["everyday"]


def warm_up(
    names: Iterable[str] = tuple(PROPAGATORS),
    physics: Mapping[str, Any] = _EVERYDAY,
    answer: Callable | None = None,
) -> None:
    """Predict two bodies in contact by each propagator, so that what it needs is compiled or loaded.

    ``physics`` are arguments of `Scene`; propagators of other packages that do not run on its integrator are
    left out. ``answer`` takes a scene, a belief, a propagator and a horizon [s]; by default they are
    predicted and the prediction is judged.
    """
    scene = _scene({**physics, "overlap": None, "stiffness": None})  # which all propagators take
    mean = np.zeros((3, STATE))
    mean[:, QUATERNION] = 0.0, 0.0, 0.0, 1.0
    mean[:, POSITION][:, 2] = 0.0, 0.015, -0.015
    if scene.integrator == "explicit":  # so far in one step that statuses look between steps
        mean[1, ANGULAR_VELOCITY.start] = 1.0 / scene.dt
    P = covariance(1e-6 * np.eye(ERROR), ERROR, "covariance")
    belief = Belief(mean, np.stack([P, P]), scene.moving)
    moved(mean[0], np.zeros(3), -1.0)
    at_com(np.eye(ERROR), mean[0], np.zeros(3))  # of what is given at its model's origin
    multiply(tuple(mean[0, QUATERNION]), tuple(mean[0, QUATERNION]))  # or in another frame
    inverse_error_map(mean[0], np.zeros(3))
    at_origin(mean[0], np.eye(ERROR), np.zeros(3))  # of each body in answers
    error_map(mean[0], np.zeros(3))
    congruent(np.eye(ERROR), np.eye(ERROR))  # of all bodies together
    _FLOOR.surface(mean[:, POSITION])  # of scenes where nothing may touch
    boxminus(mean[0], mean[1], np.empty(ERROR))  # of outcomes that split
    exp(0.0, 0.0, 0.0)  # of uncertain paths
    quantile(0.5)  # of outcomes that few rollouts reach
    for name in names:
        few = {"samples": 4} if name in PROPAGATORS and "samples" in PROPAGATORS[name].options() else {}
        propagator = make_propagator(name, **few)
        if scene.integrator in propagator.integrators:
            (answer or _judged)(scene, belief, propagator, _STEPS * scene.dt)
        if scene.integrator in propagator.supports.actions and scene.integrator == "implicit":
            actions = _scene_with_actions(scene, physics)
            (answer or _judged)(*actions, propagator, _STEPS * scene.dt)


def warm_up_in_processes(
    names: Iterable[str], physics: Mapping[str, Any]
) -> Iterator[tuple[str | None, int]]:
    """Run `warm_up` for each propagator, in as many processes as there are processor cores.

    Kernels that several propagators need are compiled once: a process waits while another compiles one.
    Yields the name of each propagator that is ready, or None several times a second in between, with the
    number of kernels that were compiled so far.
    """
    names = list(names)
    for name in names:
        make_propagator(name)  # errors are raised here
    processes = min(len(names), os.cpu_count() or 1)
    context = multiprocessing.get_context("spawn")
    counter = context.Value("q", 0)
    with ProcessPoolExecutor(processes, context, _begin_process, (counter,)) as pool:
        waiting = {pool.submit(warm_up, (name,), physics): name for name in names}
        while waiting:
            done, _ = wait(waiting, _LOOK, FIRST_COMPLETED)
            yield None, counter.value
            for future in done:
                future.result()
                yield waiting.pop(future), counter.value


def _begin_process(counter):
    """Count compiled kernels for the process that shows them, and end silently with it."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    logging.getLogger(__name__.partition(".")[0]).setLevel(logging.ERROR)
    CompiledKernels(counter).register()


def _judged(scene, belief, propagator, horizon):
    prediction = predict(scene, belief, propagator, horizon)
    assess(prediction)
    prediction.samples(2)


def _scene(physics):
    """Return a scene of a rod between two others, the lower of which is fixed."""
    row = np.arange(20) * 0.02
    centers = np.stack([row - row.mean(), np.zeros(20), np.zeros(20)], axis=1)
    inertia = np.diag([1e-3, 1e-2, 1e-2])
    model = SpherePacking(MODEL, centers, np.full(20, 0.01), inertia, 1e-4, np.zeros(3), bounding_radius=0.5)
    first, second = RigidBody("a", model, 1.0), RigidBody("b", model, 1.0)
    gravity = physics.get("gravity")
    if physics.get("integrator") == "implicit" and gravity is not None and any(gravity):
        first = replace(first, at_rest=True)
    return Scene([first, second, RigidBody("floor", model, fixed=True)], **physics)


def _scene_with_actions(scene, physics):
    """Return a scene of rods over a floor, and the belief: one lies, one flies, and one is carried."""
    model, dt = scene.bodies[0].model, scene.dt
    path = PosePath(times=np.arange(2) * dt, positions=np.array([[4.0, 0.0, 1.0], [4.0, 0.0, 1.001]]))
    bodies = [
        RigidBody("lies", model, 1.0),
        RigidBody("flies", model, 1.0),
        RigidBody("hand", model, trajectory=path),
        RigidBody("held", model, 1.0, attached_to="hand", released_at=2.0 * dt),
    ]
    known: dict[str, Any] = {"position_std": 0.001, "orientation_std": 0.01, "linear_velocity_std": 0.01}
    heights = {"lies": (0.0, 0.011), "flies": (2.0, 1.0), "held": (4.0, 1.025)}
    beliefs = {name: BodyBelief(position=[x, 0.0, z], **known) for name, (x, z) in heights.items()}
    given = {**physics, "overlap": None, "stiffness": None, "gravity": scene.gravity}
    scene = Scene(bodies, environment=[_FLOOR], **given)
    return scene, Belief.of(scene, beliefs)
