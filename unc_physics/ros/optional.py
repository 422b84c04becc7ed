"""Fields that may be left out: arrays of at most one entry."""

from __future__ import annotations

from ..checks.errors import InvalidRequestError


def optional(values, field: str):
    """The entry of such an array, None if it is empty.

    Raises
    ------
    InvalidRequestError
        If it holds more, which clients do not check.
    """
    if len(values) == 0:
        return None
    if len(values) > 1:
        raise InvalidRequestError("must hold at most one entry", field=field, value=len(values))
    return values[0]
