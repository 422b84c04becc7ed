"""Bodies at rest in turned, tilted and unequal poses: how far they settle, and the belief they begin with."""

import numpy as np
import pytest
from plain_scenes import BALL, independent, state
from scipy.spatial.transform import Rotation

from unc_physics import (
    Belief,
    BodyBelief,
    Plane,
    RigidBody,
    Scene,
    load_model,
    make_propagator,
    predict,
    start_belief,
)
from unc_physics.shapes.pieces import farthest

STDS = np.radians([3.0, 2.0, 4.0])  # of rotations about the axes of the body
HEIGHT_STD, SHIFT = 0.004, 0.002  # m: above the floor on average


@pytest.fixture(scope="module")
def tilted():
    """A box that is yawed, a can that lies, and a ball; each is above the floor and leans."""
    lying = Rotation.from_euler("ZX", [2.4, 0.5 * np.pi])
    poses = {"box": Rotation.from_euler("z", -1.1), "can": lying}
    scene = Scene.everyday(
        [RigidBody("box", load_model("salt_box"), at_rest=True)]
        + [RigidBody("can", load_model("can"), at_rest=True), RigidBody("ball", BALL, 1.0)],
        exact=True,
        environment=[Plane(name="floor")],
    )
    starts = {"ball": BodyBelief(position=(0, 0, 5), linear_velocity=(1, 0, 0), linear_velocity_std=0.1)}
    for k, (name, turn) in enumerate(poses.items()):
        model = scene.bodies[k].model
        low = -farthest(model.pieces, turn.inv().apply([[0.0, 0.0, -1.0]]))[0]
        P = np.zeros((12, 12))
        P[:3, :3] = np.diag([0.003, 0.002, HEIGHT_STD]) ** 2
        P[6:9, 6:9] = np.diag(STDS**2)
        place = (k + 1.0, 0.5, SHIFT - low)
        starts[name] = BodyBelief(position=place, orientation=turn.as_quat(), covariance=P)
    return scene, Belief.of(scene, starts)


def test_how_far_bodies_at_rest_were_moved_is_noted(tilted):
    """The tilt is the angle between the drawn and the settled vertical axis, in standard deviations."""
    scene, belief = tilted
    drawn = belief.sample(40, np.random.default_rng(0))
    prediction = predict(scene, belief, make_propagator("monte_carlo", samples=40), scene.dt)
    start, states = prediction.carry.contact_history.start, prediction.carry.states
    std_of_tilt = np.hypot(STDS[0], STDS[1:]) / np.sqrt(2.0)  # the vertical axis is z, or y of the can
    for k in range(2):
        down = [Rotation.from_quat(x[:, k, 6:10]).inv().apply([0.0, 0.0, -1.0]) for x in (drawn, states)]
        tilt = np.arccos(np.clip((down[0] * down[1]).sum(axis=1), -1.0, 1.0))
        assert np.degrees(np.median(tilt)) > 1.0, "the case must lean"
        np.testing.assert_allclose(start.tilted[:, k], tilt, atol=1e-4)
        sunk = np.abs(drawn[:, k, 2] - states[:, k, 2]) / HEIGHT_STD
        leant = tilt / max(0.03, std_of_tilt[k])
        assert 0.1 < (leant > sunk).mean() < 0.9, "both must count"
        np.testing.assert_allclose(start.moved[:, k], np.maximum(sunk, leant), rtol=0.02)
    assert not start.tilted[:, 2].any()


def test_the_belief_at_the_start_is_that_of_settled_bodies(tilted):
    """Contact decides height, tilt and velocity; the ball's and horizontal errors stay as they were."""
    scene, belief = tilted
    found = start_belief(scene, belief)
    same = predict(scene, belief, "sigma_points", scene.dt).start
    np.testing.assert_array_equal(found.mean, same.mean)
    np.testing.assert_array_equal(found.joint, same.joint)
    np.testing.assert_allclose(found.mean[:, :2], belief.mean[:, :2], atol=3e-4)
    for k in range(2):
        model, turn = scene.bodies[k].model, Rotation.from_quat(found.mean[k, 6:10])
        low = -farthest(model.pieces, turn.inv().apply([[0.0, 0.0, -1.0]]))[0]
        assert found.mean[k, 2] == pytest.approx(-low, abs=3e-4)
        P, std = found.marginal(k), np.sqrt(belief.marginal(k).diagonal())
        np.testing.assert_allclose(np.sqrt(P.diagonal()[:2]), std[:2], rtol=0.1)
        assert P[2, 2] < 1e-7 and not P[3:6].any() and not P[9:].any()
    np.testing.assert_allclose(found.marginal(2), belief.marginal(2), rtol=1e-6, atol=1e-12)
    explicit = Scene([RigidBody("ball", BALL, 1.0)], dt=0.01)
    given = independent(state(), position=0.01)
    assert start_belief(explicit, given) is given
