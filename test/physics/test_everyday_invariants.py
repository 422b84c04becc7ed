"""What no motion changes: momentum, energy, symmetry, order; and the same bits from any way to run."""

import math

import numpy as np
import pytest
from everyday_worlds import (
    FLOOR,
    about,
    course,
    model,
    product,
    run,
    solid_ball,
    solid_box,
    solid_cylinder,
    world,
)
from hypothesis import settings
from plain_scenes import at_steps, energy, momenta, state, tumbling_orientation
from scipy.spatial.transform import Rotation

from unc_physics import Box, Plane, RigidBody, load_model
from unc_physics.shapes import pieces as shapes

BOX, CAN, BALL = (
    solid_box("box", (0.078, 0.046, 0.122), 0.52),
    solid_cylinder("can", 0.038, 0.11, 0.455),
    solid_ball("ball", 0.03, 0.2),
)
BOWL = RigidBody("bowl", load_model("bowl"))
PILE = BOX, CAN, BALL
FALLING = np.array(
    [
        state((0, 0, 0.09), (0.3, 0.1, -0.5), (1, 2, 3), about((1, 0.2, 0.1), 0.5)),
        state((0.02, 0.01, 0.22), (0, 0, -0.5), (-2, 1, 0), about((0.3, 1, 0), 0.8)),
        state((-0.02, -0.01, 0.33), (0, 0.1, -1), (0, 4, 1)),
    ]
)


# -- momentum and energy -----------------------------------------------------------------------------


@at_steps
@pytest.mark.parametrize("e", [0.0, 0.7])
def test_contacts_between_bodies_keep_momentum(dt, e):
    """Three bodies meet without gravity; what one gains another loses."""
    scene = world(*PILE, dt=dt, gravity=None, environment=(), restitution=e)
    x = np.array(
        [
            state((-0.15, 0, 0.01), (1, 0, 0), (3, -2, 5), about((3, 2, 1), 0.4)),
            state((0.05, 0.01, 0), (-0.5, 0.1, 0), (-1, 4, 2), about((-4, 5, 9), 1.1)),
            state((0.2, 0.02, 0.02), (-1.5, 0.0, 0.1), (2, 1, 0)),
        ]
    )
    y = run(scene, x, 0.6)
    assert (np.linalg.norm(y[:, 3:6] - x[:, 3:6], axis=1) > 0.1).all(), "they must have met"
    np.testing.assert_allclose(momenta(scene, y)[0], momenta(scene, x)[0], rtol=0, atol=1e-12)


@at_steps
@pytest.mark.parametrize("e", [0.0, 0.7])
@pytest.mark.parametrize("mu", [0.0, 0.5])
def test_balls_that_meet_off_centre_keep_angular_momentum(dt, e, mu):
    """Their normal is that of the impact: the start of the step has it up to 0.3 rad off."""
    scene = world(
        BALL, solid_ball("big", 0.05, 0.3), dt=dt, gravity=None, environment=(), restitution=e, friction=mu
    )
    x = np.array(
        [state((0.05, 0.03, 0), (-0.5, 0.1, 0), (3, -2, 5)), state((-0.15, 0, 0), (1, 0, 0), (-1, 4, 2))]
    )
    y = run(scene, x, 0.2)
    assert (np.linalg.norm(y[:, 3:6] - x[:, 3:6], axis=1) > 0.1).all(), "they must have met"
    (p, L), (q, M) = momenta(scene, x), momenta(scene, y)
    np.testing.assert_allclose(q, p, rtol=0, atol=1e-12)
    np.testing.assert_allclose(M, L, rtol=0, atol=2e-3 * np.linalg.norm(L))
    assert energy(scene, y) < energy(scene, x)


@pytest.mark.parametrize("e", [0.0, 0.7])
@pytest.mark.parametrize("pair", ["box box", "box can", "can can", "box ball", "can ball", "can bowl"])
def test_bodies_of_any_shape_that_meet_keep_angular_momentum(pair, e):
    """Impulses act where the surfaces are opposite each other; what is left is in taking out depth."""
    rng, bodies = np.random.default_rng(3), {"box": BOX, "can": CAN, "ball": BALL, "bowl": BOWL}
    first, second = (bodies[name] for name in pair.split())
    second = RigidBody("second", second.model, second.mass)
    scene = world(first, second, gravity=None, environment=(), restitution=e)
    lost = []
    for _ in range(12):
        q, r = rng.standard_normal((2, 4))
        spins, aside = rng.standard_normal((2, 3)) * 5, rng.uniform(-0.04, 0.04, 2)
        x = np.array(
            [
                state((-0.12, 0, 0), (1, 0, 0), spins[0], q / np.linalg.norm(q)),
                state((0.12, *aside), (-0.5, 0.1, 0), spins[1], r / np.linalg.norm(r)),
            ]
        )
        y = run(scene, x, 0.5)
        (p, L), (linear, angular) = momenta(scene, x), momenta(scene, y)
        np.testing.assert_allclose(linear, p, rtol=0, atol=1e-12)
        assert energy(scene, y) < energy(scene, x)
        lost.append(np.linalg.norm(angular - L) / np.linalg.norm(L))
    assert np.median(lost) < 0.015, np.round(lost, 4)


def largest_gain(scene, start, time):
    """Return the largest rise of energy over the energy at the start, above the lowest level before it."""
    path = course(scene, start, np.arange(1, round(time / 0.02) + 1) * 0.02)
    E = np.array([energy(scene, x) for x in (np.reshape(start, (-1, 13)), *path)])
    return (E - np.minimum.accumulate(E)).max() / E[0]


@at_steps
@pytest.mark.parametrize("e", [0.0, 0.3, 0.8])
def test_a_pile_never_gains_energy(dt, e):
    assert largest_gain(world(*PILE, dt=dt, restitution=e), FALLING, 1.5) < 1e-3


@pytest.mark.parametrize(
    "name", ["salt_box", "can", "brick", "mug", "bowl", "plate", "bottle", "bin", "pin", "rounded_box"]
)
def test_a_model_that_tumbles_never_gains_energy(name):
    """From two heights and orientations onto a floor beside a step."""
    rng = np.random.default_rng(5)
    step = Box((0.3, 1, 0.05), (0.15, 0, 0.025), name="step")
    scene = world(RigidBody("b", load_model(name)), restitution=0.3, environment=[FLOOR, step])
    for height in (0.25, 0.5):
        q = rng.standard_normal(4)
        spin = rng.standard_normal(3) * 5
        start = state((rng.uniform(-0.1, 0.1), 0, height), (0.3, 0, 0), spin, q / np.linalg.norm(q))
        assert largest_gain(scene, start, 1.5) < 1e-3


BIN = (
    Box((0.5, 0.5, 0.02), (0, 0, -0.01)),
    *(Box((0.02, 0.5, 0.3), (s * 0.25, 0, 0.15)) for s in (-1, 1)),
    *(Box((0.5, 0.02, 0.3), (0, s * 0.25, 0.15)) for s in (-1, 1)),
    Plane(offset=-0.5),
)
SCENES = 1000 if settings.get_current_profile_name() == "thousands" else 16


def random_scene(seed):
    """Return a scene without overlap of up to three models of 6 cm in the air, and its start (B, 13)."""
    rng = np.random.default_rng(seed)
    names = ("salt_box", "can", "mug", "brick", "bowl", "bottle", "plate")
    bodies, start, top = [], [], 0.05
    for k, name in enumerate(rng.choice(names, rng.integers(1, 4))):
        small = load_model(str(name)).scaled(0.6)
        bodies.append(RigidBody(f"b{k}", small, 10.0 ** rng.uniform(-1.0, 0.7)))
        place, q = (*rng.uniform(-0.05, 0.05, 2), top + small.bounding_radius + 0.01), rng.normal(size=4)
        start.append(state(place, rng.normal(0, 0.7, 3), rng.normal(0, 4, 3), q / np.linalg.norm(q)))
        top = place[2] + small.bounding_radius
    scene = world(
        *bodies,
        dt=float(rng.choice([1 / 120, 1 / 240, 1 / 500, 1 / 1000])),
        friction=float(rng.choice([0.0, 0.2, 0.5, 1.0])),
        restitution=float(rng.choice([0.0, 0.1, 0.3, 0.5, 0.8, 1.0])),
        environment=BIN if rng.random() < 0.6 else [FLOOR],
    )
    return scene, np.array(start)


def test_random_scenes_never_gain_energy():
    """Of what they have above their lowest place, which the floor or the plane below the bin bounds."""
    gains = np.array([largest_gain(*random_scene(seed), 1.5) for seed in range(SCENES)])
    assert gains.max() < 1e-3, np.flatnonzero(gains > 1e-3)


@pytest.mark.parametrize("seed", [45, 50, 59])  # of bottles and bowls: up to 16 % more
def test_elastic_impacts_with_friction_never_gain_energy(seed):
    """Newton's restitution with friction would: a rebound at the speed wanted may need more than there is."""
    scene, start = random_scene(seed)
    assert scene.restitution == 1.0 and scene.friction > 0.0
    assert largest_gain(scene, start, 1.5) < 1e-3


@at_steps
@pytest.mark.parametrize("mu", [0.2, 0.5, 0.8])
def test_a_bowl_in_a_bowl_never_gains_energy(dt, mu):
    """It wedges itself in, which loads contacts from all sides."""
    bowl = load_model("bowl")
    scene = world(RigidBody("a", bowl), RigidBody("b", bowl), dt=dt, friction=mu, restitution=0.1)
    z = -float(bowl.origin[2])
    start = [state((0, 0, z)), state((0.002, 0.001, z + 0.075), orientation=about((1, 0, 0), 0.05))]
    assert largest_gain(scene, start, 2.0) < 1e-3


@pytest.mark.parametrize(
    "body",
    [solid_box("box", (0.1, 0.08, 0.06), 0.5), solid_box("flat box", (0.2, 0.15, 0.02), 0.5), CAN],
    ids=lambda body: body.name,
)
def test_elastic_tumbles_keep_their_energy(body):
    """To 1 % in 2 s from 60 random starts: edges and rims strike in turn within a step."""
    rng = np.random.default_rng(17)
    scene = world(body, restitution=1.0, friction=0.0)
    kept = []
    for _ in range(60):
        q = rng.standard_normal(4)
        height, spin = rng.uniform(0.15, 0.5), rng.standard_normal(3) * 3
        start = state((0, 0, height), (0, 0, 0), spin, q / np.linalg.norm(q))[None]
        kept.append(energy(scene, run(scene, start, 2.0)) / energy(scene, start))
    assert min(kept) > 0.99 and max(kept) < 1.001, np.round(np.array(kept), 3)


@at_steps
def test_free_flight_is_a_parabola_and_keeps_angular_momentum(dt):
    """Exact at any step; damping exp(-c t)."""
    body = solid_box("b", (0.1, 0.08, 0.06), 0.5)
    scene, x = world(body, dt=dt), state((0, 0, 100), (1, 2, 3), (2, 20.0, 1))[None]
    y = run(scene, x, 2.0)
    np.testing.assert_allclose(y[0, :3], [2, 4, 106 - 2 * 9.81], rtol=0, atol=1e-9)
    spins = [momenta(scene, z)[1] - np.cross(z[0, :3], momenta(scene, z)[0]) for z in (x, y)]
    np.testing.assert_allclose(*spins, rtol=0, atol=1e-9)
    assert energy(scene, y) == pytest.approx(energy(scene, x), rel=1e-6)
    y = run(world(body, dt=dt, damping=0.7, environment=()), state(velocity=(1, 0, 0)), 1.5)[0]
    np.testing.assert_allclose(y[[3, 5]], [np.exp(-1.05), -9.81 / 0.7 * (1 - np.exp(-1.05))], rtol=1e-9)
    free = {"gravity": None, "gyroscopic": False, "damping": 0.7, "environment": ()}
    y = run(world(body, dt=dt, **free), state((0, 0, 0), (1, 2, 3), (3, 2, 1)), 1.5)[0]
    np.testing.assert_allclose(y[3:6], np.exp(-0.7 * 1.5) * np.array([1, 2, 3]), rtol=1e-9)
    np.testing.assert_allclose(y[10:], np.exp(-0.7 * 1.5) * np.array([3, 2, 1]), rtol=1e-9)


def test_a_body_that_tumbles_without_forces_is_accurate_to_round_off():
    """Dzhanibekov's turns against SciPy: the error falls with the step, and stays small at tiny ones."""
    moments, spin = np.array([6e-4, 1.1e-3, 1.5e-3]), np.array([0.01, 5.0, 0.01])
    right, errors = Rotation.from_quat(tumbling_orientation(moments, spin, 10.0)), []
    body = RigidBody("b", model([shapes.ball(0.04)], moments), 1.0)
    for hz in (240, 480, 8000):
        x = run(world(body, dt=1 / hz, gravity=None, environment=()), state(spin=spin), 10.0)[0]
        errors.append((Rotation.from_quat(x[6:10]).inv() * right).magnitude())
    assert errors[0] < 3e-6 and errors[1] < 0.1 * errors[0] and errors[2] < 5e-7, errors


# -- symmetry ----------------------------------------------------------------------------------------


def turned_states(x, yaw):
    """Return states (B, 13) turned about the vertical [rad]."""
    R, y = Rotation.from_rotvec([0, 0, yaw]), np.array(x, float)
    for part in (slice(0, 3), slice(3, 6), slice(10, 13)):
        y[:, part] = R.apply(y[:, part])
    y[:, 6:10] = (R * Rotation.from_quat(y[:, 6:10])).as_quat()
    return y


def mirrored_states(x):
    """Return states (B, 13) mirrored at the plane y = 0, of bodies that are symmetric themselves."""
    signs = np.array([1, -1, 1, 1, -1, 1, -1, 1, -1, 1, -1, 1, -1.0])
    return np.array(x, float) * signs


def apart(x, y):
    """Return how far positions [m] and orientations [rad] of states (B, 13) are apart."""
    turn = Rotation.from_quat(x[:, 6:10]).inv() * Rotation.from_quat(y[:, 6:10])
    return max(np.abs(x[:, :3] - y[:, :3]).max(), turn.magnitude().max())


ALONE = ((0.0, BOX), (0.0, CAN), (0.3, BOX), (0.3, CAN))
TIMES = np.array([0.25, 1.0])  # s, after some impacts, and after it has come to lie


@pytest.mark.parametrize("e, body", ALONE, ids=lambda part: getattr(part, "name", part))
@pytest.mark.parametrize("yaw", [0.3, 1.7, math.pi / 2, -2.9])
def test_a_turned_start_gives_the_turned_motion(e, body, yaw):
    scene = world(body, restitution=e)
    start = FALLING[:1]
    straight, turned = course(scene, start, TIMES), course(scene, turned_states(start, yaw), TIMES)
    assert apart(turned_states(straight[0], yaw), turned[0]) < 1e-5
    assert apart(turned_states(straight[1], yaw), turned[1]) < 1e-3


@pytest.mark.parametrize("e, body", ALONE, ids=lambda part: getattr(part, "name", part))
def test_a_mirrored_start_gives_the_mirrored_motion(e, body):
    scene = world(body, restitution=e)
    straight, mirrored = (course(scene, x, TIMES) for x in (FALLING[:1], mirrored_states(FALLING[:1])))
    assert apart(mirrored_states(straight[0]), mirrored[0]) < 1e-5
    assert apart(mirrored_states(straight[1]), mirrored[1]) < 1e-3


STACKED = np.array([state((0.003 * k, 0, 0.0355 + 0.071 * k)) for k in range(3)])
BRICKS = tuple(solid_box(f"brick {k}", (0.24, 0.115, 0.071), 1.0 + k) for k in range(3))
#: Where another order leads to the same motion, and how near: bodies, start, time [s], bound [m, rad].
ORDERS = {"a stack": (BRICKS, STACKED, 1.0, 3e-5), "impacts": (PILE, FALLING, 0.1, 5e-4)}


@pytest.mark.parametrize("what", ORDERS)
@pytest.mark.parametrize("order", [(1, 0, 2), (2, 1, 0), (1, 2, 0)])
def test_the_order_of_bodies_does_not_matter(order, what):
    """Until chaos grows the sweeps' tolerance, .03 mm/s, into more."""
    bodies, start, time, bound = ORDERS[what]
    order = list(order)
    one = run(world(*bodies), start, time)
    other = run(world(*(bodies[k] for k in order)), start[order], time)
    assert apart(one[order], other) < bound


@pytest.mark.parametrize("angle", [0.1, math.pi / 8, 1.0, 2.5])
def test_a_round_body_may_be_turned_about_its_axis(angle):
    """Only the angle about the axis itself differs, in flight, impacts, and on its rim."""
    for body, axis in ((CAN, (0, 0, 1)), (BALL, (0.6, 0, 0.8))):
        turn = about(axis, angle)
        x = FALLING[1:2].copy()
        y = x.copy()
        y[0, 6:10] = product(x[0, 6:10], turn)
        ends = course(world(body, restitution=0.3), x, TIMES), course(world(body, restitution=0.3), y, TIMES)
        for one, other, within in zip(*ends, (1e-5, 1e-3), strict=True):
            other[0, 6:10] = product(other[0, 6:10], about(axis, -angle))
            assert apart(one, other) < within


@pytest.mark.parametrize("spin", [5.0, 40.0])
def test_spin_about_the_vertical_does_not_move_a_slick_can(spin):
    """Without friction its axis keeps still, and so does its centre."""
    scene = world(CAN, friction=0.0)
    x = run(scene, state((0, 0, 0.055), (0.4, 0, 0), (0, 0, spin), about((0, 0, 1), 0.3)), 1.0)[0]
    np.testing.assert_allclose(x[:3], [0.4, 0, 0.055], atol=1e-4)
    np.testing.assert_allclose(x[10:], [0, 0, spin], atol=1e-3)


# -- the same world ----------------------------------------------------------------------------------


def test_a_body_far_away_changes_nothing():
    """Only what touches is solved together."""
    scene = world(BOX, restitution=0.3)
    both = world(BOX, RigidBody("far", BALL.model, 0.2), restitution=0.3)
    alone = course(scene, FALLING[:1], [0.2, 0.5])[:, 0]
    beside = course(both, [FALLING[0], state((5, 5, 0.03))], [0.2, 0.5])[:, 0]
    np.testing.assert_allclose(beside, alone, rtol=0, atol=1e-6)


def test_a_slope_and_turned_gravity_are_the_same_world():
    """The world turned as a whole: a plane at an angle, or gravity."""
    R = Rotation.from_rotvec([0.2, 0.3, -0.1])
    start = FALLING[:1]
    level = run(world(BOX), start, 0.3)[0]
    tilted = start.copy()
    for part in (slice(0, 3), slice(3, 6), slice(10, 13)):
        tilted[0, part] = R.apply(start[0, part])
    tilted[0, 6:10] = (R * Rotation.from_quat(start[0, 6:10])).as_quat()
    scene = world(BOX, environment=[Plane(R.apply((0, 0, 1)))], gravity=R.apply((0, 0, -9.81)))
    end = run(scene, tilted, 0.3)[0]
    np.testing.assert_allclose(R.inv().apply(end[:3]), level[:3], rtol=0, atol=1e-5)
