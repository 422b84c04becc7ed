"""Procedure of a status: judge each snapshot once, with rollouts where its spread needs a comparison."""

from __future__ import annotations

from dataclasses import replace
from weakref import WeakKeyDictionary

import numpy as np

from ..checks.errors import InvalidOptionError, LimitExceededError
from ..checks.validation import integer
from ..propagators.balanced_monte_carlo import BalancedMonteCarlo
from ..propagators.base import SAMPLES_LIMIT, rollout_count
from ..propagators.modes import may_split
from ..scene.marks import mark_at
from ..spatial.layout import ANGULAR_VELOCITY, ERR_ANGULAR_VELOCITY, ERR_VELOCITY, VELOCITY
from .body_status import BodyStatus
from .diagnostics import judged, measures_of
from .driver import Propagation, wide_states
from .evidence import Evidence, initial_diagnostics
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
#: Factor of spreads and distance of means, over the standard deviation, up to which a dozen rollouts agree
#: with the answer; beyond, they decide nothing: balanced ones leave out tails.
_AGREE = 1.15, 0.25
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
    return same and evidence.wide is other.wide and evidence.compared is other.compared


def _compare(prediction, found, places, rollouts, before=0):
    """Add states of rollouts to the evidence at some places, after those of ``before`` earlier rollouts."""
    if places:
        marks = [mark_at(found[k].snapshot.time, prediction.scene.dt) for k in places]
        scene = prediction.asked or prediction.scene
        seed = _SEED + (before > 0)
        sampled = sampled_snapshots(scene, prediction.initial, marks, rollouts, seed)
        for k, one in zip(places, sampled, strict=True):
            states = [found[k].compared, one.rollout_states] if before else [one.rollout_states]
            known = np.concatenate([some for some in states if some is not None])
            found[k] = replace(found[k], compared=known)


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
    """Return whether an answer is to be compared with rollouts: where there is any doubt (`Evidence.doubts`).

    That of a single rollout also is where it may have missed a contact, or has a gyroscopic term.
    """
    scene = evidence.scene
    missed = scene.gyroscopic or len(scene.bodies) + len(scene.environment) > 1
    return any(evidence.doubts) or (evidence.propagator.traits.mean_update == "nominal" and missed)


def is_inconclusive(evidence: Evidence) -> bool:
    """Return whether a few rollouts do not agree with the answer, or leave open if outcomes split."""
    factors, distances, compared = evidence.spread_factors, evidence.mean_distances, evidence.compared
    if factors is None or distances is None or compared is None:
        return False
    if (factors > _AGREE[0]).any() or (distances > _AGREE[1]).any():
        return True
    return any(
        may_split(compared[:, k], evidence.scene.bodies[k].model.bounding_radius)
        for k in np.flatnonzero(evidence.touches).tolist()
    )


def sampled_snapshots(scene, initial, marks, count, seed=_SEED):
    """Return the snapshots of ``count`` rollouts at marks, as of `marks_of`."""
    propagator = BalancedMonteCarlo(samples=count, seed=seed)
    check_supported(scene, propagator)
    check_memory(scene, initial, propagator, len(marks))
    return Propagation(scene, initial, propagator, marks).run().snapshots
