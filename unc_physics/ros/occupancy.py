"""Predicted occupancy for planners: boxes that contain objects with a chosen probability."""

from __future__ import annotations

import importlib
import math
from typing import Any

import numpy as np
from geometry_msgs.msg import Pose
from shape_msgs.msg import SolidPrimitive
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from ..geometry.packing_file import SpherePacking
from ..plots.palette import body_color
from ..spatial.rotation import rotation_matrix
from .messages.fields import duration, packed, pose_message, xyz, xyzw

_ALPHA = 0.25
_ADD, _REMOVE = b"\x00", b"\x01"  # operations of collision objects


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
            self._markers.publish(_markers(boxes, answer.header, settings))
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


def _markers(boxes, header, settings):
    """Return a marker of each box, after one that deletes the previous ones."""
    found = [Marker(action=Marker.DELETEALL)]
    names = list(dict.fromkeys(name for name, *_ in boxes))
    for name, k, pose, size in boxes:
        r, g, b = (float(value) for value in body_color(names.index(name), False))
        marker = Marker(
            ns=f"occupancy {name}",
            id=k,
            type=Marker.CUBE,
            pose=pose,
            color=ColorRGBA(r=r, g=g, b=b, a=_ALPHA),
        )
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
    corners = np.array(
        [[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
    )
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
