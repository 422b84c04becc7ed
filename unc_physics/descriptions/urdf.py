"""Read URDF files with yourdfpy."""

from __future__ import annotations

import io
import logging
from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from ..checks.errors import InvalidRequestError
from ..checks.names import hint
from ..checks.validation import number
from .parts import Description, Inertial, Link, Shape, read_xml, referred

_KNOWN = ("box", "cylinder", "sphere", "mesh")


def load_robot(path: Path):
    """Return the file as a `yourdfpy.URDF` without meshes, and its unknown shapes, one line each.

    Raises
    ------
    InvalidRequestError
    """
    import yourdfpy

    _, root = read_xml(path)
    place = f"description {path}"
    if root.tag != "robot":
        raise InvalidRequestError("is no URDF: its root is not <robot>", field=place, value=root.tag)
    left_out = _without_unknown_shapes(root)
    logger, before = logging.getLogger(yourdfpy.urdf.__name__), logging.CRITICAL
    before, logger.level = logger.level, before
    try:
        robot = yourdfpy.URDF.load(
            io.BytesIO(ElementTree.tostring(root)), load_meshes=False, build_scene_graph=True
        )
    except Exception as error:  # noqa: BLE001 - yourdfpy raises errors of many types
        reason = (str(error).splitlines() or [type(error).__name__])[0][:100]
        raise InvalidRequestError(f"is no URDF that yourdfpy reads: {reason}", field=place) from None
    finally:
        logger.level = before
    if not robot.link_map:
        raise InvalidRequestError("has no links", field=place)
    return robot, left_out


def _without_unknown_shapes(root):
    """Remove shapes that the library does not read; return one line for each."""
    left_out = []
    for link in root.iter("link"):
        for kind in ("collision", "visual"):
            for entry in link.findall(kind):
                shapes = [shape.tag for shape in entry.findall("geometry/*")]
                if len(shapes) != 1 or shapes[0] not in _KNOWN:
                    link.remove(entry)
                    if kind == "collision":
                        what = " and ".join(shapes) or "no shape"
                        left_out.append(f"{link.get('name')}: a shape that is not read: {what}")
    return left_out


def read_urdf(path: Path, configuration: Mapping[str, float] | None = None) -> Description:
    """Read the links of a URDF (`reading.read_description`)."""
    robot, left_out = load_robot(path)
    if configuration is not None:
        set_joints(robot, configuration)
    moved = {} if configuration is not None else _moved_links(robot)
    links = []
    for link in robot.robot.links:
        # collision shapes; many objects have only visual ones
        entries = link.collisions or link.visuals
        shapes = tuple(_shape(entry, path.parent) for entry in entries)
        pose = np.array(robot.get_transform(link.name), float)
        links.append(Link(link.name, pose, shapes, _inertial(link.inertial), moved.get(link.name, "")))
    return Description(path, tuple(links), tuple(left_out))


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


def _moved_links(robot):
    """Return what moves each movable link, by link name."""
    joints = {joint.child: joint for joint in robot.robot.joints}
    moved = {}
    for link in robot.robot.links:
        name, passed = link.name, set()
        while name in joints and name not in passed:
            passed.add(name)
            if joints[name].type != "fixed":
                moved[link.name] = f"moves with the joint {joints[name].name}"
                break
            name = joints[name].parent
    return moved


def _shape(entry, base):
    pose = np.eye(4) if entry.origin is None else np.array(entry.origin, float)
    geometry = entry.geometry
    if geometry.box is not None:
        return Shape("box", pose, tuple(float(edge) for edge in geometry.box.size))
    if geometry.sphere is not None:
        return Shape("sphere", pose, (float(geometry.sphere.radius),))
    if geometry.cylinder is not None:
        return Shape("cylinder", pose, (float(geometry.cylinder.radius), float(geometry.cylinder.length)))
    uri = geometry.mesh.filename or ""
    file = referred(uri, base)
    scale = np.ones(3) * (1.0 if geometry.mesh.scale is None else geometry.mesh.scale)
    return Shape("mesh", pose, file=file, scale=scale, problem="" if file else f"the mesh {uri} is not found")


def _inertial(inertial):
    if inertial is None or not inertial.mass:
        return None
    pose = np.eye(4) if inertial.origin is None else np.array(inertial.origin, float)
    inertia = None if inertial.inertia is None else np.array(inertial.inertia, float)
    return Inertial(float(inertial.mass), pose, inertia)
