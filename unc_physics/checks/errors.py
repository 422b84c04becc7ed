"""Errors that bad input raises; each kind has its own code.

The same numbers serve as ``error_code`` over ROS (the constants of ``unc_physics_msgs/msg/Result``) and as
the exit status of the command line, so a failure reads the same wherever it shows.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any, ClassVar

from .shown import printable, shown


class ErrorCode(IntEnum):
    """Code of an error: over ROS, and as exit status of the command line (1 and 2 are left to Python and
    argparse).
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


class UncPhysicsError(Exception):
    """Base of every error that bad input raises.

    Parameters
    ----------
    problem : str
        What is wrong, as the end of one sentence.
    field : str, optional
        The offending field, as the user wrote it, for example ``bodies[1].mass``.
    value : object, optional
        The offending value; shown shortened.

    Attributes
    ----------
    prediction : Prediction, optional
        Of an error that ended a prediction: what was predicted until then.
    """

    code: ClassVar[ErrorCode] = ErrorCode.INVALID_REQUEST

    def __init__(self, problem: str, *, field: str | None = None, value: object = None):
        self.problem, self.field, self.value = problem, field, value
        self.prediction: Any = None
        text = problem if field is None else f"{field} {problem}"
        if value is not None:
            text += f" (got {shown(value)})"
        super().__init__(printable(text))


class InvalidRequestError(UncPhysicsError):
    """A malformed scene file or message: wrong types, unknown keys, missing or inconsistent entries."""


class NoObjectsError(UncPhysicsError):
    """A scene without bodies."""

    code = ErrorCode.NO_OBJECTS


class DuplicateIdError(UncPhysicsError):
    """Two bodies of one name."""

    code = ErrorCode.DUPLICATE_ID


class UnknownModelError(UncPhysicsError):
    """No model of that name in the models directory."""

    code = ErrorCode.UNKNOWN_MODEL


class InvalidModelError(UncPhysicsError):
    """A model file that cannot be read or contradicts itself."""

    code = ErrorCode.INVALID_MODEL


class UnknownPropagatorError(UncPhysicsError):
    """No propagator of that name."""

    code = ErrorCode.UNKNOWN_PROPAGATOR


class NotFiniteError(UncPhysicsError):
    """NaN or infinity where a finite number is needed."""

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
    """A horizon, a number of bodies, samples or steps above a set limit."""

    code = ErrorCode.LIMIT_EXCEEDED


class InvalidOptionError(UncPhysicsError):
    """A propagator's or scene's option that does not exist, or a value it cannot take."""

    code = ErrorCode.INVALID_OPTION


class InvalidEnvironmentError(UncPhysicsError):
    """An element of the environment that makes no solid."""

    code = ErrorCode.INVALID_ENVIRONMENT


class UnknownFrameError(UncPhysicsError):
    """A coordinate frame that cannot be related to the world frame."""

    code = ErrorCode.UNKNOWN_FRAME


class PredictionTimeoutError(UncPhysicsError):
    """The computation time that a request allows ran out."""

    code = ErrorCode.TIMEOUT


class NotSupportedError(UncPhysicsError):
    """A field that is part of the interface but not served by this version."""

    code = ErrorCode.NOT_SUPPORTED


class CanceledError(UncPhysicsError):
    """The caller canceled the prediction."""

    code = ErrorCode.CANCELED


class InvalidMeshError(UncPhysicsError):
    """A file that is no mesh, or a mesh that encloses no volume."""

    code = ErrorCode.INVALID_MESH


class OutputError(UncPhysicsError):
    """A result file that cannot be written."""

    code = ErrorCode.OUTPUT_FAILED


class NotActiveError(UncPhysicsError):
    """A node that does not answer, or is not active."""

    code = ErrorCode.NOT_ACTIVE


class InternalError(UncPhysicsError):
    """A fault of the node itself."""

    code = ErrorCode.INTERNAL


class DivergedError(UncPhysicsError):
    """The simulation left the range of numbers."""

    code = ErrorCode.DIVERGED


def error_of(code: int, sentence: str) -> UncPhysicsError:
    """The error that a code and its sentence stand for, as of a node's answer or a command's exit status."""
    known = reversed(UncPhysicsError.__subclasses__())  # of several with one code, the first
    kinds: dict[int, type[UncPhysicsError]] = {kind.code: kind for kind in known}
    return kinds.get(code, InternalError)(sentence)
