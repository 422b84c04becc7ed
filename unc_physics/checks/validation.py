"""Checks of input: arrays and scalars must be finite, and have the right shape and range."""

import math

import numpy as np

from .errors import (
    InvalidCovarianceError,
    InvalidOrientationError,
    InvalidRequestError,
    LimitExceededError,
    NotFiniteError,
    UncPhysicsError,
)

#: Largest coordinate [m].
FARTHEST = 1e12
#: Tolerance of a quaternion's length; perception rounds to single precision or a few decimals.
_QUATERNION_TOLERANCE = 1e-3
#: Tolerance of a covariance's asymmetry and negative eigenvalues, relative to the sizes of its blocks.
_COVARIANCE_TOLERANCE = 1e-8


def number(value, field, error: type[UncPhysicsError] = InvalidRequestError) -> float:
    """Return a finite float; texts and booleans are no numbers."""
    if isinstance(value, (str, bytes)):
        raise error("must be a number, not a text", field=field, value=value)
    if isinstance(value, bool):
        raise error("must be a number", field=field, value=value)
    try:
        result = float(value)
    except (TypeError, ValueError, OverflowError):
        raise error("must be a number", field=field, value=value) from None
    if not math.isfinite(result):
        raise NotFiniteError("must be finite", field=field, value=value)
    return result


def number_from_text(text, field, error: type[UncPhysicsError] = InvalidRequestError) -> float:
    """Return the finite float of a text, as of a command line."""
    try:
        value = float(text)
    except ValueError:
        raise error("must be a number", field=field, value=text) from None
    return number(value, field, error)


def instance(value, kinds, field) -> None:
    """Raise `InvalidRequestError` unless a value is of a class, or of one of several.

    The message does not include the value, which usually is another argument with large arrays.
    """
    kinds = kinds if isinstance(kinds, tuple) else (kinds,)
    if not isinstance(value, kinds):
        names = [_with_article(kind.__name__) for kind in kinds]
        given = "None" if value is None else _with_article(type(value).__name__)
        raise InvalidRequestError(f"must be {' or '.join(names)}, not {given}", field=field)


def _with_article(name):
    return f"{'an' if name[0].lower() in 'aeio' else 'a'} {name}"


def positive(value, field, error: type[UncPhysicsError] = InvalidRequestError) -> float:
    """Return a positive finite float."""
    result = number(value, field, error)
    if result <= 0.0:
        raise error("must be positive", field=field, value=value)
    return result


def non_negative(value, field, error: type[UncPhysicsError] = InvalidRequestError) -> float:
    """Return a non-negative finite float."""
    result = number(value, field, error)
    if result < 0.0:
        raise error("must not be negative", field=field, value=value)
    return result


def share(value, field, error: type[UncPhysicsError] = InvalidRequestError) -> float:
    """Return a float between 0 and 1."""
    result = number(value, field, error)
    if not 0.0 <= result <= 1.0:
        raise error("must be between 0 and 1", field=field, value=value)
    return result


def flag(value, field) -> bool:
    """Return a boolean; other truthy or falsy values are errors."""
    if not isinstance(value, (bool, np.bool_)):
        raise InvalidRequestError("must be true or false", field=field, value=value)
    return bool(value)


def integer(value, field, *, low, error: type[UncPhysicsError] = InvalidRequestError) -> int:
    """Return an int that is at least ``low``."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)):
        raise error("must be an integer", field=field, value=value)
    if value < low:
        raise error(f"must be at least {low}", field=field, value=value)
    return int(value)


def numbers(value, field, error: type[UncPhysicsError] = InvalidRequestError) -> np.ndarray:
    """Return a float64 array of any shape, as a copy."""
    try:
        if not _holds_truth(value) and np.asarray(value).dtype.kind not in "SU":
            return np.array(value, dtype=float, order="C")
    except (TypeError, ValueError, OverflowError):
        pass
    raise error("must be an array of numbers", field=field, value=value)


def _holds_truth(value):
    """Return whether a value is true or false, or a list with such an entry."""
    return isinstance(value, bool) or isinstance(value, (list, tuple)) and any(map(_holds_truth, value))


def array(value, shape, field, error: type[UncPhysicsError] = InvalidRequestError) -> np.ndarray:
    """Return a finite, read-only float64 array of the given shape, as a copy."""
    result = numbers(value, field, error)
    if result.shape != shape:
        raise error(f"must have shape {shape}, not {result.shape}", field=field)
    if not np.isfinite(result).all():
        raise NotFiniteError("must be finite", field=field, value=result[~np.isfinite(result)][0].item())
    result.flags.writeable = False
    return result


def point(value, field, error: type[UncPhysicsError] = InvalidRequestError) -> np.ndarray:
    """Return a position (3,) in the world [m]; beyond `FARTHEST`, double precision is too coarse."""
    place = array(value, (3,), field, error)
    if np.abs(place).max() > FARTHEST:
        raise LimitExceededError(
            f"must be within {FARTHEST:g} m of the origin", field=field, value=place.tolist()
        )
    return place


def quaternion(value, field) -> np.ndarray:
    """Return a unit quaternion (x, y, z, w); small deviations from unit length are normalized."""
    q = array(value, (4,), field)
    length = float(np.linalg.norm(q))
    if abs(length - 1.0) > _QUATERNION_TOLERANCE:
        raise InvalidOrientationError(
            f"must have unit length, not {length:.6g}; the order is x, y, z, w", field=field, value=q.tolist()
        )
    q = q / length
    q.flags.writeable = False
    return q


def covariance(value, size, field) -> np.ndarray:
    """Return a symmetric positive semidefinite matrix (size, size); ``size`` is a multiple of 3.

    Symmetry and eigenvalues are checked relative to the largest variance of each 3 x 3 block, since blocks
    have different units.
    """
    from ..spatial.moments import pivoted_cholesky

    P = array(value, (size, size), field, InvalidCovarianceError)
    diagonal = P.diagonal()
    if np.count_nonzero(P) == np.count_nonzero(diagonal) and diagonal.min(initial=0.0) >= 0.0:
        return P  # only variances
    variance = np.repeat(diagonal.reshape(-1, 3).max(axis=1), 3)
    variance[variance <= 0.0] = max(
        0.0, variance.max(initial=0.0)
    )  # a block without variance has only the round-off of the others
    if (negative := diagonal < -_COVARIANCE_TOLERANCE * variance).any():
        k = int(negative.argmax())
        raise InvalidCovarianceError(
            f"has a negative variance at [{k}][{k}]", field=field, value=float(diagonal[k])
        )
    if not variance.any() and P.any():
        raise InvalidCovarianceError(
            "has entries beside a diagonal of zeros", field=field, value=float(P.flat[np.abs(P).argmax()])
        )
    scale = np.sqrt(np.where(variance > 0.0, variance, 1.0))
    C = P / scale[:, None] / scale
    asymmetry = np.abs(C - C.T)
    if asymmetry.max() > _COVARIANCE_TOLERANCE:
        a, b = np.unravel_index(asymmetry.argmax(), asymmetry.shape)
        raise InvalidCovarianceError(
            f"must be symmetric, but [{a}][{b}] and [{b}][{a}] differ",
            field=field,
            value=(float(P[a, b]), float(P[b, a])),
        )
    C = 0.5 * (C + C.T)
    _, rest = pivoted_cholesky(C, _COVARIANCE_TOLERANCE)
    if (
        np.abs(rest).max() > 10.0 * _COVARIANCE_TOLERANCE
    ):  # a semidefinite matrix leaves no off-diagonal remainder
        low = float(np.linalg.eigvalsh(C)[0])
        if low < -_COVARIANCE_TOLERANCE * size:
            raise InvalidCovarianceError(
                "must not have negative eigenvalues", field=field, value=float(np.linalg.eigvalsh(P)[0])
            )
    P = 0.5 * (P + P.T)
    P.flags.writeable = False
    return P
