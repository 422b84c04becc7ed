"""What speaks for or against a prediction, in numbers: what a status judges by (`status.assess`)."""

from __future__ import annotations

import math
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from ..physics.contact_model import capacity, impact_frequency
from ..physics.layout import (
    ANGULAR_VELOCITY,
    ERR_ANGULAR_VELOCITY,
    ERR_POSITION,
    ERR_ROTATION,
    ERR_VELOCITY,
    POSITION,
    QUATERNION,
    VELOCITY,
)
from ..physics.overlap_search import TOUCHING
from ..physics.rotation import rotation_matrix
from ..propagators.names import POINTS
from ..propagators.registry import make_propagator
from ..propagators.start import known
from .few_rollouts import pose_spreads
from .islands import merged
from .overlap_depths import overlaps
from .status_rules import RULES

_DRAWN = 40  # states of a belief whose overlaps are kept
_FAR = 5.0  # standard deviations that are not to be expected of an honest belief
_SEED = 0  # of their draws: the same question has the same status
_NOTHING = 1e-9  # of the body's radius, and in rad: spreads below it agree
_NOISE = 4.0  # standard deviations of a sample's mean energy that are no gain
_USUAL = 0.95  # share of the rollouts that a residual must be small in
_EVEN = 1.05  # unevenness up to which points are right
_OPEN = 1.4, 2.7  # factors between which a dozen rollouts leave open whether spreads differ by two
_OPEN_IN_DOUBT = 1.1  # the lower one where contacts were doubtful
_shapes = WeakKeyDictionary()


class Start(NamedTuple):
    """What all times share: of each body (B,), or of each of the M moving ones."""

    mean: np.ndarray  # (B, 13)
    blocks: np.ndarray  # (M, 12, 12)
    mass: np.ndarray  # (B,), 0 of a fixed body [kg]
    shapes: (
        np.ndarray
    )  # (B, 4): least and largest inertia over mass [m^2], largest sphere's radius, the body's [m]
    overlap: np.ndarray  # (B,) [m]
    energy: np.ndarray  # (B,), from above [J]
    samples: (
        float | None
    )  # that a belief is the mean of: infinite where they are chosen instead of drawn; None for one
    directions: np.ndarray | None  # (M,), that points are spread along; None without such points
    own: dict  # measures (B,) by name that the propagator gives of its answer at the end
    found: Any  # what points or samples learned of their own beginning; None for the explicit integrator


def start_of(prediction):
    scene, initial, propagator = prediction.scene, prediction.initial, prediction.propagator
    samples = None
    if propagator.traits.mean_update != "nominal":
        samples = math.inf if propagator.own_sample_count is None else propagator.rollouts(prediction.carry)
    if scene.integrator == "implicit":
        initial = prediction.start
    mass = np.array([body.mass if body.free else 0.0 for body in scene.bodies])
    shapes = np.array([_shape(body.model) for body in scene.bodies])
    states = initial.mean[None]
    if scene.overlap == "keep" and len(scene.moving):
        states = np.concatenate([states, initial.sample(_DRAWN, np.random.default_rng(_SEED))])
    depths, (held, *_) = overlaps(scene, states)
    overlap, drawn = depths[0], depths[1:]
    if drawn.any():
        overlap = np.maximum(overlap, np.quantile(drawn, _USUAL, axis=0))
    start = Start(
        initial.mean,
        initial.blocks,
        mass,
        shapes,
        overlap,
        held,
        samples,
        propagator.directions(initial),
        propagator.measures(prediction.carry, scene),
        _found(prediction),
    )
    energy, noise = _kinetic(scene, start, initial, 1)
    if samples is not None and math.isfinite(samples):
        energy += _NOISE * noise / math.sqrt(samples)
    return start._replace(energy=held + energy)


def _found(prediction):
    """What the rollouts learned of their own beginning; a single one begins as points do, which tell more."""
    scene = prediction.scene
    if scene.integrator == "implicit" and prediction.propagator.traits.mean_update == "nominal":
        points = make_propagator(POINTS)
        return points.contact_history(points.init(scene, known(scene, prediction.initial))).start
    return prediction.contact_history.start


def _shape(model):
    """A model's row of `Start.shapes`."""
    if model not in _shapes:
        principal = np.linalg.eigvalsh(model.inertia)
        _shapes[model] = principal[0], principal[-1], float(model.radii.max()), model.bounding_radius
    return _shapes[model]


def measures_at(scene, start, prediction, time, belief, spreads, uneven, motion):
    """Measures by name of each body, at one of the prediction's times; a fixed one has none."""
    propagator, history, bodies = prediction.propagator, prediction.contact_history, len(scene.bodies)
    touched = history.first_time.min(axis=0) <= time
    pairs = np.argwhere(touched[:, :bodies])
    touches = touched.any(axis=1) | touched[:, :bodies].any(axis=0)
    group = merged(np.arange(bodies), pairs) if len(pairs) else np.arange(bodies)
    per_body = {"initial_overlap": start.overlap / start.shapes[:, 3]} if scene.overlap == "keep" else {}
    per_body |= _beginning(scene, start)
    if propagator.own_sample_count is None:
        per_body["rotation_std"] = _free_rotation_std(scene, start, time)
    if spreads is not None:
        per_body["spread_disagreement"] = _disagreement(scene, start, belief.blocks, spreads)
        since = propagator.doubtful_since(prediction.carry)
        if since is not None:
            per_body["doubtful_contacts"] = np.where(since <= time, per_body["spread_disagreement"], 1.0)
    if propagator.own_sample_count is not None:
        others = propagator.rollouts(prediction.carry) - 1
        per_body["few_samples"] = np.full(bodies, min(1.0, 1.0 / math.sqrt(2.0 * max(others, 0.5))))
    in_contact = dict(start.own)
    if touches.any():
        if propagator.traits.mean_update == "nominal" and spreads is None:
            in_contact["unchecked"] = np.ones(bodies)
        if start.directions is not None:
            in_contact["directions"] = _directions(scene, start, group)
            if uneven is not None:
                in_contact["unevenness"] = uneven
            in_contact["mean_overlap"] = overlaps(scene, belief.mean[None])[0][0] / start.shapes[:, 3]
        speed, gain = _energies(scene, start, belief, group, motion)
        if not scene.acts:  # which adds energy
            in_contact["energy_gain"] = gain
        if scene.integrator == "explicit":
            in_contact |= _explicit_measures(scene, start, speed)
        else:
            in_contact["contact_residual"] = np.quantile(history.solver.residual, _USUAL, axis=0)
    return [
        {}
        if not body.free
        else {
            key: float(value[k]) for key, value in (per_body | in_contact if touches[k] else per_body).items()
        }
        for k, body in enumerate(scene.bodies)
    ]


def unevenness_at_times(prediction, start):
    """At each time (B,), `_unevenness` of the points; None without such points."""
    propagator, scene = prediction.propagator, prediction.scene
    return [
        None if carry is None else _unevenness(scene, start, propagator.opposite_points(carry, scene))
        for carry in prediction.answers.carries(len(prediction.times))
    ]


def needs_rollouts(prediction, start, uneven):
    """Whether a spread is to be compared with that of rollouts: one that rests on a single rollout, where
    there is something to meet, or a gyroscopic term; on points, where one touched and they are uneven, or
    many, or may have turned too far.
    """
    scene, propagator = prediction.scene, prediction.propagator
    if propagator.traits.mean_update == "nominal" and propagator.compared_with_rollouts:
        return len(scene.bodies) + len(scene.environment) > 1 or scene.gyroscopic  # else flight is exact
    if not propagator.compared_with_rollouts or not np.isfinite(prediction.contact_history.first_time).any():
        return False
    if start.directions is None or start.directions.sum() > RULES["directions"].limit:
        return True
    return any(bent is None or bent.max() > _EVEN for bent in uneven) or _half_turned(prediction, start)


def left_open(prediction, start, spreads):
    """Whether a few rollouts' spreads (T, M, 2) leave it open, at any time, if those predicted are wrong."""
    since = prediction.propagator.doubtful_since(prediction.carry)
    if since is None:
        since = math.inf
    for time, belief, some in zip(prediction.times, prediction.beliefs, spreads, strict=True):
        factor = _disagreement(prediction.scene, start, belief.blocks, some)
        low = np.where(since <= time, _OPEN_IN_DOUBT, _OPEN[0])
        if ((low < factor) & (factor < _OPEN[1])).any():
            return True
    return False


def _half_turned(prediction, start):
    """Whether points may have turned by half a turn since they touched something: from there on rotations
    look smaller than they are, and opposite ones still opposite.

    Of so many points the farthest is that many standard deviations out, and its spin that of the end.
    """
    scene, bodies = prediction.scene, len(prediction.scene.bodies)
    first = prediction.contact_history.first_time.min(axis=0)
    since = np.minimum(first.min(axis=1), first[:, :bodies].min(axis=0))[scene.moving]
    far = math.sqrt(start.directions.sum() + len(scene.uncertain) + 0.5)
    for time, belief in zip(prediction.times, prediction.beliefs, strict=True):
        spin = belief.blocks[:, ERR_ANGULAR_VELOCITY, ERR_ANGULAR_VELOCITY]
        std = np.sqrt(np.maximum(np.einsum("mii->m", spin), 0.0))
        if (far * std * np.maximum(time - since, 0.0) > math.pi).any():
            return True
    return False


def _beginning(scene, start):
    """How rollouts came free of overlap, and to rest: values (B,) by name; none for the explicit
    integrator.
    """
    found = start.found
    if found is None:
        return {}
    keeps = found.kept > TOUCHING
    measures = {"overlap_share": (found.overlap > TOUCHING).mean(axis=0)}
    if scene.overlap != "keep":
        measures["overlap_kept"] = found.kept.max(axis=0) / start.shapes[:, 3]
        measures["overlap_certain"] = keeps.mean(axis=0)
    if scene.overlap != "keep" or any(body.at_rest for body in scene.bodies):
        # chosen points lie far out themselves, and may be moved as far
        drawn = start.samples is not None and math.isfinite(start.samples)
        far = _FAR if drawn else max(_FAR, 1.0 + math.sqrt(0.5 * len(found.moved)))
        measures["overlap_moved"] = (found.moved > far).mean(axis=0)
    if any(body.at_rest for body in scene.bodies):
        measures["settled_tilt"] = np.sqrt((found.tilted**2).mean(axis=0))
        measures["unsettled"] = found.unsettled.mean(axis=0)
    return measures


def _explicit_measures(scene, start, speed):
    """What a step can take at the bodies' highest speeds (B,): values (B,) by name."""
    radius = start.shapes[:, 2]
    frequency = [
        impact_frequency(speed[k], 1.0 / body.mass, radius[k], scene.stiffness)
        for k, body in enumerate(scene.bodies)
    ]
    most = np.maximum(capacity(radius, scene.stiffness), 1e-300)
    return {
        "step_times_frequency": scene.dt * np.array(frequency),
        "impact_over_capacity": 0.5 * start.mass * speed**2 / most,
    }


def _directions(scene, start, group):
    """(B,): how many uncertain directions each body shares its points with."""
    own = np.zeros(len(scene.bodies))
    own[scene.moving] = start.directions
    apart = scene.islands and not scene.shared_parameters
    shared = np.bincount(group, own, len(own))[group] if apart else np.full(len(own), own.sum())
    return shared + len(scene.uncertain)


def _unevenness(scene, start, points):
    """(B,): spread of points in opposite pairs, over that of what is opposite in them (`RULES`)."""
    result = np.ones(len(scene.bodies))
    forth, back = points
    for k, body in enumerate(scene.moving):
        nothing = _NOTHING * start.shapes[body, 3], _NOTHING
        for block, floor in zip((ERR_POSITION, ERR_ROTATION), nothing, strict=True):
            odd = 0.5 * (forth[:, k, block] - back[:, k, block])
            even = 0.5 * (forth[:, k, block] + back[:, k, block])
            shift = even.sum(axis=0) / (len(even) + 0.5)
            straight = np.sum(odd**2) / (len(odd) + 0.5)
            bent = np.sum(even**2) / (len(even) + 0.5) - shift @ shift
            ratio = math.sqrt((straight + max(bent, 0.0) + floor**2) / (straight + floor**2))
            result[body] = max(result[body], ratio)
    return result


def _disagreement(scene, start, blocks, spreads):
    """(B,): the larger factor between predicted and sampled standard deviations."""
    nothing = np.column_stack([_NOTHING * start.shapes[scene.moving, 3], np.full(len(blocks), _NOTHING)])
    predicted = np.maximum(pose_spreads(blocks), nothing)
    found = np.where(np.isfinite(spreads), np.maximum(spreads, nothing), math.inf)
    result = np.ones(len(scene.bodies))
    result[scene.moving] = np.maximum(predicted / found, found / predicted).max(axis=1)
    return result


def _free_rotation_std(scene, start, time):
    """(B,): largest standard deviation about any axis of the rotation after a time without contact [rad]."""
    if scene.damping > 0.0:
        time = -math.expm1(-scene.damping * time) / scene.damping
    P = start.blocks
    cross = P[:, ERR_ROTATION, ERR_ANGULAR_VELOCITY]
    spread = (
        P[:, ERR_ROTATION, ERR_ROTATION]
        + time * (cross + cross.transpose(0, 2, 1))
        + time**2 * P[:, ERR_ANGULAR_VELOCITY, ERR_ANGULAR_VELOCITY]
    )
    result = np.zeros(len(scene.bodies))
    result[scene.moving] = np.sqrt(np.maximum(np.linalg.eigvalsh(spread)[:, -1], 0.0))
    return result


def _energies(scene, start, belief, group, motion):
    """Highest speed [m/s] of each body, and its group's relative gain of energy: each (B,).

    Samples that are made of rollouts have energies that nothing holds them to: then those of the rollouts
    count.
    """
    position = belief.mean[:, POSITION] if motion is None else motion.position
    work = start.mass * ((position - start.mean[:, POSITION]) @ scene.gravity)
    if motion is None:
        after, _ = _kinetic(scene, start, belief, 0)
    else:
        after = 0.5 * start.mass * (motion.speed_squares + start.shapes[:, 0] * motion.spin_squares)
    source, rest = (
        np.bincount(group, value, len(group))[group]
        for value in (start.energy + np.maximum(work, 0.0), after + np.maximum(-work, 0.0))
    )
    gain = (rest - source) / np.where(source > 0.0, source, math.inf)
    way = belief.mean[:, POSITION] - start.mean[:, POSITION]
    squares = np.maximum(*((state[:, VELOCITY] ** 2).sum(axis=1) for state in (start.mean, belief.mean)))
    return np.sqrt(squares + 2.0 * math.sqrt(scene.gravity @ scene.gravity) * np.abs(way).max(axis=1)), gain


def _kinetic(scene, start, belief, side):
    """Kinetic energy of each body [J], and of several rollouts the standard deviation of a single one's: each
    (B,).

    The mean over several rollouts has the spread's energy. Its share of rotation depends on how velocities
    and poses go together: the least (``side`` 0) or the largest (1) moment of inertia stands for all.
    """
    energy, noise = np.zeros(len(scene.bodies)), np.zeros(len(scene.bodies))
    some, P = scene.moving, belief.blocks
    v, w = belief.mean[some, VELOCITY], belief.mean[some, ANGULAR_VELOCITY]
    if start.samples is None:
        for k in some:
            x, inertia = belief.mean[k], scene.bodies[k].unit_inertia
            spin = x[ANGULAR_VELOCITY] @ rotation_matrix(x[QUATERNION])
            energy[k] = 0.5 * start.mass[k] * (x[VELOCITY] @ x[VELOCITY] + spin @ inertia @ spin)
        return energy, noise
    for factor, mean, block in ((1.0, v, ERR_VELOCITY), (start.shapes[some, side], w, ERR_ANGULAR_VELOCITY)):
        spread = P[:, block, block]
        share = factor * start.mass[some]
        energy[some] += 0.5 * share * ((mean**2).sum(axis=1) + np.einsum("mii->m", spread))
        along = np.einsum("mi,mij,mj->m", mean, spread, mean)
        noise[some] += share * np.sqrt(np.maximum(along + 0.5 * (spread**2).sum(axis=(1, 2)), 0.0))
    return energy, noise
