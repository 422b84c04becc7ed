"""Samples of an initial belief that fly until their bodies first touch something.

Until then all propagators agree, as bodies fly freely.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..compiler import inner, kernel
from ..physics.paper.explicit_step import integrate
from ..physics.paper.rollout import rollout
from ..physics.paper.workspace import workspace
from ..physics.paper.world import Bodies, World
from ..propagators.monte_carlo import MonteCarlo
from ..propagators.start import constrain_belief, draw, resolve_initial_overlap
from ..scene.belief import Belief
from ..scene.kinematic_states import start_states
from ..scene.marks import Mark
from ..scene.parameters import draw_parameters, rollout_varied
from ..scene.scene import Scene


class Flights(NamedTuple):
    """N equally probable flights up to one time."""

    states: np.ndarray  # (N, B, 13): at that time; of a body that touched something, just after it did
    #: (N, B, B + E): time of the first contact of bodies i < j, or of body i and element j - B [s];
    #: infinite without one. A body that was stopped can still be touched: such a contact is later than its
    #: time in ``known_until``.
    first_contacts: np.ndarray
    #: (N, B): time at which each body first touched something [s]; infinite for one that flew until
    #: then, or is fixed
    known_until: np.ndarray


def first_contacts(
    scene: Scene, initial: Belief, marks: Sequence[Mark], samples: int, seed: int = 0
) -> list[Flights]:
    """Simulate flights of samples of a belief at time 0 until their first contacts, up to each of the marks.

    The marks ascend. Samples do not stop at contacts in scenes in which a robot acts, and with the implicit
    integrator.
    """
    initial = constrain_belief(scene, initial)
    if scene.integrator == "implicit":
        return _simulated(scene, initial, marks, samples, seed)
    states, history = resolve_initial_overlap(scene, initial, draw(scene, initial, samples, seed))
    z = draw_parameters(scene, samples, seed)
    if scene.acts:  # which first contacts do not decide
        states = start_states(scene, states, z)
    stopped = np.full(states.shape[:2], np.inf, history.first_time.dtype)
    found: list[Flights] = []
    done = 0
    for mark in marks:
        _advance(states, history, stopped, scene, z, done, mark.steps - done)
        done = mark.steps
        found.append(Flights(states.copy(), history.first_time.copy(), stopped.copy()))
    return found


def _simulated(scene, initial, marks, samples, seed):
    """Return samples that are simulated beyond their first contacts, at each of the marks."""
    propagator = MonteCarlo(samples=samples, seed=seed)
    carries = propagator.advance_through(propagator.init(scene, initial), scene, marks)
    known = np.full((samples, len(scene.bodies)), np.inf, np.float32)
    return [
        Flights(propagator.own_samples(carry, scene), carry.contact_history.first_time, known)
        for carry in carries
    ]


def _advance(states, history, stopped, scene, z, begin, steps):
    """Advance the flights in place.

    In scenes in which a robot acts, no body stops, and the uncertain parameters ``z`` are used.
    """
    world, first = scene.world, history.first_time
    if scene.acts and scene.uncertain:
        rollout_varied(states, history, scene, z, begin, steps)
    elif scene.acts:
        rollout(states, history, world, begin, steps)
    else:
        _fly(states, first, stopped, world, world.environment, begin, steps)


@kernel(noinline=True)
def _own_world(world, environment):
    """Return a world with its own copy of the data that stops bodies.

    ``environment`` is that of the world, or None to compile without it.
    """
    b = world.bodies
    return World(
        Bodies(
            b.moving.copy(),
            b.mass,
            b.inertia,
            b.inverse_mass.copy(),
            b.inverse_inertia.copy(),
            b.radius,
            b.root,
        ),
        world.tree,
        world.gravity,
        world.dt,
        world.decay,
        world.stiffness,
        world.stack_size,
        environment,
    )


@kernel
def _fly(states, first, stopped, world, environment, begin, steps):
    """Advance the states in place; a body is fixed from the step in which it touches something."""
    for n in range(len(states)):
        own = _own_world(world, environment)
        left = _fix(stopped[n], own.bodies)
        work = workspace(states[n], own)
        for step in range(begin, begin + steps):
            if left == 0:
                break
            integrate(states[n], first[n], own, environment, None, step, 1, work)
            left = _stop(first[n], stopped[n], own.bodies)


@inner
def _fix(stopped, bodies):
    """Fix the stopped bodies; return the number of moving ones."""
    left = 0
    for i in range(len(stopped)):
        bodies.moving[i] = bodies.moving[i] and stopped[i] == np.inf
        left += bodies.moving[i]
        if not bodies.moving[i]:
            bodies.inverse_mass[i] = 0.0
            bodies.inverse_inertia[i] = 0.0
    return left


@inner
def _stop(first, stopped, bodies):
    """Stop the bodies that touched something; return the number of moving ones."""
    for i in range(len(stopped)):
        if not bodies.moving[i]:
            continue
        time = np.float32(np.inf)
        for j in range(first.shape[1]):
            time = min(time, first[i, j])
        for j in range(i):
            time = min(time, first[j, i])
        if time < np.inf:
            stopped[i] = time
    return _fix(stopped, bodies)
