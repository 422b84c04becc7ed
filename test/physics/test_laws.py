"""Laws of the explicit step beyond the paper's: environment and gyroscopic term."""

import math
from dataclasses import replace

import numpy as np
import pytest
from plain_scenes import BALL, PLATE, G, run, state, tumbling_orientation
from scipy.spatial.transform import Rotation

from unc_physics import RigidBody, Scene
from unc_physics.collision.contact_model import cap, lens, shallow_energy, shallow_slope, shallow_volume
from unc_physics.scene.environment import Plane
from unc_physics.scene.stiffness import auto_stiffness


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
