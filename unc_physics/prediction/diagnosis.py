"""Procedure of a status: judge each snapshot once, with rollouts where its spread needs a comparison."""

from __future__ import annotations

import math
from dataclasses import replace
from weakref import WeakKeyDictionary

import numpy as np

from ..checks.errors import InvalidOptionError, LimitExceededError
from ..checks.validation import integer
from ..compiler.compile_time import clock
from ..propagators.balanced_monte_carlo import BalancedMonteCarlo
from ..propagators.base import SAMPLES_LIMIT, PointPairs, rollout_count
from ..propagators.modes import may_split
from ..scene.marks import mark_at
from ..spatial.layout import ANGULAR_VELOCITY, ERR_ANGULAR_VELOCITY, ERR_VELOCITY, VELOCITY
from ..spatial.moments import pose_spreads
from .body_status import BodyStatus
from .compute_budget import ComputeBudget
from .diagnostics import RULES, judged, measures_of
from .driver import run, wide_states
from .evidence import MOST_FLIGHT_TURN, Evidence, initial_diagnostics
from .prediction_data import PredictionData
from .probability import is_certain
from .request_checks import check_memory, check_supported
from .snapshot import Snapshot
from .step_motion import Span, motion_in_meetings

#: Rollouts with which `judge` compares a spread.
ROLLOUTS = 12
#: Rollouts that are added if the comparison is inconclusive, and the number of rollouts from which on none
#: are added.
_ADDED, _CONCLUSIVE = 24, 36
_ENOUGH = 1000  # rollouts with which no search for rare outcomes is necessary
_SYMMETRIC = 1.05  # asymmetry of sigma points up to which their spread is not compared
_INCONCLUSIVE = 1.4, 2.7  # factors between which a dozen rollouts cannot decide whether spreads differ by two
_FARTHEST = 3.0  # standard deviations of a velocity that a dozen rollouts do not exceed
_SEED = 0  # of the rollouts; added rollouts have the next one. A fixed seed makes statuses reproducible


#: Cached statuses of a snapshot by the number of rollouts.
_judged: WeakKeyDictionary[Snapshot, dict[int, tuple[BodyStatus, ...]]] = WeakKeyDictionary()


def compared_rollouts(rollouts: int, field: str = "rollouts") -> int:
    """Return the number of rollouts to compare with, checked; one alone has no spread."""
    found = integer(rollouts, field, low=0)
    if found == 1:
        raise InvalidOptionError("must be 0, or at least 2", field=field, value=rollouts)
    if found > SAMPLES_LIMIT:
        raise LimitExceededError(f"must be at most {SAMPLES_LIMIT}", field=field, value=rollouts)
    return found


@np.errstate(all="ignore")
def judge(prediction: PredictionData, rollouts: int) -> tuple[tuple[BodyStatus, ...], ...]:
    """Return the statuses of all bodies at each time, as of a prediction that ends at this time.

    Spreads are compared with those of ``rollouts`` rollouts, as in `status.assess`.
    """
    rollouts = compared_rollouts(rollouts)
    known = [_judged.setdefault(snapshot, {}).get(rollouts) for snapshot in prediction.snapshots]
    left = tuple(one for one, own in zip(prediction.snapshots, known, strict=True) if own is None)
    if left:
        for snapshot, statuses in zip(
            left, _judge(replace(prediction, snapshots=left), rollouts), strict=True
        ):
            _judged[snapshot][rollouts] = statuses
    return tuple(_judged[snapshot][rollouts] for snapshot in prediction.snapshots)


def _judge(prediction, rollouts):
    """Return the statuses as `judge` does, without the cache."""
    start = initial_diagnostics(prediction)
    found = [Evidence.of(prediction, start, snapshot) for snapshot in prediction.snapshots]
    if rollouts > 0:
        _compare(prediction, found, [k for k, one in enumerate(found) if needs_rollouts(one)], rollouts)
    if 0 < rollouts < _CONCLUSIVE:
        places = [k for k, one in enumerate(found) if is_inconclusive(one)]
        _compare(prediction, found, places, _ADDED, before=rollouts)
    if rollouts > 0 and may_miss(prediction):
        _add_wide_rollouts(prediction, found)
    if prediction.scene.integrator == "explicit":
        _add_step_motion(prediction, found)
    statuses = []
    for k, one in enumerate(found):
        if k and _is_same_evidence(one, found[k - 1]):
            statuses.append(statuses[-1])
        else:
            statuses.append(tuple(judged(one, body, own) for body, own in enumerate(measures_of(one))))
    return tuple(statuses)


def _is_same_evidence(evidence, other):
    """Return whether two times have the same evidence, as when all bodies sleep (`Snapshot.at_time`)."""
    one, before = evidence.snapshot, other.snapshot
    same = one.carry is before.carry and one.belief is before.belief
    return same and evidence.wide is other.wide and evidence.spreads is other.spreads


def _compare(prediction, found, places, rollouts, before=0):
    """Add spreads and states of rollouts to the evidence at some places.

    Evidence of ``before`` earlier rollouts is combined with that of the new ones.
    """
    if places:
        marks = [mark_at(found[k].snapshot.time, prediction.scene.dt) for k in places]
        scene = prediction.asked or prediction.scene
        seed = _SEED + (before > 0)
        sampled = sampled_snapshots(scene, prediction.initial, marks, rollouts, seed)
        for k, one in zip(places, sampled, strict=True):
            own, states = pose_spreads(one.belief.blocks), one.rollout_states
            if before:
                squares = before * found[k].spreads ** 2 + rollouts * own**2
                own = np.sqrt(squares / (before + rollouts))
                states = np.concatenate([some for some in (found[k].compared, states) if some is not None])
            found[k] = replace(found[k], spreads=own, compared=states)


def may_miss(prediction: PredictionData) -> bool:
    """Return whether the few rollouts of a method with hard contacts may miss rare outcomes."""
    scene, propagator = prediction.scene, prediction.propagator
    if scene.integrator == "explicit" or propagator.traits.mean_update == "nominal":
        return False
    return rollout_count(prediction.carry) < _ENOUGH and not is_certain(
        scene, prediction.initial, prediction.at()
    )


def _add_wide_rollouts(prediction, found):
    """Add states of rollouts of a wider belief to evidence without them."""
    scene, initial = prediction.scene, prediction.initial
    left = [k for k, one in enumerate(found) if one.wide is None]
    marks = [mark_at(found[k].snapshot.time, scene.dt) for k in left]
    if not left:
        return
    states = wide_states(scene, initial, marks, rollout_count(prediction.carry))
    for k, wide in zip(left, states, strict=True):
        found[k] = replace(found[k], wide=wide)


def _add_step_motion(prediction, found):
    """Add to evidence the motion in one explicit step of bodies that meet something."""
    start, initial = found[0].start, prediction.initial
    motions = motion_in_meetings(
        prediction.asked or prediction.scene,
        initial,
        start.shapes[:, 3],
        start.shapes[:, 2],
        1 if start.deterministic else ROLLOUTS,
        [_span(one, initial) for one in found],
    )
    found[:] = [replace(one, step_motion=own) for one, own in zip(found, motions, strict=True)]


def _span(evidence, initial):
    """Return the time of evidence with the highest speeds in a dozen rollouts, by start, end and gravity."""
    states = evidence.snapshot.belief.mean[None] if evidence.states is None else evidence.states
    norms = []
    for part, error_part in ((VELOCITY, ERR_VELOCITY), (ANGULAR_VELOCITY, ERR_ANGULAR_VELOCITY)):
        before = np.linalg.norm(initial.mean[:, part], axis=1)
        variances = np.trace(initial.blocks[:, error_part, error_part], axis1=1, axis2=2)
        before[initial.moving] += _FARTHEST * np.sqrt(np.maximum(variances, 0.0))
        norms.append(np.maximum(before, np.linalg.norm(states[..., part], axis=-1).max(axis=0)))
    steps = mark_at(evidence.snapshot.time, evidence.scene.dt).count
    return Span(steps, np.maximum(norms[0], evidence.highest_speed), norms[1])


def needs_rollouts(evidence: Evidence) -> bool:
    """Return whether a spread is to be compared with that of rollouts.

    A spread of a single rollout is compared if there is something to touch, a gyroscopic term, or far
    rotation in a step. A spread of points is compared if one of them touched something, and the points are
    asymmetric, or many, or touched different things, or may have turned too far. Without a contact, it is
    compared if the points are asymmetric, by the gyroscopic term.
    """
    scene, propagator, directions = evidence.scene, evidence.propagator, evidence.start.directions
    if propagator.traits.mean_update == "nominal":
        if len(scene.bodies) + len(scene.environment) > 1 or scene.gyroscopic:
            return True
        # else flight is exact, or of first order in the rotation of a step
        return propagator.traits.separate_collisions and bool((evidence.step_turn > MOST_FLIGHT_TURN).any())
    touched = np.isfinite(evidence.history.first_time)
    if touched.any() and evidence.left_out:
        return True
    if not isinstance(propagator, PointPairs):
        return False
    asymmetry = evidence.asymmetry
    uneven = asymmetry is None or asymmetry.max() > _SYMMETRIC
    if not touched.any():
        return scene.gyroscopic and uneven
    if directions is None or directions.sum() > RULES["directions"].limit:
        return True
    return uneven or not (touched == touched[0]).all() or _may_have_wrapped(evidence)


def is_inconclusive(evidence: Evidence) -> bool:
    """Return whether a few rollouts leave open if predicted spreads are wrong, or if outcomes split."""
    factors, scene, compared = evidence.spread_factors, evidence.scene, evidence.compared
    if factors is None:
        return False
    low, high = _INCONCLUSIVE
    factor = factors.max(axis=1)
    if ((low < factor) & (factor < high)).any():
        return True
    return compared is not None and any(
        may_split(compared[:, k], scene.bodies[k].model.bounding_radius)
        for k in np.flatnonzero(evidence.touches).tolist()
    )


def _may_have_wrapped(evidence):
    """Return whether sigma points may have turned by half a turn since they touched something.

    Rotations wrap there, so the spread of the points is too small, and opposite points still look opposite.
    The number of directions determines how many standard deviations the farthest point is from the mean. Its
    spin is that of the final belief.
    """
    scene, snapshot, bodies = evidence.scene, evidence.snapshot, len(evidence.scene.bodies)
    first = evidence.history.first_time.min(axis=0)
    since = np.minimum(first.min(axis=1), first[:, :bodies].min(axis=0))[scene.moving]
    far = math.sqrt(evidence.start.directions.sum() + len(scene.uncertain) + 0.5)
    spin = snapshot.belief.blocks[:, ERR_ANGULAR_VELOCITY, ERR_ANGULAR_VELOCITY]
    std = np.sqrt(np.maximum(np.einsum("mii->m", spin), 0.0))
    return bool((far * std * np.maximum(snapshot.time - since, 0.0) > math.pi).any())


def sampled_snapshots(scene, initial, marks, count, seed=_SEED):
    """Return the snapshots of ``count`` rollouts at marks, as of `marks_of`."""
    propagator = BalancedMonteCarlo(samples=count, seed=seed)
    check_supported(scene, propagator)
    check_memory(scene, initial, propagator, len(marks))
    return run(scene, initial, propagator, marks, ComputeBudget(None, clock(), None)).snapshots
