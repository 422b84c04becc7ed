"""Explicit rollouts of scenes with uncertain parameters: each sample or sigma point has its own `World`."""

from __future__ import annotations

import weakref

import numpy as np

from ..compiler.threads import in_threads
from ..compiler.time_limit import limit_here
from ..physics import contact_history as histories
from ..physics.contact_history import ContactHistory
from ..physics.paper.rollout import new_records, read_records, record
from ..physics.paper.world import World
from ..spatial.layout import ANGULAR_VELOCITY, POSITION, QUATERNION, VELOCITY
from ..spatial.rotation import rotate_vectors
from .body import shape_of
from .kinematic_states import vary_actions
from .scene import Scene

_KEPT, _KEPT_WITH_PACKINGS = 32_768, 1024  # worlds; a centre of mass that is uncertain gives each a packing
_FIRST_PART = 2  # samples; each is a separate call and may take many steps
_worlds_of = weakref.WeakKeyDictionary()  # of each computation: by scenes, the last parameters and worlds
_SINGLE = 4.0 * np.finfo(np.float32).eps  # bounds the rounding of a shift, relative to the body's size


def draw_parameters(scene: Scene, count: int, seed: int) -> np.ndarray:
    """Draw standard normal numbers (count, K) for the scene's K uncertain parameters.

    They are independent of the states' draws. The first k rows are the same for every larger count.
    """
    if not scene.uncertain:
        return np.zeros((count, 0))
    stream = np.random.SeedSequence(seed).spawn(1)[0]
    return np.random.default_rng(stream).standard_normal((count, len(scene.uncertain)))


def vary(scene: Scene, z: np.ndarray) -> World:
    """Return the scene's `World` with each parameter shifted by ``z`` (K,) standard deviations.

    Mass and inertia share a factor. A shift of the centre of mass moves the spheres the opposite way in the
    body frame.
    """
    world = scene.world
    stiffness, tilt = world.stiffness, np.zeros(2)
    for parameter, value in zip(scene.uncertain, z, strict=True):
        if parameter.name == "stiffness":
            stiffness = float(stiffness * np.exp(value * parameter.std / stiffness))
        elif parameter.name == "gravity_direction":
            tilt[parameter.axis] = value * parameter.std
    tree, radius, environment = world.tree, world.bodies.radius, world.environment
    offsets = center_offsets(scene, z[None])[0]
    if len(offsets):
        tree, radius = _shifted_trees(scene, offsets)
    if environment is not None and scene.acts:
        environment = environment._replace(actions=vary_actions(scene, environment.actions, z))
    return world._replace(
        bodies=_varied_bodies(scene, z, radius),
        tree=tree,
        gravity=tilted_gravity(world.gravity, tilt[None])[0],
        stiffness=stiffness,
        environment=environment,
    )


def _varied_bodies(scene, z, radius):
    """Return the world's bodies with varied masses, and with their ``radius`` (B,)."""
    own = scene.world.bodies
    factors = [
        (parameter.body, np.exp(value * parameter.std / scene.bodies[parameter.body].mass))
        for parameter, value in zip(scene.uncertain, z, strict=True)
        if parameter.name == "mass"
    ]
    if factors:
        mass, inertia = own.mass.copy(), own.inertia.copy()
        inverse_mass, inverse_inertia = own.inverse_mass.copy(), own.inverse_inertia.copy()
        for k, factor in factors:
            inverse_mass[k] /= factor
            inverse_inertia[k] /= factor
            mass[k] *= factor
            inertia[k] *= factor
        own = own._replace(
            mass=mass, inertia=inertia, inverse_mass=inverse_mass, inverse_inertia=inverse_inertia
        )
    return own if radius is own.radius else own._replace(radius=radius)


def recorded_varied(
    states: np.ndarray,
    contact_history: ContactHistory,
    scene: Scene,
    z: np.ndarray,
    begin: int,
    steps: np.ndarray,
) -> list[tuple[np.ndarray, ContactHistory]]:
    """Return states and histories after numbers of ``steps`` as `physics.paper.rollout.recorded` does.

    State n is simulated in the world of ``z[n]``.
    """
    records, worlds = new_records(states, contact_history, steps), _worlds(scene, z)
    most = _KEPT_WITH_PACKINGS if center_offsets(scene, z[:1]).size else _KEPT

    def run(some):
        for n in range(some.start, some.stop):
            world, own = worlds.get(n), slice(n, n + 1)
            if world is None:
                world = vary(scene, z[n])
                if len(z) <= most:
                    worlds[n] = world
            record(states[own], histories.samples(contact_history, own), world, begin, steps, records, n)

    in_threads(len(z), run, _FIRST_PART)
    return read_records(records, contact_history, len(steps))


def _worlds(scene, z) -> dict[int, World]:
    """Return the cache of worlds of parameters ``z`` (N, K), which lasts as long as a computation.

    A computation with a time limit calls every few steps. Building the worlds would take longer than these
    steps.
    """
    computation = limit_here()
    if computation is None:
        return {}
    kept = _worlds_of.setdefault(computation, weakref.WeakKeyDictionary())
    last = kept.get(scene)
    if last is None or not np.array_equal(last[0], z):
        last = kept[scene] = z.copy(), {}
    return last[1]


def center_offsets(scene: Scene, z: np.ndarray) -> np.ndarray:
    """Return the centres of mass in the models' frames [m], (N, B, 3); (N, 0, 3) if all are certain."""
    shifts = [
        (c, parameter) for c, parameter in enumerate(scene.uncertain) if parameter.name == "center_of_mass"
    ]
    offsets = np.zeros((len(z), len(scene.bodies) if shifts else 0, 3))
    for c, parameter in shifts:
        offsets[:, parameter.body, parameter.axis] = parameter.std * z[:, c]
    return offsets


def moved_along(states: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """Return states (N, B, 13) of the bodies' points at ``offsets`` (N, B, 3), body axes [m]."""
    if offsets.shape[1] == 0:
        return states
    moved = states.copy()
    arm = rotate_vectors(states[..., QUATERNION], offsets)
    moved[..., POSITION] += arm
    moved[..., VELOCITY] += np.cross(states[..., ANGULAR_VELOCITY], arm)
    return moved


def tilted_gravity(gravity: np.ndarray, tilt: np.ndarray) -> np.ndarray:
    """Return gravity (N, 3) turned about two perpendicular axes across it by ``tilt`` (N, 2) [rad]."""
    size = np.linalg.norm(gravity)
    if size == 0.0 or not tilt.any():
        return np.repeat(gravity[None], len(tilt), axis=0)
    down = gravity / size
    first = np.cross(np.eye(3)[np.argmin(np.abs(down))], down)
    first /= np.linalg.norm(first)
    turn = tilt[:, :1] * first + tilt[:, 1:] * np.cross(down, first)
    angle = np.linalg.norm(turn, axis=1, keepdims=True)
    return size * (np.cos(angle) * down + np.sinc(angle / np.pi) * np.cross(turn, down))


def _shifted_trees(scene, offsets):
    """Return sphere trees for shifted centres of mass, and bounding radii about these."""
    world = scene.world
    bounds, child, centers, radii = world.tree
    bounds, centers, radius = bounds.copy(), centers.copy(), world.bodies.radius.copy()
    for k in np.flatnonzero(offsets.any(axis=1)):
        root = world.bodies.root[k]
        nodes = slice(root, root + len(shape_of(scene.bodies[k].model).tree[1]))
        spheres = ~child[nodes][child[nodes] < 0]
        centers[spheres] -= offsets[k]
        reach = np.max(np.linalg.norm(centers[spheres], axis=1) + radii[spheres])
        bounds[nodes, :3] -= offsets[k][:, None].astype(np.float32)
        bounds[nodes, 3] += np.float32(_SINGLE * max(reach, radius[k]))
        radius[k] = reach
    return world.tree._replace(bounds=bounds, centers=centers), radius
