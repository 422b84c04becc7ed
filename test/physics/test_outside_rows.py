"""Cases that users and other simulators reported, with known answers, beside the table of laws."""

import math

import numpy as np
import pytest
from everyday_worlds import (
    about,
    base_radius,
    course,
    product,
    run,
    solid_ball,
    solid_box,
    solid_cylinder,
    tilt,
    world,
)
from plain_scenes import G, state
from planar_shelf import spin_off_shelf

from unc_physics import (
    Belief,
    BodyBelief,
    Box,
    Plane,
    PosePath,
    RigidBody,
    Scene,
    Status,
    assess,
    load_model,
    make_propagator,
    predict,
    primitive_model,
)

DT = 1 / 240  # s


def tray_path(acceleration, every, velocities):
    """Return the path of a tray whose top is at z = 0, which accelerates along x for 0.8 s."""
    times = np.arange(0.0, 0.8001, every)
    return PosePath(
        times=times,
        positions=[(0.5 * acceleration * t * t, 0.0, -0.01) for t in times],
        linear_velocities=[(acceleration * t, 0.0, 0.0) for t in times] if velocities else None,
    )


@pytest.mark.parametrize("every", [0.01, 0.1])  # s
@pytest.mark.parametrize("velocities", [True, False])
@pytest.mark.parametrize("mu, acceleration", [(0.3, 2.0), (0.5, 3.0)])
def test_a_part_sticks_to_a_tray_on_way_points(every, velocities, mu, acceleration):
    # ARIAC issue 24: friction mu g is above the acceleration, which way points hold between them
    tray = RigidBody(
        "tray",
        primitive_model("box", size=(0.8, 0.4, 0.02)),
        trajectory=tray_path(acceleration, every, velocities),
    )
    scene = world(RigidBody("part", load_model("salt_box")), tray, dt=DT, friction=mu, environment=())
    part, carrier = run(scene, [state((0, 0, 0.061)), state((0, 0, -0.01))], 0.6)
    assert part[0] == pytest.approx(carrier[0], abs=1e-6)


@pytest.mark.parametrize("inertia, radius", [(7e-7, 0.1), (7e-7, 0.05), (1e-3, 0.1)])
def test_a_ball_of_given_inertia_rolls_down_without_a_flag(inertia, radius):
    angle = 0.1111
    normal = np.array([math.sin(angle), 0.0, math.cos(angle)])
    body = RigidBody("ball", solid_ball("ball", radius, 1.0).model, 1.0, inertia=inertia)
    scene = world(body, dt=DT, environment=[Plane(normal)])
    p = predict(
        scene,
        Belief.exact(state(radius * normal)[None], scene.moving),
        make_propagator("monte_carlo", samples=1),
        2.0,
    )
    right = G * math.sin(angle) / (1.0 + inertia / radius**2) * 2.0
    assert np.linalg.norm(p["ball"].linear_velocity) == pytest.approx(right, rel=1e-3)
    (status,) = assess(p)
    assert status.flags == Status.FINE, status.message


@pytest.mark.parametrize("dt", [1 / 120, 1 / 4000])
@pytest.mark.parametrize("speed, spin", [(0.6, 40.0), (0.3, 15.0)])
def test_a_can_that_slides_and_spins_stays_upright_at_any_step(dt, speed, spin):
    scene = world(RigidBody("can", load_model("can")), dt=dt, friction=0.24)
    path = course(scene, state((0, 0, 0.055), (speed, 0, 0), (0, 0, spin)), np.arange(1, 7) * 0.1)
    assert max(tilt(x[0]) for x in path) < math.radians(0.1)


@pytest.mark.parametrize(
    "name, height, half_base, speed",
    [("can", 0.055, None, 0.8), ("can", 0.055, None, 1.0), ("salt_box", 0.061, 0.039, 0.8)],
)
@pytest.mark.parametrize("dt, within", [(1 / 240, 0.05), (1 / 1000, 0.03)])
def test_a_body_leaves_a_shelf_within_five_and_three_percent(name, height, half_base, speed, dt, within):
    model = load_model(name)
    right = spin_off_shelf(height, half_base or base_radius(model), model.inertia[1, 1], 0.5, speed, 0.06)
    shelf = [Box((0.6, 1, 0.4), (-0.3, 0, 0.2)), Plane(offset=-2.0)]
    scene = world(RigidBody("body", model), dt=dt, friction=0.5, restitution=0.1, environment=shelf)
    path = course(scene, state((-0.06, 0, 0.4 + height), (speed, 0, 0)), np.arange(1, 121) / 120)[:, 0]
    assert path[np.argmax(path[:, 2] < 0.3), 11] == pytest.approx(right, rel=within)


@pytest.mark.parametrize("radius, length, mass", [(0.00525, 0.0445, 0.012), (0.0171, 0.0615, 0.14)])
@pytest.mark.parametrize("yaw", [0.0, 0.4])
def test_other_batteries_lie_across_an_edge(radius, length, mass, yaw):
    # AAA and D cells, after mujoco_warp issue 1555
    table = Box((1, 1, 0.04), (0.003 - 0.5, 0, -0.02))
    scene = world(solid_cylinder("b", radius, length, mass), dt=DT, restitution=0.2, environment=[table])
    turn = product(about((0, 0, 1), yaw), about((0, 1, 0), math.pi / 2))
    x = run(scene, state((0, 0, radius + 0.005), orientation=turn), 5.0)[0]
    assert math.hypot(x[0], x[1]) < 1e-3
    assert abs(math.cos(tilt(x))) * length < 1e-4


@pytest.mark.parametrize("e", [0.5, 0.6, 0.7])
@pytest.mark.parametrize("yaw", [0.3, math.pi / 4])
@pytest.mark.parametrize("what", ["cube", "salt box"])
def test_a_turned_box_that_lands_flat_on_a_pedestal_rebounds_without_spin(what, yaw, e):
    # box3d issue 83, with the body askew to the support
    body, half, narrow = solid_box("b", (0.1, 0.1, 0.1), 1.0), 0.05, 0.075
    if what == "salt box":
        body, half, narrow = RigidBody("b", load_model("salt_box")), 0.061, 0.03
    support = Box((narrow, narrow, 0.2), (0, 0, -0.1))
    scene = world(body, dt=DT, restitution=e, environment=[support])
    fall = math.sqrt(0.4 / G)
    times = [fall * (1 + e), fall * (1 + 2 * e + e * e)]
    path = course(scene, state((0, 0, half + 0.2), orientation=about((0, 0, 1), yaw)), times)[:, 0]
    heights = path[:, 2] - half + path[:, 5] ** 2 / (2 * G)
    np.testing.assert_allclose(heights, [0.2 * e**2, 0.2 * e**4], atol=4e-3)
    assert np.abs(path[:, 10:]).max() < 0.02


@pytest.mark.parametrize("radius", [0.005, 0.01, 0.02])
@pytest.mark.parametrize("fixed", [True, False])
def test_no_sample_of_a_ball_passes_through_a_tabletop(radius, fixed):
    mass = 4000 * radius**3
    ball = RigidBody("ball", solid_ball("ball", radius, mass).model, mass)
    start = {"ball": BodyBelief(position=(0, 0, 0.2), position_std=0.01)}
    bodies, environment = [ball], [Box((1.2, 0.8, 0.02), (0, 0, -0.01))]
    if fixed:
        top = RigidBody("top", primitive_model("box", size=(1.2, 0.8, 0.02)), 1.0, fixed=True)
        bodies, environment = [ball, top], []
        start["top"] = BodyBelief(position=(0, 0, -0.01))
    scene = Scene.everyday(bodies, environment=environment)
    x = predict(scene, Belief.of(scene, start), make_propagator("auto"), 0.6).samples()[:, 0]
    above = (np.abs(x[:, :2]) < [0.6, 0.4]).all(axis=1)
    assert above.sum() > 0.9 * len(x)
    assert x[above, 2].min() > radius - 3e-4


def test_each_of_two_boxes_on_a_tray_has_friction_of_its_own():
    # the upper one slides where its friction is below the acceleration and below the lower one's on the tray
    acceleration, mu, std, samples = 1.5, 0.3, 0.12, 400
    tray = RigidBody(
        "tray", primitive_model("box", size=(1.6, 0.4, 0.02)), trajectory=tray_path(acceleration, 0.1, True)
    )
    lower = RigidBody("lower", primitive_model("box", size=(0.3, 0.2, 0.02)), 1.0)
    upper = RigidBody("upper", primitive_model("box", size=(0.06, 0.06, 0.04)), 0.2)
    scene = Scene.everyday([tray, lower, upper], friction=mu, friction_std=std, environment=[])
    belief = Belief.of(
        scene, {"lower": BodyBelief(position=(0, 0, 0.01)), "upper": BodyBelief(position=(0, 0, 0.04))}
    )
    x = predict(scene, belief, make_propagator("monte_carlo", samples=samples), 0.75).samples()
    slid = np.mean(x[:, 1, 0] - x[:, 2, 0] > 2e-3)
    own = np.random.default_rng(1).standard_normal((200000, 3)) * math.sqrt(2.0) * std / mu
    of_upper = mu * np.exp(0.5 * (own[:, 1] + own[:, 2]))
    of_lower = mu * np.exp(0.5 * (own[:, 0] + own[:, 1]))
    right = np.mean(of_upper < np.minimum(acceleration / G, of_lower))
    assert slid == pytest.approx(right, abs=4.0 * math.sqrt(right * (1.0 - right) / samples))
