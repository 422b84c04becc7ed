"""The scenes of the paper's evaluation (its section 5), each as (scene, belief, horizon)."""

from __future__ import annotations

import math

import numpy as np

from unc_physics.checks.errors import InvalidModelError, InvalidRequestError, UnknownModelError
from unc_physics.checks.validation import non_negative
from unc_physics.scene.belief import Belief
from unc_physics.scene.body import RigidBody
from unc_physics.scene.environment import Box, Plane
from unc_physics.scene.scene import Scene
from unc_physics.shapes.library import find_model, load_model
from unc_physics.shapes.packing_file import SpherePacking
from unc_physics.spatial.layout import (
    ANGULAR_VELOCITY,
    ERR_ANGULAR_VELOCITY,
    ERR_POSITION,
    ERR_ROTATION,
    ERR_VELOCITY,
    ERROR,
    POSITION,
    QUATERNION,
    STATE,
    VELOCITY,
)

#: The models that the paper drops on each other; all ship with the package.
MODELS = ("bunny", "armadillo", "pin")
LARGE = 100_000  # spheres, of packings that do not ship

EXTENT = 1.0  # longest side of a model's bounding box [m]
MASS = 1.0  # kg
STIFFNESS = 2e4  # N/m^3
DT = 0.01  # s
DAMPING = -math.log(0.99) / DT  # 1/s: velocities keep 99 % in each step
SPEED = 1.0  # m/s
GAP = 1.5  # between the centres of mass, along the motion [m]
OFFSET = 0.15  # between the centres of mass, across the motion [m]
COLLISION_HORIZON = 5.0  # s
FREE_HORIZON = 4.0  # s

# general: along no symmetry of a model; unit quaternions (x, y, z, w) after normalisation
_ORIENTATIONS = {"left": (0.36, -0.24, 0.54, 0.72), "right": (-0.52, 0.61, 0.20, 0.56)}
_SPIN = (0.3, -0.5, 0.4)  # rad/s
_UNCERTAIN = {"linear_velocity": "velocity", "angular_velocity": "spin"}

_LEANING = math.cos(math.radians(15.0))  # the least vertical part of an upright body's axis
_WALL = 0.02  # thickness of a bin [m]
_BIN, _LARGE_BIN = (0.292, 0.192, 0.143), (0.4, 0.4, 0.25)  # inside: length, width, depth [m]
_PITCH = 0.19  # between bodies that are let go from a lattice [m]
_TUMBLED = {"position": 0.01, "rotation": 0.3}  # what is let go in no particular order


def resting(positions) -> np.ndarray:
    """Return states (B, 13) of unrotated bodies at rest."""
    mean = np.zeros((len(positions), STATE))
    mean[:, POSITION] = positions
    mean[:, QUATERNION] = 0.0, 0.0, 0.0, 1.0
    return mean


def spread(bodies: int, position=0.0, velocity=0.0, rotation=0.0, spin=0.0) -> np.ndarray:
    """Return covariances (B, 12, 12) from standard deviations, one or three numbers each."""
    std = np.zeros(ERROR)
    std[ERR_POSITION], std[ERR_VELOCITY] = position, velocity
    std[ERR_ROTATION], std[ERR_ANGULAR_VELOCITY] = rotation, spin
    return np.tile(np.diag(std**2), (bodies, 1, 1))


def unit_model(name: str, spheres: int) -> SpherePacking:
    """Return a model's first ``spheres`` spheres, scaled to a longest side of the bounding box of 1 m.

    A packing larger than the shipped one has the name ``NAME_SPHERES``, as made by
    ``unc_physics models --make NAME -n SPHERES``.

    Raises
    ------
    UnknownModelError
        If there is no such model, or no packing of it with that number of spheres.
    """
    packing = load_model(name)
    if spheres > len(packing):
        packing = load_model(find_model(f"{name}_{spheres}"))
    if packing.bounds is None:
        raise InvalidModelError("are needed to scale it", field=f"bounds of model '{name}'")
    return packing.scaled(EXTENT / float(np.max(packing.bounds[1] - packing.bounds[0]))).prefix(spheres)


def has_packing(model: str, spheres: int) -> bool:
    """Return whether there is a packing of a model with a number of spheres."""
    try:
        unit_model(model, spheres)
    except UnknownModelError:
        return False
    return True


def missing_packings() -> list[str]:
    """Return the models without a packing of `LARGE` spheres, and how to make one."""
    return [
        f"{model} with {LARGE} spheres: no packing; python -m unc_physics models --make {model} -n {LARGE}"
        " makes it"
        for model in MODELS
        if not has_packing(model, LARGE)
    ]


def collision(
    model: str, spheres: int = 1000, sigma: float = 0.05, encounter: int = 0
) -> tuple[Scene, Belief, float]:
    """Return two bodies of one model with an off-centre collision (the paper's section 5.2).

    The bodies fly towards each other along x, offset along y; no gravity, damped velocities.

    Parameters
    ----------
    model : str
        Name in the model library.
    spheres : int
        Number of each body's spheres.
    sigma : float
        Standard deviation of the initial positions, the same along all axes [m].
    encounter : int
        Number of the random orientations of the bodies; 0 has fixed orientations.
    """
    packing = unit_model(model, spheres)
    turned = {name: _orientation(name) for name in _ORIENTATIONS}
    if encounter:
        rng = np.random.default_rng(encounter)
        turned = {
            name: q / np.linalg.norm(q) for name, q in zip(turned, rng.standard_normal((2, 4)), strict=True)
        }
    scene = _scene([RigidBody(name, packing, MASS) for name in ("left", "right")])
    mean = np.zeros((2, STATE))
    for body, (name, side) in enumerate((("left", 1.0), ("right", -1.0))):
        mean[body, POSITION] = -side * GAP / 2, side * OFFSET / 2, 0.0
        mean[body, VELOCITY] = side * SPEED, 0.0, 0.0
        mean[body, QUATERNION] = turned[name]
    return scene, Belief(mean, spread(2, position=non_negative(sigma, "sigma"))), COLLISION_HORIZON


def collision_free(
    uncertain: str, model: str = "pin", spheres: int = 10, sigma: float = 0.1
) -> tuple[Scene, Belief, float]:
    """Return one body that moves and spins without contact (the paper's section 5.1, Table 2).

    Parameters
    ----------
    uncertain : {'linear_velocity', 'angular_velocity'}
        Uncertain initial velocity.
    model : str
        Name in the model library.
    spheres : int
        Number of the body's spheres.
    sigma : float
        Standard deviation of that velocity, the same along all axes [m/s or rad/s].
    """
    if uncertain not in _UNCERTAIN:
        raise InvalidRequestError(
            f"must be one of {', '.join(_UNCERTAIN)}", field="uncertain", value=uncertain
        )
    scene = _scene([RigidBody("left", unit_model(model, spheres), MASS)])
    mean = np.zeros((1, STATE))
    mean[0, VELOCITY] = SPEED, 0.0, 0.0
    mean[0, QUATERNION] = _orientation("left")
    mean[0, ANGULAR_VELOCITY] = _SPIN
    deviations = {_UNCERTAIN[uncertain]: non_negative(sigma, "sigma")}
    return scene, Belief(mean, spread(1, **deviations)), FREE_HORIZON


def salt_box_into_bin() -> tuple[Scene, Belief, float]:
    """Return a carton of salt that falls towards an open bin (the paper's Fig. 1)."""
    mean = resting([[0.07, 0.02, 0.35]])
    mean[0, QUATERNION] = 0.0, 0.0, math.sin(0.3), math.cos(0.3)
    return _handled(["salt_box"], 2000, open_bin(*_BIN), mean, {"position": 0.04, "rotation": 0.2})


def can_off_shelf() -> tuple[Scene, Belief, float]:
    """Return a full can that slides towards the edge of a shelf at 0.4 m."""
    return _off_shelf("can", 0.055, (0.0, 0.0, 0.0, 1.0), 0.7)


def carton_off_shelf() -> tuple[Scene, Belief, float]:
    """Return a carton that slides, on its broad side, past the edge of a shelf at 0.4 m."""
    return _off_shelf("salt_box", 0.023, (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)), 1.0)


def _off_shelf(model, height, orientation, speed):
    top = 0.4  # m
    environment = (Plane((0.0, 0.0, 1.0), 0.0), Box((0.6, 0.6, 0.03), (-0.3, 0.0, top - 0.015)))
    mean = resting([[-0.06, 0.0, top + height]])
    mean[0, VELOCITY], mean[0, QUATERNION] = (speed, 0.0, 0.0), orientation
    deviations = {"position": (0.02, 0.02, 0.0), "velocity": (0.2, 0.05, 0.0)}
    return _handled([model], 2000, environment, mean, deviations)


def five_into_bin() -> tuple[Scene, Belief, float]:
    """Return three cartons and two cans that fall into a bin without room for all side by side."""
    mean = resting(
        [[0.05, 0.02, 0.15], [-0.05, -0.02, 0.3], [0.03, -0.03, 0.45], [0.0, 0.03, 0.6], [-0.06, 0.0, 0.75]]
    )
    mean[:, ANGULAR_VELOCITY] = 0.5, 1.0, 0.0
    models = ["salt_box", "can", "salt_box", "can", "salt_box"]
    return _handled(models, 1000, open_bin(*_BIN), mean, _TUMBLED)


def tableware_into_box() -> tuple[Scene, Belief, float]:
    """Return six objects that fall into a box one after another; four are neither box nor cylinder."""
    mean = resting(
        [
            [0.05, 0.02, 0.22],
            [-0.05, -0.02, 0.38],
            [0.03, -0.03, 0.53],
            [0.0, 0.03, 0.67],
            [-0.06, 0.0, 0.82],
            [0.06, 0.02, 1.02],
        ]
    )
    mean[:, ANGULAR_VELOCITY] = 0.5, 1.0, 0.0
    models = ["plate", "bowl", "mug", "salt_box", "can", "bottle"]
    return _handled(models, 1000, open_bin(*_LARGE_BIN), mean, _TUMBLED)


def boxes_and_cans(count: int, spheres: int = 1000) -> tuple[Scene, Belief, float]:
    """Return a lattice of cartons and cans, up to four layers, that falls into a bin of the same width.

    Parameters
    ----------
    count : int
        Number of bodies.
    spheres : int
        Of each.
    """
    side = math.ceil(math.sqrt(count / 4.0))
    inside = (side * _PITCH, side * _PITCH, 0.5 * side * _PITCH)
    place = np.arange(count)
    across = np.stack([place % side, place // side % side], axis=1) - 0.5 * (side - 1)
    mean = resting(_PITCH * np.column_stack([across, place // side**2 + 0.7]))
    mean[:, ANGULAR_VELOCITY] = 0.5, 1.0, 0.0
    models = [("salt_box", "can")[k % 2] for k in range(count)]
    return _handled(models, spheres, open_bin(*inside), mean, _TUMBLED)


def in_bin(states: np.ndarray) -> np.ndarray:
    """Return whether states (..., 13) of a body have the centre inside the bin of `salt_box_into_bin`."""
    return _between(states, _BIN)


def in_box(states: np.ndarray) -> np.ndarray:
    """Return whether states (..., 13) of a body have the centre inside the box of `tableware_into_box`."""
    return _between(states, _LARGE_BIN)


def on_shelf(states: np.ndarray) -> np.ndarray:
    """Return whether states (..., 13) of a body have the centre above the shelf of `can_off_shelf`."""
    return states[..., POSITION][..., 2] > 0.4


def is_upright(states: np.ndarray) -> np.ndarray:
    """Return whether states (..., 13) have the z axis within 15 degrees of the vertical, up or down."""
    x, y = np.moveaxis(states[..., QUATERNION], -1, 0)[:2]
    return np.abs(1.0 - 2.0 * (x * x + y * y)) > _LEANING


#: Everyday scenes with gravity and friction, each with what it means to end up in place.
MANIPULATION = {"salt_box_into_bin": (salt_box_into_bin, in_bin), "can_off_shelf": (can_off_shelf, on_shelf)}
#: The same with several bodies.
PILES = {"five_into_bin": (five_into_bin, in_bin), "tableware_into_box": (tableware_into_box, in_box)}


def open_bin(length: float, width: float, depth: float) -> tuple[Plane | Box, ...]:
    """Return a bin of boxes on a floor, with its inside from the wall's thickness above the floor [m]."""
    x, y, height = 0.5 * (length + _WALL), 0.5 * (width + _WALL), depth + _WALL
    return (
        Plane((0.0, 0.0, 1.0), 0.0),
        Box((length, width, _WALL), (0.0, 0.0, 0.5 * _WALL)),
        *(Box((_WALL, width, height), (side * x, 0.0, 0.5 * height)) for side in (-1.0, 1.0)),
        *(Box((length + 2.0 * _WALL, _WALL, height), (0.0, side * y, 0.5 * height)) for side in (-1.0, 1.0)),
    )


def _between(states, sides):
    """Return whether centres are inside a bin."""
    position = states[..., POSITION]
    inside = np.abs(position[..., :2]) < 0.5 * np.array(sides[:2])
    return inside.all(axis=-1) & (position[..., 2] < sides[2] + _WALL)


def _handled(models, spheres, environment, mean, deviations):
    packings = [load_model(model) for model in models]
    bodies = [
        RigidBody(f"{packing.name}{k or ''}", packing.prefix(spheres)) for k, packing in enumerate(packings)
    ]
    scene = Scene.everyday(bodies, exact=True, environment=environment)
    return scene, Belief(mean, spread(len(bodies), **deviations)), 1.5


def _scene(bodies):
    return Scene(tuple(bodies), dt=DT, stiffness=STIFFNESS, damping=DAMPING)


def _orientation(name):
    q = np.array(_ORIENTATIONS[name])
    return q / np.linalg.norm(q)
