"""Transforms of scenes from other frames to the world frame, by tf2 if installed."""

from __future__ import annotations

import copy
import importlib.util
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from geometry_msgs.msg import Pose, Twist, Wrench
from geometry_msgs.msg import Transform as TransformMessage
from rclpy.duration import Duration
from rclpy.time import Time

from ...checks.errors import UncPhysicsError, UnknownFrameError
from ...checks.validation import array, quaternion
from ...spatial.rotation import multiply, rotation_matrix
from .clocks import both_clocks
from .covariances import UNKNOWN
from .fields import packed, pose_message, quaternion_message, xyz, xyzw

#: Parts of messages that move with a frame, and those of vectors that turn with it.
_PLACES = {Pose: ("position", "orientation"), TransformMessage: ("translation", "rotation")}
_VECTORS = {Twist: ("linear", "angular"), Wrench: ("force", "torque")}
#: Packages whose messages have such parts, and names of covariances in these.
_PACKAGES = "unc_physics_msgs", "geometry_msgs", "trajectory_msgs"
_COVARIANCES = "covariance", "data"


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
    """Transform between two fixed frames.

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

    def moved(self, message: Any) -> Any:
        """Return a copy of a message, or of a list of them, in the other frame.

        Notes
        -----
        Poses, twists and wrenches are moved, wherever they are in it, but for wrenches along the axes of a
        body. Covariances are about fixed axes, so all their blocks are rotated:
        ``diag(R, ...) C diag(R, ...)^T``. Unknown covariances stay unknown. Shared pose errors and shapes do
        not change.
        """
        kind = type(message)
        if kind is list:
            return [self.moved(part) for part in message]
        if kind in _PLACES:
            point, turn = _PLACES[kind]
            q = quaternion_message(multiply(self.q, xyzw(getattr(message, turn))))
            return kind(**{point: _turned(getattr(message, point), self.R, self.translation), turn: q})
        if kind in _VECTORS:
            return kind(**{name: _turned(getattr(message, name), self.R) for name in _VECTORS[kind]})
        if kind.__module__.partition(".")[0] not in _PACKAGES:
            return message
        found = copy.copy(message)
        for name in message.get_fields_and_field_types():
            value = getattr(message, name)
            if name in _COVARIANCES:
                setattr(found, name, self._rotated(value))
            elif not (name == "wrench" and message.body_axes):
                setattr(found, name, self.moved(value))
        return found

    def _rotated(self, entries):
        """Return the rotated entries of a covariance of vectors; keep unknown ones and other sizes."""
        count, rest = divmod(math.isqrt(len(entries)), 3)
        if rest or (3 * count) ** 2 != len(entries) or (count and entries[0] == UNKNOWN):
            return entries
        C = np.reshape(entries, (count, 3, count, 3))
        C = np.einsum("ab,ibjc,dc->iajd", self.R, C, self.R, optimize=True).ravel()
        return C if isinstance(entries, np.ndarray) else packed(C)


IDENTITY = Transform(np.eye(3), np.zeros(3), (0.0, 0.0, 0.0, 1.0))


def _turned(vector, R, translation=(0.0, 0.0, 0.0)):
    """Return a rotated Vector3, or a moved Point."""
    x, y, z = (R @ xyz(vector) + translation).tolist()
    return type(vector)(x=x, y=y, z=z)
