"""Physics as a message: read from requests, and written with what was used."""

from __future__ import annotations

from array import array as packed_array

from geometry_msgs.msg import Vector3

from unc_physics_msgs.msg import Physics

from ..checks.errors import InvalidOptionError, InvalidRequestError, UncPhysicsError
from ..scene.materials import DEFAULT_RESTITUTION
from ..scene.physics_keys import PHYSICS_KEYS
from ..scene.presets import with_changes
from ..scene.scene import DEFAULT_OVERLAP
from ..scene.scene_file import physics_value, preset
from ..scene.stiffness import AUTO
from .optional import optional

#: What fields of the message are where the core's are None or absent.
_ABSENT = {key: 0.0 for key in PHYSICS_KEYS if key.endswith("_std")}
_ABSENT |= {"damping": 0.0, "friction": 0.0, "gravity": (0.0, 0.0, 0.0)}
_ABSENT |= {"gyroscopic": False, "islands": False, "sleep": False, "stiffness": AUTO}


def read_physics(message: Physics, physics: dict) -> dict:
    """Arguments of `Scene`: ``physics``, changed by what a request says.

    Raises
    ------
    InvalidOptionError, NotFiniteError, InvalidRequestError
        Limits of the values are checked by `Scene`; `physics_field` says what the message calls its fields.
    """
    if message.preset:
        physics = _at("preset", preset, message.preset)
    given = {}
    for key in PHYSICS_KEYS:
        value = getattr(message, key)
        value = (value or None) if isinstance(value, str) else optional(value, f"physics.{key}")
        if value is not None:
            given[key] = _at(physics_field(key), physics_value, key, _plain(key, value))
    return with_changes(physics, given)


def physics_field(key: str) -> str:
    """What the message calls a field of a scene: an entry of an array, but for texts."""
    return key if key in ("preset", "integrator", "overlap") else f"{key}[0]"


def physics_message(physics: dict) -> Physics:
    """All values of a message from arguments of `Scene`, where None and what is absent stand for what `Scene`
    takes for them.
    """
    physics = {key: value for key, value in physics.items() if value is not None}
    integrator = physics.get("integrator", "explicit")
    own = {"restitution": DEFAULT_RESTITUTION[integrator], "overlap": DEFAULT_OVERLAP[integrator]}
    physics = _ABSENT | own | physics
    x, y, z = map(float, physics["gravity"])
    message = Physics(integrator=integrator, overlap=physics["overlap"], gravity=[Vector3(x=x, y=y, z=z)])
    if physics["stiffness"] == AUTO:
        physics["stiffness"] = Physics.STIFFNESS_AUTO
    for key, value in physics.items():
        if isinstance(value, bool):
            setattr(message, key, [value])
        elif isinstance(value, (int, float)):
            setattr(message, key, packed_array("d", (value,)))
    return message


def _plain(key, value):
    """A field's value as a scene file has it."""
    if key == "gravity":
        return value.x, value.y, value.z
    return AUTO if key == "stiffness" and value == Physics.STIFFNESS_AUTO else value


def _at(field, function, *arguments):
    """Call a function and let its errors name a field of the message."""
    try:
        return function(*arguments)
    except InvalidRequestError as error:
        raise InvalidOptionError(error.problem, field=f"physics.{field}", value=error.value) from None
    except UncPhysicsError as error:
        raise type(error)(error.problem, field=f"physics.{field}", value=error.value) from None
