"""Linear programmes of the packing against SciPy's `linprog`."""

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
