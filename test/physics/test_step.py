"""Laws of mechanics that one step, and many steps, must keep."""

from dataclasses import replace

import numpy as np
import plain_scenes
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plain_scenes import BALL, PLATE, G, momenta, run, state, tumbling_orientation, turned
from scipy.spatial.transform import Rotation
from twins.step import bodies_of, physics_of
from twins.step import step as twin_step

from unc_physics import RigidBody, Scene
from unc_physics.physics.paper.rollout import simulate
from unc_physics.scene.environment import Plane
from unc_physics.scene.stiffness import auto_stiffness

ROUND_OFF = 1e-11  # of sums of up to hundreds of forces, relative to the largest
DT, KAPPA = 0.01, 1e4

seeds = st.integers(0, 2**32 - 1)


def packing(centers, radii):
    return plain_scenes.packing("packing", centers, radii, np.diag([0.3, 0.4, 0.5]))


def stepped(scene, states, steps=1):
    """States (B, 13) or (N, B, 13) some steps later."""
    out = np.array(states, float, ndmin=3)
    simulate(out, scene.world, steps)
    return out.reshape(np.shape(states))


def random_scene(rng, shapes, **physics):
    bodies = [
        RigidBody(f"b{k}", shapes[rng.integers(len(shapes))], rng.uniform(0.1, 5.0))
        for k in range(rng.integers(2, 5))
    ]
    if rng.random() < 0.4:
        bodies[rng.integers(len(bodies))] = RigidBody("fixed", shapes[0], fixed=True)
    scene = Scene(
        bodies,
        **(
            {"dt": DT, "stiffness": KAPPA, "damping": rng.uniform(0, 2), "gravity": rng.normal(size=3)}
            | physics
        ),
    )
    x = np.array([np.zeros(13) if b.fixed else rng.standard_normal(13) for b in bodies])
    x[:, :3] = rng.uniform(-0.7, 0.7, (len(bodies), 3))
    x[:, 6:10] = Rotation.random(len(bodies), rng=rng).as_quat()
    return scene, x


@pytest.fixture(scope="module")
def shapes(loaded):
    bodies = loaded("three_bodies").scene.bodies
    return [body.model for body in bodies] + [packing([[0.1, 0, 0]], [0.6])]


@pytest.mark.parametrize("most_planes", [0, 3])
@given(seeds)
def test_one_step_equals_the_twin(shapes, most_planes, seed):
    """Any number of bodies, of different models, some fixed, with gravity and damping, deep in contact with
    each other and with half-spaces at any angle.
    """
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(rng.integers(1, most_planes + 1) if most_planes else 0, 3))
    planes = [Plane(normal, rng.uniform(-1.0, 0.3)) for normal in normals]
    scene, x = random_scene(rng, shapes, environment=planes)
    ours, theirs = stepped(scene, x), twin_step(x[None], bodies_of(scene), physics_of(scene))[0]
    theirs[:, 6:10] *= np.sign(np.sum(theirs[:, 6:10] * ours[:, 6:10], axis=1))[:, None]
    np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=ROUND_OFF * max(1.0, np.abs(theirs).max()))


@pytest.mark.parametrize("steps", [1, 150])
def test_linear_momentum_is_conserved(loaded, steps):
    scene, belief, _ = loaded("undamped")
    x = belief.mean.copy()
    after = stepped(scene, x, steps)
    p0, p1 = momenta(scene, x)[0], momenta(scene, after)[0]
    if steps > 1:
        assert np.linalg.norm(after[0, 3:6] - x[0, 3:6]) > 0.1, "no collision"
    np.testing.assert_allclose(p1, p0, atol=1e-13 * steps)


@given(seeds, st.integers(1, 300), st.floats(0.0, 3.0))
def test_free_flight_is_the_closed_form(seed, steps, damping):
    rng = np.random.default_rng(seed)
    g = rng.normal(size=3)
    scene = Scene([RigidBody("ball", packing([[0, 0, 0]], [0.1]), 1.0)], 0.01, KAPPA, damping, g)
    position, velocity, turn, spin = rng.standard_normal((4, 3))
    x = state(position, velocity, spin, turned(*turn))
    after = stepped(scene, x[None], steps)[0]
    k, decay = np.arange(steps), np.exp(-0.01 * damping)
    # v_k = decay^k v0 + dt g (1 + ... + decay^(k-1)), and p adds up the v before each step
    powers = decay**k
    sums = np.concatenate([[0.0], np.cumsum(powers)])
    np.testing.assert_allclose(after[3:6], decay**steps * x[3:6] + 0.01 * g * sums[steps], atol=ROUND_OFF)
    np.testing.assert_allclose(
        after[:3], x[:3] + 0.01 * (x[3:6] * sums[steps] + 0.01 * g * sums[:steps].sum()), atol=1e-10
    )
    np.testing.assert_allclose(after[10:13], decay**steps * x[10:13], atol=ROUND_OFF)
    turn = Rotation.from_rotvec(0.01 * sums[steps] * x[10:13]) * Rotation.from_quat(x[6:10])
    assert (turn.inv() * Rotation.from_quat(after[6:10])).magnitude() < 1e-10


@pytest.mark.parametrize("radius", [0.5, 0.2])
@pytest.mark.parametrize("d", [0.0, 1e-300, 1e-160, 1e-12, 0.1, 0.3])
def test_a_sphere_inside_another_is_pushed_with_its_whole_volume(d, radius):
    """Or not at all, where both centres are one."""
    bodies = [RigidBody(name, packing([[0, 0, 0]], [r]), 1.0) for name, r in (("a", 0.5), ("b", radius))]
    scene = Scene(bodies, DT, KAPPA)
    after = stepped(scene, np.array([state(), state((d, 0, 0))]))
    push = DT * KAPPA * 4.0 / 3.0 * np.pi * radius**3
    assert np.isfinite(after).all()
    if d == 0.0:
        np.testing.assert_array_equal(after[:, 3], 0.0)
    elif 1e-150 < d <= 0.5 - radius:  # its square is a number
        np.testing.assert_allclose(after[:, 3], [-push, push])


def test_a_body_bounces_back_from_a_fixed_one_with_its_energy():
    """Head-on, without damping: the speed comes back, up to what the explicit step gains or loses."""
    ball = packing([[0, 0, 0]], [0.5])
    scene = Scene(
        [RigidBody("wall", ball, fixed=True), RigidBody("ball", ball, 1.0)], dt=1e-4, stiffness=KAPPA
    )
    after = stepped(scene, np.array([state(), state((1.05, 0, 0), (-1.0, 0, 0))]), 4000)
    TIME_STEP = 1e-3
    np.testing.assert_allclose(after[1, 3:6], [1.0, 0, 0], atol=TIME_STEP)


def test_the_step_is_of_first_order():
    """Measured: halving dt halves the error of a collision."""
    ball = packing([[0.05, 0.1, 0]], [0.5])
    x = np.array([state(velocity=(0.5, 0, 0)), state((1.1, 0.1, 0.0), (-1.0, 0, 0))])

    def end(dt):
        scene = Scene([RigidBody("a", ball, 1.0), RigidBody("b", ball, 2.0)], dt, 1e3, damping=0.3)
        return stepped(scene, x, round(0.4 / dt))

    truth = end(1e-5)
    errors = [np.abs(end(dt) - truth)[:, :3].max() for dt in (4e-3, 2e-3, 1e-3)]
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert np.all((orders > 0.85) & (orders < 1.2)), orders


@settings(max_examples=40)
@given(seeds)
def test_one_call_equals_many_single_steps_to_the_last_bit(shapes, seed):
    """Whatever a rollout remembers from step to step, such as who is far from whom, changes no result."""
    rng = np.random.default_rng(seed)
    count = rng.integers(2, 7)
    bodies = [
        RigidBody(f"b{k}", shapes[rng.integers(4)], rng.uniform(0.2, 3.0), bool(k == 1)) for k in range(count)
    ]
    scene = Scene(bodies, 0.01, 2e3, rng.choice([0.0, 1.0]), rng.choice([0.0, 3.0]) * rng.normal(size=3))
    x = np.zeros((count, 13))
    x[:, :3] = rng.uniform(-3.0, 3.0, (count, 3))
    x[:, 6:10] = Rotation.random(count, rng=rng).as_quat()
    moving = scene.moving
    x[moving, 3:6] = -x[moving, :3] * rng.uniform(
        0.0, 3.0, (len(moving), 1)
    )  # towards the middle, fast and slow
    x[moving, 10:13] = rng.choice([0.0, 1.0, 20.0]) * rng.standard_normal((len(moving), 3))
    singly = x
    for _ in range(300):
        singly = stepped(scene, singly)
    np.testing.assert_array_equal(stepped(scene, x, 300), singly)


@pytest.mark.parametrize("speed", np.geomspace(0.3, 10.0, 12))
def test_a_body_that_flies_straight_at_another_meets_it_in_the_same_step(speed):
    """No bound on how far bodies travel is loose here, so one that is too low shows."""
    far_side = packing([[-1.0, 0.0, 0.0]], [0.1])
    scene = Scene(
        [RigidBody("still", far_side, 1.0), RigidBody("flies", packing([[0.0, 0, 0]], [0.1]), 1.0)], DT, 1e6
    )
    x = np.array([state(), state((1.05, 0, 0), (-speed, 0, 0))])
    steps = int(2.4 / (DT * speed))
    singly = x
    for _ in range(steps):
        singly = stepped(scene, singly)
    assert np.any(singly[0, 3:6] != 0.0), "they never met"
    np.testing.assert_array_equal(stepped(scene, x, steps), singly)


def test_the_gyroscopic_term_conserves_angular_momentum_and_follows_euler():
    """A plate thrown about its middle axis tumbles as a fine integration of Euler's equations says."""
    scene = Scene([RigidBody("p", PLATE, 2.0)], dt=1e-3, gyroscopic=True)
    spin, orientation = np.array([0.05, 6.0, 0.02]), Rotation.from_rotvec([0.2, -0.1, 0.3])
    x = state(spin=spin, orientation=orientation.as_quat())
    inertia = 2.0 * PLATE.inertia

    def momentum(s):
        R = Rotation.from_quat(s[6:10]).as_matrix()
        return R @ inertia @ R.T @ s[10:]

    turned = tumbling_orientation(np.diag(inertia), orientation.inv().apply(spin), 2.0)
    expected = orientation * Rotation.from_quat(turned)
    end, without = (run(replace(scene, gyroscopic=on), x, 2.0)[0] for on in (True, False))
    np.testing.assert_allclose(momentum(end), momentum(x), atol=1e-12)
    assert (Rotation.from_quat(end[6:10]).inv() * expected).magnitude() < 0.01
    assert (Rotation.from_quat(without[6:10]).inv() * expected).magnitude() > 0.5


def test_auto_stiffness_limits_penetration():
    bodies = [RigidBody("b", BALL, 0.5)]
    x = state((0, 0, 0.06), (0, 0, -1.0))
    kappa = auto_stiffness(bodies, x[None], (0, 0, -G), penetration=0.1)
    scene = Scene(bodies, dt=5e-4, stiffness=kappa, gravity=(0, 0, -G), environment=(Plane(),))
    lowest = min(run(scene, x, t)[0, 2] for t in np.arange(0.002, 0.06, 0.002))
    assert 0.0 < 0.05 - lowest < 0.1 * 0.05
