"""Detected objects: their topics, duplicates, and which of them stand on something.

A detection has a pose and no velocity. An object close to a support is taken as at rest.
One in mid-air is not predicted.
"""

from __future__ import annotations

import functools
import importlib
import math
import re
from collections.abc import Callable, Collection, Mapping
from typing import Any, NamedTuple

import numpy as np
from geometry_msgs.msg import Pose, PoseWithCovariance, PoseWithCovarianceStamped
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from std_msgs.msg import Header

from unc_physics_msgs.msg import Environment, ObjectState, Scene

from ..checks.errors import UncPhysicsError
from ..checks.validation import array, quaternion
from ..shapes.distance import signed_distance
from ..shapes.packing_file import SpherePacking
from ..shapes.primitive_models import primitive_model
from ..spatial.rotation import cross_matrices, rotation_matrix
from .messages.covariances import MOST_ANGLE_VARIANCE, UNKNOWN
from .messages.environment import PackedElement, read_environment
from .messages.fields import pose_message, xyz, xyzw
from .parameters import BASE, CENTER, ClassModel

try:
    Detection3DArray: Any = importlib.import_module("vision_msgs.msg").Detection3DArray
except ImportError:  # optional
    Detection3DArray = None

#: Depth, history and reliability have parameters such as ``qos_overrides./TOPIC.subscription.depth``.
OVERRIDABLE = QoSOverridingOptions.with_default_policies()
_SIGMAS = 3.0
_SURFACE_ERROR = 2e-3  # m, of a model's surface
_NO_POSE = Pose()
_UPWARD = 0.5  # cosine of the steepest slope of a support


class _Body(NamedTuple):
    """An object or an obstacle, and how surely the object's pose is known.

    Attributes
    ----------
    name : str
    position : (3,) array
        Origin of the model's coordinates, world frame [m].
    orientation : (4,) array
        Quaternion (x, y, z, w), body to world.
    model : SpherePacking
    covariance : (6, 6) array
        Of position and rotation about fixed axes; zeros for an obstacle.
    """

    name: str
    position: np.ndarray
    orientation: np.ndarray
    model: SpherePacking
    covariance: np.ndarray

    @classmethod
    def obstacle(cls, own: PackedElement) -> _Body:
        """Return a packed element."""
        place = np.array(own.position), np.array(own.orientation)
        return cls(own.name, *place, own.model, np.zeros((6, 6)))

    @property
    def pose(self) -> tuple[np.ndarray, np.ndarray]:
        """Position of the centre of mass, world frame [m], and orientation."""
        return self.position - rotation_matrix(self.orientation) @ self.model.origin, self.orientation

    def std_along(self, normal: np.ndarray, point: np.ndarray) -> float:
        """Return the standard deviation of a point of the body along a normal, world frame [m]."""
        J = np.concatenate([normal, np.cross(point - self.position, normal)])
        return float(np.sqrt(max(J @ self.covariance @ J, 0.0)))


class Detections(NamedTuple):
    """Objects that were detected at one time.

    Attributes
    ----------
    header : Header
    objects : list of ObjectState
        In the frame of the header, with unknown velocity.
    named : collection of str
        Ids among theirs that the source gave.
    skipped : mapping of str
        Reasons of detections that were left out, by id.
    """

    header: Header
    objects: list[ObjectState]
    named: Collection[str]
    skipped: Mapping[str, str]


def read_detections(message, library, settings) -> Detections:
    """Return the objects of a Detection3DArray.

    The best hypothesis of each detection names its class. If the array has no frame, it is that of the first
    detection with one; detections in other frames, and those without hypotheses, are omitted.
    """
    objects, skipped, header = [], {}, message.header
    own_frames = not header.frame_id
    if own_frames:
        frames = (detection.header.frame_id for detection in message.detections)
        header = Header(stamp=header.stamp, frame_id=next(filter(None, frames), ""))
    names = set()
    for k, detection in enumerate(message.detections):
        valid = [
            one
            for one in detection.results
            if one.hypothesis.class_id and math.isfinite(one.hypothesis.score)
        ]
        best = max(valid, key=lambda one: one.hypothesis.score, default=None)
        name = detection.id or (f"detection_{k}" if best is None else f"{best.hypothesis.class_id}_{k}")
        if name in names:  # some detectors write the class into the id
            name = f"{name}_{k}"
        names.add(name)
        frame = detection.header.frame_id if own_frames else ""
        if best is None:
            skipped[name] = f"detections[{k}].results must name a class, with a finite score: none does"
        elif frame not in ("", header.frame_id):
            skipped[name] = (
                f"detections[{k}].header.frame_id must be that of the other detections, '{header.frame_id}'"
                f" (got '{frame}')"
            )
        else:
            objects.append(_detected(name, best, detection.bbox, library, settings))
    named = {detection.id for detection in message.detections if detection.id}
    return Detections(header, objects, named, skipped)


def detection_subscriptions(
    server, of_one: Callable[[Detections], object], of_many: Callable[[Detections], object], depth: int
) -> list:
    """Subscribe to ``~/detections``, and to ``~/observed/ID`` for each of `Settings.observed`.

    Parameters
    ----------
    server : PredictionServer
    of_one, of_many : callable
        Take the `Detections` of a topic of one object, and of an array.
    depth : int
        Number of messages of a topic that wait in the middleware.
    """
    node, library, parameters = server.node, server.library, server.parameters

    def one(name, kind, message):
        state = detected_object(name, kind, message.pose, library, parameters.settings)
        of_one(Detections(message.header, [state], {name}, {}))

    def many(message):
        of_many(read_detections(message, library, parameters.settings))

    found = [
        subscribe(
            node,
            PoseWithCovarianceStamped,
            f"~/observed/{topic_name(name)}",
            functools.partial(one, name, kind),
            depth,
        )
        for name, kind in parameters.settings.observed.items()
    ]
    if Detection3DArray is not None:
        found.append(subscribe(node, Detection3DArray, "~/detections", many, depth))
    return found


def topic_name(text: str) -> str:
    """Return a text as the last part of a topic name."""
    name = re.sub(r"[^A-Za-z0-9_]", "_", text)
    return name if name[:1].isalpha() else f"_{name}"


def subscribe(node, kind: type, topic: str, callback: Callable, depth: int = 1):
    """Subscribe by best effort, which matches all publishers, including sensors; users may override it."""
    profile = QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)
    return node.create_subscription(kind, topic, callback, profile, qos_overriding_options=OVERRIDABLE)


def detected_object(name: str, kind: str, pose: PoseWithCovariance, library, settings) -> ObjectState:
    """Return an object of a class with unknown velocity, at a pose as the class has it."""
    model, origin = settings.classes.get(kind, ClassModel(kind))
    return _at_point(name, model, pose, origin, library, settings)


def _detected(name, best, box, library, settings):
    """Return the object of a detection, whose box is its pose or shape where it has no other."""
    kind = best.hypothesis.class_id
    model, origin = settings.classes.get(kind, ClassModel(kind))
    size = xyz(box.size)
    if model not in library and all(math.isfinite(length) and length > 0.0 for length in size):
        library.add(model, primitive_model("box", size=size).named(model))
        pose = PoseWithCovariance(pose=box.center, covariance=best.pose.covariance)
        return _at_point(name, model, pose, "", library, settings)
    if best.pose.pose == _NO_POSE and not np.any(best.pose.covariance) and box.center != _NO_POSE:
        pose = PoseWithCovariance(pose=box.center, covariance=best.pose.covariance)
        return _at_point(name, model, pose, CENTER, library, settings)
    return _at_point(name, model, best.pose, origin, library, settings)


def _at_point(name, model, pose, origin, library, settings):
    """Return an object of a model, given the pose of a point of its box; empty: of the model's own origin."""
    state = ObjectState(id=name, model=model, pose=pose)
    state.twist.covariance[0] = UNKNOWN
    try:
        packing = library.shape(model)
    except UncPhysicsError:
        return state  # reported when the scene is read
    state.mass = settings.tracked_mass if packing.mass is None else 0.0
    if origin:
        state.pose = moved_pose(pose, -_point_of_box(packing, origin))
    return state


def _point_of_box(model, name):
    """Return the middle (3,) of a model's box, or of its base, from the model's origin along its axes [m]."""
    low, high = model.corners - model.origin
    point = 0.5 * (low + high)
    return np.array([*point[:2], low[2]]) if name == BASE else point


def moved_pose(pose: PoseWithCovariance, offset: np.ndarray) -> PoseWithCovariance:
    """Return the pose of another point of a body, at an offset (3,) along its axes [m].

    Variances that mean "not measured", and unknown covariances, are not carried over by the lever.
    """
    given = pose.pose
    arm = rotation_matrix(np.array(xyzw(given.orientation))) @ offset
    P = np.reshape(np.array(pose.covariance, float), (6, 6))
    if P[0, 0] != UNKNOWN:
        J = np.eye(6)
        measured = P.diagonal()[3:] <= MOST_ANGLE_VARIANCE
        J[:3, 3:] = -cross_matrices(arm) * measured
        P = J @ P @ J.T
    found = pose_message(np.array(xyz(given.position)) + arm, xyzw(given.orientation))
    return PoseWithCovariance(pose=found, covariance=P.ravel())


def settle_detected(
    scene: Scene, environment: Environment, library: Any, settings: Any
) -> tuple[Scene, dict[str, str]]:
    """Return the scene with objects at rest marked, and why objects are left out, by their ids.

    Parameters
    ----------
    scene : Scene
        Detected objects, in the world frame.
    environment : Environment
        What they may stand on, in the world frame.
    library : ModelLibrary
    settings : Settings

    Notes
    -----
    Nearest points decide: an object stands if its gap to a support, along the support's normal, is within
    three standard deviations of zero, or negative. Supports are elements, and objects that stand. Of two
    detections of the same model whose positions agree within three standard deviations, or within half the
    model's smallest extent, the surer one is kept.
    """
    up = -np.asarray(settings.gravity, float)
    length = float(np.linalg.norm(up))
    bodies: dict[str, _Body] = {}
    for own in scene.objects:
        try:
            bodies[own.id] = _body(own, library, settings)
        except UncPhysicsError:
            pass  # reported when the scene is read
    skipped = _duplicates(scene.objects, bodies)
    kept = [own for own in scene.objects if own.id not in skipped]
    if length > 0.0:
        open_ones = {own.id: own for own in kept if own.id in bodies}
        elements, packed = read_environment(environment, library.shape_packer, wait=False)
        gaps = _stand(open_ones, bodies, [*elements, *map(_Body.obstacle, packed)], up / length)
        for name, gap in gaps.items():
            skipped[name] = (
                f"hangs in mid-air, {gap} and has no twist; publish it on ~/scene with its twist if it falls"
            )
        kept = [own for own in kept if own.id not in gaps]
    return Scene(header=scene.header, objects=kept, environment=scene.environment), skipped


def _stand(open_ones, bodies, supports, up):
    """Mark objects that stand; return the gaps of the others, in words, by their ids."""
    below = list(supports)
    gaps = {}
    found = True
    while found and open_ones:
        found = False
        for name in list(open_ones):
            body = bodies[name]
            candidates = [each for support in below if (each := _gap(body, support, up)) is not None]
            if not candidates:
                gaps[name] = "with nothing below it,"
                continue
            what, gap, std = min(candidates, key=lambda each: each[1] - _SIGMAS * each[2])
            if gap <= _SIGMAS * std + _SURFACE_ERROR:
                open_ones.pop(name).at_rest = True
                gaps.pop(name, None)
                below.append(body)
                found = True
            else:
                gaps[name] = (
                    f"{gap:.3g} m above '{what}', which is more than 3 standard deviations of {std:.3g} m,"
                )
    return gaps


def _gap(body, support, up) -> tuple[str, float, float] | None:
    """Return a support's name, the gap [m] and its standard deviation [m]; None if it is not below."""
    known, pose, own = 0.0, None, support
    if isinstance(support, _Body):
        pose, own = support.pose, support.model
        reach = body.model.bounding_radius + support.model.bounding_radius
        if np.linalg.norm(body.pose[0] - support.pose[0]) > 2.0 * reach:
            return None
    gap, normal, point, below = signed_distance(body.model, body.pose, own, pose)
    if float(normal @ up) > -_UPWARD:
        return None
    if isinstance(support, _Body):
        known = support.std_along(normal, below)
    return support.name, gap, float(np.hypot(body.std_along(normal, point), known))


def smallest_extent(model: SpherePacking) -> float:
    """Return the shortest edge of the box about a model along its axes [m]."""
    return float(np.ptp(model.corners, axis=0).min())


def _body(own, library, settings) -> _Body:
    """Return an object at its mean pose."""
    model = library.shape(own.model)
    position = array(xyz(own.pose.pose.position), (3,), "position")
    orientation = quaternion(xyzw(own.pose.pose.orientation), "orientation")
    P = settings.covariance_defaults.known_pose(own.pose.covariance, "pose.covariance")
    return _Body(own.id, position, np.array(orientation), model, P.with_unmeasured())


def _duplicates(objects, bodies) -> dict[str, str]:
    """Return the reasons of detections of an object that another detection describes better."""
    skipped: dict[str, str] = {}
    surest = sorted(
        (own for own in objects if own.id in bodies), key=lambda own: np.trace(bodies[own.id].covariance)
    )
    for k, own in enumerate(surest):
        for better in surest[:k]:
            if own.model != better.model or better.id in skipped:
                continue
            body, other = bodies[own.id], bodies[better.id]
            apart = body.position - other.position
            distance = float(np.linalg.norm(apart))
            direction = apart / max(distance, 1e-12)
            P = body.covariance[:3, :3] + other.covariance[:3, :3]
            std = float(np.sqrt(max(direction @ P @ direction, 0.0)))
            extent = smallest_extent(body.model)
            # disjoint bodies are farther apart than their smallest extent
            if distance < max(min(_SIGMAS * std, 0.9 * extent), 0.5 * extent):
                skipped[own.id] = f"is a second detection of '{better.id}', {distance:.3g} m away"
                break
    return skipped
