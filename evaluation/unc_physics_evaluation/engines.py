"""Rollouts of a scene in PyBullet and MuJoCo.

Masses, inertias, states, damping, environment and time step are the scene's.

Shapes are the scene's spheres ("spheres") or the usual ones of these engines ("primitive"): a model that is
a box or a cylinder has that shape, and any other model has convex pieces. In a scene without friction both
engines have elastic contacts without friction, with their fastest settings. In a scene with friction they
have their own contact laws and default settings. Bodies sleep if the scene allows it, and there is no
rendering. All steps run in one call. Bodies are given in their principal axes, in which both engines store
the inertia.
"""

from __future__ import annotations

import math
import tempfile
import warnings
from collections.abc import Sequence
from functools import singledispatch
from pathlib import Path

import numpy as np
from scipy.cluster.vq import kmeans2
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from unc_physics.checks.errors import NotSupportedError
from unc_physics.scene.environment import Box, Capsule, Cylinder, Element, Plane, Sphere
from unc_physics.spatial.layout import ANGULAR_VELOCITY, POSITION, QUATERNION, VELOCITY

#: Shapes of the models that are one primitive.
PRIMITIVES = {"salt_box": "box", "can": "cylinder", "cube": "box", "block": "box"}
PIECES = 16  # convex ones of a body
_DIRECTIONS = 64  # of a piece's support points, and so the largest number of its vertices
_CONDIM = {False: 1, True: 3}  # MuJoCo's: without and with friction
_TIME_CONSTANT = 0.02  # s, of MuJoCo's contacts by default


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

    Notes
    -----
    ``pieces`` divides the spheres into clusters and returns the convex hull of each, like a convex
    decomposition of a mesh.
    """

    def __init__(self, body):
        moments, axes = np.linalg.eigh(body.unit_inertia)
        axes[:, 2] *= np.linalg.det(axes)
        self.mass, self.name, self._model = body.mass, body.name, body.model
        self.prescribed = body.trajectory is not None
        self.inertia = body.mass * moments
        self.centers, self.radii = body.model.centers @ axes, body.model.radii
        self.axes = Rotation.from_matrix(axes)

    def own_geometry(self, geometry):
        """Return the geometry of this body if ``geometry`` is requested for the scene."""
        return "pieces" if geometry == "primitive" and self._model.name not in PRIMITIVES else geometry

    def primitive(self):
        """Return kind, sides [m], centre (3,) [m] and orientation of the model's box or cylinder."""
        low, high = self._model.bounds
        return (
            PRIMITIVES[self._model.name],
            (high - low).tolist(),
            self.axes.inv().apply(0.5 * (low + high)),
            self.axes.inv(),
        )

    def pieces(self):
        """Return the vertices (k, 3) of each convex piece [m]."""
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

    def orientation(self, state):
        """Return the rotation from principal axes to the world for one body's state (13,)."""
        return Rotation.from_quat(state[QUATERNION]) * self.axes

    def state(self, position, velocity, rotation, angular_velocity):
        """Return one body's state (13,) from an engine's values for the principal axes."""
        return np.concatenate([position, velocity, (rotation * self.axes.inv()).as_quat(), angular_velocity])


class PyBulletRollouts:
    """Rollouts in PyBullet.

    Notes
    -----
    Bodies are read from URDF text, because ``createCollisionShapeArray`` silently keeps only 16 spheres.
    Maximal coordinates select the solver for free bodies. The solver for articulated bodies is no faster, and
    gains energy with elastic contacts.
    """

    def __init__(self, scene, geometry="spheres"):
        import pybullet
        from pybullet_utils.bullet_client import BulletClient

        self._scene = scene
        self._bodies = [PrincipalBody(body) for body in scene.bodies]
        self._client = client = BulletClient(connection_mode=pybullet.DIRECT)
        client.setPhysicsEngineParameter(restitutionVelocityThreshold=0.0)
        client.setGravity(*scene.gravity.tolist())
        # Bullet keeps the share 1 - d of a velocity in a second, we exp(-damping)
        damping = 1.0 - math.exp(-scene.damping)
        self._handles, self._shapes = [], []
        with tempfile.TemporaryDirectory() as folder:
            for body in self._bodies:
                path = Path(folder) / f"{body.name}.urdf"
                path.write_text(_urdf(body, geometry, Path(folder)))
                probe = client.loadURDF(
                    str(path)
                )  # PyBullet tells the shapes of bodies in minimal coordinates only
                self._shapes.append(len(client.getCollisionShapeData(probe, -1)))
                client.removeBody(probe)
                flags = pybullet.URDF_USE_INERTIA_FROM_FILE
                if scene.sleep:
                    flags |= pybullet.URDF_ENABLE_SLEEPING
                handle = client.loadURDF(str(path), flags=flags, useMaximalCoordinates=True)
                client.changeDynamics(
                    handle, -1, linearDamping=damping, angularDamping=damping, **_bullet_contact(scene)
                )
                self._handles.append(handle)
        for solid in scene.environment:
            client.changeDynamics(self._fixed(solid), -1, **_bullet_contact(scene))

    def shapes(self):
        """Number of shapes of each body, as the engine has them."""
        return self._shapes

    def _fixed(self, solid):
        """Create a fixed body for an element of the environment."""
        shape = self._client.createCollisionShape(**_bullet_shape(solid, self._client))
        place = {"basePosition": solid.position.tolist()}
        if not isinstance(solid, Plane):  # whose shape is given in the world's axes
            place["baseOrientation"] = np.asarray(solid.orientation).tolist()
        return self._client.createMultiBody(0.0, shape, **place)

    def begin(self, state):
        """Set the state (B, 13)."""
        for body, handle, x in zip(self._bodies, self._handles, state, strict=True):
            self._client.resetBasePositionAndOrientation(
                handle, x[POSITION].tolist(), body.orientation(x).as_quat().tolist()
            )
            self._client.resetBaseVelocity(handle, x[VELOCITY].tolist(), x[ANGULAR_VELOCITY].tolist())

    def advance(self, steps):
        """Take so many steps, in one call: as steps within a longer one."""
        self._client.setPhysicsEngineParameter(fixedTimeStep=steps * self._scene.dt, numSubSteps=steps)
        self._client.stepSimulation()

    def state(self):
        """The state (B, 13)."""
        return bullet_states(self._client, self._bodies, self._handles)

    def run(self, state, steps):
        """The state (B, 13) after ``steps`` steps from ``state``."""
        self.begin(state)
        self.advance(steps)
        return self.state()

    def close(self):
        """Leave the engine."""
        self._client.disconnect()


def bullet_states(client, bodies, handles) -> np.ndarray:
    """Return the states (B, 13) of principal bodies in PyBullet, by their handles."""
    states = []
    for body, handle in zip(bodies, handles, strict=True):
        position, q = client.getBasePositionAndOrientation(handle)
        velocity, spin = client.getBaseVelocity(handle)
        states.append(body.state(position, velocity, Rotation.from_quat(q), spin))
    return np.array(states)


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


def _bullet_contact(scene):
    """Return the contact parameters of each body; Bullet multiplies those of touching bodies."""
    if scene.friction is None:
        return {"lateralFriction": 0.0, "restitution": 1.0, "contactProcessingThreshold": 0.0}
    return {"lateralFriction": math.sqrt(scene.friction), "restitution": math.sqrt(scene.restitution or 0.0)}


def _urdf(body, geometry, folder):
    geometry = body.own_geometry(geometry)
    if geometry == "spheres":
        shapes = [
            (f'xyz="{x!r} {y!r} {z!r}"', f'<sphere radius="{r!r}"/>')
            for (x, y, z), r in zip(body.centers.tolist(), body.radii.tolist(), strict=True)
        ]
    elif geometry == "primitive":
        kind, (x, y, z), middle, turned = body.primitive()
        shape = (
            f'<box size="{x!r} {y!r} {z!r}"/>'
            if kind == "box"
            else f'<cylinder radius="{x / 2!r}" length="{z!r}"/>'
        )
        shapes = [(urdf_place(middle, turned), shape)]
    else:
        shapes = []
        for k, vertices in enumerate(body.pieces()):
            path = folder / f"{body.name}_{k}.obj"
            path.write_text(_obj(vertices))
            shapes.append(('xyz="0 0 0"', f'<mesh filename="{path}"/>'))
    return urdf(body.name, body.mass, body.inertia, shapes)


def urdf(name: str, mass: float, inertia: np.ndarray, shapes: Sequence[tuple[str, str]]) -> str:
    """Return the URDF text of a body with principal moments (3,), and shapes by place and geometry."""
    collisions = "\n".join(  # on lines of their own: PyBullet cuts long lines
        f"<collision><origin {place}/><geometry>{shape}</geometry></collision>" for place, shape in shapes
    )
    a, b, c = inertia.tolist()
    moments = f'<inertia ixx="{a!r}" iyy="{b!r}" izz="{c!r}" ixy="0" ixz="0" iyz="0"/>'
    return (
        f'<robot name="{name}"><link name="body"><inertial><mass value="{mass!r}"/>{moments}</inertial>\n'
        f"{collisions}\n</link></robot>\n"
    )


def urdf_place(place: np.ndarray, turned: Rotation) -> str:
    """Return the URDF attributes of a shape's position (3,) and orientation in its body."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # at gimbal lock any of the equivalent angles will do
        angles = turned.as_euler("xyz")
    return f'xyz="{text_of(place)}" rpy="{text_of(angles)}"'


def _obj(vertices):
    """Return a convex hull as the text of a mesh file."""
    lines = ["v {!r} {!r} {!r}".format(*vertex) for vertex in vertices.tolist()]
    lines += ["f {} {} {}".format(*(corners + 1)) for corners in ConvexHull(vertices).simplices]
    return "\n".join(lines) + "\n"


class MuJoCoRollouts:
    """Rollouts in MuJoCo: free bodies of sphere geoms, all steps in one call.

    Notes
    -----
    Without friction, contacts are springs without dampers, thus elastic; the solver distributes the mass over
    the contacts. With friction, contacts are MuJoCo's critically damped ones without a coefficient of
    restitution: a cube that falls flat rebounds with 0.12 of its speed at steps of 1/240 s. The friction cone
    is elliptic; MuJoCo's default pyramid has 0.7 of
    the friction halfway between its axes.
    """

    def __init__(self, scene, geometry="spheres"):
        import mujoco

        self._mujoco = mujoco
        self._bodies = [PrincipalBody(body) for body in scene.bodies]
        model = mujoco.MjModel.from_xml_string(_mjcf(scene, self._bodies, geometry))
        for k, body in enumerate(self._bodies):
            model.dof_damping[6 * k : 6 * k + 3] = scene.damping * body.mass
            model.dof_damping[6 * k + 3 : 6 * k + 6] = scene.damping * body.inertia
        if scene.sleep:
            model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_SLEEP
        self._model, self._data = model, mujoco.MjData(model)

    def set_restitution(self, value):
        """Give all contacts the damping of a linear spring that returns this share of the speed."""
        log = math.log(max(value, 1e-3))
        self._model.geom_solref[:] = _TIME_CONSTANT, -log / math.hypot(math.pi, log)

    def shapes(self):
        """Number of shapes of each body, as the engine has them."""
        return self._model.body_geomnum[1:].tolist()

    def begin(self, state):
        """Set the state (B, 13)."""
        data = self._data
        self._mujoco.mj_resetData(self._model, data)
        for k, (body, x) in enumerate(zip(self._bodies, state, strict=True)):
            rotation = body.orientation(x)
            data.qpos[7 * k : 7 * k + 3] = x[POSITION]
            data.qpos[7 * k + 3 : 7 * k + 7] = rotation.as_quat()[[3, 0, 1, 2]]
            data.qvel[6 * k : 6 * k + 3] = x[VELOCITY]
            data.qvel[6 * k + 3 : 6 * k + 6] = rotation.inv().apply(x[ANGULAR_VELOCITY])

    def advance(self, steps):
        """Take so many steps, in one call."""
        self._mujoco.mj_step(self._model, self._data, nstep=steps)

    def state(self):
        """The state (B, 13)."""
        states = []
        for k, body in enumerate(self._bodies):
            rotation = Rotation.from_quat(self._data.qpos[7 * k + 3 : 7 * k + 7][[1, 2, 3, 0]])
            position, velocity = self._data.qpos[7 * k : 7 * k + 3], self._data.qvel[6 * k : 6 * k + 3]
            spin = rotation.apply(self._data.qvel[6 * k + 3 : 6 * k + 6])
            states.append(body.state(position, velocity, rotation, spin))
        return np.array(states)

    def run(self, state, steps):
        """The state (B, 13) after ``steps`` steps from ``state``."""
        self.begin(state)
        self.advance(steps)
        return self.state()

    def run_all(self, states, steps):
        """The states (N, B, 13) after ``steps`` steps from each of ``states``, all in one call."""
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

    def close(self):
        """Leave the engine; nothing to do."""


def _mjcf(scene, bodies, geometry):
    text, assets = [], []
    for body in bodies:
        shape = body.own_geometry(geometry)
        if shape == "spheres":
            geoms = [
                f'<geom type="sphere" size="{r!r}" pos="{x!r} {y!r} {z!r}"/>'
                for (x, y, z), r in zip(body.centers.tolist(), body.radii.tolist(), strict=True)
            ]
        elif shape == "primitive":
            kind, (x, y, z), middle, turned = body.primitive()
            size = f"{x / 2!r} {y / 2!r} {z / 2!r}" if kind == "box" else f"{x / 2!r} {z / 2!r}"
            geoms = [
                (
                    f'<geom type="{kind}" size="{size}" pos="{text_of(middle)}"'
                    f' quat="{mujoco_quaternion(turned)}"/>'
                )
            ]
        else:
            pieces = body.pieces()
            geoms = [f'<geom type="mesh" mesh="{body.name}_{k}"/>' for k in range(len(pieces))]
            assets += [
                f'<mesh name="{body.name}_{k}" vertex="{" ".join(map(repr, vertices.ravel().tolist()))}"/>'
                for k, vertices in enumerate(pieces)
            ]
        inertia = " ".join(repr(value) for value in body.inertia.tolist())
        inertial = f'<inertial pos="0 0 0" mass="{body.mass!r}" diaginertia="{inertia}"/>'
        floats = ' gravcomp="1"' if body.prescribed else ""
        text.append(f'<body name="{body.name}"{floats}><joint type="free"/>{inertial}{"".join(geoms)}</body>')
    contact = 'solref="-1000 0"' if scene.friction is None else f'friction="{scene.friction!r} 0.005 0.0001"'
    cone = "" if scene.friction is None else 'cone="elliptic" '
    text += [mujoco_fixed(solid) for solid in scene.environment]
    return (
        f'<mujoco><option {cone}timestep="{scene.dt!r}" gravity="{text_of(scene.gravity)}"/><size'
        ' memory="256M"/>'
        f'<default><geom condim="{_CONDIM[scene.friction is not None]}" mass="0" {contact}/></default>'
        f"<asset>{''.join(assets)}</asset><worldbody>{''.join(text)}</worldbody></mujoco>"
    )


def mujoco_fixed(solid: Element, name: str = "") -> str:
    """Return the geom of an element of the environment."""
    size, turned = text_of(_mujoco_size(solid)), mujoco_quaternion(Rotation.from_matrix(solid.rotation))
    named = f'name="{name}" ' if name else ""
    return (
        f'<geom {named}type="{solid.shape}" size="{size}" pos="{text_of(solid.position)}" quat="{turned}"/>'
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
