"""How far each body's prediction can be trusted: flags, and the measures that they were judged by.

A check looks at the beginning and the end of a prediction, not at its steps, so that it costs next to nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntFlag

import numpy as np

from ..belief import Belief
from ..kernels.compiled import kernel
from ..kernels.contact import DISTANCE, next_contacts
from ..kernels.laws import FIRST
from ..kernels.pairs import near_pairs
from ..kernels.pieces import impact_rate
from ..kernels.so3 import rotation_matrix
from ..kernels.step import open_pair, workspace
from ..kernels.surroundings import next_element_contacts, open_element
from ..layout import (
    ANGULAR_VELOCITY,
    ERR_ANGULAR_VELOCITY,
    ERR_POSITION,
    ERR_ROTATION,
    ERR_VELOCITY,
    POSITION,
    QUATERNION,
    VELOCITY,
)
from ..scene import Scene
from .answers import REST_SPEED
from .islands import merged
from .predict import Prediction


class Status(IntFlag):
    """Flags of one body's prediction; the numbers are those of ``unc_physics_msgs/msg/PredictedObject``."""

    FINE = 0
    NOT_CONVERGED = 1
    OUTSIDE_VALIDITY = 2
    INITIAL_OVERLAP = 4


#: Flag, limit and words of each measure; `assess` explains them.
RULES = {
    "initial_overlap": (Status.INITIAL_OVERLAP, 0.02, "overlaps another body or the environment at the start"),
    "energy_gain": (Status.NOT_CONVERGED, 0.02, "energy was gained; a smaller dt or the robust integrator helps"),
    "step_times_frequency": (Status.NOT_CONVERGED, 1.3, "the step is too long for the stiffness of the contacts"),
    "impact_over_capacity": (Status.NOT_CONVERGED, 1.0, "hits harder than the stiffness can stop"),
    "spread_energy": (Status.OUTSIDE_VALIDITY, 1.1, "the spread of the velocities takes more energy than there is"),
    "rotation_std": (Status.OUTSIDE_VALIDITY, 1.0, "the rotation's spread is too wide for a Gaussian"),
    "spread_lost": (Status.OUTSIDE_VALIDITY, 10.0, "the spread collapsed"),
    "lasting_contact": (Status.OUTSIDE_VALIDITY, 0.5, "contact lasts, in which this propagator's spread is not to be trusted"),
}


@dataclass(frozen=True)
class BodyStatus:
    """What speaks against one body's prediction.

    Attributes
    ----------
    body : str
        Its name.
    flags : Status
    measures : dict of str to float
        What the flags were judged by, each by name (`assess`).
    reasons : tuple of str
        The flags in words.
    """

    body: str
    flags: Status
    measures: dict[str, float]
    reasons: tuple[str, ...]

    @property
    def message(self) -> str:
        """The reasons in one text; empty when fine."""
        return "; ".join(self.reasons)


def assess(scene: Scene, initial: Belief, prediction: Prediction) -> tuple[BodyStatus, ...]:
    """Check what can be checked of a prediction.

    Parameters
    ----------
    scene : Scene
    initial : Belief
        The belief that the prediction began with.
    prediction : Prediction

    Returns
    -------
    tuple of BodyStatus
        One for each body, in the scene's order; a fixed body's has no measures.

    Notes
    -----
    The measures, each compared with its limit in `RULES`; bodies that touched each other, directly or through others,
    share their energy:

    ``initial_overlap``
        Depth of the deepest pair of spheres at the initial mean, over the body's radius.
    ``energy_gain``
        Of the mean: energy gained, over all that there was and that gravity gave.
    ``step_times_frequency``
        Of a body that touched something, with the explicit integrator: what a contact's oscillation turns in a step [rad],
        at the highest speed that start, end and gravity suggest.
    ``impact_over_capacity``
        Kinetic energy at that speed over ``stiffness pi r^4``, about what two spheres of the body's largest radius r take
        up before they pass through each other.
    ``spread_energy``
        Mean kinetic energy at the end, the spread's included, over the same at the start and what gravity gave.
    ``rotation_std``
        Largest standard deviation of the rotation about any axis at the end [rad]; of Gaussian propagators.
    ``spread_lost``
        Of a body that touched something: standard deviation of its position at the start over that at the end.
    ``lasting_contact``
        1 where a body of a propagator with one nominal rollout touches something at the end, and is slow.
    """
    begin, end = initial.mean, prediction.belief.mean
    first = prediction.carry.memory[..., FIRST].min(axis=0)
    touched = np.isfinite(first)
    touches = touched.any(axis=1) | touched[:, : len(begin)].any(axis=0)
    nominal = prediction.propagator.traits.mean_update == "nominal"
    deep = _depths(scene, begin)
    lasting = _depths(scene, end) > 0.0 if nominal and touches.any() else np.zeros(len(begin), bool)
    speed, gain, spread_energy = _energies(scene, initial, prediction, touched)
    results = []
    for k, body in enumerate(scene.bodies):
        measures = {} if body.fixed else {"initial_overlap": deep[k] / body.model.bounding_radius}
        if not body.fixed:
            P, before = prediction.belief.marginal(k), initial.marginal(k)
            if prediction.propagator.name != "monte_carlo":
                measures["rotation_std"] = _largest_std(P[ERR_ROTATION, ERR_ROTATION])
            measures["spread_energy"] = spread_energy[k]
        if not body.fixed and touches[k]:
            measures["energy_gain"] = gain[k]
            radius = float(body.model.radii.max())
            if scene.integrator == "explicit":
                measures["step_times_frequency"] = scene.dt * impact_rate(speed[k], 1.0 / body.mass, radius, scene.stiffness)
            impact, capacity = 0.5 * body.mass * speed[k] ** 2, math.pi * scene.stiffness * radius**4
            measures["impact_over_capacity"] = impact / capacity if capacity > 0.0 else math.inf
            if nominal:
                wide = _largest_std(before[ERR_POSITION, ERR_POSITION])
                measures["spread_lost"] = wide / max(_largest_std(P[ERR_POSITION, ERR_POSITION]), 1e-300) if wide > 0.0 else 0.0
                slow = np.linalg.norm(end[k, VELOCITY]) < REST_SPEED
                measures["lasting_contact"] = float(lasting[k] and slow and P.any())
        results.append(_judged(body.name, {key: float(value) for key, value in measures.items()}))
    return tuple(results)


def _judged(name, measures):
    """The status that measures make."""
    flags, reasons = Status.FINE, []
    for key, value in measures.items():
        flag, limit, words = RULES[key]
        if value > limit:
            flags |= flag
            reasons.append(f"{words} ({key} {value:.3g} above {limit:.3g})")
    return BodyStatus(name, flags, measures, tuple(reasons))


def _largest_std(P):
    return math.sqrt(max(np.linalg.eigvalsh(P)[-1], 0.0))


def _energies(scene, initial, prediction, touched):
    """Highest speed [m/s] of each body, its group's relative gain of energy, and what the spread takes: each (B,)."""
    begin, end, bodies = initial.mean, prediction.belief.mean, len(scene.bodies)
    mass = np.array([0.0 if body.fixed else body.mass for body in scene.bodies])
    given = np.maximum(mass * ((end - begin)[:, POSITION] @ scene.gravity), 0.0)
    lost = np.maximum(-mass * ((end - begin)[:, POSITION] @ scene.gravity), 0.0)
    at_start, at_end = _kinetic(scene, initial, -1), _kinetic(scene, prediction.belief, 0)
    label = merged(np.arange(bodies), np.argwhere(touched[:, :bodies]))
    total = {
        name: np.bincount(label, value, bodies)[label]
        for name, value in (("given", given), ("lost", lost), ("e0", at_start[0]), ("e1", at_end[0]),
                            ("all0", at_start.sum(axis=0)), ("all1", at_end.sum(axis=0)))
    }
    source = total["e0"] + total["given"]
    gain = (total["e1"] + total["lost"] - source) / np.where(source > 0.0, source, 1.0)
    everything = total["all0"] + total["given"]
    spread = total["all1"] / np.where(everything > 0.0, everything, 1.0)
    g = np.linalg.norm(scene.gravity)
    drop = np.abs((end - begin)[:, POSITION]).max(axis=1)
    speeds = [np.linalg.norm(state[:, VELOCITY], axis=1) for state in (begin, end)]
    speed = np.sqrt(np.maximum(*speeds) ** 2 + 2.0 * g * drop)
    return speed, gain, np.where(everything > 0.0, spread, 0.0)


def _kinetic(scene, belief, side):
    """(2, B): kinetic energy of the mean, and of the spread about it [J].

    Without the gyroscopic term the energy of a free turn is not constant; its least value (``side`` 0) or its
    largest (-1) stands for it, so that it is not taken for a gain.
    """
    result = np.zeros((2, len(scene.bodies)))
    for k in scene.moving:
        body, x, P = scene.bodies[k], belief.mean[k], belief.marginal(k)
        principal = body.mass * np.linalg.eigvalsh(body.model.inertia)[side]
        w = x[ANGULAR_VELOCITY]
        turning = principal * w @ w
        if scene.gyroscopic:
            spin = w @ rotation_matrix(x[QUATERNION])
            turning = body.mass * spin @ body.model.inertia @ spin
        result[0, k] = 0.5 * (body.mass * x[VELOCITY] @ x[VELOCITY] + turning)
        spread = P[ERR_VELOCITY, ERR_VELOCITY].trace(), P[ERR_ANGULAR_VELOCITY, ERR_ANGULAR_VELOCITY].trace()
        result[1, k] = 0.5 * (body.mass * spread[0] + principal * spread[1])
    return result


def _depths(scene, mean):
    """(B,): how deep each body's spheres reach into others or the environment [m]."""
    depth = np.zeros(len(mean))
    _deepest(mean.copy(), scene.world, scene.world.laws, depth)
    return depth


@kernel
def _deepest(x, world, laws, depth):
    work = workspace(x, world, laws)
    radii, pairs, records = world.tree.radii, work.search.pairs, work.search.records
    for k in range(near_pairs(x, world.bodies.radius, work.still, world.bodies.moving, work)):
        i, j = work.near[k, 0], work.near[k, 1]
        t_ij, slack, top = open_pair(x, i, j, world, work)
        while top > 0:
            count, top = next_contacts(world.tree, work.R_ij, t_ij, slack, work.search, top)
            for c in range(count):
                deep = radii[pairs[c, 0]] + radii[pairs[c, 1]] - records[c, DISTANCE]
                depth[i], depth[j] = max(depth[i], deep), max(depth[j], deep)
    if laws is not None:
        for i in range(len(x)):
            if world.bodies.moving[i]:
                for e in range(len(laws.kind)):
                    t, top = open_element(x, i, e, world, laws, work)
                    while top > 0:
                        count, top = next_element_contacts(world.tree, laws, e, work.R_ij, t, work.search, top)
                        for c in range(count):
                            depth[i] = max(depth[i], radii[pairs[c, 0]] - records[c, DISTANCE])
