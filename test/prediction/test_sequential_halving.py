"""Races of coins: a best one is hardly ever called worse, clear losers get few tosses, the budget holds."""

import math

import numpy as np
import pytest
from scipy.stats import binom

from unc_physics.prediction.sequential_halving import FIRST_ROUND, SequentialHalving, chance, wins_and_losses

ROLLOUTS, BUDGET = 1000, 2000
STATISTICS = 4.0  # standard errors


def tosses(rng, probabilities, common=True):
    """Outcomes (K, ROLLOUTS) of coins: heads below a number that all share, or that each has of its own."""
    u = rng.uniform(size=(1 if common else len(probabilities), ROLLOUTS))
    return u < np.array(probabilities)[:, None]


def run(halving, outcomes):
    """The halving to its end, with these outcomes (K, ROLLOUTS)."""
    while halving.remaining:
        halving.add({k: outcomes[k, : halving.count] for k in halving.remaining})
    return halving


def test_the_chance_is_a_bound_of_the_sign_test():
    for pairs in (1, 5, 40, 300):
        for wins in range(pairs + 1):
            exact = binom.sf(wins - 1, pairs, 0.5)
            assert exact <= chance(wins, pairs - wins) * (1.0 + 1e-9)
        assert chance(pairs, 0) == pytest.approx(min((pairs + 1) * 0.5**pairs, 1.0))
    assert chance(0, 0) == 1.0


def test_the_chance_holds_however_often_one_looks():
    """Of fair pairs, looked at after each: the sign test alone would find many, this few."""
    level, runs = 0.1, 1000
    wins = np.cumsum(np.random.default_rng(0).uniform(size=(runs, 300)) < 0.5, axis=1)
    found = naive = 0
    for own in wins.tolist():
        found += any(chance(w, m - w) <= level for m, w in enumerate(own, 1))
        naive += any(binom.sf(w - 1, m, 0.5) <= level for m, w in list(enumerate(own, 1))[::20])
    assert 0 < found <= level * runs + STATISTICS * math.sqrt(level * runs)
    assert naive > 2 * level * runs


@pytest.mark.parametrize("common", [True, False])
def test_a_best_one_is_rarely_called_worse(common):
    """Ten looks at equal coins would find a difference often, if each look were tested by itself."""
    rng, risk, races = np.random.default_rng(0), 0.2, 400
    probabilities = [0.5] * 6 if not common else [0.5, 0.5, 0.5, 0.49, 0.48, 0.3]
    called = naive = 0
    for _ in range(races):
        outcomes = tosses(rng, probabilities, common)
        halving = run(SequentialHalving(range(6), ROLLOUTS, 6 * ROLLOUTS, risk), outcomes)
        called += 0 in halving.losers
        leader = outcomes[outcomes[:, :64].mean(axis=1).argmax(), :64]
        naive += chance(*wins_and_losses(leader, outcomes[0, :64])[:2]) <= 0.9
    assert called <= risk * races + STATISTICS * math.sqrt(risk * races)
    assert common or 0 < called < naive, "the case must be one in which errors happen"


def test_clear_losers_get_few_tosses_and_the_best_ones_most():
    rng = np.random.default_rng(1)
    probabilities = [0.05, 0.9, 0.1, 0.8, 0.0, 0.95, 0.3, 0.2, 0.6, 0.15]
    regrets = []
    for _ in range(50):
        halving = run(SequentialHalving(range(10), ROLLOUTS, BUDGET), tosses(rng, probabilities, False))
        counts = [len(halving.outcomes[k]) for k in range(10)]
        assert sum(counts) == halving.spent <= BUDGET
        assert max(counts[0], counts[2], counts[4]) <= 4 * FIRST_ROUND and {0, 2, 4} <= halving.losers
        assert len(halving.outcomes[halving.order[0]]) == max(counts) > ROLLOUTS / 2
        regrets.append(max(probabilities) - probabilities[halving.order[0]])
    assert np.mean(regrets) < 0.01


@pytest.mark.parametrize("rollouts", [50, 160, ROLLOUTS])
def test_with_a_budget_for_all_only_clear_losers_leave(rollouts):
    outcomes = tosses(np.random.default_rng(2), [0.515, 0.52, 0.512, 0.05])[:, :rollouts]
    halving = run(SequentialHalving(range(4), rollouts, 4 * rollouts), outcomes)
    assert [len(halving.outcomes[k]) for k in range(3)] == [rollouts] * 3 and halving.losers == {3}
    assert len(halving.outcomes[3]) <= 40
    assert halving.order[:3] == sorted(range(3), key=lambda k: -outcomes[k].mean())
    assert halving.difference(1, 1) == (0.0, 0.0, rollouts)
    assert halving.difference(0, 2).value == pytest.approx(outcomes[0].mean() - outcomes[2].mean())


@pytest.mark.parametrize(
    ("candidates", "rollouts", "budget", "counts"),
    [
        (5, ROLLOUTS, 5, [1] * 5),
        (1, ROLLOUTS, ROLLOUTS, [ROLLOUTS]),
        (1, ROLLOUTS, 30, [30]),
        (3, 7, 21, [7] * 3),
        (4, 100, 250, [100, 100, 20, 20]),
    ],
)
def test_equal_candidates_share_the_budget(candidates, rollouts, budget, counts):
    """No one loses; equals keep the order in which they were given."""
    halving = run(SequentialHalving(range(candidates), rollouts, budget), np.ones((candidates, 1000), bool))
    assert [len(halving.outcomes[k]) for k in range(candidates)] == counts
    assert halving.order == halving.ties() == [*range(candidates)] and not halving.losers


def test_a_candidate_without_outcomes_is_in_no_order():
    outcomes = tosses(np.random.default_rng(4), [0.9, 0.5, 0.95, 0.1])
    halving = SequentialHalving(range(4), 80, 320)
    halving.add({k: outcomes[k, : halving.count] for k in halving.remaining})
    halving.add({k: outcomes[k, : halving.count] for k in (0, 1)})
    run(halving, outcomes)
    assert {0, 1} <= {*halving.order} <= {0, 1, 3} and not halving.remaining
    assert halving.spent == sum(len(halving.outcomes[k]) for k in halving.order)
    halving = SequentialHalving(range(4), 80, 320)
    halving.add({})
    assert not halving.order and not halving.ties() and not halving.remaining and halving.spent == 0


def test_the_error_of_a_difference_is_that_of_pairs():
    one, other = tosses(np.random.default_rng(3), [0.6, 0.55])
    halving = SequentialHalving("ab", ROLLOUTS, 2 * ROLLOUTS)
    halving.add({"a": one, "b": other})
    found = halving.difference("a", "b")
    pairs = one.astype(float) - other
    assert found.value == pairs.mean() and found.draws == ROLLOUTS
    assert found.std == pytest.approx(pairs.std() / math.sqrt(ROLLOUTS), rel=0.02)
    independent = math.sqrt((one.var() + other.var()) / ROLLOUTS)
    assert found.std < 0.5 * independent, "common draws must pay"
    halving.add({"a": one[:16], "b": ~one[:16]})
    assert halving.difference("a", "b").std > 0.0
