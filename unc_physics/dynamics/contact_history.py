"""Contact data that rollouts carry from step to step in addition to their states."""

from typing import Any, NamedTuple

import numpy as np

from ..spatial.random import keys_of
from . import implicit_world
from .implicit_world import fresh_solver_memory


class InitialAdjustment(NamedTuple):
    """Initial projection and settling of each body in N rollouts (`initialization.projection`).

    Attributes
    ----------
    overlap : (N, B) float32
        Deepest overlap before projection [m].
    moved : (N, B) float32
        Distance by which projection or settling moved the body, in standard deviations.
    kept : (N, B) float32
        Deepest overlap that remains after projection [m].
    tilted : (N, B) float32
        Angle by which settling tilted the body [rad].
    unsettled : (N, B) float32
        1 if settling did not converge.
    """

    overlap: np.ndarray
    moved: np.ndarray
    kept: np.ndarray
    tilted: np.ndarray
    unsettled: np.ndarray


class ContactHistory(NamedTuple):
    """Contact history of N rollouts.

    Attributes
    ----------
    first_time : (N, B, B + E) float32
        Time of the first contact of bodies i < j, or of body i and element j - B of the environment [s].
        Infinite without contact. The resolution is one step: a contact has the time of the end of its step.
    solver : NamedTuple or None
        Arrays of the implicit step, or of the one over exact shapes, with N as the first axis; None for the
        explicit step.
    start : InitialAdjustment or None
        None for the explicit step.
    """

    first_time: np.ndarray
    solver: Any
    start: InitialAdjustment | None


def fresh(count, world):
    """Return the history of ``count`` new rollouts."""
    bodies = len(world.bodies.moving)
    elements = 0 if world.environment is None else len(world.environment.kind)
    first = np.full((count, bodies, bodies + elements), np.inf, np.float32)
    if world.implicit is None:
        return ContactHistory(first, None, None)
    start = InitialAdjustment(*(np.zeros((count, bodies), np.float32) for _ in InitialAdjustment._fields))
    return ContactHistory(first, fresh_solver_memory(count, bodies), start)


def copy(history):
    """Return a copy of the history; the constant ``start`` is shared."""
    return _each(history, np.copy)._replace(start=history.start)


def samples(history, some):
    """Return the history of some rollouts; a slice ``some`` shares the arrays, an index array copies them."""
    return _each(history, lambda array: array[some])


def with_keys(history, seed, first=0):
    """Return the history of implicit rollouts with keys for random impact errors; ``first`` numbers them.

    The key of a rollout depends only on the seed and the rollout's number.
    """
    keys = keys_of(np.uint64(seed), first, len(history.first_time))
    return history._replace(solver=history.solver._replace(key=keys))


def asleep(history, world):
    """Return which bodies sleep in each rollout, or may sleep: (N, B) bool."""
    if _is_of_exact_shapes(history):
        return history.solver.at_rest
    if history.solver is None or world.implicit is None or world.implicit.rest_steps == 0:
        return np.zeros(history.first_time.shape[:2], bool)
    return history.solver.rest_steps >= world.implicit.rest_steps


def renewed(history, bodies):
    """Return the history in which some bodies, by their indices, are awake and have touched nothing yet."""
    first = history.first_time.copy()
    first[:, bodies] = np.inf
    first[:, :, bodies] = np.inf
    if history.solver is None:
        return history._replace(first_time=first)
    if _is_of_exact_shapes(history):
        return history._replace(first_time=first, solver=history.solver.renewed(bodies))
    rest_steps = history.solver.rest_steps.copy()
    rest_steps[:, bodies] = 0
    return history._replace(first_time=first, solver=history.solver._replace(rest_steps=rest_steps))


def woken(history):
    """Return the history in which every body is awake."""
    if history.solver is None:
        return history
    if _is_of_exact_shapes(history):
        return history._replace(solver=history.solver.awake())
    rest_steps = np.zeros_like(history.solver.rest_steps)
    return history._replace(solver=history.solver._replace(rest_steps=rest_steps))


def moved(history):
    """Return the history after the states of rollouts were changed from outside."""
    return history._replace(solver=history.solver.moved()) if _is_of_exact_shapes(history) else history


def _is_of_exact_shapes(history):
    """Return whether rollouts remember contacts of exact shapes, not of spheres."""
    return history.solver is not None and not isinstance(history.solver, implicit_world.SolverMemory)


def with_kept_overlap(history, kept, bodies):
    """Return the history in which some bodies keep overlaps ``kept`` (N, B, B + E) without a force [m]."""
    old = history.solver.kept_overlap
    if not (kept[:, bodies].any() or kept[:, :, bodies].any() or old.size):
        return history
    new = old.copy() if old.size else np.zeros_like(history.first_time)
    new[:, bodies], new[:, :, bodies] = kept[:, bodies], kept[:, :, bodies]
    return history._replace(solver=history.solver._replace(kept_overlap=new))


def _each(history, function):
    """Return a history with a function applied to all of its arrays."""
    if history.solver is None:
        return ContactHistory(function(history.first_time), None, None)
    solver, start = (type(part)(*map(function, part)) for part in (history.solver, history.start))
    return ContactHistory(function(history.first_time), solver, start)


def of_bodies(history, bodies):
    """Return the history of some bodies (ascending indices), with each other and with all elements."""
    first, solver, start = _pairs_of(history.first_time, bodies), history.solver, history.start
    if solver is not None:
        if _is_of_exact_shapes(history):
            solver = solver.of_bodies(bodies)
        else:
            solver = implicit_world.of_bodies(solver, bodies, _pairs_of(solver.kept_overlap, bodies))
        start = type(start)(*(np.ascontiguousarray(values[:, bodies]) for values in start))
    return ContactHistory(first, solver, start)


def _pairs_of(values, bodies):
    """Return values (N, B, B + E) of some bodies with each other and all elements; keep empty arrays."""
    if values.shape[1] == 0:
        return values
    columns = np.concatenate([bodies, np.arange(values.shape[1], values.shape[2])])
    return np.ascontiguousarray(values[:, bodies][:, :, columns])


def with_another_body(history):
    """Return the history with one more body after the others, which has touched nothing yet."""

    def larger(pairs, value):  # (N, B, B + E): elements come after all bodies
        return np.insert(np.insert(pairs, bodies, value, axis=1), bodies, value, axis=2)

    bodies, solver = history.first_time.shape[1], history.solver
    first = larger(history.first_time, np.inf)
    if solver is None:
        return ContactHistory(first, None, None)
    start = history.start
    start = type(start)(*(np.insert(values, bodies, 0.0, axis=1) for values in start))
    if _is_of_exact_shapes(history):
        return ContactHistory(first, solver.with_another_body(), start)
    new = fresh_solver_memory(len(first), bodies + 1)
    for name in ("contact", "force", "rest_steps", "residual"):
        old = getattr(solver, name)
        getattr(new, name)[:, : old.shape[1]] = old
    kept = solver.kept_overlap
    kept = larger(kept, 0.0) if kept.size else kept
    return ContactHistory(first, new._replace(count=solver.count, kept_overlap=kept, key=solver.key), start)


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
