"""Scenes in other frames than the world's, by tf2 where it is installed."""

from __future__ import annotations

import copy
import importlib.util
from typing import NamedTuple

import numpy as np
from rclpy.time import Time

from ..checks.errors import UnknownFrameError
from ..checks.validation import array, quaternion
from ..physics.rotation import rotation_matrix
from .conversions import UNKNOWN


class Frames:
    """Transforms from other frames to the world frame, as far as tf2 knows them.

    Parameters
    ----------
    node : rclpy Node
    world_frame : str
    """

    def __init__(self, node, world_frame: str):
        self._world_frame = world_frame
        self._buffer = None
        if importlib.util.find_spec("tf2_ros"):
            import tf2_ros  # pyright: ignore[reportMissingImports]  (optional)

            self._buffer = tf2_ros.Buffer()
            self._listener = tf2_ros.TransformListener(self._buffer, node)

    @property
    def available(self) -> bool:
        """Whether there is tf2."""
        return self._buffer is not None

    def to_world(self, header) -> Transform | None:
        """How things in a header's frame are seen from the world frame; None where that is the same.

        Parameters
        ----------
        header : Header
            Its frame may be empty, which means the world frame.

        Raises
        ------
        UnknownFrameError
            If no transform is known.
        """
        if header.frame_id in ("", self._world_frame):
            return None
        if self._buffer is None:
            raise UnknownFrameError(
                f"must be empty or the world frame '{self._world_frame}', as tf2_ros is not installed",
                field="header.frame_id",
                value=header.frame_id,
            )
        try:
            found = self._buffer.lookup_transform(
                self._world_frame, header.frame_id, Time.from_msg(header.stamp)
            )
        except Exception as error:  # tf2's errors have no common base in Python
            raise UnknownFrameError(
                f"has no transform to '{self._world_frame}': {error}",
                field="header.frame_id",
                value=header.frame_id,
            ) from error
        t, q = found.transform.translation, found.transform.rotation
        R = rotation_matrix(quaternion((q.x, q.y, q.z, q.w), "the transform's rotation"))
        translation = array((t.x, t.y, t.z), (3,), "the transform's translation")
        return Transform(R, translation, (q.x, q.y, q.z, q.w))


class Transform(NamedTuple):
    """From one frame to another that does not move against it; messages that are given stay as they are.

    Attributes
    ----------
    R : (3, 3) array
        Rotation from the one frame to the other.
    translation : (3,) array
        Of the origin of the one frame, in the other [m].
    q : tuple
        The rotation as a quaternion (x, y, z, w).
    """

    R: np.ndarray
    translation: np.ndarray
    q: tuple[float, float, float, float]

    def object(self, message):
        """An ObjectState as the other frame sees it.

        Notes
        -----
        Covariances are about fixed axes, so both halves of pose and twist turn alike:
        ``diag(R, R) C diag(R, R)^T``. Those that mean unknown stay so.
        """
        result = copy.deepcopy(message)
        self._move(result.pose.pose)
        _turn(result.twist.twist.linear, self.R)
        _turn(result.twist.twist.angular, self.R)
        A = np.kron(np.eye(2), self.R)
        for part in (result.pose, result.twist):
            C = np.array(part.covariance, float)
            if C[0] != UNKNOWN:
                part.covariance = (A @ C.reshape(6, 6) @ A.T).ravel()
        return result

    def environment(self, message):
        """An Environment as the other frame sees it."""
        result = copy.deepcopy(message)
        for plane in result.planes:
            normal = self.R @ plane.coef[:3]
            plane.coef = np.append(normal, plane.coef[3] - normal @ self.translation)
        for pose in result.primitive_poses:
            self._move(pose)
        return result

    def region(self, message):
        """A BoxRegion as the other frame sees it."""
        result = copy.deepcopy(message)
        self._move(result.pose)
        return result

    def _move(self, pose):
        _turn(pose.position, self.R, self.translation)
        q = pose.orientation
        q.x, q.y, q.z, q.w = _product(self.q, q)


def _turn(vector, R, translation=(0.0, 0.0, 0.0)):
    x, y, z = (R @ [vector.x, vector.y, vector.z] + translation).tolist()
    vector.x, vector.y, vector.z = x, y, z


def _product(a, b):
    """Hamilton product of a quaternion (x, y, z, w) and a quaternion message."""
    ax, ay, az, aw = a
    return (
        aw * b.x + ax * b.w + ay * b.z - az * b.y,
        aw * b.y - ax * b.z + ay * b.w + az * b.x,
        aw * b.z + ax * b.y - ay * b.x + az * b.w,
        aw * b.w - ax * b.x - ay * b.y - az * b.z,
    )
