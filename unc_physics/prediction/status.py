"""How far each body's prediction can be trusted: flags, and the measures that they were judged by."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import IntFlag
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from ..checks.validation import instance, integer
from ..physics.broad_phase import near_pairs
from ..physics.compiled import kernel
from ..physics.contact_model import capacity, impact_frequency
from ..physics.element_contacts import next_element_contacts, open_element
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
from ..physics.narrow_phase import DISTANCE, VOLUME, next_contacts, open_pair
from ..physics.overlap_search import TOUCHING
from ..physics.rotation import rotation_matrix
from ..physics.workspace import workspace
from ..propagators.names import REFERENCE
from ..propagators.registry import make_propagator, names_where
from .islands import merged
from .predict import predict
from .prediction import Prediction

#: Rollouts with which `assess` compares what rests on a single nominal one.
ROLLOUTS = 12
_DRAWN = 40  # states of a belief whose overlaps are kept
_FAR = 5.0  # standard deviations that are not to be expected of an honest belief
_SEED = 0  # of their draws: the same question has the same status
_NOTHING = 1e-9  # of the body's radius, and in rad: spreads below it agree
_NUDGE = 1e-9  # of the body's radius: coincident spheres have no normal
_shapes = WeakKeyDictionary()
_NOISE = 4.0  # standard deviations of a sample's mean energy that are no gain
_USUAL = 0.95  # share of the rollouts that a residual must be small in


_SAMPLED = names_where(lambda propagator: propagator.own_sample_count is not None, " or ")
_ESTIMATED = names_where(lambda propagator: propagator.traits.mean_update == "estimated", " or ")


class Status(IntFlag):
    """Flags of one body's prediction; the numbers are those of ``unc_physics_msgs/msg/PredictedObject``."""

    FINE = 0
    NOT_CONVERGED = 1
    OUTSIDE_VALIDITY = 2
    INITIAL_OVERLAP = 4


#: Flag, limit and words of each measure, with what to do; `assess` explains them.
RULES = {
    "initial_overlap": (
        Status.INITIAL_OVERLAP,
        0.02,
        (
            "overlaps another body or the environment at the start; give poses without overlap, or take the"
            " implicit integrator with 'overlap: project'"
        ),
    ),
    "overlap_share": (
        Status.INITIAL_OVERLAP,
        math.inf,
        "overlapped at the start, and was moved to the nearest pose without",
    ),
    "overlap_moved": (
        Status.INITIAL_OVERLAP,
        0.01,
        (
            "some of the belief was moved by more than 5 standard deviations, to where it does not overlap or"
            " stands; check its pose, or give it a larger covariance"
        ),
    ),
    "overlap_kept": (
        Status.INITIAL_OVERLAP,
        0.02,
        (
            "cannot come free of what it overlaps at the start, and keeps the overlap; check its pose, or"
            " give it a larger covariance"
        ),
    ),
    "overlap_certain": (Status.INITIAL_OVERLAP, 0.5, "overlaps at the start for certain; check its pose"),
    "settled_tilt": (
        Status.INITIAL_OVERLAP,
        math.radians(15.0),
        (
            "is said to be at rest, and tilted far until something held it; check its orientation, and"
            " what is below it"
        ),
    ),
    "unsettled": (
        Status.INITIAL_OVERLAP,
        0.05,
        "is said to be at rest, and nothing holds it; put something below it, or take at_rest away",
    ),
    "energy_gain": (Status.NOT_CONVERGED, 0.02, "energy was gained; a smaller dt, now {dt:.3g} s, helps"),
    "contact_residual": (
        Status.NOT_CONVERGED,
        5e-3,
        (
            "contact forces were not found well enough; a smaller dt, now {dt:.3g} s, or masses that differ"
            " less, help"
        ),
    ),
    "step_times_frequency": (
        Status.NOT_CONVERGED,
        1.3,
        "the step is too long for the stiffness of contacts; lower dt, now {dt:.3g} s, to {shorter:.2g} s",
    ),
    "impact_over_capacity": (
        Status.NOT_CONVERGED,
        1.0,
        (
            "hits harder than the stiffness can stop; raise stiffness, now {stiffness:.3g}, above"
            " {stiffer:.2g} N/m^3, and lower dt with its root"
        ),
    ),
    "directions": (
        Status.OUTSIDE_VALIDITY,
        30.0,
        f"too many uncertain directions for as few points; islands or {_SAMPLED} helps",
    ),
    "rotation_std": (
        Status.OUTSIDE_VALIDITY,
        2.2,
        f"the rotation is too uncertain for a Gaussian; samples of {REFERENCE} are not",
    ),
    "spread_disagreement": (Status.OUTSIDE_VALIDITY, 2.3, f"rollouts spread differently; {_ESTIMATED} helps"),
    "doubtful_contacts": (
        Status.OUTSIDE_VALIDITY,
        1.7,
        (
            "contacts may open, close or coincide otherwise within a standard deviation, and rollouts spread"
            f" differently; {_ESTIMATED} helps"
        ),
    ),
    "few_samples": (Status.OUTSIDE_VALIDITY, 0.3, "too few samples to tell a spread"),
    "unevenness": (Status.OUTSIDE_VALIDITY, 2.0, f"opposite points do not move oppositely; {_SAMPLED} helps"),
    "mean_overlap": (
        Status.OUTSIDE_VALIDITY,
        0.2,
        f"the mean of its points lies inside another body or the environment; {_SAMPLED} helps",
    ),
    "surface_error": (Status.OUTSIDE_VALIDITY, math.inf, "rollouts do not tell what is between them"),
    "mean_error": (Status.OUTSIDE_VALIDITY, 0.35, "rests on too few rollouts; more of them help"),
    "unchecked": (
        Status.OUTSIDE_VALIDITY,
        0.5,
        (f"its spread after a contact was not compared with rollouts; ask for some, or take {_ESTIMATED}"),
    ),
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


def assess(prediction: Prediction, *, rollouts: int = ROLLOUTS) -> tuple[BodyStatus, ...]:
    """Check what can be checked of a prediction at its end.

    Parameters
    ----------
    prediction : Prediction
    rollouts : int, optional
        How many to compare with, for a propagator that asks for it (`Propagator.compared_with_rollouts`); it
        costs as many rollouts, where there is something to touch, or a gyroscopic term. With 0, what touched
        is flagged as unchecked.

    Returns
    -------
    tuple of BodyStatus
        One for each body, in the scene's order; a fixed body's has no measures.

    Notes
    -----
    The measures, each compared with its limit in `RULES`; bodies that touched each other, directly or through
    others, share their energy:

    ``initial_overlap``
        Where overlap at the start is kept: depth of the deepest pair of spheres, over the body's radius, that
        one in twenty states of the belief exceeds, or that of its mean.
    ``overlap_share``
        Share of the points or samples in which the body overlapped something at the start, before it was
        moved away. It raises no flag.
    ``overlap_moved``
        Share of them in which it was moved by more than 5 standard deviations of the belief, by that or by
        settling; of sigma points by one more than they lie from the mean themselves.
    ``overlap_kept``
        Deepest overlap that could not come free and stays, in any of them, over the body's radius.
    ``overlap_certain``
        Share of them that keep an overlap.
    ``settled_tilt``
        Of a body at rest: the angle by which it tilted until contacts held it, as a root mean square over
        them [rad].
    ``unsettled``
        Share of them in which it did not come to rest.
    ``energy_gain``
        Of a body that touched something: energy gained, over all that there was, that gravity gave and that
        overlap at the start held. For propagators with several rollouts in the mean over these, from below.
    ``contact_residual``
        Of a body that touched something, with the implicit integrator: by how much of the largest impulse
        those of its contacts, and of what touched it, still changed when the solver gave up; the most of all
        steps up to the prediction's end, that only one in twenty rollouts exceeds.
    ``step_times_frequency``
        Of a body that touched something, with the explicit integrator: what a contact's oscillation turns in
        a step [rad], at the highest speed that start, end and gravity suggest.
    ``impact_over_capacity``
        With the explicit integrator: kinetic energy at that speed over what two spheres as large as the
        body's largest take up before they pass through each other (`contact_model.capacity`).
    ``directions``
        Of points that are spread along directions, for a body that touched something: in how many directions
        the bodies that they are spread for together are uncertain. Points lie farther out the more there are,
        and most of them move a single body.
    ``rotation_std``
        Largest standard deviation of the rotation about any axis that the body would have at the end without
        contact [rad]; not of a propagator with samples of its own.
    ``spread_disagreement``
        The factor by which predicted spreads and those of a few rollouts differ, of position or rotation,
        whichever is worse. Over twelve rollouts it is uncertain by about a sixth.
    ``doubtful_contacts``
        The same of a body for which contacts, or their order in an impact, would have been others within a
        standard deviation (`Propagator.doubtful_since`): there a smaller factor is enough.
    ``few_samples``
        Of a propagator with samples of its own: by which share of itself a spread is uncertain for their
        number alone, which one sample leaves unknown (1).
    ``unevenness``
        Of points in opposite pairs: spread of position or rotation, over that of what is opposite in the
        pairs, whichever is larger. What is not comes from curvature, by which points far out tell too much.
    ``mean_overlap``
        Of such points, for a body that touched something: depth of the deepest pair of spheres in their mean,
        over the body's radius.
    ``surface_error``
        Of a response surface: mean square of what each rollout differs from a surface through the others,
        over the variance; from 1 on the surface tells nothing, and the rollouts alone are the answer. It
        raises no flag.
    ``mean_error``
        Of the same: standard error of the mean position or rotation over the standard deviation, whichever is
        larger.
    ``unchecked``
        1 for a body that touched something where no rollouts were asked for: its spread is wrong by more than
        a factor of 2 more often than not.
    """
    instance(prediction, Prediction, "prediction")
    last = replace(prediction, times=prediction.times[-1:], beliefs=prediction.beliefs[-1:])
    return assess_all(last, rollouts=rollouts)[0]


def assess_all(prediction: Prediction, *, rollouts: int = ROLLOUTS) -> tuple[tuple[BodyStatus, ...], ...]:
    """As `assess`, at each of the prediction's times."""
    instance(prediction, Prediction, "prediction")
    return prediction.answers.statuses(prediction, integer(rollouts, "rollouts", low=0))


@np.errstate(all="ignore")
def judge(prediction: Prediction, rollouts: int) -> tuple[tuple[BodyStatus, ...], ...]:
    """The statuses of a prediction that was made here."""
    scene, initial = prediction.scene, prediction.initial
    meets = len(scene.bodies) + len(scene.environment) > 1 or scene.gyroscopic  # else flight is exact
    spreads = [None] * len(prediction.times)
    if prediction.propagator.compared_with_rollouts and meets and rollouts > 0:
        spreads = _spreads(scene, initial, prediction.times, rollouts)
    start = _start(prediction)
    carries = prediction.answers.carries(len(prediction.times))
    return tuple(
        _assess(scene, start, prediction, time, belief, spread, carry)
        for time, belief, spread, carry in zip(
            prediction.times, prediction.beliefs, spreads, carries, strict=True
        )
    )


class _Start(NamedTuple):
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


def _start(prediction):
    scene, initial, propagator = prediction.scene, prediction.initial, prediction.propagator
    samples = None
    if propagator.traits.mean_update != "nominal":
        samples = math.inf if propagator.own_sample_count is None else propagator.rollouts(prediction.carry)
    if scene.integrator == "implicit":
        initial = prediction.start
    mass = np.array([body.mass if body.free else 0.0 for body in scene.bodies])
    shapes = np.array([_shape(body.model) for body in scene.bodies])
    overlap, held = _overlaps(scene, initial.mean)
    if scene.overlap == "keep" and len(scene.moving):
        drawn = [_overlaps(scene, x)[0] for x in initial.sample(_DRAWN, np.random.default_rng(_SEED))]
        overlap = np.maximum(overlap, np.quantile(drawn, _USUAL, axis=0))
    start = _Start(
        initial.mean,
        initial.blocks,
        mass,
        shapes,
        overlap,
        held,
        samples,
        propagator.directions(initial),
        propagator.measures(prediction.carry, scene),
    )
    energy, noise = _kinetic(scene, start, initial, 1)
    if samples is not None and math.isfinite(samples):
        energy += _NOISE * noise / math.sqrt(samples)
    return start._replace(energy=held + energy)


def _shape(model):
    """A model's row of `_Start.shapes`."""
    if model not in _shapes:
        principal = np.linalg.eigvalsh(model.inertia)
        _shapes[model] = principal[0], principal[-1], float(model.radii.max()), model.bounding_radius
    return _shapes[model]


def _assess(scene, start, prediction, time, belief, spreads, carry):
    """The statuses at one of the prediction's times."""
    propagator, history, bodies = prediction.propagator, prediction.contact_history, len(scene.bodies)
    touched = history.first_time.min(axis=0) <= time
    pairs = np.argwhere(touched[:, :bodies])
    touches = touched.any(axis=1) | touched[:, :bodies].any(axis=0)
    group = merged(np.arange(bodies), pairs) if len(pairs) else np.arange(bodies)
    per_body = {"initial_overlap": start.overlap / start.shapes[:, 3]} if scene.overlap == "keep" else {}
    per_body |= _beginning(scene, start, history.start)
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
        if propagator.compared_with_rollouts and spreads is None:
            in_contact["unchecked"] = np.ones(bodies)
        if start.directions is not None:
            in_contact["directions"] = _directions(scene, start, group)
            if carry is not None:
                points = propagator.opposite_points(carry, scene)
                in_contact["unevenness"] = _unevenness(scene, start, points)
            in_contact["mean_overlap"] = _overlaps(scene, belief.mean)[0] / start.shapes[:, 3]
        speed, gain = _energies(scene, start, belief, group)
        if not scene.acts:  # which adds energy
            in_contact["energy_gain"] = gain
        if scene.integrator == "explicit":
            in_contact |= _explicit_measures(scene, start, speed)
        else:
            in_contact["contact_residual"] = np.quantile(history.solver.residual, _USUAL, axis=0)
    return tuple(
        _judged(
            scene,
            body.name,
            (
                {}
                if not body.free
                else {
                    key: float(value[k])
                    for key, value in (per_body | in_contact if touches[k] else per_body).items()
                }
            ),
        )
        for k, body in enumerate(scene.bodies)
    )


def _beginning(scene, start, found):
    """What the rollouts learned of their own beginning: values (B,) by name; none for the explicit
    integrator.
    """
    if found is None:
        return {}
    keeps = found.kept > TOUCHING
    measures = {"overlap_share": (found.overlap > TOUCHING).mean(axis=0)}
    if scene.overlap != "keep":
        measures["overlap_kept"] = found.kept.max(axis=0) / start.shapes[:, 3]
        measures["overlap_certain"] = keeps.mean(axis=0)
    if scene.overlap != "keep" or any(body.at_rest for body in scene.bodies):
        # chosen points lie far out themselves, and may be moved as far
        far = (
            _FAR
            if math.isfinite(start.samples or 1.0)
            else max(_FAR, 1.0 + math.sqrt(0.5 * len(found.moved)))
        )
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


def _judged(scene, name, measures):
    """The status that measures make."""
    flags, reasons = Status.FINE, []
    for key, value in measures.items():
        flag, limit, words = RULES[key]
        if not value <= limit:  # also what is no number
            flags |= flag
            words = words.format(
                dt=scene.dt,
                stiffness=scene.stiffness,
                shorter=scene.dt * limit / value,
                stiffer=scene.stiffness * value,
            )
            reasons.append(f"{words} ({key} {value:.3g} above {limit:.3g})")
    return BodyStatus(name, flags, measures, tuple(reasons))


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


def _spreads(scene, initial, times, count):
    """(T, M, 2): standard deviations of position [m] and rotation [rad] of some rollouts, at each time."""
    if len(scene.bodies) > 2 and not scene.islands:
        scene = replace(scene, islands=True)  # changes rollouts by nothing that counts here
    sampled = predict(
        scene, initial, make_propagator(REFERENCE, samples=count, seed=_SEED), None, times=times
    )
    return math.sqrt(count / max(count - 1, 1)) * np.array(
        [_stds(belief.blocks) for belief in sampled.beliefs]
    )


def _stds(blocks):
    """(M, 2): standard deviations of position [m] and rotation [rad], over all axes together."""
    variances = np.einsum("mii->mi", blocks)
    return np.sqrt(
        np.maximum([variances[:, block].sum(axis=1) for block in (ERR_POSITION, ERR_ROTATION)], 0.0)
    ).T


def _disagreement(scene, start, blocks, spreads):
    """(B,): the larger factor between predicted and sampled standard deviations."""
    nothing = np.column_stack([_NOTHING * start.shapes[scene.moving, 3], np.full(len(blocks), _NOTHING)])
    predicted = np.maximum(_stds(blocks), nothing)
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


def _energies(scene, start, belief, group):
    """Highest speed [m/s] of each body, and its group's relative gain of energy: each (B,)."""
    way = belief.mean[:, POSITION] - start.mean[:, POSITION]
    work = start.mass * (way @ scene.gravity)
    after, _ = _kinetic(scene, start, belief, 0)
    source, rest = (
        np.bincount(group, value, len(group))[group]
        for value in (start.energy + np.maximum(work, 0.0), after + np.maximum(-work, 0.0))
    )
    gain = (rest - source) / np.where(source > 0.0, source, math.inf)
    squares = np.maximum(*((state[:, VELOCITY] ** 2).sum(axis=1) for state in (start.mean, belief.mean)))
    return np.sqrt(squares + 2.0 * math.sqrt(scene.gravity @ scene.gravity) * np.abs(way).max(axis=1)), gain


def _kinetic(scene, start, belief, side):
    """Kinetic energy of each body [J], and of several rollouts the standard deviation of a single one's: each
    (B,).

    The mean over several rollouts has the spread's energy. Its share of rotation depends on how velocities
    and poses go
    together: the least (``side`` 0) or the largest (1) moment of inertia stands for all.
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


def _overlaps(scene, mean):
    """How deep each body's spheres reach into others or the environment [m], and no less than the energy
    there [J]: each (B,).
    """
    nudged = mean.copy()
    for k, body in enumerate(scene.bodies):
        nudged[k, POSITION.start] += k * _NUDGE * body.model.bounding_radius
    result = np.zeros((2, len(mean)))
    _add_overlaps(nudged, scene.world, scene.world.surroundings, result)
    return result[0], scene.stiffness * result[1]


@kernel
def _add_overlaps(x, world, surroundings, out):
    """Depths into ``out[0]``; depth times volume, half for each of two bodies, into ``out[1]``."""
    work = workspace(x, world)
    radii, pairs, records = world.tree.radii, work.search.pairs, work.search.records
    for k in range(near_pairs(x, world.bodies.radius, work.zero_travel, world.bodies.moving, work)):
        i, j = work.near[k, 0], work.near[k, 1]
        t_ij, slack, top = open_pair(x, i, j, world, work)
        while top > 0:
            count, top = next_contacts(world.tree, work.R_ij, t_ij, slack, work.search, top)
            for c in range(count):
                depth = radii[pairs[c, 0]] + radii[pairs[c, 1]] - records[c, DISTANCE]
                for body in (i, j):
                    out[0, body] = max(out[0, body], depth)
                    out[1, body] += 0.5 * depth * records[c, VOLUME]
    if surroundings is not None:
        for i in range(len(x)):
            if world.bodies.moving[i]:
                for e in range(len(surroundings.kind)):
                    t, top = open_element(x, i, e, world, surroundings, work)
                    while top > 0:
                        count, top = next_element_contacts(
                            world.tree, surroundings, e, work.R_ij, t, work.search, top
                        )
                        for c in range(count):
                            depth = radii[pairs[c, 0]] - records[c, DISTANCE]
                            out[0, i] = max(out[0, i], depth)
                            out[1, i] += depth * records[c, VOLUME]
