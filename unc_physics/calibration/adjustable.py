"""Quantities that calibration can fit, by name: parameters of a scene, and the noise of recorded poses."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..checks.errors import InvalidOptionError
from ..checks.names import one_of
from ..scene.environment import Plane
from ..scene.scene import IMPACT_STDS, Scene
from .flight import moving_body

#: Inertia of everyday objects over that of a solid one: a thin shell has 1.67.
_PARTLY_HOLLOW = 1.2
_USUAL_SPEED = 1.5  # closing speed of the impacts of recorded throws [m/s]
_FACTOR = 0.7  # standard deviation of the logarithm of what is known to a factor of two


class Model(NamedTuple):
    """Scene and pose noise with which recorded motions are predicted."""

    scene: Scene  # of one body
    #: position_noise, rotation_noise: standard deviations of the independent errors of the poses that a
    #: start is fitted to, along each axis [m], [rad]
    position_noise: float
    rotation_noise: float


@dataclass(frozen=True)
class Adjustable:
    """A number that calibration can fit, with its prior."""

    name: str
    unit: str
    about: str
    #: low, high: bounds of the search
    low: float
    high: float
    prior_std: float  # standard deviation of the prior; of the logarithm where ``relative``
    get: Callable[[Model], float]  # its value in a `Model`
    put: Callable[[Model, float], Model]  # the `Model` with another value
    relative: bool = False  # whether it is sought on a logarithmic scale
    typical: float = 0.0  # median of the prior where the scene gives none
    keeps_scene: bool = True  # whether the scene's value, if it is not 0, is the median of the prior

    def prior_median(self, model: Model) -> float:
        """Return the median of the prior under a model, where the search begins."""
        value = self.get(model) if self.keeps_scene else 0.0
        return float(np.clip(value or self.typical, self.low, self.high))

    def scaled(self, value: float) -> float:
        """Return a value in standard deviations of the prior."""
        return (math.log(value) if self.relative else value) / self.prior_std

    def unscaled(self, scaled: float) -> float:
        """Return the value, within its bounds, that `scaled` maps to this number."""
        by = scaled * self.prior_std
        return float(np.clip(math.exp(by) if self.relative else by, self.low, self.high))


def _positive(name, unit, about, low, high, typical=0.0, of_scene=True, **options):
    """Return the adjustable of a positive field of the scene, or of the `Model` itself."""

    def get(model):
        return getattr(model.scene if of_scene else model, name) or 0.0

    def put(model, value):
        changed = {name: value}
        return model._replace(**({"scene": replace(model.scene, **changed)} if of_scene else changed))

    options = {"get": get, "put": put, "relative": True, "typical": typical} | options
    return Adjustable(name, unit, about, low, high, _FACTOR, **options)


def _material(name, about, low, high, prior_std, relative=False):
    """Return the adjustable of friction or restitution; it replaces values of bodies and elements."""

    def get(model):
        values = getattr(model.scene.materials, name)
        others = values[1:] if len(values) > 1 else values
        return float(np.sqrt(values[0] * np.mean(others)))

    def put(model, value):
        own: dict = {name: None, f"{name}_std": 0.0}
        scene = model.scene
        bodies = [replace(body, **own) for body in scene.bodies]
        elements = [replace(element, **own) for element in scene.environment]
        changes: dict = {name: value}
        if name == "friction":
            changes["friction_std"] = min(scene.friction_std, value)  # a larger one is refused
        return model._replace(scene=replace(scene, bodies=bodies, environment=elements, **changes))

    return Adjustable(name, "", about, low, high, prior_std, get, put, relative)


def _with_friction_std(model, value):
    """Return the model with a spread of friction, which is at most the friction itself."""
    scene = model.scene
    return model._replace(scene=replace(scene, friction_std=min(value, scene.friction or value)))


def _inertia_factor(model):
    body = moving_body(model.scene)
    return float(np.trace(body.unit_inertia) / np.trace(body.model.inertia))


def _with_inertia(model, factor):
    body = moving_body(model.scene)
    changed = replace(body, inertia=body.unit_inertia * (factor / _inertia_factor(model)))
    return model._replace(scene=replace(model.scene, bodies=[changed]))


def _raised(reference):
    """Return ``get`` and ``put`` of the height of the environment [m], relative to a reference scene."""
    up = -reference.gravity / max(np.linalg.norm(reference.gravity), 1e-300)

    def height(scene):
        return float(scene.environment[0].position @ up) if scene.environment else 0.0

    def get(model):
        return height(model.scene) - height(reference)

    def put(model, value):
        by = (value - get(model)) * up
        elements = [
            replace(element, offset=element.offset + float(by @ element.normal))
            if isinstance(element, Plane)
            else replace(element, position=element.position + by)
            for element in model.scene.environment
        ]
        return model._replace(scene=replace(model.scene, environment=elements))

    return get, put


def _tilt(model):
    return max((element.surface_tilt_std for element in model.scene.environment), default=0.0)


def _with_tilt(model, value):
    elements = [replace(element, surface_tilt_std=value) for element in model.scene.environment]
    return model._replace(scene=replace(model.scene, environment=elements))


def adjustables(scene: Scene) -> dict[str, Adjustable]:
    """Return all adjustables of a scene by name; heights are relative to this scene."""
    point, own = 0.05 * moving_body(scene).model.bounding_radius, {"keeps_scene": False}
    each = "from motion to motion"
    known = (
        _material("friction", "coefficient of friction between body and surroundings", 0.005, 3.0, 0.5, True),
        _material("restitution", "coefficient of restitution, likewise", 0.0, 1.0, 0.15),
        _positive("impact_friction_speed", "m/s", "closing speed that halves friction", 0.2, 100.0, 3.0),
        Adjustable(
            "inertia",
            "",
            "inertia over that of the model",
            0.3,
            3.0,
            0.25,
            _inertia_factor,
            _with_inertia,
            relative=True,
            typical=_PARTLY_HOLLOW,
            keeps_scene=moving_body(scene).inertia is not None,
        ),
        Adjustable(
            "height", "m", "by how much the surroundings lie higher", -0.02, 0.02, 2e-3, *_raised(scene)
        ),
        _positive("impact_direction_std", "rad", "turn of an impact's impulse", 1e-3, 0.5, 0.03),
        _positive("impact_point_std", "m", "shift of where it acts", 1e-5, 0.05, point),
        _positive("impact_friction_std", "", "of the logarithm of its friction", 1e-3, 1.5, 0.1),
        _positive(
            "friction_std", "", f"spread of friction {each}", 1e-4, 0.5, 0.02, put=_with_friction_std, **own
        ),
        _positive("restitution_std", "", "likewise of restitution", 1e-4, 0.5, 0.03, **own),
        _positive(
            "surface_tilt_std",
            "rad",
            f"tilt of the surroundings, {each}",
            1e-4,
            0.2,
            5e-3,
            get=_tilt,
            put=_with_tilt,
        ),
        _positive("position_noise", "m", "error of a recorded position", 1e-6, 0.05, of_scene=False),
        _positive("rotation_noise", "rad", "error of a recorded rotation", 1e-5, 0.5, of_scene=False),
    )
    return {one.name: one for one in known}


#: Names of all that can be fitted.
FITTABLE = (
    "friction",
    "restitution",
    "impact_friction_speed",
    "inertia",
    "height",
    "impact_direction_std",
    "impact_point_std",
    "impact_friction_std",
    "friction_std",
    "restitution_std",
    "surface_tilt_std",
    "position_noise",
    "rotation_noise",
)


#: Laws of impacts that a scene may lack.
_IMPACT_LAWS = ("impact_friction_speed", *IMPACT_STDS)


def fitted_by_default(scene: Scene) -> list[str]:
    """Return the names of `FITTABLE` without the laws of impacts that a scene lacks, as an exact one does.

    Friction of a scene without ``impact_friction_speed`` does not depend on the closing speed. A prior about
    3 m/s would bias it.
    """
    return [name for name in FITTABLE if name not in _IMPACT_LAWS or getattr(scene, name)]


def directions(adjusted: Sequence[Adjustable], x: np.ndarray) -> np.ndarray:
    """Return the directions (K, K) along which scaled values are varied about ``x`` (K,), one a column.

    Each changes one value. With ``impact_friction_speed``, friction changes as well, so that friction at
    `_USUAL_SPEED` stays: throws determine little else of both.
    """
    found, places = np.eye(len(adjusted)), {one.name: k for k, one in enumerate(adjusted)}
    if {"friction", "impact_friction_speed"} <= set(places):
        row, column = places["friction"], places["impact_friction_speed"]
        friction, halving = adjusted[row], adjusted[column]
        share = _USUAL_SPEED / (_USUAL_SPEED + halving.unscaled(x[column]))
        found[row, column] = -share * halving.prior_std / friction.prior_std
    return found


def chosen(scene: Scene, names: Sequence[str]) -> list[Adjustable]:
    """Return the adjustables of some names, each once; raise `InvalidOptionError` for an unknown name."""
    known = adjustables(scene)
    for name in names:
        if name not in known:
            raise InvalidOptionError(one_of(name, known), field="fit", value=name)
    return [known[name] for name in dict.fromkeys(names)]


def with_values(model: Model, adjusted: Sequence[Adjustable], values: Mapping[str, float]) -> Model:
    """Return a model with the values of some adjustables, by their names."""
    for one in adjusted:
        model = one.put(model, values[one.name])
    return model
