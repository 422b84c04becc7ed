"""The search on scores that are known: the least is found, and as surely as it says."""

import numpy as np
import pytest
from throws import scene

from unc_physics.calibration.adjustable import Model, chosen
from unc_physics.calibration.search import Search
from unc_physics.calibration.uncertainty import refine

NAMES = ("friction", "restitution", "impact_point_std")
STEEP = np.array([[2.0, 0.6, 0.0], [0.6, 1.0, 0.0], [0.0, 0.0, 0.0]])
BEST = np.array([-4.0, 3.0, 1.0])  # in steps of each
MOTIONS = 40


class Known:
    """A quadratic for each motion, whose least differs; the last value changes nothing."""

    def __init__(self, adjusted, slope=0.0):
        self.adjusted, self.recorded, self.slope = adjusted, range(MOTIONS), slope
        rng = np.random.default_rng(0)
        self.least = BEST + 0.5 * rng.standard_normal((MOTIONS, 3))
        self.least[:, :2] += BEST[:2] - self.least[:, :2].mean(axis=0)
        self.own = 1.0 + 0.1 * rng.standard_normal(MOTIONS)

    def per_motion(self, model):
        x = np.array([one.scaled(one.get(model)) for one in self.adjusted])
        d = x - self.least
        return 0.5 * np.einsum("mi,ij,mj->m", d, STEEP, d) + self.slope * self.own * x[2]


def found(slope=0.0):
    """Where the search ends, in steps of each, and what is said of it."""
    model = Model(scene(), 1e-3, 1e-3)
    adjusted = chosen(model.scene, NAMES)
    known, told = Known(adjusted, slope), []
    search = Search(known, model, adjusted, told.append)
    search.approach()
    search.run(20)
    estimate = refine(known, known, model, adjusted, search.values, told.append)
    return known, adjusted, estimate, told


@pytest.fixture(scope="module")
def fitted():
    return found()


def test_it_finds_the_least(fitted):
    _, adjusted, estimate, told = fitted
    at = [one.scaled(estimate.values[one.name]) for one in adjusted]
    assert at[:2] == pytest.approx(BEST[:2], abs=0.02)
    assert len(told) < 90


def test_it_is_as_sure_as_motions_agree(fitted):
    known, adjusted, estimate, _ = fitted
    spread = np.std(known.least, axis=0, ddof=1) / np.sqrt(MOTIONS)
    for one, std in list(zip(adjusted, spread, strict=True))[:2]:
        scale = one.step * (estimate.values[one.name] if one.relative else 1.0)
        assert 0.95 < estimate.stds[one.name] / (scale * std) < 1.5, one.name
        assert estimate.settled[one.name], one.name


def test_it_says_what_it_cannot_know(fitted):
    """A standard deviation that changes nothing is 0, and may be anything."""
    _, _, estimate, _ = fitted
    assert estimate.values["impact_point_std"] == 0.0 and not estimate.settled["impact_point_std"]


def test_a_value_at_its_bound_has_an_upper_limit():
    """A score that rises by 1 +- 0.1 a step, in all motions: it is larger by a standard error at once."""
    _, adjusted, estimate, _ = found(slope=1.0)
    assert estimate.values["impact_point_std"] == 0.0 and estimate.settled["impact_point_std"]
    assert 0.0 < estimate.stds["impact_point_std"] <= 0.2 * adjusted[2].step
