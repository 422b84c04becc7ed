"""SDF files: worlds and models."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..checks.errors import InvalidRequestError, UncPhysicsError
from .parts import (
    Description,
    Inertial,
    Link,
    Shape,
    matrix_of_quaternion,
    mesh_shape,
    primitive_shape,
    read_numbers,
    read_xml,
    transform,
)
from .sdf_includes import DEPTH, FOLDER, expand_includes

_MASS, _DENSITY = 1.0, 1000.0  # kg and kg/m^3, the defaults of SDF
_GRAVITY = (0.0, 0.0, -9.8)  # m/s^2, the default of SDF
_NEAR = 0.02  # m/s^2, by which gravity may differ without a note


def read_sdf(path: Path) -> Description:
    """Read the links of an SDF world or model (`reading.read_description`).

    Links of non-static models are free bodies unless a joint holds them.
    """
    reader = _Reader()
    root = read_xml(path, "sdf")
    for scope in [*root.findall("world"), root]:
        reader.left_out += expand_includes(scope, path.parent)
        reader.read_scope(scope, np.eye(4), "", path.parent, False, 0, ())
        gravity = scope.find("gravity")
        if gravity is not None and np.abs(_numbers(scope, "gravity", 3) - _GRAVITY).max() > _NEAR:
            reader.notes.append(
                f"gravity, {_text(scope, 'gravity')} m/s^2, is not imported: set it in the scene"
            )
    return Description(path, tuple(reader.links), tuple(reader.left_out), tuple(reader.notes))


class _Reader:
    """Collector of links."""

    def __init__(self):
        self.links: list[Link] = []
        self.left_out: list[str] = []
        self.notes: list[str] = []

    def read_scope(self, scope, pose, prefix, base, static, depth, joints):
        """Read the models of a world, of a model, or of a file.

        ``joints`` are those of outer models, as pairs of their element and the names of their ends here.
        """
        frames = _Frames(scope)
        for model in scope.findall("model"):
            self.read_model(model, pose, frames, prefix, base, static, depth, joints)
        for tag in ("actor", "population", "state"):
            self.left_out += [
                f"{prefix}{tag} {entry.get('name', '')}".strip() for entry in scope.findall(tag)
            ]

    def read_model(self, model, outer, outer_frames, prefix, base, static, depth, outer_joints):
        """Read a model's links and its nested models."""
        own = model.get("name", "model")
        name = f"{prefix}{own}"
        static = static or _flag(model, "static")
        base = Path(model.get(FOLDER, base))
        if depth > DEPTH:
            self.left_out.append(f"{name}: nested too deep")
            return
        try:
            pose = outer @ outer_frames.pose_of(model)
        except UncPhysicsError as error:
            self.left_out.append(f"{name}: {error}")
            return
        joints = [(joint, _ends(joint)) for joint in model.findall("joint")]
        joints += [
            (joint, [end.removeprefix(f"{own}::") for end in ends])
            for joint, ends in outer_joints
            if any(end.startswith(f"{own}::") for end in ends)
        ]
        moving = [joint.get("name", "") for joint, _ in joints if joint.get("type") != "fixed"]
        held = static or any("world" in ends for _, ends in joints)
        frames, links = _Frames(model), model.findall("link")
        alone = len(links) == 1
        for link in links:
            called = name if alone else f"{name}::{link.get('name', 'link')}"
            moves, free = "", False
            if moving and not static:
                moves = f"is held by joints ({', '.join(moving)})"
            elif not held and joints:
                moves = "is one of several links that move as one"
            elif not held:
                free = True
            try:
                self.links.append(self._link(link, called, pose, frames, base, moves, free))
            except UncPhysicsError as error:
                self.left_out.append(f"{called}: {error}")
        self.read_scope(model, pose, f"{name}::", base, static, depth + 1, joints)

    def _link(self, link, name, model_pose, frames, base, moves, free):
        base = Path(link.get(FOLDER, base))
        pose = frames.pose_of(link)
        entries = link.findall("collision") or link.findall("visual")
        shapes = tuple(
            _shape(entry, base, pose, frames) for entry in entries if entry.find("geometry/empty") is None
        )
        inertial, notes = _inertial(link.find("inertial"))
        if free and shapes:
            self.notes += [f"{name}: {note}" for note in notes]
        return Link(name, model_pose @ pose, shapes, inertial, moves, free)


class _Frames:
    """Frames of a model, world or file to which poses may be relative."""

    def __init__(self, scope):
        self.is_model = scope.tag == "model"
        self.entries = {
            entry.get("name"): entry
            for tag in ("model", "joint", "frame", "link")
            for entry in scope.findall(tag)
        }

    def pose_of(self, entry, passed=()):
        """Return ``T_scope_entry`` (4, 4) of a link, frame, joint or model."""
        pose = entry.find("pose")
        to = pose.get("relative_to") if pose is not None else None
        if not to and entry.tag == "frame":
            to = entry.get("attached_to")
        if not to and entry.tag == "joint":
            to = _ends(entry)[1]
        T = read_pose(pose)
        placement = entry.get("placement_frame") if entry.tag == "model" else None
        if placement:
            T = T @ np.linalg.inv(_Frames(entry).named(placement))
        return self.named(to or "", (*passed, id(entry))) @ T

    def named(self, name, passed=()):
        """Return ``T_scope_frame`` (4, 4) of the frame with a name."""
        if name in ("", "__model__") or (name == "world" and not self.is_model):
            return np.eye(4)
        first, nested, rest = name.partition("::")
        entry = self.entries.get(first)
        if entry is None or id(entry) in passed or (nested and entry.tag != "model"):
            problem = "names a frame that is not in its model" + ", or refers to itself" * (entry is not None)
            raise InvalidRequestError(problem, field="relative_to", value=name)
        T = self.pose_of(entry, passed)
        return T @ _Frames(entry).named(rest) if nested else T


def _ends(joint):
    """Return the names of a joint's parent and child."""
    return [_text(joint, "parent"), _text(joint, "child")]


def read_pose(entry) -> np.ndarray:
    """Return the transform (4, 4) of a ``<pose>``, relative to its own frame."""
    from scipy.spatial.transform import Rotation

    if entry is None:
        return np.eye(4)
    text = " ".join((entry.text or "").split())
    if entry.get("rotation_format") == "quat_xyzw":
        values = read_numbers(text or "0 0 0 0 0 0 1", 7, "pose")
        return transform(values[:3], matrix_of_quaternion(values[3:], "pose"))
    values = read_numbers(text or "0 0 0 0 0 0", 6, "pose")
    degrees = entry.get("degrees") in ("true", "1")
    return transform(values[:3], Rotation.from_euler("xyz", values[3:], degrees=degrees).as_matrix())


def _shape(entry, base, link_pose, frames):
    """Return a shape; its pose is relative to its link, whose pose in the model is ``link_pose``."""
    geometry, given = entry.find("geometry"), entry.find("pose")
    kinds = [] if geometry is None else list(geometry)
    pose, to = read_pose(given), given.get("relative_to") if given is not None else None
    if to:
        pose = np.linalg.inv(link_pose) @ frames.named(to) @ pose
    if len(kinds) != 1:
        return Shape("nothing", pose, problem="has no shape")
    kind = kinds[0].tag
    friction = _maybe(entry, "surface/friction/ode/mu")
    about: dict[str, Any] = {
        "friction": _maybe(entry, "surface/friction/bullet/friction") if friction is None else friction,
        "restitution": _maybe(entry, "surface/bounce/restitution_coefficient"),
        "density": _positive(entry, "density"),
    }
    if kind == "mesh":
        problem = "" if kinds[0].find("submesh") is None else "names a part of a mesh"
        about["convex"] = kinds[0].get("optimization") == "convex_hull"
        return mesh_shape(pose, _text(kinds[0], "uri"), base, _text(kinds[0], "scale"), problem, **about)
    return primitive_shape(
        kind, pose, lambda key: _text(kinds[0], key) or "0 0 1" * (key == "normal"), **about
    )


def _inertial(entry):
    """Return the mass properties of a link, and notes about what is missing."""
    if entry is None:
        return Inertial(_MASS), [
            f"has no <inertial>: mass {_MASS:g} kg, as SDF says, and the inertia of its shape"
        ]
    mass = _positive(entry, "mass")
    if entry.get("auto") in ("true", "1"):
        given = [tag for tag in ("pose", "inertia") if entry.find(tag) is not None]
        ignored = f"<{'> and <'.join(given)}> of <inertial auto='true'>: ignored, as SDF says"
        return Inertial(mass, density=_positive(entry, "density") or _DENSITY), [ignored] * bool(given)
    notes = [] if mass else [f"has no <mass>: {_MASS:g} kg, as SDF says"]
    pose = entry.find("pose")
    if pose is not None and pose.get("relative_to"):
        raise InvalidRequestError(
            "is a frame that is not resolved in <inertial>",
            field="relative_to",
            value=pose.get("relative_to"),
        )
    inertia = None
    if entry.find("inertia") is not None:
        xx, yy, zz = (_maybe(entry, f"inertia/i{axes}") for axes in ("xx", "yy", "zz"))
        xy, xz, yz = (_maybe(entry, f"inertia/i{axes}") or 0.0 for axes in ("xy", "xz", "yz"))
        xx, yy, zz = (1.0 if value is None else value for value in (xx, yy, zz))
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    elif entry.find("pose") is None and mass is None:
        return Inertial(_MASS), notes
    return Inertial(mass or _MASS, read_pose(pose), inertia), notes


def _text(entry, tag):
    return (entry.findtext(tag) or "").strip()


def _flag(entry, tag):
    return _text(entry, tag) in ("true", "1")


def _numbers(entry, tag, count):
    return read_numbers(_text(entry, tag), count, tag)


def _maybe(entry, tag):
    return float(_numbers(entry, tag, 1)[0]) if _text(entry, tag) else None


def _positive(entry, tag):
    value = _maybe(entry, tag)
    if value is not None and value <= 0.0:
        raise InvalidRequestError("must be positive", field=tag, value=value)
    return value
