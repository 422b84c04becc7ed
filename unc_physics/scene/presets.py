"""Named sets of physics, which provide the defaults of a scene."""

from .physics_keys import PHYSICS_KEYS

#: Laws of the preset ``everyday``, which need the implicit integrator.
_EVERYDAY = {
    "integrator": "implicit",
    "dt": 1.0 / 240.0,  # s
    "gravity": (0.0, 0.0, -9.81),  # m/s^2
    "gyroscopic": True,
}
#: Arguments of `Scene` for each value of a scene file's key ``physics``. Friction and restitution of
#: ``everyday`` are a prior for unknown household objects (sources: `docs/how-to/uncertain-parameters.md`).
PRESETS = {
    "paper": {"gravity": (0.0, 0.0, 0.0)},
    "everyday": _EVERYDAY
    | {
        "friction": 0.25,
        "friction_std": 0.12,
        "restitution": 0.25,
        "restitution_std": 0.15,
        "impact_friction_speed": 3.0,  # m/s
        "impact_direction_std": 0.03,  # rad
        "impact_point_std": 0.005,  # m
        "impact_friction_std": 0.1,
        "rolling_friction": 1e-4,  # m, of hard household objects
    },
}
#: ``PRESETS`` with the key ``exact``: one friction and one restitution, and impacts without errors.
EXACT_PRESETS = PRESETS | {"everyday": _EVERYDAY | {"friction": 0.5, "restitution": 0.1}}


def certain(physics: dict) -> dict:
    """Return arguments of `Scene` without standard deviations, and with impacts as in `EXACT_PRESETS`."""
    return {key: value for key, value in physics.items() if not _is_uncertain(key)}


def _is_uncertain(key):
    return key.endswith("_std") or key == "impact_friction_speed"


def with_changes(physics: dict, given: dict) -> dict:
    """Return arguments of `Scene`: ``physics`` overridden by ``given``; None disables a law.

    A given friction or restitution is exact unless its standard deviation is given, too. A change of the
    integrator drops what the other one lacks and nobody asked for: explicit has no sleep, rolling friction
    and errors of contacts, and implicit has no stiffness.
    """
    if "gravity" in given and given["gravity"] is None:
        given = given | {"gravity": (0.0, 0.0, 0.0)}  # `Scene` distinguishes this from a missing entry
    laws = {key for key, spec in PHYSICS_KEYS.items() if spec.law}
    overrides = {key: value for key, value in given.items() if value is not None or key in laws}
    replaced = {f"{key}_std" for key in ("friction", "restitution") if key in overrides}
    integrator = overrides.get("integrator", physics.get("integrator"))
    if integrator == "explicit" and physics.get("integrator") == "implicit":
        replaced |= {"sleep", "rolling_friction", *filter(_is_uncertain, physics)}
    elif integrator == "implicit" and physics.get("integrator") == "explicit":
        replaced |= {"stiffness", "stiffness_std"}
    physics = {key: value for key, value in physics.items() if key not in replaced} | overrides
    return {key: value for key, value in physics.items() if value is not None}
