"""Laws of the explicit step beyond the paper's: environment and gyroscopic term."""

import math
from dataclasses import replace

import numpy as np
import pytest
from example_scenes import parts_of
from plain_scenes import BALL, BLOCK, PLATE, G, energy, run, state
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from unc_physics import Belief, RigidBody, Scene, make_propagator, predict
from unc_physics.collision.contact_model import cap, lens, shallow_energy, shallow_slope, shallow_volume
from unc_physics.scene.environment import Box, Plane
from unc_physics.scene.stiffness import auto_stiffness


def test_a_cap_is_continuous_and_its_volume_that_of_the_sphere_at_most():
    r = 0.3
    distances = np.linspace(-0.5, 0.5, 2001)
    volumes = np.array([cap(d, r)[0] for d in distances])
    assert volumes[0] == pytest.approx(4 / 3 * math.pi * r**3) and volumes[-1] == 0.0
    assert np.all(np.diff(volumes) <= 0) and np.abs(np.diff(volumes)).max() < math.pi * r**2 * 0.00051
    # the derivative by depth is the area of the circle on the surface
    h = 1e-6
    slope = (cap(0.1 - h, r)[0] - cap(0.1 + h, r)[0]) / (2 * h)
    assert slope == pytest.approx(math.pi * (r**2 - 0.1**2), rel=1e-6)


@pytest.mark.parametrize("ri, rj", [(0.3, 0.3), (0.3, 0.05), (0.3, math.inf)])
def test_shallow_overlaps_are_those_of_small_depths(ri, rj):
    """Volume, slope and energy to leading order in the depth, against those of the lens or the cap."""
    R = ri if math.isinf(rj) else ri * rj / (ri + rj)
    depths = 1e-4 * R * np.linspace(0.0, 1.0, 201)
    volumes = np.array(
        [cap(ri - d, ri)[0] if math.isinf(rj) else lens(ri + rj - d, ri, rj)[0] for d in depths]
    )
    d, LEADING_ORDER = depths[-1], 1e-3
    assert shallow_volume(R, d) == pytest.approx(volumes[-1], rel=LEADING_ORDER)
    assert shallow_energy(R, d) == pytest.approx(np.trapezoid(volumes, depths), rel=LEADING_ORDER)
    assert shallow_slope(R, depths[-2]) == pytest.approx(
        (volumes[-1] - volumes[-3]) / (depths[-1] - depths[-3]), rel=LEADING_ORDER
    )


def test_a_plane_pushes_with_the_caps_volume():
    scene = Scene(
        [RigidBody("b", BALL, 2.0)],
        dt=1e-3,
        stiffness=1e5,
        gravity=(0.0, 0.0, 0.0),
        environment=(Plane((0, 0, 2.0), 0.1),),
    )
    x = run(scene, state((0.3, 0.2, 0.13)), 1e-3)  # 2 cm deep
    volume = math.pi * 0.02**2 * (0.15 - 0.02) / 3
    np.testing.assert_allclose(x[0, 3:6], [0, 0, 1e-3 * 1e5 * volume / 2.0], rtol=1e-12)
    np.testing.assert_allclose(x[0, 10:], 0, atol=1e-12)


def test_planes_are_boxes_that_never_end():
    """A tilted body on a tilted plane moves as on the face of a box that has the same surface."""
    R = Rotation.from_rotvec([0.3, -0.2, 0.5])
    plane = Plane(R.apply([0, 0, 1]), 0.0)
    box = Box((50, 50, 10), R.apply([0, 0, -5]), R.as_quat())
    x = state(R.apply([0, 0, 0.08]), (0.2, 0, -1), (1, 2, 3), Rotation.from_rotvec([0.5, 0.4, 0]).as_quat())
    scenes = [
        Scene([RigidBody("b", BLOCK, 0.5)], dt=1e-3, stiffness=1e7, gravity=(0.0, 0.0, 0.0), environment=(e,))
        for e in (plane, box)
    ]
    a, b = (run(scene, x, 0.3) for scene in scenes)
    np.testing.assert_allclose(a, b, atol=1e-8)


@pytest.mark.parametrize("gyroscopic", [False, True])
def test_momentum_is_kept_in_contact(gyroscopic):
    """Two spinning blocks meet in space; the gyroscopic term keeps energy, up to the step's own error."""
    bodies = [RigidBody("a", BLOCK, 0.5), RigidBody("b", BLOCK, 1.5)]
    scene = Scene(bodies, dt=1e-4, stiffness=1e8, gyroscopic=gyroscopic)
    x = np.array(
        [
            state((-0.12, 0, 0.01), (1, 0, 0), (3, -2, 5), Rotation.from_rotvec([0.3, 0.2, 0.1]).as_quat()),
            state(
                (0.12, 0.01, 0), (-0.5, 0.1, 0), (-1, 4, 2), Rotation.from_rotvec([-0.4, 0.5, 1]).as_quat()
            ),
        ]
    )
    y = run(scene, x, 0.5)
    m = np.array([[0.5], [1.5]])
    assert np.linalg.norm(y[:, 3:6] - x[:, 3:6]) > 0.1, "they must have met"
    np.testing.assert_allclose((m * y[:, 3:6]).sum(0), (m * x[:, 3:6]).sum(0), atol=1e-12)
    if gyroscopic:  # without, free flight keeps no angular momentum to compare energies by
        assert energy(scene, y) == pytest.approx(energy(scene, x), rel=0.01)


def test_the_gyroscopic_term_conserves_angular_momentum_and_follows_euler():
    """A plate thrown about its middle axis tumbles as a fine integration of Euler's equations says."""
    scene = Scene([RigidBody("p", PLATE, 2.0)], dt=1e-3, gyroscopic=True)
    spin, orientation = np.array([0.05, 6.0, 0.02]), Rotation.from_rotvec([0.2, -0.1, 0.3])
    x = state(spin=spin, orientation=orientation.as_quat())
    y = run(scene, x, 2.0)[0]
    inertia = 2.0 * PLATE.inertia

    def momentum(s):
        R = Rotation.from_quat(s[6:10]).as_matrix()
        return R @ inertia @ R.T @ s[10:]

    np.testing.assert_allclose(momentum(y), momentum(x), atol=1e-12)

    def euler(t, s):
        q, w = s[:4] / np.linalg.norm(s[:4]), s[4:]
        half = 0.5 * w  # body axes
        dq = np.array(
            [
                q[3] * half[0] + q[1] * half[2] - q[2] * half[1],
                q[3] * half[1] + q[2] * half[0] - q[0] * half[2],
                q[3] * half[2] + q[0] * half[1] - q[1] * half[0],
                -q[:3] @ half,
            ]
        )
        return np.concatenate([dq, np.linalg.solve(inertia, -np.cross(w, inertia @ w))])

    fine = solve_ivp(
        euler,
        (0, 2.0),
        np.concatenate([orientation.as_quat(), orientation.inv().apply(spin)]),
        rtol=1e-11,
        atol=1e-12,
    )
    apart = Rotation.from_quat(y[6:10]).inv() * Rotation.from_quat(fine.y[:4, -1])
    assert apart.magnitude() < 0.01
    without = run(replace(scene, gyroscopic=False), x, 2.0)[0]
    assert (Rotation.from_quat(without[6:10]).inv() * Rotation.from_quat(fine.y[:4, -1])).magnitude() > 0.5


@pytest.mark.parametrize(
    "name", ["linearization", "surrogate", "sigma_points", "local_sampling", "monte_carlo"]
)
def test_pieces_of_a_prediction_equal_the_whole(name):
    """A saved carry goes on bit for bit, with everything that a scene can have."""
    scene = Scene(
        [RigidBody("a", BLOCK, 0.5), RigidBody("b", BALL, 0.3)],
        dt=0.005,
        stiffness=1e6,
        gravity=(0, 0, -G),
        environment=(Plane(), Box((0.1, 0.1, 0.1), (0.3, 0, 0.05))),
        gyroscopic=True,
    )
    mean = np.array([state((0, 0, 0.05), (1, 0, 0), (1, 2, 3)), state((0.02, 0.01, 0.15), (0, 0, -1))])
    P = np.zeros((2, 12, 12))
    P[:, [0, 1, 2], [0, 1, 2]] = 1e-4
    belief = Belief(mean, P)
    propagator = make_propagator(name, **({"samples": 8} if name == "monte_carlo" else {}))
    whole = propagator.advance(propagator.init(scene, belief), scene, 80)
    carry = propagator.init(scene, belief)
    for steps in (1, 30, 49):
        carry = propagator.advance(carry, scene, steps)
    for a, b in zip(parts_of(carry), parts_of(whole), strict=True):
        np.testing.assert_array_equal(a, b)
    P = predict(scene, belief, propagator, 0.4).belief.joint
    assert np.array_equal(P, P.T) and np.linalg.eigvalsh(P).min() > -1e-12 * P.max()


def test_auto_stiffness_limits_penetration():
    bodies = [RigidBody("b", BALL, 0.5)]
    x = state((0, 0, 0.06), (0, 0, -1.0))
    kappa = auto_stiffness(bodies, x[None], (0, 0, -G), penetration=0.1)
    scene = Scene(bodies, dt=5e-4, stiffness=kappa, gravity=(0, 0, -G), environment=(Plane(),))
    lowest = min(run(scene, x, t)[0, 2] for t in np.arange(0.002, 0.06, 0.002))
    assert 0.0 < 0.05 - lowest < 0.1 * 0.05
