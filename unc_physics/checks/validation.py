"""Checks of numbers at the edge: every array and scalar that enters is finite, of its shape, and within its
range.
"""

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

#: How far from the origin anything may be [m].
FARTHEST = 1e12
#: How far a quaternion's length may be from 1: perception rounds to single precision or a few decimals.
_QUATERNION_TOLERANCE = 1e-3
#: What round-off may leave of a covariance's asymmetry and negative eigenvalues, relative to its blocks'
# sizes.
_COVARIANCE_TOLERANCE = 1e-8


def number(value, field, error: type[UncPhysicsError] = InvalidRequestError) -> float:
    """A finite float; strings in any Python float form count, booleans do not."""
    if isinstance(value, bool):
        raise error("must be a number", field=field, value=value)
    try:
        result = float(value)
    except (TypeError, ValueError, OverflowError):
        raise error("must be a number", field=field, value=value) from None
    if not math.isfinite(result):
        raise NotFiniteError("must be finite", field=field, value=value)
    return result


def instance(value, kinds, field) -> None:
    """Raise `InvalidRequestError` unless a value is of one class, or of one of several.

    The value itself stays out of the message: as a rule it is another argument, with all its arrays.
    """
    kinds = kinds if isinstance(kinds, tuple) else (kinds,)
    if not isinstance(value, kinds):
        names = [_with_article(kind.__name__) for kind in kinds]
        given = "None" if value is None else _with_article(type(value).__name__)
        raise InvalidRequestError(f"must be {' or '.join(names)}, not {given}", field=field)


def _with_article(name):
    return f"{'an' if name[0].lower() in 'aeio' else 'a'} {name}"


def positive(value, field, error: type[UncPhysicsError] = InvalidRequestError) -> float:
    """A finite float above zero."""
    result = number(value, field, error)
    if result <= 0.0:
        raise error("must be positive", field=field, value=value)
    return result


def non_negative(value, field, error: type[UncPhysicsError] = InvalidRequestError) -> float:
    """A finite float that is not below zero."""
    result = number(value, field, error)
    if result < 0.0:
        raise error("must not be negative", field=field, value=value)
    return result


def share(value, field, error: type[UncPhysicsError] = InvalidRequestError) -> float:
    """A float from 0 to 1."""
    result = number(value, field, error)
    if not 0.0 <= result <= 1.0:
        raise error("must be between 0 and 1", field=field, value=value)
    return result


def flag(value, field, error: type[UncPhysicsError] = InvalidRequestError) -> bool:
    """True or false, and nothing that merely counts as one of them."""
    if not isinstance(value, (bool, np.bool_)):
        raise error("must be true or false", field=field, value=value)
    return bool(value)


def integer(value, field, *, low, error: type[UncPhysicsError] = InvalidRequestError) -> int:
    """An int that is at least ``low``."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)):
        raise error("must be an integer", field=field, value=value)
    if value < low:
        raise error(f"must be at least {low}", field=field, value=value)
    return int(value)


def numbers(value, field, error: type[UncPhysicsError] = InvalidRequestError) -> np.ndarray:
    """A float64 array of any shape, independent of the input."""
    try:
        return np.array(value, dtype=float, order="C")
    except (TypeError, ValueError, OverflowError):
        raise error("must be an array of numbers", field=field, value=value) from None


def array(value, shape, field, error: type[UncPhysicsError] = InvalidRequestError) -> np.ndarray:
    """A finite, read-only float64 array of the given shape, independent of the input."""
    result = numbers(value, field, error)
    if result.shape != shape:
        raise error(f"must have shape {shape}, not {result.shape}", field=field)
    if not np.isfinite(result).all():
        raise NotFiniteError("must be finite", field=field, value=result[~np.isfinite(result)][0].item())
    result.flags.writeable = False
    return result


def point(value, field, error: type[UncPhysicsError] = InvalidRequestError) -> np.ndarray:
    """A place (3,) in the world [m]; beyond `FARTHEST` the steps between numbers are no longer small."""
    place = array(value, (3,), field, error)
    if np.abs(place).max() > FARTHEST:
        raise LimitExceededError(
            f"must be within {FARTHEST:g} m of the origin", field=field, value=place.tolist()
        )
    return place


def quaternion(value, field) -> np.ndarray:
    """A unit quaternion (x, y, z, w); small deviations from unit length are normalized."""
    q = array(value, (4,), field)
    length = float(np.linalg.norm(q))
    if abs(length - 1.0) > _QUATERNION_TOLERANCE:
        raise InvalidOrientationError(
            f"must have unit length, not {length:.6g}", field=field, value=q.tolist()
        )
    q = q / length
    q.flags.writeable = False
    return q


def covariance(value, size, field) -> np.ndarray:
    """A symmetric positive semidefinite matrix (size, size), ``size`` a multiple of 3.

    Symmetry and eigenvalues are judged relative to the largest variance of each block of three, since blocks
    have different units.
    """
    from ..spatial.moments import pivoted_cholesky

    P = array(value, (size, size), field, InvalidCovarianceError)
    diagonal = P.diagonal()
    if np.count_nonzero(P) == np.count_nonzero(diagonal) and diagonal.min(initial=0.0) >= 0.0:
        return P  # variances alone
    variance = np.repeat(diagonal.reshape(-1, 3).max(axis=1), 3)
    variance[variance <= 0.0] = max(
        0.0, variance.max(initial=0.0)
    )  # a certain block has only the others' round-off
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
    ):  # a semidefinite matrix leaves nothing off its diagonal
        low = float(np.linalg.eigvalsh(C)[0])
        if low < -_COVARIANCE_TOLERANCE * size:
            raise InvalidCovarianceError(
                "must not have negative eigenvalues", field=field, value=float(np.linalg.eigvalsh(P)[0])
            )
    P = 0.5 * (P + P.T)
    P.flags.writeable = False
    return P
