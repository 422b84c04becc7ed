"""Rollouts through the full simulator, as carries hold them."""

from __future__ import annotations

from typing import Any

from ..dynamics import contact_history as histories
from ..dynamics.rollout import rollout
from ..scene.parameters import rollout_varied
from ..scene.scene import Scene


def advance_rollouts(carry: Any, scene: Scene, steps: int) -> Any:
    """Return the carry after ``steps`` time steps.

    Its ``states`` (N, B, 13) are simulated, with its ``parameters`` (N, K) where the scene's are uncertain.
    """
    states, history = carry.states.copy(), histories.copy(carry.contact_history)
    if scene.uncertain:
        rollout_varied(states, history, scene, carry.parameters, carry.step, steps)
    else:
        rollout(states, history, scene.world, carry.step, steps)
    return carry._replace(states=states, contact_history=history, step=carry.step + steps)
