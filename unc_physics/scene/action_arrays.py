"""A scene's actions as the kernels take them (`physics.actions`), also with other values of what is
uncertain.
"""

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
    STATE,
    VELOCITY,
)
from ..spatial.rotation import exp, multiply, rotation_matrix
from .belief import Belief

if TYPE_CHECKING:
    from .scene import Scene

#: Uncertain parameters (`parameters`) that are of actions.
UNCERTAIN = ("trajectory", "released_at")


def actions_of(bodies, environment) -> Actions:
    """What acts on some bodies, among elements of the environment."""
    names = [body.name for body in bodies]
    paths = [k for k, body in enumerate(bodies) if body.trajectory is not None]
    held = [k for k, body in enumerate(bodies) if body.attached_to is not None]
    pushed = [(k, wrench) for k, body in enumerate(bodies) for wrench in body.wrenches]
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
    if pushed:
        actions = actions._replace(
            wrench_body=np.array([k for k, _ in pushed]),
            wrench=np.array([[*wrench.force, *wrench.torque] for _, wrench in pushed]),
            wrench_time=np.array([[wrench.start, wrench.end] for _, wrench in pushed]),
            wrench_local=np.array([wrench.body_axes for _, wrench in pushed]),
        )
    moves = [element.moving_surface for element in environment]
    if any(row.any() for row in moves):
        actions = actions._replace(surface=np.array(moves))
    return actions._replace(driven=np.array([*paths, *held], np.int64))


def vary_actions(scene: Scene, actions: Actions, z: np.ndarray) -> Actions:
    """The actions with the scene's uncertain parameters ``z`` (K,) standard deviations from their values."""
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
    """A path's poses (K, 13) and turns (K, 6), moved by an offset (6,) along the axes of the first one."""
    R, middle = rotation_matrix(pose[0, QUATERNION]), pose[0, POSITION].copy()
    rotation = exp(*(R @ offset[3:]))
    A = rotation_matrix(np.array(rotation))
    moved = pose.copy()
    moved[:, POSITION] = (pose[:, POSITION] - middle) @ A.T + middle + R @ offset[:3]
    moved[:, VELOCITY], moved[:, ANGULAR_VELOCITY] = pose[:, VELOCITY] @ A.T, pose[:, ANGULAR_VELOCITY] @ A.T
    moved[:, QUATERNION] = [multiply(rotation, tuple(q)) for q in pose[:, QUATERNION]]
    return moved, np.concatenate([turn[:, :3] @ A.T, turn[:, 3:] @ A.T], axis=1)


def path_states(scene: Scene, body: int, times, actions: Actions | None = None) -> np.ndarray:
    """(T, 13): states of a prescribed body at some times [s]."""
    actions = actions_of(scene.bodies, ()) if actions is None else actions
    return states_on_path(body, np.array(times, float), actions)


def held_at_start(scene: Scene) -> np.ndarray:
    """(B,) bool: which bodies something holds at time 0."""
    return np.array([body.attached_to is not None and body.attached_at == 0.0 for body in scene.bodies])


def with_driven(scene: Scene, mean: np.ndarray, time: float) -> np.ndarray:
    """States (B, 13) with those of prescribed bodies as their paths say."""
    some = [k for k, body in enumerate(scene.bodies) if body.trajectory is not None]
    if not some:
        return mean
    mean, actions = mean.copy(), scene.actions
    for k in some:
        mean[k] = path_states(scene, k, [time], actions)[0]
    return mean


def with_certain_actions(scene: Scene) -> Scene:
    """The scene in which paths and times of release are known for sure."""
    if not any(parameter.name in UNCERTAIN for parameter in scene.uncertain):
        return scene
    certain = {"trajectory_std": 0.0, "released_at_std": 0.0}
    return replace(scene, bodies=[replace(body, **certain) for body in scene.bodies])


def driven_belief(scene: Scene, belief: Belief) -> Belief:
    """A belief at time 0 as the scene's actions say: where prescribed bodies are, and that held ones move
    with what holds them.
    """
    held = held_at_start(scene)
    mean = with_driven(scene, belief.mean, 0.0)
    if not held.any():
        return belief if mean is belief.mean else Belief.trusted(mean, belief.covariance, belief.moving)
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
    return Belief.trusted(mean, P, belief.moving)


def start_states(scene: Scene, states: np.ndarray, z: np.ndarray) -> np.ndarray:
    """States (N, B, 13) at time 0 in which prescribed bodies are where their own paths say, and what they
    hold moves along: its pose is known in their frames.
    """
    if not scene.acts:
        return states
    states, nominal = states.copy(), scene.actions
    before = {k: path_states(scene, k, [0.0], nominal) for k in _paths(scene)}
    after = {k: np.empty((len(states), STATE)) for k in before}
    for n in range(len(states)):
        own = vary_actions(scene, nominal, z[n]) if scene.uncertain else nominal
        for k, rows in after.items():
            rows[n] = path_states(scene, k, [0.0], own)[0] if scene.uncertain else before[k][0]
            states[n, k] = rows[n]
    for k in np.flatnonzero(held_at_start(scene)):
        carrier = int(nominal.carrier[k])
        at = states[:1, carrier].copy()
        carry_along(
            states, k, before.get(carrier, at), after.get(carrier, np.repeat(at, len(states), axis=0))
        )
    return states


def _paths(scene):
    return [k for k, body in enumerate(scene.bodies) if body.trajectory is not None]
