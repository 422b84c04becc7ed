"""Pareto fronts."""

from unc_physics_evaluation.pareto import Choice, front, in_words


def choice(time, error, method="surrogate", samples=None):
    return Choice(method, samples, time, error)


def test_front_holds_what_nothing_beats():
    good = [choice(1.0, 5.0), choice(2.0, 3.0), choice(7.0, 1.0)]
    assert front([choice(3.0, 4.0), good[2], choice(2.0, 3.5), good[0], choice(8.0, 1.0), good[1]]) == good


def test_of_equally_fast_ones_the_most_accurate_stays():
    assert front([choice(1.0, 2.0), choice(1.0, 1.5)]) == [choice(1.0, 1.5)]


def test_front_in_words():
    words = in_words([choice(0.001, 5.0, "local_sampling"), choice(0.02, 1.5, "monte_carlo", 50)])
    assert words == "local sampling (1.00 ms, 5.00), then MC-50 (20.0 ms, 1.50)"
