"""Islands on the implicit step: bodies that are computed together are of one island, so nothing changes."""

from dataclasses import replace

import numpy as np
import pytest
from plain_scenes import independent, lowest, state

from unc_physics import Belief, Box, Plane, RigidBody, Scene, load_model, make_propagator, predict
from unc_physics.collision.contact_search import NEAR
from unc_physics.prediction.islands import IslandRunner
from unc_physics.scene.marks import whole

TABLE = [Box(name="table", size=(1.2, 1.2, 0.05), position=(0, 0, -0.025)), Plane(name="floor", offset=-0.7)]
BIN = [Plane(name="floor")] + [
    Box(name=f"wall {k}", size=size, position=position)
    for k, (size, position) in enumerate(
        [
            ((0.05, 2.1, 0.6), (1, 0, 0.3)),
            ((0.05, 2.1, 0.6), (-1, 0, 0.3)),
            ((2.1, 0.05, 0.6), (0, 1, 0.3)),
            ((2.1, 0.05, 0.6), (0, -1, 0.3)),
        ]
    )
]


def thrown(seed, environment, count=4, **options):
    """Some bodies in the air and a fixed one, which meet, part and come to rest."""
    rng = np.random.default_rng(seed)
    bodies, mean = [], np.zeros((count + 1, 13))
    for k in range(count):
        model = load_model(rng.choice(["salt_box", "can", "mug", "bowl"])).prefix(60)
        bodies.append(RigidBody(f"b{k}", model, rng.uniform(0.1, 1.0), restitution=rng.uniform(0.0, 0.6)))
    mean[:, :3] = rng.uniform([-0.8, -0.8, 0.1], [0.8, 0.8, 0.5], (count + 1, 3))
    mean[:, 3:6], mean[:, 10:] = (
        rng.uniform(-1.5, 1.5, (count + 1, 3)),
        rng.uniform(-5.0, 5.0, (count + 1, 3)),
    )
    mean[:, 6:10] = rng.normal(size=(count + 1, 4))
    mean[:, 6:10] /= np.linalg.norm(mean[:, 6:10], axis=1, keepdims=True)
    mean[-1, 3:6] = mean[-1, 10:] = 0.0
    bodies.append(RigidBody("post", load_model("can").prefix(60), fixed=True))
    scene = Scene.everyday(bodies, exact=True, environment=environment, **options)
    P = np.zeros((count, 12, 12))
    P[:, range(9), range(9)] = np.repeat([0.005, 0.05, 0.05], 3) ** 2
    return scene, Belief(mean, P, scene.moving)


def run_both(scene, belief, propagator, horizon):
    return tuple(predict(replace(scene, islands=on), belief, propagator, horizon) for on in (False, True))


def assert_same(joint, divided):
    """What a carry holds, but for the order in which contacts are remembered."""
    a, b = joint.carry, divided.carry
    np.testing.assert_array_equal(a.states, b.states)
    for one, other in zip(
        (a.contact_history, a.contact_history.solver),
        (b.contact_history, b.contact_history.solver),
        strict=True,
    ):
        for name in {"first_time", "count", "rest_steps", "residual"} & set(one._fields):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name), name)
    for n, count in enumerate(a.contact_history.solver.count):
        memories = [c.contact_history.solver for c in (a, b)]
        lists = [
            sorted(np.column_stack([m.contact[n, :count], m.force[n, :count]]).tolist()) for m in memories
        ]
        assert lists[0] == lists[1]


@pytest.mark.parametrize("sleep", [False, True])
@pytest.mark.parametrize("environment", [[Plane(name="floor")], BIN, TABLE], ids=["floor", "bin", "table"])
def test_monte_carlo_is_the_joint_run_bit_for_bit(environment, sleep):
    for seed in range(3):
        scene, belief = thrown(seed, environment, sleep=sleep)
        joint, divided = run_both(scene, belief, make_propagator("monte_carlo", samples=6, seed=seed), 1.5)
        assert_same(joint, divided)


def uncertainly_thrown():
    scene, belief = thrown(2, BIN)
    bodies = [
        replace(
            body,
            mass_std=0.1 * body.mass,
            center_of_mass_std=0.003,
            friction=0.4,
            friction_std=0.05,
            restitution_std=0.05,
        )
        for body in scene.bodies[:-1]
    ]
    impacts = {"impact_direction_std": 0.05, "impact_point_std": 0.002, "impact_friction_std": 0.1}
    return replace(scene, bodies=[*bodies, scene.bodies[-1]], **impacts), belief


def test_so_it_is_with_uncertain_parameters_and_impacts():
    scene, belief = uncertainly_thrown()
    joint, divided = run_both(scene, belief, make_propagator("monte_carlo", samples=6), 1.0)
    assert not joint.scene.shared_parameters
    assert_same(joint, divided)


def test_rollouts_that_are_added_are_those_of_one_batch():
    """Each batch has islands of its own, which may merge at other times."""
    scene, belief = uncertainly_thrown()
    scene = replace(scene, islands=True)
    cloud, auto = (
        predict(scene, belief, make_propagator(name, runs=80, **options), 0.3, times=[0.1])
        for name, options in (("cloud", {}), ("auto", {"error": 0.0}))
    )
    assert len(auto.carry.states) == 80
    for one, other in zip(cloud.snapshots, auto.snapshots, strict=True):
        np.testing.assert_allclose(one.rollout_states, other.rollout_states, rtol=0.0, atol=1e-9)
        np.testing.assert_allclose(one.belief.mean, other.belief.mean, rtol=0.0, atol=1e-9)
        np.testing.assert_allclose(one.belief.joint, other.belief.joint, rtol=0.0, atol=1e-9)


def resting(gap):
    """Two bricks beside each other on the floor."""
    brick = load_model("brick").prefix(60)
    scene = Scene.everyday(
        [RigidBody("a", brick, 1.0), RigidBody("b", brick, 1.0)], exact=True, environment=[Plane()]
    )
    height = 1e-4 - lowest(brick)
    return scene, independent(state((0, 0, height)), state((2.0 * brick.bounding_radius + gap, 0, height)))


@pytest.mark.parametrize("gap, together", [(0.5 * NEAR, True), (0.1, False)])
def test_what_the_step_computes_together_is_one_island(gap, together):
    scene, belief = resting(gap)
    propagator = make_propagator("monte_carlo", samples=1)
    joint, divided = run_both(scene, belief, propagator, 0.2)
    assert_same(joint, divided)
    runner = IslandRunner(propagator, joint.scene, [whole(48, joint.scene.dt)])
    end = runner.advance(runner.init(belief), 48)
    assert len(end.islands) == (1 if together else 2)


@pytest.mark.parametrize("damping", [0.0, 0.7])
def test_a_lone_body_flies_in_closed_form_as_step_by_step(damping):
    can = load_model("can").prefix(60)
    bodies = [RigidBody("a", can, 1.0), RigidBody("b", can, 1.0)]
    scene = Scene.everyday(
        bodies, exact=True, gyroscopic=False, damping=damping, environment=[Plane(offset=-50.0)]
    )
    states = [state((x, 0, 0), (1, 2, 3), (3, -2, 5)) for x in (0.0, 50.0)]
    stds = {"position": 0.01, "velocity": 0.05, "rotation": 0.02, "spin": 0.1}
    divided = predict(replace(scene, islands=True), independent(*states, **stds), "sigma_points", 1.0)
    for k in range(2):
        own = replace(scene, bodies=bodies[k : k + 1])
        alone = predict(own, independent(states[k], **stds), "sigma_points", 1.0)
        np.testing.assert_allclose(divided.belief.mean[k], alone.belief.mean[0], rtol=0.0, atol=1e-10)
        np.testing.assert_allclose(divided.belief.blocks[k], alone.belief.blocks[0], rtol=0.0, atol=1e-10)
