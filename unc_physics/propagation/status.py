"""How far each body's prediction can be trusted: flags, and the measures that they were judged by."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import IntFlag

import numpy as np

from ..belief import Belief
from ..kernels.compiled import kernel
from ..kernels.contact import DISTANCE, VOLUME, next_contacts
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
    ERROR,
    POSITION,
    QUATERNION,
    VELOCITY,
)
from ..scene import Scene
from .islands import merged
from .monte_carlo import MonteCarlo
from .predict import Prediction, predict

#: Rollouts with which `assess` compares what rests on a single nominal one.
ROLLOUTS = 8
_SEED = 0  # of their draws: the same question has the same status
_NOTHING = 1e-9  # of the body's radius, and in rad: spreads below it agree
_NUDGE = 1e-9  # of the body's radius: coincident spheres have no normal
_NOISE = 4.0  # standard deviations of a sample's mean energy that are no gain


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
    "directions": (Status.OUTSIDE_VALIDITY, 30.0, "too many uncertain directions for sigma points; islands or monte_carlo helps"),
    "rotation_std": (Status.OUTSIDE_VALIDITY, 2.2, "the rotation is too uncertain for a Gaussian"),
    "spread_disagreement": (Status.OUTSIDE_VALIDITY, 2.3, "rollouts spread differently; sigma_points or monte_carlo helps"),
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


def assess(scene: Scene, initial: Belief, prediction: Prediction, rollouts: int = ROLLOUTS) -> tuple[BodyStatus, ...]:
    """Check what can be checked of a prediction at its end.

    Parameters
    ----------
    scene : Scene
    initial : Belief
        The belief that the prediction began with.
    prediction : Prediction
    rollouts : int
        How many to compare with, for a propagator whose spread rests on a single nominal rollout (``mean_update`` is
        ``nominal``); 0 for none. It costs as many rollouts, where there is something to touch.

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
        Of a body that touched something: energy gained, over all that there was, that gravity gave and that overlap at
        the start held. For propagators with several rollouts in the mean over these, from below.
    ``step_times_frequency``
        Of a body that touched something, with the explicit integrator: what a contact's oscillation turns in a step [rad],
        at the highest speed that start, end and gravity suggest.
    ``impact_over_capacity``
        Kinetic energy at that speed over ``stiffness pi r^4``, about what two spheres of the body's largest radius r take
        up before they pass through each other.
    ``directions``
        Of sigma points, for a body that touched something: in how many directions the bodies that they are spread for
        together are uncertain. Points lie farther out the more there are, and most of them move a single body.
    ``rotation_std``
        Largest standard deviation of the rotation about any axis that the body would have at the end without contact [rad];
        not of Monte Carlo.
    ``spread_disagreement``
        The factor by which predicted spreads and those of a few rollouts differ, of position or rotation, whichever is
        worse. Over eight rollouts it is uncertain by about a fifth.
    """
    return assess_all(scene, initial, replace(prediction, times=prediction.times[-1:], beliefs=prediction.beliefs[-1:]), rollouts)[0]


def assess_all(
    scene: Scene, initial: Belief, prediction: Prediction, rollouts: int = ROLLOUTS
) -> tuple[tuple[BodyStatus, ...], ...]:
    """As `assess`, at each of the prediction's times."""
    nominal = prediction.propagator.traits.mean_update == "nominal"
    meets = len(scene.bodies) + len(scene.environment) > 1
    spreads = None
    if nominal and meets and rollouts > 0:
        spreads = _spreads(scene, initial, prediction.times, rollouts)
    deep, held = _overlaps(scene, initial.mean)
    return tuple(
        _assess(scene, initial, prediction, k, deep, held, None if spreads is None else spreads[k])
        for k in range(len(prediction.times))
    )


def _assess(scene, initial, prediction, at, deep, held, spreads):
    """The statuses at the prediction's time number ``at``."""
    time, belief = prediction.times[at], prediction.beliefs[at]
    touched = prediction.carry.memory[..., FIRST].min(axis=0) <= time
    touches = touched.any(axis=1) | touched[:, : len(scene.bodies)].any(axis=0)
    samples = _samples(prediction)
    group = merged(np.arange(len(scene.bodies)), np.argwhere(touched[:, : len(scene.bodies)]))
    speed, gain = _energies(scene, initial, belief, group, held, samples)
    directions = _directions(scene, initial, prediction, group) if prediction.propagator.name == "sigma_points" else None
    results = []
    for k, body in enumerate(scene.bodies):
        measures = {}
        if not body.fixed:
            measures["initial_overlap"] = deep[k] / body.model.bounding_radius
            if samples is None or prediction.propagator.name != "monte_carlo":
                measures["rotation_std"] = _free_rotation_std(scene, initial.marginal(k), time)
            if spreads is not None:
                measures["spread_disagreement"] = _disagreement(belief.marginal(k), spreads[k], body.model.bounding_radius)
        if not body.fixed and touches[k]:
            if prediction.propagator.name == "sigma_points":
                measures["directions"] = directions[k]
            measures["energy_gain"] = gain[k]
            radius = float(body.model.radii.max())
            if scene.integrator == "explicit":
                measures["step_times_frequency"] = scene.dt * impact_rate(speed[k], 1.0 / body.mass, radius, scene.stiffness)
            impact, capacity = 0.5 * body.mass * speed[k] ** 2, math.pi * scene.stiffness * radius**4
            measures["impact_over_capacity"] = impact / capacity if capacity > 0.0 else math.inf
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


def _samples(prediction):
    """Number of rollouts that the belief is the mean of, infinite where they are chosen instead of drawn; None for one."""
    if prediction.propagator.traits.mean_update == "nominal":
        return None
    return prediction.propagator.samples if prediction.propagator.name == "monte_carlo" else math.inf


def _directions(scene, initial, prediction, group):
    """(B,): how many uncertain directions each body shares its sigma points with."""
    own = np.zeros(len(scene.bodies))
    for k in scene.moving:
        values = np.linalg.eigvalsh(initial.marginal(k))
        own[k] = ERROR if prediction.propagator.points == "full" else np.count_nonzero(values > 1e-14 * values[-1])
    shared = np.bincount(group, own, len(own))[group] if scene.islands else np.full(len(own), own.sum())
    return shared + len(scene.uncertain)


def _spreads(scene, initial, times, count):
    """(T, B, 2): standard deviations of position [m] and rotation [rad] of some rollouts, at each time."""
    if len(scene.bodies) > 2 and not scene.islands:
        scene = replace(scene, islands=True)  # changes rollouts by nothing that counts here
    sampled = predict(scene, initial, MonteCarlo(samples=count, seed=_SEED), None, times=times)
    result = np.zeros((len(times), len(scene.bodies), 2))
    for t, belief in enumerate(sampled.beliefs):
        for k in scene.moving:
            P = belief.marginal(k) * (count / max(count - 1, 1))
            result[t, k] = [math.sqrt(P[block, block].trace()) for block in (ERR_POSITION, ERR_ROTATION)]
    return result


def _disagreement(P, spread, radius):
    """The larger factor between predicted and sampled standard deviations."""
    worst = 1.0
    for block, found, nothing in ((ERR_POSITION, spread[0], _NOTHING * radius), (ERR_ROTATION, spread[1], _NOTHING)):
        predicted = max(math.sqrt(max(P[block, block].trace(), 0.0)), nothing)
        found = max(found, nothing) if math.isfinite(found) else math.inf
        worst = max(worst, predicted / found, found / predicted)
    return worst


def _free_rotation_std(scene, P, time):
    """Largest standard deviation about any axis of the rotation after a time without contact [rad]."""
    if scene.damping > 0.0:
        time = -math.expm1(-scene.damping * time) / scene.damping
    cross = P[ERR_ROTATION, ERR_ANGULAR_VELOCITY]
    spread = P[ERR_ROTATION, ERR_ROTATION] + time * (cross + cross.T) + time**2 * P[ERR_ANGULAR_VELOCITY, ERR_ANGULAR_VELOCITY]
    return math.sqrt(max(np.linalg.eigvalsh(spread)[-1], 0.0))


def _energies(scene, initial, belief, group, held, samples):
    """Highest speed [m/s] of each body, and its group's relative gain of energy: each (B,)."""
    begin, end, bodies = initial.mean, belief.mean, len(scene.bodies)
    mass = np.array([0.0 if body.fixed else body.mass for body in scene.bodies])
    work = mass * ((end - begin)[:, POSITION] @ scene.gravity)
    before, noise = _kinetic(scene, initial, samples, -1)
    after, _ = _kinetic(scene, belief, samples, 0)
    if samples is not None and math.isfinite(samples):
        before += _NOISE * noise / math.sqrt(samples)
    source, rest = (
        np.bincount(group, value, bodies)[group]
        for value in (before + np.maximum(work, 0.0) + held, after + np.maximum(-work, 0.0)))
    gain = np.where(source > 0.0, (rest - source) / np.where(source > 0.0, source, 1.0), 0.0)
    drop = np.abs((end - begin)[:, POSITION]).max(axis=1)
    speeds = [np.linalg.norm(state[:, VELOCITY], axis=1) for state in (begin, end)]
    return np.sqrt(np.maximum(*speeds) ** 2 + 2.0 * np.linalg.norm(scene.gravity) * drop), gain


def _kinetic(scene, belief, samples, side):
    """Kinetic energy of each body [J], and of several rollouts the standard deviation of a single one's: each (B,).

    The mean over several rollouts has the spread's energy. Its share of rotation depends on how velocities and poses go
    together: the least (``side`` 0) or the largest (-1) moment of inertia stands for all.
    """
    energy, noise = np.zeros(len(scene.bodies)), np.zeros(len(scene.bodies))
    for k in scene.moving:
        body, x, P = scene.bodies[k], belief.mean[k], belief.marginal(k)
        v, w = x[VELOCITY], x[ANGULAR_VELOCITY]
        if samples is None:
            spin = w @ rotation_matrix(x[QUATERNION])
            energy[k] = 0.5 * body.mass * (v @ v + spin @ body.model.inertia @ spin)
            continue
        principal = np.linalg.eigvalsh(body.model.inertia)[side]
        for factor, mean, block in ((1.0, v, ERR_VELOCITY), (principal, w, ERR_ANGULAR_VELOCITY)):
            spread = P[block, block]
            energy[k] += 0.5 * body.mass * factor * (mean @ mean + spread.trace())
            noise[k] += body.mass * factor * math.sqrt(max(mean @ spread @ mean + 0.5 * (spread * spread).sum(), 0.0))
    return energy, noise


def _overlaps(scene, mean):
    """How deep each body's spheres reach into others or the environment [m], and no less than the energy there [J]: each (B,)."""
    nudged = mean.copy()
    for k, body in enumerate(scene.bodies):
        nudged[k, POSITION.start] += k * _NUDGE * body.model.bounding_radius
    result = np.zeros((2, len(mean)))
    _add_overlaps(nudged, scene.world, scene.world.laws, result)
    return result[0], scene.stiffness * result[1]


@kernel
def _add_overlaps(x, world, laws, out):
    """Depths into ``out[0]``; depth times volume, half for each of two bodies, into ``out[1]``."""
    work = workspace(x, world, laws)
    radii, pairs, records = world.tree.radii, work.search.pairs, work.search.records
    for k in range(near_pairs(x, world.bodies.radius, work.still, world.bodies.moving, work)):
        i, j = work.near[k, 0], work.near[k, 1]
        t_ij, slack, top = open_pair(x, i, j, world, work)
        while top > 0:
            count, top = next_contacts(world.tree, work.R_ij, t_ij, slack, work.search, top)
            for c in range(count):
                depth = radii[pairs[c, 0]] + radii[pairs[c, 1]] - records[c, DISTANCE]
                for body in (i, j):
                    out[0, body] = max(out[0, body], depth)
                    out[1, body] += 0.5 * depth * records[c, VOLUME]
    if laws is not None:
        for i in range(len(x)):
            if world.bodies.moving[i]:
                for e in range(len(laws.kind)):
                    t, top = open_element(x, i, e, world, laws, work)
                    while top > 0:
                        count, top = next_element_contacts(world.tree, laws, e, work.R_ij, t, work.search, top)
                        for c in range(count):
                            depth = radii[pairs[c, 0]] - records[c, DISTANCE]
                            out[0, i] = max(out[0, i], depth)
                            out[1, i] += depth * records[c, VOLUME]
