"""Checks of the arguments of a prediction."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from ..checks.errors import InvalidHorizonError, LimitExceededError, NotSupportedError
from ..checks.memory import require_memory
from ..checks.validation import positive
from ..physics.everyday.columns import REMEMBERED
from ..physics.everyday.rollouts import FIRST_ROOM
from ..propagators.base import Propagator, Samples
from ..propagators.registry import names_where
from ..scene.belief import Belief
from ..scene.environment import element_names, thing_names
from ..scene.marks import RESOLUTION, Mark, mark_at
from ..scene.materials import Materials
from ..scene.scene import Scene
from ..spatial.layout import ERROR, STATE

STEPS_LIMIT = 100_000_000
TIMES_LIMIT = 100_000
_NUMBER, _SHORT = 8, 4  # bytes of a double and of a single
_COPIES = 2  # of the rollouts' memory: each piece of a prediction begins with a copy
_MATRICES = 4  # as large as the joint covariance, while a belief is made of states
_PAIR = 150  # bytes of each pair of things in a rollout's workspace


def periodic_times(scene: Scene, period: float, horizon: float, field: str = "period") -> list[float]:
    """Return the multiples of ``period`` before ``horizon`` [s]; errors call the period ``field``."""
    step = _checked_mark(scene, period, field).time
    count = positive(horizon, "horizon", InvalidHorizonError) / step
    if count > TIMES_LIMIT:
        raise LimitExceededError(f"gives more than {TIMES_LIMIT} times", field=field, value=period)
    return [k * step for k in range(1, math.ceil(count - 1e-9))]


def checked_marks(
    scene: Scene,
    belief: Belief,
    propagator: Propagator,
    horizon: float | None,
    times: float | Sequence[float] | None,
) -> list[Mark]:
    """Check that arguments of `predict` fit together, and return the marks of the requested times."""
    belief.check_fits(scene)
    check_supported(scene, propagator)
    return marks_of(scene, horizon, times)


def check_supported(scene: Scene, propagator: Propagator) -> None:
    """Raise `NotSupportedError` unless the propagator supports the scene.

    Integrator, overlap, actions and uncertain parameters count; materials may be left out
    (`simulated_scene.left_out`).
    """
    if scene.integrator not in propagator.integrators:
        able = names_where(lambda other: scene.integrator in other.integrators)
        raise NotSupportedError(
            f"does not run on the {scene.integrator} integrator; {able} do",
            field="propagator",
            value=propagator.name,
        )
    if scene.overlap == "reject" and not propagator.supports.overlap_rejection:
        able = names_where(lambda other: other.supports.overlap_rejection)
        raise NotSupportedError(
            f"is for {able} alone, not for {propagator.name}; 'project' is for all",
            field="overlap",
            value="reject",
        )
    takes_actions = scene.integrator in propagator.supports.actions
    if scene.acts and not takes_actions:
        able = names_where(lambda other: scene.integrator in other.supports.actions)
        where = ""
        if propagator.supports.actions:
            names = propagator.supports.actions
            where = f", but on the {' and '.join(names)} integrator{'s' * (len(names) > 1)}"
        raise NotSupportedError(
            f"does not take prescribed, held or pushed bodies, nor surfaces that move{where}; {able} do",
            field="propagator",
            value=propagator.name,
        )
    for k, surface in enumerate(scene.surfaces):
        if surface.torsional_friction and not takes_actions:
            raise NotSupportedError(
                f"is not supported by {propagator.name}",
                field=f"torsional_friction of '{thing_names(scene)[k]}'",
                value=surface.torsional_friction,
            )
    supports, supported = propagator.supports, Materials._fields
    if scene.integrator in supports.parameters_on:
        supported += supports.parameters
    unsupported = [parameter for parameter in scene.uncertain if parameter.name not in supported]
    if unsupported:
        first = unsupported[0]
        owners = [f" of body '{body.name}'" for body in scene.bodies]
        owners += [f" of element '{name}'" for name in element_names(scene.environment)]
        owner = "" if first.body < 0 else owners[first.body]
        field = f"{first.name}_std{owner}"
        raise NotSupportedError(f"is not supported by {propagator.name}", field=field, value=float(first.std))


def marks_of(scene: Scene, horizon: float | None, times: float | Sequence[float] | None) -> list[Mark]:
    """Return the marks of the requested times, ascending; the arguments are those of `predict`.

    A number as ``times`` is one time. If a time is no multiple of ``dt``, the implicit integrator ends with a
    shorter step. The explicit one does not, as its contact law depends on the step.
    """
    if isinstance(horizon, (list, tuple, np.ndarray)):
        raise InvalidHorizonError(
            "must be one time; several are given as times=[...]", field="horizon", value=horizon
        )
    wanted = [] if times is None else list(times) if isinstance(times, Iterable) else [times]
    if horizon is not None:
        wanted.append(horizon)
    if not wanted:
        raise InvalidHorizonError(
            "must be given: the time to predict for in seconds, as in 'horizon: 1.0' of a scene file,"
            " '--horizon 1.0' or predict(..., horizon=1.0)",
            field="horizon",
        )
    names = [f"times[{k}]" for k in range(len(wanted))]
    if horizon is not None:
        names[-1] = "horizon"
    marks: list[Mark] = []
    for name, value in zip(names, wanted, strict=True):
        mark = _checked_mark(scene, value, name)
        if marks and mark.time < marks[-1].time - RESOLUTION:
            before = f"{marks[-1].time:.6g} s"
            raise InvalidHorizonError(
                f"is the last time, so it must be at least that of times, {before}"
                if name == "horizon"
                else f"must not be earlier than the time before it, {before}",
                field=name,
                value=value,
            )
        if not marks or mark.time > marks[-1].time + RESOLUTION:
            marks.append(mark)
    return marks


def _checked_mark(scene, value, field):
    """Return the mark of a time [s]; errors are those of `marks_of`."""
    time = positive(value, field, InvalidHorizonError)
    if time / scene.dt > STEPS_LIMIT:
        raise LimitExceededError(
            f"takes more than {STEPS_LIMIT} steps of dt = {scene.dt} s", field=field, value=value
        )
    mark = mark_at(time, scene.dt)
    if mark.rest > 0.0 and scene.integrator == "explicit":
        nearest = max(round(time / scene.dt), 1) * scene.dt
        raise InvalidHorizonError(
            f"is no multiple of dt = {scene.dt} s, and the explicit integrator takes whole steps only; the"
            f" nearest possible time is {nearest} s",
            field=field,
            value=value,
        )
    return mark


def rollout_bytes(scene: Scene) -> int:
    """Return the bytes of a rollout's state at one time, with its first contacts and its contact memory."""
    bodies = len(scene.bodies)
    remembered = _SHORT * bodies * (bodies + len(scene.environment))
    if scene.integrator == "implicit":
        remembered += bodies * _NUMBER * (FIRST_ROOM * REMEMBERED + 1)
    return remembered + _NUMBER * STATE * bodies


def check_memory(scene: Scene, belief: Belief, propagator: Propagator, times: int) -> None:
    """Raise `LimitExceededError` if a prediction of so many ``times`` exceeds the memory."""
    bodies, things = len(scene.bodies), len(scene.bodies) + len(scene.environment)
    own = isinstance(propagator, Samples)
    rollouts = propagator.own_sample_count if own else propagator.most_rollouts(scene, belief)
    state = _NUMBER * STATE * bodies
    kept = rollout_bytes(scene)
    errors = _NUMBER * ERROR * len(scene.moving)
    covariance = _NUMBER * (ERROR * len(scene.moving)) ** 2
    if own and propagator.joint_when_used:
        kept, covariance = kept + errors, covariance // max(len(scene.moving), 1)
    of_times = times * (covariance + rollouts * kept)
    needed = rollouts * (_COPIES * kept + 2 * errors + state)
    needed += _MATRICES * covariance + _PAIR * bodies * things
    what = f"{bodies} {'body' if bodies == 1 else 'bodies'} in {rollouts} rollouts, at {times} times,"
    if of_times > needed:
        require_memory(needed + of_times, what, "the number of times", times)
    elif not own:
        require_memory(needed + of_times, what, "the number of bodies", bodies)
    else:
        require_memory(needed + of_times, what, "samples", rollouts)
