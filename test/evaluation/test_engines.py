"""Other engines hold the bodies that we hold: mass, inertia, states and shapes."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from unc_physics.evaluation.engines import GEOMETRIES, PEERS, PrincipalBody
from unc_physics.evaluation.scenarios import collision
from unc_physics.physics.rollout import simulate
from unc_physics.layout import ANGULAR_VELOCITY, POSITION, QUATERNION, VELOCITY

FREE = 20  # steps: no contact yet


@pytest.fixture(scope="module")
def case():
    return collision("pin", 50)


def test_the_box_has_the_inertia(case):
    body = PrincipalBody(case[0].bodies[0])
    x, y, z = 2.0 * body.box()
    expected = body.mass / 12.0 * np.array([y * y + z * z, x * x + z * z, x * x + y * y])
    assert body.inertia == pytest.approx(expected, rel=1e-12)


def test_pieces_cover_the_spheres(case):
    """In every direction the pieces reach as far as the spheres, but for the gaps between the directions of the outline."""
    body = PrincipalBody(case[0].bodies[0])
    vertices = np.concatenate(body.pieces())
    directions = np.random.default_rng(0).standard_normal((200, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    spheres = np.max(body.centers @ directions.T + body.radii[:, None], axis=0)
    reached = np.max(vertices @ directions.T, axis=0)
    assert np.all(reached <= spheres + 1e-12)
    assert np.all(reached >= 0.95 * spheres)


@pytest.mark.parametrize("geometry", GEOMETRIES)
@pytest.mark.parametrize("name", PEERS)
def test_free_flight_is_ours(name, geometry, case):
    pytest.importorskip(name)
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
@pytest.mark.parametrize("name", PEERS)
def test_collisions_keep_the_momentum(name, geometry, case):
    pytest.importorskip(name)
    scene, belief, _ = case
    engine = PEERS[name](scene, geometry)
    assert engine.shapes() == {"spheres": [50, 50], "pieces": [16, 16], "box": [1, 1]}[geometry]
    end = engine.run(belief.mean.copy(), 150)
    free = np.exp(-1.5 * scene.damping)
    assert np.abs(end[:, VELOCITY].sum(axis=0)).max() < 0.02 * free
    assert np.abs(end[0, VELOCITY] - free * belief.mean[0, VELOCITY]).max() > 0.05 * free  # they did meet
    engine.close()
