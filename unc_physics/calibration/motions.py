"""Recorded motions of one body: poses with times, from files."""

from __future__ import annotations

import csv
import os
import struct
import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from ..checks.array_field import Array, array_field
from ..checks.errors import InvalidRequestError, NotSupportedError, UncPhysicsError
from ..checks.validation import array, numbers, point, quaternion
from ..spatial.layout import POSITION, QUATERNION
from ..spatial.rotation import rotation_matrix

COLUMNS = ("time", "x", "y", "z", "qx", "qy", "qz", "qw")
#: Column of a CSV file that names the motion of each row.
MOTION = "motion"
#: Message types that hold a pose, and the number of strings between stamp and pose.
POSES = {
    "geometry_msgs/msg/PoseStamped": 1,
    "geometry_msgs/msg/PoseWithCovarianceStamped": 1,
    "nav_msgs/msg/Odometry": 2,
}
_HEAD = 4  # bytes of the encapsulation header; alignment counts from its end


@dataclass(frozen=True, eq=False, repr=False)
class Motion:
    """Poses of a body at several times.

    Attributes
    ----------
    name : str
    times : (n,) array
        Ascending [s].
    poses : (n, 7) array
        Position of the centre of mass [m] and quaternion (x, y, z, w) of ``R_world_body``.
    """

    name: str
    times: Array = array_field()
    poses: Array = array_field()

    def __repr__(self):
        return f"<Motion '{self.name}': {len(self.times)} poses in {self.duration:.3g} s>"

    def __post_init__(self):
        field = f"motion '{self.name}'"
        times = numbers(self.times, f"times of {field}")
        times = array(times, (times.size,), f"times of {field}")
        if len(times) < 3:
            raise InvalidRequestError("needs at least three poses", field=field, value=len(times))
        if not np.all(np.diff(times) > 0.0):
            at = int(np.argmin(np.diff(times) > 0.0)) + 1
            raise InvalidRequestError("must ascend", field=f"times[{at}] of {field}", value=times[at])
        poses = array(self.poses, (len(times), 7), f"poses of {field}").copy()
        for k in range(len(poses)):
            point(poses[k, :3], f"position of pose {k} of {field}")
            poses[k, 3:] = quaternion(poses[k, 3:], f"orientation of pose {k} of {field}")
        object.__setattr__(self, "times", times - times[0])
        object.__setattr__(self, "poses", poses)

    @property
    def duration(self) -> float:
        """From the first pose to the last [s]."""
        return float(self.times[-1])

    def nearest(self, time: float) -> float:
        """Return the time of the pose that is nearest to a time [s]."""
        return float(self.times[np.argmin(np.abs(self.times - time))])

    def pose(self, time: float) -> np.ndarray:
        """Return the pose (7,) at a time [s], interpolated linearly between two poses."""
        k = int(np.clip(np.searchsorted(self.times, time), 1, len(self.times) - 1))
        share = (time - self.times[k - 1]) / (self.times[k] - self.times[k - 1])
        first, second = self.poses[k - 1], self.poses[k].copy()
        if first[3:] @ second[3:] < 0.0:
            second[3:] *= -1.0
        between = first + np.clip(share, 0.0, 1.0) * (second - first)
        between[3:] /= np.linalg.norm(between[3:])
        return between


def read_motions(
    path: str | os.PathLike[str], *, origin: np.ndarray | None = None, topic: str | None = None
) -> list[Motion]:
    """Read recorded motions.

    Parameters
    ----------
    path : str or path-like
        One of: an ``.npz`` file with ``states`` (total, 13), of which position and quaternion count,
        ``offsets`` (m + 1,) of the motions in it and ``dt`` [s] between poses; a ``.csv`` file whose first
        line names the columns time, x, y, z, qx, qy, qz, qw and, if it holds several, motion; a folder of
        such files; a rosbag, where ``rosbag2_py`` can be imported.
    origin : (3,) array, optional
        The point whose positions were recorded, in the body frame, seen from the centre of mass [m]; such as
        `SpherePacking.origin`. By default the centre of mass.
    topic : str, optional
        Of a rosbag: a topic of ``geometry_msgs/PoseStamped``, ``PoseWithCovarianceStamped`` or
        ``nav_msgs/Odometry``; may be left out where it has only one.

    Raises
    ------
    InvalidRequestError
        If there is nothing to read, or something in it is no motion.
    NotSupportedError
        If a rosbag cannot be read here.
    """
    path = Path(path)
    if not path.exists():
        raise InvalidRequestError("does not exist", field=f"file {path}")
    if path.is_dir() and not (path / "metadata.yaml").is_file():
        files = sorted(file for file in path.iterdir() if file.suffix in (".csv", ".npz"))
        if not files:
            raise InvalidRequestError("holds no .csv or .npz files", field="motions", value=str(path))
        found = [motion for file in files for motion in _one_file(file)]
    elif path.is_dir() or path.suffix in (".mcap", ".db3"):
        if find_spec("rosbag2_py") is None:
            columns = ",".join((MOTION, *COLUMNS))
            raise NotSupportedError(
                f"is a rosbag, and rosbag2_py cannot be imported here; write a CSV file with {columns}",
                field="motions",
                value=str(path),
            )
        found = [Motion(*_read_rosbag(path, topic))]
    else:
        found = list(_one_file(path))
    if not found:
        raise InvalidRequestError("holds no motion", field="motions", value=str(path))
    return found if origin is None else [_of_center(motion, np.asarray(origin, float)) for motion in found]


def _of_center(motion, origin):
    """Return the motion of the centre of mass from that of the point ``origin`` in the body frame."""
    poses = motion.poses.copy()
    for k in range(len(poses)):
        poses[k, :3] -= rotation_matrix(poses[k, 3:]) @ origin
    return Motion(motion.name, motion.times, poses)


def _one_file(path) -> Iterator[Motion]:
    readers = {".npz": _npz, ".csv": _csv}
    if path.suffix not in readers:
        raise InvalidRequestError(
            "must be an .npz or .csv file, a folder of them, or a rosbag", field="motions", value=str(path)
        )
    try:
        yield from readers[path.suffix](path)
    except UncPhysicsError as error:
        if str(path) in (error.field or ""):
            raise
        raise error.at(f"file {path}: {error.field}") from error


def _npz(path):
    try:
        with np.load(path, allow_pickle=False) as file:
            missing = [name for name in ("states", "offsets", "dt") if name not in file.files]
            if missing:
                raise InvalidRequestError(f"has no '{missing[0]}'", field=f"file {path}")
            states, offsets, dt = file["states"].astype(float), file["offsets"], float(file["dt"])
            names = file["names"] if "names" in file.files else np.arange(len(offsets) - 1)
    except (OSError, ValueError, TypeError, KeyError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise InvalidRequestError("is no .npz archive of motions", field=f"file {path}") from error
    whole = offsets.ndim == 1 and offsets.dtype.kind in "iu" and len(offsets) and offsets[-1] == len(states)
    if (
        states.ndim != 2
        or states.shape[1] != 13
        or not whole
        or len(names) != len(offsets) - 1
        or not dt > 0.0
    ):
        raise InvalidRequestError(
            "must have states (total, 13), whole offsets that end with total, a name for each motion if any, "
            "and a positive dt",
            field=f"file {path}",
        )
    for name, k, end in zip(names, offsets[:-1], offsets[1:], strict=True):
        own = states[k:end]
        poses = np.concatenate([own[:, POSITION], own[:, QUATERNION]], axis=1)
        yield Motion(str(name), np.arange(len(own)) * dt, poses)


def _csv(path):
    try:
        yield from _rows_of_csv(path)
    except (OSError, UnicodeError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or "it is no table in UTF-8 text"
        raise InvalidRequestError(f"cannot be read: {reason}", field=f"file {path}") from None


def _rows_of_csv(path):
    with open(path, newline="", encoding="utf-8-sig") as file:
        reader = csv.DictReader(file)
        named = [name.strip() for name in reader.fieldnames or ()]
        reader.fieldnames = named
        missing = [name for name in COLUMNS if name not in named]
        if missing:
            raise InvalidRequestError(
                f"has no column '{missing[0]}'; it needs {', '.join(COLUMNS)}", field=f"file {path}"
            )
        rows: dict[str, list] = {}
        for line in reader:
            try:
                values = [float(line[name]) for name in COLUMNS]
            except (TypeError, ValueError):
                raise InvalidRequestError(
                    "must hold numbers", field=f"line {reader.line_num} of {path}", value=list(line.values())
                ) from None
            rows.setdefault(line.get(MOTION) or path.stem, []).append(values)
    for name, values in rows.items():
        values = np.array(values)
        yield Motion(name, values[:, 0], values[:, 1:])


def _read_rosbag(path, topic: str | None = None) -> tuple[str, np.ndarray, np.ndarray]:
    """Return name, times (n,) [s] and poses (n, 7) of a topic, read with ``rosbag2_py``."""
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
    """Return time [s], position and quaternion in a serialized message (CDR, as ROS 2 writes it).

    ROS' own deserialization would need its whole client library.
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
