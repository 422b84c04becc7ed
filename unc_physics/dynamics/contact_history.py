"""What rollouts remember of their contacts, beside their states: it is part of every carry."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ..spatial.random import combine
from . import implicit_world
from .implicit_world import fresh_solver_memory


class InitialAdjustment(NamedTuple):
    """What N rollouts of the implicit step learned of their own beginning, about each body (`projection`).

    Attributes
    ----------
    overlap : (N, B) float32
        Its deepest overlap before it was projected away [m].
    moved : (N, B) float32
        How far the projection, or settling, moved it, in standard deviations.
    kept : (N, B) float32
        Its deepest overlap that could not come free [m].
    tilted : (N, B) float32
        By how much settling tilted it [rad].
    unsettled : (N, B) float32
        1 where settling did not end.
    """

    overlap: np.ndarray
    moved: np.ndarray
    kept: np.ndarray
    tilted: np.ndarray
    unsettled: np.ndarray


class ContactHistory(NamedTuple):
    """What N rollouts remember.

    Attributes
    ----------
    first_time : (N, B, B + E) float32
        Time of the first contact of bodies i < j, or of body i and element j - B of the environment [s];
        infinite without contact. Told by the step: a contact that begins within a step has the time of its
        end.
    solver : NamedTuple or None
        Arrays of the implicit step, the first axis of each being N; None for the explicit step, which
        remembers nothing.
    start : InitialAdjustment or None
        None for the explicit step.
    """

    first_time: np.ndarray
    solver: Any
    start: InitialAdjustment | None


def fresh(count, world):
    """The history of ``count`` rollouts that begin."""
    bodies = len(world.bodies.moving)
    elements = 0 if world.surroundings is None else len(world.surroundings.kind)
    first = np.full((count, bodies, bodies + elements), np.inf, np.float32)
    if world.implicit is None:
        return ContactHistory(first, None, None)
    start = InitialAdjustment(*(np.zeros((count, bodies), np.float32) for _ in InitialAdjustment._fields))
    return ContactHistory(first, fresh_solver_memory(count, bodies), start)


def copy(history):
    """A history of its own, with the same content; what its start was like is shared, since it stays."""
    return _each(history, np.copy)._replace(start=history.start)


def samples(history, some):
    """The history of some rollouts: ``some`` is a slice, which shares the arrays, or an array of indices."""
    return _each(history, lambda array: array[some])


def with_keys(history, seed, first=0):
    """The history of implicit rollouts, from the ``first`` on, that draw the errors of their impacts.

    Rollout n always draws the same.
    """
    numbers = range(first, first + len(history.first_time))
    keys = np.array([combine(np.uint64(seed), n) for n in numbers], np.uint64)
    return history._replace(solver=history.solver._replace(key=keys))


def _each(history, function):
    """A history with all of its arrays changed alike."""
    if history.solver is None:
        return ContactHistory(function(history.first_time), None, None)
    solver, start = (type(part)(*map(function, part)) for part in (history.solver, history.start))
    return ContactHistory(function(history.first_time), solver, start)


def of_bodies(history, bodies):
    """The history of some bodies, whose indices ascend, with each other and with all elements."""
    first, solver, start = _pairs_of(history.first_time, bodies), history.solver, history.start
    if solver is not None:
        solver = implicit_world.of_bodies(solver, bodies, _pairs_of(solver.kept_overlap, bodies))
        start = InitialAdjustment(*(np.ascontiguousarray(values[:, bodies]) for values in start))
    return ContactHistory(first, solver, start)


def _pairs_of(values, bodies):
    """Values (N, B, B + E) of some bodies with each other and with all elements; empty ones stay so."""
    if values.shape[1] == 0:
        return values
    columns = np.concatenate([bodies, np.arange(values.shape[1], values.shape[2])])
    return np.ascontiguousarray(values[:, bodies][:, :, columns])


def joined(histories: Sequence[ContactHistory], rows: Sequence, bodies: Sequence, world) -> ContactHistory:
    """One history for the bodies of several, which never touched each other.

    Parameters
    ----------
    histories : sequence of ContactHistory
    rows : sequence of (n,) int arrays
        Which rollouts of the joint history each history's are; the others' rollouts follow its first, before
        which nothing distinguishes them.
    bodies : sequence of (b,) int arrays
        Which of the joint history's bodies each history's are.
    world : World
        Of the joint history.
    """
    count = 1 + max(int(np.max(own)) for own in rows)
    history = fresh(count, world)
    if any(own.solver is not None and own.solver.kept_overlap.size for own in histories):
        kept = np.zeros_like(history.first_time)
        history = history._replace(solver=history.solver._replace(kept_overlap=kept))
    for own, some, k in zip(histories, bodies, rows, strict=True):
        some, followed = np.asarray(some), np.zeros(count, np.int64)
        followed[k] = np.arange(len(k))
        _add_pairs(history.first_time, own.first_time, some, followed)
        if history.solver is not None:
            implicit_world.add_bodies(history.solver, own.solver, some, followed)
            _add_pairs(history.solver.kept_overlap, own.solver.kept_overlap, some, followed)
            for values, others in zip(history.start or (), own.start or (), strict=True):
                values[:, some] = others[followed]
    return history


def _add_pairs(values, own, some, followed):
    """Write what one history says of pairs of bodies, and of these and elements, into the joint one's."""
    if own.shape[1] == 0:
        return
    columns = np.concatenate([some, np.arange(values.shape[1], values.shape[2])])
    values[np.ix_(np.arange(len(values)), some, columns)] = own[followed]


def stacked(history, others):
    """The history of some rollouts and, after them, of others of the same bodies."""
    if history.solver is None:
        return ContactHistory(one_after_the_other(history.first_time, others.first_time), None, None)
    solver, start = (
        type(part)(*map(one_after_the_other, part, other))
        for part, other in ((history.solver, others.solver), (history.start, others.start))
    )
    return ContactHistory(one_after_the_other(history.first_time, others.first_time), solver, start)


def one_after_the_other(some, others):
    """Arrays of some rollouts and of others in one; what has room for less gets more, empty."""
    shape = np.maximum(some.shape[1:], others.shape[1:])
    out = np.zeros((len(some) + len(others), *shape), some.dtype)
    out[(slice(0, len(some)), *(slice(0, n) for n in some.shape[1:]))] = some
    out[(slice(len(some), None), *(slice(0, n) for n in others.shape[1:]))] = others
    return out
