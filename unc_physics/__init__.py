"""Predicts where rigid objects will be, and how surely: rigid-body dynamics with uncertainty.

    from unc_physics import load_scene, predict
    scene, belief, horizon = load_scene("scene.yaml")
    prediction = predict(scene, belief, "sigma_points", horizon)
    prediction.belief.mean, prediction.belief.covariance
"""

__version__ = "0.1.0"

_HOMES = {
    "Belief": "belief",
    "Box": "environment",
    "Capsule": "environment",
    "Cylinder": "environment",
    "Plane": "environment",
    "Sphere": "environment",
    "RigidBody": "scene",
    "Scene": "scene",
    "SpherePacking": "geometry.packing_file",
    "load_model": "geometry.library",
    "load_scene": "scene_file",
    "Prediction": "propagation",
    "predict": "propagation",
    "make_propagator": "propagation",
    "PROPAGATORS": "propagation",
    "assess": "propagation.status",
    "contact_probabilities": "propagation.answers",
    "auto_stiffness": "stiffness",
    "ErrorCode": "errors",
    "UncPhysicsError": "errors",
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
