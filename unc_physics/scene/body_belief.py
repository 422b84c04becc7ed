"""Belief about one body, with the field names of scene files."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..checks.array_field import Array, MaybeArray, OptionalArray, array_field
from ..checks.errors import InvalidRequestError, NotFiniteError
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
from ..spatial.rotation import rotation_matrix

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
_STD_LIMIT, _FULL_TURN = 1e150, 2.0 * math.pi


@with_named_arguments
@dataclass(frozen=True, eq=False, kw_only=True)
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
    covariance: OptionalArray = array_field(None)

    def __post_init__(self):
        checked = {name: array(getattr(self, name), (3,), name) for name in MEANS}
        checked["position"] = point(self.position, "position")
        checked["orientation"] = self._checked_orientation()
        if self.origin not in ORIGINS:
            raise InvalidRequestError(one_of(self.origin, ORIGINS), field="origin", value=self.origin)
        checked |= {name: three_stds(getattr(self, name), name) for name in STDS}
        if checked["orientation_std"].max() > _FULL_TURN:
            raise InvalidRequestError(
                "is more than a full turn; it is in rad, not in degrees",
                field="orientation_std",
                value=self.orientation_std,
            )
        if self.covariance is None:
            std = np.zeros(ERROR)
            for name, place in STDS.items():
                std[place] = checked[name]
            P = np.diag(std**2)
            P.flags.writeable = False
        else:
            for name in STDS:
                if checked[name].any():
                    raise InvalidRequestError(f"must not be given beside {name}", field="covariance")
            P = covariance(self.covariance, ERROR, "covariance")
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
        object.__setattr__(self, "roll_pitch_yaw", None)
        cr, cp, cy = np.cos(0.5 * angles)
        sr, sp, sy = np.sin(0.5 * angles)
        q = [
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        ]
        return quaternion(q, "roll_pitch_yaw")

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


def three_stds(value, field) -> np.ndarray:
    """Return standard deviations (3,) from three numbers, or from one that stands for all."""
    std = numbers(value, field)
    std = array(np.full(3, std) if std.ndim == 0 else std, (3,), field)
    non_negative(float(std.min()), field)
    if std.max() > _STD_LIMIT:
        raise NotFiniteError("is too large for its square to be finite", field=field, value=value)
    return std
