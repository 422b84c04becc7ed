"""Recorded pushes in other engines: a block of walls and feet on a table, and a pusher on its path.

Masses, inertias, frictions of each pair and initial states are ours. Before each step the pusher is put where
its path says. In MuJoCo it is a mocap body; contacts take it to stand still, so its velocity is given as that
of its surface. In PyBullet it is a body without mass whose velocity is set.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Mapping, Sequence
from functools import cache
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from unc_physics.scene.kinematic_states import path_states
from unc_physics.scene.scene import Scene
from unc_physics.spatial.layout import ANGULAR_VELOCITY, POSITION, QUATERNION, VELOCITY

from .engines import PrincipalBody, bullet_states, mujoco_fixed, mujoco_quaternion, text_of, urdf, urdf_place
from .recorded_pushes import EDGE, FOOT, HEIGHT, Push, edges, feet_of, planar, recorded_pushes


class Shape(NamedTuple):
    """A box or a sphere of a body.

    Attributes
    ----------
    size : tuple of float
        A box's sides, or a sphere's radius [m].
    place : (3,) array
        In the body's frame [m].
    turned : Rotation
        From the shape's axes to the body's.
    """

    size: tuple[float, ...]
    place: np.ndarray
    turned: Rotation = Rotation.identity()

    @property
    def kind(self) -> str:
        """Name of the shape in both engines."""
        return "sphere" if len(self.size) == 1 else "box"


class Settings(NamedTuple):
    """Settings of an engine.

    Attributes
    ----------
    dt : float
        [s]
    iterations : int
        Iterations of PyBullet's solver in a step.
    contact_time : float
        Time constant of MuJoCo's contacts [s].
    firm_friction : float
        Ratio of the stiffness of friction to that of contacts in MuJoCo (``impratio``).
    """

    dt: float
    iterations: int = 50
    contact_time: float = 0.02
    firm_friction: float = 1.0


#: What engines do unless told otherwise, and what is fine enough for slow pushes.
OWN = {"mujoco": Settings(0.002), "pybullet": Settings(1.0 / 240.0)}
FINE = {
    "mujoco": Settings(0.001, contact_time=0.002, firm_friction=100.0),
    "pybullet": Settings(0.001, iterations=200),
}


def pushed_in(engine: str, settings: Settings, push: Push, support: int) -> np.ndarray:
    """Return the block's final pose (3,) after a push in an engine, on some of its feet, as `planar`."""
    pusher = push.scene.bodies[1].model
    shapes = {
        "block": block_shapes(support),
        "pusher": [Shape((r,), c) for c, r in zip(pusher.centers, pusher.radii.tolist(), strict=True)],
    }
    return planar(run_in(engine, settings, push.scene, shapes, push.belief.mean, push.horizon)[0])


def block_shapes(support: int) -> list[Shape]:
    """Return the shapes of our block: boxes as thick as our spheres' radius along its edges, and its feet."""
    pushes = recorded_pushes()
    low, shapes = -0.5 * pushes.height, []
    for a, along, inward, length, margin in edges():
        middle = a + 0.5 * length * along + 0.5 * EDGE * inward - pushes.com
        turned = Rotation.from_rotvec([0.0, 0.0, math.atan2(along[1], along[0])])
        place = np.array([*middle, low + HEIGHT])
        shapes.append(Shape((length - 2.0 * margin, EDGE, 2.0 * EDGE), place, turned))
    feet = feet_of(support) - pushes.com
    return shapes + [Shape((FOOT,), np.array([*foot, low + FOOT])) for foot in feet]


def run_in(
    engine: str,
    settings: Settings,
    scene: Scene,
    shapes: Mapping[str, Sequence[Shape]],
    start: np.ndarray,
    horizon: float,
) -> np.ndarray:
    """Return the states (B, 13) of free and prescribed bodies at the horizon [s], from those at the start.

    Bodies that are not free never touch each other or the environment.
    """
    bodies = [PrincipalBody(body) for body in scene.bodies]
    own = [
        [
            shape._replace(
                place=one.axes.inv().apply(np.array(shape.place)), turned=one.axes.inv() * shape.turned
            )
            for shape in shapes[body.name]
        ]
        for body, one in zip(scene.bodies, bodies, strict=True)
    ]
    steps = round(horizon / settings.dt)
    times = settings.dt * np.arange(steps + 1)
    prescribed = {
        k: _motions(bodies[k], path_states(scene, k, times))
        for k, body in enumerate(scene.bodies)
        if not body.free
    }
    made = {"mujoco": _MuJoCo, "pybullet": _PyBullet}[engine](scene, settings, bodies, own)
    for k, (body, state) in enumerate(zip(bodies, start, strict=True)):
        made.put(k, _motions(body, state[None])[0])
    for step in range(steps + 1):
        for k, motions in prescribed.items():
            made.put(k, motions[step])
        if step < steps:
            made.step()
    return made.states()


class _Motion(NamedTuple):
    """Motion of a body's principal axes: place, quaternion (x, y, z, w), velocities in world and own axes."""

    place: np.ndarray
    q: np.ndarray
    velocity: np.ndarray
    spin: np.ndarray
    own_velocity: np.ndarray
    own_spin: np.ndarray


def _motions(body, states):
    """Return the motion of the principal axes in each of a body's states (n, 13)."""
    states = np.array(states)
    velocity, spin = states[:, VELOCITY], states[:, ANGULAR_VELOCITY]
    turned = Rotation.from_quat(states[:, QUATERNION]) * body.axes
    back = turned.inv()
    columns = states[:, POSITION], turned.as_quat(), velocity, spin, back.apply(velocity), back.apply(spin)
    return [_Motion(*row) for row in zip(*columns, strict=True)]


def _friction(scene, partner):
    return scene.friction if partner.friction is None else partner.friction


class _MuJoCo:
    """Scene in MuJoCo: elliptic cones, Newton's method, and the friction of each pair of shapes."""

    def __init__(self, scene, settings, bodies, shapes):
        import mujoco

        self._mujoco, self._bodies, self._shapes = mujoco, bodies, shapes
        text, geoms = [], []  # of geoms: whether they are free, body, and friction
        for k, (body, one) in enumerate(zip(scene.bodies, bodies, strict=True)):
            moments = text_of(one.inertia)
            head = f'<freejoint/><inertial pos="0 0 0" mass="{one.mass!r}" diaginertia="{moments}"/>'
            inner = "".join(
                _geom(f"g{len(geoms) + n}", shape, body.free) for n, shape in enumerate(shapes[k])
            )
            geoms += [(body.free, k, _friction(scene, body))] * len(shapes[k])
            text.append(f"<body>{head}{inner}</body>" if body.free else f'<body mocap="true">{inner}</body>')
        for solid in scene.environment:
            text.append(mujoco_fixed(solid, f"g{len(geoms)}"))
            geoms.append((False, -1, _friction(scene, solid)))
        pairs = [
            f'<pair geom1="g{i}" geom2="g{j}" condim="3" friction="{mu!r} {mu!r} 0 0 0"'
            f' solref="{settings.contact_time!r} 1"/>'
            for (i, (free_i, a, p)), (j, (free_j, b, q)) in combinations(enumerate(geoms), 2)
            if a != b and (free_i or free_j)
            for mu in [max(math.sqrt(p * q), 1e-5)]
        ]
        self._model = model = mujoco.MjModel.from_xml_string(
            f'<mujoco><option cone="elliptic" tolerance="1e-10" gravity="{text_of(scene.gravity)}"'
            f' timestep="{settings.dt!r}" impratio="{settings.firm_friction!r}"/>'
            '<default><geom contype="0" conaffinity="0" mass="0"/></default>'
            f"<worldbody>{''.join(text)}</worldbody><contact>{''.join(pairs)}</contact></mujoco>"
        )
        self._data = mujoco.MjData(model)
        free = [k for k, body in enumerate(scene.bodies) if body.free]
        self._joint = {k: n for n, k in enumerate(free)}
        self._mocap = {k: n for n, k in enumerate(set(range(len(bodies))) - set(free))}
        names = iter(f"g{n}" for n in range(len(geoms)))  # MuJoCo orders geoms by their bodies
        self._geoms = [
            [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, next(names)) for _ in own] for own in shapes
        ]
        for k, n in self._joint.items():
            damping = [bodies[k].mass] * 3 + bodies[k].inertia.tolist()
            model.dof_damping[6 * n : 6 * n + 6] = scene.damping * np.array(damping)

    def put(self, k, motion):
        data, (x, y, z, w) = self._data, motion.q
        if k in self._joint:
            at = self._joint[k]
            data.qpos[7 * at : 7 * at + 7] = [*motion.place, w, x, y, z]
            data.qvel[6 * at : 6 * at + 6] = [*motion.velocity, *motion.own_spin]
            return
        at = self._mocap[k]
        data.mocap_pos[at], data.mocap_quat[at] = motion.place, (w, x, y, z)
        for geom, shape in zip(self._geoms[k], self._shapes[k], strict=True):
            turned = shape.turned.inv()
            velocity = motion.own_velocity + np.cross(motion.own_spin, shape.place)
            self._model.geom_surfacevel[geom] = [*turned.apply(velocity), *turned.apply(motion.own_spin)]

    def step(self):
        self._mujoco.mj_step(self._model, self._data)

    def states(self):
        found, data = np.zeros((len(self._bodies), 13)), self._data
        for k, body in enumerate(self._bodies):
            if k in self._joint:
                at = self._joint[k]
                place, q = data.qpos[7 * at : 7 * at + 3], data.qpos[7 * at + 3 : 7 * at + 7]
                velocity, spin = data.qvel[6 * at : 6 * at + 3], data.qvel[6 * at + 3 : 6 * at + 6]
            else:
                place, q = data.mocap_pos[self._mocap[k]], data.mocap_quat[self._mocap[k]]
                velocity = spin = np.zeros(3)
            rotation = Rotation.from_quat(q[[1, 2, 3, 0]])
            found[k] = body.state(place, velocity, rotation, rotation.apply(spin))
        return found


def _geom(name, shape, is_free):
    size = shape.size if shape.kind == "sphere" else [0.5 * side for side in shape.size]
    return (
        f'<geom name="{name}" type="{shape.kind}" size="{text_of(size)}" pos="{text_of(shape.place)}"'
        f' quat="{mujoco_quaternion(shape.turned)}" surfacevel="{0 if is_free else 1} 0 0"/>'
    )


class _PyBullet:
    """Scene in PyBullet.

    Free bodies have maximal coordinates. Prescribed bodies are massless and have minimal coordinates, so that
    contacts use their velocity.
    """

    def __init__(self, scene, settings, bodies, shapes):
        import pybullet

        self._bodies, self._handles = bodies, []
        self._client = client = _bullet()
        client.resetSimulation()
        client.setPhysicsEngineParameter(
            fixedTimeStep=settings.dt,
            numSolverIterations=settings.iterations,
            restitutionVelocityThreshold=0.0,
        )
        client.setGravity(*scene.gravity.tolist())
        damping, restitution = 1.0 - math.exp(-scene.damping), math.sqrt(scene.restitution or 0.0)
        with tempfile.TemporaryDirectory() as folder:
            for k, (body, one) in enumerate(zip(scene.bodies, bodies, strict=True)):
                path = Path(folder) / f"{k}.urdf"
                collisions = [
                    (urdf_place(shape.place, shape.turned), _urdf_shape(shape)) for shape in shapes[k]
                ]
                mass, inertia = (one.mass, one.inertia) if body.free else (0.0, np.zeros(3))
                path.write_text(urdf(body.name, mass, inertia, collisions))
                handle = client.loadURDF(
                    str(path), flags=pybullet.URDF_USE_INERTIA_FROM_FILE, useMaximalCoordinates=body.free
                )
                client.changeDynamics(handle, -1, linearDamping=damping, angularDamping=damping)
                self._handles.append(handle)
        solids = []
        for solid in scene.environment:
            shape = client.createCollisionShape(client.GEOM_PLANE, planeNormal=solid.normal.tolist())
            solids.append(client.createMultiBody(0.0, shape, basePosition=solid.position.tolist()))
        partners = (*scene.bodies, *scene.environment)
        for handle, partner in zip((*self._handles, *solids), partners, strict=True):
            friction = math.sqrt(_friction(scene, partner))  # PyBullet multiplies those of touching bodies
            client.changeDynamics(handle, -1, lateralFriction=friction, restitution=restitution)
        for a, b in combinations(range(len(bodies)), 2):
            if not (scene.bodies[a].free or scene.bodies[b].free):
                client.setCollisionFilterPair(self._handles[a], self._handles[b], -1, -1, 0)

    def put(self, k, motion):
        client, handle = self._client, self._handles[k]
        client.resetBasePositionAndOrientation(handle, motion.place.tolist(), motion.q.tolist())
        client.resetBaseVelocity(handle, motion.velocity.tolist(), motion.spin.tolist())

    def step(self):
        self._client.stepSimulation()

    def states(self):
        return bullet_states(self._client, self._bodies, self._handles)


def _urdf_shape(shape):
    size = text_of(shape.size)
    return f'<sphere radius="{size}"/>' if shape.kind == "sphere" else f'<box size="{size}"/>'


@cache
def _bullet():
    """Return the only PyBullet client of this process for pushes; each new one would print a line."""
    import pybullet
    from pybullet_utils.bullet_client import BulletClient

    return BulletClient(connection_mode=pybullet.DIRECT)
