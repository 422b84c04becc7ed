"""Rollouts through the full simulator, as carries hold them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..dynamics import contact_history as histories
from ..dynamics.rollout import recorded
from ..scene.contact_world import recorded_contacts
from ..scene.marks import Mark, whole
from ..scene.parameters import recorded_varied
from ..scene.scene import Scene
from ..spatial.layout import ANGULAR_VELOCITY, VELOCITY
from .base import Propagator


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
    if scene.integrator == "contact":
        found = recorded_contacts(
            carry.states, carry.contact_history, scene, carry.parameters, carry.step, marks
        )
        return [
            carry._replace(states=states, contact_history=history, step=mark.fraction_of(scene.dt))
            for mark, (states, history) in zip(marks, found, strict=True)
        ]
    if _all_sleep(carry, scene):
        return [carry._replace(step=mark.fraction_of(scene.dt)) for mark in marks]
    states, history = carry.states.copy(), histories.copy(carry.contact_history)
    stops = scene.stops(carry.step, marks)
    if scene.uncertain:
        found = recorded_varied(states, history, scene, carry.parameters, carry.step, stops)
    else:
        found = recorded(states, history, scene.world, carry.step, stops)
    return [
        carry._replace(states=states, contact_history=history, step=mark.fraction_of(scene.dt))
        for mark, (states, history) in zip(marks, found, strict=True)
    ]


def _all_sleep(carry, scene):
    """Return whether no step changes anything: all bodies sleep in all rollouts, and nothing wakes them."""
    if scene.acts or not len(scene.moving):
        return False
    sleeping = histories.asleep(carry.contact_history, scene.world)[:, scene.moving]
    if not sleeping.all():
        return False
    states = carry.states[:, scene.moving]
    return not states[..., VELOCITY].any() and not states[..., ANGULAR_VELOCITY].any()
