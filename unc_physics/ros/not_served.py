"""What the messages have room for and this version does not serve: asked for, it is an error, and never
ignored.
"""

from __future__ import annotations

import numpy as np

from unc_physics_msgs.msg import ObjectState

from ..checks.errors import NotSupportedError

_UNTOUCHED = "predict up to where it is used, and begin anew from there"

#: Fields of each message that must be empty or zero, and what to do instead.
NOT_SERVED = {
    "ObjectState": {
        "trajectory": _UNTOUCHED,
        "trajectory_std": _UNTOUCHED,
        "attached_to": _UNTOUCHED,
        "attached_at": _UNTOUCHED,
        "released_at": _UNTOUCHED,
        "released_at_std": _UNTOUCHED,
        "wrenches": _UNTOUCHED,
    },
    "Material": {"torsional_friction": "leave it empty"},
    "EnvironmentElement": {"surface_velocity": "leave it zero"},
}

#: Values of other fields, their names, and what to do instead.
NOT_SERVED_VALUES = {
    "ObjectState": {"kind": {ObjectState.PRESCRIBED: ("PRESCRIBED", "take DYNAMIC or FIXED")}}
}


def refuse_not_served(kind: str, message, place: str) -> None:
    """Raise `NotSupportedError` if a message asks for what is not served.

    Parameters
    ----------
    kind : str
        The message's type, as in `NOT_SERVED`.
    message : message
    place : str
        What errors write before the field's name: empty, or a path that ends with a dot.
    """
    for name, instead in NOT_SERVED.get(kind, {}).items():
        if _asks(getattr(message, name)):
            raise NotSupportedError(f"is not supported; {instead}", field=f"{place}{name}")
    for name, values in NOT_SERVED_VALUES.get(kind, {}).items():
        if (value := getattr(message, name)) in values:
            shown, instead = values[value]
            raise NotSupportedError(f"{shown} is not supported; {instead}", field=f"{place}{name}")


def _asks(value) -> bool:
    """Whether a field is neither empty nor zero."""
    if isinstance(value, (bool, int, float, str)):
        return bool(value)
    if hasattr(value, "get_fields_and_field_types"):
        return any(_asks(getattr(value, name)) for name in value.get_fields_and_field_types())
    if isinstance(value, np.ndarray):
        return bool(value.any())
    return any(hasattr(entry, "get_fields_and_field_types") or bool(entry) for entry in value)
