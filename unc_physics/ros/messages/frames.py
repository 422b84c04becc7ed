"""Transforms of scenes from other frames to the world frame, by tf2 if installed."""

from __future__ import annotations

import copy
import importlib.util
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from rclpy.duration import Duration
from rclpy.time import Time

from unc_physics_msgs.msg import Environment, Scene

from ...checks.errors import UncPhysicsError, UnknownFrameError
from ...checks.validation import array, quaternion
from ...spatial.rotation import multiply, rotation_matrix
from .clocks import both_clocks
from .covariances import UNKNOWN
from .fields import packed, pose_message, xyz, xyzw


class Frames:
    """Transforms from other frames to the world frame, from tf2.

    Parameters
    ----------
    node : rclpy Node, optional
        Without it, only the world frame is known.
    world_frame : str
    timeout : callable
        Returns the time to wait for a missing transform [s]. Perception is often a few milliseconds ahead of
        transforms.
    """

    def __init__(self, node=None, world_frame: str = "world", timeout: Callable[[], float] = lambda: 0.0):
        self._world_frame, self._timeout = world_frame, timeout
        self._buffer, self._node = None, node
        if node is not None and importlib.util.find_spec("tf2_ros"):
            import tf2_ros  # pyright: ignore[reportMissingImports]  (optional)

            self._buffer = tf2_ros.Buffer()
            self._listener = tf2_ros.TransformListener(self._buffer, node)

    @property
    def available(self) -> bool:
        """Whether tf2 is installed."""
        return self._buffer is not None

    def is_world(self, frame: str) -> bool:
        """Return whether a frame is the world frame."""
        return frame in ("", self._world_frame)

    def clear(self) -> None:
        """Forget all transforms but static ones."""
        if self._buffer is not None:
            self._buffer.clear()

    def to_world(self, header, field: str = "scene.header") -> Transform | None:
        """Return the transform from a header's frame to the world frame; None if they are the same.

        The calling thread, which must not be the executor's, waits for a missing transform.

        Parameters
        ----------
        header : Header
            Header; an empty frame means the world frame.
        field : str
            Its place in the message, for errors.

        Raises
        ------
        UnknownFrameError
            If no transform arrives in time.
        """
        if self.is_world(header.frame_id):
            return None
        if self._buffer is None:
            raise UnknownFrameError(
                f"must be empty or '{self._world_frame}' (parameter world_frame), as there is no tf2_ros",
                field=f"{field}.frame_id",
                value=header.frame_id,
            )
        timeout = self._timeout()
        try:
            found = self._buffer.lookup_transform(
                self._world_frame,
                header.frame_id,
                Time.from_msg(header.stamp),
                timeout=Duration(seconds=timeout),
            )
        except Exception as error:  # tf2's errors have no common base in Python
            waited = f" within {timeout:g} s" if timeout else ""
            clocks = both_clocks(self._node, header.stamp)
            raise UnknownFrameError(
                f"has no transform to '{self._world_frame}' (parameter world_frame){waited} (parameter"
                f" transform_timeout): {error}; {clocks}",
                field=f"{field}.frame_id",
                value=header.frame_id,
            ) from error
        t, q = found.transform.translation, found.transform.rotation
        R = rotation_matrix(quaternion(xyzw(q), "the transform's rotation"))
        return Transform(R, array(xyz(t), (3,), "the transform's translation"), xyzw(q))


class Transform(NamedTuple):
    """Transform between two fixed frames; its methods return transformed copies of messages.

    Attributes
    ----------
    R : (3, 3) array
        Rotation.
    translation : (3,) array
        Position of the first frame's origin, in the second frame [m].
    q : tuple
        Rotation as a quaternion (x, y, z, w).
    """

    R: np.ndarray
    translation: np.ndarray
    q: tuple[float, float, float, float]

    @classmethod
    def from_pose(cls, pose, field: str) -> Transform:
        """Return the transform of a Pose message; a zero quaternion means no rotation, as in MoveIt.

        Raises
        ------
        InvalidOrientationError, NotFiniteError
            They name parts of ``field``.
        """
        q = xyzw(pose.orientation)
        try:
            q = quaternion(q if any(q) else (0.0, 0.0, 0.0, 1.0), "orientation")
            position = array(xyz(pose.position), (3,), "position")
        except UncPhysicsError as error:
            raise error.at(f"{field}.{error.field}") from None
        return cls(rotation_matrix(np.array(q)), position, tuple(q))

    def pose(self):
        """Return the Pose message of the first frame in the second one."""
        return pose_message(self.translation, self.q)

    def compose(self, other: Transform) -> Transform:
        """Return the transform that applies ``other`` first and this one second."""
        translation = self.R @ other.translation + self.translation
        return Transform(self.R @ other.R, translation, multiply(self.q, other.q))

    def scene(self, message):
        """Return a Scene in the other frame; its header and the shared pose error do not change."""
        return Scene(
            header=message.header,
            objects=[self.object(state) for state in message.objects],
            environment=self.environment(message.environment),
            pairs=message.pairs,
            common_pose_std=message.common_pose_std,
            common_pose_origin=message.common_pose_origin,
            joint_covariance=self.joint_covariance(message.joint_covariance),
        )

    def object(self, message):
        """Return an ObjectState in the other frame.

        Notes
        -----
        Covariances are about fixed axes, so all blocks of pose and twist are rotated:
        ``diag(R, R) C diag(R, R)^T``. Unknown covariances stay unknown.
        """
        result = copy.deepcopy(message)
        self._move(result.pose.pose)
        _rotate(result.twist.twist.linear, self.R)
        _rotate(result.twist.twist.angular, self.R)
        for part in (result.pose, result.twist):
            if part.covariance[0] != UNKNOWN:
                part.covariance = self._rotated(part.covariance, 2)
        result.covariance = packed(self._rotated(result.covariance, 4))
        return result

    def action(self, message):
        """Return an Action in the other frame."""
        result = copy.deepcopy(message)
        for point in result.trajectory.points:
            for place in point.transforms:
                _rotate(place.translation, self.R, self.translation)
                q = place.rotation
                q.x, q.y, q.z, q.w = multiply(self.q, xyzw(q))
            for twist in point.velocities:
                _rotate(twist.linear, self.R)
                _rotate(twist.angular, self.R)
        if not result.body_axes:
            _rotate(result.wrench.force, self.R)
            _rotate(result.wrench.torque, self.R)
        return result

    def joint_covariance(self, message):
        """Return a JointCovariance in the other frame."""
        result = copy.deepcopy(message)
        result.data = packed(self._rotated(result.data, 4 * len(message.object_ids)))
        return result

    def _rotated(self, entries, count):
        """Return the rotated entries of a covariance of ``count`` vectors; keep other sizes unchanged."""
        size = 3 * count
        if len(entries) != size**2:
            return entries
        C = np.reshape(entries, (count, 3, count, 3))
        return np.einsum("ab,ibjc,dc->iajd", self.R, C, self.R, optimize=True).ravel()

    def environment(self, message):
        """Return an Environment in the other frame."""
        # copied separately, as elements may share a pose
        elements = [copy.deepcopy(element) for element in message.elements]
        for element in elements:
            self._move(element.pose)
            _rotate(element.surface_velocity.linear, self.R)
            _rotate(element.surface_velocity.angular, self.R)
        return Environment(elements=elements, complete=message.complete)

    def region(self, message):
        """Return a BoxRegion in the other frame."""
        result = copy.deepcopy(message)
        self._move(result.pose)
        return result

    def _move(self, pose):
        _rotate(pose.position, self.R, self.translation)
        q = pose.orientation
        q.x, q.y, q.z, q.w = multiply(self.q, xyzw(q))


def _rotate(vector, R, translation=(0.0, 0.0, 0.0)):
    x, y, z = (R @ [vector.x, vector.y, vector.z] + translation).tolist()
    vector.x, vector.y, vector.z = x, y, z
