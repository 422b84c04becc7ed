"""Uncertain parameters of a scene, as directions of sigma points and Monte Carlo."""

import dataclasses

import numpy as np
import pytest
from plain_scenes import BALL, FLOOR, G, box, state, turned
from scipy.spatial.transform import Rotation

from unc_physics import Belief, Box, Plane, PosePath, RigidBody, Scene, make_propagator, predict
from unc_physics.physics.everyday.columns import FRICTION, RESTITUTION
from unc_physics.physics.paper.sphere_tree import EMPTY
from unc_physics.scene.contact_world import variation
from unc_physics.scene.parameters import vary

ROUND_OFF = 1e-12
TIME, DT = 0.5, 0.01
SAMPLES = 4000
#: Five standard errors of a variance from that many normal samples, relative to it.
STATISTICS = 5.0 * np.sqrt(2.0 / SAMPLES)


@pytest.fixture(scope="module")
def model(loaded):
    """A packing of ten spheres."""
    return loaded("two_bodies").scene.bodies[0].model


def at_rest(count=1, spacing=100.0):
    """States of bodies at rest, far from each other along x, in different orientations."""
    mean = np.zeros((count, 13))
    mean[:, 0] = spacing * np.arange(count)
    mean[:, 9] = 1.0
    if count > 1:
        mean[1, 6:10] = [0.5, -0.5, 0.5, 0.5]
    return mean


def samplers():
    """The propagators that take uncertain parameters."""
    return make_propagator("sigma_points"), make_propagator("monte_carlo", samples=SAMPLES, seed=3)


def relative_error(propagator):
    """What a propagator's covariance may be off where the dynamics are linear in the uncertainty."""
    return STATISTICS if propagator.name == "monte_carlo" else 1e-3


def test_gravity_that_hardly_tilts_falls_straight_down(model):
    scene = Scene([RigidBody("a", model, 1.0)], DT, gravity=[0.0, 0.0, -9.81], gravity_direction_std=1e-320)
    sigma_points = samplers()[0]
    mean = predict(scene, Belief.exact(at_rest()), sigma_points, TIME).belief.mean
    assert np.isfinite(mean).all() and np.allclose(mean[0, :2], 0.0)


def test_a_shifted_centre_of_mass_leaves_the_belief_about_the_model_s(model):
    std = np.array([0.0, 0.03, 0.0])
    scene = Scene(
        [
            RigidBody("a", model, 1.0, center_of_mass_std=std),
            RigidBody("b", model, 1.0, center_of_mass_std=0.01),
        ],
        DT,
    )
    mean = at_rest(2)
    mean[0, 10:13] = [0.0, 0.0, 2.0]
    for propagator in samplers():
        carry = propagator.init(scene, Belief.exact(mean))
        belief = propagator.belief(carry, scene)
        assert np.allclose(belief.mean, mean, atol=1e-10)
        assert np.allclose(belief.joint, 0.0, atol=1e-14)
        # a free body turns about its centre of mass: half a turn and the model's moves by twice the offset
        half_turn = predict(scene, Belief.exact(mean), propagator, np.pi / 2.0 // DT * DT).belief
        angle = 2.0 * (np.pi / 2.0 // DT * DT)
        along, across = std[1] * np.sin(angle), std[1] * (1.0 - np.cos(angle))
        offset = np.array([along, across]) + std[1] * 2.0 * (np.pi / 2.0 // DT * DT) * np.array([-1.0, 0.0])
        assert np.allclose(
            half_turn.joint[:2, :2], np.outer(offset, offset), rtol=relative_error(propagator), atol=1e-12
        )
        assert np.allclose(half_turn.blocks[1], 0.0, atol=1e-14)


def test_a_shifted_centre_of_mass_moves_the_spheres_and_what_bounds_them(model):
    scene = Scene([RigidBody("a", model, 1.0, center_of_mass_std=0.1), RigidBody("b", model, 1.0)])
    world = vary(scene, np.array([1.0, -2.0, 0.5]))
    shift, count = np.array([0.1, -0.2, 0.05]), len(model)
    assert np.allclose(world.tree.centers[:count], model.centers - shift, atol=ROUND_OFF)
    assert np.array_equal(world.tree.centers[count:], model.centers)
    assert np.allclose(
        world.bodies.radius[0], np.max(np.linalg.norm(model.centers - shift, axis=1) + model.radii)
    )
    bounds, child = world.tree.bounds.astype(float), world.tree.child
    node, k = np.nonzero((child < 0) & (child != EMPTY))
    spheres = ~child[node, k]
    gap = (
        np.linalg.norm(world.tree.centers[spheres] - bounds[node, :3, k], axis=1) + world.tree.radii[spheres]
    )
    assert np.all(gap <= bounds[node, 3, k])


def test_masses_and_the_stiffness_vary_by_their_laws(model):
    """Log-normal; a mass and its inertia share a factor, and gravity turns about two axes across it."""
    laws = {"stiffness": 1e5, "stiffness_std": 1e4, "gravity": (0, 0, -G), "gravity_direction_std": 0.02}
    scene = Scene([RigidBody("a", model, 2.0, mass_std=0.4)], **laws)
    assert {parameter.name for parameter in scene.uncertain} == {"mass", "stiffness", "gravity_direction"}
    own, found, factor = scene.world, vary(scene, np.full(4, 2.0)), np.exp(0.4)
    assert found.stiffness == pytest.approx(1e5 * np.exp(0.2))
    tilt = np.sqrt(2.0) * 0.04
    assert np.linalg.norm(found.gravity[:2]) == pytest.approx(G * np.sin(tilt))
    assert found.gravity[2] == pytest.approx(-G * np.cos(tilt))
    for name in ("mass", "inertia"):
        np.testing.assert_allclose(getattr(found.bodies, name), getattr(own.bodies, name) * factor)
        inverse = f"inverse_{name}"
        np.testing.assert_allclose(getattr(found.bodies, inverse), getattr(own.bodies, inverse) / factor)


def test_an_off_centre_push_turns_by_the_shifted_centre_of_mass(model):
    ball = model.prefix(1)
    scene = Scene(
        [RigidBody("a", ball, 1.0, center_of_mass_std=[0.1 * ball.radii[0], 0.0, 0.0])],
        0.001,
        1e6,
        gravity=(0.0, 0.0, 0.0),
        environment=[Plane()],
    )
    mean = at_rest()
    mean[0, 2], mean[0, 5] = ball.radii[0] - ball.centers[0, 2] + 0.001, -1.0
    prediction = predict(scene, Belief.exact(mean), make_propagator("monte_carlo", samples=50, seed=2), 0.1)
    offset = prediction.carry.parameters[:, 0]
    spin = prediction.carry.states[:, 0, 11]
    assert (
        np.corrcoef(offset, spin)[0, 1] > 0.98
    )  # support left of the centre of mass turns the body about +y


def test_draws_of_the_state_stay_the_same(loaded):
    scene, belief, _ = loaded("two_bodies")
    left, right = scene.bodies
    uncertain = dataclasses.replace(scene, bodies=(dataclasses.replace(left, mass_std=0.1), right))
    propagator = make_propagator("monte_carlo", samples=20, seed=9)
    carries = [propagator.init(s, belief) for s in (scene, uncertain)]
    assert np.array_equal(carries[0].states, carries[1].states)
    assert carries[0].parameters.size == 0
    more = dataclasses.replace(propagator, samples=30).init(uncertain, belief)
    assert np.array_equal(more.parameters[:20], carries[1].parameters)


def test_zero_is_none_and_costs_nothing(loaded):
    scene, belief, _ = loaded("two_bodies")
    zeros = [
        dataclasses.replace(body, mass_std=0.0, center_of_mass_std=[0.0, 0.0, 0.0]) for body in scene.bodies
    ]
    same = dataclasses.replace(scene, bodies=zeros, stiffness_std=0.0)
    assert same.uncertain == () and same.world.environment is None
    for propagator in (make_propagator("sigma_points"), make_propagator("monte_carlo", samples=20)):
        a, b = (predict(s, belief, propagator, 1.0).carry for s in (scene, same))
        assert np.array_equal(a.states, b.states)


# -- by the implicit step ----------------------------------------------------------------------------


def test_each_parameter_varies_by_its_law():
    """Of the second of two rollouts, from a number of standard deviations each; the first one has none."""
    path = PosePath(
        times=[0, 1], positions=[[1, 0, 0], [1, 1, 0]], orientations=[turned(0, 0, np.pi / 2)] * 2
    )
    bodies = [
        RigidBody("a", BALL, 2.0, mass_std=0.2, center_of_mass_std=(0.01, 0.0, 0.02), friction=0.4),
        RigidBody("b", BALL, 1.0, attached_to="hand", released_at=0.5, released_at_std=0.1),
        RigidBody("hand", BALL, trajectory=path, trajectory_std=[0.1, 0, 0, 0, 0, 0.5]),
    ]
    slope = Plane((1, 0, 0), 0.5, friction=0.8, surface_tilt_std=0.02)
    stds = {"friction_std": 0.05, "restitution_std": 0.1, "gravity_direction_std": 0.03}
    scene = Scene.everyday(bodies, exact=True, environment=[slope], friction=0.5, restitution=0.9, **stds)
    z = {
        ("gravity_direction", -1, 0): 1.0,
        ("gravity_direction", -1, 1): 0.0,
        ("mass", 0, 0): -1.0,
        ("center_of_mass", 0, 0): 2.0,
        ("center_of_mass", 0, 2): -1.0,
        ("released_at", 1, 0): 1.5,
        ("trajectory", 2, 0): 1.0,
        ("trajectory", 2, 5): 2.0,
        ("restitution", 0, 0): -2.0,
        ("friction", 1, 0): 1.5,
        ("restitution", 1, 0): 3.0,
        ("friction", 2, 0): 0.0,
        ("restitution", 2, 0): 0.0,
        ("restitution", 3, 0): 0.0,
        ("surface_tilt", 3, 0): 0.0,
        ("surface_tilt", 3, 1): 2.0,
    }
    assert [parameter[:3] for parameter in scene.uncertain] == list(z)
    found = variation(scene, np.array([np.zeros(len(z)), [*z.values()]]))
    two = np.sqrt(2.0)  # each surface has a draw, and a contact the mean of two
    friction = [0.4, 0.5 * np.exp(1.5 * two * 0.05 / 0.5), 0.5, 0.8]
    restitution = [0.9 - 2.0 * two * 0.1, 1.0, 0.9, 0.9]
    turn = Rotation.from_rotvec([0, 0, 1.0])  # two of 0.5 rad about z, and 0.1 m along the path's own x
    expected = {
        "mass": [np.exp(-0.1), 1.0, 1.0],
        "offset": [[0.02, 0.0, -0.02], [0.0] * 3, [0.0] * 3],
        "held": [[np.inf, np.inf], [0.0, 0.65], [np.inf, np.inf]],
    }
    for name, values in expected.items():
        np.testing.assert_allclose(getattr(found, name)[1], values, atol=1e-15, err_msg=name)
    np.testing.assert_allclose(found.materials[1, [FRICTION, RESTITUTION]], [friction, restitution])
    np.testing.assert_allclose(found.materials[0, [FRICTION, RESTITUTION]], scene.materials)
    tilt = np.arccos(found.gravity[1] @ found.gravity[0] / G**2)
    assert tilt == pytest.approx(0.03) and np.linalg.norm(found.gravity[1]) == pytest.approx(G)
    place, R = found.frames[1, 0, :3], found.frames[1, 0, 3:].reshape(3, 3)
    assert np.arccos(R[0, 0]) == pytest.approx(0.04)  # the normal's, about a point that stays
    np.testing.assert_allclose(place + R @ slope.position, slope.position, atol=1e-12)
    shift = found.shift[1, 2]
    for y in (0.0, 1.0):
        moved = shift[:3] + Rotation.from_quat(shift[3:]).apply([1, y, 0])
        np.testing.assert_allclose(moved, turn.apply([0, y, 0]) + [1, 0.1, 0], atol=1e-12)


def sampled(scene, *mean, horizon):
    """Standard normal numbers (N, K) of the uncertain parameters, and the samples' states (N, B, 13)."""
    propagator = make_propagator("monte_carlo", samples=40, seed=3)
    prediction = predict(scene, Belief.exact(np.array(mean), scene.moving), propagator, horizon)
    return prediction.carry.parameters, prediction.samples()


def test_mass_decides_who_pushes_whom():
    """Balls that collide straight: velocities by conserved momentum, and restitution."""
    bodies = [RigidBody("a", BALL, 1.0, mass_std=0.2), RigidBody("b", BALL, 0.5)]
    scene = Scene.everyday(bodies, exact=True, gravity=None, restitution=0.6)
    z, ends = sampled(scene, state(velocity=(1, 0, 0)), state((0.12, 0, 0)), horizon=0.2)
    mass = np.exp(0.2 * z[:, 0])
    np.testing.assert_allclose(ends[:, 1, 3], 1.6 * mass / (mass + 0.5), rtol=1e-6)
    np.testing.assert_allclose(mass * ends[:, 0, 3] + 0.5 * ends[:, 1, 3], mass, rtol=1e-9)


BOX = box(0.2, 0.1, 0.06)
OWNERS = ["scene", "body", "element"]


def owned(owner, model, **given):
    """A scene of one body on a floor, in which a value and its spread belong to one of three."""
    own = {name: given if owner == name else {} for name in OWNERS}
    exact = {key: value for key, value in given.items() if not key.endswith("_std")}
    body, floor = RigidBody("a", model, 1.0, **own["body"]), Plane(**own["element"])
    return Scene.everyday([body], exact=True, environment=[floor], **exact | own["scene"])


@pytest.mark.parametrize("owner", OWNERS)
def test_friction_decides_how_far_a_box_slides(owner):
    """A contact has the geometric mean of its surfaces, of which one varies, or both by the scene's."""
    mu, std = 0.4, 0.04
    scene = owned(owner, BOX, friction=mu, friction_std=std)
    z, ends = sampled(scene, state((0, 0, 0.03), (1, 0, 0)), horizon=1.0)
    spread = z.sum(axis=1) / np.sqrt(2.0) if owner == "scene" else 0.5 * z[:, 0]
    np.testing.assert_allclose(ends[:, 0, 0], 1.0 / (2.0 * mu * np.exp(spread * std / mu) * G), rtol=0.02)


@pytest.mark.parametrize("owner", OWNERS)
def test_restitution_decides_how_fast_a_ball_comes_back(owner):
    e, std = 0.5, 0.1
    scene = dataclasses.replace(
        owned(owner, BALL, restitution=e, restitution_std=std), gravity=(0.0, 0.0, 0.0)
    )
    z, ends = sampled(scene, state((0, 0, 0.06), (0, 0, -1)), horizon=0.1)
    own = np.clip(e + std * z * (np.sqrt(2.0) if owner == "scene" else 1.0), 0.0, 1.0)
    expected = np.sqrt(own.prod(axis=1) * (1.0 if owner == "scene" else e))
    np.testing.assert_allclose(ends[:, 0, 5], expected, rtol=1e-6)


def test_the_direction_of_gravity_decides_where_a_ball_rolls():
    scene = Scene.everyday(
        [RigidBody("a", BALL, 1.0)], exact=True, environment=[FLOOR], gravity_direction_std=0.02
    )
    z, ends = sampled(scene, state((0, 0, 0.05)), horizon=0.5)
    way = np.linalg.norm(ends[:, 0, :2], axis=1)
    tilt = 0.02 * np.linalg.norm(z, axis=1)
    np.testing.assert_allclose(way, 5.0 / 7.0 * G * np.sin(tilt) * 0.5**2 / 2.0, rtol=0.02)


def test_a_shifted_centre_of_mass_decides_who_falls_off_a_table():
    """A box that overhangs by the half: it falls where the centre of mass is beyond the edge."""
    table = Box(name="table", size=(1.0, 1.0, 0.1), position=(-0.5, 0, -0.05))
    scene = Scene.everyday(
        [RigidBody("a", BOX, 1.0, center_of_mass_std=(0.02, 0.0, 0.0))],
        exact=True,
        environment=[table, Plane(offset=-1.0)],
    )
    z, ends = sampled(scene, state((0, 0, 0.03)), horizon=2.0)
    clear = np.abs(z[:, 0]) > 0.1  # nearer than 2 mm they take longer than 2 s
    np.testing.assert_array_equal(ends[clear, 0, 2] < -0.5, z[clear, 0] > 0.0)
