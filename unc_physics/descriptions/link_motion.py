"""A robot's links as they move along a trajectory of its joints."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ..checks.errors import InvalidHorizonError, InvalidRequestError
from ..checks.validation import numbers, point, positive, quaternion
from .reading import require_libraries
from .world import quaternion_of


@dataclass(frozen=True, eq=False)
class LinkMotion:
    """Poses of a link's own origin at some times; between them it moves on the shortest way.

    Attributes
    ----------
    times : (n,) array
        From the trajectory's start [s], ascending.
    positions : (n, 3) array
        Of the link's origin, world frame [m].
    orientations : (n, 4) array
        Quaternions (x, y, z, w) of ``R_world_link``.
    """

    times: np.ndarray
    positions: np.ndarray
    orientations: np.ndarray

    def of_com(self, origin: ArrayLike) -> LinkMotion:
        """The same motion, of the centre of mass (COM) of the link's model.

        Parameters
        ----------
        origin : (3,) array
            The link's origin in the body frame [m]: `SpherePacking.origin`.
        """
        from scipy.spatial.transform import Rotation

        offset = np.array(point(origin, "origin"))
        return LinkMotion(
            self.times,
            self.positions - Rotation.from_quat(self.orientations).apply(offset),
            self.orientations,
        )


def link_motions(
    path: str | os.PathLike[str],
    joint_names: Sequence[str],
    times: ArrayLike,
    positions: ArrayLike,
    *,
    links: Sequence[str] | None = None,
    base_position: ArrayLike = (0.0, 0.0, 0.0),
    base_orientation: ArrayLike = (0.0, 0.0, 0.0, 1.0),
    period: float | None = 0.02,
) -> dict[str, LinkMotion]:
    """Move a robot's joints along a trajectory, and tell where its links are on the way.

    The fields of a ``trajectory_msgs/JointTrajectory`` are what it takes: ``joint_names``, and the points'
    ``time_from_start`` and ``positions``. Joints that are not named stay at 0.

    Parameters
    ----------
    path : path-like
        The robot's URDF.
    joint_names : sequence of str
    times : (n,) array
        Of the trajectory's points, from its start [s], ascending.
    positions : (n, joints) array
        [rad], or [m] for prismatic joints.
    links : sequence of str, optional
        Those that are wanted; by default all that have a shape.
    base_position : (3,) array
        Of the robot's root, world frame [m].
    base_orientation : (4,) array
        Quaternion (x, y, z, w) of ``R_world_base``.
    period : float, optional
        Longest time between poses [s]: links on a turning joint move along arcs, so poses are told between
        the trajectory's points, too, with joints on straight lines. None tells those at the points alone.

    Returns
    -------
    dict of str to LinkMotion
        By the links' names.

    Raises
    ------
    InvalidRequestError
        For a joint or link that the robot does not have, and arrays of other shapes.
    InvalidHorizonError
        If times do not ascend.
    NotSupportedError
        If a library is missing.
    """
    from scipy.spatial.transform import Rotation

    from .urdf import load_robot, set_joints

    require_libraries()
    points, columns = _checked(joint_names, times, positions)
    robot, _ = load_robot(Path(path))
    with_shapes = [link.name for link in robot.robot.links if link.collisions or link.visuals]
    wanted = with_shapes if links is None else list(links)
    for name in wanted:
        if name not in robot.link_map:
            raise InvalidRequestError("is no link of the robot", field="links", value=name)
    when = points if period is None else _refined(points, positive(period, "period"))
    joints = np.stack([np.interp(when, points, column) for column in columns.T], axis=1)
    poses = np.empty((len(wanted), len(when), 4, 4))
    for k, row in enumerate(joints):
        set_joints(robot, dict(zip(joint_names, row.tolist(), strict=True)))
        for j, name in enumerate(wanted):
            poses[j, k] = robot.get_transform(name)
    base = np.eye(4)
    turn = np.array(quaternion(base_orientation, "base_orientation"))
    base[:3, :3] = Rotation.from_quat(turn).as_matrix()
    base[:3, 3] = point(base_position, "base_position")
    return {name: _motion(when, base @ poses[j]) for j, name in enumerate(wanted)}


def _checked(joint_names, times, positions):
    """Times (n,) and positions (n, joints) of a trajectory."""
    times, positions = numbers(times, "times"), numbers(positions, "positions")
    if times.ndim != 1 or len(times) == 0:
        raise InvalidRequestError("must be a list of times, at least one", field="times", value=times.shape)
    if positions.shape != (len(times), len(joint_names)):
        raise InvalidRequestError(
            f"must have {len(times)} rows, one for each time, and {len(joint_names)} columns",
            field="positions",
            value=positions.shape,
        )
    if not np.isfinite(times).all() or np.any(np.diff(times) <= 0.0) or times[0] < 0.0:
        raise InvalidHorizonError("must ascend from 0 or later", field="times", value=times.tolist())
    return times, positions


def _refined(times, period):
    """The times with others between them, none farther apart than the period."""
    pieces = [
        np.linspace(start, end, max(int(np.ceil((end - start) / period - 1e-9)), 1), endpoint=False)
        for start, end in pairwise(times)
    ]
    return np.concatenate([*pieces, times[-1:]])


def _motion(when, poses):
    orientations = np.array([quaternion_of(pose) for pose in poses])
    for k in range(1, len(orientations)):  # q and -q are one rotation; neighbours have the nearer one
        if orientations[k] @ orientations[k - 1] < 0.0:
            orientations[k] *= -1.0
    return LinkMotion(when, poses[:, :3, 3].copy(), orientations)
