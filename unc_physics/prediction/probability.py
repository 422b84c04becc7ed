"""Probabilities of events, counted in the samples, rollouts or flights of a prediction.

An estimate has an interval for the finite number of rollouts and the limits of the method. The Gaussian of a
propagator without samples is no measure of probability once bodies have touched
(``python -m unc_physics evaluate calibration``). Such a prediction uses samples of the initial belief that
fly until their first contacts (`first_contacts`). A flight that does not decide the event counts half. If no
flight decides it, the Gaussian answers.
"""

from __future__ import annotations

import math
import weakref
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
    """Equally probable outcomes, how they were found (`Probability.method`), and from how many rollouts."""

    method: str
    outcomes: RolloutOutcomes
    rollouts: int


_found: weakref.WeakKeyDictionary[Snapshot, tuple[_Source, ...]] = weakref.WeakKeyDictionary()


def probability(scene: Scene, initial: Belief, snapshot: Snapshot, event: Event) -> Probability:
    """Return the probability of an event at a snapshot's time, by the method with the narrowest interval.

    ``initial`` is the given belief at time 0.
    """
    if not event.needs_contacts and not event.names & {body.name for body in scene.bodies if body.free}:
        mean = RolloutOutcomes(scene, initial.mean, snapshot.belief.mean[None])
        return _counted(event, _Source("certain", mean, 1))
    return _best(event, _sources(scene, initial, snapshot))[0]


def contact_time(scene: Scene, initial: Belief, snapshot: Snapshot, event: Touches) -> ContactTime | None:
    """Return the time of the first contact, given that there is one; None if no outcome has a contact.

    The arguments are those of `probability`.
    """
    _, best = _best(event, _sources(scene, initial, snapshot))
    times = event.first_times(best.outcomes).astype(float)
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


def interval(share: float, count: int) -> tuple[float, float]:
    """Return the bounds of a probability from a share of ``count`` draws (Wilson 1927)."""
    square = NORMAL_QUANTILE**2 / count
    middle = (share + 0.5 * square) / (1.0 + square)
    half = NORMAL_QUANTILE * math.sqrt(share * (1.0 - share) / count + 0.25 * square / count) / (1.0 + square)
    # exact at the ends, where round-off would leave a remainder
    return 0.0 if share == 0.0 else middle - half, 1.0 if share == 1.0 else middle + half


def _best(event, sources):
    """Return the probability of an event with the narrowest interval, and its source."""
    found = [(_counted(event, source), source) for source in sources]
    return min(found, key=lambda pair: pair[0].high - pair[0].low)


def _counted(event, source):
    """Return the probability of an event from one source."""
    certainly, possibly = event.bounds(source.outcomes)
    low, high = float(certainly.mean()), float(possibly.mean())
    estimate = 0.5 * (low + high)
    if source.method == "gaussian":
        low, high = 0.0, 1.0
    elif source.method != "certain":
        low, high = interval(low, source.rollouts)[0], interval(high, source.rollouts)[1]
    # round-off must not leave the estimate outside
    return Probability(estimate, min(low, estimate), max(high, estimate), source.method, source.rollouts)


def _sources(scene, initial, snapshot):
    """Return the sources in which events are counted: rollouts with their contacts, and flights."""
    if snapshot not in _found:
        _found[snapshot] = _sources_of(scene, initial, snapshot)
    return _found[snapshot]


def _sources_of(scene, initial, snapshot):
    states, first, start = snapshot.rollout_states, snapshot.first_contacts, initial.mean
    if is_certain(scene, initial, snapshot):
        only = snapshot.belief.mean[None] if states is None else states[:1]
        certain = _Source("certain", RolloutOutcomes(scene, start, only, first[:1]), 1)
        return (certain,)
    found = []
    if states is None:  # ahead of flights: these count only where their interval is narrower
        drawn = snapshot.belief.sample(_DRAWN, np.random.default_rng(0))
        outcomes = RolloutOutcomes(scene, start, drawn, first[np.arange(_DRAWN) % len(first)])
        found.append(_Source("gaussian", outcomes, len(first)))
    else:
        found.append(_Source("samples", RolloutOutcomes(scene, start, states, first), len(states)))
    if snapshot.flights is not None:
        outcomes = RolloutOutcomes(scene, start, *snapshot.flights)
        found.append(_Source("flights", outcomes, len(outcomes.states)))
    return tuple(found)
