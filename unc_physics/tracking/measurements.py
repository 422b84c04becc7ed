"""Measurements of bodies: poses, positions of points, and poses relative to another body."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..checks.array_field import Array, array_field
from ..checks.errors import InvalidCovarianceError, InvalidRequestError
from ..checks.names import one_of
from ..checks.validation import array, covariance, point, quaternion
from ..scene.body import RigidBody
from ..scene.body_belief import ORIGINS, POSE_ERRORS, BodyBelief, pose_covariance
from ..spatial.layout import ERROR
from .observation import POSE, POSITION, RELATIVE_POSE

#: Least variance, of the largest of its block of three: a measurement without error has no density.
_LEAST_VARIANCE = 1e-12


class Observation(NamedTuple):
    """Measurement in the form of the kernels.

    Attributes
    ----------
    kind : int
        `POSE`, `POSITION` or `RELATIVE_POSE`.
    value : (7,) array
        Position and quaternion; a position uses the first three.
    point : (3,) array
        The measured point, body axes [m].
    noise : (m, m) array
        Covariance: position along the world's axes (or the reference body's), rotation about the measured
        body's own axes.
    """

    kind: int
    value: np.ndarray
    point: np.ndarray
    noise: np.ndarray

    @property
    def has_rotation(self) -> bool:
        """Whether a rotation was measured, too."""
        return self.kind != POSITION


@dataclass(frozen=True, eq=False)
class PoseMeasurement:
    """A measured pose of a body, with a Gaussian error.

    Attributes
    ----------
    pose : (7,) array
        Position [m] and quaternion (x, y, z, w) of ``R_world_body``, world frame.
    covariance : (6, 6) array
        Of the position, along the world's axes [m^2], then of the rotation, about ``axes`` [rad^2]. Six
        numbers are standard deviations, about the body's axes unless ``axes`` says otherwise. It is stored
        about the body's axes, as in the error state.
    origin : {'center_of_mass', 'model'}
        The point whose position was measured: the centre of mass, or the origin of the model's coordinates.
    axes : {'fixed', 'body'}
        Axes of the rotations of the covariance, without a default for a matrix: the world's fixed axes, as
        in ROS, or the body's.

    Raises
    ------
    InvalidRequestError, NotFiniteError, InvalidOrientationError, InvalidCovarianceError
        For wrong shapes, NaN or infinity, a quaternion far from unit length, what is no covariance, and an
        unknown origin.
    """

    pose: Array = array_field()
    covariance: Array = array_field()
    origin: str = "center_of_mass"
    axes: str | None = None

    def __post_init__(self):
        object.__setattr__(self, "pose", _checked_pose(self.pose))
        axes = "body" if self.axes is None and np.ndim(self.covariance) == 1 else self.axes
        P = _checked_covariance(self.covariance, 6)
        P = pose_covariance(P, axes, self.pose[3:], "covariance")
        P.flags.writeable = False
        object.__setattr__(self, "covariance", P)
        object.__setattr__(self, "axes", "body")
        if self.origin not in ORIGINS:
            raise InvalidRequestError(one_of(self.origin, ORIGINS), field="origin", value=self.origin)

    @property
    def reference(self) -> str | None:
        """None: the pose is in the world frame."""
        return None

    def observation(self, body: RigidBody) -> Observation:
        """Return the measurement of the body's centre of mass."""
        if self.origin == "center_of_mass":
            return Observation(POSE, self.pose.copy(), np.zeros(3), self.covariance.copy())
        P = np.zeros((ERROR, ERROR))
        P[np.ix_(POSE_ERRORS, POSE_ERRORS)] = self.covariance
        seen = BodyBelief(origin="model", position=self.pose[:3], orientation=self.pose[3:], covariance=P)
        seen = seen.at_center_of_mass(body.model.origin)
        noise = _regular(seen.covariance[np.ix_(POSE_ERRORS, POSE_ERRORS)])
        value = np.concatenate([seen.position, self.pose[3:]])
        return Observation(POSE, value, np.zeros(3), noise)


@dataclass(frozen=True, eq=False)
class PositionMeasurement:
    """A measured position of a point of a body, with a Gaussian error.

    Attributes
    ----------
    position : (3,) array
        World frame [m].
    covariance : (3, 3) array
        Along the world's axes [m^2]. Three numbers are standard deviations.
    point : (3,) array
        The point, from the centre of mass, body axes [m]; by default the centre of mass.

    Raises
    ------
    InvalidRequestError, NotFiniteError, InvalidCovarianceError
        For wrong shapes, NaN or infinity, and what is no covariance.
    """

    position: Array = array_field()
    covariance: Array = array_field()
    point: Array = array_field((0.0, 0.0, 0.0))

    def __post_init__(self):
        object.__setattr__(self, "position", point(self.position, "position"))
        object.__setattr__(self, "covariance", _checked_covariance(self.covariance, 3))
        object.__setattr__(self, "point", array(self.point, (3,), "point"))

    @property
    def reference(self) -> str | None:
        """None: the position is in the world frame."""
        return None

    def observation(self, body: RigidBody) -> Observation:
        """Return the measurement in the form of the kernels."""
        value = np.concatenate([self.position, [0.0, 0.0, 0.0, 1.0]])
        return Observation(POSITION, value, self.point.copy(), self.covariance.copy())


@dataclass(frozen=True, eq=False)
class RelativePoseMeasurement:
    """A measured pose of a body in the frame of another body, with a Gaussian error.

    Attributes
    ----------
    reference : str
        Name of the other body.
    pose : (7,) array
        Position of the centre of mass [m] and quaternion (x, y, z, w), in the frame of the other body's
        centre of mass.
    covariance : (6, 6) array
        Of the position, along the other body's axes [m^2], then of the rotation, about the measured body's
        axes [rad^2]. Six numbers are standard deviations.

    Raises
    ------
    InvalidRequestError, NotFiniteError, InvalidOrientationError, InvalidCovarianceError
        For wrong shapes, NaN or infinity, a quaternion far from unit length, and what is no covariance.
    """

    reference: str
    pose: Array = array_field()
    covariance: Array = array_field()

    def __post_init__(self):
        if not isinstance(self.reference, str) or not self.reference:
            raise InvalidRequestError("must be the name of a body", field="reference", value=self.reference)
        object.__setattr__(self, "pose", _checked_pose(self.pose))
        object.__setattr__(self, "covariance", _checked_covariance(self.covariance, 6))

    def observation(self, body: RigidBody) -> Observation:
        """Return the measurement in the form of the kernels."""
        return Observation(RELATIVE_POSE, self.pose.copy(), np.zeros(3), self.covariance.copy())


Measurement = PoseMeasurement | PositionMeasurement | RelativePoseMeasurement


def _checked_pose(value):
    pose = array(value, (7,), "pose").copy()
    pose[:3] = point(pose[:3], "position of pose")
    pose[3:] = quaternion(pose[3:], "orientation of pose")
    pose.flags.writeable = False
    return pose


def _checked_covariance(value, size):
    """Return a covariance (size, size) from a covariance or from standard deviations (size,)."""
    if np.shape(value) == (size,):
        std = array(value, (size,), "covariance", InvalidCovarianceError)
        if std.min() < 0.0:
            raise InvalidCovarianceError(
                "must not hold negative standard deviations", field="covariance", value=std.tolist()
            )
        value = np.diag(std**2)
    P = covariance(value, size, "covariance")
    if not P.diagonal().reshape(-1, 3).max(axis=1).all():
        raise InvalidCovarianceError(
            "must be positive for position and rotation: a measurement has an error",
            field="covariance",
            value=P.diagonal().tolist(),
        )
    P = _regular(P)
    P.flags.writeable = False
    return P


def _regular(P):
    """Return the covariance with variances raised until it is invertible."""
    least = np.repeat(P.diagonal().reshape(-1, 3).max(axis=1), 3)
    return P + np.diag(_LEAST_VARIANCE * least)
