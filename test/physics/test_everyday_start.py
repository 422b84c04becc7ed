"""Starts of rollouts with exact shapes: overlap, bodies at rest, and what the answer says of them."""

import math
from dataclasses import replace

import numba
import numpy as np
import pytest
from everyday_worlds import belief_of
from plain_scenes import FLOOR, energy
from scipy.spatial.transform import Rotation

from unc_physics import (
    Belief,
    Box,
    Plane,
    PosePath,
    RigidBody,
    Scene,
    assess,
    load_model,
    make_propagator,
    predict,
    primitive_model,
)
from unc_physics.checks.errors import (
    InvalidOptionError,
    InvalidRequestError,
    LimitExceededError,
    NotSupportedError,
    UncPhysicsError,
)
from unc_physics.prediction.evidence import overlap_shares
from unc_physics.propagators.start import constrain_belief
from unc_physics.scene.contact_world import depths_of_pairs
from unc_physics.shapes import signed_distance
from unc_physics.shapes.recipes import RECIPES

FREE = 5e-5  # m, depth that counts as none
TABLE = Box((0.8, 0.8, 0.02), (-0.4, 0.0, -0.01), name="table")  # its edge is at x = 0
CUBE = primitive_model("box", size=(0.1, 0.1, 0.1))


def scene_of(bodies, environment=(FLOOR,), **physics):
    return Scene.everyday(bodies, **{"exact": True, "environment": environment} | physics)


def begun(scene, belief, samples=100, seed=0):
    """Return states as drawn and at time 0, (N, B, 13), and what is noted of the start."""
    propagator = make_propagator("monte_carlo", samples=samples, seed=seed)
    belief = constrain_belief(scene, belief)
    carry = propagator.init(scene, belief)
    return belief.sample(samples, np.random.default_rng(seed)), carry.states, carry.contact_history.start


def upright(model, x=0.0, y=0.0):
    """Return the position in which a model stands on the ground."""
    return x, y, -model.bounds[0][2]


def status_of(prediction, body):
    return next(status for status in assess(prediction) if status.body == body)


@pytest.mark.parametrize("thickness", [0.5e-3, 3e-3])
@pytest.mark.parametrize("name", ["ball", "salt_box", "mug"])
def test_no_sample_passes_a_thin_wall(name, thickness):
    model = primitive_model("sphere", radius=0.006) if name == "ball" else load_model(name)
    wall = Box((thickness, 2.0, 2.0), (0.5 * thickness, 0.0, 0.0), name="wall")
    scene = scene_of([RigidBody("body", model, 0.2)], [wall])
    belief = belief_of(
        scene, body={"position": (-0.08, 0.0, 0.2), "position_std": 0.05, "orientation_std": 0.3}
    )
    drawn, states, start = begun(scene, belief, 200)
    assert (drawn[:, 0, 0] > 0.02).sum() > 2, "or else the test says nothing"
    assert (states[:, 0, 0] < 0.0).all()
    assert depths_of_pairs(scene, states).max() < FREE and not start.kept.any()


def test_samples_without_overlap_stay_as_they_are():
    scene = scene_of([RigidBody("box", load_model("salt_box"))])
    belief = belief_of(
        scene,
        box={"position": upright(load_model("salt_box")), "position_std": 0.005, "orientation_std": 0.05},
    )
    drawn, states, start = begun(scene, belief)
    free = depths_of_pairs(scene, drawn).max(axis=(1, 2)) == 0.0
    assert 0.1 < free.mean() < 0.6
    np.testing.assert_array_equal(states[free], drawn[free])
    assert not start.moved[free].any() and (start.moved[~free] > 0.0).all()
    assert (start.overlap[~free] > 0.0).all()


@pytest.mark.parametrize("stds", [(0.01, 0.01), (0.01, 0.001), (0.002, 0.008)])
def test_the_one_known_less_well_gives_way(stds):
    # of two cubes side by side, each moves by its share of the variances
    bodies = [RigidBody(name, CUBE, 1.0) for name in "ab"]
    scene = scene_of(bodies, [], gravity=None)
    belief = belief_of(
        scene,
        **{
            name: {"position": (0.1005 * k, 0.0, 0.0), "position_std": (std, 0.0, 0.0)}
            for k, (name, std) in enumerate(zip("ab", stds, strict=True))
        },
    )
    drawn, states, start = begun(scene, belief)
    deep = np.maximum(0.1 - (drawn[:, 1, 0] - drawn[:, 0, 0]), 0.0)
    share = stds[0] ** 2 / (stds[0] ** 2 + stds[1] ** 2)
    np.testing.assert_allclose(states[:, 0, 0] - drawn[:, 0, 0], -share * deep, atol=FREE)
    np.testing.assert_allclose(states[:, 1, 0] - drawn[:, 1, 0], (1.0 - share) * deep, atol=FREE)
    np.testing.assert_allclose(
        start.moved[:, 0], share * deep / stds[0], atol=FREE / stds[0]
    )  # in standard deviations


def test_a_body_goes_the_nearest_way_in_the_metric_of_its_belief():
    # out of a plane, without rotation: Sigma n / (n' Sigma n) times the depth
    root = np.array([[3.0, 0.0, 0.0], [1.0, 2.0, 0.0], [2.0, -1.0, 1.5]]) * 1e-3
    P, mean = np.zeros((1, 12, 12)), np.zeros((1, 13))
    P[0, :3, :3], mean[0, [2, 9]] = root @ root.T, (0.05, 1.0)
    drawn, states, _ = begun(scene_of([RigidBody("cube", CUBE, 1.0)]), Belief(mean, P), 60)
    depth = np.maximum(0.05 - drawn[:, 0, 2], 0.0)
    assert (depth > FREE).sum() > 20
    way = np.outer(depth, P[0, :3, 2] / P[0, 2, 2])
    np.testing.assert_allclose(states[:, 0, :3] - drawn[:, 0, :3], way, atol=2 * FREE)
    np.testing.assert_array_equal(states[:, 0, 6:10], drawn[:, 0, 6:10])


def test_what_is_fixed_or_certain_does_not_move():
    bodies = [RigidBody("free", CUBE, 1.0), RigidBody("fixed", CUBE, 1.0, fixed=True)]
    scene = scene_of(bodies, [], gravity=None)
    belief = belief_of(scene, free={"position": (0.1005, 0, 0), "position_std": 0.005}, fixed={})
    drawn, states, _ = begun(scene, belief)
    assert (drawn[:, 0, 0] < 0.099).any() and depths_of_pairs(scene, states).max() < FREE
    np.testing.assert_array_equal(states[:, 1], drawn[:, 1])
    # its height is certain, and 3 mm too low
    scene = scene_of([RigidBody("cube", CUBE, 1.0)])
    belief = belief_of(scene, cube={"position": (0, 0, 0.047), "position_std": (0.005, 0.005, 0.0)})
    _, states, start = begun(scene, belief)
    np.testing.assert_array_equal(states[:, 0, 2], 0.047)
    np.testing.assert_allclose(start.kept, 0.003, rtol=1e-3)
    p = predict(scene, belief, make_propagator("monte_carlo", samples=10), 0.2)
    assert "INITIAL_OVERLAP" in str(status_of(p, "cube").flags)


def test_taking_out_overlap_gives_no_energy():
    box = load_model("salt_box")
    scene = scene_of([RigidBody("box", box), RigidBody("can", load_model("can"))])
    given = {"position_std": 0.005, "orientation_std": 0.05}
    belief = belief_of(
        scene, box=given | {"position": upright(box)}, can=given | {"position": (0, 0.065, 0.055)}
    )
    _, states, start = begun(scene, belief, 20)
    assert (start.overlap > 1e-3).sum() > 10
    p = predict(scene, belief, make_propagator("monte_carlo", samples=20), times=[0.05, 0.1, 0.3, 1.0])
    path = np.array([states, *(p.samples(time=t) for t in p.times)])
    energies = np.array([[energy(scene, x) for x in at] for at in path])
    assert (energies - energies[0]).max() < 1e-4
    assert (path[..., 2] - path[0, ..., 2]).max() < 1e-3


def test_bodies_that_share_an_error_move_together():
    # both cubes have one error of 10 mm along z, and 0.1 mm of their own: the floor lifts both
    bodies = [RigidBody(name, CUBE, 1.0) for name in "ab"]
    scene = scene_of(bodies)
    mean = np.zeros((2, 13))
    mean[:, 9] = 1.0
    mean[:, 2], mean[1, 0] = 0.05, 0.3
    mean[1, 2] = 0.08
    P = np.zeros((2, 12, 2, 12))
    P[:, 2, :, 2] = 0.01**2 + 1e-8 * np.eye(2)
    belief = Belief(mean, P.reshape(24, 24))
    drawn, states, _ = begun(scene, belief)
    low = np.maximum(0.05 - drawn[:, 0, 2], 0.0)
    assert low.max() > 0.01
    for k in range(2):
        np.testing.assert_allclose(states[:, k, 2] - drawn[:, k, 2], low, atol=1e-4 + 2e-4 * low.max())


def test_a_mean_inside_something_is_freed_by_the_shortest_way():
    # 4 mm inside a wall and 25 mm above the floor's level: out of the wall
    wall = Box((0.1, 1.0, 1.0), (-0.05, 0.0, 0.0), name="wall")
    scene = scene_of([RigidBody("cube", CUBE, 1.0)], [wall])
    belief = belief_of(scene, cube={"position": (0.046, 0.1, 0.2), "position_std": 0.002})
    drawn, states, _ = begun(scene, belief)
    right = drawn[:, 0, :3].copy()
    right[:, 0] = np.maximum(right[:, 0], 0.05)
    np.testing.assert_allclose(states[:, 0, :3], right, atol=FREE)


def test_velocities_into_a_contact_are_no_impact():
    # samples that are moved to the floor do not hit it; what is above, or surely falls, keeps its velocity
    scene = scene_of([RigidBody("cube", CUBE, 1.0)])
    for mean, surely in ((-0.02, False), (-1.0, True)):
        belief = belief_of(
            scene,
            cube={
                "position": (0.0, 0.0, 0.05),
                "position_std": 0.003,
                "linear_velocity": (0.2, 0.0, mean),
                "linear_velocity_std": 0.03,
            },
        )
        drawn, states, _ = begun(scene, belief)
        low = drawn[:, 0, 2] < 0.05 - FREE
        right = drawn[:, 0, 3:6].copy()
        if not surely:
            right[low, 2] = np.maximum(right[low, 2], 0.0)
        assert low.any() and not low.all()
        np.testing.assert_allclose(states[:, 0, 3:6], right, atol=1e-5)


@pytest.mark.parametrize(
    ("names", "spots"),
    [
        (["salt_box", "can"] * 3, [(0.09 * (k % 3) - 0.09, 0.09 * (k // 3) - 0.05, 0.062) for k in range(6)]),
        (
            ["plate", "bowl", "mug", "salt_box", "can", "bottle"],
            [
                (0, 0, 0.0115),
                (0, 0, 0.05),
                (0.02, 0.02, 0.115),
                (-0.08, 0.09, 0.07),
                (0.09, 0.09, 0.06),
                (0.09, -0.09, 0.1),
            ],
        ),
    ],
    ids=["packages", "tableware"],
)
def test_a_full_bin_comes_free(names, spots):
    walls = [Box((0.01, 0.32, 0.3), (s * 0.155, 0.0, 0.15)) for s in (-1.0, 1.0)]
    walls += [Box((0.32, 0.01, 0.3), (0.0, s * 0.155, 0.15)) for s in (-1.0, 1.0)]
    bodies = [RigidBody(f"{name}{k}", load_model(name)) for k, name in enumerate(names)]
    scene = scene_of(bodies, [Box((0.32, 0.32, 0.01), (0.0, 0.0, -0.005)), *walls])
    belief = belief_of(
        scene,
        **{
            body.name: {"position": spot, "position_std": 0.01, "orientation_std": 0.05}
            for body, spot in zip(bodies, spots, strict=True)
        },
    )
    drawn, states, start = begun(scene, belief)
    before, after = (depths_of_pairs(scene, x).max(axis=(1, 2)) for x in (drawn, states))
    assert np.median(before) > 1e-3
    assert (start.kept.any(axis=1)).mean() <= 0.01
    assert np.quantile(after, 0.97) < FREE and after.max() < 2e-4
    assert np.quantile(start.moved, 0.99) < 5.0


def test_few_samples_are_the_first_of_many():
    scene = scene_of([RigidBody("mug", load_model("mug"), at_rest=True), RigidBody("can", load_model("can"))])
    belief = belief_of(
        scene,
        mug={"position": (0.0, 0.0, 0.04), "position_std": 0.005},
        can={"position": (0.085, 0.0, 0.056), "position_std": 0.005, "orientation_std": 0.05},
    )
    _, many, _ = begun(scene, belief, 40)
    threads = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        _, few, _ = begun(scene, belief, 7)
    finally:
        numba.set_num_threads(threads)
    np.testing.assert_array_equal(many[:7], few)


def test_rejection_keeps_samples_without_overlap_and_keep_all():
    box = load_model("salt_box")
    given = {"position": upright(box), "position_std": 0.005, "orientation_std": 0.05}
    scene = scene_of([RigidBody("box", box)], overlap="reject")
    belief = belief_of(scene, box=given)
    _, states, _ = begun(scene, belief)
    assert depths_of_pairs(scene, states).max() < FREE
    scene = scene_of([RigidBody("box", box)], overlap="keep")
    drawn, states, start = begun(scene, belief)
    np.testing.assert_array_equal(states, drawn)
    np.testing.assert_allclose(start.overlap[:, 0], depths_of_pairs(scene, drawn).max(axis=(1, 2)), atol=FREE)
    deep = belief_of(scene, box=given | {"position": (0.0, 0.0, 0.02)})
    scene = scene_of([RigidBody("box", box)], overlap="reject")
    with pytest.raises(LimitExceededError, match="'project'"):
        begun(scene, deep)
    with pytest.raises(NotSupportedError, match="overlap"):
        predict(scene, belief, "sigma_points", 0.1)
    with pytest.raises(InvalidOptionError, match="overlap"):
        scene_of([RigidBody("box", box)], overlap="ignore")


def test_the_explicit_step_begins_as_drawn():
    box = load_model("salt_box")
    scene = Scene([RigidBody("box", box)], environment=[FLOOR], gravity=(0.0, 0.0, -9.81))
    belief = belief_of(scene, box={"position": upright(box), "position_std": 0.005})
    propagator = make_propagator("monte_carlo", samples=20)
    drawn = belief.sample(20, np.random.default_rng(0))
    np.testing.assert_array_equal(propagator.init(scene, belief).states, drawn)
    for overlap in ("project", "reject"):
        with pytest.raises(InvalidOptionError, match="overlap"):
            replace(scene, overlap=overlap)


def test_a_body_at_rest_needs_gravity_the_everyday_step_and_no_velocity():
    box = load_model("salt_box")
    resting = RigidBody("box", box, at_rest=True)
    for make in (
        lambda: Scene([resting], environment=[FLOOR], gravity=(0.0, 0.0, -9.81)),
        lambda: scene_of([resting], gravity=None),
        lambda: RigidBody("box", box, at_rest=True, fixed=True),
    ):
        with pytest.raises(UncPhysicsError, match="at_rest"):
            make()
    scene = scene_of([resting])
    with pytest.raises(InvalidRequestError, match="velocity"):
        belief_of(scene, box={"position": upright(box), "linear_velocity": (0.1, 0.0, 0.0)})


@pytest.mark.parametrize("beyond", [-0.0095, -0.001, 0.001])
@pytest.mark.parametrize("std", [0.0, 0.003])
@pytest.mark.parametrize("floor", [(), (Plane(offset=-0.25, name="floor"),)])
def test_a_box_at_rest_near_an_edge_stands_as_statics_say(beyond, std, floor):
    # its centre of mass is ``beyond`` the edge; neither how high it was seen nor where it would end matters
    box = load_model("salt_box")
    scene = scene_of([RigidBody("box", box, at_rest=True)], [TABLE, *floor])
    belief = belief_of(
        scene, box={"position": upright(box, beyond), "position_std": (0.0, 0.0, std), "orientation_std": std}
    )
    p = predict(scene, belief, make_propagator("monte_carlo", samples=20), 0.7)
    fell = p.samples()[:, 0, 2] < 0.04
    assert (fell == (beyond > 0.0)).all()
    status = status_of(p, "box")
    assert status.measures["unsettled"] == (1.0 if beyond > 0.0 else 0.0)
    if beyond < 0.0:
        assert abs(p.samples()[:, 0, 2] + box.bounds[0][2]).max() < 1e-4
        assert np.linalg.norm(p.samples()[:, 0, 3:6], axis=1).max() < 1e-3


def test_mugs_at_rest_near_an_edge_fall_where_statics_say():
    # the origin is 10 mm inside, the centre of mass off it; P(falls) = .103
    mug = load_model("mug")
    mean = -0.01 - mug.origin[0]
    scene = scene_of([RigidBody("mug", mug, at_rest=True)], [TABLE])
    belief = belief_of(scene, mug={"position": (mean, 0.0, -mug.origin[2]), "position_std": 0.005})
    p = predict(scene, belief, make_propagator("monte_carlo", samples=400), 0.7)
    drawn = constrain_belief(scene, belief).sample(400, np.random.default_rng(0))
    assert 0.5 * math.erfc(-mean / 0.005 / math.sqrt(2.0)) == pytest.approx(0.103, abs=1e-3)
    fell, beyond = p.samples()[:, 0, 2] < 0.0, drawn[:, 0, 0]
    clear = abs(beyond) > 5e-4
    np.testing.assert_array_equal(fell[clear], beyond[clear] > 0.0)


def test_bodies_at_rest_keep_their_horizontal_spread():
    box = load_model("salt_box")
    scene = scene_of([RigidBody("box", box, at_rest=True)])
    belief = belief_of(scene, box={"position": upright(box), "position_std": 0.005, "orientation_std": 0.05})
    drawn, states, start = begun(scene, belief)
    np.testing.assert_allclose(states[:, 0, :2], drawn[:, 0, :2], atol=2e-4)
    np.testing.assert_allclose(states[:, 0, 2], upright(box)[2], atol=FREE)
    axes = Rotation.from_quat(states[:, 0, 6:10]).as_matrix()
    assert np.degrees(np.arccos(axes[:, 2, 2].clip(-1.0, 1.0))).max() < 0.05
    assert not start.unsettled.any() and not states[:, 0, 3:6].any() and not states[:, 0, 10:].any()
    later = predict(scene, belief, make_propagator("monte_carlo", samples=20), 0.5).samples()
    assert np.linalg.norm(later[..., :3] - states[:20, ..., :3], axis=-1).max() < 1e-4
    assert np.std(Rotation.from_quat(states[:, 0, 6:10]).as_rotvec()[:, 2]) > 0.04


def test_a_tilt_that_leaves_no_room_is_said():
    # a box upright on a table whose height is exactly known cannot be tilted
    box = load_model("salt_box")
    tilt = math.radians(3.0)
    scene = scene_of([RigidBody("box", box)])
    given = {"position": upright(box), "orientation_std": (tilt, tilt, 0.0)}
    propagator = make_propagator("monte_carlo", samples=100)
    exact = predict(scene, belief_of(scene, box=given), propagator, 0.1)
    (note,) = status_of(exact, "box").notes
    assert "rotation" in note and "0.052 rad was given" in note
    assert overlap_shares(exact) == pytest.approx([1.0])
    above = {"position": upright(box, 0.0)[:2] + (0.2,), "orientation_std": (tilt, tilt, 0.0)}
    free = predict(scene, belief_of(scene, box=above), propagator, 0.1)
    assert status_of(free, "box").notes == () and not overlap_shares(free).any()


def test_a_slot_too_narrow_is_flagged_and_nothing_explodes():
    box = load_model("salt_box")
    width = box.bounds[1][0] - box.bounds[0][0]
    walls = [
        Box((0.1, 0.3, 0.2), (s * (0.05 + 0.5 * width - 0.5e-3), 0.0, 0.1), name=name)
        for s, name in ((-1.0, "left"), (1.0, "right"))
    ]
    scene = scene_of([RigidBody("box", box)], [FLOOR, *walls])
    given = {"position": upright(box), "position_std": 1e-3, "orientation_std": (0.0, 0.0, 1e-3)}
    p = predict(scene, belief_of(scene, box=given), make_propagator("monte_carlo", samples=30), 0.5)
    status = status_of(p, "box")
    assert "INITIAL_OVERLAP" in str(status.flags)
    assert "left" in status.message or "right" in status.message
    assert np.linalg.norm(p.samples()[:, 0, 3:6], axis=1).max() < 0.2


@pytest.mark.parametrize("close", [0.5e-3, 2e-3, 6e-3])
def test_a_can_between_fingers_that_are_too_close_is_flagged_by_name(close):
    can = primitive_model("cylinder", radius=0.038, length=0.11)
    finger = primitive_model("box", size=(0.02, 0.03, 0.06))

    def opening(side):
        x = side * (0.038 + 0.01 - 0.5 * close)
        return PosePath(
            times=[0.0, 0.5, 1.0],
            positions=[(x, 0.0, 0.055), (x, 0.0, 0.055), (x + 0.05 * side, 0.0, 0.055)],
            linear_velocities=np.zeros((3, 3)),
        )

    fingers = [
        RigidBody(name, finger, trajectory=opening(side)) for name, side in (("left", -1), ("right", 1))
    ]
    scene = scene_of([*fingers, RigidBody("can", can, 0.3)])
    belief = belief_of(scene, can={"position": (0.0, 0.0, 0.055)})
    times = [0.25, 0.5, 0.55, 0.6, 0.7, 1.0]
    p = predict(scene, belief, make_propagator("monte_carlo", samples=1), times=times)
    status = status_of(p, "can")
    assert "'left' and 'right'" in status.message
    assert status.measures["squeezed"] == pytest.approx(close, rel=0.3)
    speeds = [np.linalg.norm(p.samples(time=t)[0, 2, 3:6]) for t in times]
    assert max(speeds) < 0.2


@pytest.mark.parametrize("arcs", [False, True])
def test_depths_are_those_of_signed_distances(arcs):
    """Of flat sides as of the hollow surfaces that they stand for."""
    mug, can = load_model("mug"), load_model("can")
    if arcs:
        mug = replace(mug, pieces=[piece.moved(mug.origin, np.eye(3)) for piece in RECIPES["mug"].pieces()])
    scene = scene_of([RigidBody("mug", mug), RigidBody("can", can)])
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
