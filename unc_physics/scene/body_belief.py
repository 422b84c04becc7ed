"""Belief about one body, with the field names of scene files."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..checks.array_field import Array, MaybeArray, OptionalArray, array_field
from ..checks.errors import InvalidCovarianceError, InvalidRequestError, NotFiniteError
from ..checks.names import one_of, with_named_arguments
from ..checks.validation import array, covariance, non_negative, numbers, point, quaternion
from ..spatial import origin as origins
from ..spatial.layout import (
    ANGULAR_VELOCITY,
    ERR_ANGULAR_VELOCITY,
    ERR_POSITION,
    ERR_ROTATION,
    ERR_VELOCITY,
    ERROR,
    POSITION,
    QUATERNION,
    STATE,
    VELOCITY,
)
from ..spatial.rotation import from_roll_pitch_yaw, rotation_matrix

#: Slices of the state and of the error state for each field.
MEANS = {"position": POSITION, "linear_velocity": VELOCITY, "angular_velocity": ANGULAR_VELOCITY}
STDS = {
    "position_std": ERR_POSITION,
    "linear_velocity_std": ERR_VELOCITY,
    "orientation_std": ERR_ROTATION,
    "angular_velocity_std": ERR_ANGULAR_VELOCITY,
}
#: Points of a body to which its position and velocity may refer.
ORIGINS = ("center_of_mass", "model")
#: Axes of the rotations of a pose's covariance: the world's, as in ROS, or the body's.
AXES = ("fixed", "body")
#: Places of a pose in the error state.
POSE_ERRORS = np.r_[ERR_POSITION, ERR_ROTATION]
_STD_LIMIT, _FULL_TURN = 1e150, 2.0 * math.pi


@with_named_arguments
@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class BodyBelief:
    """Belief about one body at time 0; the fields are keys of scene files.

    Each standard deviation is three numbers, or one that stands for three.

    Attributes
    ----------
    origin : {'center_of_mass', 'model'}
        Point to which position, linear velocity and their covariances refer: the centre of mass, or the
        origin of the model's coordinates, as in perception and MoveIt.
    position : (3,) array
        World frame [m].
    orientation : (4,) array
        Quaternion (x, y, z, w) of ``R_world_body``.
    roll_pitch_yaw : (3,) array, optional
        Alternative to ``orientation``: rotations about the world's x, then y, then z axis [rad], as in URDF.
    linear_velocity : (3,) array
        World frame [m/s].
    angular_velocity : (3,) array
        World frame [rad/s].
    position_std : (3,) array
        Along the world's axes [m].
    orientation_std : (3,) array
        About the body's axes [rad].
    linear_velocity_std : (3,) array
        Along the world's axes [m/s].
    angular_velocity_std : (3,) array
        About the world's axes [rad/s].
    pose_covariance : (6, 6) array, optional
        Alternative to the standard deviations of position and orientation: covariance of position, along the
        world's axes [m^2], and of rotation, about ``axes`` [rad^2].
    axes : {'fixed', 'body'}
        Axes of the rotations of ``pose_covariance``, without a default: the world's fixed axes, as in ROS, or
        the body's.
    covariance : (12, 12) array
        Alternative to the standard deviations: covariance of position, linear velocity, rotation about the
        body axes, and angular velocity, as in `Belief`. By default computed from the standard deviations.

    Raises
    ------
    InvalidRequestError, NotFiniteError, InvalidOrientationError, InvalidCovarianceError
        For wrong shapes, NaN or infinity, a quaternion far from unit length, or negative standard deviations.
        Also for orientations uncertain by more than a full turn, an invalid covariance, fields that exclude
        each other, or an unknown origin.
    """

    origin: str = "center_of_mass"
    position: Array = array_field((0.0, 0.0, 0.0))
    orientation: OptionalArray = array_field(None)
    roll_pitch_yaw: MaybeArray = array_field(None)
    linear_velocity: Array = array_field((0.0, 0.0, 0.0))
    angular_velocity: Array = array_field((0.0, 0.0, 0.0))
    position_std: Array = array_field(0.0)
    orientation_std: Array = array_field(0.0)
    linear_velocity_std: Array = array_field(0.0)
    angular_velocity_std: Array = array_field(0.0)
    pose_covariance: MaybeArray = array_field(None)
    axes: str | None = None
    covariance: OptionalArray = array_field(None)

    def __post_init__(self):
        checked = {name: array(getattr(self, name), (3,), name) for name in MEANS}
        checked["position"] = point(self.position, "position")
        checked["orientation"] = self._checked_orientation()
        if self.origin not in ORIGINS:
            raise InvalidRequestError(one_of(self.origin, ORIGINS), field="origin", value=self.origin)
        checked |= {name: three_stds(getattr(self, name), name) for name in STDS}
        within_a_turn(checked["orientation_std"], "orientation_std")
        P = self._checked_covariance(checked, checked["orientation"])
        std = np.sqrt(np.maximum(P.diagonal(), 0.0))
        checked |= {name: std[place] for name, place in STDS.items()}
        for name, value in (checked | {"covariance": P}).items():
            object.__setattr__(self, name, value)

    def _checked_orientation(self):
        if self.roll_pitch_yaw is None:
            return quaternion(
                (0.0, 0.0, 0.0, 1.0) if self.orientation is None else self.orientation, "orientation"
            )
        if self.orientation is not None:
            raise InvalidRequestError("must not be given beside orientation", field="roll_pitch_yaw")
        angles = array(self.roll_pitch_yaw, (3,), "roll_pitch_yaw")
        within_a_turn(angles, "roll_pitch_yaw")
        object.__setattr__(self, "roll_pitch_yaw", None)
        return quaternion(from_roll_pitch_yaw(angles), "roll_pitch_yaw")

    def _checked_covariance(self, stds, orientation):
        """Covariance (12, 12) from the standard deviations, the pose's covariance, or as it was given."""
        whole, pose = self.covariance, self.pose_covariance
        others = {"covariance": STDS, "pose_covariance": ("position_std", "orientation_std")}
        if whole is not None and pose is not None:
            raise InvalidRequestError("must not be given beside pose_covariance", field="covariance")
        for field, value in (("covariance", whole), ("pose_covariance", pose)):
            for name in () if value is None else others[field]:
                if stds[name].any():
                    raise InvalidRequestError(f"must not be given beside {name}", field=field)
        if pose is None and self.axes is not None:
            raise InvalidRequestError("needs pose_covariance beside it", field="axes", value=self.axes)
        if whole is not None:
            if numbers(whole, "covariance", InvalidCovarianceError).shape[:1] != (ERROR,):
                raise InvalidCovarianceError(
                    f"must have {ERROR} rows, three each for position, linear velocity, rotation about the"
                    " body's axes and angular velocity; a matrix of position and rotation is pose_covariance",
                    field="covariance",
                )
            return covariance(whole, ERROR, "covariance")
        P = np.zeros((ERROR, ERROR))
        for name, place in STDS.items():
            P[place, place] = np.diag(stds[name] ** 2)
        if pose is not None:
            P[np.ix_(POSE_ERRORS, POSE_ERRORS)] = pose_covariance(pose, self.axes, orientation)
            object.__setattr__(self, "pose_covariance", None)
            object.__setattr__(self, "axes", None)
        P.flags.writeable = False
        return P

    def at_center_of_mass(self, model_origin: np.ndarray) -> BodyBelief:
        """Return the same belief with the centre of mass as its origin.

        ``model_origin`` (3,) is the origin of the model's coordinates, body frame [m]
        (`SpherePacking.origin`). The covariance is mapped to first order in the rotation error.
        """
        if self.origin == "center_of_mass":
            return self
        state = origins.moved(self.state, model_origin, -1.0)
        axes = np.eye(ERROR)  # from body axes to world axes
        axes[ERR_ROTATION, ERR_ROTATION] = rotation_matrix(self.orientation)
        P = origins.at_com(axes @ self.covariance @ axes.T, state, model_origin)
        means = {name: state[place] for name, place in MEANS.items()}
        return BodyBelief(**means, orientation=self.orientation, covariance=P)

    @property
    def state(self) -> np.ndarray:
        """Mean state (13,) as in `Belief`, at `origin`."""
        state = np.empty(STATE)
        state[QUATERNION] = self.orientation
        for name, place in MEANS.items():
            state[place] = getattr(self, name)
        return state

    def check_fixed(self) -> None:
        """Raise `InvalidRequestError` if the body moves or is uncertain, which a fixed body must not."""
        for name in ("linear_velocity", "angular_velocity", *STDS):
            value = getattr(self, name)
            if value.any():
                raise InvalidRequestError(
                    "must be zero or absent: the body is fixed", field=name, value=value.tolist()
                )


def pose_covariance(value, axes, orientation, field="pose_covariance") -> np.ndarray:
    """Return the covariance (6, 6) of position and rotation about the body's axes.

    Parameters
    ----------
    value : (6, 6) array
        Covariance with rotations about ``axes``.
    axes : {'fixed', 'body'}
        The world's or the body's.
    orientation : (4,) array
        Quaternion of ``R_world_body``.
    field : str
        Name of the value in errors.
    """
    P = covariance(value, 6, field)
    if axes not in AXES:
        raise InvalidRequestError(
            f"must be 'fixed' (the world's axes, as in ROS) or 'body', the axes of the rotations of {field}",
            field="axes",
            value=axes,
        )
    if axes == "body":
        return P
    to_body = np.eye(6)
    to_body[3:, 3:] = rotation_matrix(orientation).T
    return to_body @ P @ to_body.T


def within_a_turn(angles, field) -> None:
    """Raise `InvalidRequestError` for an angle of more than a full turn, which was meant in degrees."""
    if np.abs(angles).max() > _FULL_TURN:
        raise InvalidRequestError(
            "is more than a full turn; it is in rad, not in degrees", field=field, value=angles.tolist()
        )


def three_stds(value, field) -> np.ndarray:
    """Return standard deviations (3,) from three numbers, or from one that stands for all."""
    std = numbers(value, field)
    std = array(np.full(3, std) if std.ndim == 0 else std, (3,), field)
    non_negative(float(std.min()), field)
    if std.max() > _STD_LIMIT:
        raise NotFiniteError("is too large for its square to be finite", field=field, value=value)
    return std
