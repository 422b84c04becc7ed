"""Pareto fronts."""

from unc_physics_evaluation.pareto import Choice, front


def choice(time, error):
    return Choice("surrogate", None, time, error)


def test_front_holds_what_nothing_beats():
    good = [choice(1.0, 5.0), choice(2.0, 3.0), choice(7.0, 1.0)]
    assert front([choice(3.0, 4.0), good[2], choice(2.0, 3.5), good[0], choice(8.0, 1.0), good[1]]) == good


def test_of_equally_fast_ones_the_most_accurate_stays():
    assert front([choice(1.0, 2.0), choice(1.0, 1.5)]) == [choice(1.0, 1.5)]
