"""Summaries of a scene's physics."""

from __future__ import annotations

from typing import Any

from ..checks.validation import instance
from .environment import thing_names
from .materials import DEFAULT_RESTITUTION, Materials
from .scene import IMPACT_STDS, Scene

_STDS = ("stiffness_std", "gravity_direction_std", "friction_std", "restitution_std", *IMPACT_STDS)


def physics_of(scene: Scene) -> dict[str, Any]:
    """Return the physics of a scene as plain Python values [SI].

    ``friction`` and ``restitution`` apply to all surfaces without their own values. ``friction_of`` and
    ``restitution_of`` list surfaces with their own values by name, and ``pairs`` those of pairs, if any.
    Uncertain parameters of the scene include their standard deviations.
    """
    instance(scene, Scene, "scene")
    restitution = DEFAULT_RESTITUTION[scene.integrator] if scene.restitution is None else scene.restitution
    found = {
        "integrator": scene.integrator,
        "dt": scene.dt,
        "damping": scene.damping,
        "gravity": scene.gravity.tolist(),
        "gyroscopic": scene.gyroscopic,
        "friction": scene.friction or 0.0,
        "restitution": restitution,
        "sleep": scene.sleep,
        "overlap": scene.overlap,
    }
    if scene.integrator == "explicit":
        found["stiffness"] = scene.stiffness
    else:
        found["rolling_friction"] = scene.rolling_friction or 0.0
    for key in (*Materials._fields, "rolling_friction"):
        own = {
            name: value
            for name, surface in zip(thing_names(scene), scene.surfaces, strict=True)
            if (value := getattr(surface, key)) is not None
        }
        if own:
            found[f"{key}_of"] = own
    if scene.pairs:
        found["pairs"] = [{"between": list(pair.between)} | pair.given for pair in scene.pairs]
    if scene.impact_friction_speed is not None:
        found["impact_friction_speed"] = scene.impact_friction_speed
    return found | {key: std for key in _STDS if (std := getattr(scene, key))}


def physics_as_text(scene: Scene) -> str:
    """Return the physics of a scene in one line, as 'implicit, dt 0.0041667 s, ...'."""
    physics = physics_of(scene)
    parts = [physics["integrator"], f"dt {physics['dt']:.5g} s"]
    if scene.stiffness is not None:
        parts.append(f"stiffness {scene.stiffness:.3g} N/m^3")
    if any(physics["gravity"]):
        parts.append(f"gravity ({', '.join(f'{g:g}' for g in physics['gravity'])}) m/s^2")
    if physics["damping"]:
        parts.append(f"damping {physics['damping']:g} 1/s")
    if scene.integrator != "explicit":
        parts += [
            f"{key} {physics[key]:g}"
            + (f" +- {physics[f'{key}_std']:g}" if f"{key}_std" in physics else "")
            + (" (some surfaces have their own)" if f"{key}_of" in physics else "")
            for key in Materials._fields
        ]
    if scene.rolling_friction:
        parts.append(f"rolling friction {scene.rolling_friction * 1e3:g} mm")
    if scene.pairs:
        parts.append(f"pairs {', '.join(' and '.join(pair.between) for pair in scene.pairs)}")
    if scene.integrator == "implicit" and scene.overlap != "project":
        parts.append(f"overlap {scene.overlap}")
    return ", ".join(parts + [key for key in ("gyroscopic", "sleep") if physics[key]])
