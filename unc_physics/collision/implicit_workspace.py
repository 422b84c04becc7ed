"""Temporary arrays of a rollout of the implicit step, filled in each step."""

from typing import NamedTuple

import numpy as np

from ..compiler import inner, kernel
from ..compiler.arrays import (
    aligned_zeros,
    assign,
    booleans,
    empty,
    full,
    integers,
    singles,
    small_integers,
    zeros,
)
from ..spatial.layout import Q
from ..spatial.rotation import write_matrix
from .contact_row import ROW, TORSION_ROW
from .faces import SIDES
from .narrow_phase import RECORD
from .sphere_tree import AT_ONCE, Scratch

#: Velocities of the bodies, each (B, 8) with two zero columns.
#: START: at the interval's start. FREE: at its end without contacts. NOW: as solved.
#: BEFORE: before a sweep. ALONG: search direction.
START, FREE, NOW, BEFORE, ALONG = 0, 1, 2, 3, 4
#: Impulses. LASTING: of lasting contacts. ELASTIC: of an impact. PLASTIC: of an impact without rebound.
#: PREVIOUS: before a sweep. SEARCH: search direction. BEST: best so far.
LASTING, ELASTIC, PLASTIC, PREVIOUS, SEARCH, BEST = 0, 1, 2, 3, 4, 5
#: Columns of a body's numbers.
#: PACE: bound on its points' speed [m/s]. TRAVEL: integral of this over time [m].
#: CLEARANCE: travel up to which the environment is out of reach [m].
#: START_POSITION, START_QUATERNION: pose at the interval's beginning.
#: SURGE: bound on the change of velocity in a step without contacts, beyond gravity [m/s].
#: FREE_POSITION, FREE_QUATERNION: pose at the interval's end without contacts.
PACE, TRAVEL, CLEARANCE, START_POSITION, START_QUATERNION, SURGE = 0, 1, 2, 3, 6, 10
FREE_POSITION, FREE_QUATERNION = 11, 14
#: Columns of a candidate: unit normal towards the body, point on its surface (body frame), gap [m], score
#: [m].
CANDIDATE_NORMAL, CANDIDATE_POINT, CANDIDATE_GAP, CANDIDATE_SCORE = 0, 3, 6, 7

#: Limit of remembered contacts per body, counted at the body that they name first. A limit per body keeps
#: each body's memory independent of other bodies.
REMEMBERED_CONTACTS = 48

_PAIRS_AT_ONCE = 1024

#: Integers of a step: number of contacts, number of remembered contacts, used entries of the pool, and
#: overflow.
CONTACTS, REMEMBERED, POOL_USED, OVERFLOW = 0, 1, 2, 3
#: Kinds of overflow: contacts, candidates, lists.
NO_OVERFLOW, TOO_MANY_CONTACTS, TOO_MANY_CANDIDATES, TOO_LONG_LISTS = 0, 1, 2, 3


class ImplicitWorkspace(NamedTuple):
    """Temporary arrays of one rollout.

    Attributes
    ----------
    R : (B, 3, 3) float64
        ``R_world_body``.
    inverse_inertia : (B, 3, 3) float64
        World axes [1/(kg m^2)].
    velocity : (5, B, 8) float64
        Indexed by `START` to `ALONG`: linear [m/s] and angular [rad/s].
    numbers : (B, 18) float64
        Columns `PACE` to `FREE_QUATERNION`.
    moving : (B,) bool
        Whether each body moves freely in this step.
    inverse_mass : (B,) float64
        1/kg; 0 for bodies that do not.
    hold : (B, 7) float64
        Position and quaternion of attached bodies in the frames of their carriers.
    carried : (3, 13) float64
        Temporary states.
    loaded : (B,) int64
        Number of loaded contacts of each body.
    holds : (B,) bool
        Whether at least one of these does not slip.
    group : (B,) int64
        Lowest body of each body's group.
    members : (B,) int64
        Bodies of the current group, ascending.
    order : (B,) int64
        Bodies sorted along x.
    near : (B, B) bool
        Pairs of bodies that may touch in this step.
    neighbor : (B, B) int32
        Near bodies of each body i, ascending, at the beginning of row i.
    neighbor_count : (B,) int64
        Number of near bodies.
    next_member : (B,) int64
        The next higher body of each moving body's group; -1 after the highest.
    rows : (C, ROW) float64
        Rows of the current contacts (`contact_row`). C is even, as two are copied at once.
    torsion_rows : (C, TORSION_ROW) float64
        Rows of torsional friction, if any.
    ids : (C, 4) int64
        Bodies and spheres of the current contacts, as in `SolverMemory`.
    impulses : (6, C, 4) float64
        Normal and tangential impulses [N s], and moments about the normal [N m s], indexed by `LASTING` to
        `BEST`.
    settled : (B,) bool
        Bodies with contacts that closed from the beginning of an interval without an impact.
    part : (B,) int64
        Labels of connected bodies in an impact; positive for bodies that take part.
    throw_pace : (B,) float64
        Largest `PACE` of two near bodies in each group, indexed by its lowest body [m/s].
    candidates : (D, 8) float64
    candidate_ids : (D, 4) int64
        Spheres, state of the candidate, and its index in the last step's memory, or -1.
    best, best_score : (9,) int64 and float64
        Supports of a patch, and its deepest candidate.
    pool : (P, 2) int32
        Lists of spheres, or pairs of spheres, that may touch; one for each pair of bodies, or body and
        element.
    pool_spheres : (8, P) float64
        Centre, body frame, and radius of each sphere in the pool [m]; for pairs, the second sphere's follow.
    low : (P,) float64
        Least of current and predicted gaps of the spheres of a list [m].
    lists : (B, B + E, 2) int64
        Start and length of each list in the pool.
    list_pose : (B, B + E, 13) float64
        Relative pose for which each list was built: rotation and position of the second body in the first's
        frame, or of the body in the element's. Then the motion until it is rebuilt [m].
    search : Scratch
    R_ij : (3, 3) float64
    outlines : (2, SIDES, 5) float64
    outline_spheres : (2, SIDES) int64
    outline_corners : (2,) int64
        Outlines of a body's face and of its partner's: corners, their spheres and number (`face_outlines`).
    old_contact, new_contact : (K, 4) int32
    old_force, new_force : (K, 4) float32
        Memory of the last step and of this one (`SolverMemory`).
    head, link : (B,) and (K,) int64
        Linked lists of the last step's contacts of each body.
    counts : (4,) int64
        Indexed by `CONTACTS`, `REMEMBERED`, `POOL_USED`, `OVERFLOW`.
    state, rest_steps : (B, 13) float64 and (B,) int64
        Values at the step's start.
    kept_overlap : (B, B + E) float64
        As in `SolverMemory`, but never empty.
    """

    R: np.ndarray
    inverse_inertia: np.ndarray
    velocity: np.ndarray
    numbers: np.ndarray
    moving: np.ndarray
    inverse_mass: np.ndarray
    hold: np.ndarray
    carried: np.ndarray
    loaded: np.ndarray
    holds: np.ndarray
    group: np.ndarray
    members: np.ndarray
    order: np.ndarray
    near: np.ndarray
    neighbor: np.ndarray
    neighbor_count: np.ndarray
    next_member: np.ndarray
    rows: np.ndarray
    torsion_rows: np.ndarray
    ids: np.ndarray
    impulses: np.ndarray
    settled: np.ndarray
    part: np.ndarray
    throw_pace: np.ndarray
    candidates: np.ndarray
    candidate_ids: np.ndarray
    best: np.ndarray
    best_score: np.ndarray
    pool: np.ndarray
    pool_spheres: np.ndarray
    low: np.ndarray
    lists: np.ndarray
    list_pose: np.ndarray
    search: Scratch
    R_ij: np.ndarray
    outlines: np.ndarray
    outline_spheres: np.ndarray
    outline_corners: np.ndarray
    old_contact: np.ndarray
    old_force: np.ndarray
    new_contact: np.ndarray
    new_force: np.ndarray
    head: np.ndarray
    link: np.ndarray
    counts: np.ndarray
    state: np.ndarray
    rest_steps: np.ndarray
    kept_overlap: np.ndarray


@inner
def more_room(counts, room):
    """Return the room (contacts, candidates, pairs in lists), doubled for the kind that overflowed."""
    contacts, candidates, pool = room
    if counts[OVERFLOW] == TOO_MANY_CANDIDATES:
        return contacts, 2 * candidates, pool
    if counts[OVERFLOW] == TOO_LONG_LISTS:
        return contacts, candidates, 2 * pool
    return 2 * contacts, candidates, pool


@kernel(noinline=True)
def implicit_workspace(x, kept_overlap, world, room):
    """Return a workspace for a rollout that starts at state ``x`` (B, 13).

    ``room`` is the number of contacts, candidates and pairs in lists; ``kept_overlap`` is the rollout's row
    of `SolverMemory`.
    """
    contacts, candidates, pool = room
    count, elements = len(x), len(world.environment.kind)
    remembered = REMEMBERED_CONTACTS * count
    R = empty((count, 3, 3))
    for i in range(count):
        write_matrix((x[i, Q], x[i, Q + 1], x[i, Q + 2], x[i, Q + 3]), R, i)
    stack = small_integers((world.stack_size, 2))
    search = Scratch(
        stack,
        small_integers((_PAIRS_AT_ONCE, 2)),
        small_integers((AT_ONCE, 2)),
        integers(AT_ONCE),
        empty((1, RECORD)),
    )
    kept = zeros((count, count + elements))
    torsion_rows = contacts if world.implicit.torsional else 0
    if len(kept_overlap) > 0:
        assign(kept, kept_overlap)
    return ImplicitWorkspace(
        R,
        zeros((count, 3, 3)),
        aligned_zeros((5, count, 8)),
        zeros((count, 18)),
        world.bodies.moving.copy(),
        world.bodies.inverse_mass.copy(),
        zeros((count, 7)),
        zeros((3, 13)),
        integers(count),
        booleans(count),
        np.arange(count),
        np.arange(count),
        np.arange(count),
        booleans((count, count)),
        small_integers((count, count)),
        integers(count),
        integers(count),
        aligned_zeros((contacts, ROW)),
        empty((torsion_rows, TORSION_ROW)),
        integers((contacts, 4)),
        empty((6, contacts, 4)),
        booleans(count),
        integers(count),
        empty(count),
        empty((candidates, 8)),
        integers((candidates, 4)),
        integers(9),
        empty(9),
        small_integers((pool, 2)),
        empty((8, pool)),
        empty(pool),
        integers((count, count + elements, 2)),
        full((count, count + elements, 13), -np.inf),
        search,
        empty((3, 3)),
        empty((2, SIDES, 5)),
        integers((2, SIDES)),
        integers(2),
        small_integers((remembered, 4)),
        singles((remembered, 4)),
        small_integers((remembered, 4)),
        singles((remembered, 4)),
        integers(count),
        integers(remembered),
        integers(4),
        empty((count, 13)),
        integers(count),
        kept,
    )
