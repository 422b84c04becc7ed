"""A thrown body in other engines, with uncertain friction, table tilt and impacts as in unc_physics.

Engines have no errors of impacts, so what a step's contacts gave to the momentum is changed after it: turned,
made to act elsewhere, and its part along the table multiplied, by the laws of `physics.impact_error`; less,
where energy would be gained. MuJoCo's contacts are soft and share an impact among steps, each of which is
changed by itself.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from unc_physics.scene.belief import Belief
from unc_physics.scene.scene import Scene
from unc_physics.spatial.layout import QUATERNION
from unc_physics.spatial.rotation import rotation_matrix

from .engines import MuJoCoRollouts, PyBulletRollouts

IMPACT = 0.1  # m/s in one step; what is slower is no impact, as in ours
_HALVINGS = 5  # of an error that would add energy


class _PyBullet(PyBulletRollouts):
    """One body in PyBullet."""

    def begin(self, state):
        super().begin(state)
        self.step_singly()

    def material(self, friction, restitution):
        for handle in range(self._client.getNumBodies()):
            self._client.changeDynamics(
                handle, -1, lateralFriction=math.sqrt(friction), restitution=math.sqrt(restitution)
            )

    def gravity(self, value):
        self._client.setGravity(*value)

    def velocity(self):
        """Return the velocity in world axes and the angular velocity in the engine's axes, six numbers."""
        velocity, spin = self._client.getBaseVelocity(self._handles[0])
        return *velocity, *spin

    def middle(self):
        return self._client.getBasePositionAndOrientation(self._handles[0])[0]

    def own_axes(self, vector):
        """Transform a vector from world axes to the axes of `velocity`'s angular part."""
        return vector

    def world_axes(self, vector):
        """Transform a vector from the axes of `velocity`'s angular part to world axes."""
        return vector

    def set_velocity(self, six):
        self._client.resetBaseVelocity(self._handles[0], six[:3], six[3:])

    def contact(self):
        """Return the mean position of the contacts (3,), weighted by forces; None without contacts."""
        points = self._client.getContactPoints(self._handles[0])
        force = np.array([point[9] for point in points])
        if not force.sum() > 0.0:
            return None
        return (force @ np.array([point[5] for point in points]) / force.sum()).tolist()


class _MuJoCo(MuJoCoRollouts):
    """One body in MuJoCo; the damping of its contacts gives the restitution of a linear spring."""

    def __init__(self, scene):
        super().__init__(scene)
        self.set_restitution(scene.restitution or 0.0)

    def material(self, friction, restitution):
        self._model.geom_friction[:, 0] = friction
        self.set_restitution(restitution)

    def gravity(self, value):
        self._model.opt.gravity[:] = value

    def velocity(self):
        return self._data.qvel.tolist()

    def middle(self):
        return self._data.qpos[:3].tolist()

    def own_axes(self, vector):
        w, *axis = self._data.qpos[3:7].tolist()
        return _turned(vector, [-value for value in axis], w)

    def world_axes(self, vector):
        w, *axis = self._data.qpos[3:7].tolist()
        return _turned(vector, axis, w)

    def set_velocity(self, six):
        self._data.qvel[:] = six

    def contact(self):
        """Return the mean position of the contacts (3,), weighted by depths; None without contacts."""
        depth = np.maximum(-self._data.contact.dist, 0.0)
        return (depth @ self._data.contact.pos / depth.sum()).tolist() if depth.any() else None


class RecordedEngine:
    """Predictor of recorded motions in another engine, like `calibration.objective.simulated`.

    Parameters
    ----------
    name : {'pybullet', 'mujoco'}

    Notes
    -----
    The body has the same spheres, draws have the same seeds, and starts are drawn by unc_physics.
    """

    def __init__(self, name: str):
        self._make = {"pybullet": _PyBullet, "mujoco": _MuJoCo}[name]
        self._scene, self._engine = None, None

    def __call__(
        self, scene: Scene, belief: Belief, times: Sequence[float], samples: int, seed: int
    ) -> list[np.ndarray]:
        """Return the states (n, 13) at each time."""
        engine = self._of(scene)
        starts = belief.sample(samples, np.random.default_rng(seed))
        marks = [round(time / scene.dt) for time in times]
        found = np.empty((len(marks), samples, 13))
        friction, restitution, table = scene.friction or 0.0, scene.restitution or 0.0, scene.environment[0]
        for n, start in enumerate(starts):
            rng = np.random.default_rng([seed, n, 2])
            spread, *tilt, bounce = rng.standard_normal(4)
            if scene.friction_std or scene.restitution_std:
                engine.material(
                    friction * math.exp(spread * scene.friction_std / friction),
                    min(max(restitution + bounce * scene.restitution_std, 0.0), 1.0),
                )
            gravity = np.array(scene.gravity)  # SciPy takes none that is read-only
            if table.surface_tilt_std:  # to tilt gravity is the same but for where things lie by a sine
                turn = [*(table.surface_tilt_std * np.array(tilt)), 0.0]
                gravity = Rotation.from_rotvec(turn).apply(gravity)
                engine.gravity(gravity.tolist())
            engine.begin(start)
            done = 0
            for k, mark in enumerate(marks):
                if scene.draws_impacts:
                    self._disturbed(engine, scene, gravity, mark - done, rng)
                else:
                    engine.advance(mark - done)
                done = mark
                found[k, n] = engine.state()[0]
        return list(found)

    def close(self) -> None:
        """Leave the engine."""
        if self._engine is not None:
            self._engine.close()
        self._scene = self._engine = None

    def _of(self, scene) -> Any:
        if self._scene is not scene:
            self.close()
            self._scene, self._engine = scene, self._make(scene)
        return self._engine

    def _disturbed(self, engine, scene, gravity, steps, rng):
        """Take steps with errors of impacts."""
        gx, gy, gz = (gravity * scene.dt).tolist()
        before = engine.velocity()
        for _ in range(steps):
            touches = engine.step()
            after = engine.velocity()
            u, v, w = after[0] - before[0] - gx, after[1] - before[1] - gy, after[2] - before[2] - gz
            if touches and abs(u) + abs(v) + abs(w) > IMPACT and math.sqrt(u * u + v * v + w * w) > IMPACT:
                after = self._changed(engine, scene, before, after, [u, v, w], rng)
            before = after

    def _changed(self, engine, scene, before, after, given, rng):
        """Set and return the velocities, six numbers, after an impact with an error.

        ``before`` and ``after`` are the velocities around the impact; ``given`` is its change of velocity.
        It computes with Python floats, because each sample calls it some twenty times.
        """
        point = engine.contact()
        if point is None:
            return after
        arm = [p - q for p, q in zip(point, engine.middle(), strict=True)]
        R = rotation_matrix(engine.state()[0, QUATERNION])
        inertia = R @ scene.bodies[0].unit_inertia @ R.T
        inverse = np.linalg.inv(inertia)
        x, y, z, u, v, f = rng.standard_normal(6).tolist()
        d, s = scene.impact_direction_std, scene.impact_point_std
        energy = _energy(engine, before, inertia)
        was = _cross(arm, given)
        for k in range(_HALVINGS):
            part = 0.5**k
            a, b, c = part * d * x, part * d * y, part * d * z
            angle = math.sqrt(a * a + b * b + c * c)
            half = 0.5 * math.sin(0.5 * angle) / (0.5 * angle) if angle > 0.0 else 0.5
            other = _turned(given, [half * a, half * b, half * c], math.cos(0.5 * angle))
            factor = math.exp(part * scene.impact_friction_std * f)
            other = [factor * other[0], factor * other[1], other[2]]
            twist = _cross([arm[0] + part * s * u, arm[1] + part * s * v, arm[2]], other)
            spun = engine.own_axes((inverse @ np.subtract(twist, was)).tolist())
            change = [*(p - q for p, q in zip(other, given, strict=True)), *spun]
            six = [p + q for p, q in zip(after, change, strict=True)]
            if _energy(engine, six, inertia) <= energy:
                engine.set_velocity(six)
                return six
        return after


def _energy(engine, six, inertia):
    spin = np.array(engine.world_axes(six[3:]))
    return sum(value * value for value in six[:3]) + float(spin @ inertia @ spin)


def _cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def _turned(vector, axis, w):
    """Rotate a vector by a quaternion, given by its vector and scalar parts."""
    turned = [2.0 * value for value in _cross(axis, vector)]
    more = _cross(axis, turned)
    return [p + w * q + r for p, q, r in zip(vector, turned, more, strict=True)]
