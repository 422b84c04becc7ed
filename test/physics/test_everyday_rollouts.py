"""The step over exact shapes against closed forms, and what its results must not depend on."""

import math

import numba
import numpy as np
import pytest

from unc_physics import (
    Belief,
    BodyBelief,
    Box,
    Plane,
    PosePath,
    RigidBody,
    Scene,
    Wrench,
    load_model,
    make_propagator,
    predict,
    primitive_model,
)
from unc_physics.checks.errors import DivergedError, InvalidOptionError, NotSupportedError
from unc_physics.physics import contact_history as histories
from unc_physics.scene.contact_world import depths_of_pairs
from unc_physics.shapes import signed_distance

G = 9.81
FLOOR = Box((4.0, 4.0, 0.2), position=(0.0, 0.0, -0.1), name="floor")


def everyday(bodies, **given):
    return Scene.everyday(bodies, **{"exact": True, "environment": [FLOOR]} | given)


def belief_of(scene, states):
    return Belief.of(scene, {name: BodyBelief(**state) for name, state in states.items()})


def run(scene, horizon, **states):
    """Return the prediction of one rollout."""
    return predict(scene, belief_of(scene, states), make_propagator("monte_carlo", samples=1), horizon)


def carry_after(scene, belief, propagator, pieces):
    """Return the carry after numbers of steps, taken one after another."""
    carry = propagator.init(scene, belief)
    for steps in pieces:
        carry = propagator.advance(carry, scene, steps)
    return carry


def momentum(scene, states):
    """Return momentum, and angular momentum about the world's origin, of states (B, 13)."""
    from unc_physics.spatial.rotation import rotation_matrix

    p, L = np.zeros(3), np.zeros(3)
    for body, x in zip(scene.bodies, states, strict=True):
        R = rotation_matrix(x[6:10])
        p += body.mass * x[3:6]
        L += body.mass * (np.cross(x[:3], x[3:6]) + R @ body.unit_inertia @ R.T @ x[10:])
    return p, L


def test_a_mug_stays_at_rest():
    mug = load_model("mug")
    height = mug.origin[2] * -1.0
    p = run(everyday([RigidBody("mug", mug)]), 2.0, mug={"position": (0.0, 0.0, height)})["mug"]
    assert np.linalg.norm(p.position - (0.0, 0.0, height)) < 1e-5
    assert np.linalg.norm(p.linear_velocity) < 1e-5


def test_a_dropped_mug_comes_to_rest_on_its_base_or_its_side():
    mug = load_model("mug")
    p = run(
        everyday([RigidBody("mug", mug)], restitution=0.0, friction=0.5),
        0.2,
        mug={"position": (0.0, 0.0, 0.1 - mug.origin[2])},
    )["mug"]
    assert p.position[2] == pytest.approx(-mug.origin[2], abs=2e-4)  # it fell flat, from 0.1 m


def test_an_offset_centre_of_mass_tips_a_box_at_the_right_offset():
    # a box of 6 cm half width stands while its centre of mass is over its base, also off the middle
    box = primitive_model("box", size=(0.04, 0.12, 0.2))
    scene = everyday([RigidBody("box", box, 1.0, center_of_mass_std=(0.02, 0.0, 0.0))])
    propagator = make_propagator("monte_carlo", samples=200)
    p = predict(scene, belief_of(scene, {"box": {"position": (0.0, 0.0, 0.1)}}), propagator, 1.5)
    z = p.carry.parameters[:, 0]
    upright = p.samples()[:, 0, 2] > 0.095
    assert (upright == (abs(0.02 * z) < 0.02))[abs(abs(z) - 1.0) > 0.02].all()


def test_a_part_sticks_to_a_tray_that_accelerates_or_slips_by_the_right_way():
    tray = primitive_model("box", size=(0.8, 0.4, 0.02))
    times = np.arange(0.0, 0.601, 0.1)
    for acceleration, lag in ((2.0, 0.0), (4.0, 0.5 * (4.0 - 0.3 * G) * 0.36)):
        path = PosePath(
            times=times,
            positions=[(0.5 * acceleration * t * t, 0.0, -0.01) for t in times],
            linear_velocities=[(acceleration * t, 0.0, 0.0) for t in times],
        )
        bodies = [RigidBody("tray", tray, trajectory=path), RigidBody("part", load_model("salt_box"))]
        scene = everyday(bodies, friction=0.3, restitution=0.0, environment=[])
        p = run(scene, 0.6, part={"position": (0.0, 0.0, 0.061)})["part"]
        way = 0.5 * acceleration * 0.36
        assert p.position[0] == pytest.approx(way - lag, abs=1e-5 + 2e-3 * lag)
        assert p.position[2] == pytest.approx(0.061, abs=1e-5)


def test_bodies_that_collide_keep_momentum():
    bodies = [RigidBody("can", load_model("can")), RigidBody("bowl", load_model("bowl"))]
    scene = everyday(bodies, environment=[], gravity=None, restitution=0.5, friction=0.4)
    states = {
        "can": {"linear_velocity": (1.0, 0.2, 0.0), "angular_velocity": (3.0, 1.0, 5.0)},
        "bowl": {"position": (0.2, 0.03, 0.02), "orientation": (0.1, 0.7, 0.1, 0.7)},
    }
    belief = belief_of(scene, states)
    before = momentum(scene, belief.mean)
    carry = carry_after(scene, belief, make_propagator("monte_carlo", samples=1), [120])
    assert np.isfinite(carry.contact_history.first_time[0, 0, 1])
    after = momentum(scene, carry.states[0])
    np.testing.assert_allclose(after[0], before[0], atol=1e-12)
    np.testing.assert_allclose(after[1], before[1], atol=2e-4)


@pytest.fixture(scope="module")
def pile():
    names = ("mug", "can", "salt_box")
    scene = Scene.everyday(
        [RigidBody(name, load_model(name), mass_std=0.01) for name in names],
        environment=[FLOOR, Box((0.1, 1.0, 0.3), position=(0.12, 0.0, 0.15))],
    )
    states = {
        name: {"position": (0.01 * k, 0.0, 0.1 + 0.13 * k), "position_std": 0.003, "orientation_std": 0.1}
        for k, name in enumerate(names)
    }
    return scene, belief_of(scene, states)


def test_a_horizon_in_pieces_gives_the_same_bits(pile):
    scene, belief = pile
    propagator = make_propagator("monte_carlo", samples=6)
    whole = carry_after(scene, belief, propagator, [150])
    assert np.isfinite(whole.contact_history.first_time[:, 0, 1:]).any()
    parts = carry_after(scene, belief, propagator, [1, 40, 2, 57, 50])
    assert np.array_equal(parts.states, whole.states)
    assert np.array_equal(parts.contact_history.first_time, whole.contact_history.first_time)


def test_a_shorter_last_step_leaves_the_rollouts_as_they_are(pile):
    scene, belief = pile
    propagator = make_propagator("monte_carlo", samples=3)
    p = predict(scene, belief, propagator, times=[0.3011, 0.5])
    q = predict(scene, belief, propagator, 0.5)
    assert np.array_equal(p.samples(time=0.5), q.samples())


def test_rollouts_depend_neither_on_their_order_nor_on_threads(pile):
    scene, belief = pile
    propagator = make_propagator("monte_carlo", samples=8)
    threads = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        carry = carry_after(scene, belief, propagator, [120])
        numba.set_num_threads(min(2, numba.config.NUMBA_NUM_THREADS))
        assert np.array_equal(carry_after(scene, belief, propagator, [120]).states, carry.states)
    finally:
        numba.set_num_threads(threads)
    first = propagator.init(scene, belief)
    order = np.array([5, 2, 7, 0, 1, 6, 4, 3])
    mixed = first._replace(
        states=first.states[order],
        parameters=first.parameters[order],
        contact_history=histories.samples(first.contact_history, order),
    )
    mixed = propagator.advance(mixed, scene, 120)
    assert np.array_equal(mixed.states, carry.states[order])


@pytest.mark.parametrize("sleep", [False, True])
def test_contacts_can_be_read_and_carry_the_weight(sleep):
    scene = everyday([RigidBody("box", load_model("salt_box"))], sleep=sleep)
    belief = belief_of(scene, {"box": {"position": (0.0, 0.0, 0.061)}})
    p = predict(scene, belief, make_propagator("monte_carlo", samples=2), times=[0.01, 0.25])
    found = p.contacts()
    assert found["rollout"].tolist() == [0] * 4 + [1] * 4
    np.testing.assert_allclose(found["normal"], np.tile([0.0, 0.0, 1.0], (8, 1)), atol=1e-6)
    assert set(found["first"]) == {1} and set(found["second"]) == {0}
    np.testing.assert_allclose(abs(found["point"]), np.tile([0.039, 0.023, 0.0], (8, 1)), atol=1e-4)
    assert (abs(found["gap"]) < 5e-5).all()
    weight = [0.0, 0.0, scene.bodies[0].mass * G * scene.dt]
    np.testing.assert_allclose(found["impulse"][:4].sum(axis=0), weight, atol=1e-6)


def test_contacts_of_a_shorter_last_step_have_its_impulse_and_its_things():
    low, high = (Box((1, 1, 0.1), (x, 0, -0.05), name=f"at {x}") for x in (-0.51, 0.51))
    bodies = [RigidBody(name, load_model("salt_box")) for name in ("a", "b")]
    scene = everyday(bodies, environment=[low, high])
    states = {"a": {"position": (0.0, 0.0, 0.061)}, "b": {"position": (0.0, 0.0, 0.183)}}
    p = predict(scene, belief_of(scene, states), make_propagator("monte_carlo", samples=1), 0.251)
    found = p.contacts()
    assert set(zip(found["first"], found["second"], strict=True)) == {(0, 1), (2, 0), (3, 0)}
    rest, m = 0.251 - 60 * scene.dt, scene.bodies[0].mass
    for ground, weight in ((found["second"] == 0, 2.0), (found["second"] == 1, 1.0)):
        np.testing.assert_allclose(found["impulse"][ground].sum(axis=0)[2], weight * m * G * rest, rtol=1e-3)


def test_contacts_of_the_explicit_step_are_no_data():
    scene = Scene([RigidBody("box", load_model("salt_box"))])
    with pytest.raises(NotSupportedError, match="no contacts as data"):
        run(scene, 0.01, box={"position": (0.0, 0.0, 0.2)}).contacts()


def test_each_body_has_friction_of_its_own():
    # of two boxes on a slope between friction and its spread, one may slide while the other does not
    boxes = [RigidBody(name, load_model("salt_box")) for name in ("a", "b")]
    angle = math.atan(0.25)
    scene = Scene.everyday(
        boxes,
        friction=0.25,
        friction_std=0.1,
        gravity=(G * math.sin(angle), 0.0, -G * math.cos(angle)),
        environment=[FLOOR],
    )
    states = {name: {"position": (0.0, 0.3 * k, 0.061)} for k, name in enumerate("ab")}
    p = predict(scene, belief_of(scene, states), make_propagator("monte_carlo", samples=60), 0.5)
    slid = p.samples()[:, :, 0] > 0.01
    assert 5 < (slid[:, 0] != slid[:, 1]).sum() < 40


def test_a_release_within_a_step_falls_the_right_way():
    hand = RigidBody("hand", primitive_model("sphere", radius=0.02), fixed=True)
    can = RigidBody("can", load_model("can"), attached_to="hand", released_at=0.1234)
    scene = everyday([hand, can], environment=[])
    p = run(scene, 0.4, hand={}, can={"position": (0.0, 0.0, -0.2)})["can"]
    fallen = 0.5 * G * (0.4 - 0.1234) ** 2
    assert p.position[2] == pytest.approx(-0.2 - fallen, abs=1e-9)


def test_forces_act_as_in_closed_form():
    box = RigidBody("box", load_model("salt_box"), wrenches=[Wrench(force=(0.3, 0.0, 0.0), duration=0.35)])
    scene = everyday([box], environment=[], gravity=(0.0, 0.0, -2.0), damping=0.0)
    p = run(scene, 0.5, box={})["box"]
    a = 0.3 / box.model.mass
    assert p.linear_velocity[0] == pytest.approx(0.35 * a, rel=1e-9)
    assert p.position[2] == pytest.approx(-0.25, rel=1e-9)
    damped = everyday([RigidBody("box", load_model("salt_box"))], environment=[], gravity=None, damping=0.7)
    v = run(damped, 0.5, box={"linear_velocity": (1.0, 0.0, 0.0)})["box"].linear_velocity[0]
    assert v == pytest.approx(math.exp(-0.35), rel=1e-9)


def test_a_belt_carries_a_box_along():
    belt = Box((4.0, 1.0, 0.2), position=(0.0, 0.0, -0.1), surface_velocity=(0.5, 0.0, 0.0))
    scene = everyday([RigidBody("box", load_model("salt_box"))], environment=[belt], friction=0.5)
    p = run(scene, 0.5, box={"position": (0.0, 0.0, 0.061)})["box"]
    slips = 0.5 / (0.5 * G)  # until it has the belt's speed
    assert p.linear_velocity[0] == pytest.approx(0.5, rel=1e-5)
    assert p.position[0] == pytest.approx(0.5 * 0.5 - 0.25 * slips, abs=2e-4)


def test_torsional_friction_stops_a_spin_in_the_right_time():
    ball = primitive_model("sphere", radius=0.03)
    r = 0.002
    scene = everyday([RigidBody("ball", ball, 0.2, torsional_friction=r)], environment=[Plane()])
    p = run(scene, 0.1, ball={"position": (0.0, 0.0, 0.03), "angular_velocity": (0.0, 0.0, 30.0)})["ball"]
    slowing = r * G / (0.4 * 0.03**2)
    assert p.angular_velocity[2] == pytest.approx(30.0 - 0.1 * slowing, rel=1e-3)


def test_a_ball_of_spheres_bounces_on_a_turned_box():
    # without pieces of its own a model has one for each sphere; gravity is along the box's own axis
    from unc_physics import SpherePacking

    r, angle = 0.02, 0.3
    ball = SpherePacking(
        "ball",
        np.zeros((1, 3)),
        np.array([r]),
        inertia=0.4 * r * r * np.eye(3),
        volume=4.0 / 3.0 * math.pi * r**3,
        origin=np.zeros(3),
        bounding_radius=r,
        mass=0.1,
    )
    up = np.array([math.sin(angle), 0.0, math.cos(angle)])
    slab = Box(
        (1.0, 1.0, 0.1), position=-0.05 * up, orientation=(0.0, math.sin(angle / 2), 0.0, math.cos(angle / 2))
    )
    scene = everyday([RigidBody("ball", ball)], environment=[slab], gravity=-G * up, restitution=0.8)
    fall = math.sqrt(2 * 0.1 / G)
    p = run(scene, 1.8 * fall, ball={"position": (r + 0.1) * up})["ball"]
    assert p.position @ up == pytest.approx(r + 0.64 * 0.1, abs=1e-6)
    assert np.linalg.norm(p.position - (p.position @ up) * up) < 1e-9


def test_a_stiffness_is_refused():
    with pytest.raises(InvalidOptionError, match="integrator: implicit") as caught:
        everyday([RigidBody("can", load_model("can"))], stiffness=1e6)
    assert caught.value.field == "stiffness"


@pytest.mark.parametrize("gap", [0.05e-3, 0.5e-3])
def test_a_ball_falls_through_a_hole_without_touching_its_edges(gap):
    # within a step it passes edges that their normals at the step's start would put in its way
    w, r = 0.02 + gap, 0.02
    walls = [Box((0.1, 0.3, 0.01), (s * (w + 0.05), 0.0, 0.0)) for s in (-1.0, 1.0)]
    walls += [Box((0.3, 0.1, 0.01), (0.0, s * (w + 0.05), 0.0)) for s in (-1.0, 1.0)]
    ball = RigidBody("ball", primitive_model("sphere", radius=r), 0.1)
    p = run(everyday([ball], environment=walls), 0.2, ball={"position": (0.0, 0.0, 0.06)})["ball"]
    assert p.linear_velocity[2] == pytest.approx(-0.2 * G, rel=1e-9)


def test_a_box_falls_past_the_edge_of_a_shelf():
    shelf = Box((0.2, 0.4, 0.02), (0.1, 0.0, -0.01))
    scene = everyday([RigidBody("box", load_model("salt_box"))], environment=[shelf])
    p = run(scene, 0.3, box={"position": (-0.0392, 0.0, 0.081)})["box"]
    assert p.position[0] == pytest.approx(-0.0392, abs=1e-9)
    assert p.position[2] == pytest.approx(0.081 - 0.5 * G * 0.09, abs=1e-9)


def test_depths_are_those_of_signed_distances():
    mug, can = load_model("mug"), load_model("can")
    scene = everyday([RigidBody("mug", mug), RigidBody("can", can)])
    rng = np.random.default_rng(0)
    states = np.zeros((30, 2, 13))
    states[..., :3] = rng.uniform(-0.08, 0.08, (30, 2, 3)) + (0.0, 0.0, 0.06)
    states[..., 6:10] = rng.standard_normal((30, 2, 4))
    states[..., 6:10] /= np.linalg.norm(states[..., 6:10], axis=-1, keepdims=True)
    states[..., 3:6] = 5.0  # which are not travelled
    depths = depths_of_pairs(scene, states)
    assert np.array_equal(depths[:, 0, 1], depths[:, 1, 0])
    gaps = np.array(
        [signed_distance(mug, (a[:3], a[6:10]), can, (b[:3], b[6:10])).distance for a, b in states]
    )
    assert np.array_equal(depths[:, 0, 1] > 0.0, gaps < 0.0) and 5 < (gaps < 0.0).sum() < 25
    shallow = (-3e-3 < gaps) & (gaps < 0.0)
    np.testing.assert_allclose(depths[shallow, 0, 1], -gaps[shallow], rtol=0.1, atol=1e-5)
    for k, model in enumerate((mug, can)):
        low = [
            signed_distance(
                model,
                (x[:3], x[6:10]),
                primitive_model("box", size=(4.0, 4.0, 0.2)),
                ((0, 0, -0.1), (0, 0, 0, 1)),
            ).distance
            for x in states[:, k]
        ]
        np.testing.assert_allclose(depths[:, k, 2], np.maximum(-np.array(low), 0.0), atol=1e-4)


def test_floors_tilt_and_paths_are_offset_by_each_rollouts_own_draws():
    yaw = 0.4
    floor = Box(
        (4, 4, 0.2), (0, 0, -0.1), (0, 0, math.sin(yaw / 2), math.cos(yaw / 2)), surface_tilt_std=0.01
    )
    path = PosePath(times=[0, 1], positions=[[1, 0, 0.5], [1, 1, 0.5]], orientations=[[0, 0, 1, 0]] * 2)
    ball = primitive_model("sphere", radius=0.03)
    hand = RigidBody("hand", ball, trajectory=path, trajectory_std=[0.1, 0, 0, 0, 0, 0.5])
    scene = everyday([hand, RigidBody("ball", ball, 0.1)], environment=[floor], friction=1.0, restitution=0.0)
    belief = belief_of(scene, {"ball": {"position": (0.0, 0.0, 0.0301)}})
    p = predict(scene, belief, make_propagator("monte_carlo", samples=20), 0.5)
    names = [(parameter.name, parameter.axis) for parameter in scene.uncertain]
    z = {name: p.carry.parameters[:, k] for k, name in enumerate(names)}
    x, y = (0.01 * z["surface_tilt", axis] for axis in range(2))  # about the element's own axes
    tilt = np.column_stack([x * math.cos(yaw) - y * math.sin(yaw), x * math.sin(yaw) + y * math.cos(yaw)])
    expected = 0.5 * 5.0 / 7.0 * G * 0.25 * np.column_stack([tilt[:, 1], -tilt[:, 0]])
    np.testing.assert_allclose(p.samples()[:, 1, :2], expected, atol=2e-2 * abs(expected).max())
    # the path's own axes are turned by half a turn
    a, turn = -0.1 * z["trajectory", 0], 0.5 * z["trajectory", 5]
    expected = np.column_stack([1.0 + a - 0.5 * np.sin(turn), 0.5 * np.cos(turn), np.full(20, 0.5)])
    np.testing.assert_allclose(p.samples()[:, 0, :3], expected, atol=1e-9)


def test_what_leaves_the_range_of_numbers_is_named():
    scene = everyday([RigidBody("box", load_model("salt_box"))])
    with pytest.raises(DivergedError):
        run(scene, 0.1, box={"position": (0, 0, 0.2), "linear_velocity": (1e200, 0.0, 0.0)})
