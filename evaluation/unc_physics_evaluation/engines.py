"""Rollouts of a scene in PyBullet and MuJoCo.

Masses, inertias, states, damping, environment and time step are the scene's. Bodies are given in their
principal axes, in which both engines store the inertia.

Shapes are the scene's spheres ("spheres"), the usual ones of these engines ("primitive"), or given. A model
that is a box or a cylinder has that shape as a primitive, and any other model has convex pieces. In a scene
without friction both engines have elastic contacts without friction, with their fastest settings. In a scene
with friction they have their own contact laws and default settings. Bodies sleep if the scene allows it, and
there is no rendering. All steps run in one call.

With `Settings`, contacts have the friction of their pair of surfaces, and bodies can follow their paths.
Before each step they are put where the path says. In MuJoCo such a body is a mocap body; contacts take it to
stand still, so its velocity is given as that of its surface. In PyBullet it is a body without mass whose
velocity is set.
"""

from __future__ import annotations

import math
import tempfile
import warnings
from collections.abc import Mapping, Sequence
from functools import singledispatch
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.cluster.vq import kmeans2
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from unc_physics.checks.errors import NotSupportedError
from unc_physics.scene.environment import Box, Capsule, Cylinder, Plane, Sphere
from unc_physics.scene.kinematic_states import path_states
from unc_physics.scene.scene import Scene
from unc_physics.spatial.layout import ANGULAR_VELOCITY, POSITION, QUATERNION, VELOCITY

#: Shapes of the models that are one primitive.
PRIMITIVES = {"salt_box": "box", "can": "cylinder", "cube": "box", "block": "box"}
PIECES = 16  # convex ones of a body
_DIRECTIONS = 64  # of a piece's support points, and so the largest number of its vertices
_TIME_CONSTANT = 0.02  # s, of MuJoCo's contacts by default
_LEAST_FRICTION = 1e-5  # that MuJoCo takes


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
    contact_time: float = _TIME_CONSTANT
    firm_friction: float = 1.0


#: What engines do unless told otherwise, and what is fine enough for slow pushes.
OWN = {"mujoco": Settings(0.002), "pybullet": Settings(1.0 / 240.0)}
FINE = {
    "mujoco": Settings(0.001, contact_time=0.002, firm_friction=100.0),
    "pybullet": Settings(0.001, iterations=200),
}


class Shape(NamedTuple):
    """A primitive or a convex piece of a body.

    Attributes
    ----------
    kind : {'sphere', 'box', 'cylinder', 'mesh'}
    size : tuple of float
        Radius; sides; radius and length; nothing [m].
    place : (3,) array
        [m]
    turned : Rotation
        From the shape's axes to the body's.
    vertices : (n, 3) array, optional
        Of a mesh [m].
    """

    kind: str
    size: tuple[float, ...]
    place: np.ndarray
    turned: Rotation = Rotation.identity()
    vertices: np.ndarray | None = None


class Motion(NamedTuple):
    """Motion of a body's principal axes: place, quaternion (x, y, z, w), velocities in world and own axes."""

    place: np.ndarray
    q: np.ndarray
    velocity: np.ndarray
    spin: np.ndarray
    own_velocity: np.ndarray
    own_spin: np.ndarray


class PrincipalBody:
    """A body's shapes and inertia in its principal axes.

    Attributes
    ----------
    centers : (n, 3) array
        Of its spheres [m].
    radii : (n,) array
        [m]
    inertia : (3,) array
        Principal moments [kg m^2].
    axes : Rotation
        From principal axes to the body frame.
    free : bool
        Whether the engine moves it. Without settings that is so of prescribed bodies too, which float.
    """

    def __init__(self, body, follows=False):
        moments, axes = np.linalg.eigh(body.unit_inertia)
        axes[:, 2] *= np.linalg.det(axes)
        self.mass, self.name, self._model = body.mass, body.name, body.model
        self.free = body.free or not follows
        self.floats = self.free and body.trajectory is not None
        self.inertia = body.mass * moments
        self.centers, self.radii = body.model.centers @ axes, body.model.radii
        self.axes = Rotation.from_matrix(axes)

    def shapes(self, geometry: str | Mapping[str, Sequence[Shape]]) -> list[Shape]:
        """Return the shapes: spheres, primitives, or those given by the body's name in its own axes."""
        back = self.axes.inv()
        if not isinstance(geometry, str):
            return [
                shape._replace(place=back.apply(np.array(shape.place)), turned=back * shape.turned)
                for shape in geometry[self.name]
            ]
        if geometry == "spheres":
            spheres = zip(self.radii.tolist(), self.centers, strict=True)
            return [Shape("sphere", (radius,), center) for radius, center in spheres]
        if self._model.name not in PRIMITIVES:
            return [Shape("mesh", (), np.zeros(3), vertices=vertices) for vertices in self.pieces()]
        low, high = self._model.bounds
        kind, (x, y, z) = PRIMITIVES[self._model.name], (high - low).tolist()
        size = (x, y, z) if kind == "box" else (x / 2, z)
        return [Shape(kind, size, back.apply(0.5 * (low + high)), back)]

    def pieces(self):
        """Return the vertices (k, 3) of the hulls of clusters of spheres, like a convex decomposition [m]."""
        _, cluster = kmeans2(
            self.centers, min(PIECES, len(self.centers)), minit="++", rng=np.random.default_rng(0)
        )
        # support points: where the hull of a cluster's spheres touches planes of evenly spread directions
        height = 1.0 - (2.0 * np.arange(_DIRECTIONS) + 1.0) / _DIRECTIONS
        turn = np.pi * (1.0 + math.sqrt(5.0)) * np.arange(_DIRECTIONS)
        around = np.sqrt(1.0 - height**2)
        directions = np.stack([around * np.cos(turn), around * np.sin(turn), height], axis=1)
        made = []
        for k in np.unique(cluster):
            centers, radii = self.centers[cluster == k], self.radii[cluster == k]
            farthest = np.argmax(centers @ directions.T + radii[:, None], axis=0)
            made.append(centers[farthest] + radii[farthest, None] * directions)
        return made

    def motions(self, states) -> list[Motion]:
        """Return the motion of the principal axes in each of the body's states (n, 13)."""
        states = np.array(states)
        velocity, spin = states[:, VELOCITY], states[:, ANGULAR_VELOCITY]
        turned = Rotation.from_quat(states[:, QUATERNION]) * self.axes
        back = turned.inv()
        columns = (
            states[:, POSITION],
            turned.as_quat(),
            velocity,
            spin,
            back.apply(velocity),
            back.apply(spin),
        )
        return [Motion(*row) for row in zip(*columns, strict=True)]

    def state(self, position, velocity, rotation, angular_velocity):
        """Return one body's state (13,) from an engine's values for the principal axes."""
        return np.concatenate([position, velocity, (rotation * self.axes.inv()).as_quat(), angular_velocity])


class _Engine:
    """What both engines share: bodies and their shapes, and how rollouts run."""

    def __init__(self, scene, geometry, settings):
        self._scene, self._settings = scene, settings
        self._dt = scene.dt if settings is None else settings.dt
        self._bodies = [PrincipalBody(body, settings is not None) for body in scene.bodies]
        self._own = [body.shapes(geometry) for body in self._bodies]

    def begin(self, state):
        """Set the state (B, 13)."""
        for k, (body, x) in enumerate(zip(self._bodies, state, strict=True)):
            self.put(k, body.motions(x[None])[0])

    def run(self, state, steps):
        """The state (B, 13) after ``steps`` steps from ``state``, in one call."""
        self.begin(state)
        self.advance(steps)
        return self.state()

    def follow(self, state, steps):
        """The state (B, 13) after ``steps`` steps, in which bodies that are not free follow their paths."""
        times = self._dt * np.arange(steps + 1)
        prescribed = {
            k: body.motions(path_states(self._scene, k, times))
            for k, body in enumerate(self._bodies)
            if not body.free
        }
        self.begin(state)
        for step in range(steps + 1):
            for k, motions in prescribed.items():
                self.put(k, motions[step])
            if step < steps:
                self.step()
        return self.state()

    def close(self):
        """Leave the engine."""


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
    made = PEERS[engine](scene, shapes, settings)
    try:
        return made.follow(start, round(horizon / settings.dt))
    finally:
        made.close()


def _friction(scene, partner):
    return scene.friction if partner.friction is None else partner.friction


#: PyBullet's clients that are not in use: each new one prints a line.
_CLIENTS: list[Any] = []


class PyBulletRollouts(_Engine):
    """Rollouts in PyBullet.

    Notes
    -----
    Bodies are read from URDF text, because ``createCollisionShapeArray`` silently keeps only 16 spheres.
    Maximal coordinates select the solver for free bodies. The solver for articulated bodies is no faster, and
    gains energy with elastic contacts. Prescribed bodies have minimal coordinates, so that contacts use their
    velocity.
    """

    def __init__(self, scene, geometry="spheres", settings=None):
        import pybullet
        from pybullet_utils.bullet_client import BulletClient

        super().__init__(scene, geometry, settings)
        client = _CLIENTS.pop() if _CLIENTS else BulletClient(connection_mode=pybullet.DIRECT)
        self._client = client
        client.resetSimulation()
        iterations = {} if settings is None else {"numSolverIterations": settings.iterations}
        client.setPhysicsEngineParameter(restitutionVelocityThreshold=0.0, **iterations)
        client.setGravity(*scene.gravity.tolist())
        # Bullet keeps the share 1 - d of a velocity in a second, we exp(-damping)
        damping = 1.0 - math.exp(-scene.damping)
        self._handles, self._counts = [], []
        flags = pybullet.URDF_USE_INERTIA_FROM_FILE | (pybullet.URDF_ENABLE_SLEEPING if scene.sleep else 0)
        with tempfile.TemporaryDirectory() as folder:
            for k, (body, own) in enumerate(zip(self._bodies, self._own, strict=True)):
                path = Path(folder) / f"{k}.urdf"
                path.write_text(_urdf(body, own, Path(folder)))
                if settings is None:  # it tells the shapes of bodies in minimal coordinates only
                    probe = client.loadURDF(str(path))
                    self._counts.append(len(client.getCollisionShapeData(probe, -1)))
                    client.removeBody(probe)
                handle = client.loadURDF(str(path), flags=flags, useMaximalCoordinates=body.free)
                client.changeDynamics(handle, -1, linearDamping=damping, angularDamping=damping)
                self._handles.append(handle)
        solids = [self._fixed(solid) for solid in scene.environment]
        partners = (*scene.bodies, *scene.environment)
        for handle, partner in zip((*self._handles, *solids), partners, strict=True):
            client.changeDynamics(handle, -1, **_bullet_contact(scene, partner))
        for a, b in combinations([k for k, body in enumerate(self._bodies) if not body.free], 2):
            client.setCollisionFilterPair(self._handles[a], self._handles[b], -1, -1, 0)

    def shapes(self):
        """Number of shapes of each body, as the engine has them."""
        return self._counts

    def _fixed(self, solid):
        """Create a fixed body for an element of the environment."""
        shape = self._client.createCollisionShape(**_bullet_shape(solid, self._client))
        place = {"basePosition": solid.position.tolist()}
        if not isinstance(solid, Plane):  # whose shape is given in the world's axes
            place["baseOrientation"] = np.asarray(solid.orientation).tolist()
        return self._client.createMultiBody(0.0, shape, **place)

    def put(self, k, motion):
        """Set the motion of a body."""
        client, handle = self._client, self._handles[k]
        client.resetBasePositionAndOrientation(handle, motion.place.tolist(), motion.q.tolist())
        client.resetBaseVelocity(handle, motion.velocity.tolist(), motion.spin.tolist())

    def advance(self, steps):
        """Take so many steps, in one call: as steps within a longer one."""
        self._client.setPhysicsEngineParameter(fixedTimeStep=steps * self._dt, numSubSteps=steps)
        self._client.stepSimulation()

    def follow(self, state, steps):
        self.step_singly()
        return super().follow(state, steps)

    def step_singly(self):
        """Let each `step` be one by itself."""
        self._client.setPhysicsEngineParameter(fixedTimeStep=self._dt, numSubSteps=0)

    def step(self):
        """Take a step; return whether there may be contacts."""
        self._client.stepSimulation()
        return True

    def state(self):
        """The state (B, 13)."""
        states = []
        for body, handle in zip(self._bodies, self._handles, strict=True):
            position, q = self._client.getBasePositionAndOrientation(handle)
            velocity, spin = self._client.getBaseVelocity(handle)
            states.append(body.state(position, velocity, Rotation.from_quat(q), spin))
        return np.array(states)

    def close(self):
        _CLIENTS.append(self._client)


@singledispatch
def _bullet_shape(solid, client):
    """Return the arguments of PyBullet's shape for an element of the environment."""
    raise _no_shape(solid)


@_bullet_shape.register
def _(solid: Plane, client):
    return {"shapeType": client.GEOM_PLANE, "planeNormal": solid.normal.tolist()}


@_bullet_shape.register
def _(solid: Box, client):
    return {"shapeType": client.GEOM_BOX, "halfExtents": (0.5 * solid.size).tolist()}


@_bullet_shape.register
def _(solid: Sphere, client):
    return {"shapeType": client.GEOM_SPHERE, "radius": solid.radius}


@_bullet_shape.register
def _(solid: Cylinder, client):
    return {"shapeType": client.GEOM_CYLINDER, "radius": solid.radius, "height": solid.length}


@_bullet_shape.register
def _(solid: Capsule, client):
    return {"shapeType": client.GEOM_CAPSULE, "radius": solid.radius, "height": solid.length}


def _no_shape(solid):
    return NotSupportedError("is not known in other engines", field="environment", value=type(solid).__name__)


def _bullet_contact(scene, partner):
    """Return the contact parameters of a surface; Bullet multiplies those of touching bodies."""
    if _friction(scene, partner) is None:
        return {"lateralFriction": 0.0, "restitution": 1.0, "contactProcessingThreshold": 0.0}
    friction = math.sqrt(_friction(scene, partner))
    return {"lateralFriction": friction, "restitution": math.sqrt(scene.restitution or 0.0)}


def _urdf(body, shapes, folder):
    """Return the URDF text of a body with its shapes; meshes are written to a folder."""
    collisions = []  # on lines of their own: PyBullet cuts long lines
    for k, shape in enumerate(shapes):
        if shape.kind == "mesh":
            path = folder / f"{body.name}_{k}.obj"
            path.write_text(_obj(shape.vertices))
            geometry = f'mesh filename="{path}"'
        elif shape.kind == "cylinder":
            geometry = f'cylinder radius="{shape.size[0]!r}" length="{shape.size[1]!r}"'
        else:
            geometry = f'{shape.kind} {"size" if shape.kind == "box" else "radius"}="{text_of(shape.size)}"'
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # at gimbal lock any of the equivalent angles will do
            angles = shape.turned.as_euler("xyz")
        origin = f'<origin xyz="{text_of(shape.place)}" rpy="{text_of(angles)}"/>'
        collisions.append(f"<collision>{origin}<geometry><{geometry}/></geometry></collision>")
    mass, inertia = (body.mass, body.inertia) if body.free else (0.0, np.zeros(3))
    a, b, c = inertia.tolist()
    moments = f'<inertia ixx="{a!r}" iyy="{b!r}" izz="{c!r}" ixy="0" ixz="0" iyz="0"/>'
    inertial = f'<inertial><mass value="{mass!r}"/>{moments}</inertial>'
    lines = f'<robot name="{body.name}"><link name="body">{inertial}', *collisions, "</link></robot>\n"
    return "\n".join(lines)


def _obj(vertices):
    """Return a convex hull as the text of a mesh file."""
    lines = ["v {!r} {!r} {!r}".format(*vertex) for vertex in vertices.tolist()]
    lines += ["f {} {} {}".format(*(corners + 1)) for corners in ConvexHull(vertices).simplices]
    return "\n".join(lines) + "\n"


class MuJoCoRollouts(_Engine):
    """Rollouts in MuJoCo.

    Notes
    -----
    Without friction, contacts are springs without dampers, thus elastic; the solver distributes the mass over
    the contacts. With friction, contacts are MuJoCo's critically damped ones without a coefficient of
    restitution: a cube that falls flat rebounds with 0.12 of its speed at steps of 1/240 s. The friction cone
    is elliptic; MuJoCo's default pyramid has 0.7 of the friction halfway between its axes. With settings,
    each pair of shapes has the geometric mean of their frictions.
    """

    def __init__(self, scene, geometry="spheres", settings=None):
        import mujoco

        super().__init__(scene, geometry, settings)
        self._mujoco = mujoco
        self._model = model = mujoco.MjModel.from_xml_string(_mjcf(scene, self._bodies, self._own, settings))
        free = [k for k, body in enumerate(self._bodies) if body.free]
        self._joint = {k: n for n, k in enumerate(free)}
        self._mocap = {k: n for n, k in enumerate(set(range(len(self._bodies))) - set(free))}
        for k, n in self._joint.items():
            damping = [self._bodies[k].mass] * 3 + self._bodies[k].inertia.tolist()
            model.dof_damping[6 * n : 6 * n + 6] = scene.damping * np.array(damping)
        if scene.sleep:
            model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_SLEEP
        self._data = mujoco.MjData(model)

    def set_restitution(self, value):
        """Give all contacts the damping of a linear spring that returns this share of the speed."""
        log = math.log(max(value, 1e-3))
        self._model.geom_solref[:] = _TIME_CONSTANT, -log / math.hypot(math.pi, log)

    def shapes(self):
        """Number of shapes of each body, as the engine has them."""
        return self._model.body_geomnum[1:].tolist()

    def begin(self, state):
        self._mujoco.mj_resetData(self._model, self._data)
        super().begin(state)

    def put(self, k, motion):
        """Set the motion of a body."""
        data, (x, y, z, w) = self._data, motion.q
        if k in self._joint:
            at = self._joint[k]
            data.qpos[7 * at : 7 * at + 7] = [*motion.place, w, x, y, z]
            data.qvel[6 * at : 6 * at + 6] = [*motion.velocity, *motion.own_spin]
            return
        at = self._mocap[k]
        data.mocap_pos[at], data.mocap_quat[at] = motion.place, (w, x, y, z)
        first = self._model.body_geomadr[1 + k]
        for geom, shape in enumerate(self._own[k], first):
            turned = shape.turned.inv()
            velocity = motion.own_velocity + np.cross(motion.own_spin, shape.place)
            self._model.geom_surfacevel[geom] = [*turned.apply(velocity), *turned.apply(motion.own_spin)]

    def advance(self, steps):
        """Take so many steps, in one call."""
        self._mujoco.mj_step(self._model, self._data, nstep=steps)

    def step(self):
        """Take a step; return whether there may be contacts."""
        self._mujoco.mj_step(self._model, self._data)
        return self._data.ncon > 0

    def state(self):
        """The state (B, 13)."""
        states, data = [], self._data
        for k, body in enumerate(self._bodies):
            if k in self._joint:
                q, v = 7 * self._joint[k], 6 * self._joint[k]
                place, turn = data.qpos[q : q + 3], data.qpos[q + 3 : q + 7]
                velocity, spin = data.qvel[v : v + 3], data.qvel[v + 3 : v + 6]
            else:
                place, turn = data.mocap_pos[self._mocap[k]], data.mocap_quat[self._mocap[k]]
                velocity = spin = np.zeros(3)
            rotation = Rotation.from_quat(turn[[1, 2, 3, 0]])
            states.append(body.state(place, velocity, rotation, rotation.apply(spin)))
        return np.array(states)

    def run_all(self, states, steps):
        """The states (N, B, 13) of free bodies after ``steps`` steps from each of ``states``, in one call."""
        from mujoco import rollout

        nq, count, turned = self._model.nq, len(states), []
        packed = np.zeros((count, 1 + nq + self._model.nv))  # time, places, velocities
        for k, body in enumerate(self._bodies):
            x, q, v = states[:, k], 1 + 7 * k, 1 + nq + 6 * k
            rotation = Rotation.from_quat(x[:, QUATERNION]) * body.axes
            packed[:, q : q + 3], packed[:, v : v + 3] = x[:, POSITION], x[:, VELOCITY]
            packed[:, q + 3 : q + 7] = rotation.as_quat()[:, [3, 0, 1, 2]]
            packed[:, v + 3 : v + 6] = rotation.inv().apply(x[:, ANGULAR_VELOCITY])
        after = rollout.rollout(self._model, self._data, packed, nstep=steps)[0][:, -1]
        for k, body in enumerate(self._bodies):
            q, v = 1 + 7 * k, 1 + nq + 6 * k
            rotation = Rotation.from_quat(after[:, [q + 4, q + 5, q + 6, q + 3]])
            spin = rotation.apply(after[:, v + 3 : v + 6])
            parts = after[:, q : q + 3], after[:, v : v + 3], (rotation * body.axes.inv()).as_quat(), spin
            turned.append(np.concatenate(parts, axis=1))
        return np.stack(turned, axis=1)


def _mjcf(scene, bodies, shapes, settings):
    text, assets, surfaces = [], [], []  # of surfaces: whether they are free, body, and friction
    for k, (body, own) in enumerate(zip(bodies, shapes, strict=True)):
        geoms = []
        for shape in own:
            name = f"g{len(surfaces)}"
            surfaces.append((body.free, k, _friction(scene, scene.bodies[k])))
            if shape.kind == "mesh":
                assets.append(f'<mesh name="{name}" vertex="{text_of(shape.vertices.ravel())}"/>')
                geoms.append(f'<geom name="{name}" type="mesh" mesh="{name}"/>')
            else:
                moves = "" if body.free else ' surfacevel="1 0 0"'
                half = {"sphere": (1.0,), "box": (0.5, 0.5, 0.5), "cylinder": (1.0, 0.5)}[shape.kind]
                size = text_of(np.multiply(half, shape.size))
                place = f'pos="{text_of(shape.place)}" quat="{mujoco_quaternion(shape.turned)}"'
                geoms.append(f'<geom name="{name}" type="{shape.kind}" size="{size}" {place}{moves}/>')
        head = '<body mocap="true">'
        if body.free:
            inertial = f'<inertial pos="0 0 0" mass="{body.mass!r}" diaginertia="{text_of(body.inertia)}"/>'
            floats = ' gravcomp="1"' if body.floats else ""
            head = f"<body{floats}><freejoint/>{inertial}"
        text.append(f"{head}{''.join(geoms)}</body>")
    for solid in scene.environment:
        name, size = f"g{len(surfaces)}", text_of(_mujoco_size(solid))
        surfaces.append((False, -1, _friction(scene, solid)))
        turned = mujoco_quaternion(Rotation.from_matrix(solid.rotation))
        place = f'pos="{text_of(solid.position)}" quat="{turned}"'
        text.append(f'<geom name="{name}" type="{solid.shape}" size="{size}" {place}/>')
    option, contact, pairs = 'cone="elliptic" ', f'condim="3" friction="{scene.friction!r} 0.005 0.0001"', ""
    if settings is None and scene.friction is None:
        option, contact = "", 'condim="1" solref="-1000 0"'
    elif settings is not None:
        option += f'tolerance="1e-10" impratio="{settings.firm_friction!r}" '
        contact = 'contype="0" conaffinity="0"'
        pairs = "".join(
            f'<pair geom1="g{i}" geom2="g{j}" condim="3" friction="{mu!r} {mu!r} 0 0 0"'
            f' solref="{settings.contact_time!r} 1"/>'
            for (i, (free_i, a, p)), (j, (free_j, b, q)) in combinations(enumerate(surfaces), 2)
            if a != b and (free_i or free_j)
            for mu in [max(math.sqrt(p * q), _LEAST_FRICTION)]
        )
    dt = scene.dt if settings is None else settings.dt
    return (
        f'<mujoco><option {option}timestep="{dt!r}" gravity="{text_of(scene.gravity)}"/><size memory="256M"/>'
        f'<default><geom mass="0" {contact}/></default><asset>{"".join(assets)}</asset>'
        f"<worldbody>{''.join(text)}</worldbody><contact>{pairs}</contact></mujoco>"
    )


@singledispatch
def _mujoco_size(solid):
    """Return MuJoCo's size of an element of the environment; its names of shapes equal ours."""
    raise _no_shape(solid)


@_mujoco_size.register
def _(solid: Plane):
    return 0.0, 0.0, 1.0  # without end


@_mujoco_size.register
def _(solid: Box):
    return 0.5 * solid.size


@_mujoco_size.register
def _(solid: Sphere):
    return (solid.radius,)


@_mujoco_size.register(Cylinder)
@_mujoco_size.register(Capsule)
def _(solid):
    return solid.radius, 0.5 * solid.length


def text_of(values) -> str:
    """Format numbers for the engines' files."""
    return " ".join(repr(value) for value in np.asarray(values, float).tolist())


def mujoco_quaternion(rotation: Rotation) -> str:
    """Format a rotation for MuJoCo's files."""
    return text_of(rotation.as_quat()[[3, 0, 1, 2]])


PEERS = {"pybullet": PyBulletRollouts, "mujoco": MuJoCoRollouts}
