"""The one rule for covariances of messages: what is unknown, not measured, rounded or exact."""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np

from ...checks.errors import InvalidCovarianceError
from ...checks.validation import array
from ...spatial.layout import ERROR

#: First entry of an unknown covariance, as in sensor_msgs/Imu.
UNKNOWN = -1.0
#: Variances above these mean "not measured": of a position [m^2] and of an angle [rad^2].
MOST_POSITION_VARIANCE, MOST_ANGLE_VARIANCE = 10.0**2, math.pi**2
#: Variance of an angle that was not measured: uniform from -pi to pi [rad^2].
ANY_ANGLE_VARIANCE = math.pi**2 / 3.0
_AXES = ("x", "y", "z", "roll", "pitch", "yaw")
_X, _Y, _YAW = 0, 1, 5
_MOST = np.repeat([MOST_POSITION_VARIANCE, MOST_ANGLE_VARIANCE], 3)
# asymmetry and negative eigenvalues that are repaired, over the largest entry: single precision with a
# lever of 1 m has 1e-6, and rounded printouts 1e-5
_REPAIRED, _ROUND_OFF = 1e-4, 1e-9
# numbers that are printed with six decimals are wrong by half of the last one; six add up in an eigenvalue
_DECIMALS, _ROUNDED = 6, 6 * 0.5e-6


class ReadCovariance(NamedTuple):
    """Covariance of a message, after the rule.

    Attributes
    ----------
    P : array
        (6, 6) or larger, symmetric and positive semidefinite. Directions that were not measured have zeros.
    unmeasured : tuple of int
        Rows of these directions, of a pose.
    changes : tuple of str
        What was changed, in words.
    zeros_replaced : bool
        Whether zeros were read as unknown.
    """

    P: np.ndarray
    unmeasured: tuple[int, ...] = ()
    changes: tuple[str, ...] = ()
    zeros_replaced: bool = False

    @property
    def is_supported(self) -> bool:
        """Whether height or tilt were not measured, so that they come from what supports the object."""
        return bool({2, 3, 4} & set(self.unmeasured))

    def with_unmeasured(self) -> np.ndarray:
        """Return the covariance with variances of what was not measured, for a filter."""
        P = self.P.copy()
        for row in self.unmeasured:
            P[row, row] = MOST_POSITION_VARIANCE if row < 3 else ANY_ANGLE_VARIANCE
        return P


class CovarianceDefaults(NamedTuple):
    """Covariances that replace unknown ones.

    Attributes
    ----------
    pose, twist : (6, 6) array
        Defaults of unknown covariances, in the order and frame of messages, at the model's origin.
    zero_is_exact : bool
        Whether zeros mean exact; otherwise they mean unknown.
    """

    pose: np.ndarray
    twist: np.ndarray
    zero_is_exact: bool

    @classmethod
    def from_stds(cls, position, orientation, linear_velocity, angular_velocity, zero_is_exact):
        """Return defaults from standard deviations [m, rad, m/s, rad/s], equal along all axes."""
        pose = np.diag(np.repeat([position, orientation], 3) ** 2)
        twist = np.diag(np.repeat([linear_velocity, angular_velocity], 3) ** 2)
        return cls(pose, twist, zero_is_exact)

    def known_pose(self, values, field: str) -> ReadCovariance:
        """Return the covariance of a pose in a message.

        Parameters
        ----------
        values : (36,) array
        field : str
            Its name in error messages.

        Raises
        ------
        InvalidCovarianceError, NotFiniteError
            Also if x or y was not measured.
        """
        return self._known(values, field, self.pose, of_pose=True)

    def known_twist(self, values, field: str) -> ReadCovariance:
        """Return the covariance of a twist in a message, as `known_pose` does; all of it is measured."""
        return self._known(values, field, self.twist, of_pose=False)

    def _known(self, values, field, unknown, of_pose):
        plain = isinstance(values, np.ndarray) and values.dtype == np.float64 and values.shape == (36,)
        entries = values if plain else array(values, (36,), field, InvalidCovarianceError)
        found = _read(entries.tobytes(), field, of_pose)
        if found is None:
            return ReadCovariance(unknown)
        if self.zero_is_exact or found.P.any() or found.unmeasured:
            return found
        return ReadCovariance(unknown, zeros_replaced=True)


EXACT = CovarianceDefaults.from_stds(0.0, 0.0, 0.0, 0.0, zero_is_exact=True)


def read_whole(values, size: int, field: str) -> ReadCovariance:
    """Return a covariance (size, size) of whole states, in which all is measured.

    Raises
    ------
    InvalidCovarianceError, NotFiniteError
    """
    entries = array(values, (size**2,), field, InvalidCovarianceError)
    if size != ERROR:
        return _repaired(entries.reshape(size, size), field)
    found = _read(entries.tobytes(), field, False)
    assert found is not None
    return found


@functools.lru_cache(maxsize=256)
def _read(entries: bytes, field: str, of_pose: bool) -> ReadCovariance | None:
    """Return a covariance from the bytes of its entries; None if it is unknown.

    It is cached, as clients often repeat equal covariances.
    """
    flat = np.frombuffer(entries)
    size = math.isqrt(len(flat))
    P = array(flat.reshape(size, size), (size, size), field, InvalidCovarianceError)
    if size < ERROR and flat[0] == UNKNOWN:
        return None
    return _measured(P, field) if of_pose else _repaired(P, field)


def _measured(P, field):
    """Return the covariance of a pose, in which very large variances mean "not measured"."""
    rows = [int(row) for row in np.flatnonzero(P.diagonal() > _MOST)]
    for row in {_X, _Y} & set(rows):
        raise InvalidCovarianceError(
            f"says that {_AXES[row]} was not measured, without which there is no place to predict from",
            field=f"{field}[{7 * row}]",
            value=float(P[row, row]),
        )
    kept = P.copy()
    kept[rows], kept[:, rows] = 0.0, 0.0
    found = _repaired(kept, field)
    changes = list(found.changes)
    exact = [k for k in range(6) if k not in rows and not found.P[k, k]]
    if exact and found.P.any():
        changes.append(f"{', '.join(_AXES[k] for k in exact)} of the pose have zero variance: exactly known")
    if rows:
        names = ", ".join(_AXES[row] for row in rows if row != _YAW)
        supported = f"{names} of the pose were not measured: the support decides" if names else ""
        spread = "yaw was not measured: any angle" if _YAW in rows else ""
        changes += filter(None, (supported, spread))
    return found._replace(unmeasured=tuple(rows), changes=tuple(changes))


def _repaired(P, field):
    """Return a covariance that is symmetric and positive semidefinite, if it nearly was."""
    diagonal = P.diagonal()
    if np.count_nonzero(P) == np.count_nonzero(diagonal) and diagonal.min(initial=0.0) >= 0.0:
        return ReadCovariance(P)  # only variances
    largest = np.repeat(np.abs(P).max(axis=1).reshape(-1, 3).max(axis=1), 3)
    blocks = np.repeat(np.maximum(diagonal, 0.0).reshape(-1, 3).max(axis=1), 3)  # of one unit each
    scale = np.sqrt(np.where(blocks > 0.0, blocks, largest.max(initial=1.0)))
    C = P / scale[:, None] / scale
    allowed = np.full_like(C, _REPAIRED)
    if np.abs(P - np.round(P, _DECIMALS)).max() < _ROUND_OFF * _ROUNDED:
        allowed += _ROUNDED / scale[:, None] / scale
    asymmetry = np.abs(C - C.T)
    if (asymmetry > allowed).any():
        a, b = np.unravel_index((asymmetry - allowed).argmax(), asymmetry.shape)
        raise InvalidCovarianceError(
            f"must be symmetric, but [{a}][{b}] and [{b}][{a}] differ",
            field=field,
            value=(float(P[a, b]), float(P[b, a])),
        )
    values, vectors = np.linalg.eigh(0.5 * (C + C.T))
    low = float(values[0])
    if low < -max(_REPAIRED * float(values[-1]), float(allowed.max())):
        k = int(diagonal.argmin())
        if diagonal[k] < 0.0:
            raise InvalidCovarianceError(
                f"has a negative variance at [{k}][{k}]", field=field, value=float(diagonal[k])
            )
        raise InvalidCovarianceError(
            "must not have negative eigenvalues; enlarge its diagonal by their size, at least",
            field=field,
            value=float(np.linalg.eigvalsh(0.5 * (P + P.T))[0]),
        )
    changes = []
    if asymmetry.max() > _ROUND_OFF:
        changes.append(f"{field} was made symmetric")
    found = 0.5 * (P + P.T)
    if low < -_ROUND_OFF:
        changes.append(f"slightly negative eigenvalues of {field} were clipped")
        positive = (vectors * np.maximum(values, 0.0)) @ vectors.T
        found = positive * scale[:, None] * scale
        found = 0.5 * (found + found.T)
    return ReadCovariance(found, changes=tuple(changes))
