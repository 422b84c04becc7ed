"""Rollouts through the full simulator, as carries hold them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ..physics import contact_history as histories
from ..physics.contact_history import ContactHistory
from ..physics.paper.rollout import recorded
from ..scene.contact_world import recorded_contacts
from ..scene.marks import Mark, whole
from ..scene.parameters import recorded_varied
from ..scene.scene import Scene
from .base import Propagator


class RolloutCarry(NamedTuple):
    """Persistent state of N rollouts."""

    states: np.ndarray  # (N, B, 13): of the bodies' centres of mass, wherever those are uncertain
    contact_history: ContactHistory  # what the rollouts remember of their contacts
    step: int  # how many are done
    #: (N, K): the rollouts' K uncertain parameters, in standard deviations from their values
    parameters: np.ndarray


class SimulatedRollouts(Propagator):
    """A propagator whose rollouts are simulated, from a carry as below."""

    def advance(self, carry, scene, steps):
        return advance_rollouts(carry, scene, steps)

    def advance_through(self, carry, scene, marks):
        if type(self).advance is not SimulatedRollouts.advance:  # a simulator of its own
            return super().advance_through(carry, scene, marks)
        return recorded_rollouts(carry, scene, marks)


def advance_rollouts(carry: Any, scene: Scene, steps: int) -> Any:
    """Return the carry after ``steps`` time steps.

    Its ``states`` (N, B, 13) are simulated, with its ``parameters`` (N, K) where the scene's are uncertain.
    """
    return recorded_rollouts(carry, scene, [whole(carry.step + steps, scene.dt)])[0]


def recorded_rollouts(carry: Any, scene: Scene, marks: Sequence[Mark]) -> list[Any]:
    """Return the carry at each of several marks, ascending (`base.Propagator.advance_through`).

    Each rollout is simulated to all of them at once: a call of its own costs as much as dozens of steps.
    """
    if scene.integrator == "explicit":
        states, history = carry.states.copy(), histories.copy(carry.contact_history)
        steps = np.array([mark.steps for mark in marks], np.int64) - carry.step
        if scene.uncertain:
            found = recorded_varied(states, history, scene, carry.parameters, carry.step, steps)
        else:
            found = recorded(states, history, scene.world, carry.step, steps)
    else:
        z = carry.parameters if scene.uncertain else np.zeros((len(carry.states), 0))
        found = recorded_contacts(carry.states, carry.contact_history, scene, z, carry.step, marks)
    return [
        carry._replace(states=states, contact_history=history, step=mark.fraction_of(scene.dt))
        for mark, (states, history) in zip(marks, found, strict=True)
    ]
