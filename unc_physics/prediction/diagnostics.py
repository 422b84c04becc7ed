"""Rules of a status: each measure with its computation, its limit, its flag and its message.

A measure is a function of the `Evidence` of one time. It returns values (B,), masked for bodies without a
value, or None if no body has one. Bodies that touched each other, directly or through others, share their
energy.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from ..checks.shown import printable
from ..physics.paper.contact_model import capacity
from ..propagators.base import Samples
from ..propagators.modes import contains, split
from ..propagators.overlap_depths import overlaps
from ..propagators.registry import names_where
from ..scene.environment import thing_names
from ..spatial.layout import ANGULAR_VELOCITY, ERR_POSITION, ERR_ROTATION, POSITION, VELOCITY
from ..spatial.moments import mean_and_errors
from .body_status import BodyStatus, Status
from .conservation_checks import energy_loss, kinetic_energies
from .evidence import Evidence, kinetic_moments, spread_floors
from .notes import notes_of
from .rare_outcomes import MATTER
from .step_motion import MOST_MOTION

_SAMPLED = names_where(lambda propagator: isinstance(propagator, Samples), "or")
_FAR = 5.0  # standard deviations beyond which samples of a correct belief are not expected
#: Standard deviations of position that a mean's depth inside something is compared with [m].
_MEAN_DEPTHS = 2e-4, 2e-3
_LOOKED_AT = 64  # most rollouts whose depths are computed; more take longer than all other measures
_LEAST_SHARE = 0.05  # of an outcome that moves the mean
_SURE = 2.0  # standard errors by which a measure must exceed its limit
_USUAL = 0.95  # quantile of the rollouts that is compared with a limit
_NARROWED = 0.5  # share of a standard deviation below which the removal of overlap is said
_QUANTITIES, _UNITS = ("position", "rotation"), ("m", "rad")  # that spreads are compared in


class Rule(NamedTuple):
    """A measure with its limit, its flag and its message."""

    flag: Status  # flag that a value above the limit raises
    limit: float
    words: str  # the problem and its remedy; ``{detail}`` stands for quantities of the body
    compute: Callable[[Evidence], np.ndarray | None]  # returns the values (B,), or None
    unit: str  # of the measure; empty for a share or a factor
    #: returns the ``detail`` of a body, by its index
    detail: Callable[[Evidence, int], str] | None
    in_contact: bool  # whether only bodies that touched something have a value


#: Every measure by its name.
RULES: dict[str, Rule] = {}


def _measure(flag, limit, words, *, unit="", detail=None, in_contact=False):
    """Enter a function into `RULES`, under its name."""

    def enter(compute):
        RULES[compute.__name__] = Rule(flag, limit, words, compute, unit, detail, in_contact)
        return compute

    return enter


def measures_of(evidence: Evidence) -> list[dict[str, float]]:
    """Return the measures of each body by name; a body that does not move has none."""
    touches, found = evidence.touches, {}
    for name, rule in RULES.items():
        if touches.any() or not rule.in_contact:
            values = rule.compute(evidence)
            if values is not None:
                found[name] = values
    return [
        {
            name: float(values[k])
            for name, values in found.items()
            if body.free and (touches[k] or not RULES[name].in_contact)
        }
        for k, body in enumerate(evidence.scene.bodies)
    ]


def raised(measures: Mapping[str, float]) -> list[str]:
    """Return the names of a body's measures that raise their flags; NaN counts as above the limit."""
    return [name for name, value in measures.items() if not value <= RULES[name].limit]


def judged(evidence: Evidence, body: int, measures: dict[str, float]) -> BodyStatus:
    """Return the status of a body, by its index, from its measures."""
    scene, flags, reasons, keys = evidence.scene, Status.FINE, [], raised(measures)
    for key in keys:
        value, rule = measures[key], RULES[key]
        flags |= rule.flag
        words = rule.words.format(
            dt=scene.dt,
            stiffness=scene.stiffness,
            shorter=scene.dt * rule.limit / value,
            stiffer=(scene.stiffness or 0.0) * value,
            detail="" if rule.detail is None else rule.detail(evidence, body),
        )
        unit = rule.unit and f" {rule.unit}"
        reasons.append(f"{words} ({key} {value:.3g}{unit} above {rule.limit:.3g}{unit})")
    notes = (*notes_of(scene, body), *_narrowed_spreads(evidence, body))
    return BodyStatus(scene.bodies[body].name, flags, measures, tuple(reasons), notes)


def _spreads_apart(evidence, body):
    """Return the quantity whose spread differs most from that of rollouts, and both spreads, as a text."""
    place = int(np.searchsorted(evidence.scene.moving, body))
    factors, moments = evidence.spread_factors, evidence.compared_moments
    assert factors is not None and moments is not None  # the rule had a value
    own, other = evidence.predicted_spreads[place], moments[1][place]
    k = int(np.argmax(factors[body]))
    unit, floor = _UNITS[k], spread_floors(evidence.start, body)[k]
    less = f" (less than {floor:.3g} {unit} counts as {floor:.3g} {unit})"
    less = less if min(own[k], other[k]) < floor else ""
    return f"{_QUANTITIES[k]} {own[k]:.3g} {unit} predicted, {other[k]:.3g} {unit} in rollouts{less}"


def _narrowed_spreads(evidence, body):
    """Return in words where the removal of overlap took most of a spread that was given."""
    return [
        f"starts with a standard deviation of its {quantity} of {after:.2g} {unit}, in a direction in which"
        f" {before:.2g} {unit} was given: other poses overlap something"
        for quantity, unit, (before, after) in zip(
            _QUANTITIES, _UNITS, evidence.start.narrowed[body], strict=True
        )
        if after < _NARROWED * before
    ]


def _squeezing(evidence, body):
    """Return the names of the two things between which a body is squeezed most, as a text."""
    squeezed, names = evidence.history.solver.squeezed[:, body], thing_names(evidence.scene)
    _, *pair = squeezed[np.argmax(squeezed[:, 0])]
    return " and ".join(f"'{printable(names[int(k)])}'" for k in pair)


def _widened_quantity(evidence, body):
    factors = evidence.widening[body]
    return f"{_QUANTITIES[int(np.argmax(factors))]} by a factor of {factors.max():.3g}"


def _kept_overlap(evidence, body):
    """Return the name of the deepest overlap that a body keeps, and its depth, as a text."""
    scene, depths = evidence.scene, evidence.start.kept_overlaps
    bodies = len(scene.bodies)
    own = np.concatenate([np.maximum(depths[body, :bodies], depths[:, body]), depths[body, bodies:]])
    other = int(np.argmax(own))
    if own[other] == 0.0:  # that of states of the belief
        return "another body or the environment"
    return f"'{printable(thing_names(scene)[other])}' by {own[other]:.3g} m"


def _mean_depth(evidence, body):
    depths, _ = overlaps(evidence.scene, evidence.snapshot.belief.mean[None])
    return f"{depths[0, body]:.3g} m"


# -- the start ---------------------------------------------------------------------------------------


@_measure(
    Status.INITIAL_OVERLAP,
    0.01,
    "overlaps {detail} at the start, which stays; check the poses of both, or give a larger covariance",
    detail=_kept_overlap,
)
def overlap_kept(evidence):
    """Deepest overlap at the start that is not removed, in any sample or point, over the body's radius. Where
    the scene keeps overlap, that of the mean, or that which one in twenty states of the belief exceeds.
    """
    start = evidence.start
    kept = start.overlap
    if evidence.scene.overlap != "keep" and start.found is not None:
        kept = start.found.kept.max(axis=0)
    return kept / start.shapes[:, 3]


@_measure(
    Status.INITIAL_OVERLAP,
    0.01,
    "some samples or points were moved by more than 5 standard deviations, to remove overlap or to rest, or"
    " it is in the same place as another body; check its pose, or give it a larger covariance",
)
def overlap_moved(evidence):
    """Share of the samples or points that projection or settling moved by more than 5 standard deviations of
    the belief. A sigma point may move by one standard deviation more than it lies from the mean. All of them
    for two bodies whose given centres of mass are closer than 2 % of the smaller one's radius, and which
    overlap: nothing says in which direction they are to part.
    """
    scene, start, found = evidence.scene, evidence.start, evidence.start.found
    if found is None or (scene.overlap == "keep" and not any(body.at_rest for body in scene.bodies)):
        return None
    # chosen points lie far out themselves, and may be moved as far
    drawn = start.samples is not None and math.isfinite(start.samples)
    far = _FAR if drawn else max(_FAR, 1.0 + math.sqrt(0.5 * len(found.moved)))
    return np.where(start.coincident, 1.0, (found.moved > far).mean(axis=0))


@_measure(
    Status.INITIAL_OVERLAP,
    0.05,
    "is set at_rest, and does not stay in some or all samples; put something that holds it below it, or"
    " remove at_rest",
)
def unsettled(evidence):
    """Share of the samples or points in which a body at rest did not come to rest."""
    found = evidence.start.found
    if found is None or not any(body.at_rest for body in evidence.scene.bodies):
        return None
    return found.unsettled.mean(axis=0)


@_measure(
    Status.OUTSIDE_VALIDITY,
    2e-4,
    "is squeezed between {detail}, which leave it less room than its size; check its pose, and their paths",
    unit="m",
    detail=_squeezing,
    in_contact=True,
)
def squeezed(evidence):
    """Depths of the body's opposite contacts with two bodies that do not give way, one of them prescribed,
    together. The largest of all steps, which one in twenty rollouts exceeds. With the
    implicit integrator.
    """
    if evidence.scene.integrator == "explicit":
        return None
    return np.quantile(evidence.history.solver.squeezed[..., 0], _USUAL, axis=0)


# -- the spread --------------------------------------------------------------------------------------


@_measure(
    Status.OUTSIDE_VALIDITY,
    1.0,
    "the rotation spreads too far for a mean and a covariance; read samples or modes in their place",
    unit="rad",
)
def rotation_std(evidence):
    """Largest standard deviation of the rotation about any axis [rad], or that of the rollouts that the
    spread was compared with, if it is smaller; less two of its standard errors (``spread_error``).
    """
    moving = evidence.scene.moving
    blocks = evidence.snapshot.belief.blocks[:, ERR_ROTATION, ERR_ROTATION]
    largest = np.linalg.eigvalsh(blocks)[:, -1]
    if evidence.compared is not None:
        _, errors = mean_and_errors(np.ascontiguousarray(evidence.compared), moving)
        own = errors.reshape(len(errors), len(moving), -1)[:, :, ERR_ROTATION]
        of_rollouts = np.einsum("rmi,rmj->mij", own, own) / len(own)
        largest = np.minimum(largest, np.linalg.eigvalsh(of_rollouts)[:, -1])
    result = np.zeros(len(evidence.scene.bodies))
    result[moving] = np.sqrt(np.maximum(largest, 0.0))
    errors = spread_error(evidence)
    return result if errors is None else result * np.maximum(1.0 - _SURE * errors, 0.0)


@_measure(
    Status.OUTSIDE_VALIDITY,
    1.5,  # from which on evaluations count a spread as wrong
    f"its predicted spread differs from that of rollouts: {{detail}}; take {_SAMPLED}",
    detail=_spreads_apart,
)
def spread_disagreement(evidence):
    """Factor between the predicted spread and that of a few rollouts, of position or rotation, whichever is
    larger. The rollouts start with the belief's mean and covariance, so it is 1 where all is linear.
    """
    factors = evidence.spread_factors
    return None if factors is None else factors.max(axis=1)


@_measure(
    Status.OUTSIDE_VALIDITY,
    0.5,  # from which on evaluations count a mean as wrong
    f"its predicted mean differs from that of rollouts; take {_SAMPLED}",
)
def mean_disagreement(evidence):
    """Distance of the predicted mean from that of a few rollouts, over their standard deviation, of position
    or rotation, whichever is larger.
    """
    distances = evidence.mean_distances
    return None if distances is None else distances.max(axis=1)


@_measure(Status.OUTSIDE_VALIDITY, 0.25, "its spread rests on too few rollouts; more of them help")
def spread_error(evidence):
    """Standard error of the standard deviation of position or rotation, over that standard deviation,
    whichever is larger. Of N plain samples it is one over the root of 2 (N - 1), 1 for one sample. No value
    if only one outcome is possible. ``cloud`` and ``auto`` ignore turns about axes of bodies of revolution.
    """
    own = evidence.own_measures.get("spread_error")
    if own is not None or not isinstance(evidence.propagator, Samples) or evidence.start.deterministic:
        return own
    others = len(evidence.history.first_time) - 1
    return np.full(len(evidence.scene.bodies), min(1.0, 1.0 / math.sqrt(2.0 * max(others, 0.5))))


@_measure(
    Status.OUTSIDE_VALIDITY,
    MATTER,
    "rare outcomes lie far from all rollouts, and may widen the spread of {detail}; ask for"
    " the probability of an event, or for many more rollouts",
    detail=_widened_quantity,
)
def rare_outcomes(evidence):
    """Factor by which outcomes widen the standard deviation of position or rotation that a few rollouts do
    not reach, whichever is larger. They are looked for in as many rollouts of a belief that is twice as wide,
    more than eight standard deviations from the mean. Their probability is computed as if they began at a
    threshold along one uncertain direction, whose distance follows from their share.
    """
    return None if evidence.widening is None else evidence.widening.max(axis=1)


@_measure(
    Status.OUTSIDE_VALIDITY,
    1.05,
    "ended before its accuracy was reached; allow more time, or a larger value of the option 'runs'",
)
def missed_goal(evidence):
    """Largest error over its limit, or 32 over the number of rollouts. For ``auto``."""
    return evidence.own_measures.get("missed_goal")


@_measure(
    Status.OUTSIDE_VALIDITY,
    0.0,
    f"its spread was not compared with rollouts, though {{detail}}; ask for some, or take {_SAMPLED}",
    detail=lambda evidence, body: ", and ".join(evidence.doubts[body]),
)
def unchecked(evidence):
    """Number of reasons for which the spread should be compared with that of rollouts, if none were asked
    for. After a contact: the method has one nominal rollout, or leaves something out; or its points move
    unevenly, touch different things, may have turned by half a turn, or are spread along more than 30
    directions. In flight: points turn far or unevenly, or a covariance is of first order in the rotation of a
    step of more than 2 rad.
    """
    if evidence.compared is not None or not any(evidence.doubts):
        return None
    return np.array([float(len(own)) for own in evidence.doubts])


# -- the mean ----------------------------------------------------------------------------------------


@_measure(
    Status.MEAN_NOT_POSSIBLE,
    1.0,
    f"outcomes split into several, between which the mean lies; read the modes of {_SAMPLED}",
    in_contact=True,
)
def outcomes(evidence):
    """Number of separate outcomes of the rollouts (`PredictedBody.modes`) with a share of at least 5 %; 1
    where the mean pose is within a standard deviation of an outcome's mean in each coordinate. Of methods
    without rollouts: of those that the spread was compared with.
    """
    snapshot, scene, compared = evidence.snapshot, evidence.scene, evidence.compared
    if snapshot.rollout_states is None and compared is None:
        return None
    found = np.ones(len(scene.bodies))
    for k in np.flatnonzero(evidence.touches):
        radius, mean = scene.bodies[k].model.bounding_radius, snapshot.belief.mean[k]
        modes = (
            snapshot.modes(scene, k) if snapshot.rollout_states is not None else split(compared[:, k], radius)
        )
        if not any(contains(mode, mean, radius) for mode in modes):
            found[k] = sum(mode.weight >= _LEAST_SHARE for mode in modes)
    return found


@_measure(
    Status.MEAN_NOT_POSSIBLE,
    1.0,
    "the mean pose lies {detail} inside another body or the environment; read samples or modes",
    detail=_mean_depth,
    in_contact=True,
)
def mean_penetration(evidence):
    """Depth of the deepest overlap of the mean pose, less two standard errors of this pose, over the largest
    standard deviation of the position on any axis, limited to 0.2 to 2 mm. Overlap that is kept from the
    start, or as deep as that of one in twenty rollouts, does not count. Not with the explicit integrator,
    whose contacts are soft.
    """
    scene, start, belief = evidence.scene, evidence.start, evidence.snapshot.belief
    # the mean of a nominal method is a rollout's own pose
    if evidence.propagator.traits.mean_update == "nominal" or scene.integrator == "explicit":
        return None
    depths, _ = overlaps(scene, belief.mean[None])
    kept = start.overlap if start.found is None else np.maximum(start.overlap, start.found.kept.max(axis=0))
    std = np.zeros(len(scene.bodies))
    P = belief.blocks[:, ERR_POSITION, ERR_POSITION]
    std[scene.moving] = np.sqrt(np.maximum(np.linalg.eigvalsh(P)[:, -1], 0.0))
    scale, depth = np.clip(std, *_MEAN_DEPTHS), depths[0] - kept
    if (depth > scale).any() and evidence.states is not None:
        # evenly spaced, as the first ones of many sigma points lie on one side of the mean
        last = len(evidence.states) - 1
        some = np.linspace(0, last, min(last + 1, _LOOKED_AT)).round().astype(int)
        own, _ = overlaps(scene, evidence.states[some])
        depth = depth - np.quantile(own, _USUAL, axis=0)
    return np.maximum(depth - _SURE * mean_pose_errors(evidence), 0.0) / scale


def mean_pose_errors(evidence):
    """Return the standard error of each mean pose along one axis, with that of touched bodies: (B,) [m].

    Errors of the rotation are multiplied by the body's radius.
    """
    scene, propagator, errors = evidence.scene, evidence.propagator, np.zeros(len(evidence.scene.bodies))
    if not isinstance(propagator, Samples):
        return errors
    found = propagator.standard_errors(evidence.snapshot.carry, scene)
    if found is None:
        of_mean = np.zeros((len(errors), 2))
        count = len(evidence.history.first_time)
        of_mean[scene.moving] = evidence.predicted_spreads / math.sqrt(count)
    else:
        of_mean = np.column_stack([found.position, found.rotation])
    errors = (of_mean[:, 0] ** 2 + (evidence.start.shapes[:, 3] * of_mean[:, 1]) ** 2) / 3.0
    pairs = evidence.touched[:, : len(errors)]
    others = np.where(pairs | pairs.T, errors, 0.0).max(axis=1)
    return np.sqrt(errors + others)


# -- the physics -------------------------------------------------------------------------------------


@_measure(
    Status.NOT_CONVERGED,
    0.02,
    "energy was gained, or lost in contacts that conserve it; a smaller dt, now {dt:.3g} s, helps",
    in_contact=True,
)
def energy_error(evidence):
    """Energy gained, over the initial energy, the work of gravity and the energy of overlap at the start.
    Bodies that touched share their energy. With several rollouts, a lower bound of the mean. Or energy lost,
    over the largest kinetic energy at the start, the first contact or the end, if that is larger. Losses
    count only where all contacts are elastic and without friction, parameters are certain, and nothing else
    takes energy; not with the explicit integrator. A tracker's predictions are not judged. Falls from less
    than 1 mm do not count.
    """
    if evidence.scene.acts or evidence.propagator.adds_energy:
        return None
    lost = _energy_lost(evidence) if evidence.conserving.any() else -math.inf
    return np.maximum(_energy_gained(evidence), lost)


def _energy_gained(evidence):
    """Return the share of energy (B,) that each body's group gained."""
    scene, start, belief = evidence.scene, evidence.start, evidence.snapshot.belief
    position = belief.mean[:, POSITION]
    propagator = evidence.propagator
    if isinstance(propagator, Samples) and propagator.resamples and evidence.states is not None:
        # samples that are made of rollouts conserve no energy; the rollouts do
        position = evidence.states[..., POSITION].mean(axis=0)
        speed, spin = (
            np.einsum("nbi,nbi->b", part, part) / len(part)
            for part in (evidence.states[..., VELOCITY], evidence.states[..., ANGULAR_VELOCITY])
        )
        after = 0.5 * start.mass * (speed + start.shapes[:, 0] * spin)
    else:
        after, _ = kinetic_moments(scene, start, belief, 0)
    work = start.mass * ((position - start.mean[:, POSITION]) @ scene.gravity)
    source, rest = (
        np.bincount(evidence.group, value, len(work))[evidence.group]
        for value in (start.energy + np.maximum(work, 0.0), after + np.maximum(-work, 0.0))
    )
    return (rest - source) / np.where(source > 0.0, source, math.inf)


def _energy_lost(evidence):
    """Return the share of energy (B,) that each body's group lost; minus infinity where it may lose some."""
    scene, start, states, belief = evidence.scene, evidence.start, evidence.states, evidence.snapshot.belief
    if states is not None:
        position, kinetic = states[..., POSITION].mean(axis=0), kinetic_energies(scene, start.mass, states)
    else:
        position, (kinetic, _) = belief.mean[:, POSITION], kinetic_moments(scene, start, belief, 1)
    bodies, times = len(scene.bodies), evidence.history.first_time
    first = np.minimum(times.min(axis=2), times[:, :, :bodies].min(axis=1))  # of each rollout
    reached = np.isfinite(first)
    mean = np.where(reached, first, 0.0).sum(axis=0) / np.maximum(reached.sum(axis=0), 1)
    lost = energy_loss(scene, start, position, kinetic, mean, evidence.group)
    return np.where(evidence.conserving, lost, -math.inf)


@_measure(
    Status.NOT_CONVERGED,
    1.0,
    "hits harder than the stiffness can stop; raise stiffness, now {stiffness:.3g}, above {stiffer:.2g}"
    " N/m^3, and lower dt with its root",
    in_contact=True,
)
def impact_over_capacity(evidence):
    """Kinetic energy at the highest expected speed, over the energy that two spheres as large as the body's
    largest absorb before they pass through each other. With the explicit integrator.
    """
    scene, start = evidence.scene, evidence.start
    if scene.integrator != "explicit":
        return None
    most = np.maximum(capacity(start.shapes[:, 2], scene.stiffness), 1e-300)
    return 0.5 * start.mass * evidence.highest_speed**2 / most


@_measure(
    Status.NOT_CONVERGED,
    MOST_MOTION,
    "moves too far in one step for contacts to be seen: it can pass through something, or turn past it; lower"
    " dt, now {dt:.3g} s, to {shorter:.2g} s",
)
def step_motion(evidence):
    """Motion in one explicit step of the body and something that it meets, at a step or between two, in a
    dozen rollouts: the relative travel over the sum of their thicknesses, or the rotation of either [rad],
    whichever is larger. Thicknesses are the diameter of a body's largest sphere, and the least extent of an
    element. Balls that hit each other centrally overlap during two steps at the limit, and need not touch
    from twice the limit on. Balls turn without effect. The value is 0 within the limit.
    """
    return None if evidence.step_motion is None else evidence.step_motion.max(axis=1)
