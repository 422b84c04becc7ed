"""Read paths and wrenches from YAML files."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from ..checks.errors import InvalidRequestError
from ..checks.validation import number
from .actions import PosePath, Wrench
from .entries import ORIENTATION, ROLL_PITCH_YAW, at_field, check_keys, read_numbers, read_orientation

_VELOCITIES = ("linear_velocity", "angular_velocity")
_POSE_KEYS = ("time", "position", ORIENTATION, ROLL_PITCH_YAW, *_VELOCITIES)
_WRENCH_KEYS = tuple(spec.name for spec in fields(Wrench))


def read_path(poses, place) -> PosePath:
    """Return the path that a list of poses describes."""
    if not isinstance(poses, list):
        raise InvalidRequestError("must be a list of poses", field=place, value=poses)
    count = len(poses)
    read = {key: np.full((count, 3), np.nan) for key in _VELOCITIES}
    times, positions, orientations = np.zeros(count), np.zeros((count, 3)), np.zeros((count, 4))
    for k, pose in enumerate(poses):
        entry = f"{place}[{k}]"
        check_keys(pose, _POSE_KEYS, entry)
        for key in ("time", "position"):
            if pose.get(key) is None:
                raise InvalidRequestError("must be given", field=f"{entry}.{key}")
        times[k] = number(pose["time"], f"{entry}.time")
        positions[k] = read_numbers(pose["position"], (3,), f"{entry}.position")
        given = read_orientation(pose, entry)
        orientations[k] = (0, 0, 0, 1) if given is None else given
        for key, values in read.items():
            if pose.get(key) is not None:
                values[k] = read_numbers(pose[key], (3,), f"{entry}.{key}")
    return at_field(
        place,
        PosePath,
        times=times,
        positions=positions,
        orientations=orientations,
        linear_velocities=read["linear_velocity"],
        angular_velocities=read["angular_velocity"],
    )


def read_wrenches(entries, place) -> list[Wrench]:
    """Return the wrenches that a list describes."""
    if not isinstance(entries, list):
        raise InvalidRequestError("must be a list", field=place, value=entries)
    found = []
    for k, entry in enumerate(entries):
        check_keys(entry, _WRENCH_KEYS, f"{place}[{k}]")
        given = {key: value for key, value in entry.items() if value is not None}
        found.append(at_field(f"{place}[{k}]", Wrench, **given))
    return found
