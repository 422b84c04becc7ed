"""Rollouts of a scene in PyBullet and in MuJoCo: the same spheres, masses, inertias, states, damping and time step.

Both engines get what is fastest for them among the settings under which the bodies collide as ours do: no friction,
elastic contact, damping of all velocities as in the scene, no gravity, no sleeping, no rendering. Bodies are given
in their principal axes, in which both engines keep the inertia.
"""

from __future__ import annotations

import math
import tempfile
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from unc_physics.layout import ANGULAR_VELOCITY, POSITION, QUATERNION, VELOCITY

_FRICTIONLESS = 1  # MuJoCo's condim


class PrincipalBody:
    """A body's spheres and inertia in its principal axes.

    Attributes
    ----------
    centers : (n, 3) array
        [m]
    radii : (n,) array
        [m]
    inertia : (3,) array
        Principal moments [kg m^2].
    axes : Rotation
        From principal axes to the body frame.
    """

    def __init__(self, body):
        moments, axes = np.linalg.eigh(body.model.inertia)
        axes[:, 2] *= np.linalg.det(axes)
        self.mass, self.name = body.mass, body.name
        self.inertia = body.mass * moments
        self.centers, self.radii = body.model.centers @ axes, body.model.radii
        self.axes = Rotation.from_matrix(axes)

    def orientation(self, state):
        """Rotation from principal axes to the world, of one body's state (13,)."""
        return Rotation.from_quat(state[QUATERNION]) * self.axes

    def state(self, position, velocity, rotation, angular_velocity):
        """One body's state (13,) from what an engine says about the principal axes."""
        return np.concatenate([position, velocity, (rotation * self.axes.inv()).as_quat(), angular_velocity])


class PyBulletRollouts:
    """Rollouts in PyBullet.

    Notes
    -----
    Bodies come from URDF text, because ``createCollisionShapeArray`` keeps 16 spheres and says nothing. As
    bodies in maximal coordinates they take the solver for free bodies; the other one, for articulated bodies, is no
    faster and gains energy with elastic contacts.
    """

    def __init__(self, scene):
        import pybullet
        from pybullet_utils.bullet_client import BulletClient

        self._scene = scene
        self._bodies = [PrincipalBody(body) for body in scene.bodies]
        self._client = client = BulletClient(connection_mode=pybullet.DIRECT)
        client.setPhysicsEngineParameter(fixedTimeStep=scene.dt, numSubSteps=0, restitutionVelocityThreshold=0.0)
        client.setGravity(0.0, 0.0, 0.0)
        # Bullet keeps the share 1 - d of a velocity in a second, we exp(-damping)
        damping = 1.0 - math.exp(-scene.damping)
        self._handles, self._spheres = [], []
        with tempfile.TemporaryDirectory() as folder:
            for body in self._bodies:
                path = Path(folder) / f"{body.name}.urdf"
                path.write_text(_urdf(body))
                probe = client.loadURDF(str(path))  # PyBullet tells the shapes of bodies in minimal coordinates only
                self._spheres.append(len(client.getCollisionShapeData(probe, -1)))
                client.removeBody(probe)
                handle = client.loadURDF(
                    str(path), flags=pybullet.URDF_USE_INERTIA_FROM_FILE, useMaximalCoordinates=True
                )
                client.changeDynamics(
                    handle, -1, linearDamping=damping, angularDamping=damping, lateralFriction=0.0,
                    restitution=1.0, contactProcessingThreshold=0.0,
                )
                self._handles.append(handle)

    def spheres(self):
        """Number of spheres of each body, as the engine has them."""
        return self._spheres

    def _reset(self, state):
        for body, handle, x in zip(self._bodies, self._handles, state, strict=True):
            self._client.resetBasePositionAndOrientation(handle, x[POSITION].tolist(), body.orientation(x).as_quat().tolist())
            self._client.resetBaseVelocity(handle, x[VELOCITY].tolist(), x[ANGULAR_VELOCITY].tolist())

    def _state(self):
        states = []
        for body, handle in zip(self._bodies, self._handles, strict=True):
            position, q = self._client.getBasePositionAndOrientation(handle)
            velocity, spin = self._client.getBaseVelocity(handle)
            states.append(body.state(position, velocity, Rotation.from_quat(q), spin))
        return np.array(states)

    def run(self, state, steps):
        """The state (B, 13) after ``steps`` steps from ``state``."""
        self._reset(state)
        step = self._client.stepSimulation
        for _ in range(steps):
            step()
        return self._state()

    def contacts(self, state, steps):
        """Number of contacts with overlap in each step (steps,)."""
        self._reset(state)
        counts = np.zeros(steps, int)
        for k in range(steps):
            self._client.stepSimulation()
            counts[k] = sum(point[8] < 0.0 for point in self._client.getContactPoints())
        return counts

    def close(self):
        """Leave the engine."""
        self._client.disconnect()


def _urdf(body):
    spheres = "\n".join(  # on lines of their own: PyBullet cuts long lines
        f'<collision><origin xyz="{x!r} {y!r} {z!r}"/><geometry><sphere radius="{r!r}"/></geometry></collision>'
        for (x, y, z), r in zip(body.centers.tolist(), body.radii.tolist(), strict=True)
    )
    a, b, c = body.inertia.tolist()
    inertia = f'<inertia ixx="{a!r}" iyy="{b!r}" izz="{c!r}" ixy="0" ixz="0" iyz="0"/>'
    return (
        f'<robot name="{body.name}"><link name="body"><inertial><mass value="{body.mass!r}"/>{inertia}</inertial>'
        f"\n{spheres}\n</link></robot>\n"
    )


class MuJoCoRollouts:
    """Rollouts in MuJoCo: free bodies of sphere geoms, all steps in one call.

    Notes
    -----
    Contacts are springs without damper, so they are elastic; its solver shares the mass among the contacts.
    """

    def __init__(self, scene):
        import mujoco

        self._mujoco = mujoco
        self._bodies = [PrincipalBody(body) for body in scene.bodies]
        model = mujoco.MjModel.from_xml_string(_mjcf(scene, self._bodies))
        for k, body in enumerate(self._bodies):
            model.dof_damping[6 * k : 6 * k + 3] = scene.damping * body.mass
            model.dof_damping[6 * k + 3 : 6 * k + 6] = scene.damping * body.inertia
        self._model, self._data = model, mujoco.MjData(model)

    def spheres(self):
        """Number of spheres of each body, as the engine has them."""
        return self._model.body_geomnum[1:].tolist()

    def _reset(self, state):
        data = self._data
        self._mujoco.mj_resetData(self._model, data)
        for k, (body, x) in enumerate(zip(self._bodies, state, strict=True)):
            rotation = body.orientation(x)
            data.qpos[7 * k : 7 * k + 3] = x[POSITION]
            data.qpos[7 * k + 3 : 7 * k + 7] = rotation.as_quat()[[3, 0, 1, 2]]
            data.qvel[6 * k : 6 * k + 3] = x[VELOCITY]
            data.qvel[6 * k + 3 : 6 * k + 6] = rotation.inv().apply(x[ANGULAR_VELOCITY])

    def _state(self):
        states = []
        for k, body in enumerate(self._bodies):
            rotation = Rotation.from_quat(self._data.qpos[7 * k + 3 : 7 * k + 7][[1, 2, 3, 0]])
            position, velocity = self._data.qpos[7 * k : 7 * k + 3], self._data.qvel[6 * k : 6 * k + 3]
            spin = rotation.apply(self._data.qvel[6 * k + 3 : 6 * k + 6])
            states.append(body.state(position, velocity, rotation, spin))
        return np.array(states)

    def run(self, state, steps):
        """The state (B, 13) after ``steps`` steps from ``state``."""
        self._reset(state)
        self._mujoco.mj_step(self._model, self._data, nstep=steps)
        return self._state()

    def contacts(self, state, steps):
        """Number of contacts with overlap in each step (steps,)."""
        self._reset(state)
        counts = np.zeros(steps, int)
        for k in range(steps):
            self._mujoco.mj_step(self._model, self._data)
            counts[k] = np.count_nonzero(self._data.contact.dist < 0.0)
        return counts

    def close(self):
        """Leave the engine; nothing to do."""


def _mjcf(scene, bodies):
    text = []
    for body in bodies:
        geoms = "".join(
            f'<geom size="{r!r}" pos="{x!r} {y!r} {z!r}"/>'
            for (x, y, z), r in zip(body.centers.tolist(), body.radii.tolist(), strict=True)
        )
        inertia = " ".join(repr(value) for value in body.inertia.tolist())
        inertial = f'<inertial pos="0 0 0" mass="{body.mass!r}" diaginertia="{inertia}"/>'
        text.append(f'<body name="{body.name}"><joint type="free"/>{inertial}{geoms}</body>')
    return (
        f'<mujoco><option timestep="{scene.dt!r}" gravity="0 0 0"/><size memory="256M"/>'
        f'<default><geom type="sphere" condim="{_FRICTIONLESS}" mass="0" solref="-1000 0"/></default>'
        f'<worldbody>{"".join(text)}</worldbody></mujoco>'
    )


PEERS = {"pybullet": PyBulletRollouts, "mujoco": MuJoCoRollouts}
