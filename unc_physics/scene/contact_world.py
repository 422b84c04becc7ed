"""Scenes as the arrays of the step over exact shapes (`physics.everyday`)."""

from __future__ import annotations

import math
import weakref
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from ..compiler.time_limit import limit_here
from ..physics.actions import no_actions
from ..physics.contact_history import ContactHistory, InitialAdjustment
from ..physics.everyday import columns as c
from ..physics.everyday.rollouts import ContactMemory, EverydayWorld, Variation, fresh_memory, recorded
from ..physics.stops import NEVER, Stops
from ..shapes.columns import AXES, CENTER, HALF_EXTENT, KIND, LATHE, ORIGIN, RADIUS
from ..shapes.pieces import joined, piece_arrays
from ..spatial.layout import ANGULAR_VELOCITY, QUATERNION, VELOCITY
from ..spatial.rotation import exp_vectors, rotate_vectors, rotation_matrix
from .environment import thing_names
from .marks import Mark
from .parameters import tilted_gravity
from .scene import Scene

_SAME_AXIS = 1e-9  # m, and of directions: round-off between lathes of one body
#: Rows of materials by the names of `PairMaterial`.
_QUANTITIES = {
    "friction": c.FRICTION,
    "restitution": c.RESTITUTION,
    "torsional_friction": c.TORSION,
    "rolling_friction": c.ROLLING,
}
_AN_INSTANT = 1e-9  # s: a step in which nothing moves
_FARTHEST = 1e12  # m, m/s, rad/s: what moves farther has left the range of numbers
_BALL = 1e-9  # relative difference of a ball's moments of inertia
_SETTLING_STEP = 1.0 / 120.0  # s, of bodies that come to rest
_FIRST_SETTLING, _LONGEST_SETTLING = 0.15, 1.0  # s, of the first attempt, and of the last one at most
_worlds = weakref.WeakKeyDictionary()  # of scenes
_pieces = weakref.WeakKeyDictionary()  # of models: their `PieceArrays`


def everyday_world(scene: Scene) -> EverydayWorld:
    """Return the scene as the step's arrays, without uncertain parameters."""
    if scene not in _worlds:
        _worlds[scene] = _new_world(scene)
    limit = limit_here()
    return _worlds[scene]._replace(
        dt=scene.dt, start=scene.start, stop=NEVER if limit is None else limit.flag
    )


def _new_world(scene):
    tilting = _tilting(scene)
    ground = [
        piece for k, element in enumerate(scene.environment) if k not in tilting for piece in element.pieces
    ]
    for model in {body.model for body in scene.bodies if body.model not in _pieces}:
        _pieces[model] = piece_arrays([model.pieces])
    rows = [_pieces[body.model] for body in scene.bodies]
    rows += [piece_arrays([ground])]
    rows += [piece_arrays([scene.environment[k].pieces]) for k in tilting]
    pieces, points, first = joined(rows)
    bodies = np.zeros((len(rows), c.BODY))
    for k, (low, high) in enumerate(pairwise(first)):
        bodies[k, c.FIRST], bodies[k, c.LAST] = low, high
        bodies[k, [c.ROT, c.ROT + 4, c.ROT + 8, c.QUAT + 3]] = 1.0
        _fill_bounds(bodies[k], pieces[low:high])
    for row, body in zip(bodies, scene.bodies, strict=False):
        _fill_body(row, body, scene.gyroscopic)
    par = np.zeros(c.SETTINGS)
    par[c.DECAY], par[c.SLEEP] = scene.damping, scene.sleep
    par[c.DIRECTION_ERROR], par[c.POINT_ERROR] = scene.impact_direction_std, scene.impact_point_std
    par[c.MU_ERROR] = scene.impact_friction_std
    par[c.SLIPPERINESS] = 1.0 / (scene.impact_friction_speed or math.inf)
    return EverydayWorld(
        bodies,
        pieces,
        points,
        _spots(scene, tilting, pieces, first, bodies),
        par,
        scene.actions,
        len(scene.bodies),
        scene.dt,
        0.0,
        NEVER,
    )


def _tilting(scene):
    """Return the indices of the elements whose tilt is uncertain; the others are one body, the ground."""
    return [k for k, element in enumerate(scene.environment) if element.surface_tilt_std > 0.0]


def _fill_bounds(row, pieces):
    """Fill bounds and rolling axis of a body from its pieces."""
    if len(pieces) == 0:
        return
    middle, half = pieces[:, CENTER : CENTER + 3], pieces[:, HALF_EXTENT : HALF_EXTENT + 3]
    row[c.RADIUS] = (np.linalg.norm(middle, axis=1) + pieces[:, RADIUS]).max()
    low, high = (middle - half).min(axis=0), (middle + half).max(axis=0)
    bounded = np.isfinite(low).all() and np.isfinite(high).all()
    row[c.MIDDLE : c.MIDDLE + 3] = 0.5 * (low + high) if bounded else 0.0
    row[c.HALF : c.HALF + 3] = 0.5 * (high - low) if bounded else np.inf
    lathes = pieces[pieces[:, KIND] == LATHE]
    if len(lathes):
        axis, origin = _axis(lathes[0])
        row[c.AXIS : c.AXIS + 3], row[c.ROLLS] = axis, 1.0
        row[c.ARM : c.ARM + 3] = origin - (origin @ axis) * axis


def _axis(piece):
    """Return direction and a point of a lathe's axis, body axes."""
    return piece[AXES : AXES + 9].reshape(3, 3)[:, 2], piece[ORIGIN : ORIGIN + 3]


def _fill_body(row, body, gyroscopic):
    """Fill mass and inertia."""
    inertia = body.mass * body.unit_inertia
    row[c.OWN_IMASS] = row[c.IMASS] = 1.0 / body.mass if body.free else 0.0
    row[c.STEADY] = not gyroscopic or abs(inertia - inertia[0, 0] * np.eye(3)).max() < _BALL * inertia[0, 0]
    for at, matrix in ((c.INERTIA, inertia), (c.IBODY, np.linalg.inv(inertia))):
        row[at : at + 6] = matrix[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]


def _spots(scene, tilting, pieces, first, bodies):
    """Return what a step adds to each piece."""
    spots, count = np.zeros((len(pieces), c.SPOT)), len(scene.bodies)
    for k, (low, high) in enumerate(pairwise(first)):
        if k < count:
            spots[low:high, c.SURFACE_OF] = k
        elif k > count:
            spots[low:high, c.SURFACE_OF] = count + tilting[k - count - 1]
        for p in range(low, high):
            if pieces[p, KIND] == LATHE and k < count:
                axis, origin = _axis(pieces[p])
                own, arm = bodies[k, c.AXIS : c.AXIS + 3], bodies[k, c.ARM : c.ARM + 3]
                away = origin - (origin @ axis) * axis - arm
                parallel = np.linalg.norm(np.cross(own, axis)) < _SAME_AXIS
                spots[p, c.ON_AXIS] = parallel and np.linalg.norm(away) < _SAME_AXIS
    at = first[count]
    for k, element in enumerate(scene.environment):
        if k not in tilting:
            spots[at : at + len(element.pieces), c.SURFACE_OF] = count + k
            at += len(element.pieces)
    return spots


def variation(scene: Scene, z: np.ndarray) -> Variation:
    """Return the parameters of N rollouts, ``z`` (N, K) standard deviations from the scene's.

    Without uncertain parameters all rollouts share one row.
    """
    count = len(z) if scene.uncertain else 1
    own = scene.materials
    materials = np.repeat(_materials(scene)[None], count, axis=0)
    mass, tilt = np.ones((count, len(scene.bodies))), np.zeros((count, 2))
    offset = np.zeros((count, len(scene.bodies), 3))
    turns = np.zeros((count, len(scene.environment), 3))
    held = np.repeat(scene.actions.held[None], count, axis=0)
    paths = np.zeros((count, len(scene.bodies), 6))
    for k, (name, body, axis, std) in enumerate(scene.uncertain):
        shift = std * z[:, k]
        if name == "friction":
            materials[:, c.FRICTION, body] *= np.exp(shift / own.friction[body])
        elif name == "restitution":
            materials[:, c.RESTITUTION, body] = np.clip(own.restitution[body] + shift, 0.0, 1.0)
        elif name == "mass":
            mass[:, body] = np.exp(shift / scene.bodies[body].mass)
        elif name == "center_of_mass":
            offset[:, body, axis] = shift
        elif name == "gravity_direction":
            tilt[:, axis] = shift
        elif name == "surface_tilt":
            turns[:, body - len(scene.bodies), axis] = shift
        elif name == "released_at":
            held[:, body, 1] = np.maximum(held[:, body, 0], held[:, body, 1] + shift)
        else:
            paths[:, body, axis] = shift
    return Variation(
        materials,
        mass,
        offset,
        tilted_gravity(np.asarray(scene.gravity, float), tilt),
        _frames(scene, turns),
        held,
        _path_shifts(scene, paths),
    )


def _materials(scene):
    """Return the scene's materials (MATERIALS, S + P), without uncertain parts."""
    things = thing_names(scene)
    found = np.full((c.MATERIALS, len(things) + len(scene.pairs)), -1.0)
    own = found[:, : len(things)]
    own[c.FRICTION], own[c.RESTITUTION] = scene.materials
    for k, surface in enumerate(scene.surfaces):
        rolling = scene.rolling_friction if surface.rolling_friction is None else surface.rolling_friction
        own[c.ROLLING, k] = 0.0 if rolling is None else rolling
        if surface.torsional_friction is not None:
            own[c.TORSION, k] = surface.torsional_friction
    for pair, column in zip(scene.pairs, found.T[len(things) :], strict=True):
        column[[c.PAIR_A, c.PAIR_B]] = sorted(map(things.index, pair.between))
        for name, value in pair.given.items():
            column[_QUANTITIES[name]] = value
    return found


def materials_of_pairs(scene: Scene, pairs: Sequence[tuple[int, int]]) -> list[dict[str, float]]:
    """Return the quantities of the contacts of pairs of things, without errors of uncertain ones.

    Parameters
    ----------
    scene : Scene
        With the implicit integrator.
    pairs : sequence of (int, int)
        Places of two things among bodies and then elements.

    Returns
    -------
    list of dict of float
        By the names of `PairMaterial`: the pair's own value, or the geometric mean of those of both things.
    """
    table, things = _materials(scene), len(thing_names(scene))
    own = {tuple(column[[c.PAIR_A, c.PAIR_B]].astype(int).tolist()): column for column in table.T[things:]}
    found = []
    for pair in pairs:
        x, y = table[:, pair[0]], table[:, pair[1]]
        both = np.minimum(x, y) >= 0.0
        mean = np.where(both, np.sqrt(np.abs(x * y)), np.maximum(np.maximum(x, y), 0.0))
        given = own.get((min(pair), max(pair)))
        values = mean if given is None else np.where(given >= 0.0, given, mean)
        found.append({name: float(values[row]) for name, row in _QUANTITIES.items()})
    return found


def _frames(scene, turns):
    """Return the frames (N, T, 12) of elements that tilt about their positions."""
    tilting = _tilting(scene)
    frames = np.zeros((len(turns), len(tilting), 12))
    for t, k in enumerate(tilting):
        element = scene.environment[k]
        q = exp_vectors(turns[:, k] @ element.rotation.T)
        tilt = rotate_vectors(q[:, None], np.eye(3)).transpose(0, 2, 1)
        frames[:, t, :3] = element.position - tilt @ element.position
        frames[:, t, 3:] = tilt.reshape(-1, 9)
    return frames


def _path_shifts(scene, offsets):
    """Return displacement and rotation (N, B, 7) of paths that are offset at their first poses."""
    shifts = np.zeros((*offsets.shape[:2], 7))
    shifts[..., 6] = 1.0
    for k, body in enumerate(scene.bodies):
        if body.trajectory is None or not offsets[:, k].any():
            continue
        pose = scene.actions.pose[scene.actions.path[k, 0]]
        R, middle = rotation_matrix(pose[6:10]), pose[:3]
        q = exp_vectors(offsets[:, k, 3:] @ R.T)
        shifts[:, k, 3:] = q
        shifts[:, k, :3] = middle + offsets[:, k, :3] @ R.T - rotate_vectors(q, middle)
    return shifts


def fresh_history(scene: Scene, count: int) -> ContactHistory:
    """Return the contact history of new rollouts."""
    bodies = len(scene.bodies)
    first = np.full((count, bodies, len(scene.surfaces)), np.inf, np.float32)
    start = InitialAdjustment(*(np.zeros((count, bodies), np.float32) for _ in InitialAdjustment._fields))
    return ContactHistory(first, fresh_memory(count, bodies), start)


def recorded_contacts(
    states: np.ndarray,
    history: ContactHistory,
    scene: Scene,
    z: np.ndarray,
    begin: int,
    marks: Sequence[Mark],
) -> list[tuple[np.ndarray, ContactHistory]]:
    """Return states and histories of rollouts at each of several marks, ascending; the given ones stay.

    Rollouts that have left the range of numbers are not simulated; their states become NaN.
    """
    lost = ~(np.abs(states) < _FARTHEST).all(axis=(1, 2))
    if lost.any():
        states = states.copy()
        states[lost] = 0.0
        states[lost, :, QUATERNION.stop - 1] = 1.0
    found = recorded(
        states,
        history.first_time,
        history.solver,
        everyday_world(scene),
        variation(scene, z),
        begin,
        scene.stops(begin, marks),
    )
    for x, _, _ in found if lost.any() else ():
        x[lost] = np.nan
    return [(x, history._replace(first_time=first, solver=solver)) for x, first, solver in found]


def depths_of_pairs(scene: Scene, states: np.ndarray) -> np.ndarray:
    """Return how deep bodies are in each other and in elements, in states (N, B, 13): (N, B, B + E) [m].

    The depth of two bodies is that of their deepest contact in a step from rest that has no length.
    """
    still = states.copy()
    still[..., VELOCITY] = still[..., ANGULAR_VELOCITY] = 0.0
    count, bodies = states.shape[:2]
    world = everyday_world(scene)._replace(dt=_AN_INSTANT, start=0.0, actions=no_actions(bodies))
    history = fresh_history(scene, count)
    own = variation(scene, np.zeros((1, len(scene.uncertain))))
    stops = Stops(np.ones(1, np.int64), np.zeros(1))
    ((_, _, found),) = recorded(still, history.first_time, history.solver, world, own, 0, stops)
    depths = np.zeros(history.first_time.shape)
    n, a, b, rows = remembered(scene, found)
    depth = np.maximum(-rows[:, c.GAP0], 0.0)
    np.maximum.at(depths, (n, b, a), depth)
    among = a < bodies
    np.maximum.at(depths, (n[among], a[among], b[among]), depth[among])
    return depths


def bearing_pairs(scene: Scene, history: ContactHistory) -> np.ndarray:
    """Return which bodies i < j, and bodies and elements, bear on each other: (N, B, B + E) bool."""
    found = np.zeros(history.first_time.shape, bool)
    n, a, b, rows = remembered(scene, history.solver)
    impulse, normal = (rows[:, k : k + 3] for k in (c.IMPULSE, c.NORMAL))
    bears = np.einsum("ci,ci->c", impulse, normal) > 0.0
    found[n[bears], np.minimum(a, b)[bears], np.maximum(a, b)[bears]] = True
    return found


#: Columns of `contact_table`.
CONTACT = np.dtype(
    [
        ("rollout", np.int64),
        ("first", np.int64),
        ("second", np.int64),
        ("point", float, 3),
        ("normal", float, 3),
        ("gap", float),
        ("impulse", float, 3),
    ]
)


def contact_table(scene: Scene, history: ContactHistory) -> np.ndarray:
    """Return the contacts of each rollout's last step as an array with the columns `CONTACT`.

    Things are numbered as in `environment.thing_names`. The point is in the middle of the gap [m], which is
    below zero for a depth. The normal is from the first thing to the second, and the impulse of the step is
    on the second [N s]; all are in the world frame.
    """
    n, a, b, rows = remembered(scene, history.solver)
    found = np.zeros(len(n), CONTACT)
    found["rollout"], found["first"], found["second"] = n, a, b
    found["gap"] = rows[:, c.GAP0]
    for name, first in (("point", c.POINT), ("normal", c.NORMAL), ("impulse", c.IMPULSE)):
        found[name] = rows[:, first : first + 3]
    return found


def remembered(scene: Scene, memory: ContactMemory) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return rollout, surfaces a and b, and row of each contact of a `ContactMemory`.

    Surface a is a body, or B + e for element e; b is a body.
    """
    n, row = np.nonzero(np.arange(memory.contact.shape[1]) < memory.count[:, None])
    rows = memory.contact[n, row]
    surfaces = everyday_world(scene).spots[:, c.SURFACE_OF].astype(np.int64)
    a, b = (surfaces[rows[:, k].astype(np.int64)] for k in (c.PIECE_A, c.PIECE_B))
    return n, a, b, rows


def settled_contacts(
    scene: Scene, states: np.ndarray, resting: np.ndarray
) -> tuple[np.ndarray, ContactHistory]:
    """Let bodies ``resting`` (B,) come to rest from states (N, B, 13), in place; the others do not move.

    Returns which bodies sleep in each rollout (N, B), and the histories, in which supports touch at time 0.
    """
    count, bodies = states.shape[:2]
    world = everyday_world(scene)
    rows, par = world.bodies.copy(), world.par.copy()
    held = np.flatnonzero(~resting)
    rows[held, c.IMASS] = rows[held, c.OWN_IMASS] = 0.0
    par[c.DECAY], par[c.SLEEP], par[c.DIRECTION_ERROR : c.MU_ERROR + 1] = 0.0, 1.0, 0.0
    world = world._replace(bodies=rows, par=par, dt=_SETTLING_STEP, start=0.0, actions=no_actions(bodies))
    own, history = variation(scene, np.zeros((1, len(scene.uncertain)))), fresh_history(scene, count)
    asleep, waiting, time = np.zeros((count, bodies), bool), np.arange(count), _FIRST_SETTLING
    memory: Any = fresh_memory(count, bodies)
    while len(waiting) and time <= _LONGEST_SETTLING:
        stops = Stops(np.array([round(time / _SETTLING_STEP)]), np.zeros(1))
        part = type(memory)(*(values[waiting] for values in memory))
        ((x, _, part),) = recorded(states[waiting], history.first_time[waiting], part, world, own, 0, stops)
        if world.stop[0] != 0:  # these rollouts ended early, so that their states are invalid
            break
        states[waiting] = x
        memory = _with_some(memory, part, waiting)
        asleep[waiting] = part.at_rest
        waiting, time = waiting[~asleep[waiting][:, resting].all(axis=1)], 2.0 * time
    history = history._replace(solver=memory)
    history.first_time[bearing_pairs(scene, history)] = 0.0
    return asleep, history


def _with_some(memory, part, some):
    """Return a contact memory with those of some rollouts in place of its own."""
    found = []
    for own, new in zip(memory, part, strict=True):
        if new.ndim == 3 and new.shape[1] > own.shape[1]:
            own = np.pad(own, ((0, 0), (0, new.shape[1] - own.shape[1]), (0, 0)))
        own = own.copy()
        own[some] = 0
        own[(some, *(slice(0, size) for size in new.shape[1:]))] = new
        found.append(own)
    return type(memory)(*found)
