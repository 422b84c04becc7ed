"""Linearization, surrogate and local sampling on everyday steps: impacts by hand, rest, and its flags."""

import numpy as np
import pytest
from plain_scenes import BALL, box, independent, state

from unc_physics import RigidBody, Scene, make_propagator, predict
from unc_physics.prediction.body_status import Status
from unc_physics.prediction.status import assess
from unc_physics.scene.environment import Plane
from unc_physics.spatial.layout import ERR_POSITION, ERR_ROTATION, ERR_VELOCITY, VELOCITY

AFTER = 0.005  # the normal is that of the end of the step, when the balls have moved on
SLAB = box(0.1, 0.08, 0.03)


def belief(states, position=0.002, velocity=0.0, rotation=0.0):
    states = [state(p, v) for p, v in states]
    return independent(*states, position=position, velocity=velocity, rotation=rotation)


def spreads(prediction):
    P = prediction.belief.blocks
    return [np.sqrt(np.einsum("mii->m", P[:, block, block])) for block in (ERR_POSITION, ERR_ROTATION)]


@pytest.fixture(scope="module")
def impact():
    """Two balls that hit each other, and the belief."""
    bodies = [RigidBody(name, BALL, 0.3) for name in "ab"]
    start = belief([((0, 0, 0), (1.0, 0, 0)), ((0.1101, 0.03, 0), (0.0, 0, 0))])
    physics = {"exact": True, "gravity": None, "restitution": 0.8, "friction": None}
    return Scene.everyday(bodies, **physics), start


def until_impact(propagator, scene, start):
    """Carries before and after the step of the impact, and its impulse on the second ball [N s]."""
    before = propagator.init(scene, start)
    for _ in range(20):
        after = propagator.advance(before, scene, 1)
        impulse = 0.3 * after.mean[1, VELOCITY]
        if impulse.any():
            return before, after, impulse
        before = after
    raise AssertionError("no impact")


def test_an_impact_s_impulse_tilts_as_the_surrogate_s_equations_say(impact):
    """With equal variances along all axes, Eq. 21 is a multiple of the projection across the normal.

    ``k_sigma`` counts ten times, as an impulse acts once.
    """
    scene, start = impact
    propagator = make_propagator("surrogate", k_sigma=0.3)
    before, after, impulse = until_impact(propagator, scene, start)
    size = np.linalg.norm(impulse)
    n = impulse / size
    alpha = np.arctan(10.0 * 0.3 * np.sqrt(2.0) * 0.002 / 0.1)
    increment = size * np.sin(alpha) / 3.0 / 0.3 * (np.eye(3) - np.outer(n, n))
    for k in range(2):
        grown = after.blocks[k][ERR_VELOCITY, ERR_VELOCITY] - before.blocks[k][ERR_VELOCITY, ERR_VELOCITY]
        np.testing.assert_allclose(grown, increment, atol=AFTER * np.abs(increment).max())


def test_an_impact_s_impulse_spreads_as_its_perturbed_normals_do(impact):
    scene, start = impact
    propagator = make_propagator("local_sampling", samples=20_000)
    before, after, impulse = until_impact(propagator, scene, start)
    size = np.linalg.norm(impulse)
    D = 0.1 * impulse / size + np.random.default_rng(0).normal(0.0, np.sqrt(2.0) * 0.002, (100_000, 3))
    deviation = size * (D / np.linalg.norm(D, axis=1)[:, None] - impulse / size) / 0.3
    expected = deviation.T @ deviation / len(D)
    grown = after.blocks[1] - before.blocks[1]
    np.testing.assert_allclose(
        grown[ERR_VELOCITY, ERR_VELOCITY], expected, atol=0.03 * np.abs(expected).max()
    )


@pytest.mark.parametrize("name", ["linearization", "surrogate", "local_sampling"])
def test_what_lies_on_another_has_finite_spreads_that_are_right_or_flagged(name):
    bodies = [RigidBody("low", SLAB, 0.4), RigidBody("high", SLAB, 0.4)]
    scene = Scene.everyday(bodies, exact=True, environment=[Plane(name="table")])
    start = belief([((0, 0, 0.015), (0, 0, 0)), ((0.001, 0, 0.045), (0, 0, 0))], 1e-3, 1e-2, 1e-2)
    prediction = predict(scene, start, name, 1.0)
    position, rotation = spreads(prediction)
    assert (position < 0.1).all() and (rotation < 1.0).all()
    assert (position > 5e-4).all(), "where it is does not get surer by lying there"
    truth = spreads(predict(scene, start, make_propagator("monte_carlo", samples=200), 1.0))
    for k, status in enumerate(assess(prediction)):
        off = max(max(a[k] / b[k], b[k] / a[k]) for a, b in zip((position, rotation), truth, strict=True))
        assert off < 2.0 or status.flags & Status.OUTSIDE_VALIDITY
