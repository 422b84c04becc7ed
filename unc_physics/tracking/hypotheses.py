"""The constant-velocity filter of each body, and the switch between it and physics.

Physics cannot explain the motion of a hand. A constant-velocity filter can, less accurately. Both predict
each measurement. A cumulative sum of the ratio of their densities decides between them (Page 1954).
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

import numpy as np

from ..spatial.layout import (
    ANGULAR_VELOCITY,
    ERR_ANGULAR_VELOCITY,
    ERR_POSITION,
    ERR_ROTATION,
    ERR_VELOCITY,
    ERROR,
    POSITION,
    QUATERNION,
    VELOCITY,
)
from ..spatial.moments import boxplus
from .ensemble import Gates, Innovation, of_dimensions
from .measurements import Observation
from .observation import POSE, constant_velocity, expectation, kalman_update
from .symmetry import NONE, Symmetry, folded

#: Intensities of the white acceleration [m^2/s^3], [rad^2/s^3], fitted to tosses in flight and contact.
ACCELERATION, ANGULAR_ACCELERATION = 3.0, 600.0
#: Largest standard deviations of velocities that suffice for physics [m/s], [rad/s].
KNOWN_VELOCITY, KNOWN_SPIN = 0.5, 8.0
#: Standard deviations of unknown velocities [m/s], [rad/s].
UNKNOWN_VELOCITY, UNKNOWN_SPIN = 2.0, 15.0
#: Standard deviations of a pose before its first measurement [m], [rad]; the last is of the rotation if only
#: a position is measured.
_UNKNOWN_POSITION, _UNKNOWN_ROTATION, _KEPT_ROTATION = 1e3, 1.0, 0.3
#: Evidence (logarithm of a ratio of densities) at which a body counts as carried, and as free again.
CARRIED_AT, FREE_AT = 25.0, 30.0
#: Most evidence of a measurement of six dimensions either way, so that no single one decides, at any rate.
_MOST = 14.0
#: Time for which a release must explain a body in contact before it is free [s]: friction stops the body,
#: and the first measurements of a slow push agree with that, too. Of 8 pushes of 0.1 m/s at 10 Hz, .25 s end
#: two too early, and .5 s none.
_RELEASED_FOR = 0.5
#: Time without measurements after which a body is coasting [s].
COASTING_AFTER = 0.25
#: Number of rejected measurements that agree with each other, after which the track starts again.
_AGREEING = 3


class TrackMode(Enum):
    """Source of a body's answer."""

    STARTING = "starting"
    PHYSICS = "physics"
    CARRIED = "carried"


class Filter(NamedTuple):
    """A constant-velocity filter.

    Attributes
    ----------
    mean : (13,) array
    covariance : (12, 12) array
    time : float
        [s]
    """

    mean: np.ndarray
    covariance: np.ndarray
    time: float

    def at(self, time: float) -> Filter:
        """Return the filter's prediction for a time [s]."""
        mean, P = constant_velocity(
            self.mean, self.covariance, time - self.time, ACCELERATION, ANGULAR_ACCELERATION
        )
        return Filter(mean, P, time)

    def corrected(self, seen: Observation, reference: np.ndarray, hard: float) -> tuple[Filter, Innovation]:
        """Return the filter after a measurement at its time, and how both agreed."""
        rows = len(seen.noise)
        y, H = expectation(self.mean, reference, seen.kind, seen.value, seen.point, rows)
        change, P, square, density = kalman_update(self.covariance, H, y, seen.noise)
        if not square <= of_dimensions(hard, rows):
            return self, Innovation(square, density, False)
        mean = np.empty(13)
        boxplus(self.mean, change, mean)
        return Filter(mean, P, self.time), Innovation(square, density, True)

    def seen(
        self, observation: Observation, reference: np.ndarray, hard: float, symmetry: Symmetry
    ) -> tuple[Filter, Innovation]:
        """Return the filter after a measurement of a body with a symmetry, and how both agreed."""
        nearest = folded(symmetry, observation, self.mean, reference)
        found, innovation = self.corrected(nearest, reference, hard)
        return found._replace(covariance=symmetry.without_angle(found.covariance)), innovation

    def knows_velocities(self, symmetry: Symmetry) -> bool:
        """Return whether its velocities, as far as poses determine them, suffice for physics."""
        seen = symmetry.seen_spin(self.mean[QUATERNION])
        spin = seen @ self.covariance[ERR_ANGULAR_VELOCITY, ERR_ANGULAR_VELOCITY] @ seen
        variance = self.covariance.diagonal()[ERR_VELOCITY]
        return bool(variance.max() < KNOWN_VELOCITY**2 and spin.diagonal().max() < KNOWN_SPIN**2)


class Track(NamedTuple):
    """Data of a body besides its members.

    Attributes
    ----------
    mode : TrackMode
    free : Filter
        The constant-velocity filter.
    evidence : float
        Against the present mode. Whenever it is 0 while a body is carried, the members, which assume that the
        body is free, are drawn again.
    released : float
        When the evidence was last 0 [s]: the release of a carried body that the members assume.
    last_seen : float
        Time of the last accepted measurement [s]; -inf before.
    rejected : int
        Measurements in a row that neither physics nor the filter accepted.
    candidate : Filter or None
        Of rejected measurements that agree with each other.
    agreeing : int
        Number of these measurements.
    first : Filter or None
        The filter after the first measurement, until velocities are known.
    distance : float
        Mahalanobis distance of the last measurement; NaN before.
    """

    mode: TrackMode
    free: Filter
    evidence: float = 0.0
    released: float = -np.inf
    last_seen: float = -np.inf
    rejected: int = 0
    candidate: Filter | None = None
    agreeing: int = 0
    first: Filter | None = None
    distance: float = np.nan

    def seen(
        self,
        time: float,
        observation: Observation,
        reference: np.ndarray,
        physics: Innovation,
        gates: Gates,
        symmetry: Symmetry = NONE,
        touching: bool = False,
    ) -> Track:
        """Return the track after a measurement.

        Parameters
        ----------
        time : float
            [s]
        observation : Observation
        reference : (13,) array
            Mean state of the body that a relative pose refers to.
        physics : Innovation
            How the members agreed with it.
        gates : Gates
        symmetry : Symmetry, optional
            Of the body.
        touching : bool, optional
            Whether members touch something.
        """
        free, alone = self.free.at(time).seen(observation, reference, gates.hard, symmetry)
        by_physics = self.mode is TrackMode.PHYSICS
        used = physics if by_physics else alone
        track = self._replace(free=free, distance=float(np.sqrt(used.square)))
        if not (alone.accepted or (by_physics and physics.accepted)):
            return track._after_rejection(time, observation, reference, gates, symmetry)
        track = track._replace(rejected=0, candidate=None, agreeing=0, last_seen=time)
        if self.mode is TrackMode.STARTING:
            return track._replace(first=track.first or free)
        return track._weighed(time, alone.density - physics.density, len(observation.noise), touching)

    def answer(self, time: float) -> Filter:
        """Return the filter's belief at a time [s].

        Without measurements the mean of a carried body stops after a while, as hands do not move straight on.
        The covariance grows as before.
        """
        free, stop = self.free.at(time), self.last_seen + COASTING_AFTER
        if self.mode is not TrackMode.CARRIED or time <= stop:
            return free
        mean = self.free.at(stop).mean
        mean[VELOCITY] = mean[ANGULAR_VELOCITY] = 0.0
        return free._replace(mean=mean)

    def _weighed(self, time, gained, rows, touching=False):
        """Return the track with its evidence changed by what a measurement gained against physics."""
        most = of_dimensions(_MOST, rows)
        gained = min(max(gained, -most), most)
        is_carried = self.mode is TrackMode.CARRIED
        evidence = max(0.0, self.evidence + (-gained if is_carried else gained))
        released = time if evidence == 0.0 else self.released
        if is_carried:
            switches = evidence > FREE_AT and time - released >= _RELEASED_FOR * touching
        else:
            switches = evidence > CARRIED_AT
        if switches:
            mode = TrackMode.PHYSICS if is_carried else TrackMode.CARRIED
            return self._replace(mode=mode, evidence=0.0, released=time)
        return self._replace(evidence=evidence, released=released)

    def _after_rejection(self, time, observation, reference, gates, symmetry):
        """Return the track after a rejected measurement; three that agree start it again."""
        candidate, agreeing = self.candidate, self.agreeing
        if candidate is not None:
            candidate, found = candidate.at(time).seen(observation, reference, gates.soft, symmetry)
            agreeing = agreeing + 1 if found.accepted else 0
        if candidate is None or not agreeing:
            candidate, agreeing = _begun(self.free, time, observation, reference), 1
        track = self._replace(rejected=self.rejected + 1, candidate=candidate, agreeing=agreeing)
        if agreeing < _AGREEING:
            return track
        return track._replace(
            mode=TrackMode.CARRIED,
            free=candidate,
            evidence=0.0,
            released=time,
            last_seen=time,
            rejected=0,
            candidate=None,
            agreeing=0,
        )


def new_track(free: Filter, symmetry: Symmetry) -> Track:
    """Return the track of a body that begins with a belief."""
    return Track(TrackMode.PHYSICS if free.knows_velocities(symmetry) else TrackMode.STARTING, free)


def _begun(free, time, observation, reference):
    """Return a filter that starts with one measurement; a position does not change the rotation."""
    mean, P = free.mean.copy(), np.zeros((ERROR, ERROR))
    mean[VELOCITY] = mean[ANGULAR_VELOCITY] = 0.0
    P[ERR_VELOCITY, ERR_VELOCITY] = UNKNOWN_VELOCITY**2 * np.eye(3)
    P[ERR_ANGULAR_VELOCITY, ERR_ANGULAR_VELOCITY] = UNKNOWN_SPIN**2 * np.eye(3)
    P[ERR_POSITION, ERR_POSITION] = _UNKNOWN_POSITION**2 * np.eye(3)
    rotation = _UNKNOWN_ROTATION if observation.has_rotation else _KEPT_ROTATION
    P[ERR_ROTATION, ERR_ROTATION] = rotation**2 * np.eye(3)
    if observation.kind == POSE:
        mean[POSITION], mean[QUATERNION] = observation.value[:3], observation.value[3:]
    return Filter(mean, P, time).corrected(observation, reference, np.inf)[0]
