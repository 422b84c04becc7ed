"""Random everyday scenes: edges, piles, rare hits, releases, pushes and uncertain materials."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from unc_physics import Belief, Box, PosePath, RigidBody, Scene, load_model
from unc_physics.scene.environment import Plane
from unc_physics.spatial.layout import ANGULAR_VELOCITY, POSITION, VELOCITY

from .everyday_cases import Case
from .random_scenes import MODELS, SPHERES, log_uniform, state_above
from .scenarios import spread

_TABLE = 0.4  # height of the table that things stand on, above the floor [m]
_SIDE = 0.8  # of the table, whose edge is at x = 0 [m]
_GAP = 2e-3  # between what is put above each other [m]
_FINGER = 0.2  # scale of the rounded box that pushes: 2 cm wide
_HAND = 0.3  # scale of the one that holds
_HEIGHTS = (0.01, 0.1)  # from which things are released [m]
_HORIZON = (0.3, 1.0)  # s
#: Standard deviations of position [m], rotation [rad], velocity [m/s] and spin [rad/s]: from, to.
_STDS = {"position": (1e-3, 1.5e-2), "rotation": (1e-2, 0.15), "velocity": (1e-2, 0.1), "spin": (3e-2, 0.3)}


def scene_at_random(number: int) -> Case:
    """Return the scene of a number; consecutive numbers cycle through `KINDS`."""
    names = list(KINDS)
    rng = np.random.default_rng([40, number])
    return KINDS[names[number % len(names)]](rng)


def kind_of(number: int) -> str:
    """Return the kind of the scene of a number."""
    return list(KINDS)[number % len(KINDS)]


def _edge(rng):
    """Return an object at rest with its centre of mass near the edge of a table, over which it may tip."""
    model = _model(rng)
    stds = _stds(rng)
    mean = _standing(rng, model)
    mean[0, POSITION] += -stds["position"] * rng.uniform(-1.0, 3.0), 0.0, _TABLE
    body = RigidBody("body", model, at_rest=True)
    return _case(rng, [body], mean, stds | {"velocity": 0.0, "spin": 0.0}, [_table()])


def _pile(rng):
    """Return two or three objects, each released above the previous one."""
    models = [_model(rng) for _ in range(rng.integers(2, 4))]
    states, top = [], 0.0
    for model in models:
        state = _standing(rng, model)
        state[0, POSITION] += rng.normal(0.0, 0.1 * model.bounding_radius, 3) * (1.0, 1.0, 0.0)
        state[0, POSITION] += 0.0, 0.0, top
        top = state[0, POSITION][2] + float(np.max(model.centers[:, 2] + model.radii)) + _GAP
        states.append(state)
    bodies = [RigidBody(f"body{k}", model) for k, model in enumerate(models)]
    return _case(rng, bodies, np.concatenate(states), _stds(rng), [])


def _rare_hit(rng):
    """Return an object that is thrown past a post at 1.5 to 3.5 standard deviations."""
    model = _model(rng)
    stds = _stds(rng)
    mean = state_above(rng, model, rng.uniform(0.05, 0.2), upright=False)
    mean[0, VELOCITY] = log_uniform(rng, 0.3, 1.0), 0.0, rng.uniform(0.0, 0.5)
    mean[0, ANGULAR_VELOCITY] = rng.normal(0.0, 1.0, 3)
    way = model.bounding_radius + 0.01 + rng.uniform(0.02, 0.1)
    time = way / mean[0, VELOCITY][0]
    lateral = math.hypot(stds["position"], stds["velocity"] * time)
    beside = model.bounding_radius + 0.01 + rng.uniform(0.0, 2.5) * lateral
    post = Box((0.02, 0.02, 0.6), (way, beside, 0.3), name="post")
    return _case(rng, [RigidBody("body", model)], mean, stds, [post])


def _release(rng):
    """Return an object in a moving hand that opens at an uncertain time, above a table near its edge."""
    model = _model(rng)
    mean = state_above(rng, model, log_uniform(rng, *_HEIGHTS), upright=bool(rng.integers(2)))
    mean[0, POSITION] += rng.uniform(-0.15, 0.0), 0.0, _TABLE
    hand = mean[0, POSITION] + (0.0, 0.0, model.bounding_radius + 0.06)
    way = rng.uniform(0.02, 0.2) * np.array([1.0, 0.0, 0.0])
    path = PosePath(times=[0.0, 0.4], positions=[hand, hand + way])
    held = RigidBody(
        "body", model, attached_to="hand", released_at=rng.uniform(0.1, 0.3), released_at_std=0.03
    )
    holder = RigidBody("hand", load_model("rounded_box").scaled(_HAND), trajectory=path)
    states = np.concatenate([mean, mean])
    return _case(rng, [held, holder], states, _stds(rng) | {"velocity": 0.0, "spin": 0.0}, [_table()])


def _push(rng):
    """Return an object on a table that a finger pushes by some centimetres, beside its middle."""
    model = _model(rng)
    mean = _standing(rng, model)
    mean[0, POSITION] += -0.2, 0.0, _TABLE
    way = model.bounding_radius + 0.02
    height = _TABLE + min(0.03, 0.8 * model.bounding_radius)
    start = np.array([-0.2 - way, rng.uniform(-0.4, 0.4) * model.bounding_radius, height])
    end = start + (0.02 + rng.uniform(0.02, 0.08), 0.0, 0.0)
    path = PosePath(times=[0.0, log_uniform(rng, 0.3, 1.0)], positions=[start, end])
    finger = RigidBody(
        "finger",
        load_model("rounded_box").scaled(_FINGER),
        trajectory=path,
        trajectory_std=(0.0, log_uniform(rng, 5e-4, 5e-3), 0.0, 0.0, 0.0, 0.0),
    )
    body = RigidBody("body", model, at_rest=True)
    stds = _stds(rng) | {"velocity": 0.0, "spin": 0.0}
    return _case(rng, [body, finger], np.concatenate([mean, mean]), stds, [_table()])


def _uncertain_materials(rng):
    """Return an object that slides or falls on a table, with uncertain friction, restitution and mass."""
    model = _model(rng)
    body = RigidBody("body", model, restitution=0.3, restitution_std=0.1, mass_std=0.1 * (model.mass or 1.0))
    upright = bool(rng.integers(2))
    mean = state_above(rng, model, 1e-4 if upright else log_uniform(rng, *_HEIGHTS), upright)
    mean[0, POSITION] += rng.uniform(-0.4, -0.1), 0.0, _TABLE
    mean[0, VELOCITY] = log_uniform(rng, 0.2, 1.0), 0.0, 0.0
    friction = rng.uniform(0.2, 0.6)
    return _case(rng, [body], mean, _stds(rng), [_table(friction=friction, friction_std=0.2 * friction)])


#: What makes a scene of each kind, in turn.
KINDS: dict[str, Callable[[np.random.Generator], Case]] = {
    "edge": _edge,
    "pile": _pile,
    "rare hit": _rare_hit,
    "release": _release,
    "push": _push,
    "uncertain materials": _uncertain_materials,
}


def _model(rng):
    return load_model(str(rng.choice(MODELS))).prefix(SPHERES)


def _standing(rng, model):
    """Return an upright state (1, 13) just above z = 0."""
    return state_above(rng, model, 1e-4, upright=True)


def _stds(rng):
    return {name: log_uniform(rng, *limits) for name, limits in _STDS.items()}


def _table(**material):
    size = (_SIDE, _SIDE, 0.02)
    return Box(size, (-0.5 * _SIDE, 0.0, _TABLE - 0.01), name="table", **material)


def _case(rng, bodies, mean, stds, environment):
    scene = Scene.everyday(bodies, exact=True, environment=[Plane(name="floor"), *environment])
    belief = Belief(mean, spread(len(scene.moving), **stds), moving=scene.moving)
    return Case(scene, belief, log_uniform(rng, *_HORIZON))
