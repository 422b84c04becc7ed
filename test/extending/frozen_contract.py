"""What is asked of any propagator, of one from another package: run where `frozen` is installed."""

from dataclasses import replace

import numpy as np
from example_scenes import three_bodies

from unc_physics import PROPAGATORS, assess, contact_probabilities, make_propagator, predict, start_belief
from unc_physics.prediction.probabilities import BoxRegion, region_probabilities, rest_probabilities
from unc_physics.propagators.names import BUILT_IN
from unc_physics.scene.scene_file import scene_from_dict
from unc_physics_evaluation.comparison import error_rows, monte_carlo
from unc_physics_evaluation.jobs import Job
from unc_physics_evaluation.methods import color, label, methods
from unc_physics_evaluation.wasserstein import representatives


def arrays(carry):
    """All numbers of a carry."""
    parts = carry if isinstance(carry, tuple) else (carry,)
    return (
        [np.asarray(carry)]
        if not isinstance(carry, tuple)
        else [a for p in parts if p is not None for a in arrays(p)]
    )


# listed: the paper's four methods, what they are measured by, then those of other packages
assert list(PROPAGATORS) == [*BUILT_IN, "frozen"]
scene, belief, _ = scene_from_dict(three_bodies())
scale = make_propagator("frozen", scale=2.0)

# alone, by islands, in pieces
predictions = []
for islands in (False, True):
    for progress in (None, lambda done, steps: None):
        found = predict(replace(scene, islands=islands), belief, scale, 1.0, times=[0.5], progress=progress)
        for now in found.beliefs:
            np.testing.assert_array_equal(now.mean, belief.mean)
            np.testing.assert_array_equal(now.blocks, 2.0 * belief.blocks)
        predictions.append(found)
for found in predictions[1:]:
    for one, other in zip(arrays(found.carry), arrays(predictions[0].carry), strict=True):
        np.testing.assert_array_equal(one, other)
assert predictions[0].samples(7).shape == (7, len(scene.bodies), 13)
assert predictions[0].kept is None and predictions[0].seed is None

# statuses: bodies that move away from where they are said to stay do so in the rollouts
statuses = assess(predictions[0])
assert any(status.measures.get("spread_disagreement", 0.0) > 1.0 for status in statuses)

# probabilities
contact_probabilities(predictions[0])
rest_probabilities(predictions[0])
region_probabilities(predictions[0], [BoxRegion("here", (1.0, 1.0, 1.0))])

# the implicit step's beginning
everyday = replace(scene, integrator="implicit", friction=0.5, islands=True, gravity=(0.0, 0.0, -9.81))
found = predict(everyday, belief, "frozen", 0.1)
began = start_belief(everyday, belief)
np.testing.assert_allclose(found.belief.mean, began.mean, atol=1e-12)
assess(found, rollouts=2)

# the evaluation's comparison
job = Job("collisions", {"distance": "exact"})
truth, second = (monte_carlo(scene, belief, 0.5, 20, seed) for seed in (1, 2))
frozen = "frozen", None
answers = {frozen: predict(scene, belief, methods(job)[frozen], 0.5).belief}
rows = error_rows(job, truth, second, answers, [5], 20)
assert any(row.method == "frozen" and row.value > 0.0 for row in rows)
assert representatives(predictions[0], 9, np.random.default_rng(0)).shape == (9, len(scene.bodies), 13)
assert (label("frozen"), color("frozen")) == ("frozen", "#66A61E")
print("kept")
