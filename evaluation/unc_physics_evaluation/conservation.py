"""Conservation in rollouts: energy, momentum, positions at rest, and no passing through each other."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from unc_physics.propagators.registry import make_propagator
from unc_physics.scene.belief import Belief
from unc_physics.scene.marks import whole
from unc_physics.scene.scene import Scene
from unc_physics.spatial.layout import POSITION, VELOCITY

from .energy import contact_energy, height_energy, kinetic_energy, momentum
from .jobs import Row
from .methods import MONTE_CARLO
from .passing import passed_through

FINITE, GAIN, CHANGE, MOMENTUM = "finite", "energy_gain", "energy_change", "momentum_error"
PASSED, DRIFT = "passed_through", "drift"
#: Of the bodies' radii: with gravity, energies are compared with at least what lifts all of them so far.
LIFT = 1e-3


def trajectory(scene: Scene, mean: np.ndarray, steps: int) -> np.ndarray:
    """Return the states (T, B, 13) of one rollout at every step, up to the first that is not finite."""
    simulator = make_propagator(MONTE_CARLO, samples=1)
    carry = simulator.init(scene, Belief.exact(mean, scene.moving))
    marks = [whole(step, scene.dt) for step in range(1, steps + 1)]
    states = np.stack([mean, *(at.states[0] for at in simulator.advance_through(carry, scene, marks))])
    lost = np.flatnonzero(~np.isfinite(states).all(axis=(1, 2)))
    return states[: lost[0] + 1] if len(lost) else states


def rollout_rows(method: str, scene: Scene, states: np.ndarray) -> list[Row]:
    """Return the conservation errors of a rollout, given by its `trajectory`.

    The gain is the largest during the rollout, over the initial energy plus the work of gravity. Energy in
    contacts counts at the start only, so that it never appears as a gain. Without friction and with elastic
    contacts, ``energy_change`` is the change at the end, contacts included. Where momentum is conserved,
    ``momentum_error`` is its largest error over the largest sum of the bodies' momenta. ``drift`` is the
    largest mean speed of a body over the last quarter, in scenes with friction.
    """
    finite = np.isfinite(states).all(axis=(1, 2))
    rows = [Row(method, FINITE, "1", float(finite.all()))]
    states = states[finite]
    times = np.arange(len(states)) * scene.dt
    with np.errstate(over="ignore", invalid="ignore"):
        height = height_energy(scene, states)
        total, stored = height + kinetic_energy(scene, states), contact_energy(scene, states[0])
        rows.append(Row(method, GAIN, "1", _gain(scene, total, height, stored)))
        if _lossless(scene):
            change = total[-1] + contact_energy(scene, states[-1]) - total[0] - stored
            rows.append(Row(method, CHANGE, "1", float(change / _scale(scene, total, height, stored))))
        rows += _momentum_rows(method, scene, states, times)
        rows.append(Row(method, PASSED, "1", float(passed_through(scene, states))))
    last = len(states) // 4
    if scene.materials.friction.any() and last:
        moved = np.linalg.norm(
            states[-1, scene.moving, POSITION] - states[-1 - last, scene.moving, POSITION], axis=-1
        )
        rows.append(Row(method, DRIFT, "m/s", float(moved.max() / (last * scene.dt))))
    return rows


def mean_gain(scene: Scene, rollouts: Iterable[np.ndarray]) -> float:
    """Return the gain of `rollout_rows` in the mean energy of rollouts, whose states (N, B, 13) are given."""
    height, total, stored = [], [], None
    for states in rollouts:
        if stored is None:
            stored = float(np.mean([contact_energy(scene, state) for state in states]))
        height.append(height_energy(scene, states).mean())
        total.append(height[-1] + kinetic_energy(scene, states).mean())
    return _gain(scene, np.array(total), np.array(height), stored)


def _lossless(scene):
    """Return whether the scene conserves energy."""
    friction, restitution = scene.materials
    return scene.damping == 0.0 and not friction.any() and (restitution == 1.0).all()


def _gain(scene, total, height, stored):
    return float(max(np.max(total - total[0] - stored) / _scale(scene, total, height, stored), 0.0))


def _scale(scene, total, height, stored):
    """Return the initial energy plus the work of gravity [J]."""
    bodies = [scene.bodies[k] for k in scene.moving]
    lifting = (
        LIFT * np.linalg.norm(scene.gravity) * sum(body.mass * body.model.bounding_radius for body in bodies)
    )
    return max(total[0] - height[0] + stored + max(height[0] - np.min(height), 0.0), lifting, 1e-300)


def _momentum_rows(method, scene, states, times):
    if scene.environment or scene.damping or any(body.fixed for body in scene.bodies):
        return []
    mass = np.array([body.mass for body in scene.bodies])
    expected = momentum(scene, states[0]) + mass.sum() * times[:, None] * scene.gravity
    error = np.linalg.norm(momentum(scene, states) - expected, axis=-1).max()
    size = (np.linalg.norm(states[:, :, VELOCITY], axis=-1) @ mass).max()
    return [Row(method, MOMENTUM, "1", float(error / max(size, 1e-300)))]
