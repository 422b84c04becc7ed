"""Small contact problems: without friction against non-negative least squares, with it against Coulomb's law.

Impulses J^T x with x >= 0 at contacts that may only open, J v >= 0, and no rebound: the velocities v are the
nearest ones to those before, in the metric of the masses. Their dual is a problem for `scipy.optimize.nnls`.
"""

import numpy as np
import pytest
from everyday_worlds import FLOOR, about, run, solid_ball, solid_box, world
from plain_scenes import state
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation

from unc_physics import Belief, Box, make_propagator, predict

STEP = 1e-4  # s, in which nothing moves far
SIZE = np.array([0.1, 0.08, 0.06])
CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * SIZE


def nearest_velocities(bodies, start, contacts):
    """Return velocities and spins (6 B,) after contacts without friction and rebound.

    A contact is (first, second, point, normal): the normal points to the first body; the second may be None.
    """
    mass = np.zeros((6 * len(bodies), 6 * len(bodies)))
    for k, body in enumerate(bodies):
        R = Rotation.from_quat(start[k, 6:10]).as_matrix()
        mass[6 * k : 6 * k + 3, 6 * k : 6 * k + 3] = body.mass * np.eye(3)
        mass[6 * k + 3 : 6 * k + 6, 6 * k + 3 : 6 * k + 6] = body.mass * R @ body.model.inertia @ R.T
    before = np.concatenate([np.concatenate([x[3:6], x[10:]]) for x in start])
    J = np.zeros((len(contacts), 6 * len(bodies)))
    for row, (first, second, point, normal) in zip(J, contacts, strict=True):
        for k, n in ((first, np.asarray(normal, float)), (second, -np.asarray(normal, float))):
            if k is not None:
                row[6 * k : 6 * k + 3] += n
                row[6 * k + 3 : 6 * k + 6] += np.cross(point - start[k, :3], n)
    root = np.linalg.cholesky(mass)
    inverse = np.linalg.inv(root)
    impulses, _ = nnls(inverse @ J.T, -root.T @ before)
    return before + np.linalg.solve(mass, J.T @ impulses)


def check(bodies, start, contacts, environment, within):
    """Compare one step with the nearest velocities, relative to the speeds before."""
    scene = world(*bodies, dt=STEP, gravity=None, friction=0.0, environment=environment)
    end = run(scene, start, STEP)
    found = np.concatenate([np.concatenate([x[3:6], x[10:]]) for x in end]).reshape(-1, 2, 3)
    right = nearest_velocities(bodies, start, contacts).reshape(-1, 2, 3)
    before = np.stack([start[:, 3:6], start[:, 10:]], axis=1)
    assert np.abs(right - before)[:, 0].max() > 10 * within, "contacts must act"
    reach = 0.05  # m, at which spins make speeds
    np.testing.assert_allclose(found[:, 0], right[:, 0], rtol=0, atol=within)
    np.testing.assert_allclose(found[:, 1], right[:, 1], rtol=0, atol=within / reach)


def velocities(rng, count, speed):
    """Return velocities and spins (count, 2, 3) of points at a distance of a few centimetres."""
    return rng.standard_normal((count, 2, 3)) * np.array([speed, 15 * speed])[:, None]


def moving(rng, speed, positions, orientation=(0, 0, 0, 1)):
    """Return states (B, 13) with random velocities."""
    v = velocities(rng, len(positions), speed)
    return np.array([state(p, a, w, orientation) for p, (a, w) in zip(positions, v, strict=True)])


@pytest.mark.parametrize("seed", range(8))
def test_a_face_that_hits_the_floor(seed):
    """Four corners at once; also where some of them open."""
    rng = np.random.default_rng(seed)
    start = moving(rng, 0.5, [(0, 0, 0.03)], about((0, 0, 1), 0.4))
    start[0, 5] = -abs(start[0, 5])
    low = Rotation.from_quat(start[0, 6:10]).apply(CORNERS[CORNERS[:, 2] < 0]) + start[0, :3]
    contacts = [(0, None, point, (0, 0, 1)) for point in low]
    check([solid_box("b", SIZE, 0.5)], start, contacts, [FLOOR], 2e-3)


@pytest.mark.parametrize("seed", range(4))
def test_an_edge_that_hits_the_floor(seed):
    """Two corners of a tilted box."""
    rng = np.random.default_rng(seed)
    turn = Rotation.from_rotvec([0, 0.5, 0])
    points = turn.apply(CORNERS)
    low = points[points[:, 2] < points[:, 2].min() + 1e-9]
    position = np.array([0, 0, -low[0, 2]])
    start = moving(rng, 0.5, [position], turn.as_quat())
    start[0, 5] = -abs(start[0, 5])
    check(
        [solid_box("b", SIZE, 0.5)], start, [(0, None, p + position, (0, 0, 1)) for p in low], [FLOOR], 2e-3
    )


@pytest.mark.parametrize("seed", range(4))
def test_a_ball_in_a_corner(seed):
    """Three walls, slowly, so that they are solved together."""
    rng = np.random.default_rng(seed)
    start = moving(rng, 0.01, [(0.03, 0.03, 0.03)])
    start[0, 3:6] = -np.abs(start[0, 3:6])
    walls = [FLOOR, Box((0.02, 1, 1), (-0.01, 0, 0.4)), Box((1, 0.02, 1), (0, -0.01, 0.4))]
    contacts = [(0, None, start[0, :3] - 0.03 * n, n) for n in np.eye(3)]
    check([solid_ball("b", 0.03, 0.2)], start, contacts, walls, 3e-4)


@pytest.mark.parametrize("ratio", [0.1, 1.0, 10.0])
@pytest.mark.parametrize("seed", range(3))
def test_a_stack_that_is_pressed(seed, ratio):
    """Two boxes on the floor with eight contacts, slowly."""
    rng = np.random.default_rng(seed)
    start = moving(rng, 0.005, [(0, 0, 0.03), (0.02, 0.01, 0.09)])
    start[:, 5] = -0.01
    low = CORNERS[CORNERS[:, 2] < 0]
    meet = np.array([[x, y, 0.06] for x in (-0.03, 0.05) for y in (-0.03, 0.04)])  # where the faces overlap
    contacts = [(0, None, p + start[0, :3], (0, 0, 1)) for p in low]
    contacts += [(1, 0, p, (0, 0, 1)) for p in meet]
    bodies = [solid_box("low", SIZE, 0.5), solid_box("high", SIZE, 0.5 * ratio)]
    check(bodies, start, contacts, [FLOOR], 3e-4)


# -- with Coulomb's friction ----------------------------------------------------------------------------


def step_with_contacts(scene, start):
    """Return the velocities (B, 2, 3) after one step, and its contacts."""
    belief = Belief.exact(start, scene.moving)
    found = predict(scene, belief, make_propagator("monte_carlo", samples=1), scene.dt)
    end = found.samples()[0]
    return np.stack([end[:, 3:6], end[:, 10:]], axis=1), found.contacts()


def misfit(bodies, start, after, contacts, mu):
    """Return by how much velocities and impulses break the laws of Newton, Signorini and Coulomb [m/s].

    The impulses at the contacts must give the change of the velocities; they only push, and where a contact
    opens there is none; friction is in its cone, and where a contact slides on the cone against the velocity.
    """
    before = np.stack([start[:, 3:6], start[:, 10:]], axis=1)
    given, worst, light = before.copy(), 0.0, min(body.mass for body in bodies)
    for contact in contacts:
        a, b, point, normal, impulse = contact[["first", "second", "point", "normal", "impulse"]]
        u = np.zeros(3)
        for k, sign in ((a, -1.0), (b, 1.0)):
            if k < len(bodies):
                body, R = bodies[k], Rotation.from_quat(start[k, 6:10]).as_matrix()
                arm = point - start[k, :3]
                given[k, 0] += sign * impulse / body.mass
                inertia = body.mass * R @ body.model.inertia @ R.T
                given[k, 1] += sign * np.linalg.solve(inertia, np.cross(arm, impulse))
                u += sign * (after[k, 0] + np.cross(after[k, 1], arm))
        closing, push = normal @ u, normal @ impulse / light
        slip, friction = u - closing * normal, impulse / light - push * normal
        size, speed = np.linalg.norm(friction), np.linalg.norm(slip)
        worst = max(worst, -closing, -push, min(closing, push), size - mu * push)
        if push > 0.0:
            worst = max(worst, min(speed, mu * push - size))  # what slides is on the cone
            if min(speed, size) > 0.0:
                worst = max(worst, min(speed, size) * 0.5 * np.linalg.norm(slip / speed + friction / size))
    return max(worst, np.abs(given - after)[:, 0].max(), 0.05 * np.abs(given - after)[:, 1].max())


def pressed_face(rng):
    """A box whose face is pressed to the floor: four contacts."""
    start = moving(rng, 0.01, [(0, 0, 0.03)], about((0, 0, 1), rng.uniform(0, 3)))
    start[:, 5] = -0.02
    return [solid_box("b", SIZE, 0.5)], start, [FLOOR]


def pressed_edge(rng):
    """A box that lies on an edge: two contacts."""
    turn = Rotation.from_rotvec([0, 0.5, 0])
    start = moving(rng, 0.01, [(0, 0, -turn.apply(CORNERS)[:, 2].min())], turn.as_quat())
    start[:, 5] = -0.02
    return [solid_box("b", SIZE, 0.5)], start, [FLOOR]


def ball_in_corner(rng):
    """A ball at three walls: three contacts."""
    start = moving(rng, 0.01, [(0.03, 0.03, 0.03)])
    start[0, 3:6] = -np.abs(start[0, 3:6])
    walls = [FLOOR, Box((0.02, 1, 1), (-0.01, 0, 0.4)), Box((1, 0.02, 1), (0, -0.01, 0.4))]
    return [solid_ball("b", 0.03, 0.2)], start, walls


def heap_of_balls(rng):
    """A ball on two that lie on the floor: four contacts of three bodies."""
    top = 0.03 + 0.06 * np.sin(np.pi / 3)
    start = moving(rng, 0.004, [(-0.03, 0, 0.03), (0.03, 0, 0.03), (0, 0, top)])
    start[:, 5] = -0.01
    return [solid_ball(f"b{k}", 0.03, m) for k, m in enumerate(rng.uniform(0.1, 0.5, 3))], start, [FLOOR]


@pytest.mark.parametrize("problem", [pressed_face, pressed_edge, ball_in_corner, heap_of_balls])
@pytest.mark.parametrize("mu", [0.1, 0.4, 0.9])
def test_impulses_obey_coulombs_law(problem, mu):
    """Random small problems, slow enough to be solved together."""
    for seed in range(10):
        bodies, start, environment = problem(np.random.default_rng(seed))
        scene = world(*bodies, dt=STEP, gravity=None, friction=mu, environment=environment)
        after, contacts = step_with_contacts(scene, start)
        assert np.linalg.norm(contacts["impulse"], axis=1).max() > 1e-3 * bodies[0].mass, "contacts must act"
        assert misfit(bodies, start, after, contacts, mu) < 3e-4, seed
