"""The search on scores that are known: the least is found, and as surely as it says."""

import numpy as np
import pytest
from throws import scene

from unc_physics.calibration.adjustable import Model, chosen
from unc_physics.calibration.quadratic import fit_quadratic, least_in_box
from unc_physics.calibration.search import Search

NAMES = ("friction", "restitution", "impact_point_std")
STEEP = np.array([[2.0, 0.6, 0.0], [0.6, 1.0, 0.0], [0.0, 0.0, 0.0]])
BEST = np.array([-4.0, 3.0, 1.0])  # in steps of each
MOTIONS = 40


class Known:
    """A quadratic for each motion, whose least differs; the last value changes nothing."""

    def __init__(self, adjusted):
        self.adjusted = adjusted
        rng = np.random.default_rng(0)
        self.least = BEST + 0.5 * rng.standard_normal((MOTIONS, 3))
        self.least[:, :2] += BEST[:2] - self.least[:, :2].mean(axis=0)

    def per_motion(self, model):
        x = np.array([one.scaled(one.get(model)) for one in self.adjusted])
        d = x - self.least
        return 0.5 * np.einsum("mi,ij,mj->m", d, STEEP, d)


@pytest.fixture(scope="module")
def search():
    model = Model(scene(), 1e-3, 1e-3)
    adjusted = chosen(model.scene, NAMES)
    search = Search(Known(adjusted), model, adjusted, 40)
    search.approach()
    search.run(12)
    search.settle(40 - search.tried)
    return search


def test_it_finds_the_least_with_the_models_it_may_try(search):
    values = search.estimate().values
    found = [one.scaled(values[one.name]) for one in search.adjusted]
    assert search.tried <= 42
    assert found[:2] == pytest.approx(BEST[:2], abs=0.15)


def test_it_is_as_sure_as_motions_agree(search):
    estimate = search.estimate()
    spread = np.std(search.objective.least, axis=0, ddof=1) / np.sqrt(MOTIONS)
    for one, known in list(zip(search.adjusted, spread, strict=True))[:2]:
        scale = one.step * (estimate.values[one.name] if one.relative else 1.0)
        assert estimate.stds[one.name] == pytest.approx(scale * known, rel=0.3), one.name
        assert estimate.settled[one.name], one.name


def test_it_says_what_it_cannot_know(search):
    """A value that changes nothing, and all of them where the search ends on a slope."""
    assert not search.estimate().settled["impact_point_std"]
    model = search.model
    short = Search(search.objective, model, search.adjusted, 8)
    short.settle(8)
    assert not short.estimate().settled["friction"]


def test_a_quadratic_is_found_again():
    rng = np.random.default_rng(1)
    points = rng.uniform(-1.0, 1.0, (40, 3))
    values = 1.0 + points @ [0.5, -1.0, 0.0] + 0.5 * np.einsum("ki,ij,kj->k", points, STEEP, points)
    center = points[0]
    found = fit_quadratic(points, values[:, None], center, 4.0)
    assert found.hessian[0] == pytest.approx(STEEP, abs=0.05)
    assert found.slope[0] == pytest.approx(np.array([0.5, -1.0, 0.0]) + STEEP @ center, abs=0.05)


def test_the_least_in_a_box():
    low, high = np.full(3, -1.0), np.full(3, 2.0)
    g, H = np.array([1.0, -1.0, -0.5]), np.diag([1.0, 0.1, -1.0])
    assert least_in_box(g, H, low, high) == pytest.approx([-1.0, 2.0, 2.0])
