"""Sequential halving with common random numbers: candidates that clearly lose get few rollouts.

Rollout k of every candidate begins with the same draws, so outcomes are compared in pairs. Only rollouts in
which two candidates differ count. A candidate that wins no more often than another one wins at most half of
these (the sign test). A mixture of likelihood ratios bounds the probability of its wins. The bound holds for
any number of tests, after any number of draws (Robbins 1970, by Ville's inequality).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np

#: Largest probability that the best candidate is called clearly worse.
RISK = 1e-3
#: Rollouts of each candidate in the first round.
FIRST_ROUND = 20


class Difference(NamedTuple):
    """Difference between the probabilities of an event by two candidates."""

    value: float  # of the draws that both have
    #: its standard error, with half a draw added to each of the four outcomes of a pair (Agresti and Min
    #: 2005), so that it is not 0 where few draws agree
    std: float
    draws: int


def wins_and_losses(one: np.ndarray, other: np.ndarray) -> tuple[int, int, int]:
    """Return how many pairs of outcomes (n,), (m,) bool only one side has, and the number of pairs."""
    count = min(len(one), len(other))
    one, other = one[:count], other[:count]
    return int(np.count_nonzero(one & ~other)), int(np.count_nonzero(other & ~one)), count


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


class SequentialHalving:
    """Sequential halving: the choice, round by round, of candidates that get more rollouts.

    Every round doubles the rollouts of the remaining candidates. Before a round, clear losers are dropped. If
    the budget does not suffice for all rollouts of the others, the last ones are dropped, too: the rest of
    the budget is divided evenly among the remaining rounds, so that about half of the candidates remain each
    time (successive halving, Karnin et al. 2013). At least two remain unless one is a clear loser. A last
    single candidate gets all rollouts that are left to it.

    Parameters
    ----------
    candidates : iterable of str
        Their names.
    rollouts : int
        Largest number of one candidate.
    budget : int
        Largest number of all candidates, at least one for each.
    risk : float
        Largest probability that the best candidate is called clearly worse.

    Attributes
    ----------
    outcomes : dict of str to (n,) bool array
        Successes of each candidate's rollouts so far.
    order : list of str
        Candidates: the best one, then the others by their difference from it.
    losers : set of str
        Candidates that are clearly worse than another one.
    remaining : list of str
        Candidates of the next round; empty after the last one.
    count : int
        Rollouts of each remaining candidate after the next round.
    """

    def __init__(self, candidates: Iterable[str], rollouts: int, budget: int, risk: float = RISK):
        self._rollouts, self._budget = rollouts, budget
        self.outcomes = {name: np.zeros(0, bool) for name in candidates}
        self._limit = risk / max(len(self.outcomes) - 1, 1)  # of each pair with the best candidate
        self.losers: set[str] = set()
        self.order, self.remaining = list(self.outcomes), list(self.outcomes)
        self.count = min(FIRST_ROUND, rollouts, budget // len(self.outcomes))

    @property
    def spent(self) -> int:
        """Rollouts of all candidates so far."""
        return sum(map(len, self.outcomes.values()))

    def add(self, outcomes: Mapping[str, np.ndarray]) -> None:
        """Take all outcomes so far of the remaining candidates, and decide on the next round.

        A remaining candidate without outcomes cannot be simulated, and leaves.
        """
        failed = set(self.remaining) - outcomes.keys()
        known = {name: own for name, own in self.outcomes.items() if name not in failed}
        self.outcomes, self.remaining = {name: outcomes.get(name, own) for name, own in known.items()}, []
        self.order = [name for name in self.order if name in known]
        if not outcomes:
            return
        # of equals the first ones stay first
        left = sorted(outcomes, key=lambda name: -self.outcomes[name].mean())
        best = left[0]
        for name in left:
            wins, losses, _ = wins_and_losses(self.outcomes[best], self.outcomes[name])
            if chance(wins, losses) <= self._limit:
                self.losers.add(name)
        others = sorted(known, key=lambda name: -self.difference(name, best).value)
        self.order = [best, *(name for name in others if name != best)]
        self._choose([name for name in left if name not in self.losers])

    def _choose(self, left):
        """Choose the candidates of the next round out of ``left``, and the rollouts of each after it."""
        count, rest = self.count, self._budget - self.spent
        if count >= self._rollouts or rest < len(left):
            return
        wanted = self._rollouts if len(left) == 1 else min(2 * count, self._rollouts)
        if len(left) > 1 and rest < len(left) * (self._rollouts - count):
            rounds = math.ceil(math.log2(self._rollouts / count))
            left = left[: max(rest // rounds // (wanted - count), 2)]
        self.remaining, self.count = left, min(wanted, count + rest // len(left))

    def difference(self, name: str, other: str) -> Difference:
        """Return the difference of success between two candidates, over the draws that both have."""
        wins, losses, count = wins_and_losses(self.outcomes[name], self.outcomes[other])
        if name == other:
            return Difference(0.0, 0.0, count)
        up, down = (wins + 0.5) / (count + 2), (losses + 0.5) / (count + 2)
        std = math.sqrt((up + down - (up - down) ** 2) / (count + 2))
        return Difference(float(wins - losses) / count, std, count)

    def ties(self) -> list[str]:
        """Return the candidates within a standard error of the best one, which comes first."""
        differences = {k: self.difference(k, self.order[0]) for k in self.order if k not in self.losers}
        return [k for k, found in differences.items() if abs(found.value) <= found.std]
