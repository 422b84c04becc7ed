"""Sequential halving with common random numbers: actions that clearly lose get few rollouts.

Rollout k of every action begins with the same draws, so outcomes are compared in pairs. Only rollouts in
which two actions differ count. An action that wins no more often than another one wins at most half of
these (the sign test). A mixture of likelihood ratios bounds the probability of its wins. The bound holds for
any number of tests, after any number of draws (Robbins 1970, by Ville's inequality).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

#: Largest probability that the best action is called clearly worse.
RISK = 1e-3
#: Rollouts of each action in the first round.
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
    """Return an upper bound of the probability that wins ever exceed losses by as much as observed.

    Only pairs that differ count, and each of them is won with a probability of at most one half. The bound is
    ``(m + 1) binomial(m, wins) / 2^m`` for m pairs: the inverse of their likelihood, averaged over all
    probabilities to win, over their likelihood at one half.
    """
    pairs = wins + losses
    if wins <= losses:
        return 1.0
    ways = math.lgamma(pairs + 1) - math.lgamma(wins + 1) - math.lgamma(losses + 1)
    return min(1.0, math.exp(math.log(pairs + 1) + ways - pairs * math.log(2.0)))


def clearly_worse(outcomes: Sequence[np.ndarray], leader: int, limit: float) -> np.ndarray:
    """Return which actions (K,) are worse than the leader, by a `chance` of at most ``limit``."""
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
    """Sequential halving: the choice, round by round, of actions that get more rollouts.

    Every round doubles the rollouts of the remaining actions. Before a round, clear losers are dropped. If
    the budget does not suffice for the other actions, the last ones are dropped, too: the rest of the budget
    is divided evenly among the remaining rounds, so that about half of the actions remain each time
    (successive halving, Karnin et al. 2013). At least two remain unless one is a clear loser. A last single
    action gets all rollouts that are left to it.

    Parameters
    ----------
    actions : int
    rollouts : int
        Largest number of one action.
    budget : int
        Largest number of all actions, at least one for each.
    risk : float
        Largest probability that the best action is called clearly worse.

    Attributes
    ----------
    outcomes : list of (n,) bool arrays
        Successes of each action's rollouts so far.
    left : list of int
        Remaining actions; the best one first, once there are outcomes.
    losers : set of int
        Actions that are clearly worse than another one.
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
        """Return the round after a round of ``count`` rollouts of each action."""
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
        """Return all actions: the best one, then the others by their difference from it."""
        best = self.left[0]
        others = [k for k in range(len(self.outcomes)) if k != best]
        return [best, *sorted(others, key=lambda k: -self.difference(k, best).value)]

    def difference(self, k: int, other: int) -> Difference:
        """Return the difference of success between two actions."""
        if k == other:
            return Difference(0.0, 0.0, len(self.outcomes[k]))
        return difference(self.outcomes[k], self.outcomes[other])

    def ties(self) -> list[int]:
        """Return the actions within a standard error of the best one, which comes first."""
        best = self.left[0]
        return [k for k in self.order() if k not in self.losers and self.difference(k, best).is_tie]
