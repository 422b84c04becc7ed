"""The search on scores that are known: the least is found, and as certainly as it says."""

from dataclasses import replace

import numpy as np
import pytest
from throws import scene

from unc_physics.calibration.adjustable import Model, adjustables, chosen, with_values
from unc_physics.calibration.posterior import Posterior, prior_weight
from unc_physics.calibration.search import ParameterSearch
from unc_physics.calibration.uncertainty import _along, _axis, _mixed, _std_from_increase, refine
from unc_physics.checks.errors import DivergedError, LimitExceededError

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
    search = ParameterSearch(posterior)
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
            raise DivergedError("diverged")
        return known.per_motion(model)

    broken = Known()
    broken.per_motion = fails
    search = ParameterSearch(Posterior(broken, MODEL, ADJUSTED))
    search.approach()
    assert ADJUSTED[0].unscaled(search.best[0]) >= 0.4


def test_other_errors_of_the_simulation_end_the_search():
    broken = Known()

    def runs_out_of_memory(model):
        raise LimitExceededError("needs more memory")

    broken.per_motion = runs_out_of_memory
    with pytest.raises(LimitExceededError):
        ParameterSearch(Posterior(broken, MODEL, ADJUSTED))


def test_values_that_make_up_for_each_other_are_as_uncertain_as_that():
    """Throws determine friction at 1.5 m/s well, and the speed that halves friction badly.

    The score is a quadratic of their logarithms, so that the sandwich estimator has a closed form.
    """
    laws = replace(MODEL.scene, impact_friction_speed=3.0)
    adjusted = chosen(laws, ("friction", "impact_friction_speed"))
    errors = np.random.default_rng(0).standard_normal((MOTIONS, 2)) * [0.1, 1.0]
    errors -= errors.mean(axis=0)
    stiff = np.array([20.0, 1.0])

    class Valley:
        recorded = range(MOTIONS)

        def per_motion(self, model):
            friction, speed = model.scene.friction, model.scene.impact_friction_speed
            way = np.log([friction / (1.0 + 1.5 / speed) / 0.3, speed / 2.5])
            return 0.5 * ((way - errors) ** 2 @ stiff)

    posterior = Posterior(Valley(), Model(laws, 1e-3, 1e-3), adjusted)
    search = ParameterSearch(posterior)
    search.approach()
    search.run(20)
    estimate = refine(posterior, search.best)
    speed, (a, b) = adjusted[1].unscaled(estimate.x[1]), (one.prior_std for one in adjusted)
    turn = np.array([[a, b * 1.5 / (speed + 1.5)], [0.0, b]])
    own, weight = turn.T @ (stiff[:, None] * turn), prior_weight(MOTIONS) / MOTIONS
    slopes = errors * stiff @ turn
    spread = (slopes.T @ slopes + 2.0 * own) / (MOTIONS + 3) / MOTIONS + weight**2 * np.eye(2)
    inverse = np.linalg.inv(own + weight * np.eye(2))
    ratio = estimate.stds / np.sqrt(np.diagonal(inverse @ spread @ inverse))
    assert (ratio > 0.85).all() and (ratio < 1.5).all()
    alone = np.sqrt(spread[0, 0]) / (own[0, 0] + weight)
    assert estimate.stds[0] > 1.5 * alone


@pytest.mark.parametrize("laws", [{}, {"impact_friction_speed": 3.0, "friction_std": 0.2}])
def test_all_values_within_bounds_fit_together(laws):
    given = replace(MODEL.scene, **laws)
    adjusted, rng = list(adjustables(given).values()), np.random.default_rng(0)
    for _ in range(50):
        values = {one.name: one.low + rng.random() ** 3 * (one.high - one.low) for one in adjusted}
        model = with_values(MODEL._replace(scene=given), adjusted, values)
        assert model.scene.friction == pytest.approx(values["friction"])
        assert model.scene.friction_std == pytest.approx(min(values["friction_std"], values["friction"]))


class Quadratic:
    """Scores of motions that are quadratics of two values within bounds of -3 and 7."""

    low, high, curvature = np.full(2, -3.0), np.full(2, 7.0), 0.0
    hessian = np.array([[3.0, 1.0], [1.0, 2.0]])

    def __init__(self, least=(1.0, 2.0), motions=30):
        self.least, errors = np.array(least), np.random.default_rng(0).standard_normal((motions, 2))
        self.slopes = errors - errors.mean(axis=0)

    def at(self, x):
        d = x - self.least
        return 7.0 + 0.5 * d @ self.hessian @ d + self.slopes @ d

    def moved(self, x, k, by):
        return np.clip(x + by * np.eye(2)[k], self.low, self.high)

    def directions(self, x):
        return np.eye(2)


@pytest.mark.parametrize("place", [-3.0, -2.9, -2.6, -2.0, 2.0, 6.2, 6.9, 7.0])
def test_differences_of_a_quadratic_are_exact_beside_a_bound(place):
    """On both sides, or twice on one side where the bound is closer than three tenths of a step."""
    scores, step = Quadratic(), 0.8
    for k in range(2):
        x = np.array([3.0, 3.0])
        x[k] = place
        axis = _along(scores, x, scores.at(x), k, step)
        assert axis.curvature == pytest.approx(np.full(30, scores.hessian[k, k]))
        assert axis.slope == pytest.approx(scores.slopes[:, k] + scores.hessian[k] @ (x - scores.least))
        points = sorted((axis.step, axis.opposite))
        expected = {
            -3.0: (0.8, 1.6),
            -2.9: (0.8, 1.6),
            -2.6: (-0.4, 0.8),
            6.9: (-1.6, -0.8),
            7.0: (-1.6, -0.8),
        }
        assert points == pytest.approx(expected.get(place, (-0.8, 0.8)))
    first, second = (_along(scores, x, scores.at(x), k, step) for k in range(2))
    assert _mixed(scores, x, scores.at(x), (0, first), (1, second)) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("curvature", "error", "slope", "step"),
    [
        (3.0, 0.9, 2.0, 0.7),  # it curves by 3.3 standard errors
        (3.0, 1.1, 2.0, 1.4),  # by 2.7, also over twice the step
        (30.0, 0.0, 30.0, 0.7),
        (300.0, 0.0, 3.0, None),  # six standard deviations
    ],
)
def test_steps_are_longer_than_the_noise_and_not_wider_than_the_curve(curvature, error, slope, step):
    """The curvature's standard error is given, and the standard deviation of the slopes of 30 motions."""
    noise = np.random.default_rng(0).standard_normal((2, 30))
    noise = (noise - noise.mean(axis=1)[:, None]) / noise.std(axis=1, ddof=1)[:, None]
    scores, own = Quadratic((2.0, 2.0)), curvature + error * np.sqrt(30.0) * noise[0]
    scores.at = lambda x: 0.5 * own * (x[1] - 2.0) ** 2 + slope * noise[1] * (x[1] - 2.0)
    found = _axis(scores, scores.least, scores.at(scores.least), 1)
    alone = np.sqrt((29.0 * slope**2 + 2.0 * curvature) / 33.0 / 30.0) / curvature
    assert found.step == pytest.approx(6.0 * alone if step is None else step)
    assert found.curvature == pytest.approx(own) and found.opposite == pytest.approx(-found.step)


@pytest.mark.parametrize(("bumps", "share"), [((), 1.0), ((1.0,), 0.5), ((1.0, 0.5), 0.0)])
def test_the_least_of_the_quadratic_counts_only_if_it_is_less(bumps, share):
    """Where the score is larger there, half of the way is tried."""
    scores, way = Quadratic(), np.array([0.4, -0.3])
    start, plain = scores.least - way, scores.at
    places = [start + bump * way for bump in bumps]
    scores.at = lambda x: plain(x) + 50.0 * any(np.abs(x - place).max() < 1e-3 for place in places)
    assert refine(scores, start).x == pytest.approx(start + share * way, abs=1e-9)


@pytest.mark.parametrize("guess", [0.3, 1.0, 3.0])
def test_a_standard_deviation_is_that_of_the_distance_to_a_clear_increase(guess):
    """Of a quadratic it is known: the standard error of the slopes over the curvature."""
    scores = Quadratic()
    along = np.linalg.inv(scores.hessian)[:, 0] / np.linalg.inv(scores.hessian)[0, 0]
    slopes = scores.slopes @ along
    std = slopes.std(ddof=1) / np.sqrt(30.0) / (along @ scores.hessian @ along)
    found = _std_from_increase(scores, scores.least, scores.at(scores.least), 0, along, guess * std)
    assert found == pytest.approx(std)
    near = Quadratic((0.5 * std - 3.0, 2.0))  # the bound comes first on one side
    found = _std_from_increase(near, near.least, near.at(near.least), 0, along, guess * std)
    assert found == pytest.approx(0.5 * np.sqrt(0.5 * (0.5**2 + 2.0**2)) * std)
