"""The laws that any propagator keeps, for one of another package: run where `antithetic` is installed."""

from dataclasses import replace

import numpy as np
from example_scenes import parts_of, three_bodies

from unc_physics import PROPAGATORS, AtRest, BoxRegion, InRegion, Touches, assess, make_propagator, predict
from unc_physics.propagators.names import BUILT_IN
from unc_physics.scene.scene_file import scene_from_dict
from unc_physics.spatial.moments import pose_spreads

# listed after the built-in ones
assert list(PROPAGATORS) == [*BUILT_IN, "antithetic"]
scene, belief, _ = scene_from_dict(three_bodies())
antithetic = make_propagator("antithetic", pairs=30)

# the samples' mean is that of the belief, and of linear functions of it: here of free flights
start = antithetic.init(scene, belief)
np.testing.assert_allclose(antithetic.belief(start, scene).mean, belief.mean, atol=1e-12)
falling = antithetic.advance(start, scene, 20)
assert np.isinf(falling.contact_history.first_time).all()
exact = predict(scene, belief, "linearization", 20 * scene.dt).belief.mean
np.testing.assert_allclose(antithetic.belief(falling, scene).mean[:, :6], exact[:, :6], atol=1e-12)
assert antithetic.standard_errors(falling, scene).position.max() < 1e-12

# the same bits at once and in pieces
first, pieces = (
    predict(scene, belief, antithetic, 1.0, times=[0.5], progress=progress)
    for progress in (None, lambda done, steps: None)
)
for one, other in zip(parts_of(pieces.carry), parts_of(first.carry), strict=True):
    np.testing.assert_array_equal(one, other)
for one, other in zip(pieces.beliefs, first.beliefs, strict=True):
    np.testing.assert_array_equal(one.joint, other.joint)

# samples and standard errors: those of another seed are as far away as they claim
assert first.samples().shape == (60, len(scene.bodies), 13) and first.seed == 0
assert first.samples(7).shape == (7, len(scene.bodies), 13)
errors = antithetic.standard_errors(first.carry, first.scene)
other = predict(scene, belief, replace(antithetic, seed=1), 1.0).belief.mean
distances = np.linalg.norm((first.belief.mean - other)[scene.moving, :3], axis=1)
ratios = distances / errors.position[scene.moving]
assert (ratios > 0.05).all() and (ratios < 5.0).all(), ratios

# spreads of other seeds differ by what their standard errors claim, before and after the contact
for steps in (0, 100):
    carries = [
        seeded.advance(seeded.init(scene, belief), scene, steps)
        for seeded in (replace(antithetic, seed=seed) for seed in range(40))
    ]
    spreads = np.array([pose_spreads(antithetic.belief(carry, scene).blocks) for carry in carries])
    claimed = [antithetic.standard_errors(carry, scene) for carry in carries]
    claimed = np.median([[one.position_spread, one.rotation_spread] for one in claimed], axis=0)
    for k, spread in enumerate(spreads.transpose(2, 0, 1)):
        seen = spread.std(axis=0) / np.maximum(spread.mean(axis=0), 1e-300)
        uncertain = spread.mean(axis=0) > 1e-9
        ratios = claimed[k, scene.moving][uncertain] / seen[uncertain]
        assert (ratios > 0.6).all() and (ratios < 1.7).all(), (steps, k, ratios)

# statuses and probabilities
assert len(assess(first)) == len(scene.bodies)
names = [body.name for body in scene.bodies if body.free]
for event in (Touches(*names[:2]), AtRest(names[0]), InRegion(names[0], BoxRegion("here", (1.0, 1.0, 1.0)))):
    assert first.probability(event, time=0.5).method == "samples"

# the implicit step
everyday = replace(scene, integrator="implicit", stiffness=None, friction=0.5, gravity=(0.0, 0.0, -9.81))
assess(predict(everyday, belief, antithetic, 0.1), rollouts=2)
print("kept")
