"""Named sets of physics, which provide the defaults of a scene."""

from .physics_keys import PHYSICS_KEYS

#: Arguments of `Scene` for each value of a scene file's key ``physics``.
PRESETS = {
    "paper": {"gravity": (0.0, 0.0, 0.0)},
    "everyday": {
        "integrator": "implicit",
        "dt": 1.0 / 240.0,  # s
        "gravity": (0.0, 0.0, -9.81),  # m/s^2
        "gyroscopic": True,
        "friction": 0.5,
        "restitution": 0.1,
    },
}


def with_changes(physics: dict, given: dict) -> dict:
    """Return arguments of `Scene`: ``physics`` overridden by ``given``; None disables a law."""
    if "gravity" in given and given["gravity"] is None:
        given = given | {"gravity": (0.0, 0.0, 0.0)}  # `Scene` distinguishes this from a missing entry
    laws = {key for key, spec in PHYSICS_KEYS.items() if spec.law}
    said = {key: value for key, value in given.items() if value is not None or key in laws}
    return {key: value for key, value in (physics | said).items() if value is not None}
