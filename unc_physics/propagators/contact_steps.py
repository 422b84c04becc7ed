"""The surrogate and local sampling on the everyday step, from its states and its contacts.

A nominal rollout is recorded step by step: the states before and after each step, and its contacts. Then each
moving body's covariance (12, 12), or a root of it, goes through the same steps:

* the drift's derivative (Eqs. 14 and 30),
* contacts with fixed things, which stop errors as they stop the body itself (`contact_holds`),
* what the method makes of the other bodies' uncertain contacts (`kick_pair`).
"""

import math
from abc import abstractmethod
from typing import Any, ClassVar, NamedTuple

import numpy as np

from ..compiler import inner, kernel, stage
from ..compiler.arrays import empty
from ..physics import contact_history as histories
from ..physics.contact_history import ContactHistory
from ..physics.everyday.columns import BODY_A, BODY_B, FACE_OF, IMPULSE, MU0, NORMAL, PIECE_A, PIECE_B
from ..physics.paper.drift_derivative import apply_gyroscopic_jacobian, apply_transition, write_exact_rotation
from ..scene.belief import Belief
from ..scene.contact_world import everyday_world, recorded_contacts
from ..scene.marks import whole
from ..scene.scene import Scene
from ..shapes.columns import AXES, KIND, LATHE, ORIGIN, ROUNDING
from ..spatial.layout import ERROR, Q, V, W
from ..spatial.moments import symmetric_root
from ..spatial.rotation import cross, rotate, rotate_back, write_matrix
from ..spatial.vectors import dot, minus, plus, three, times
from .base import Propagator
from .contact_holds import Directions, arm_at, hold, no_directions
from .start import resolve_initial_overlap

_AT_ONCE = 64  # steps whose contacts are kept at a time: some megabytes for dozens of bodies
_STILL = 1e-6  # m/s, slip that has no direction


class Inertias(NamedTuple):
    """What resists motion of B bodies, and then of the world's fixed rows, which have none of the rest.

    Attributes
    ----------
    moving : (nb,) bool
    inverse_mass : (nb,) float64
    inertia, inverse_inertia : (B, 3, 3) float64
        Body frame; the inverse is zero for fixed bodies.
    """

    moving: np.ndarray
    inverse_mass: np.ndarray
    inertia: np.ndarray
    inverse_inertia: np.ndarray


class Drifting(NamedTuple):
    """What a body's drift depends on, as `drift_derivative` reads it, and the shapes of contacts."""

    bodies: Inertias
    pieces: np.ndarray  # as in `shapes.columns`
    gravity: np.ndarray  # (3,)
    dt: float  # way by a unit of velocity in a step, which damping shortens [s]
    decay: float
    length: float  # of the step [s]


class Gyroscopic(NamedTuple):
    """Whether bodies tumble."""

    gyroscopic: bool


class Blocks(NamedTuple):
    """Covariances of moving bodies, or their roots, and room to work."""

    all: np.ndarray  # (M, 12, 12)
    turns: int  # 2 for covariances, which a linear map multiplies from both sides; 1 for roots
    of: np.ndarray  # (nb,) int64: each body's block; -1 for a fixed one
    R: np.ndarray  # (nb, 3, 3): ``R_world_body``
    inverse: np.ndarray  # (nb, 3, 3): inverse inertia in world axes
    step: np.ndarray  # (12, 12): derivative of a step of one body
    room: np.ndarray  # (12, 12)
    turn: np.ndarray  # (3, 3): a block of the drift's derivative
    small: np.ndarray  # (8, 3, 3): room for matrices
    directions: Directions  # room for those of one body


class Meeting(NamedTuple):
    """A contact at the end of a step; world axes, lengths in m.

    ``acting`` is the part of the normal impulse that changed the closing speed [N s]: what carries a load
    has none. ``face`` is 1 or 2 where the normal turns with body a or b, else 0. Then it turns with the line
    between the centres of both sides' curvature, which are ``round_a`` and ``round_b`` behind the point.
    Friction is ``rub`` times the part across the normal of ``slip``, the velocity of b relative to a, and at
    most ``most``, all by the normal impulse.
    """

    normal: tuple
    arm_a: tuple
    arm_b: tuple
    acting: float
    face: int
    round_a: float
    round_b: float
    slip: tuple
    rub: float
    most: float


@stage
def begin_step(method, step):
    """Prepare for the kicks of a step."""


@stage
def kick_pair(method, a, b, first, last, states, contact, world, blocks):
    """Let the uncertainty of one pair's contacts, rows first to last of ``contact``, act on velocities."""


class BlocksCarry(NamedTuple):
    """Persistent state of a propagator with a nominal rollout and blocks of moving bodies."""

    mean: np.ndarray  # (B, 13): the nominal rollout
    blocks: np.ndarray  # (M, 12, 12): covariances, or roots of them
    contact_history: ContactHistory  # what the rollout remembers of its contacts
    step: float  # how many are done; a fraction after a shorter one


class NominalWithBlocks(Propagator):
    """A propagator with a nominal rollout, and a covariance of each moving body or a root of it."""

    turns: ClassVar[int]  # 2 for covariances, which a linear map multiplies from both sides; 1 for roots

    @abstractmethod
    def contact_method(self) -> Any:
        """Return the data of `kick_pair`."""

    @abstractmethod
    def advance_explicit(
        self,
        mean: np.ndarray,
        blocks: np.ndarray,
        first_time: np.ndarray,
        scene: Scene,
        begin: int,
        steps: int,
    ) -> None:
        """Advance mean, blocks and times of first contacts (B, B + E) by explicit steps, in place."""

    def init(self, scene, belief):
        mean, history = resolve_initial_overlap(scene, belief, belief.mean[None].copy())
        blocks = belief.blocks.copy() if self.turns == 2 else symmetric_root(belief.blocks)
        return BlocksCarry(mean[0], blocks, history, 0)

    def advance(self, carry, scene, steps):
        if scene.integrator != "explicit":
            return self.advance_through(carry, scene, [whole(carry.step + steps, scene.dt)])[0]
        mean, blocks, history = carry.mean.copy(), carry.blocks.copy(), histories.copy(carry.contact_history)
        self.advance_explicit(mean, blocks, history.first_time[0], scene, carry.step, steps)
        return BlocksCarry(mean, blocks, history, carry.step + steps)

    def belief(self, carry, scene):
        P = carry.blocks if self.turns == 2 else carry.blocks @ carry.blocks.transpose(0, 2, 1)
        return Belief.trusted(carry.mean.copy(), 0.5 * (P + P.transpose(0, 2, 1)), scene.moving)

    def advance_through(self, carry, scene, marks):
        if scene.integrator == "explicit":
            return super().advance_through(carry, scene, marks)
        found, method = [], self.contact_method()
        at: tuple = carry[:-1]
        begun = carry.step
        for mark in marks:
            steps = [whole(step, scene.dt) for step in range(begun + 1, mark.steps + 1)]
            for first in range(0, len(steps), _AT_ONCE):
                some = steps[first : first + _AT_ONCE]
                at = _through(some, at, method, scene, begun, self.turns)
                begun += len(some)
            end = _through([mark], at, method, scene, begun, self.turns) if mark.rest > 0.0 else at
            found.append(BlocksCarry(end[0], end[1], end[2], mark.fraction_of(scene.dt)))
        return found


def _through(marks, at, method, scene, begun, turns):
    """Return mean, blocks and history at the last mark, from those ``at`` present; each mark is a step on."""
    mean, blocks, history = at
    z = np.zeros((1, len(scene.uncertain)))
    part = recorded_contacts(mean[None], history, scene, z, begun, marks)
    states = np.concatenate([mean[None], *(after for after, _ in part)])
    memories: list[Any] = [after.solver for _, after in part]
    contact = np.concatenate([memory.contact for memory in memories])
    count = np.concatenate([memory.count for memory in memories])
    length, blocks = marks[0].rest or scene.dt, blocks.copy()
    world = everyday_world(scene)
    free = np.zeros(len(world.bodies), bool)
    free[scene.moving] = True
    masses = np.array([body.mass for body in scene.bodies])
    inertia = np.array([body.mass * body.unit_inertia for body in scene.bodies])
    inverse_mass = np.zeros(len(free))
    inverse_mass[scene.moving] = 1.0 / masses[scene.moving]
    inverse = np.zeros(inertia.shape)
    inverse[scene.moving] = np.linalg.inv(inertia[scene.moving])
    flight = Drifting(
        Inertias(free, inverse_mass, inertia, inverse),
        world.pieces,
        np.array(scene.gravity, float),
        -math.expm1(-scene.damping * length) / scene.damping if scene.damping else length,
        math.exp(-scene.damping * length),
        length,
    )
    _advance_blocks(
        method, blocks, turns, states, contact, count, flight, Gyroscopic(scene.gyroscopic), begun
    )
    return states[-1], blocks, part[-1][1]


@kernel
def _advance_blocks(method, all_blocks, turns, states, contact, count, world, law, begun):
    """Take blocks (M, 12, 12) through T steps with states (T + 1, B, 13), and contacts, in place."""
    bodies, moving = states.shape[1], world.bodies.moving
    n = len(moving)
    number = np.where(moving, np.cumsum(moving) - 1, -1)
    rooms = empty((n, 3, 3)), empty((n, 3, 3)), empty((ERROR, ERROR)), empty((ERROR, ERROR)), empty((3, 3))
    blocks = Blocks(
        all_blocks,
        turns,
        number,
        rooms[0],
        rooms[1],
        rooms[2],
        rooms[3],
        rooms[4],
        empty((8, 3, 3)),
        no_directions(),
    )
    for i in range(len(moving)):
        write_matrix((0.0, 0.0, 0.0, 1.0), blocks.R, i)
        blocks.inverse[i] = 0.0
    for t in range(len(count)):
        n, rows = count[t], contact[t]
        for i in range(bodies):
            if moving[i]:
                _move(i, states[t], states[t + 1], rows, n, world, law, blocks)
        begin_step(method, begun + t)
        first = 0
        while first < n:
            a, b, last = int(rows[first, BODY_A]), int(rows[first, BODY_B]), first + 1
            while last < n and rows[last, BODY_A] == a and rows[last, BODY_B] == b:
                last += 1
            kick_pair(method, a, b, first, last, states[t : t + 2], rows, world, blocks)
            first = last


@inner
def _write_inverse(blocks, i, inverse):
    """Write a body's inverse inertia in world axes, column by column."""
    R = blocks.R[i]
    for c in range(3):
        v = rotate(inverse, R[c, 0], R[c, 1], R[c, 2])
        blocks.inverse[i, 0, c], blocks.inverse[i, 1, c], blocks.inverse[i, 2, c] = rotate(
            R, v[0], v[1], v[2]
        )


@inner(noinline=True)
def _move(i, before, after, contact, count, world, law, blocks):
    """Take a body's block through the derivative of a step without other bodies; write its rotation after."""
    F, room, q = blocks.step, blocks.room, three(before, i, Q)
    write_matrix((q[0], q[1], q[2], before[i, Q + 3]), blocks.R, i)
    for r in range(ERROR):
        for c in range(ERROR):
            F[r, c] = 1.0 if r == c else 0.0
    write_exact_rotation(blocks.R, before, i, world.dt, blocks.turn)
    if law.gyroscopic:
        apply_gyroscopic_jacobian(F, 0, before, i, blocks.R, world, blocks.turn)
    apply_transition(F, 0, world.dt, world.decay, blocks.turn)
    q = three(after, i, Q)
    write_matrix((q[0], q[1], q[2], after[i, Q + 3]), blocks.R, i)
    _write_inverse(blocks, i, world.bodies.inverse_inertia[i])
    hold(i, before, after, contact, count, world, blocks)
    S = blocks.all[blocks.of[i]]
    for _ in range(blocks.turns):
        for r in range(ERROR):
            for c in range(ERROR):
                room[r, c] = 0.0
            for k in range(ERROR):
                f = F[r, k]
                if f != 0.0:  # most are zero in flight
                    for c in range(ERROR):
                        room[r, c] += f * S[k, c]
        for r in range(ERROR):
            for c in range(ERROR):
                S[r, c] = room[c, r] if blocks.turns == 2 else room[r, c]


@inner
def _velocity(x, i, arm):
    """Return the velocity of a point of body i; what is behind the bodies does not move."""
    if i >= len(x):
        return 0.0, 0.0, 0.0
    return plus(three(x, i, V), cross(three(x, i, W), arm))


@inner
def _give(i, arm, n, world, blocks):
    """Return the velocity along n that a unit impulse along n gives a point of body i [1/kg]."""
    if not world.bodies.moving[i]:
        return 0.0
    j, A = cross(arm, n), blocks.inverse[i]
    return world.bodies.inverse_mass[i] + dot(j, rotate(A, j[0], j[1], j[2]))


@inner(error_model="numpy")
def _round_of(piece, i, arm, n, R):
    """Return how far behind the point at ``arm`` the centre of a piece's curvature lies; 0 at a corner.

    A lathe is round about its axis, as far as the normal n is across it.
    """
    if piece[KIND] != LATHE:
        return piece[ROUNDING]
    p, n = rotate_back(R[i], arm[0], arm[1], arm[2]), rotate_back(R[i], n[0], n[1], n[2])
    d = p[0] - piece[ORIGIN], p[1] - piece[ORIGIN + 1], p[2] - piece[ORIGIN + 2]
    axis = piece[AXES + 2], piece[AXES + 5], piece[AXES + 8]
    d = minus(d, times(dot(d, axis), axis))
    return math.sqrt(dot(d, d)) * (1.0 - dot(n, axis) ** 2)


@inner(noinline=True, error_model="numpy")
def meeting(k, a, b, states, contact, world, blocks):
    """Return the `Meeting` of row k, of bodies a and b, in a step with states (2, B, 13)."""
    n, before, after = three(contact, k, NORMAL), states[0], states[1]
    arm_b = arm_at(k, b, 0.5, after, contact)
    arm_a = arm_b if a >= len(after) else arm_at(k, a, -0.5, after, contact)
    slip = minus(_velocity(before, b, arm_b), _velocity(before, a, arm_a))
    u0 = dot(n, slip)
    u1 = dot(n, minus(_velocity(after, b, arm_b), _velocity(after, a, arm_a)))
    mass = 1.0 / (_give(a, arm_a, n, world, blocks) + _give(b, arm_b, n, world, blocks))
    f = three(contact, k, IMPULSE)
    load, along = dot(n, f), minus(slip, times(u0, n))
    acting, square, rub = min(max(load, 0.0), mass * max(u1 - u0, 0.0)), dot(along, along), 0.0
    if load > 0.0 and square > _STILL * _STILL:
        rub = dot(f, along) / (load * square)
    pa, pb = world.pieces[int(contact[k, PIECE_A])], world.pieces[int(contact[k, PIECE_B])]
    return Meeting(
        n,
        arm_a,
        arm_b,
        acting,
        int(contact[k, FACE_OF]),
        _round_of(pa, a, arm_a, n, blocks.R),
        _round_of(pb, b, arm_b, n, blocks.R),
        slip,
        rub,
        contact[k, MU0],
    )
