"""Conversion of MoveIt's planning scenes: collision objects become obstacles or objects.

This module does not import ``moveit_msgs``; callers that have a ``PlanningScene`` have it installed.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from geometry_msgs.msg import Point, Pose
from shape_msgs.msg import SolidPrimitive
from std_msgs.msg import Header

from unc_physics_msgs.msg import Action, EnvironmentElement, ObjectState, PredictionRequest, Scene

from ...checks.errors import (
    InvalidMassError,
    InvalidRequestError,
    NotSupportedError,
    UncPhysicsError,
    UnknownFrameError,
)
from ...checks.validation import positive
from ...shapes.library import load_model
from .environment import read_dimensions
from .fields import packed, xyz
from .frames import IDENTITY, Transform

# operations of collision objects; a byte is an int or bytes, depending on the ROS version
_ADD, _REMOVE, _APPEND, _MOVE = (0, b"\x00"), (1, b"\x01"), (2, b"\x02"), (3, b"\x03")
#: Names of an object's shapes: of its fields of poses, and of the shapes themselves.
_SHAPES = ("primitive", "primitives"), ("mesh", "meshes"), ("plane", "planes")
_LARGEST_BALL, _SMALLEST_BALL = 0.01, 1e-3  # m, radii of balls that stand for links


def request_of_planning_scene(
    message: Any,
    *,
    objects: Mapping[str, float] | None = None,
    models: Mapping[str, str] | None = None,
    frames: Mapping[str, Pose] | None = None,
    links: Mapping[str, SolidPrimitive] | None = None,
    planning_frame: str = "",
    ignore_octomap: bool = False,
) -> PredictionRequest:
    """Return a request with the scene and the attachments of a ``moveit_msgs/PlanningScene``.

    Parameters
    ----------
    message : moveit_msgs/PlanningScene
        Complete planning scene, not a difference.
    objects : mapping of str to float, optional
        Masses of the collision objects that move, by id [kg]; all others are obstacles.
    models : mapping of str to str, optional
        Models of the library, by name or path, that replace collision shapes, by object id. In place of one
        primitive, the middle of the model's box is at its centre, with the same axes. In place of one mesh,
        the model has the mesh's origin, and in place of several shapes that of the object's pose.
    frames : mapping of str to Pose, optional
        Poses of frames in the planning frame, in addition to the scene's ``fixed_frame_transforms``. Those of
        links to which objects are attached are needed, from tf.
    links : mapping of str to SolidPrimitive, optional
        Shapes of links that hold objects, centred at the link's frame. By default a ball that is half as far
        from the held objects as the link's origin, at most 1 cm in radius.
    planning_frame : str
        By default the frame of the fixed transforms, or else of the first object; it becomes the frame of the
        scene's header.
    ignore_octomap : bool
        Whether to ignore an octomap; otherwise it is an error.

    Returns
    -------
    unc_physics_msgs/PredictionRequest
        Request with a scene and actions; the horizon is still to be set. Covariances are zero. An attached
        object has the mass of ``objects`` or else its ``weight``, and an action of type ATTACHMENT to its
        link. The link is a fixed object at its frame; give it an action of type TRAJECTORY if it moves.
        An obstacle of several shapes becomes several elements, ``id/0``, ``id/1`` and so on.

    Raises
    ------
    NotSupportedError
        For a difference, an octomap, or a moving object with several shapes or a plane.
    UnknownFrameError
        If a frame's pose is unknown.
    UnknownModelError, InvalidModelError
        If a model of ``models`` cannot be read.
    InvalidRequestError, InvalidMassError, InvalidOrientationError, NotFiniteError
        For unknown ids, lists of different lengths, and numbers out of range.
    """
    objects, models = dict(objects or {}), dict(models or {})
    if message.is_diff:
        raise NotSupportedError("must be false; ask for the whole planning scene", field="is_diff")
    if len(message.world.octomap.octomap.data) and not ignore_octomap:
        raise NotSupportedError(
            "is not read; give what it shows as collision objects, or leave it out by ignore_octomap",
            field="world.octomap",
        )
    world = list(message.world.collision_objects)
    attached = list(message.robot_state.attached_collision_objects)
    _check_ids(world, attached, objects, models)
    fixed = list(message.fixed_frame_transforms)
    frame = planning_frame or next(
        (one.header.frame_id for one in [*fixed, *world] if one.header.frame_id), ""
    )
    poses = {"": Pose(), frame: Pose()} | dict(frames or {})

    def pose_of(name, field):
        if name not in poses:
            problem = "is no frame whose pose is known; give it in frames"
            raise UnknownFrameError(problem, field=f"{field}.header.frame_id", value=name)
        return Transform.from_pose(poses[name], f"frames['{name}']")

    known = _FramePoses(
        {one.child_frame_id: one for one in fixed if one.child_frame_id not in poses}, pose_of
    )
    _check_added(world, "world.collision_objects[{}]")
    _check_added([held.object for held in attached], "robot_state.attached_collision_objects[{}].object")
    bodies, elements, actions = [], [], []
    holders: dict[str, float] = {}  # radii of the balls that stand for links [m]
    for k, own in enumerate(world):
        field = f"world.collision_objects[{k}]"
        if own.id in objects:
            mass = positive(objects[own.id], f"mass of '{own.id}'", InvalidMassError)
            bodies.append(_object(own, known, models.get(own.id), mass, field))
        else:
            elements += _elements(own, known, field)
    for k, held in enumerate(attached):
        field = f"robot_state.attached_collision_objects[{k}]"
        mass = objects.get(held.object.id, held.weight)
        mass = positive(mass, f"{field}.weight", InvalidMassError)
        state = _object(held.object, known, models.get(held.object.id), mass, f"{field}.object")
        bodies.append(state)
        actions.append(Action(type=Action.ATTACHMENT, object=state.id, attached_to=held.link_name))
        gap = _gap(held, known, field)
        holders[held.link_name] = min(0.5 * gap, holders.get(held.link_name, _LARGEST_BALL))
    for name, radius in holders.items():
        bodies.append(_link(name, radius, (links or {}).get(name), known))
    scene = Scene(objects=bodies)
    scene.header.frame_id, scene.environment.elements = frame, elements
    return PredictionRequest(scene=scene, actions=actions)


class PlanningWorld:
    """Collision objects of a planning scene that is kept up to date from whole scenes and differences.

    Objects that are attached to the robot are no part of the surroundings, and are left out.
    """

    def __init__(self):
        self._objects: dict[str, Any] = {}
        self._transforms: dict[str, Any] = {}

    def update(self, message: Any) -> None:
        """Apply a ``moveit_msgs/PlanningScene``, whole or a difference."""
        if not message.is_diff:
            self._objects.clear()
            self._transforms.clear()
        self._transforms |= {one.child_frame_id: one for one in message.fixed_frame_transforms}
        for own in message.world.collision_objects:
            self._apply(own)
        for held in message.robot_state.attached_collision_objects:
            if held.object.operation in _ADD:
                self._objects.pop(held.object.id, None)

    def _apply(self, own):
        known = self._objects.get(own.id)
        if own.operation in _REMOVE:
            if own.id:
                self._objects.pop(own.id, None)
            else:  # as in MoveIt, no id means all objects
                self._objects.clear()
        elif own.operation in _MOVE:
            if known is not None:
                moved = copy.copy(known)
                moved.header, moved.pose = own.header, own.pose
                for name in ("primitive", "mesh", "plane"):
                    if len(poses := getattr(own, f"{name}_poses")):
                        setattr(moved, f"{name}_poses", poses)
                self._objects[own.id] = moved
        elif own.operation in _APPEND and known is not None:
            more = copy.copy(known)
            for name, plural in _SHAPES:
                setattr(more, plural, [*getattr(known, plural), *getattr(own, plural)])
                poses = f"{name}_poses"
                setattr(more, poses, [*getattr(known, poses), *getattr(own, poses)])
            self._objects[own.id] = more
        else:
            self._objects[own.id] = own

    def elements(
        self, pose_of_frame: Callable[[str], Transform]
    ) -> tuple[list[EnvironmentElement], dict[str, str]]:
        """Return the elements of all objects, and the reasons of those left out by their ids.

        Parameters
        ----------
        pose_of_frame : callable
            Takes a frame's name; returns its pose in the frame of the elements, or raises
            `UnknownFrameError`.
        """
        found, problems = [], {}
        frames = _FramePoses(self._transforms, lambda name, _: pose_of_frame(name))
        for name, own in self._objects.items():
            try:
                found += _elements(own, frames, f"collision object '{name}'")
            except UncPhysicsError as error:
                problems[name] = str(error)
        return found, problems


class _FramePoses:
    """Poses of frames, of transforms of a planning scene and of others.

    Parameters
    ----------
    transforms : mapping of str to TransformStamped
    pose_of : callable
        Takes the name of another frame, and the field that refers to it; returns its `Transform`.
    """

    def __init__(self, transforms, pose_of):
        self._transforms, self._pose_of = transforms, pose_of

    def of(self, header, field) -> Transform:
        """Return the pose of a header's frame."""
        one = self._transforms.get(header.frame_id)
        if one is None or one.header.frame_id == header.frame_id:
            return self._pose_of(header.frame_id, field)
        t = one.transform.translation
        pose = Pose(position=Point(x=t.x, y=t.y, z=t.z), orientation=one.transform.rotation)
        return self.of(one.header, field).compose(Transform.from_pose(pose, f"frame '{header.frame_id}'"))


def _check_ids(world, attached, objects, models):
    """Raise `InvalidRequestError` for a name that is not in the planning scene."""
    ids = [own.id for own in world] + [held.object.id for held in attached]
    for names, argument in ((objects, "objects"), (models, "models")):
        for name in names:
            if name not in ids:
                raise InvalidRequestError("is no object of the planning scene", field=argument, value=name)


def _check_added(objects, field):
    """Raise `NotSupportedError` for an operation other than ADD, which whole scenes do not have."""
    for k, own in enumerate(objects):
        if own.operation not in _ADD:
            raise NotSupportedError("must be ADD", field=f"{field.format(k)}.operation", value=own.operation)


def _shapes(own, field):
    """Return the shapes of an object: (name of the element's field, message, pose)."""
    found = []
    for name, plural in _SHAPES:
        shapes, poses = getattr(own, plural), getattr(own, f"{name}_poses")
        if len(poses) not in (0, len(shapes)):  # MoveIt treats missing poses as the identity
            raise InvalidRequestError(
                f"must be as many as {plural}, {len(shapes)}", field=f"{field}.{name}_poses", value=len(poses)
            )
        found += [
            (name, shape, poses[k] if len(poses) else Pose(), f"{field}.{name}_poses[{k}]")
            for k, shape in enumerate(shapes)
        ]
    return found


def _object(own, frames, model, mass, field):
    """Return a moving object, with a model or with its only shape."""
    state = ObjectState(id=own.id, mass=float(mass))
    place = frames.of(own.header, field).compose(Transform.from_pose(own.pose, f"{field}.pose"))
    shapes = _shapes(own, field)
    if model is not None:
        state.model = model
        if len(shapes) == 1:
            ((name, _, pose, where),) = shapes
            place = place.compose(Transform.from_pose(pose, where))
            if name == "primitive":
                place = place.compose(IDENTITY._replace(translation=-_middle(load_model(model))))
    else:
        if len(shapes) != 1 or shapes[0][0] == "plane":
            raise NotSupportedError(
                "moves, and must then be one primitive or one mesh, or have a model in models",
                field=field,
                value=own.id,
            )
        ((name, shape, pose, where),) = shapes
        setattr(state, name, shape)
        place = place.compose(Transform.from_pose(pose, where))
    state.pose.pose = place.pose()
    return state


def _middle(model):
    """Return the middle (3,) of a model's box, from its own origin along its axes [m]."""
    return model.corners.mean(axis=0) - model.origin


def _gap(held, frames, field):
    """Return the distance from a link's origin to the boxes of the shapes that it holds, 0 inside [m]."""
    own, field = held.object, f"{field}.object"
    link = frames.of(Header(frame_id=held.link_name), field).translation
    place = frames.of(own.header, field).compose(Transform.from_pose(own.pose, f"{field}.pose"))
    gaps = []
    for name, shape, pose, where in _shapes(own, field):
        R, t, _ = place.compose(Transform.from_pose(pose, where))
        if name == "mesh":
            corners = np.array([xyz(vertex) for vertex in shape.vertices]).reshape(-1, 3)
            low, high = corners.min(axis=0), corners.max(axis=0)
        else:
            high = np.array(_half_sizes(shape, f"{where}: {name}"))
            low = -high
        local = R.T @ (link - t)
        gaps.append(float(np.linalg.norm(local - np.clip(local, low, high))))
    return min(gaps, default=np.inf)


def _half_sizes(shape, field):
    """Return half the edges of a primitive's box [m]."""
    size = read_dimensions(shape, field)
    if shape.type == SolidPrimitive.BOX:
        return [0.5 * edge for edge in size]
    if shape.type == SolidPrimitive.SPHERE:
        return [size[0]] * 3
    if shape.type == SolidPrimitive.PRISM:
        reach = max((np.hypot(p.x, p.y) for p in shape.polygon.points), default=0.0)
        return [reach, reach, 0.5 * size[0]]
    return [size[1], size[1], 0.5 * size[0]]


def _link(name, radius, shape, frames):
    """Return the fixed object that stands for a link that holds objects."""
    if shape is None:
        if radius < _SMALLEST_BALL:
            raise NotSupportedError(
                "has its origin in an object that it holds, or close to it; give its shape in links",
                field="link",
                value=name,
            )
        shape = SolidPrimitive(type=SolidPrimitive.SPHERE, dimensions=packed([radius]))
    state = ObjectState(id=name, kind=ObjectState.FIXED, primitive=shape)
    state.pose.pose = frames.of(Header(frame_id=name), f"link '{name}'").pose()
    return state


def _elements(own, frames, field):
    """Return the elements of an obstacle, one for each of its shapes."""
    shapes = _shapes(own, field)
    place = frames.of(own.header, field).compose(Transform.from_pose(own.pose, f"{field}.pose"))
    elements = []
    for k, (name, shape, pose, where) in enumerate(shapes):
        element = EnvironmentElement(id=own.id if len(shapes) == 1 else f"{own.id}/{k}")
        setattr(element, name, shape)
        element.pose = place.compose(Transform.from_pose(pose, where)).pose()
        elements.append(element)
    return elements
