"""Rollouts of scenes with uncertain parameters: each sample or sigma point has its own `World`."""

from __future__ import annotations

import weakref

import numpy as np

from ..collision.hull import hull_columns
from ..compiler.threads import in_threads
from ..compiler.time_limit import limit_here, limited
from ..dynamics import contact_history as histories
from ..dynamics.contact_history import ContactHistory
from ..dynamics.implicit_rollout import Stops
from ..dynamics.rollout import advance, new_records, read_records, record
from ..dynamics.world import World
from ..spatial.layout import ANGULAR_VELOCITY, POSITION, QUATERNION, VELOCITY
from ..spatial.rotation import exp, rotate_vectors, rotation_matrix
from .body import shape_of
from .kinematic_states import vary_actions
from .materials import Materials, varied
from .scene import Scene

_KEPT, _KEPT_WITH_PACKINGS = 32_768, 1024  # worlds; a centre of mass that is uncertain gives each a packing
_FIRST_PART = 2  # samples; each is a separate call and may take many steps
_worlds_of = weakref.WeakKeyDictionary()  # of each computation: by scenes, the last parameters and worlds
_changes_of = weakref.WeakKeyDictionary()  # of each scene: `_material_changes`
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
    stiffness, tilt, element_tilts = world.stiffness, np.zeros(2), {}
    for parameter, value in zip(scene.uncertain, z, strict=True):
        if parameter.name == "stiffness":
            stiffness = float(stiffness * np.exp(value * parameter.std / stiffness))
        elif parameter.name == "gravity_direction":
            tilt[parameter.axis] = value * parameter.std
        elif parameter.name == "surface_tilt":
            element = parameter.body - len(scene.bodies)
            element_tilts.setdefault(element, np.zeros(3))[parameter.axis] = value * parameter.std
    tree, radius = world.tree, world.bodies.radius
    offsets = center_offsets(scene, z[None])[0]
    if len(offsets):
        tree, radius = _shifted_trees(scene, offsets)
    return world._replace(
        bodies=_varied_bodies(scene, z, radius),
        tree=tree,
        gravity=_tilted(world.gravity, tilt) if tilt.any() else world.gravity,
        stiffness=stiffness,
        environment=_varied_environment(scene, z, element_tilts),
        implicit=_varied_implicit(scene, z, tree, offsets),
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


def _varied_implicit(scene, z, tree, offsets):
    """Return the constants of the implicit step with varied materials and shifted hulls."""
    implicit = scene.world.implicit
    if implicit is None:
        return None
    friction, restitution = vary_materials(scene, z)
    implicit = implicit._replace(friction=friction, restitution=restitution)
    if len(offsets):
        shift = np.concatenate([offsets, np.zeros_like(offsets)], axis=1)
        hull = hull_columns(tree.centers, tree.radii, implicit.hull_sphere)
        implicit = implicit._replace(hull=hull, extent=implicit.extent - shift, box=implicit.box - shift)
    return implicit


def _varied_environment(scene, z, element_tilts):
    """Return the environment with tilted elements and varied actions."""
    environment = scene.world.environment
    if environment is None:
        return None
    if element_tilts:
        R = environment.R.copy()
        for e, turn in element_tilts.items():
            R[e] = R[e] @ rotation_matrix(np.array(exp(*turn)))
        environment = environment._replace(R=R)
    if scene.acts:
        environment = environment._replace(actions=vary_actions(scene, environment.actions, z))
    return environment


def vary_materials(scene: Scene, z: np.ndarray) -> Materials:
    """Return the scene's materials with each parameter shifted by ``z`` (K,) standard deviations.

    The scene's own parameters apply to all surfaces without their own values.
    """
    found = Materials(*(values.copy() for values in scene.materials))
    for c, name, places, value in _material_changes(scene):
        getattr(found, name)[places] = varied(name, value, scene.uncertain[c].std, z[c])
    return found


def _material_changes(scene):
    """Return index, name, surfaces and value of each of the scene's uncertain materials."""
    if scene in _changes_of:
        return _changes_of[scene]
    found = []
    for c, parameter in enumerate(scene.uncertain):
        name, k = parameter.name, parameter.body
        if name not in Materials._fields:
            continue
        if k < 0:
            surfaces = enumerate(scene.surfaces)
            owner, places = scene, [j for j, surface in surfaces if getattr(surface, name) is None]
        else:
            owner, places = scene.surfaces[k], [k]
        found.append((c, name, places, getattr(owner, name)))
    _changes_of[scene] = found
    return found


def rollout_varied(
    states: np.ndarray, contact_history: ContactHistory, scene: Scene, z: np.ndarray, begin: int, steps: int
) -> None:
    """Advance a batch as in `dynamics.rollout.rollout`, with state n in the world of ``z[n]``."""

    def one(own, world):
        advance(states[own], histories.samples(contact_history, own), world, begin, steps)

    _in_own_worlds(scene, z, one)


def recorded_varied(
    states: np.ndarray, contact_history: ContactHistory, scene: Scene, z: np.ndarray, begin: int, stops: Stops
) -> list[tuple[np.ndarray, ContactHistory]]:
    """Return states and histories at stops as in `dynamics.rollout.recorded`, likewise."""
    records = new_records(states, contact_history, stops)

    def one(own, world):
        some = histories.samples(contact_history, own)
        record(states[own], some, world, begin, stops, records, own.start)

    _in_own_worlds(scene, z, one)
    return read_records(records, contact_history)


def _in_own_worlds(scene, z, call):
    """Call a function with the slice of each rollout and with its world."""
    limit = limit_here()
    worlds = _worlds(scene, z, limit)

    def run(some):
        for n in range(some.start, some.stop):
            world = worlds.get(n)
            if world is None:
                world = limited(vary(scene, z[n]), limit)
                if len(z) <= most:
                    worlds[n] = world
            call(slice(n, n + 1), world)

    most = _KEPT_WITH_PACKINGS if center_offsets(scene, z[:1]).size else _KEPT
    in_threads(len(z), run, _FIRST_PART)


def _worlds(scene, z, computation) -> dict[int, World]:
    """Return the cache of worlds of parameters ``z`` (N, K), which lasts as long as a computation.

    A computation with a time limit calls every few steps. Building the worlds would take longer than these
    steps.
    """
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


def _tilted(gravity, tilt):
    """Return gravity rotated about two perpendicular axes by the angles ``tilt`` (2,) [rad]."""
    size = np.linalg.norm(gravity)
    down = gravity / size
    first = np.cross(np.eye(3)[np.argmin(np.abs(down))], down)
    first /= np.linalg.norm(first)
    turn = tilt[0] * first + tilt[1] * np.cross(down, first)
    angle = np.linalg.norm(turn)
    share = np.sin(angle) / angle if angle > 0.0 else 1.0
    return size * (np.cos(angle) * down + share * np.cross(turn, down))


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
