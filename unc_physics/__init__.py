"""Predicts where rigid objects will be, and how surely: rigid-body dynamics with uncertainty.

    from unc_physics import load_scene, predict
    scene, belief, horizon = load_scene("scene.yaml")
    prediction = predict(scene, belief, "sigma_points", horizon)
    prediction.belief.mean, prediction.belief.covariance

What is named here is the public interface; modules below are not.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:  # what `__getattr__` below imports at run time
    from .checks.errors import ErrorCode, UncPhysicsError
    from .geometry.library import list_models, load_model
    from .geometry.packing import pack_solid
    from .geometry.packing_file import SpherePacking, load_packing, save_packing
    from .geometry.solid_mesh import SolidMesh, load_solid
    from .prediction.predict import Prediction, predict, start_belief
    from .prediction.probabilities import (
        BoxRegion,
        ContactProbability,
        RegionProbability,
        RestProbability,
        contact_probabilities,
        region_probabilities,
        rest_probabilities,
    )
    from .prediction.status import BodyStatus, Status, assess
    from .propagators.base import Propagator
    from .propagators.registry import PROPAGATORS, make_propagator
    from .scene.belief import Belief
    from .scene.body import RigidBody
    from .scene.environment import Box, Capsule, Cylinder, Element, Plane, Sphere
    from .scene.physics_summary import physics_of
    from .scene.presets import PRESETS
    from .scene.scene import Scene
    from .scene.scene_file import LoadedScene, load_scene
    from .scene.stiffness import auto_stiffness, with_stiffness

__version__ = "0.1.0"

__all__ = [
    "PRESETS",
    "PROPAGATORS",
    "Belief",
    "BodyStatus",
    "Box",
    "BoxRegion",
    "Capsule",
    "ContactProbability",
    "Cylinder",
    "Element",
    "ErrorCode",
    "LoadedScene",
    "Plane",
    "Prediction",
    "Propagator",
    "RegionProbability",
    "RestProbability",
    "RigidBody",
    "Scene",
    "SolidMesh",
    "Sphere",
    "SpherePacking",
    "Status",
    "UncPhysicsError",
    "assess",
    "auto_stiffness",
    "contact_probabilities",
    "list_models",
    "load_model",
    "load_packing",
    "load_scene",
    "load_solid",
    "make_propagator",
    "pack_solid",
    "physics_of",
    "predict",
    "region_probabilities",
    "rest_probabilities",
    "save_packing",
    "start_belief",
    "with_stiffness",
]

_HOMES = {
    "PRESETS": "scene.presets",
    "PROPAGATORS": "propagators.registry",
    "Belief": "scene.belief",
    "BodyStatus": "prediction.status",
    "Box": "scene.environment",
    "BoxRegion": "prediction.probabilities",
    "Capsule": "scene.environment",
    "ContactProbability": "prediction.probabilities",
    "Cylinder": "scene.environment",
    "Element": "scene.environment",
    "ErrorCode": "checks.errors",
    "LoadedScene": "scene.scene_file",
    "Plane": "scene.environment",
    "Prediction": "prediction.predict",
    "Propagator": "propagators.base",
    "RegionProbability": "prediction.probabilities",
    "RestProbability": "prediction.probabilities",
    "RigidBody": "scene.body",
    "Scene": "scene.scene",
    "SolidMesh": "geometry.solid_mesh",
    "Sphere": "scene.environment",
    "SpherePacking": "geometry.packing_file",
    "Status": "prediction.status",
    "UncPhysicsError": "checks.errors",
    "assess": "prediction.status",
    "auto_stiffness": "scene.stiffness",
    "contact_probabilities": "prediction.probabilities",
    "list_models": "geometry.library",
    "load_model": "geometry.library",
    "load_packing": "geometry.packing_file",
    "load_scene": "scene.scene_file",
    "load_solid": "geometry.solid_mesh",
    "make_propagator": "propagators.registry",
    "pack_solid": "geometry.packing",
    "physics_of": "scene.physics_summary",
    "predict": "prediction.predict",
    "region_probabilities": "prediction.probabilities",
    "rest_probabilities": "prediction.probabilities",
    "save_packing": "geometry.packing_file",
    "start_belief": "prediction.predict",
    "with_stiffness": "scene.stiffness",
}


def __dir__() -> list[str]:
    """All public names, also those that are yet to be imported."""
    return sorted({*globals(), *__all__})


if not TYPE_CHECKING:  # with it, type checkers would let any name pass

    def __getattr__(name):
        """Import a public name at its first use: numba takes a second, and `--help` need not wait for it."""
        if name not in _HOMES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        from importlib import import_module

        value = getattr(import_module(f".{_HOMES[name]}", __name__), name)
        globals()[name] = value
        return value
