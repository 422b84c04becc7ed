"""Messages of the physics: read by the node, written by client and node."""

from __future__ import annotations

from unc_physics_msgs.msg import Physics

from ...checks.errors import InvalidOptionError, InvalidRequestError, UncPhysicsError
from ...scene.materials import DEFAULT_RESTITUTION
from ...scene.physics_keys import PHYSICS_KEYS
from ...scene.presets import certain, with_changes
from ...scene.scene import DEFAULT_OVERLAP
from ...scene.scene_file import physics_value, preset
from ...scene.stiffness import AUTO
from .fields import optional, vector_message, xyz

#: Keys that have a field.
_FIELDS = tuple(key for key in PHYSICS_KEYS if hasattr(Physics, key))
#: Values in the message of fields that are None or absent in the core.
_ABSENT = {key: 0.0 for key in PHYSICS_KEYS if key.endswith("_std")}
_ABSENT |= {
    "impact_friction_speed": 0.0,
    "rolling_friction": 0.0,
    "damping": 0.0,
    "friction": 0.0,
    "gravity": (0.0, 0.0, 0.0),
}
_ABSENT |= {"gyroscopic": False, "sleep": False, "stiffness": AUTO}


def read_physics(message: Physics, physics: dict) -> dict:
    """Return arguments of `Scene`: ``physics`` with the changes of a request.

    Raises
    ------
    InvalidOptionError, NotFiniteError, InvalidRequestError
        Limits of values are checked by `Scene`.
    """
    if message.preset:
        physics = _at("preset", preset, message.preset, message.exact)
    elif message.exact:
        physics = certain(physics)
    given = {}
    for key in _FIELDS:
        value = getattr(message, key)
        if isinstance(value, str) or key.endswith("_std"):
            value = value or None
        else:
            value = optional(message, key, "physics")
        if key == "impact_friction_speed" and value == 0.0:
            given[key] = None
        elif value is not None:
            given[key] = _at(key, physics_value, key, _plain(key, value))
    return with_changes(physics, given)


def physics_message(physics: dict) -> Physics:
    """Return a complete message from arguments of `Scene`; None and missing values become defaults."""
    physics = {key: value for key, value in physics.items() if key in _FIELDS and value is not None}
    integrator = physics.get("integrator", "explicit")
    own = {"restitution": DEFAULT_RESTITUTION[integrator], "overlap": DEFAULT_OVERLAP[integrator]}
    physics = _ABSENT | own | physics
    physics |= {"integrator": integrator, "gravity": vector_message(physics["gravity"])}
    if physics["stiffness"] == AUTO:
        physics["stiffness"] = Physics.STIFFNESS_AUTO
    message = Physics(exact=True)  # all that is uncertain is in the message
    for key, value in physics.items():
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            value = float(value)
        setattr(message, key, value)
        if hasattr(message, f"has_{key}"):
            setattr(message, f"has_{key}", True)
    return message


def _plain(key, value):
    """Return a field's value in the format of scene files."""
    if key == "gravity":
        return xyz(value)
    return AUTO if key == "stiffness" and value == Physics.STIFFNESS_AUTO else value


def _at(field, function, *arguments):
    """Call a function and set the field of its errors to a field of the message."""
    try:
        return function(*arguments)
    except InvalidRequestError as error:
        raise InvalidOptionError(error.problem, field=f"physics.{field}", value=error.value) from None
    except UncPhysicsError as error:
        raise error.at(f"physics.{field}") from None
