"""Predicted and tracked poses on tf."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from geometry_msgs.msg import PoseWithCovariance, TransformStamped, Vector3
from std_msgs.msg import Header

#: End of the names of frames of predicted and of tracked objects, after the object's id.
PREDICTED, TRACKED = "_predicted", "_tracked"


class TransformTopic:
    """Publisher of poses as transforms, made when it is first needed; needs tf2_msgs.

    Parameters
    ----------
    server : PredictionServer
    suffix : str
        End of the frames' names, after the object's id.
    """

    def __init__(self, server, suffix: str = PREDICTED):
        self._server, self._suffix = server, suffix
        self._publisher: Any = None
        self._missing = False

    def close(self) -> None:
        """Withdraw the topic."""
        if self._publisher is not None:
            self._server.node.destroy_publisher(self._publisher)

    def publish(self, header: Header, poses: Mapping[str, PoseWithCovariance]) -> None:
        """Publish the mean poses of objects by their ids."""
        if self._missing or not poses:
            return
        try:
            from tf2_msgs.msg import TFMessage  # pyright: ignore[reportMissingImports]  (optional)
        except ImportError:
            self._missing = True
            self._server.log.warning("publish_tf is set, but tf2_msgs is not installed")
            return
        if self._publisher is None:
            self._publisher = self._server.node.create_publisher(TFMessage, "/tf", 100)
        self._publisher.publish(TFMessage(transforms=transforms(header, poses, self._suffix)))


def transforms(
    header: Header, poses: Mapping[str, PoseWithCovariance], suffix: str = PREDICTED
) -> list[TransformStamped]:
    """Return the transforms from the header's frame to objects, with the header's stamp."""
    found = []
    for name, pose in poses.items():
        message = TransformStamped(header=header, child_frame_id=f"{name}{suffix}")
        p = pose.pose.position
        message.transform.translation = Vector3(x=p.x, y=p.y, z=p.z)
        message.transform.rotation = pose.pose.orientation
        found.append(message)
    return found
