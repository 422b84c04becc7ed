"""Read numbers and check keys of YAML files, with the place of each error."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..checks.errors import InvalidRequestError, UncPhysicsError
from ..checks.names import hint, removed
from ..checks.validation import array, number
from ..spatial.rotation import from_roll_pitch_yaw
from .body_belief import within_a_turn

ORIENTATION, ROLL_PITCH_YAW = "orientation", "roll_pitch_yaw"


def at_field(field, function, *arguments, **options):
    """Call a function and prefix the field of its errors with the place in the file."""
    try:
        return function(*arguments, **options)
    except UncPhysicsError as error:
        raise error.at(f"{field}.{error.field}" if error.field else field) from error


def read_orientation(content, field, error: type[UncPhysicsError] = InvalidRequestError):
    """Return the quaternion (4,) of the key ``orientation`` or ``roll_pitch_yaw``; None without either."""
    found, turned = None, None
    if content.get(ORIENTATION) is not None:
        found = read_numbers(content[ORIENTATION], (4,), f"{field}.{ORIENTATION}", error)
    value, place = content.get(ROLL_PITCH_YAW), f"{field}.{ROLL_PITCH_YAW}"
    if isinstance(value, dict):
        check_keys(value, ("degrees",), place, error)
        turned = np.radians(read_numbers(value.get("degrees"), (3,), f"{place}.degrees", error))
    elif value is not None:
        turned = read_numbers(value, (3,), place, error)
        at_field(field, within_a_turn, turned, ROLL_PITCH_YAW)
    if turned is None:
        return found
    if found is not None:
        raise error(f"must not be given beside {ORIENTATION}", field=place)
    return from_roll_pitch_yaw(turned)


def read_numbers(value, shape, field, error: type[UncPhysicsError] = InvalidRequestError) -> Any:
    """Return a number, for the shape (), or a list of so many numbers as an array."""
    if not shape:
        return number(value, field, error)
    if not isinstance(value, (list, tuple)) or len(value) != shape[0]:
        raise error(f"must be a list of {shape[0]} numbers", field=field, value=value)
    return array([number(entry, f"{field}[{k}]", error) for k, entry in enumerate(value)], shape, field)


def check_keys(content, known, field, error: type[UncPhysicsError] = InvalidRequestError) -> None:
    """Raise an error unless the content is a mapping with known keys only."""
    if not isinstance(content, dict):
        raise error("must be a mapping of keys to values", field=field, value=content)
    for key in content:
        if not isinstance(key, str):
            raise error("has a key that is no text", field=field, value=key)
        if key not in known:
            if gone := removed(key):
                raise error(f"has the key {key!r}, which {gone}", field=field)
            raise error(f"has no key {key[:50]!r}{hint(key, known)}", field=field)
