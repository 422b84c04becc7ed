"""SDF files: worlds and models."""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from ..checks.errors import InvalidRequestError, UncPhysicsError
from .parts import Description, Inertial, Link, Shape, read_xml, referred

_DEPTH = 10  # largest nesting depth of models and of includes
_SIZES = {
    "box": (("size", 3),),
    "sphere": (("radius", 1),),
    "cylinder": (("radius", 1), ("length", 1)),
    "capsule": (("radius", 1), ("length", 1)),
    "plane": (("normal", 3),),
}


def read_sdf(path: Path) -> Description:
    """Read the links of an SDF world or model (`reading.read_description`).

    Links of non-static models are free bodies unless a joint holds them.
    """
    reader = _Reader(path)
    _, root = read_xml(path)
    if root.tag != "sdf":
        raise InvalidRequestError(
            "is no SDF: its root is not <sdf>", field=f"description {path}", value=root.tag
        )
    for scope in [*root.findall("world"), root]:
        reader.read_scope(scope, np.eye(4), "", path.parent, False, 0)
    return Description(path, tuple(reader.links), tuple(reader.left_out))


class _Reader:
    """Collector of links from a file and the files that it includes."""

    def __init__(self, path):
        self.path = path
        self.links: list[Link] = []
        self.left_out: list[str] = []

    def read_scope(self, scope: Element, pose, prefix, base, static, depth):
        """Read the models of a world, of a model, or of a file."""
        for model in scope.findall("model"):
            self.read_model(model, pose, prefix, base, static, depth)
        for include in scope.findall("include"):
            self.read_include(include, pose, prefix, base, static, depth)
        for tag in ("actor", "population", "state"):
            self.left_out += [
                f"{prefix}{tag} {entry.get('name', '')}".strip() for entry in scope.findall(tag)
            ]

    def read_include(self, include, pose, prefix, base, static, depth):
        """Read the model of an included file."""
        uri = _text(include, "uri")
        found = referred(uri, base) if depth < _DEPTH else None
        if found is not None and found.is_dir():
            found = found / "model.sdf"
        if found is None or not found.is_file():
            self.left_out.append(f"{prefix}include {uri}: is not found")
            return
        try:
            _, root = read_xml(found)
        except UncPhysicsError as error:
            self.left_out.append(f"{prefix}include {uri}: {error}")
            return
        for model in root.findall("model"):
            if include.find("name") is not None:
                model.set("name", _text(include, "name"))
            own = include.find("pose")
            if own is not None:
                for old in model.findall("pose"):
                    model.remove(old)
                model.append(own)
            static_here = static or _flag(include, "static")
            self.read_model(model, pose, prefix, found.parent, static_here, depth + 1)

    def read_model(self, model, outer, prefix, base, static, depth):
        """Read a model's links and its nested models."""
        name = f"{prefix}{model.get('name', 'model')}"
        static = static or _flag(model, "static")
        if depth > _DEPTH:
            self.left_out.append(f"{name}: nested too deep")
            return
        frames = _ModelFrames(model)
        try:
            pose = outer @ _pose(model.find("pose"), None)
        except UncPhysicsError as error:
            self.left_out.append(f"{name}: {error}")
            return
        joints = [joint.get("name", "") for joint in model.findall("joint") if joint.get("type") != "fixed"]
        held = static or any(joint.findtext("parent") == "world" for joint in model.findall("joint"))
        links = model.findall("link")
        alone = len(links) == 1
        for link in links:
            called = name if alone else f"{name}::{link.get('name', 'link')}"
            moves, free = "", False
            if joints:
                moves = f"is held by joints ({', '.join(joints)})"
            elif not held and not alone and model.findall("joint"):
                moves = "is one of several links that move as one"
            elif not held:
                free = True
            try:
                self.links.append(self._link(link, called, pose @ frames.pose_of(link), base, moves, free))
            except UncPhysicsError as error:
                self.left_out.append(f"{called}: {error}")
        self.read_scope(model, pose, f"{name}::", base, static, depth + 1)

    def _link(self, link, name, pose, base, moves, free):
        entries = link.findall("collision") or link.findall("visual")
        shapes = tuple(_shape(entry, base) for entry in entries)
        return Link(name, pose, shapes, _inertial(link.find("inertial")), moves, free)


class _ModelFrames:
    """Frames of a model to which poses may be relative: its links and its own frames."""

    def __init__(self, model):
        self.entries = {entry.get("name"): entry for tag in ("link", "frame") for entry in model.findall(tag)}

    def pose_of(self, entry, depth=0):
        """Return ``T_model_entry`` (4, 4)."""
        pose = entry.find("pose")
        to = (pose.get("relative_to") if pose is not None else None) or entry.get("attached_to") or ""
        own = _pose(pose, to)
        if not to or to == "__model__":
            return own
        if to not in self.entries or depth > _DEPTH:
            raise InvalidRequestError("names a frame that is not in its model", field="relative_to", value=to)
        return self.pose_of(self.entries[to], depth + 1) @ own


def _pose(entry, known_frame):
    """Return the transform (4, 4) of a ``<pose>``; a relative pose must refer to a known frame."""
    from scipy.spatial.transform import Rotation

    T = np.eye(4)
    if entry is None:
        return T
    to = entry.get("relative_to") or ""
    if to not in ("", "world", "__model__") and to != known_frame:
        raise InvalidRequestError("is a frame that is not resolved here", field="relative_to", value=to)
    quaternion = entry.get("rotation_format") == "quat_xyzw"
    text = (entry.text or "").split()
    values = _numbers(" ".join(text) or "0 0 0 0 0 0", 7 if quaternion else 6, "pose")
    T[:3, 3] = values[:3]
    if quaternion:
        T[:3, :3] = Rotation.from_quat(values[3:]).as_matrix()
    else:
        T[:3, :3] = Rotation.from_euler("xyz", values[3:], degrees=entry.get("degrees") == "true").as_matrix()
    return T


def _shape(entry, base):
    geometry = entry.find("geometry")
    kinds = [] if geometry is None else list(geometry)
    pose = _pose(entry.find("pose"), None)
    if len(kinds) != 1:
        return Shape("nothing", pose, problem="has no shape")
    kind = kinds[0].tag
    friction = _maybe(entry, "surface/friction/ode/mu")
    restitution = _maybe(entry, "surface/bounce/restitution_coefficient")
    if kind == "mesh":
        uri = _text(kinds[0], "uri")
        file = referred(uri, base)
        scale = _numbers(_text(kinds[0], "scale") or "1 1 1", 3, "scale")
        problem = "" if file else f"the mesh {uri} is not found"
        if kinds[0].find("submesh") is not None:
            problem = "names a part of a mesh"
        return Shape(kind, pose, (), file, scale, friction, restitution, problem)
    size: list[float] = []
    for key, count in _SIZES.get(kind, ()):
        default = "0 0 1" if key == "normal" else ""
        size += _numbers(_text(kinds[0], key) or default, count, f"{kind}/{key}").tolist()
    return Shape(kind, pose, tuple(size), friction=friction, restitution=restitution)


def _inertial(entry):
    if entry is None or entry.find("mass") is None:
        return None
    mass = float(_numbers(_text(entry, "mass"), 1, "mass")[0])
    inertia = None
    if entry.find("inertia") is not None:
        xx, yy, zz = (_maybe(entry, f"inertia/i{axes}") for axes in ("xx", "yy", "zz"))
        xy, xz, yz = (_maybe(entry, f"inertia/i{axes}") or 0.0 for axes in ("xy", "xz", "yz"))
        xx, yy, zz = (1.0 if value is None else value for value in (xx, yy, zz))
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return Inertial(mass, _pose(entry.find("pose"), None), inertia)


def _text(entry, tag):
    return (entry.findtext(tag) or "").strip()


def _flag(entry, tag):
    return _text(entry, tag) in ("true", "1")


def _maybe(entry, tag):
    text = _text(entry, tag)
    return float(_numbers(text, 1, tag)[0]) if text else None


def _numbers(text, count, field):
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        values = np.empty(0)
    if len(values) != count or not np.isfinite(values).all():
        raise InvalidRequestError(f"must be {count} number{'s' * (count > 1)}", field=field, value=text)
    return values
