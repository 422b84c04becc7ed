"""A user's script, with the types that its author may count on."""

from typing import Any, assert_type

import numpy as np

from unc_physics import (
    PROPAGATORS,
    Belief,
    BodyBelief,
    BodyStatus,
    Box,
    BoxRegion,
    Capsule,
    ContactTime,
    Cylinder,
    ErrorCode,
    InRegion,
    Mode,
    Plane,
    PredictedBody,
    Prediction,
    Probability,
    Propagator,
    RigidBody,
    Scene,
    Snapshot,
    Sphere,
    SpherePacking,
    Status,
    Touches,
    Trajectory,
    UncPhysicsError,
    Upright,
    assess,
    auto_stiffness,
    load_model,
    load_scene,
    load_solid,
    make_propagator,
    pack_solid,
    physics_of,
    predict,
    save_packing,
    start_belief,
)


def drop() -> Prediction:
    box = RigidBody(
        "box", load_model("salt_box").prefix(50), mass=0.52, center_of_mass_std=(0.001, 0.001, 0.0)
    )
    assert_type(box.center_of_mass_std, np.ndarray)
    floor = Plane((0, 0, 1), name="floor")
    wall = Box(size=[0.02, 1.0, 0.3], position=np.array([0.4, 0.0, 0.15]), friction=0.2)
    post = Cylinder(0.05, 1.0, (0.0, 0.5, 0.5))
    rail, knob = Capsule(0.01, 0.5, (0.0, -0.5, 0.2)), Sphere(radius=0.02, position=(0.1, 0.1, 0.0))
    assert_type(wall.position, np.ndarray)
    scene = Scene.everyday([box], environment=[floor, wall, post, rail, knob], friction=0.4)
    assert_type(scene.gravity, np.ndarray)
    assert_type(scene.bodies[0], RigidBody)
    assert_type(scene.bodies[0].model, SpherePacking)

    about = BodyBelief(position=(0, 0, 0.2), position_std=0.01, orientation_std=[0.1, 0.1, 0.3])
    assert_type(about.position_std, np.ndarray)
    belief = Belief.of(scene, {"box": about}).with_common_pose_std([0.01] * 6)
    assert_type(belief.mean, np.ndarray)
    assert_type(belief.marginal(0), np.ndarray)
    assert_type(start_belief(scene, belief), Belief)
    assert_type(auto_stiffness(scene.bodies, belief.mean, gravity=(0, 0, -9.81)), float)

    propagator = make_propagator("monte_carlo", samples=100, seed=1)
    assert_type(propagator, Propagator)
    assert_type(PROPAGATORS, dict[str, type[Propagator]])
    try:
        prediction = predict(scene, belief, propagator, horizon=0.5, times=[0.25])
    except UncPhysicsError as error:
        assert_type(error.code, ErrorCode)
        raise
    assert_type(prediction.belief.covariance, np.ndarray)
    assert_type(prediction.times, tuple[float, ...])
    assert_type(prediction.samples(10), np.ndarray)
    print_body(prediction, prediction["box"])

    touches = Touches("box", "floor")
    region = BoxRegion("bin", size=(0.4, 0.3, 0.2), position=(0, 0, 0.1))
    found = prediction.probability(InRegion("box", region) & ~touches | Upright("box"), time=0.25)
    assert_type(found, Probability)
    assert_type(found.estimate, float)
    assert_type(prediction.contact_time(touches), ContactTime | None)
    assert_type(prediction.snapshots[0], Snapshot)
    assert_type(prediction[:1], Prediction)
    for status in assess(prediction):
        assert_type(status, BodyStatus)
        assert_type(status.flags, Status)
    assert_type(physics_of(scene), dict[str, Any])
    return prediction


def print_body(prediction: Prediction, body: PredictedBody) -> None:
    assert_type(body.position, np.ndarray)
    assert_type(body.rotation_std, np.ndarray)
    assert_type(body.covariance("ros"), np.ndarray)
    assert_type(prediction.body("box", time=0.25, origin="model").covariance("error_state"), np.ndarray)
    assert_type(body.samples(10), np.ndarray)
    assert_type(body.modes, tuple[Mode, ...])
    assert_type(body.modes[0].weight, float)
    assert_type(body.status(rollouts=0), BodyStatus)
    assert_type(prediction.bodies, tuple[PredictedBody, ...])
    assert_type(prediction.trajectory("box"), Trajectory)
    assert_type(prediction.trajectory("box").covariances, np.ndarray)


def from_file() -> Prediction:
    scene, belief, horizon = load_scene("scene.yaml")
    assert_type(scene, Scene)
    assert_type(horizon, float | None)
    return predict(scene, belief, "sigma_points", horizon)


def pack() -> None:
    solid, notes = load_solid("part.stl")
    assert_type(notes, list[str])
    save_packing("part.npz", pack_solid(solid, 5000, mass=0.35))
