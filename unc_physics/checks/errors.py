"""Errors of bad input; each kind has a code.

The codes are the ``error_code`` over ROS (constants of ``unc_physics_msgs/msg/Result``) and the exit status
of the command line.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any, ClassVar

from .shown import printable, shown


class ErrorCode(IntEnum):
    """Code of an error, over ROS and as exit status of the command line.

    Python and argparse use the exit status 1 and 2.
    """

    NONE = 0
    INVALID_REQUEST = 10
    NO_OBJECTS = 11
    DUPLICATE_ID = 12
    UNKNOWN_MODEL = 13
    INVALID_MODEL = 14
    UNKNOWN_PROPAGATOR = 15
    NOT_FINITE = 16
    INVALID_ORIENTATION = 17
    INVALID_COVARIANCE = 18
    INVALID_HORIZON = 19
    INVALID_MASS = 20
    LIMIT_EXCEEDED = 21
    INVALID_OPTION = 22
    INVALID_ENVIRONMENT = 23
    UNKNOWN_FRAME = 24
    TIMEOUT = 25
    NOT_SUPPORTED = 26
    CANCELED = 27
    INVALID_MESH = 28
    OUTPUT_FAILED = 29
    NOT_ACTIVE = 30
    INTERNAL = 31
    DIVERGED = 32
    NOT_READY = 33


class UncPhysicsError(Exception):
    """Base class of all errors of bad input.

    Parameters
    ----------
    problem : str
        Problem, as the end of a sentence.
    field : str, optional
        Field as the user wrote it, for example ``bodies[1].mass``.
    value : object, optional
        Invalid value; shortened in the message.

    Attributes
    ----------
    prediction : Prediction, optional
        Result until then, if the error ended a prediction.
    """

    code: ClassVar[ErrorCode] = ErrorCode.INVALID_REQUEST

    def __init__(self, problem: str, *, field: str | None = None, value: object = None):
        self.problem, self.field, self.value = problem, field, value
        self.prediction: Any = None
        text = problem if field is None else f"{field} {problem}"
        if value is not None:
            text += f" (got {shown(value)})"
        super().__init__(printable(text))

    def at(self, field: str) -> UncPhysicsError:
        """Return the same error with the field as the user wrote it."""
        error = type(self)(self.problem, field=field, value=self.value)
        error.prediction = self.prediction
        return error


class InvalidRequestError(UncPhysicsError):
    """A malformed scene file or message: wrong types, unknown keys, missing or inconsistent entries."""


class NoObjectsError(UncPhysicsError):
    """A scene without bodies."""

    code = ErrorCode.NO_OBJECTS


class DuplicateIdError(UncPhysicsError):
    """Two bodies with the same name."""

    code = ErrorCode.DUPLICATE_ID


class UnknownModelError(UncPhysicsError):
    """A model name that is not in the models directory."""

    code = ErrorCode.UNKNOWN_MODEL


class InvalidModelError(UncPhysicsError):
    """A model file that cannot be read or is inconsistent."""

    code = ErrorCode.INVALID_MODEL


class UnknownPropagatorError(UncPhysicsError):
    """A propagator name that does not exist."""

    code = ErrorCode.UNKNOWN_PROPAGATOR


class NotFiniteError(UncPhysicsError):
    """NaN or infinity instead of a finite number."""

    code = ErrorCode.NOT_FINITE


class InvalidOrientationError(UncPhysicsError):
    """A quaternion far from unit length."""

    code = ErrorCode.INVALID_ORIENTATION


class InvalidCovarianceError(UncPhysicsError):
    """A covariance that is not symmetric, or has a negative eigenvalue, beyond round-off."""

    code = ErrorCode.INVALID_COVARIANCE


class InvalidHorizonError(UncPhysicsError):
    """A horizon, time or time step that is not positive, or too short for a single step."""

    code = ErrorCode.INVALID_HORIZON


class InvalidMassError(UncPhysicsError):
    """A mass that is not positive."""

    code = ErrorCode.INVALID_MASS


class LimitExceededError(UncPhysicsError):
    """A horizon, or number of bodies, samples or steps, above a limit."""

    code = ErrorCode.LIMIT_EXCEEDED


class InvalidOptionError(UncPhysicsError):
    """An unknown option of a propagator or scene, or an invalid value of one."""

    code = ErrorCode.INVALID_OPTION


class InvalidEnvironmentError(UncPhysicsError):
    """An element of the environment that does not describe a solid."""

    code = ErrorCode.INVALID_ENVIRONMENT


class UnknownFrameError(UncPhysicsError):
    """A coordinate frame without a known transform to the world frame."""

    code = ErrorCode.UNKNOWN_FRAME


class PredictionTimeoutError(UncPhysicsError):
    """A prediction that exceeded the time limit of its request."""

    code = ErrorCode.TIMEOUT


class NotSupportedError(UncPhysicsError):
    """A field of the interface that this version does not support."""

    code = ErrorCode.NOT_SUPPORTED


class CanceledError(UncPhysicsError):
    """A prediction that its caller canceled."""

    code = ErrorCode.CANCELED


class InvalidMeshError(UncPhysicsError):
    """A file that is not a mesh, or a mesh that encloses no volume."""

    code = ErrorCode.INVALID_MESH


class OutputError(UncPhysicsError):
    """A result file that cannot be written."""

    code = ErrorCode.OUTPUT_FAILED


class NotActiveError(UncPhysicsError):
    """A node that does not answer, or is not active."""

    code = ErrorCode.NOT_ACTIVE


class InternalError(UncPhysicsError):
    """An internal fault of the node."""

    code = ErrorCode.INTERNAL


class NotReadyError(UncPhysicsError):
    """A request whose kernels are not compiled yet, or whose tracked object physics does not explain yet."""

    code = ErrorCode.NOT_READY


class DivergedError(UncPhysicsError):
    """A simulation that left the range of floating-point numbers."""

    code = ErrorCode.DIVERGED


def error_of(code: int, sentence: str) -> UncPhysicsError:
    """Return the error for a code and message, as of a node's answer or a command's exit status."""
    known = reversed(UncPhysicsError.__subclasses__())  # of several kinds with one code, the first
    kinds: dict[int, type[UncPhysicsError]] = {kind.code: kind for kind in known}
    return kinds.get(code, InternalError)(sentence)
