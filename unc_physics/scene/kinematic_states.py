"""States of prescribed and attached bodies, and actions whose parameters vary."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..physics.actions import Actions, carry_along, states_on_path
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
from .action_arrays import actions_of
from .belief import Belief
from .scene import Scene

#: Uncertain parameters (`parameters`) that belong to actions.
UNCERTAIN = ("trajectory", "released_at")


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
    mean = mean.copy()
    for k in np.flatnonzero(held):
        carrier = mean[scene.actions.carrier[k]][None]
        mean[k] = carry_along(mean[None].copy(), k, carrier, carrier)[0, k]
    return with_certain_velocities(belief, mean, held)


def with_certain_velocities(belief: Belief, mean: np.ndarray, bodies: np.ndarray) -> Belief:
    """Return the belief with another mean (B, 13), and without errors of the velocities of bodies (B,)."""
    still, P = np.zeros((len(belief.moving), ERROR), bool), belief.covariance.copy()
    still[bodies[belief.moving], ERR_VELOCITY] = still[bodies[belief.moving], ERR_ANGULAR_VELOCITY] = True
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
