"""Run where the cone of docs/extending.md is among the shapes; ``rollout`` lets a ball fall on it."""

import sys

import numpy as np

from unc_physics import Belief, RigidBody, Scene, encounters, load_model, load_scene, make_propagator, predict
from unc_physics.propagators.overlap_depths import overlaps
from unc_physics.scene.environment import Cone
from unc_physics.shapes.mass_properties import mass_properties
from unc_physics.view.meshes import element_mesh

cone = Cone(0.3, 0.8, position=(0.1, 0.0, 0.0))
points = np.random.default_rng(0).uniform(-1.0, 1.0, (2000, 3)) + cone.position
distance, normal = cone.surface(points)
np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1.0)
# the nearest of many points on the base's and the side's surface
rho, z = np.concatenate(
    [
        np.column_stack([np.linspace(0.0, 0.3, 4000), np.full(4000, -0.4)]),
        np.column_stack([np.linspace(0.0, 0.3, 4000), np.linspace(0.4, -0.4, 4000)]),
    ]
).T
local = points - cone.position
away = np.hypot(local[:, 0], local[:, 1])
nearest = np.hypot(away[:, None] - rho, local[:, 2:] - z).min(axis=1)
inside = (local[:, 2] > -0.4) & (away < 0.3 * (0.4 - local[:, 2]) / 0.8)
np.testing.assert_allclose(distance, np.where(inside, -nearest, nearest), atol=2e-4)
foot, _ = cone.surface(points - distance[:, None] * normal)
np.testing.assert_allclose(foot, 0.0, atol=1e-12)
directions = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.6, 0.0, 0.8]])
reach = np.einsum("nk,nk->n", cone.outermost(directions), directions)
np.testing.assert_allclose(reach, [0.4, 0.4, 0.38], atol=1e-6)

# the implicit step takes it as pieces: a cone's volume, and a centre at a quarter of its height
solid = mass_properties(cone.pieces)
np.testing.assert_allclose(solid.volume, np.pi * 0.3**2 * 0.8 / 3.0)
np.testing.assert_allclose(solid.center, cone.position - [0.0, 0.0, 0.2], atol=1e-12)

# the page in the browser draws it as it is, not as its bounding box
vertices, faces = element_mesh(cone, 1.0)
a, b, c = vertices[faces].transpose(1, 0, 2)
volume = np.einsum("nk,nk->", np.cross(a, b), c) / 6.0
np.testing.assert_allclose(volume, np.pi * 0.3**2 * 0.8 / 3.0, rtol=0.03)
np.testing.assert_allclose(cone.surface(vertices + cone.position)[0], 0.0, atol=1e-9)

scene, belief, _ = load_scene("cone.yaml")
assert scene.environment[0].size_row.tolist() == [0.3, 0.4, 0.0]
if sys.argv[1:] == ["rollout"]:
    ball = RigidBody("ball", load_model("pin").prefix(10))
    scene = Scene([ball], gravity=(0.0, 0.0, 0.0), environment=[cone], stiffness=1e5, dt=0.01, damping=0.0)
    states = np.zeros((8, 1, 13))
    states[..., 9], states[..., 0], states[:, 0, 2] = (1.0, 0.08, np.linspace(0.3, 1.0, 8))  # over the tip
    depths, _ = overlaps(scene, states)
    centers = ball.model.centers + states[:, :, :3]
    expected = np.maximum(ball.model.radii - cone.surface(centers)[0], 0.0).max(axis=1)
    assert expected[0] > expected[1] > 0.0 and expected[-1] == 0.0
    np.testing.assert_allclose(depths[:, 0], expected, rtol=1e-4, atol=1e-6)
    mean = np.zeros((1, 13))
    mean[0, [2, 5, 9]] = 0.6, -1.0, 1.0
    belief = Belief(mean, 1e-8 * np.eye(12)[None])
    prediction = predict(scene, belief, make_propagator("monte_carlo", samples=200), 1.0)
    assert prediction.belief.mean[0, 5] > -0.999  # the tip has turned it
    assert prediction.probability(encounters(scene)[0]).low > 0.9
print("kept")
