"""URDF files: links from their XML, joints with yourdfpy."""

from __future__ import annotations

import io
import logging
from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from ..checks.errors import InvalidRequestError, UncPhysicsError
from ..checks.names import hint
from ..checks.validation import number
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

_KINDS = "box", "cylinder", "capsule", "sphere", "mesh"
_MOMENTS = ("ixx", "ixy", "ixz"), ("ixy", "iyy", "iyz"), ("ixz", "iyz", "izz")


def load_robot(path: Path):
    """Return the joints of a file as a `yourdfpy.URDF`, and the root of its XML.

    Raises
    ------
    InvalidRequestError
    """
    import yourdfpy

    root, place = read_xml(path, "robot"), f"description {path}"
    if root.find("link") is None:
        raise InvalidRequestError("has no links", field=place)
    names = [link.get("name") for link in root.findall("link")]
    for k, name in enumerate(names):
        if name is None or name in names[:k]:
            problem = "must have a name" if name is None else "is the name of two links"
            raise InvalidRequestError(problem, field=f"{place}: link", value=name)
    skeleton = ElementTree.Element("robot", {"name": root.get("name", "robot")})
    for name in names:
        ElementTree.SubElement(skeleton, "link", {"name": str(name)})
    for joint in root.findall("joint"):
        for origin in joint.findall("origin"):
            _with_angles(origin, f"{place}: joint {joint.get('name')}")
        skeleton.append(joint)
    logger, before = logging.getLogger(yourdfpy.urdf.__name__), logging.CRITICAL
    before, logger.level = logger.level, before
    try:
        robot = yourdfpy.URDF.load(
            io.BytesIO(ElementTree.tostring(skeleton)), load_meshes=False, build_scene_graph=True
        )
    except Exception as error:  # noqa: BLE001 - yourdfpy raises errors of many types
        reason = (str(error).splitlines() or [type(error).__name__])[0][:100]
        raise InvalidRequestError(f"is no URDF that yourdfpy reads: {reason}", field=place) from None
    finally:
        logger.level = before
    return robot, root


def _with_angles(origin, field):
    """Write the angles of a quaternion (URDF 1.1) as those of older URDF, which yourdfpy reads."""
    T = _pose(origin, field)
    if origin.get("quat_xyzw") is not None:
        from scipy.spatial.transform import Rotation

        angles = Rotation.from_matrix(T[:3, :3]).as_euler("xyz")
        origin.set("rpy", " ".join(repr(float(angle)) for angle in angles))
        del origin.attrib["quat_xyzw"]


def read_urdf(path: Path, configuration: Mapping[str, float] | None = None) -> Description:
    """Read the links of a URDF (`reading.read_description`).

    The only link of a file without joints is a free body, unless it is called ``world``. So is a link at a
    floating joint without further links. Without a mass they are fixed. All others are fixed, or moved by
    their joints.
    """
    robot, root = load_robot(path)
    if configuration is not None:
        set_joints(robot, configuration)
    entries = root.findall("link")
    moved, floating = _moved_links(root) if configuration is None else ({}, set())
    if configuration is None and len(entries) == 1 and entries[0].get("name") != "world":
        floating = {entries[0].get("name")}
    links, left_out = [], []
    for entry in entries:
        name = str(entry.get("name"))
        try:
            inertial = _inertial(entry.find("inertial"))
            shapes, unknown = link_shapes(entry, path.parent)
        except UncPhysicsError as error:
            left_out.append(f"{name}: {error}")
            continue
        left_out += [f"{name}: a shape that is not read: {what}" for what in unknown]
        free = name in floating and inertial is not None
        moves = "" if name in floating else moved.get(name, "")
        pose = np.array(robot.get_transform(name), float)
        links.append(Link(name, pose, shapes, inertial, moves, free))
    return Description(path, tuple(links), tuple(left_out))


def link_shapes(link, base: Path) -> tuple[tuple[Shape, ...], list[str]]:
    """Return the collision shapes of a link, or its visual ones, and the names of unknown shapes."""
    # many objects have only visual shapes
    known, unknown = _shapes(link.findall("collision"), base)
    return (known, unknown) if known else (_shapes(link.findall("visual"), base)[0], unknown)


def _shapes(entries, base):
    known, unknown = [], []
    for entry in entries:
        kinds = [shape.tag for shape in entry.findall("geometry/*")]
        if len(kinds) == 1 and kinds[0] in _KINDS:
            known.append(_shape(entry, base))
        else:
            unknown.append(" and ".join(kinds) or "no shape")
    return tuple(known), unknown


def set_joints(robot, configuration) -> None:
    """Move the joints of a `yourdfpy.URDF`; unnamed joints stay.

    Raises
    ------
    InvalidRequestError, NotFiniteError
    """
    known = robot.actuated_joint_names
    values = {}
    for name, value in configuration.items():
        if name not in known:
            raise InvalidRequestError(
                f"is no joint of the robot that can be moved{hint(name, known)}", field="joint", value=name
            )
        values[name] = number(value, f"position of joint {name}")
    robot.update_cfg(values)


def _moved_links(root):
    """Return what moves each movable link, by link name, and the names of links that float freely."""
    joints = {joint.find("child").get("link"): joint for joint in root.findall("joint")}
    parents = {child: joint.find("parent").get("link") for child, joint in joints.items()}
    moved, floating = {}, set()
    for link in root.findall("link"):
        name, passed = link.get("name"), set()
        while name in joints and name not in passed:
            passed.add(name)
            if joints[name].get("type") != "fixed":
                moved[link.get("name")] = f"moves with the joint {joints[name].get('name')}"
                if joints[name].get("type") == "floating" and len(passed) == 1:
                    floating.add(name)
                break
            name = parents[name]
    return moved, {name for name in floating if name not in parents.values() and parents[name] not in moved}


def _shape(entry, base):
    pose = _pose(entry.find("origin"), "origin")
    shape = entry.find("geometry/*")
    if shape.tag == "mesh":
        return mesh_shape(pose, shape.get("filename") or "", base, shape.get("scale") or "")
    return primitive_shape(shape.tag, pose, lambda key: shape.get(key) or "")


def _inertial(entry):
    """Return the mass properties of a link; None without a mass, or with one of 0."""
    mass = None if entry is None else entry.find("mass")
    if entry is None or mass is None:
        return None
    kilograms = float(read_numbers(mass.get("value") or "", 1, "inertial/mass")[0])
    if kilograms == 0.0:
        return None
    if kilograms < 0.0:
        raise InvalidRequestError("must not be negative", field="inertial/mass", value=kilograms)
    pose, inertia = _pose(entry.find("origin"), "inertial/origin"), entry.find("inertia")
    if inertia is None:
        return Inertial(kilograms, pose)
    rows = [
        [read_numbers(inertia.get(key) or "0", 1, f"inertia/{key}")[0] for key in row] for row in _MOMENTS
    ]
    return Inertial(kilograms, pose, np.array(rows))


def _pose(origin, field):
    """Return the transform (4, 4) of an ``<origin>``."""
    from scipy.spatial.transform import Rotation

    if origin is None:
        return np.eye(4)
    position = read_numbers(origin.get("xyz") or "0 0 0", 3, f"{field} xyz")
    text = origin.get("quat_xyzw")
    if text is None:
        angles = read_numbers(origin.get("rpy") or "0 0 0", 3, f"{field} rpy")
        return transform(position, Rotation.from_euler("xyz", angles).as_matrix())
    if origin.get("rpy") is not None:
        raise InvalidRequestError(
            "must be absent beside quat_xyzw", field=f"{field} rpy", value=origin.get("rpy")
        )
    return transform(position, matrix_of_quaternion(read_numbers(text, 4, f"{field} quat_xyzw"), field))
