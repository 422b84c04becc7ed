"""Convert a scene's actions to arrays for the kernels (`dynamics.actions`), also when varied."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..dynamics.actions import Actions, carry_along, no_actions, states_on_path
from ..spatial.layout import (
    ANGULAR_VELOCITY,
    ERR_ANGULAR_VELOCITY,
    ERR_VELOCITY,
    ERROR,
    POSITION,
    QUATERNION,
    VELOCITY,
)
from ..spatial.rotation import exp, multiply, rotation_matrix

if TYPE_CHECKING:
    from .belief import Belief
    from .scene import Scene

#: Density of air at 20 degrees C and sea level [kg/m^3].
AIR_DENSITY = 1.2
#: Uncertain parameters (`parameters`) that belong to actions.
UNCERTAIN = ("trajectory", "released_at")


def actions_of(bodies, environment) -> Actions:
    """Return the actions on ``bodies`` in an ``environment`` as arrays."""
    names = [body.name for body in bodies]
    paths = [k for k, body in enumerate(bodies) if body.trajectory is not None]
    held = [k for k, body in enumerate(bodies) if body.attached_to is not None]
    pushed = [(k, wrench) for k, body in enumerate(bodies) for wrench in body.wrenches]
    slowed = [k for k, body in enumerate(bodies) if body.drag]
    actions = no_actions(len(bodies))
    if paths:
        own = [bodies[k].trajectory for k in paths]
        ends = np.cumsum([0, *(len(path.times) for path in own)])
        ranges = actions.path.copy()
        ranges[paths] = np.column_stack([ends[:-1], ends[1:]])
        actions = actions._replace(
            path=ranges,
            time=np.concatenate([path.times for path in own]),
            pose=np.concatenate([path.states for path in own]),
            turn=np.concatenate([path.turns for path in own]),
            pace=np.concatenate([path.paces for path in own]),
        )
    for k in held:
        actions.carrier[k] = names.index(bodies[k].attached_to)
        actions.held[k] = bodies[k].attached_at, bodies[k].released
    if pushed or slowed:
        none, always = [0.0] * 6, [-np.inf, np.inf]
        actions = actions._replace(
            wrench_body=np.array([*(k for k, _ in pushed), *slowed]),
            wrench=np.array(
                [*([*wrench.force, *wrench.torque] for _, wrench in pushed), *([none] * len(slowed))]
            ),
            wrench_time=np.array(
                [*([wrench.start, wrench.end] for _, wrench in pushed), *([always] * len(slowed))]
            ),
            wrench_local=np.array([*(wrench.body_axes for _, wrench in pushed), *([False] * len(slowed))]),
            wrench_drag=np.array(
                [*([0.0] * len(pushed)), *(0.5 * AIR_DENSITY * bodies[k].drag for k in slowed)]
            ),
        )
    moves = [element.moving_surface for element in environment]
    if any(row.any() for row in moves):
        actions = actions._replace(surface=np.array(moves))
    return actions._replace(kinematic=np.array([*paths, *held], np.int64))


def vary_actions(scene: Scene, actions: Actions, z: np.ndarray) -> Actions:
    """Return the actions with each uncertain parameter shifted by ``z`` (K,) standard deviations."""
    offsets, times = {}, actions.held
    for parameter, value in zip(scene.uncertain, z, strict=True):
        if parameter.name == "trajectory":
            offsets.setdefault(parameter.body, np.zeros(6))[parameter.axis] = value * parameter.std
        elif parameter.name == "released_at":
            times = times.copy()
            start, stop = times[parameter.body]
            times[parameter.body, 1] = max(start, stop + value * parameter.std)
    if not offsets:
        return actions._replace(held=times)
    pose, turn = actions.pose.copy(), actions.turn.copy()
    for k, offset in offsets.items():
        own = slice(*actions.path[k])
        pose[own], turn[own] = _moved(pose[own], turn[own], offset)
    return actions._replace(held=times, pose=pose, turn=turn)


def _moved(pose, turn, offset):
    """Move a path's poses (K, 13) and turns (K, 6) by an offset (6,) along the axes of its first pose."""
    R, middle = rotation_matrix(pose[0, QUATERNION]), pose[0, POSITION].copy()
    rotation = exp(*(R @ offset[3:]))
    A = rotation_matrix(np.array(rotation))
    moved = pose.copy()
    moved[:, POSITION] = (pose[:, POSITION] - middle) @ A.T + middle + R @ offset[:3]
    moved[:, VELOCITY], moved[:, ANGULAR_VELOCITY] = pose[:, VELOCITY] @ A.T, pose[:, ANGULAR_VELOCITY] @ A.T
    moved[:, QUATERNION] = [multiply(rotation, tuple(q)) for q in pose[:, QUATERNION]]
    return moved, np.concatenate([turn[:, :3] @ A.T, turn[:, 3:] @ A.T], axis=1)


def path_states(scene: Scene, body: int, times, actions: Actions | None = None) -> np.ndarray:
    """Return the states (T, 13) of a prescribed body at given times [s]."""
    actions = actions_of(scene.bodies, ()) if actions is None else actions
    return states_on_path(body, np.array(times, float), actions)


def held_at_start(scene: Scene) -> np.ndarray:
    """Return for each body whether it is attached to another at time 0, as (B,) bool."""
    return np.array([body.attached_to is not None and body.attached_at == 0.0 for body in scene.bodies])


def with_kinematic(scene: Scene, mean: np.ndarray, time: float) -> np.ndarray:
    """Return states (B, 13) in which prescribed bodies have the states of their paths."""
    some = _paths(scene)
    if not some:
        return mean
    mean, actions = mean.copy(), scene.actions
    for k in some:
        mean[k] = path_states(scene, k, [time], actions)[0]
    return mean


def with_certain_actions(scene: Scene) -> Scene:
    """Return the scene with zero uncertainty of paths and release times."""
    if not any(parameter.name in UNCERTAIN for parameter in scene.uncertain):
        return scene
    certain = {"trajectory_std": 0.0, "released_at_std": 0.0}
    return replace(scene, bodies=[replace(body, **certain) for body in scene.bodies])


def kinematic_belief(scene: Scene, belief: Belief) -> Belief:
    """Return the belief at time 0 after the scene's actions.

    Prescribed bodies are at the start of their paths. Attached bodies move with the body that holds them.
    """
    held = held_at_start(scene)
    mean = with_kinematic(scene, belief.mean, 0.0)
    if not held.any():
        return belief if mean is belief.mean else belief.trusted(mean, belief.covariance, belief.moving)
    mean, P = mean.copy(), belief.covariance.copy()
    for k in np.flatnonzero(held):
        carrier = mean[scene.actions.carrier[k]][None]
        mean[k] = carry_along(mean[None].copy(), k, carrier, carrier)[0, k]
    still = np.zeros((len(belief.moving), ERROR), bool)
    still[held[belief.moving], ERR_VELOCITY] = still[held[belief.moving], ERR_ANGULAR_VELOCITY] = True
    if belief.independent:
        P[still[:, :, None] | still[:, None, :]] = 0.0
    else:
        P[still.ravel()], P[:, still.ravel()] = 0.0, 0.0
    return belief.trusted(mean, P, belief.moving)


def start_states(scene: Scene, states: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Return states (N, B, 13) at time 0 that follow each sample's own paths.

    Attached bodies keep their pose in the frame of the body that holds them.
    """
    if not scene.acts:
        return states
    states, nominal = states.copy(), scene.actions
    before = {k: path_states(scene, k, [0.0], nominal) for k in _paths(scene)}
    after = {k: np.repeat(state, len(states), axis=0) for k, state in before.items()}
    if scene.uncertain:
        for n in range(len(states)):
            own = vary_actions(scene, nominal, z[n])
            for k, rows in after.items():
                rows[n] = path_states(scene, k, [0.0], own)[0]
    for k, rows in after.items():
        states[:, k] = rows
    for k in np.flatnonzero(held_at_start(scene)):
        carrier = int(nominal.carrier[k])
        at = states[:1, carrier].copy()
        carry_along(
            states, k, before.get(carrier, at), after.get(carrier, np.repeat(at, len(states), axis=0))
        )
    return states


def _paths(scene):
    return [k for k, body in enumerate(scene.bodies) if body.trajectory is not None]
