"""Checks of what a prediction is asked for, before it begins."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ..checks.errors import InvalidHorizonError, LimitExceededError, NotSupportedError
from ..checks.validation import positive
from ..propagators.base import Propagator
from ..propagators.registry import names_where
from ..scene.environment import element_names
from ..scene.scene import IMPACT_STDS, Scene

STEPS_LIMIT = 100_000_000
TIMES_LIMIT = 100_000


def periodic_times(period: float, horizon: float) -> list[float]:
    """Multiples of ``period`` before ``horizon`` [s]; raises `InvalidHorizonError` or
    `LimitExceededError`.
    """
    period = positive(period, "period", InvalidHorizonError)
    count = positive(horizon, "horizon", InvalidHorizonError) / period
    if count > TIMES_LIMIT:
        raise LimitExceededError(f"gives more than {TIMES_LIMIT} times", field="period", value=period)
    return [k * period for k in range(1, math.ceil(count - 1e-9))]


def check_supported(scene: Scene, propagator: Propagator) -> None:
    """Raise `NotSupportedError` unless the propagator takes integrator, overlap, actions, impacts' errors and
    uncertain parameters.
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
            where = f", but on the {' and '.join(propagator.supports.actions)} integrator"
        raise NotSupportedError(
            f"does not take prescribed, held or pushed bodies, nor surfaces that move{where}; {able} do",
            field="propagator",
            value=propagator.name,
        )
    for k, surface in enumerate(scene.surfaces):
        if surface.torsional_friction and not takes_actions:
            names = [body.name for body in scene.bodies] + element_names(scene.environment)
            raise NotSupportedError(
                f"is not supported by {propagator.name}",
                field=f"torsional_friction of '{names[k]}'",
                value=surface.torsional_friction,
            )
    if scene.islands and getattr(propagator, "reduce", False):
        raise NotSupportedError(
            "does not go with islands, which have no common motion; leave out either", field="reduce"
        )
    if scene.draws_impacts and not propagator.supports.impact_errors:
        field = next(name for name in IMPACT_STDS if getattr(scene, name) > 0.0)
        able = names_where(lambda other: other.supports.impact_errors)
        raise NotSupportedError(
            f"is for propagators that draw samples ({able}), not for {propagator.name}",
            field=field,
            value=getattr(scene, field),
        )
    supported = propagator.supports.parameters
    unsupported = [parameter for parameter in scene.uncertain if parameter.name not in supported]
    if unsupported:
        first = unsupported[0]
        owners = [f" of body '{body.name}'" for body in scene.bodies]
        owners += [f" of element '{name}'" for name in element_names(scene.environment)]
        owner = "" if first.body < 0 else owners[first.body]
        field = f"{first.name}_std{owner}"
        raise NotSupportedError(f"is not supported by {propagator.name}", field=field, value=float(first.std))


def steps_of(scene: Scene, horizon: float | None, times: Sequence[float] | None) -> list[int]:
    """Numbers of steps after which a belief is wanted, ascending; the arguments are those of `predict`."""
    wanted = [] if times is None else list(times)
    if horizon is not None:
        wanted.append(horizon)
    if not wanted:
        raise InvalidHorizonError("must be given", field="horizon")
    names = [f"times[{k}]" for k in range(len(wanted))]
    if horizon is not None:
        names[-1] = "horizon"
    marks = []
    for name, value in zip(names, wanted, strict=True):
        ratio = positive(value, name, InvalidHorizonError) / scene.dt
        if ratio > STEPS_LIMIT:
            raise LimitExceededError(
                f"takes more than {STEPS_LIMIT} steps of dt = {scene.dt} s", field=name, value=value
            )
        steps = round(ratio)
        if steps < 1:
            raise InvalidHorizonError(
                f"is shorter than half a step of dt = {scene.dt} s", field=name, value=value
            )
        if marks and steps < marks[-1]:
            raise InvalidHorizonError("must not be earlier than the time before it", field=name, value=value)
        if not marks or steps > marks[-1]:
            marks.append(steps)
    return marks
