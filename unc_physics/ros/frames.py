"""Objects in other frames than the world's, by tf2 where it is installed."""

from __future__ import annotations

import copy
import importlib.util

import numpy as np
from rclpy.time import Time

from ..errors import UnknownFrameError
from ..validation import array, quaternion
from .conversions import UNKNOWN, rotation_matrix


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
            import tf2_ros

            self._buffer = tf2_ros.Buffer()
            self._listener = tf2_ros.TransformListener(self._buffer, node)

    @property
    def available(self) -> bool:
        """Whether there is tf2."""
        return self._buffer is not None

    def in_world(self, header, objects):
        """Objects as the world frame sees them; those given stay as they are.

        Parameters
        ----------
        header : Header
            Its frame may be empty, which means the world frame.
        objects : sequence of ObjectState

        Raises
        ------
        UnknownFrameError
            If no transform is known.
        """
        if header.frame_id in ("", self._world_frame):
            return objects
        if self._buffer is None:
            raise UnknownFrameError(
                f"must be empty or the world frame '{self._world_frame}', as tf2_ros is not installed",
                field="header.frame_id", value=header.frame_id)
        try:
            found = self._buffer.lookup_transform(self._world_frame, header.frame_id, Time.from_msg(header.stamp))
        except Exception as error:  # tf2's errors have no common base in Python
            raise UnknownFrameError(
                f"has no transform to '{self._world_frame}': {error}", field="header.frame_id", value=header.frame_id,
            ) from error
        t, q = found.transform.translation, found.transform.rotation
        R = rotation_matrix(quaternion((q.x, q.y, q.z, q.w), "the transform's rotation"))
        translation = array((t.x, t.y, t.z), (3,), "the transform's translation")
        return [transformed(message, R, translation, (q.x, q.y, q.z, q.w)) for message in objects]


def transformed(message, R, translation, q):
    """An object seen from another frame that does not move against its own.

    Parameters
    ----------
    message : ObjectState
    R : (3, 3) array
        Rotation from the object's frame to the other.
    translation : (3,) array
        Of the origin of the object's frame, in the other [m].
    q : tuple
        The rotation as a quaternion (x, y, z, w).

    Notes
    -----
    Covariances are about fixed axes, so both halves of pose and twist turn alike: ``diag(R, R) C diag(R, R)^T``.
    Those that mean unknown stay so.
    """
    result = copy.deepcopy(message)
    pose, twist = result.pose.pose, result.twist.twist
    _turn(pose.position, R, translation)
    _turn(twist.linear, R)
    _turn(twist.angular, R)
    pose.orientation.x, pose.orientation.y, pose.orientation.z, pose.orientation.w = _product(q, pose.orientation)
    A = np.kron(np.eye(2), R)
    for part in (result.pose, result.twist):
        C = np.array(part.covariance, float)
        if C[0] != UNKNOWN:
            part.covariance = (A @ C.reshape(6, 6) @ A.T).ravel()
    return result


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
