"""Predicts where rigid objects will be, and how surely: rigid-body dynamics with uncertainty.

    from unc_physics import load_scene, predict
    scene, belief, horizon = load_scene("scene.yaml")
    prediction = predict(scene, belief, "sigma_points", horizon)
    prediction.belief.mean, prediction.belief.covariance
"""

__version__ = "0.1.0"

_HOMES = {
    "Belief": "scene.belief",
    "Box": "scene.environment",
    "Capsule": "scene.environment",
    "Cylinder": "scene.environment",
    "Plane": "scene.environment",
    "Sphere": "scene.environment",
    "RigidBody": "scene.scene",
    "Scene": "scene.scene",
    "SpherePacking": "geometry.packing_file",
    "load_model": "geometry.library",
    "load_scene": "scene.scene_file",
    "Prediction": "prediction.predict",
    "predict": "prediction.predict",
    "make_propagator": "propagators.registry",
    "PROPAGATORS": "propagators.registry",
    "assess": "prediction.status",
    "contact_probabilities": "prediction.probabilities",
    "auto_stiffness": "scene.stiffness",
    "ErrorCode": "checks.errors",
    "UncPhysicsError": "checks.errors",
}

__all__ = list(_HOMES)


def __dir__():
    """All public names, also those that are yet to be imported."""
    return sorted({*globals(), *__all__})


def __getattr__(name):
    """Import a public name at its first use: numba takes a second, and `--help` or packing need not wait for it."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    value = getattr(import_module(f".{_HOMES[name]}", __name__), name)
    globals()[name] = value
    return value
