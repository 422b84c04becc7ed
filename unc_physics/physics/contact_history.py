"""What rollouts remember of their contacts, beside their states: it is part of every carry."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from . import implicit_world
from .implicit_world import fresh_solver_memory


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
    """

    first_time: np.ndarray
    solver: Any


def fresh(count, world):
    """The history of ``count`` rollouts that begin."""
    bodies = len(world.bodies.moving)
    elements = 0 if world.surroundings is None else len(world.surroundings.kind)
    first = np.full((count, bodies, bodies + elements), np.inf, np.float32)
    return ContactHistory(first, None if world.implicit is None else fresh_solver_memory(count, bodies))


def copy(history):
    """A history of its own, with the same content."""
    return _each(history, np.copy)


def samples(history, some):
    """The history of some rollouts: ``some`` is a slice, which shares the arrays, or an array of indices."""
    return _each(history, lambda array: array[some])


def _each(history, function):
    """A history with all of its arrays changed alike."""
    solver = history.solver
    return ContactHistory(
        function(history.first_time), None if solver is None else type(solver)(*map(function, solver))
    )


def of_bodies(history, bodies):
    """The history of some bodies, whose indices ascend, with each other and with all elements."""
    first = history.first_time
    columns = np.concatenate([bodies, np.arange(first.shape[1], first.shape[2])])
    solver = None if history.solver is None else implicit_world.of_bodies(history.solver, bodies)
    return ContactHistory(np.ascontiguousarray(first[:, bodies][:, :, columns]), solver)


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
    total = history.first_time.shape[1]
    elements = np.arange(total, history.first_time.shape[2])
    for own, some, k in zip(histories, bodies, rows, strict=True):
        columns = np.concatenate([some, elements])
        history.first_time[np.ix_(np.arange(count), some, columns)] = own.first_time[:1]
        history.first_time[np.ix_(k, some, columns)] = own.first_time
        if history.solver is not None:
            implicit_world.add_bodies(history.solver, own.solver, np.asarray(some), np.asarray(k))
    return history
