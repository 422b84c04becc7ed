"""Probabilities of events, counted in the rollouts of a prediction.

An estimate has an interval for the finite number of rollouts. The Gaussian of a propagator without samples is
no measure of probability once bodies have touched (``python -m unc_physics evaluate calibration``). `predict`
simulates rollouts beside it for the events that it is given (`snapshot.Counted`). The Gaussian answers for
other events.
"""

from __future__ import annotations

import math
import weakref
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..scene.belief import Belief
from ..scene.scene import Scene
from .events import Event, RolloutOutcomes, Touches
from .snapshot import ContactTime, Probability, Snapshot

#: Half width of the interval of a share, in standard deviations: a normal value is beyond once in a thousand.
NORMAL_QUANTILE = 3.29
_DRAWN = 1000  # states of a Gaussian


class _Source(NamedTuple):
    """Equally probable outcomes, how they were found (`Probability.method`), and from how many rollouts.

    ``effective`` is that of `Snapshot`.
    """

    method: str
    outcomes: RolloutOutcomes
    rollouts: int
    effective: Callable[[np.ndarray], np.ndarray] | None = None


_found: weakref.WeakKeyDictionary[Snapshot, _Source] = weakref.WeakKeyDictionary()


def probability(scene: Scene, initial: Belief, snapshot: Snapshot, event: Event) -> Probability:
    """Return the probability of an event at a snapshot's time; ``initial`` is the given belief at time 0."""
    if not event.needs_contacts and not event.names & {body.name for body in scene.bodies if body.free}:
        mean = RolloutOutcomes(scene, initial.mean, snapshot.belief.mean[None])
        return _counted(event, _Source("certain", mean, 1))
    return _counted(event, _source(scene, initial, snapshot))


def contact_time(scene: Scene, initial: Belief, snapshot: Snapshot, event: Touches) -> ContactTime | None:
    """Return the time of the first contact, given that there is one; None if no outcome has a contact.

    The arguments are those of `probability`.
    """
    times = event.first_times(_source(scene, initial, snapshot).outcomes).astype(float)
    times = times[np.isfinite(times)]
    return ContactTime(float(times.mean()), float(times.std())) if len(times) else None


def sample_outcomes(scene: Scene, initial: Belief, snapshot: Snapshot) -> RolloutOutcomes:
    """Return the outcomes of a snapshot's samples, each of which is a rollout."""
    assert snapshot.rollout_states is not None
    return RolloutOutcomes(scene, initial.mean, snapshot.rollout_states, snapshot.first_contacts)


def is_certain(scene: Scene, initial: Belief, snapshot: Snapshot) -> bool:
    """Return whether only one outcome can happen up to a snapshot's time."""
    states = snapshot.rollout_states
    if states is not None and len(states) > 1 and (states == states[0]).all():
        return True
    return is_deterministic(scene, initial)


def is_deterministic(scene: Scene, initial: Belief) -> bool:
    """Return whether nothing is uncertain at the start, nor drawn later."""
    return not (initial.covariance.any() or scene.uncertain or scene.draws_impacts)


def interval(share: float, count: float, quantile: float = NORMAL_QUANTILE) -> tuple[float, float]:
    """Return the bounds of a probability from a share of ``count`` independent draws (Wilson 1927)."""
    square = quantile**2 / count
    middle = (share + 0.5 * square) / (1.0 + square)
    half = quantile * math.sqrt(share * (1.0 - share) / count + 0.25 * square / count) / (1.0 + square)
    # exact at the ends, where round-off would leave a remainder
    return 0.0 if share == 0.0 else middle - half, 1.0 if share == 1.0 else middle + half


def _counted(event, source):
    """Return the probability of an event from its source."""
    happened = event.happened(source.outcomes)
    estimate = float(happened.mean())
    low, high = estimate, estimate
    if source.method == "gaussian":
        low, high = 0.0, 1.0
    elif source.method != "certain":
        count = source.rollouts if source.effective is None else float(source.effective(happened[None])[0])
        low, high = interval(estimate, count)
    # round-off must not leave the estimate outside
    return Probability(estimate, min(low, estimate), max(high, estimate), source.method, source.rollouts)


def _source(scene, initial, snapshot):
    """Return the outcomes in which events are counted."""
    if snapshot not in _found:
        _found[snapshot] = _source_of(scene, initial, snapshot)
    return _found[snapshot]


def _source_of(scene, initial, snapshot):
    states, first, start = snapshot.rollout_states, snapshot.first_contacts, initial.mean
    if is_certain(scene, initial, snapshot):
        only = snapshot.belief.mean[None] if states is None else states[:1]
        return _Source("certain", RolloutOutcomes(scene, start, only, first[:1]), 1)
    effective = snapshot.effective
    if snapshot.counted is not None:
        states, first, effective = snapshot.counted
    if states is None:
        drawn = snapshot.belief.sample(_DRAWN, np.random.default_rng(0))
        outcomes = RolloutOutcomes(scene, start, drawn, first[np.arange(_DRAWN) % len(first)])
        return _Source("gaussian", outcomes, len(first))
    return _Source("samples", RolloutOutcomes(scene, start, states, first), len(states), effective)
