"""Prediction of one body: moments, samples, modes and status."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from ..checks.errors import InvalidOptionError, InvalidRequestError
from ..checks.names import hint, one_of
from ..propagators.modes import Mode
from ..scene.parameters import moved_along
from ..spatial.layout import (
    ANGULAR_VELOCITY,
    ERR_ANGULAR_VELOCITY,
    ERR_POSITION,
    ERR_ROTATION,
    ERR_VELOCITY,
    POSITION,
    QUATERNION,
    VELOCITY,
)
from ..spatial.origin import at_origin
from .body_status import BodyStatus
from .diagnosis import ROLLOUTS, judge
from .prediction_data import PredictionData
from .snapshot import Snapshot

#: Point that position and velocity refer to.
Origin = Literal["center_of_mass", "model"]
Convention = Literal["ros", "error_state"]


class PredictedBody:
    """Prediction of one body at one time; `Prediction.body` makes it.

    Position and linear velocity refer to ``origin``: the centre of mass, or the model's own origin. Their
    means and covariances are moments of the distribution of this point, from rollouts if there are any.
    Properties are computed on access.

    Attributes
    ----------
    name : str
    time : float
        Simulated time from the start [s].
    origin : {'center_of_mass', 'model'}
    fixed : bool
        Whether the body never moves; all standard deviations are then 0.
    prescribed : bool
        Whether the body follows a path; all standard deviations are then 0.
    """

    def __init__(
        self, prediction: PredictionData, name: str, snapshot: Snapshot, origin: Origin = "center_of_mass"
    ):
        scene = prediction.scene
        names = [body.name for body in scene.bodies]
        if not isinstance(name, str):
            raise InvalidRequestError(
                "must be the name of a body; prediction.bodies has them all", field="name", value=name
            )
        if name not in names:
            raise InvalidRequestError(f"is no body of the scene{hint(name, names)}", field="name", value=name)
        if origin not in get_args(Origin):
            raise InvalidOptionError(one_of(origin, get_args(Origin)), field="origin", value=origin)
        self._prediction, self._snapshot, self._body = prediction, snapshot, names.index(name)
        self.name, self.time, self.origin = name, snapshot.time, origin
        body = scene.bodies[self._body]
        self.fixed, self.prescribed = body.fixed, body.trajectory is not None

    def __repr__(self):
        position = np.round(self.position, 4).tolist()
        return f"<PredictedBody '{self.name}' at {self.time:g} s, position {position} m>"

    @property
    def position(self) -> np.ndarray:
        """(3,): mean position of the origin, world frame [m]."""
        return self._state()[POSITION]

    @property
    def orientation(self) -> np.ndarray:
        """(4,): mean orientation, the quaternion (x, y, z, w) of ``R_world_body``."""
        return self._state()[QUATERNION]

    @property
    def linear_velocity(self) -> np.ndarray:
        """(3,): mean velocity of the origin, world frame [m/s]."""
        return self._state()[VELOCITY]

    @property
    def angular_velocity(self) -> np.ndarray:
        """(3,): mean angular velocity, world frame [rad/s]."""
        return self._state()[ANGULAR_VELOCITY]

    @property
    def position_std(self) -> np.ndarray:
        """(3,): standard deviations of the position along the world's axes [m]."""
        return self._std(ERR_POSITION)

    @property
    def rotation_std(self) -> np.ndarray:
        """(3,): standard deviations of the rotation about the world's axes [rad]."""
        return self._std(ERR_ROTATION)

    @property
    def linear_velocity_std(self) -> np.ndarray:
        """(3,): standard deviations of the linear velocity along the world's axes [m/s]."""
        return self._std(ERR_VELOCITY)

    @property
    def angular_velocity_std(self) -> np.ndarray:
        """(3,): standard deviations of the angular velocity about the world's axes [rad/s]."""
        return self._std(ERR_ANGULAR_VELOCITY)

    def covariance(self, convention: Convention = "ros") -> np.ndarray:
        """Covariance of the body at the origin.

        Parameters
        ----------
        convention : {'ros', 'error_state'}
            ``ros``: (6, 6), of ``[x, y, z, rotation about x, y, z]``, all about the world's fixed axes, as in
            ``geometry_msgs/PoseWithCovariance``. ``error_state``: (12, 12), of position, linear velocity,
            rotation and angular velocity, as in `Belief`; the rotation is about the body's axes.

        Returns
        -------
        (6, 6) or (12, 12) array
            In m, m/s, rad and rad/s; zeros for a fixed body.

        Raises
        ------
        InvalidOptionError
            If there is no such convention.
        """
        if convention not in get_args(Convention):
            raise InvalidOptionError(
                one_of(convention, get_args(Convention)), field="convention", value=convention
            )
        if convention == "error_state":
            return self._belief().marginal(self._body).copy()
        return self._about_fixed_axes()[2].reshape(6, 6)

    def samples(self, count: int | None = None) -> np.ndarray:
        """Return states ``[p, v, q, omega]`` of the body (count, 13), drawn as in `Prediction.samples`."""
        states = self._prediction.samples(count, time=self.time)[:, [self._body]]
        if self.origin == "model":
            origin = np.array(self._prediction.scene.bodies[self._body].model.origin)
            states = moved_along(states, origin[None, None])
        return states[:, 0]

    @property
    def modes(self) -> tuple[Mode, ...]:
        """Outcomes of the body at its centre of mass, the most probable first.

        A single Gaussian if the propagator has no samples, or the body does not move freely.
        """
        return self._snapshot.modes(self._prediction.scene, self._body)

    def status(self, *, rollouts: int = ROLLOUTS) -> BodyStatus:
        """Return how reliable the prediction of the body is (`assess`)."""
        (statuses,) = judge(replace(self._prediction, snapshots=(self._snapshot,)), rollouts)
        return statuses[self._body]

    def _belief(self):
        """Belief about all bodies, at the origin."""
        if self.origin == "center_of_mass":
            return self._snapshot.belief
        return self._snapshot.at_model_origins(self._prediction.scene)

    def _about_fixed_axes(self):
        """State (13,), covariance (12, 12) about fixed axes, and the pose's share (36,) of it."""
        P = self._belief().marginal(self._body).copy()
        return at_origin(self._state(), P, np.zeros(3))[:3]

    def _state(self):
        return self._belief().mean[self._body].copy()

    def _std(self, block):
        return np.sqrt(np.maximum(self._about_fixed_axes()[1].diagonal()[block], 0.0))


@dataclass(frozen=True, eq=False)
class Trajectory:
    """One body at T times, ascending; `Prediction.trajectory` makes it.

    Attributes
    ----------
    times : (T,) array
        From the start [s].
    positions, linear_velocities, angular_velocities : (T, 3) array
        Means, world frame [m], [m/s], [rad/s].
    orientations : (T, 4) array
        Means, quaternions (x, y, z, w) of ``R_world_body``.
    position_stds, rotation_stds, linear_velocity_stds, angular_velocity_stds : (T, 3) array
        Standard deviations along and about the world's axes [m], [rad], [m/s], [rad/s].
    covariances : (T, 12, 12) array
        Of the error state, as in `Belief`.
    """

    times: np.ndarray
    positions: np.ndarray
    orientations: np.ndarray
    linear_velocities: np.ndarray
    angular_velocities: np.ndarray
    position_stds: np.ndarray
    rotation_stds: np.ndarray
    linear_velocity_stds: np.ndarray
    angular_velocity_stds: np.ndarray
    covariances: np.ndarray

    @classmethod
    def of(cls, bodies: Sequence[PredictedBody]) -> Trajectory:
        """Return the trajectory of one body from its predictions at all times."""
        return cls(
            times=np.array([body.time for body in bodies]),
            positions=np.array([body.position for body in bodies]),
            orientations=np.array([body.orientation for body in bodies]),
            linear_velocities=np.array([body.linear_velocity for body in bodies]),
            angular_velocities=np.array([body.angular_velocity for body in bodies]),
            position_stds=np.array([body.position_std for body in bodies]),
            rotation_stds=np.array([body.rotation_std for body in bodies]),
            linear_velocity_stds=np.array([body.linear_velocity_std for body in bodies]),
            angular_velocity_stds=np.array([body.angular_velocity_std for body in bodies]),
            covariances=np.array([body.covariance("error_state") for body in bodies]),
        )
