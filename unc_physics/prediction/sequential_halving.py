"""Sequential halving with common random numbers: actions that clearly lose get few rollouts.

Rollout k of every action begins with the same draws, so outcomes are compared in pairs. Only rollouts in
which two actions differ count. An action that wins no more often than another one wins at most half of
these (the sign test). A mixture of likelihood ratios tells how improbable its wins then are; it may be looked
at as often as wanted, after any number of draws (Robbins 1970, by Ville's inequality).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

#: Probability that the best action is among those that are called clearly worse, at most.
RISK = 1e-3
#: Rollouts of each action before any is judged.
FIRST_ROUND = 20


class Difference(NamedTuple):
    """Difference between the probabilities of an event by two actions."""

    value: float  # of the draws that both have
    #: its standard error, with half a draw added to each of the four outcomes of a pair (Agresti and Min
    #: 2005), so that it is not 0 where few draws agree
    std: float
    draws: int

    @property
    def is_tie(self) -> bool:
        """Whether it is within its standard error."""
        return abs(self.value) <= self.std


def difference(one: np.ndarray, other: np.ndarray) -> Difference:
    """Return the difference from outcomes (n,) and (m,) bool; equal indices share their draws."""
    count = min(len(one), len(other))
    better = np.count_nonzero(one[:count] & ~other[:count])
    worse = np.count_nonzero(other[:count] & ~one[:count])
    up, down = (better + 0.5) / (count + 2), (worse + 0.5) / (count + 2)
    std = math.sqrt((up + down - (up - down) ** 2) / (count + 2))
    return Difference(float(better - worse) / count, std, count)


def chance(wins: int, losses: int) -> float:
    """Upper bound of the probability that wins among pairs that differ, each won with probability one half at
    most, ever come to be as many as this against the losses.

    It is ``(m + 1) binomial(m, wins) / 2^m`` for m pairs: the inverse of their likelihood, averaged over all
    probabilities to win, over that of one half.
    """
    pairs = wins + losses
    if wins <= losses:
        return 1.0
    ways = math.lgamma(pairs + 1) - math.lgamma(wins + 1) - math.lgamma(losses + 1)
    return min(1.0, math.exp(math.log(pairs + 1) + ways - pairs * math.log(2.0)))


def clearly_worse(outcomes: Sequence[np.ndarray], leader: int, limit: float) -> np.ndarray:
    """(K,) bool: which are worse than the leader, with a `chance` of at most ``limit`` if they were not."""
    first = outcomes[leader]
    found = np.zeros(len(outcomes), bool)
    for k, own in enumerate(outcomes):
        count = min(len(own), len(first))
        wins = int(np.count_nonzero(first[:count] & ~own[:count]))
        losses = int(np.count_nonzero(own[:count] & ~first[:count]))
        found[k] = chance(wins, losses) <= limit
    return found


class Round(NamedTuple):
    """Actions that get more rollouts, and the number of rollouts that each has afterwards."""

    actions: tuple[int, ...]
    rollouts: int


class SequentialHalving:
    """Decides, round by round, which actions get more rollouts.

    Every round doubles the rollouts of those that are left. Before it, clear losers leave, and so do the last
    ones while the budget has no room for all: what is left of it is shared evenly among the rounds to come,
    so that about half of the actions stay each time (successive halving, Karnin et al. 2013). Two stay in any
    case, unless one is a clear loser; the last one gets what it may, to be known well.

    ``rollouts`` are the most of one action, and ``budget`` the most of all together, at least one for each.
    ``risk`` is the probability, at most, that the best action is among those that are called clearly worse.

    Attributes
    ----------
    outcomes : list of (n,) bool arrays
        Of each action's rollouts so far: whether it succeeded.
    left : list of int
        Actions that are still ranked; the best one first, once there are outcomes.
    losers : set of int
        Those that are clearly worse than another one.
    next : Round or None
        The next round; None after the last one.
    """

    def __init__(self, actions: int, rollouts: int, budget: int, risk: float = RISK):
        self._rollouts, self._budget = rollouts, budget
        self.outcomes = [np.zeros(0, bool) for _ in range(actions)]
        self.left, self.losers = list(range(actions)), set()
        first = min(FIRST_ROUND, rollouts, budget // actions)
        self._limit = risk / max(actions - 1, 1)  # of each pair with the best action
        self.next: Round | None = Round(tuple(self.left), first)

    @property
    def spent(self) -> int:
        """Rollouts of all actions so far."""
        return sum(map(len, self.outcomes))

    def add(self, outcomes: Sequence[np.ndarray]) -> None:
        """Add the further outcomes of the round's actions, and decide on the next round."""
        done = self.next
        assert done is not None
        for k, further in zip(done.actions, outcomes, strict=True):
            self.outcomes[k] = np.concatenate([self.outcomes[k], further])
        self.left.sort(key=lambda k: -self.outcomes[k].mean())  # of equals, the first ones stay first
        worse = clearly_worse([self.outcomes[k] for k in self.left], 0, self._limit)
        self.losers |= {k for k, is_worse in zip(self.left, worse, strict=True) if is_worse}
        self.left = [k for k, is_worse in zip(self.left, worse, strict=True) if not is_worse]
        self.next = self._following(done.rollouts)

    def _following(self, count):
        """The round after one with so many rollouts of each."""
        rest = self._budget - self.spent
        if count >= self._rollouts or rest < len(self.left):
            return None
        if len(self.left) == 1:
            return Round(tuple(self.left), min(self._rollouts, count + rest))
        rounds = math.ceil(math.log2(self._rollouts / count))
        wanted = min(2 * count, self._rollouts)
        room = rest // rounds // (wanted - count)
        self.left = self.left[: max(room, 2)]
        return Round(tuple(self.left), min(wanted, count + rest // len(self.left)))

    def order(self) -> list[int]:
        """All actions: the best one, then the others by their difference from it."""
        best = self.left[0]
        others = [k for k in range(len(self.outcomes)) if k != best]
        return [best, *sorted(others, key=lambda k: -self.difference(k, best).value)]

    def difference(self, k: int, other: int) -> Difference:
        """Return the difference of success between two actions."""
        if k == other:
            return Difference(0.0, 0.0, len(self.outcomes[k]))
        return difference(self.outcomes[k], self.outcomes[other])

    def ties(self) -> list[int]:
        """Actions within a standard error of the best one, which comes first."""
        best = self.left[0]
        return [k for k in self.order() if k not in self.losers and self.difference(k, best).is_tie]
