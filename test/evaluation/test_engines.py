"""Other engines hold the bodies that we hold, and move them as mechanics says."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from unc_physics import PosePath, RigidBody, Scene, load_model
from unc_physics.physics.paper.rollout import simulate
from unc_physics.scene.environment import Box, Capsule, Cylinder, Plane, Sphere
from unc_physics.scene.kinematic_states import with_kinematic
from unc_physics.spatial.layout import ANGULAR_VELOCITY, POSITION, QUATERNION, VELOCITY
from unc_physics_evaluation.engines import FINE, PEERS, PrincipalBody, Shape, run_in
from unc_physics_evaluation.hard_cases.shapes import ball
from unc_physics_evaluation.push_predictions import pushed_in
from unc_physics_evaluation.recorded_pushes import (
    measured_frictions,
    planar_before,
    push_scene,
    recorded_pushes,
    seen,
)
from unc_physics_evaluation.scenarios import collision, resting

FREE = 20  # steps: no contact yet
GEOMETRIES = ("spheres", "primitive")


@pytest.fixture(params=PEERS)
def name(request):
    pytest.importorskip(request.param)
    return request.param


@pytest.fixture(scope="module")
def case():
    return collision("pin", 50)


def test_pieces_cover_the_spheres(case):
    """In every direction the pieces reach as far as the spheres, but for the gaps between the directions of
    the outline.
    """
    body = PrincipalBody(case[0].bodies[0])
    vertices = np.concatenate(body.pieces())
    directions = np.random.default_rng(0).standard_normal((200, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    spheres = np.max(body.centers @ directions.T + body.radii[:, None], axis=0)
    reached = np.max(vertices @ directions.T, axis=0)
    assert np.all(reached <= spheres + 1e-12)
    assert np.all(reached >= 0.95 * spheres)


@pytest.mark.parametrize(
    "element, side",
    [
        (Plane((0.0, 0.6, 0.8), 1.0), (0.0, 0.0, 0.0)),
        (Box((0.2, 0.4, 0.6)), (0.1, 0.0, 0.0)),
        (Sphere(0.3), (0.0, 0.3, 0.0)),
        (Cylinder(0.2, 0.6), (0.0, -0.2, 0.0)),
        (Cylinder(0.2, 0.6), (0.0, 0.0, 0.3)),
        (Capsule(0.2, 0.6), (0.2, 0.0, 0.0)),
        (Capsule(0.2, 0.6), (0.0, 0.0, -0.5)),
    ],
    ids=lambda value: getattr(value, "shape", None),
)
def test_a_ball_bounces_off_the_elements_surface(name, element, side):
    """It comes back from where it touches our element, moved and turned."""
    if not isinstance(element, Plane):
        turned = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_quat()
        turn = {} if isinstance(element, Sphere) else {"orientation": turned}
        element = replace(element, position=np.array([1.0, 2.0, 3.0]), **turn)
    edge = element.position + element.rotation @ side
    out = element.surface(edge + element.rotation @ side)[1]
    radius, dt = 0.05, 1e-3
    scene = Scene(
        [RigidBody("ball", ball().scaled(radius), 1.0)],
        dt=dt,
        gravity=(0.0, 0.0, 0.0),
        environment=(element,),
    )
    start = np.zeros((1, 13))
    start[0, POSITION], start[0, VELOCITY], start[0, 9] = edge + 0.2 * out, -out, 1.0
    engine = PEERS[name](scene)
    before, after = engine.run(start, 140)[0], engine.run(start, 300)[0]
    engine.close()
    assert (before[POSITION] - edge) @ out == pytest.approx(0.06, abs=0.002), "not yet touched"
    assert after[VELOCITY] @ out > 0.5
    assert 0.05 < (after[POSITION] - edge) @ out < 0.21
    assert np.linalg.norm(np.cross(after[POSITION] - edge, out)) < 0.02, "straight back"


def test_what_is_no_box_and_no_cylinder_is_convex_pieces(name):
    bodies = [RigidBody(model, load_model(model).prefix(100), 1.0) for model in ("can", "mug")]
    engine = PEERS[name](Scene(bodies), "primitive")
    assert engine.shapes() == [1, 16]
    engine.close()


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_free_flight_is_ours(name, geometry, case):
    scene, belief, _ = case
    start = belief.mean.copy()
    start[0, ANGULAR_VELOCITY] = 0.2, -0.1, 0.3
    engine = PEERS[name](scene, geometry)
    theirs = engine.run(start, FREE)
    ours = start[None].copy()
    simulate(ours, scene.world, FREE)
    order_of_the_step = 0.02  # they damp before or after the drift, and follow the gyroscopic term
    for part in (POSITION, VELOCITY, ANGULAR_VELOCITY):
        assert theirs[:, part] == pytest.approx(ours[0][:, part], abs=order_of_the_step)
    turned = Rotation.from_quat(theirs[:, QUATERNION]).inv() * Rotation.from_quat(ours[0][:, QUATERNION])
    assert np.all(turned.magnitude() < order_of_the_step)
    engine.close()


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_collisions_keep_the_momentum(name, geometry, case):
    scene, belief, _ = case
    engine = PEERS[name](scene, geometry)
    assert engine.shapes() == {"spheres": [50, 50], "primitive": [16, 16]}[geometry]
    end = engine.run(belief.mean.copy(), 150)
    free = np.exp(-1.5 * scene.damping)
    assert np.abs(end[:, VELOCITY].sum(axis=0)).max() < 0.02 * free
    assert np.abs(end[0, VELOCITY] - free * belief.mean[0, VELOCITY]).max() > 0.05 * free  # they did meet
    engine.close()


def test_what_follows_a_path_drags_what_it_carries(name):
    """Friction feels the velocity of a tray that goes as it is told."""
    model, side = load_model("salt_box").prefix(300), 0.1
    shapes = {key: [Shape("box", (0.1, 0.1, side), np.zeros(3))] for key in ("box", "tray")}
    low = [0.0, 0.0, 0.5 * side + 0.05]
    path = PosePath(
        times=[0.0, 10.0], positions=[low, [1.0, 0.0, low[2]]], linear_velocities=[[0.1, 0.0, 0.0]] * 2
    )
    bodies = [RigidBody("box", model, 1.0), RigidBody("tray", model, trajectory=path)]
    scene = Scene.everyday(bodies, exact=True, environment=[Plane()], friction=0.5)
    mean = with_kinematic(scene, resting([[0.0, 0.0, low[2] + side], low]), 0.0)
    box = run_in(name, FINE[name], scene, shapes, mean, 0.5)[0]
    assert box[3] == pytest.approx(0.1, abs=2e-3)
    assert box[0] == pytest.approx(0.05 - 0.1**2 / (2 * 0.5 * 9.81), abs=1e-3)


def test_a_tip_pushes_the_block_as_it_was_pushed(name):
    k = int(np.flatnonzero(recorded_pushes().kind == 0)[0])
    push = push_scene(k, measured_frictions(k))
    place = pushed_in(name, FINE[name], push, int(recorded_pushes().support[k]))
    off, stays = (np.hypot(*(x - seen(k))[:2]) for x in (place, planar_before(k)))
    assert off < 0.5 * stays
