"""Report of a tracker about a correction."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum


class TrackStatus(str, Enum):
    """State of a tracked body.

    Attributes
    ----------
    STARTING
        Velocities are not known yet; a constant-velocity filter answers.
    TRACKED
        Physics explains the measurements.
    COASTING
        Not seen for 0.25 s; physics goes on.
    RESTING
        Asleep on something, whether it is seen or not.
    CARRIED
        Something that is not in the scene moves it; a constant-velocity filter answers.
    LOST
        Nothing explains the measurements, or the position is no longer known.
    """

    STARTING = "starting"
    TRACKED = "tracked"
    COASTING = "coasting"
    RESTING = "resting"
    CARRIED = "carried"
    LOST = "lost"


@dataclass(frozen=True)
class Correction:
    """Result of `Tracker.correct`.

    Attributes
    ----------
    time : float
        Of the measurements [s].
    distance : mapping of str to float
        Mahalanobis distance of each body's measurement from its prediction; the square is on average the
        number of its dimensions. A late measurement is compared with the prediction for its own time.
    rejected : tuple of str
        Bodies whose measurement was too far from its prediction, and had no effect on the belief.
        Measurements have an effect again once a few agree that the body was moved.
    carried, lost : tuple of str
        Bodies that are carried, or lost (`TrackStatus`), after the newest measurement.
    status : mapping of str to TrackStatus
        Of all moving bodies, after the newest measurement.
    too_late : bool
        Whether the measurements were older than the tracker's window, and had no effect.
    replayed : int
        Number of later measurements that were applied again.
    """

    time: float
    distance: Mapping[str, float]
    rejected: tuple[str, ...]
    carried: tuple[str, ...]
    lost: tuple[str, ...]
    status: Mapping[str, TrackStatus]
    too_late: bool = False
    replayed: int = 0
