"""Contact data that rollouts carry from step to step in addition to their states."""

from typing import Any, NamedTuple

import numpy as np

from ..spatial.random import keys_of


class InitialAdjustment(NamedTuple):
    """Removal of overlap, and settling, of each body in N rollouts at time 0 (`physics.everyday.start`).

    Attributes
    ----------
    overlap : (N, B) float32
        Deepest overlap before [m].
    moved : (N, B) float32
        Distance by which the body was moved, in standard deviations.
    kept : (N, B) float32
        Deepest overlap that remains [m].
    tilted : (N, B) float32
        Angle by which settling tilted the body [rad].
    unsettled : (N, B) float32
        1 if settling did not converge.
    partner : (N, B) float32
        1 + the number of the body, or from B on element, that the deepest kept overlap is with; 0 for none.
    """

    overlap: np.ndarray
    moved: np.ndarray
    kept: np.ndarray
    tilted: np.ndarray
    unsettled: np.ndarray
    partner: np.ndarray


class ContactHistory(NamedTuple):
    """Contact history of N rollouts.

    Attributes
    ----------
    first_time : (N, B, B + E) float32
        Time of the first contact of bodies i < j, or of body i and element j - B of the environment [s].
        Infinite without contact. The resolution is one step: a contact has the time of the end of its step.
    solver : physics.everyday.rollouts.ContactMemory or None
        None for the explicit step, which remembers nothing.
    start : InitialAdjustment or None
        None for the explicit step.
    """

    first_time: np.ndarray
    solver: Any
    start: InitialAdjustment | None


def fresh(count, world):
    """Return the history of ``count`` new rollouts of the explicit step."""
    bodies = len(world.bodies.moving)
    elements = 0 if world.environment is None else len(world.environment.kind)
    return ContactHistory(np.full((count, bodies, bodies + elements), np.inf, np.float32), None, None)


def copy(history):
    """Return a copy of the history; the constant ``start`` is shared."""
    return _each(history, np.copy)._replace(start=history.start)


def samples(history, some):
    """Return the history of some rollouts; a slice ``some`` shares the arrays, an index array copies them."""
    return _each(history, lambda array: array[some])


def with_keys(history, seed, first=0):
    """Return the history of everyday rollouts with keys for random impact errors; ``first`` numbers them.

    The key of a rollout depends only on the seed and the rollout's number.
    """
    keys = keys_of(np.uint64(seed), first, len(history.first_time))
    return history._replace(solver=history.solver._replace(key=keys))


def asleep(history):
    """Return which bodies have been at rest so long that they may sleep, in each rollout: (N, B) bool."""
    if history.solver is None:
        return np.zeros(history.first_time.shape[:2], bool)
    return history.solver.at_rest


def renewed(history, bodies):
    """Return the history in which some bodies, by their indices, are awake and have touched nothing yet."""
    first = history.first_time.copy()
    first[:, bodies] = np.inf
    first[:, :, bodies] = np.inf
    solver = history.solver if history.solver is None else history.solver.renewed(bodies)
    return history._replace(first_time=first, solver=solver)


def woken(history):
    """Return the history in which every body is awake."""
    return history if history.solver is None else history._replace(solver=history.solver.awake())


def moved(history):
    """Return the history after the states of rollouts were changed from outside."""
    return history if history.solver is None else history._replace(solver=history.solver.moved())


def _each(history, function):
    """Return a history with a function applied to all of its arrays."""
    if history.solver is None:
        return ContactHistory(function(history.first_time), None, None)
    solver, start = (type(part)(*map(function, part)) for part in (history.solver, history.start))
    return ContactHistory(function(history.first_time), solver, start)


def of_bodies(history, bodies):
    """Return the history of some bodies (ascending indices), with each other and with all elements."""
    first, solver, start = history.first_time, history.solver, history.start
    columns = np.concatenate([bodies, np.arange(first.shape[1], first.shape[2])])
    first = np.ascontiguousarray(first[:, bodies][:, :, columns])
    if solver is not None:
        solver = solver.of_bodies(bodies)
        start = type(start)(*(np.ascontiguousarray(values[:, bodies]) for values in start))
    return ContactHistory(first, solver, start)


def with_another_body(history):
    """Return the history with one more body after the others, which has touched nothing yet."""
    bodies, solver, start = history.first_time.shape[1], history.solver, history.start
    first = history.first_time  # (N, B, B + E): elements come after all bodies
    first = np.insert(np.insert(first, bodies, np.inf, axis=1), bodies, np.inf, axis=2)
    if solver is not None:
        solver = solver.with_another_body()
        start = type(start)(*(np.insert(values, bodies, 0.0, axis=1) for values in start))
    return ContactHistory(first, solver, start)


def stacked(history, others):
    """Concatenate the histories of two sets of rollouts of the same bodies."""
    if history.solver is None:
        return ContactHistory(one_after_the_other(history.first_time, others.first_time), None, None)
    solver, start = (
        type(part)(*map(one_after_the_other, part, other))
        for part, other in ((history.solver, others.solver), (history.start, others.start))
    )
    return ContactHistory(one_after_the_other(history.first_time, others.first_time), solver, start)


def one_after_the_other(some, others):
    """Concatenate arrays of two sets of rollouts; smaller arrays are padded with zeros."""
    shape = np.maximum(some.shape[1:], others.shape[1:])
    out = np.zeros((len(some) + len(others), *shape), some.dtype)
    out[(slice(0, len(some)), *(slice(0, n) for n in some.shape[1:]))] = some
    out[(slice(len(some), None), *(slice(0, n) for n in others.shape[1:]))] = others
    return out
