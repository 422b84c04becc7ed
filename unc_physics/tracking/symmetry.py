"""Symmetries of models: rotations after which a body looks as before."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..checks.array_field import Array, array_field
from ..checks.errors import InvalidRequestError
from ..checks.names import hint
from ..checks.validation import array, instance, numbers, quaternion
from ..scene.scene import Scene
from ..spatial.layout import ERR_ROTATION, ERROR, QUATERNION
from ..spatial.moments import mean_and_errors
from ..spatial.quaternions import inverse, product
from ..spatial.rotation import rotation_matrix
from .measurements import Observation
from .observation import RELATIVE_POSE

#: Standard deviation of a measured angle about an axis of symmetry, which is unknown [rad].
_UNSEEN = 10.0
#: Distance [m] and tilt [rad] within which a measured body counts as still: a few times a detector's noise.
_SAME_PLACE, _SAME_AXIS = 0.02, 0.2
_IDENTITY = np.array([0.0, 0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class AxialSymmetry:
    """Symmetry of a can or a bottle: it looks the same at every angle about an axis.

    No measurement determines the angle about the axis, and a tracker gives it the same value in all members.
    Its mean and its variance in answers are meaningless: the variance is nearly 0 after a measurement, though
    the angle is unknown. Replace it by the variance of an unknown angle, ``pi**2 / 3``, for other programs.

    Attributes
    ----------
    axis : (3,) array
        Through the centre of mass, body axes. Its length does not matter.
    reversible : bool
        Whether the body also looks the same upside down, as a can without a label.

    Raises
    ------
    InvalidRequestError, NotFiniteError
        For an axis of length 0, wrong shapes, and NaN or infinity.
    """

    axis: Array = array_field((0.0, 0.0, 1.0))
    reversible: bool = False

    def __post_init__(self):
        axis = array(self.axis, (3,), "axis")
        length = float(np.linalg.norm(axis))
        if not length > 0.0:
            raise InvalidRequestError("must have a direction", field="axis", value=axis.tolist())
        object.__setattr__(self, "axis", axis / length)


class Symmetry(NamedTuple):
    """A checked symmetry.

    Attributes
    ----------
    rotations : (K, 4) array
        Discrete ones, the identity among them.
    axis : (3,) array or None
        Unit axis about which all angles look alike.
    """

    rotations: np.ndarray
    axis: np.ndarray | None

    def folded(self, observation: Observation, expected: np.ndarray) -> Observation:
        """Return the equivalent observation whose rotation is nearest to the expected one.

        Parameters
        ----------
        observation : Observation
            Of a pose.
        expected : (4,) array
            Quaternion, in the frame of the observation.
        """
        turns, axis = self.rotations, self.axis
        if axis is not None:  # each discrete rotation, then that about the axis which comes nearest
            between = product(inverse(expected), product(observation.value[3:], turns))
            turns = product(turns, inverse(_about(axis, between)))
        equivalents = product(observation.value[3:], turns)
        best = int(np.argmax(np.abs(equivalents @ expected)))
        value, noise = observation.value.copy(), observation.noise.copy()
        value[3:] = equivalents[best]
        # errors are about the body's axes, which the symmetry has turned
        back = rotation_matrix(turns[best]).T
        noise[3:] = back @ noise[3:]
        noise[:, 3:] = noise[:, 3:] @ back.T
        if axis is not None:
            noise[3:, 3:] += _UNSEEN**2 * np.outer(axis, axis)
        return observation._replace(value=value, noise=noise)

    def aligned(self, states: np.ndarray, body: int) -> np.ndarray:
        """Return states (N, B, 13) with a body turned about its axis to the angle nearest to the mean.

        Its velocities do not change. Without an axis nothing changes. The alignment is needed as no mean of
        rotations is defined for all angles.
        """
        if self.axis is None:
            return states
        mean = states[0, body, QUATERNION]
        states = states.copy()
        for _ in range(2):  # about the first member, then about the mean
            q = states[:, body, QUATERNION]
            turns = _about(self.axis, product(inverse(mean), q))
            states[:, body, QUATERNION] = product(q, inverse(turns))
            mean = mean_and_errors(states, np.array([body]))[0][body, QUATERNION]
        return states

    def without_angle(self, covariance: np.ndarray) -> np.ndarray:
        """Return a covariance (12, 12) without variance of the meaningless angle about the axis."""
        if self.axis is None:
            return covariance
        across = np.eye(ERROR)
        across[ERR_ROTATION, ERR_ROTATION] -= np.outer(self.axis, self.axis)
        return across @ covariance @ across

    def seen_spin(self, quaternion_: np.ndarray) -> np.ndarray:
        """Return the projection (3, 3) of angular velocities, world axes, to those that poses determine."""
        if self.axis is None:
            return np.eye(3)
        axis = rotation_matrix(quaternion_) @ self.axis
        return np.eye(3) - np.outer(axis, axis)


#: Symmetry of a body that looks different from every side.
NONE = Symmetry(_IDENTITY[None], None)


def checked_symmetries(
    symmetries: Mapping[str, ArrayLike | AxialSymmetry], scene: Scene
) -> dict[str, Symmetry]:
    """Return the symmetry of each body that has one."""
    instance(symmetries, Mapping, "symmetries")
    names, found = [body.name for body in scene.bodies], {}
    for name, given in symmetries.items():
        if name not in names:
            raise InvalidRequestError(
                f"is no body of the scene{hint(str(name), names)}", field="symmetries", value=name
            )
        found[name] = checked_symmetry(given, f"symmetries['{name}']")
    return found


def checked_symmetry(given: ArrayLike | AxialSymmetry, field: str) -> Symmetry:
    """Return the symmetry of a body, checked; errors call it ``field``."""
    if isinstance(given, AxialSymmetry):
        across = np.cross(given.axis, np.eye(3)[np.argmin(np.abs(given.axis))])
        over = np.append(across / np.linalg.norm(across), 0.0)
        rotations = [_IDENTITY, over] if given.reversible else [_IDENTITY]
        return Symmetry(np.array(rotations), given.axis)
    kinds = "must be an AxialSymmetry, or quaternions (x, y, z, w) as an array of shape (K, 4)"
    try:
        rotations = numbers(given, field)
    except InvalidRequestError:
        raise InvalidRequestError(kinds, field=field, value=given) from None
    if rotations.ndim != 2 or rotations.shape[1] != 4:
        raise InvalidRequestError(kinds, field=field, value=given)
    checked = [quaternion(q, f"{field}[{k}]") for k, q in enumerate(rotations)]
    return Symmetry(np.array([_IDENTITY, *checked]), None)


def folded(
    symmetry: Symmetry, observation: Observation, body: np.ndarray, reference: np.ndarray
) -> Observation:
    """Return the equivalent observation nearest to the expected states (13,) of a body and its reference."""
    if symmetry is NONE or not observation.has_rotation:
        return observation
    expected = body[QUATERNION]
    if observation.kind == RELATIVE_POSE:
        expected = product(inverse(reference[QUATERNION]), expected)
    return symmetry.folded(observation, expected)


def turned_about(first: np.ndarray, later: np.ndarray) -> int | None:
    """Return the body axis about which a body that stays where it is has turned, by more than a quarter turn.

    Parameters
    ----------
    first, later : (7,) array
        Poses: position and quaternion (x, y, z, w).

    Returns
    -------
    int or None
        0, 1 or 2 for x, y or z; -1 if the body has moved or tilted; None if it has done neither, nor turned.
    """
    R, S = rotation_matrix(first[3:]), rotation_matrix(later[3:])
    along = np.einsum("ra,ra->a", R, S)  # cosines between each axis before and after
    axis = int(np.argmax(along))
    if np.linalg.norm(later[:3] - first[:3]) > _SAME_PLACE or along[axis] < np.cos(_SAME_AXIS):
        return -1
    return axis if along.min() < 0.0 else None


def _about(axis, turns):
    """Return the parts (..., 4) about an axis of rotations (..., 4)."""
    along, w = turns[..., :3] @ axis, turns[..., 3]
    size = np.hypot(along, w)
    along, w = np.where(size > 0.0, along, 0.0), np.where(size > 0.0, w, 1.0)
    size = np.where(size > 0.0, size, 1.0)
    return np.concatenate([(along / size)[..., None] * axis, (w / size)[..., None]], axis=-1)
