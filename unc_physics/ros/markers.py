"""Pictures of predictions: markers for RViz, and boxes that contain objects with a chosen probability.

Markers are on ``~/markers`` for requests and on ``~/stream_markers`` for streamed scenes. Boxes are on
``~/occupancy``.
"""

from __future__ import annotations

import functools
import importlib
import itertools
import math
from typing import Any

import numpy as np
from geometry_msgs.msg import Pose
from shape_msgs.msg import SolidPrimitive
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from ..plots.palette import body_color
from ..scene.environment import Box, Capsule, Plane, Sphere, element_names
from ..shapes.packing_file import SpherePacking
from ..spatial.rotation import exp_vectors, rotate_vectors, rotation_matrix
from .messages.fields import duration, packed, point_message, pose_message, xyz, xyzw

_SIGMAS = 2.0  # half axes of ellipsoids and fans
_AXES = np.eye(3)
_CELLS = 12  # along the longest side of a drawn shape
_BALL = 1.3  # diameter of a cell's ball relative to the cell, so that there are no holes
_SPHERES = 300  # most spheres whose shape is drawn
_OF_UNCERTAINTY = ("ellipsoid", "rotation")
_OF_ENVIRONMENT = "environment"
_STONE = (0.6, 0.6, 0.6)
_SLAB = 4.0, 0.01  # m, sides and thickness of a drawn half-space
_BOX_ALPHA = 0.25
_ADD, _REMOVE = b"\x00", b"\x01"  # operations of collision objects


class MarkerTopic:
    """Topic with markers of each prediction, published to subscribers; they replace the previous ones."""

    def __init__(self, server, topic: str):
        self._server = server
        self._publisher = server.node.create_publisher(MarkerArray, topic, 1)

    def close(self):
        """Withdraw the topic."""
        self._server.node.destroy_publisher(self._publisher)

    def get_subscription_count(self) -> int:
        """Return the number of subscribers."""
        return self._publisher.get_subscription_count()

    def publish(self, header, job, answer) -> None:
        """Publish the markers of a prediction with the stamp of its start, as RViz hides future markers."""
        if self._publisher.get_subscription_count():
            self._publisher.publish(markers(header, job, answer, self._server.settings))


class OccupancyTopics:
    """Topics of predicted occupancy for subscribers: markers, and differences of MoveIt's planning scene."""

    def __init__(self, server):
        self._server, node = server, server.node
        self._markers = node.create_publisher(MarkerArray, "~/occupancy", 1)
        self._publishers = [self._markers]
        self._moveit: Any = None
        self._published: set[str] = set()  # ids of collision objects that planners may have
        try:
            self._moveit = importlib.import_module("moveit_msgs.msg")
        except ImportError:
            return
        self._scenes = node.create_publisher(self._moveit.PlanningScene, "~/occupancy_scene", 1)
        self._publishers.append(self._scenes)

    def close(self):
        """Withdraw the topics."""
        for publisher in self._publishers:
            self._server.node.destroy_publisher(publisher)

    def get_subscription_count(self) -> int:
        """Return the number of subscribers."""
        return sum(publisher.get_subscription_count() for publisher in self._publishers)

    def publish(self, job, answer) -> None:
        """Publish the occupancy of a prediction."""
        wanted = [publisher for publisher in self._publishers if publisher.get_subscription_count()]
        if not wanted:
            return
        settings = self._server.settings
        boxes = occupied_boxes(job, answer, settings.occupancy_probability)
        if self._markers in wanted:
            self._markers.publish(_box_markers(boxes, answer.header, settings))
        if self._moveit is not None and self._scenes in wanted:
            self._scenes.publish(self._difference(boxes, answer.header))

    def _difference(self, boxes, header):
        """Return a PlanningScene that adds the boxes and removes those of objects that are gone."""
        scene = self._moveit.PlanningScene(is_diff=True)
        scene.robot_state.is_diff = True
        found = {f"predicted/{name}/{k}": (pose, size) for name, k, pose, size in boxes}
        for name, (pose, size) in found.items():
            own = self._moveit.CollisionObject(header=header, id=name, operation=_ADD, pose=pose)
            own.primitives = [SolidPrimitive(type=SolidPrimitive.BOX, dimensions=packed(size))]
            own.primitive_poses = [Pose()]
            scene.world.collision_objects.append(own)
        for name in sorted(self._published - set(found)):
            own = self._moveit.CollisionObject(header=header, id=name, operation=_REMOVE)
            scene.world.collision_objects.append(own)
        self._published = set(found)
        return scene


def markers(header, job, answer, settings) -> MarkerArray:
    """Return the markers of a prediction, after one that deletes the previous ones.

    Parameters
    ----------
    header : Header
        Header whose stamp is used.
    job : Job
    answer : unc_physics_msgs/Prediction
    settings : Settings
        ``markers`` selects the kinds of markers; ``marker_lifetime`` is their duration.

    Notes
    -----
    Shapes show a model's largest spheres. The ellipsoid covers two standard deviations of the position. Each
    fan shows two standard deviations of the tilt of one model axis.
    """
    found = [Marker(action=Marker.DELETEALL)]
    lifetime = duration(settings.marker_lifetime)
    for k, (body, predicted) in enumerate(zip(job.scene.bodies, answer.objects, strict=True)):
        for kind in settings.markers:
            if kind != _OF_ENVIRONMENT and (body.free or kind not in _OF_UNCERTAINTY):
                marker = _marker(kind, body.model, predicted, body_color(k, body.fixed))
                marker.ns = f"{kind} {body.name}"
                found.append(marker)
    if _OF_ENVIRONMENT in settings.markers:
        elements = job.scene.environment
        for element, name in zip(elements, element_names(elements), strict=True):
            solids = _solids(element)
            for k, solid in enumerate(solids):
                solid.ns, solid.id, solid.color = f"{_OF_ENVIRONMENT} {name}", k, _color(_STONE, 0.5)
            found += solids
    for marker in found:
        marker.header.stamp, marker.header.frame_id = header.stamp, settings.world_frame
        marker.lifetime = lifetime
    return MarkerArray(markers=found)


def _solids(element) -> list[Marker]:
    """Return the markers of an element of the environment."""
    if isinstance(element, Plane):  # a slab below the surface, near the frame's origin
        side, thickness = _SLAB
        return [_solid(Marker.CUBE, (side, side, thickness), element, (0.0, 0.0, -0.5 * thickness))]
    if isinstance(element, Box):
        return [_solid(Marker.CUBE, element.size.tolist(), element)]
    width = 2.0 * element.radius
    if isinstance(element, Sphere):
        return [_solid(Marker.SPHERE, (width,) * 3, element)]
    found = [_solid(Marker.CYLINDER, (width, width, element.length), element)]
    if isinstance(element, Capsule):  # with a ball at each end, as no marker has this shape
        end = 0.5 * element.length
        found += [_solid(Marker.SPHERE, (width,) * 3, element, (0.0, 0.0, z)) for z in (-end, end)]
    return found


def _solid(kind, size, element, center=(0.0, 0.0, 0.0)):
    """Return a marker of a kind and size [m] at a point of an element's frame [m]."""
    marker = Marker(type=kind)
    marker.scale.x, marker.scale.y, marker.scale.z = size
    return _placed(marker, element.position + element.rotation @ center, _quaternion(element.rotation))


def _marker(kind, model, predicted, color):
    """Return one marker of an object, from its start or its last pose with covariance."""
    last = predicted.states[-1].pose
    if kind == "initial":
        return _shape(model, *_pose(predicted.start.pose), color, 0.3)
    if kind == "predicted":
        return _shape(model, *_pose(last.pose), color, 0.9)
    return _ellipsoid(last, color) if kind == "ellipsoid" else _fans(model, last)


def _pose(pose):
    return np.array(xyz(pose.position)), np.array(xyzw(pose.orientation))


def _placed(marker, position, quaternion):
    marker.pose = pose_message(position, quaternion)
    return marker


def _shape(model, position, quaternion, color, alpha):
    """Draw the surface of a model as balls of equal size, which fit in one marker."""
    points, size = _surface_cells(model)
    marker = Marker(type=Marker.SPHERE_LIST, color=_color(color, alpha))
    marker.scale.x = marker.scale.y = marker.scale.z = _BALL * size
    marker.points = [point_message(point) for point in points]
    return _placed(marker, position, quaternion)


@functools.lru_cache(maxsize=256)
def _surface_cells(model):
    """Return cell centres (n, 3) at a packing's surface, from the model's origin, and their size [m]."""
    low = (model.centers - model.radii[:, None]).min(axis=0)
    high = (model.centers + model.radii[:, None]).max(axis=0)
    size = float((high - low).max() / _CELLS)
    shape = np.maximum(np.ceil((high - low) / size).astype(int), 1)
    centers = np.moveaxis(np.indices(shape), 0, -1) * size + low + 0.5 * size
    filled = np.zeros(shape, bool)
    for center, radius in zip(model.centers[:_SPHERES], model.radii[:_SPHERES], strict=True):
        filled |= np.sum((centers - center) ** 2, axis=-1) < (radius + 0.5 * size) ** 2
    inner = np.pad(filled, 1)
    inside = np.all(
        [np.roll(inner, step, axis)[1:-1, 1:-1, 1:-1] for axis in range(3) for step in (-1, 1)], axis=0
    )
    return centers[filled & ~inside] - model.origin, size


def _ellipsoid(pose, color):
    """Draw two standard deviations of the position."""
    P = np.reshape(pose.covariance, (6, 6))[:3, :3]
    variances, axes = np.linalg.eigh(P)
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] *= -1.0
    marker = Marker(type=Marker.SPHERE, color=_color(color, 0.35))
    sizes = 2.0 * _SIGMAS * np.sqrt(np.maximum(variances, 1e-12))
    marker.scale.x, marker.scale.y, marker.scale.z = sizes.tolist()
    position, _ = _pose(pose.pose)
    return _placed(marker, position, _quaternion(axes))


def _fans(model, pose):
    """Draw two standard deviations of each model axis's tilt, as lines from the origin."""
    position, quaternion = _pose(pose.pose)
    R = rotation_matrix(quaternion)
    P = np.reshape(pose.covariance, (6, 6))[3:, 3:]
    variances, directions = np.linalg.eigh(P)
    marker = Marker(type=Marker.LINE_LIST)
    marker.scale.x = 0.01 * model.bounding_radius
    points, colors = [], []
    for axis in range(3):
        arm = 1.2 * model.bounding_radius * R[:, axis]
        ends = [arm]
        for variance, direction in zip(variances, directions.T, strict=True):
            tilt = _SIGMAS * np.sqrt(max(variance, 0.0)) * direction
            ends += [rotate_vectors(exp_vectors(sign * tilt), arm) for sign in (1.0, -1.0)]
        for end in ends:
            for point in (position, position + end):
                points.append(point_message(point))
                colors.append(_color(_AXES[axis], 0.9))
    marker.points, marker.colors = points, colors
    return _placed(marker, np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]))


def _quaternion(R):
    """Return the unit quaternion (x, y, z, w) of a rotation matrix, by the method of Bar-Itzhack."""
    K = np.array(
        [
            [R[0, 0] - R[1, 1] - R[2, 2], R[1, 0] + R[0, 1], R[2, 0] + R[0, 2], R[2, 1] - R[1, 2]],
            [R[1, 0] + R[0, 1], R[1, 1] - R[0, 0] - R[2, 2], R[2, 1] + R[1, 2], R[0, 2] - R[2, 0]],
            [R[2, 0] + R[0, 2], R[2, 1] + R[1, 2], R[2, 2] - R[0, 0] - R[1, 1], R[1, 0] - R[0, 1]],
            [R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], np.trace(R)],
        ]
    )
    return np.linalg.eigh(K)[1][:, -1]


def _color(rgb, alpha):
    r, g, b = (float(value) for value in rgb)
    return ColorRGBA(r=r, g=g, b=b, a=alpha)


def _box_markers(boxes, header, settings):
    """Return a marker of each box, after one that deletes the previous ones."""
    found = [Marker(action=Marker.DELETEALL)]
    names = list(dict.fromkeys(name for name, *_ in boxes))
    for name, k, pose, size in boxes:
        marker = Marker(ns=f"occupancy {name}", id=k, type=Marker.CUBE, pose=pose)
        marker.color = _color(body_color(names.index(name), False), _BOX_ALPHA)
        marker.scale.x, marker.scale.y, marker.scale.z = size.tolist()
        marker.lifetime = duration(settings.marker_lifetime)
        found.append(marker)
    for marker in found:
        marker.header = header
    return MarkerArray(markers=found)


def occupied_boxes(job, answer, probability: float) -> list[tuple[str, int, Pose, np.ndarray]]:
    """Return boxes that contain the moving objects with a probability, each by itself.

    Parameters
    ----------
    job : Job
    answer : unc_physics_msgs/Prediction
    probability : float

    Returns
    -------
    list of (str, int, Pose, (3,) array)
        Object, number of the state, pose of the box's centre, and its edge lengths [m].
    """
    found = []
    for body, predicted in zip(job.scene.bodies, answer.objects, strict=True):
        if not body.free:
            continue
        for k, state in enumerate(predicted.states):
            P = np.reshape(np.asarray(state.pose.covariance, float), (6, 6))
            pose, size = occupied_box(body.model, state.pose.pose, P, probability)
            found.append((body.name, k, pose, size))
    return found


def occupied_box(
    model: SpherePacking, pose: Pose, P: np.ndarray, probability: float
) -> tuple[Pose, np.ndarray]:
    """Return the pose of the centre and the edge lengths [m] of a box around an uncertain object.

    Parameters
    ----------
    model : SpherePacking
    pose : Pose
        Mean pose of the model's origin.
    P : (6, 6) array
        Covariance of position and rotation about fixed axes.
    probability : float
        Of the whole object being inside the box, if the errors are Gaussian and rotations small.

    Notes
    -----
    Errors lie within an ellipsoid with this ``probability``, by the chi-square distribution of six degrees of
    freedom. In it no point of the object moves farther along an axis than the ellipsoid's radius times its
    standard deviation along that axis. So the box is conservative.
    """
    low, high = model.bounds - model.origin
    R = rotation_matrix(np.array(xyzw(pose.orientation)))
    corners = np.array(list(itertools.product(*zip(low, high, strict=True))))
    arms, radius = corners @ R.T, ellipsoid_radius(probability)
    moved = np.zeros(3)
    for axis in range(3):
        normal = R[:, axis]
        J = np.hstack([np.broadcast_to(normal, arms.shape), np.cross(arms, normal)])
        variances = np.einsum("ni,ij,nj->n", J, P, J)
        moved[axis] = radius * math.sqrt(max(float(variances.max()), 0.0))
    center = np.array(xyz(pose.position)) + R @ (0.5 * (low + high))
    return pose_message(center, xyzw(pose.orientation)), high - low + 2.0 * moved


def ellipsoid_radius(probability: float) -> float:
    """Return the radius, in standard deviations, of a 6-dimensional Gaussian's ellipsoid of a probability."""
    low, high = 0.0, 100.0
    for _ in range(60):
        radius = 0.5 * (low + high)
        half = 0.5 * radius**2
        if 1.0 - math.exp(-half) * (1.0 + half + 0.5 * half**2) < probability:
            low = radius
        else:
            high = radius
    return high
