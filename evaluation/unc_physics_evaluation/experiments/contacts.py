"""Contacts of the nominal rollout, and how long its flight, near misses and contact take."""

from __future__ import annotations

import time
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from unc_physics.physics.compiled import kernel
from unc_physics.physics.layout import P
from unc_physics.physics.narrow_phase import next_contacts, open_pair
from unc_physics.physics.rollout import simulate
from unc_physics.physics.workspace import workspace

from ..comparison import WALL_TIME, rollout_cost
from ..jobs import Job, Outcome, Row, Settings
from ..results import Results
from ..scenarios import LARGE, MODELS, collision, has_packing, missing_packings
from ..tables import number, table

TITLE = "Contacts of a rollout"
SPHERES = (10, 100, 1000, 10_000, LARGE)
PHASES = ("flight", "near miss", "contact")
ROLLOUT = "rollout"
STEPS, CONTACTS, MOST_CONTACTS = "steps", "contacts", "most_contacts"


def jobs(settings: Settings) -> list[Job]:
    """Every model with every number of spheres, alone on the machine."""
    some = SPHERES[:3] if settings.quick else SPHERES
    repeats = 3 if settings.quick else 15
    return [
        Job(
            "contacts",
            settings.parameters(model=model, spheres=spheres, repeats=repeats),
            cost=10 * repeats * rollout_cost(spheres),
            alone=True,
        )
        for model in MODELS
        for spheres in some
        if has_packing(model, spheres)
    ]


def missing(settings: Settings) -> list[str]:
    """Packings that there are not."""
    return [] if settings.quick else missing_packings()


def run(job: Job) -> Outcome:
    """Steps and wall time of each phase of the mean's rollout, and the contacts of a contact step."""
    p = job.parameters
    scene, belief, horizon = collision(p["model"], p["spheres"])
    followed = course(scene, belief.mean, round(horizon / scene.dt))
    touching = followed.contacts[followed.contacts > 0]
    times = phase_times(scene, followed, p["repeats"])
    rows = [
        Row(ROLLOUT, CONTACTS, "1", float(touching.mean()) if len(touching) else 0.0),
        Row(ROLLOUT, MOST_CONTACTS, "1", int(touching.max(initial=0))),
    ]
    for k, phase in enumerate(PHASES):
        rows.append(Row(phase, STEPS, "1", np.count_nonzero(followed.phase == k)))
        rows.append(Row(phase, WALL_TIME, "s", float(times[k])))
    return Outcome(rows)


def report(results: Results) -> str:
    """A table."""
    rows = results.rows("contacts")
    lines = []
    for model in MODELS:
        for spheres in rows.unique("spheres"):
            here = rows.where(model=model, spheres=spheres)
            if not here:
                continue
            cells = [f"{model} {spheres}"]
            mean, most = (here.where(quantity=name).mean() for name in (CONTACTS, MOST_CONTACTS))
            cells += [number(mean), f"{most:.0f}"]
            whole = here.where(quantity=WALL_TIME).values().sum()
            cells.append(number(1e3 * whole))
            for phase in PHASES:
                steps, seconds = (
                    here.where(method=phase, quantity=name).mean() for name in (STEPS, WALL_TIME)
                )
                each = f"{number(1e6 * seconds / steps)} us" if steps else ""
                cells += [f"{steps:.0f}", each, f"{100.0 * seconds / whole:.0f} %"]
            lines.append(cells)
    head = ["", "contacts", "at most", "rollout [ms]"]
    for phase in PHASES:
        head += [f"steps of {phase}", "each", "share"]
    return (
        "The rollout of the mean of a collision of two bodies: contacts of a step that has any, the number of"
        " steps with and without contact, and their shares of the wall time. A near miss is a step in which"
        " the balls about two bodies overlap, and no spheres.\n\n" + table(head, lines)
    )


@kernel
def _contacts(x, world):
    """Number of contacts at the state ``x`` (B, 13), and whether any two bodies' balls overlap."""
    work = workspace(x, world)
    total, near = 0, False
    for i in range(len(x)):
        for j in range(i + 1, len(x)):
            reach = world.bodies.radius[i] + world.bodies.radius[j]
            if np.sum((x[j, P : P + 3] - x[i, P : P + 3]) ** 2) >= reach * reach:
                continue
            near = True
            t_ij, slack, top = open_pair(x, i, j, world, work)
            while top > 0:
                count, top = next_contacts(world.tree, work.R_ij, t_ij, slack, work.search, top)
                total += count
    return total, near


class Course(NamedTuple):
    """A rollout, step by step.

    Attributes
    ----------
    states : (steps + 1, B, 13) array
        The initial state and that after each step.
    contacts : (steps,) array
        Number of contacts in each step.
    phase : (steps,) array
        Index into `PHASES`.
    """

    states: np.ndarray
    contacts: np.ndarray
    phase: np.ndarray


def course(scene, state, steps):
    """Follow one rollout from ``state`` (B, 13)."""
    states = np.empty((steps + 1, *state.shape))
    states[0] = state
    contacts, phase = np.empty(steps, int), np.empty(steps, int)
    for k in range(steps):
        states[k + 1] = states[k]
        simulate(states[k + 1 : k + 2], scene.world, 1)
        # a step's contacts are those at the pose it ends with: its kick changes velocities only
        contacts[k], near = _contacts(states[k + 1], scene.world)
        phase[k] = 2 if contacts[k] else int(near)
    return Course(states, contacts, phase)


def phase_times(scene, followed, repeats):
    """Wall times of the phases (3,) [s]: the least of ``repeats`` runs of each stretch."""
    borders = np.flatnonzero(np.diff(followed.phase, prepend=-1, append=-1))
    times = np.zeros(len(PHASES))
    for start, stop in pairwise(borders):
        times[followed.phase[start]] += _least_time(scene, followed.states[start], stop - start, repeats)
    return times


def _least_time(scene, state, steps, repeats):
    """Of a stretch, without what a call costs."""
    return max(np.min([_time(scene, state, steps) - _time(scene, state, 0) for _ in range(repeats)]), 0.0)


def _time(scene, state, steps):
    x = state.copy()
    start = time.perf_counter()
    simulate(x[None], scene.world, steps)
    return time.perf_counter() - start
