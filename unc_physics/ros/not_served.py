"""What the messages have room for and this version does not serve: asked for, it is an error, and never
ignored.
"""

from __future__ import annotations

import numpy as np
from shape_msgs.msg import SolidPrimitive

from ..checks.errors import NotSupportedError

_MODEL = "name a model; ~/load_model packs meshes"
_FIXED_OBJECT = "a fixed object with a model may have any shape"

#: Fields of each message that must be empty or zero, and what to do instead.
NOT_SERVED = {
    "ObjectState": {"primitive": _MODEL, "mesh": _MODEL},
    "EnvironmentElement": {"mesh": _FIXED_OBJECT},
    "PredictCandidates": {"score": "leave it empty, and rank the answers"},
}

#: Values of other fields, their names, and what to do instead.
NOT_SERVED_VALUES = {
    "SolidPrimitive": {
        "type": {SolidPrimitive.CONE: ("CONE", _FIXED_OBJECT), SolidPrimitive.PRISM: ("PRISM", _FIXED_OBJECT)}
    }
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
    if isinstance(value, np.ndarray):
        return bool(value.any())
    if not value:
        return False
    if isinstance(value, (bool, int, float, str)):
        return True
    if hasattr(value, "get_fields_and_field_types"):
        return any(_asks(getattr(value, name)) for name in value.get_fields_and_field_types())
    return any(hasattr(entry, "get_fields_and_field_types") or bool(entry) for entry in value)
