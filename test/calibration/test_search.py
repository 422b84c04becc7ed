"""The search on scores that are known: the least is found, and as certainly as it says."""

import numpy as np
import pytest
from throws import scene

from unc_physics import UncPhysicsError
from unc_physics.calibration.adjustable import Model, chosen
from unc_physics.calibration.posterior import Posterior, prior_weight
from unc_physics.calibration.search import Search
from unc_physics.calibration.uncertainty import refine

NAMES = ("friction", "restitution", "impact_point_std")
STEEP = np.array([[4.0, 1.2, 0.0], [1.2, 2.0, 0.0], [0.0, 0.0, 0.0]])
MODEL = Model(scene(friction=0.5, restitution=0.5), 1e-3, 1e-3)
ADJUSTED = chosen(MODEL.scene, NAMES)
OFF = np.array([-1.5, 1.0, 0.0])  # of the least from the priors, in their standard deviations
MOTIONS = 40


class Known:
    """A quadratic for each motion, whose least differs; the last value changes nothing."""

    def __init__(self, count=MOTIONS):
        self.recorded = range(count)
        self.median = Posterior(self, MODEL, ADJUSTED).median
        spread = 0.5 * np.random.default_rng(0).standard_normal((count, 3))
        self.least = self.median + OFF + spread - spread.mean(axis=0)

    def per_motion(self, model):
        d = np.array([one.scaled(one.get(model)) for one in ADJUSTED]) - self.least
        return 0.5 * np.einsum("mi,ij,mj->m", d, STEEP, d)


def found(count=MOTIONS):
    """The known scores, what is estimated, and the scores that were tried."""
    known, told = Known(count), []
    posterior = Posterior(known, MODEL._replace(), ADJUSTED, told.append)
    search = Search(posterior)
    search.approach()
    search.run(20)
    return known, refine(posterior, search.best), told


def penalised(known):
    """The least of the penalised score (3,), and its second derivatives, in closed form."""
    weight = prior_weight(len(known.recorded)) / len(known.recorded)
    H = STEEP + weight * np.eye(3)
    return known.median + np.linalg.solve(H, STEEP @ OFF), H


@pytest.mark.parametrize("count", [3, MOTIONS])
def test_it_finds_the_least_of_the_penalised_score(count):
    known, estimate, told = found(count)
    assert estimate.x == pytest.approx(penalised(known)[0], abs=0.02)
    assert len(told) < 60


def test_few_motions_stay_nearer_to_the_prior():
    offs = [np.linalg.norm(penalised(Known(count))[0] - Known(count).median) for count in (1, 3, MOTIONS)]
    assert offs[0] < offs[1] < offs[2] < np.linalg.norm(OFF)


def test_it_is_as_certain_as_motions_agree():
    """The sandwich estimator in closed form, with a prior's own error."""
    known, estimate, _ = found()
    H, weight = penalised(known)[1], prior_weight(MOTIONS) / MOTIONS
    spread = STEEP @ np.cov(known.least.T) @ STEEP / MOTIONS + weight**2 * np.eye(3)
    stds = np.sqrt(np.diagonal(np.linalg.solve(H, np.linalg.solve(H, spread).T)))
    ratio = estimate.stds[:2] / stds[:2]  # the larger of two estimates, so above 1 on the whole
    assert (ratio > 0.95).all() and (ratio < 1.5).all()
    assert estimate.determined[:2].all()


def test_a_value_that_changes_nothing_keeps_its_prior():
    known, estimate, _ = found()
    assert estimate.x[2] == pytest.approx(known.median[2], abs=1e-6)
    assert estimate.stds[2] == pytest.approx(1.0) and not estimate.determined[2]


def test_a_model_that_cannot_be_simulated_is_no_candidate():
    known = Known()

    def fails(model):
        if model.scene.friction < 0.4:
            raise UncPhysicsError("diverged")
        return known.per_motion(model)

    broken = Known()
    broken.per_motion = fails
    search = Search(Posterior(broken, MODEL, ADJUSTED))
    search.approach()
    assert ADJUSTED[0].unscaled(search.best[0]) >= 0.4
