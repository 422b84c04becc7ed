"""MJCF files, compiled with MuJoCo: bodies at the start of their joints."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path

import numpy as np

from ..checks.errors import InvalidRequestError
from ..checks.names import hint
from ..checks.validation import number
from .inertia import combined
from .parts import Description, Inertial, Link, Shape, matrix_of_quaternion, read_xml, transform

_GRAVITY = (0.0, 0.0, -9.81)  # m/s^2, the default of MuJoCo
#: Parts of a model that have no counterpart: the count's attribute and a name.
_OTHERS = {
    "neq": "equality constraints",
    "ntendon": "tendons",
    "nu": "actuators",
    "nflex": "flexible bodies",
    "npair": "contact pairs",
    "nexclude": "excluded contacts",
    "nplugin": "plugins",
}


def read_mjcf(path: Path, configuration: Mapping[str, float] | None = None) -> Description:
    """Read the bodies of an MJCF (`reading.read_description`).

    A body with a free joint becomes one link with all bodies below it, which keep the poses of the joints at
    the start. All other bodies are fixed. Each mesh stands for its convex hull, as in MuJoCo.

    Parameters
    ----------
    path : Path
    configuration : mapping of str to float, optional
        Positions of hinge and slide joints [rad or m] in place of those at the start, by name.

    Raises
    ------
    InvalidRequestError
        If MuJoCo cannot compile the file, or a joint does not exist.
    """
    mujoco = import_module("mujoco")
    place = f"description {path}"
    read_xml(path, "mujoco")
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except Exception as error:  # noqa: BLE001 - MuJoCo raises errors of several types
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise InvalidRequestError(f"is no MJCF that MuJoCo compiles: {reason}", field=place) from None
    return _CompiledModel(mujoco, model, path).description(configuration or {})


class _CompiledModel:
    """Reader of a compiled model at one configuration."""

    def __init__(self, mujoco, model, path):
        self.mujoco, self.model, self.path = mujoco, model, path
        self.left_out: list[str] = []
        self.notes: list[str] = []

    def description(self, configuration):
        """Return the description of the model."""
        model, data = self.model, self.mujoco.MjData(self.model)
        self.set_joints(data, configuration)
        self.mujoco.mj_kinematics(model, data)
        poses = [transform(p, R) for p, R in zip(data.xpos, data.xmat, strict=True)]
        roots = self.free_roots()
        links = []
        for body in range(model.nbody):
            if roots[body] in (0, body):
                free = body > 0 and roots[body] == body
                members = [k for k in range(model.nbody) if roots[k] == body] if free else [body]
                links.append(self.link(body, members, poses, free))
        for count, what in _OTHERS.items():
            if getattr(model, count, 0):
                self.left_out.append(f"{getattr(model, count)} {what}: not imported")
        if np.abs(model.opt.gravity - _GRAVITY).max() > 1e-6:
            gravity = " ".join(f"{x:g}" for x in model.opt.gravity)
            self.notes.append(f"gravity, {gravity} m/s^2, is not imported: set it in the scene")
        return Description(self.path, tuple(links), tuple(self.left_out), tuple(self.notes))

    def name(self, kind, index):
        """Return the name of a part; parts without one get their kind and number."""
        found = self.mujoco.mj_id2name(
            self.model, getattr(self.mujoco.mjtObj, f"mjOBJ_{kind.upper()}"), index
        )
        return found or f"{kind}_{index}"

    def set_joints(self, data, configuration):
        """Set positions of joints, and note those that stay at their start."""
        model, kinds = self.model, self.mujoco.mjtJoint
        hinge, slide, free = (int(getattr(kinds, f"mjJNT_{kind}")) for kind in ("HINGE", "SLIDE", "FREE"))
        joints = {self.name("joint", k): k for k in range(model.njnt)}
        movable = [name for name, k in joints.items() if int(model.jnt_type[k]) in (hinge, slide)]
        for name, value in configuration.items():
            if name not in movable:
                raise InvalidRequestError(
                    f"is no hinge or slide joint of the model{hint(name, movable)}", field="joint", value=name
                )
            data.qpos[model.jnt_qposadr[joints[name]]] = number(value, f"position of joint {name}")
        for name, k in joints.items():
            if int(model.jnt_type[k]) != free:
                body = self.name("body", model.jnt_bodyid[k])
                kept = "at the given position" if name in configuration else "at its start"
                self.notes.append(f"{body}: the joint {name} is kept {kept}")

    def free_roots(self):
        """Return for each body the nearest body above it, or itself, that has a free joint; 0 for none."""
        model, free = self.model, int(self.mujoco.mjtJoint.mjJNT_FREE)
        roots = np.zeros(model.nbody, int)
        for body in range(1, model.nbody):
            first = model.jnt_type[
                model.body_jntadr[body] : model.body_jntadr[body] + model.body_jntnum[body]
            ]
            roots[body] = body if np.any(first == free) else roots[model.body_parentid[body]]
        return roots

    def link(self, body, members, poses, free):
        """Return a body and the bodies that move with it as one link."""
        to_link = np.linalg.inv(poses[body])
        shapes = [shape for k in members for shape in self.shapes(k, to_link @ poses[k])]
        return Link(
            self.name("body", body),
            poses[body],
            tuple(shapes),
            self.inertial(members, to_link, poses) if free else None,
            free=free,
        )

    def inertial(self, members, to_link, poses):
        """Return the common mass properties of bodies, in the frame of their link."""
        model = self.model
        frames = [
            to_link @ poses[k] @ transform(model.body_ipos[k], _matrix(model.body_iquat[k])) for k in members
        ]
        masses = model.body_mass[members]
        own = [
            T[:3, :3] @ np.diag(model.body_inertia[k]) @ T[:3, :3].T
            for k, T in zip(members, frames, strict=True)
        ]
        center, inertia = combined(masses, [T[:3, 3] for T in frames], own)
        return Inertial(float(masses.sum()), transform(center, np.eye(3)), inertia)

    def shapes(self, body, pose):
        """Return the shapes of a body's geoms that collide, or of all its geoms if none does."""
        model = self.model
        geoms = range(model.body_geomadr[body], model.body_geomadr[body] + model.body_geomnum[body])
        colliding = [k for k in geoms if model.geom_contype[k] or model.geom_conaffinity[k]]
        return [self.shape(k, pose) for k in colliding or geoms]

    def shape(self, geom, pose):
        """Return the shape of a geom, in the frame of its link."""
        model = self.model
        kind = self.mujoco.mjtGeom(model.geom_type[geom]).name.removeprefix("mjGEOM_").lower()
        pose = pose @ transform(model.geom_pos[geom], _matrix(model.geom_quat[geom]))
        a, b, c = (float(x) for x in model.geom_size[geom])
        sizes = {
            "plane": (0.0, 0.0, 1.0),
            "box": (2.0 * a, 2.0 * b, 2.0 * c),
            "sphere": (a,),
            "cylinder": (a, 2.0 * b),
            "capsule": (a, 2.0 * b),
            "ellipsoid": (a, b, c),
        }
        # a contact with condim 1 has no friction
        friction = float(model.geom_friction[geom, 0]) if model.geom_condim[geom] > 1 else 0.0
        if kind != "mesh":
            return Shape(kind, pose, sizes.get(kind, ()), friction=friction)
        mesh = model.geom_dataid[geom]
        first = model.mesh_vertadr[mesh]
        points = np.array(model.mesh_vert[first : first + model.mesh_vertnum[mesh]], float)
        return Shape("mesh", pose, convex=True, points=points, friction=friction)


def _matrix(q):
    """Return the rotation matrix of MuJoCo's quaternion (w, x, y, z)."""
    return matrix_of_quaternion(np.roll(q, -1), "quaternion")
