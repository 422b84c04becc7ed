"""Rollouts as arrays, for controllers, learning and other statistics than those of a `Prediction`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..checks.errors import InvalidHorizonError, InvalidRequestError, NotSupportedError
from ..checks.memory import require_memory
from ..checks.validation import flag, instance
from ..physics.everyday.columns import FRICTION, RESTITUTION
from ..propagators.names import REFERENCE
from ..propagators.registry import make_propagator
from ..propagators.start import constrain_belief
from ..scene.belief import Belief
from ..scene.contact_world import CONTACT, contact_table, variation
from ..scene.environment import thing_names
from ..scene.scene import Scene
from ..spatial.layout import STATE
from .actions import Action, after_actions
from .request_checks import check_supported, marks_of, rollout_bytes

_PORTION = 2.0**27  # bytes that are simulated at once; contacts take far more than states
_FEWEST = 64  # rollouts in a portion, so that all threads have work

#: Columns of `RolloutStates.contacts`: place, then columns of `contact_table`.
_PLACE = [(name, np.int64) for name in ("action", "time", "sample", "body", "partner")]
CONTACTS = np.dtype(_PLACE + [(name, CONTACT[name]) for name in ("point", "normal", "gap", "impulse")])


@dataclass(frozen=True, eq=False, repr=False)
class RolloutStates:
    """Simulated rollouts of N samples at T times, of B bodies and E elements of the environment.

    With K actions, `states`, `friction` and `restitution` have a leading axis of length K.

    Attributes
    ----------
    states : (N, T, B, 13) array
        As in `Belief.mean`. NaN for rollouts that left the range of numbers.
    times : (T,) array
        From the start [s].
    friction, restitution : (N, B + E) array
        Coefficients that each rollout drew for its bodies, then for its elements.
    contacts : structured array or None
        Contacts in the last step before each time, if they were asked for. Columns: ``action`` (0 without
        actions), ``time`` and ``sample``, indices; ``body``; ``partner``, a body, or B + e for element e;
        ``point`` in the middle of the gap [m] and ``normal`` from the partner to the body, world frame;
        ``gap``, below zero for a depth [m]; ``impulse`` of the step on the body, world axes [N s].
    seed : int
    """

    states: np.ndarray
    times: np.ndarray
    friction: np.ndarray
    restitution: np.ndarray
    contacts: np.ndarray | None
    seed: int

    def __repr__(self) -> str:
        samples, times, bodies = self.states.shape[-4:-1]
        actions = f", {len(self.states)} actions" if self.states.ndim > 4 else ""
        return f"<RolloutStates of {samples} samples at {times} times, {bodies} bodies{actions}>"


def rollouts(
    scene: Scene,
    belief: Belief,
    samples: int,
    times: float | Sequence[float],
    actions: Sequence[Action] | Mapping[str, Action] | None = None,
    seed: int | None = None,
    contacts: bool = False,
) -> RolloutStates:
    """Simulate samples of a belief, and return their states without moments and status.

    The samples are those of ``monte_carlo`` with the same seed.

    Parameters
    ----------
    scene : Scene
    belief : Belief
        About the bodies of the scene at time 0.
    samples : int
        Number N of rollouts, of each action.
    times : float or sequence of float
        T times, ascending [s].
    actions : sequence or mapping of Action, optional
        K actions as in `rank`. All have the same random draws as long as the same things are uncertain. They
        keep the names of bodies and elements.
    seed : int, optional
        Seed of the draws, by default 0.
    contacts : bool
        Whether contacts are returned, of the implicit integrator.

    Returns
    -------
    RolloutStates

    Raises
    ------
    InvalidRequestError, InvalidOptionError, LimitExceededError, InvalidHorizonError, NotSupportedError
        For wrong arguments, contacts with the explicit integrator, and times as `predict`.
    """
    instance(scene, Scene, "scene")
    instance(belief, Belief, "belief")
    propagator: Any = make_propagator(REFERENCE, samples=samples, seed=0 if seed is None else seed)
    if flag(contacts, "contacts") and scene.integrator == "explicit":
        raise NotSupportedError(
            "has no contacts as data; 'implicit' has", field="integrator", value=scene.integrator
        )
    samples = propagator.samples

    def case(own, own_belief):
        if thing_names(own) != thing_names(scene):
            raise InvalidRequestError("must keep the names of bodies and elements")
        return own, own_belief

    cases = [(scene, belief)]
    if actions is not None:
        cases = list(after_actions(scene, belief, actions, case).values())
    at = np.atleast_1d(np.asarray(times, float))
    shape = len(cases), samples, len(at), len(scene.bodies), STATE
    require_memory(8.0 * math.prod(shape), f"{samples} rollouts", "samples", samples)
    states, found = np.empty(shape), []
    materials = np.empty((len(cases), 2, samples, len(scene.surfaces)))
    for k, (own, own_belief) in enumerate(cases):
        own_belief.check_fits(own)
        check_supported(own, propagator)
        marks = marks_of(own, None, at.tolist())
        if len(marks) != len(at):
            raise InvalidHorizonError("must ascend", field="times", value=at.tolist())
        start = constrain_belief(own, own_belief)
        drawn = propagator.drawn(own, start, samples)
        portion = max(int(_PORTION / (len(at) * rollout_bytes(own))), _FEWEST)
        for first in range(0, samples, portion):
            some = slice(first, min(first + portion, samples))
            carry = propagator.start_rollouts(own, start, drawn[some], first)
            materials[k, :, some] = _materials(own, carry.parameters)
            for t, reached in enumerate(propagator.advance_through(carry, own, marks)):
                states[k, some, t] = propagator.own_samples(reached, own)
                if contacts:
                    found.append(_contacts(own, reached.contact_history, k, t, first))
    friction, restitution = materials[:, 0], materials[:, 1]
    if actions is None:
        states, friction, restitution = states[0], friction[0], restitution[0]
    table = np.concatenate(found) if contacts else None
    return RolloutStates(states, at, friction, restitution, table, propagator.seed)


def _materials(scene, z):
    """Return friction and restitution (2, N, B + E) of rollouts with parameters ``z`` (N, K)."""
    if scene.integrator == "explicit":
        return np.array(scene.materials)[:, None]
    things = len(scene.surfaces)
    return variation(scene, z).materials[:, [FRICTION, RESTITUTION], :things].transpose(1, 0, 2)


def _contacts(scene, history, action, time, first):
    """Return rows of `RolloutStates.contacts` of a portion of rollouts from the ``first`` on."""
    table = contact_table(scene, history)
    found = np.empty(len(table), CONTACTS)
    found["action"], found["time"], found["sample"] = action, time, table["rollout"] + first
    found["body"], found["partner"] = table["second"], table["first"]
    for name in ("point", "normal", "gap", "impulse"):
        found[name] = table[name]
    return found
