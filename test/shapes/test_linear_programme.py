"""Linear programmes of the packing against SciPy's `linprog`."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from scipy.optimize import linprog

from unc_physics.shapes.linear_programme import minimum


def test_solutions_are_those_of_linprog_to_the_last_bit():
    rng = np.random.default_rng(4)
    solved = 0
    for _ in range(200):
        rows, cost = rng.normal(size=(12, 5)) * (rng.random((12, 5)) < 0.7), rng.normal(size=5)
        limits = rng.normal(size=12) + 0.5
        low, high = -rng.random(5), np.array([*rng.random(3), np.inf, np.inf])
        right = linprog(cost, rows, limits, bounds=np.column_stack([low, high]), method="highs")
        found = minimum(cost, rows, limits, low, high)
        assert (found is None) == (right.status != 0)
        if found is not None:
            solved += 1
            assert np.array_equal(found[0], right.x) and found[1] == right.fun
    assert 20 < solved < 180  # others have no solution, or none that is the least


def test_threads_do_not_share_a_solver():
    rng = np.random.default_rng(5)
    given = [
        (rng.normal(size=5), rng.normal(size=(40, 5)), rng.random(40), -np.ones(5), np.ones(5))
        for _ in range(400)
    ]
    with ThreadPoolExecutor(8) as pool:
        found = list(pool.map(lambda each: minimum(*each), given))
    for own, alone in zip(found, (minimum(*each) for each in given), strict=True):
        assert np.array_equal(own[0], alone[0]) and own[1] == alone[1]
