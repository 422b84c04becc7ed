"""Poses of a rosbag, read with ``rosbag2_py``."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np

from ..checks.errors import InvalidRequestError

#: Messages that hold a pose, and how many texts stand between their stamp and the pose.
POSES = {
    "geometry_msgs/msg/PoseStamped": 1,
    "geometry_msgs/msg/PoseWithCovarianceStamped": 1,
    "nav_msgs/msg/Odometry": 2,
}
_HEAD = 4  # bytes that tell the encoding, from whose end all is aligned


def read_rosbag(path, topic: str | None = None) -> tuple[str, np.ndarray, np.ndarray]:
    """Name, times (n,) [s] and poses (n, 7) of a topic; arguments and errors are those of `read_motions`."""
    import rosbag2_py  # pyright: ignore[reportMissingImports]

    reader: Any = rosbag2_py.SequentialReader()
    reader.open(rosbag2_py.StorageOptions(uri=str(path)), rosbag2_py.ConverterOptions("cdr", "cdr"))
    kinds = {entry.name: entry.type for entry in reader.get_all_topics_and_types() if entry.type in POSES}
    if topic is None and len(kinds) != 1:
        found = ", ".join(kinds) or f"none of {', '.join(POSES)}"
        raise InvalidRequestError(f"must name one of the bag's topics with poses: {found}", field="topic")
    chosen: str = next(iter(kinds)) if topic is None else topic
    if chosen not in kinds:
        raise InvalidRequestError(f"must be one of {', '.join(kinds)}", field="topic", value=chosen)
    rows = []
    while reader.has_next():
        name, data, _ = reader.read_next()
        if name == chosen:
            rows.append(pose_in(data, kinds[chosen]))
    rows = np.array(rows).reshape(-1, 8)
    return chosen, rows[:, 0], rows[:, 1:]


def pose_in(data: bytes, kind: str) -> list[float]:
    """Time [s], position and quaternion in a serialized message (CDR, as ROS 2 writes it).

    Read here, because ROS' own reader comes with all of its client library.
    """
    order = "<" if data[1] & 1 else ">"
    seconds, nanoseconds = struct.unpack_from(f"{order}iI", data, _HEAD)
    place = 8
    for _ in range(POSES[kind]):
        place += -place % 4
        (length,) = struct.unpack_from(f"{order}I", data, _HEAD + place)
        place += 4 + length
    place += -place % 8
    return [seconds + 1e-9 * nanoseconds, *struct.unpack_from(f"{order}7d", data, _HEAD + place)]
