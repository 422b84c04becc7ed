"""Motion of a robot's links along a joint trajectory."""

from __future__ import annotations

import os
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..checks.errors import InvalidHorizonError, InvalidRequestError, UncPhysicsError
from ..checks.validation import numbers, point, positive, quaternion
from ..scene.actions import PosePath
from ..scene.body import RigidBody
from ..scene.body_belief import BodyBelief
from .link_solid import packed_link
from .reading import require_libraries
from .world import WorldDescription, quaternion_of

_MOMENT = 1e-3  # s, between the two poses of a link that stands still
_STILL = 1e-9  # tolerance of a pose that stands still, in m and for quaternions


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
) -> dict[str, PosePath]:
    """Compute the motion of a robot's links along a joint trajectory.

    The arguments are fields of a ``trajectory_msgs/JointTrajectory``: ``joint_names``, and the points'
    ``time_from_start`` and ``positions``. Joints that are not named stay at 0.

    Parameters
    ----------
    path : path-like
        URDF of the robot.
    joint_names : sequence of str
    times : (n,) array
        Times of the trajectory's points from its start [s], ascending.
    positions : (n, joints) array
        [rad], or [m] for prismatic joints.
    links : sequence of str, optional
        Names of the links; by default all links with a shape.
    base_position : (3,) array
        Position of the robot's root, world frame [m].
    base_orientation : (4,) array
        Quaternion (x, y, z, w) of ``R_world_base``.
    period : float, optional
        Longest time between poses [s]. Links on a revolute joint move along arcs, so poses are added between
        the trajectory's points, with linear interpolation of joints. None adds no poses.

    Returns
    -------
    dict of str to PosePath
        Path of each link's origin, by link name.

    Raises
    ------
    InvalidRequestError
        For unknown joints or links, and arrays with wrong shapes.
    InvalidHorizonError
        If times do not ascend.
    NotSupportedError
        If a library is missing.
    """
    from scipy.spatial.transform import Rotation

    from .urdf import link_shapes, load_robot, set_joints

    require_libraries()
    points, columns = _checked(joint_names, times, positions)
    robot, root = load_robot(Path(path))
    folder = Path(path).parent
    with_shapes = [str(link.get("name")) for link in root.findall("link") if link_shapes(link, folder)[0]]
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
    """Return the checked times (n,) and positions (n, joints) of a trajectory."""
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
    """Add times so that intervals are at most ``period``."""
    pieces = [
        np.linspace(start, end, max(int(np.ceil((end - start) / period - 1e-9)), 1), endpoint=False)
        for start, end in pairwise(times)
    ]
    return np.concatenate([*pieces, times[-1:]])


def _motion(when, poses):
    """Return the path of a link through its poses (n, 4, 4)."""
    orientations = np.array([quaternion_of(pose) for pose in poses])
    if len(when) == 1:  # the link stands still
        when, poses, orientations = (
            np.array([when[0], when[0] + _MOMENT]),
            np.repeat(poses, 2, axis=0),
            np.repeat(orientations, 2, axis=0),
        )
    return PosePath(times=when, positions=poses[:, :3, 3], orientations=orientations)


def load_robot_motion(
    path: str | os.PathLike[str],
    joint_names: Sequence[str],
    times: ArrayLike,
    positions: ArrayLike,
    *,
    spheres: int = 500,
    uniform: bool = True,
    repair: bool = False,
    **options: Any,
) -> WorldDescription:
    """Load a robot that moves along a joint trajectory, as bodies of a scene.

    Parameters
    ----------
    path, joint_names, times, positions
        As in `link_motions`, which takes the ``options``: ``links``, ``base_position``, ``base_orientation``
        and ``period``.
    spheres : int
        Number of spheres of each link.
    uniform, repair : bool
        As in `from_urdf`. Mass and inertia do not affect the motion of a link on a trajectory.

    Returns
    -------
    WorldDescription
        A body for each link, which follows its path, or is fixed if no joint moves it. Also the poses of
        fixed links, and a list of omitted parts.

    Raises
    ------
    UncPhysicsError
        As in `link_motions` and `reading.read_description`.
    """
    from .reading import read_description

    motions = link_motions(path, joint_names, times, positions, **options)
    description = read_description(path, {})
    bodies, beliefs, left_out, notes = [], {}, list(description.left_out), list(description.notes)
    for link in description.links:
        if link.name not in motions:
            continue
        try:
            model, more = packed_link(description.path, link, spheres, uniform=uniform, repair=repair)
        except UncPhysicsError as error:
            left_out.append(f"{link.name}: {error}")
            continue
        notes += more
        way = of_com(motions[link.name], model.origin)
        spread = max(np.ptp(way.positions, axis=0).max(), np.ptp(way.orientations, axis=0).max())
        if spread < _STILL:
            bodies.append(RigidBody(link.name, model, fixed=True))
            beliefs[link.name] = BodyBelief(position=way.positions[0], orientation=way.orientations[0])
        else:
            bodies.append(RigidBody(link.name, model, trajectory=way))
    return WorldDescription((), tuple(bodies), beliefs, tuple(left_out), tuple(notes))


def of_com(path: PosePath, origin: ArrayLike) -> PosePath:
    """Return the path of a body's centre of mass (COM) if its model's origin follows ``path``.

    Parameters
    ----------
    path : PosePath
    origin : (3,) array
        The model's origin in the body frame [m]: `SpherePacking.origin`.
    """
    from scipy.spatial.transform import Rotation

    offset = np.array(point(origin, "origin"))
    turned = Rotation.from_quat(np.array(path.orientations)).apply(offset)
    return PosePath(times=path.times, positions=path.positions - turned, orientations=path.orientations)
