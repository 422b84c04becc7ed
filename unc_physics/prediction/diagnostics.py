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
from ..physics.paper.contact_model import capacity, impact_frequency
from ..propagators.base import Samples
from ..propagators.modes import contains, split
from ..propagators.overlap_depths import overlaps
from ..propagators.registry import names_where
from ..propagators.start import OVERLAP_TOLERANCE
from ..scene.environment import thing_names
from ..spatial.layout import ANGULAR_VELOCITY, ERR_POSITION, ERR_ROTATION, POSITION, VELOCITY
from ..spatial.moments import mean_and_errors
from .body_status import BodyStatus, Status
from .conservation_checks import energy_loss as lost_share
from .conservation_checks import kinetic_energies
from .evidence import MOST_FLIGHT_TURN, Evidence, kinetic_moments, spread_floors
from .notes import hull_of_mesh
from .rare_outcomes import MATTER
from .step_motion import MOST_TRAVEL, MOST_TURN

_SAMPLED = names_where(lambda propagator: isinstance(propagator, Samples), "or")
_ESTIMATED = names_where(lambda propagator: propagator.traits.mean_update == "estimated", "or")
_DRAWING = names_where(lambda propagator: propagator.supports.impact_errors, "or")
_EXACT_FLIGHT = names_where(lambda propagator: not propagator.traits.separate_collisions, "or")
_FAR = 5.0  # standard deviations beyond which samples of a correct belief are not expected
#: Standard deviations of position that a mean's depth inside something is compared with [m].
_MEAN_DEPTHS = 2e-4, 2e-3
_PENETRATION = 0.05  # depth that is too deep, over the body's radius
_LOOKED_AT = 64  # most rollouts whose depths are computed; more take longer than all other measures
_LEAST_SHARE = 0.05  # of an outcome that moves the mean
_SURE = 2.0  # standard errors by which a measure must exceed its limit
_EXTENT_SHARE = 5e-3  # least loss of extent that counts, over the radius of large bodies
_DENSITIES = 0.1, 1e5  # below and above the densities of all materials [kg/m^3]
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
    #: whether it raises no flag where the spread was compared with that of rollouts
    unless_compared: bool
    #: standard error of the measure, from all measures of the body; the flag is raised above the limit plus
    #: two standard errors
    error: Callable[[Mapping[str, float]], float] | None


#: Every measure by its name.
RULES: dict[str, Rule] = {}


def _measure(
    flag, limit, words, *, unit="", detail=None, in_contact=False, unless_compared=False, error=None
):
    """Enter a function into `RULES`, under its name."""

    def enter(compute):
        rule = Rule(flag, limit, words, compute, unit, detail, in_contact, unless_compared, error)
        RULES[compute.__name__] = rule
        return compute

    return enter


def measures_of(evidence: Evidence) -> list[dict[str, float]]:
    """Return the measures of each body by name; a body that does not move has none."""
    touches, found = evidence.touches, {}
    for name, rule in RULES.items():
        if touches.any() or not rule.in_contact:
            values = rule.compute(evidence)
            if values is not None:
                found[name] = np.ma.masked_array(values, rule.in_contact & ~touches | np.ma.getmask(values))
    return [
        {
            name: float(values[k])
            for name, values in found.items()
            if body.free and values[k] is not np.ma.masked
        }
        for k, body in enumerate(evidence.scene.bodies)
    ]


def raised(measures: Mapping[str, float], *, surely: bool = True) -> list[str]:
    """Return the names of a body's measures that raise their flags; NaN counts as above the limit.

    Without ``surely``, standard errors of the measures do not count.
    """
    compared = "spread_disagreement" in measures
    return [
        name
        for name, value in measures.items()
        if not value <= (_sure_limit(name, measures) if surely else RULES[name].limit)
        and not (compared and RULES[name].unless_compared)
    ]


def _sure_limit(name, measures):
    """Return the limit of a measure plus two of its standard errors."""
    rule = RULES[name]
    return rule.limit if rule.error is None else rule.limit + _SURE * rule.error(measures)


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
    notes = (hull_of_mesh(scene, body), *_narrowed_spreads(evidence, body))
    notes = tuple(note for note in notes if note is not None)
    return BodyStatus(scene.bodies[body].name, flags, measures, tuple(reasons), notes)


def _spreads_apart(evidence, body):
    """Return the quantity whose spread differs most from that of rollouts, and both spreads, as a text."""
    place = int(np.searchsorted(evidence.scene.moving, body))
    own, other = evidence.predicted_spreads[place], evidence.spreads[place]
    factors = evidence.spread_factors
    assert factors is not None  # the rule had a value
    k = int(np.argmax(factors[body]))
    unit, floor = _UNITS[k], spread_floors(evidence.start, body)[k]
    less = f" (less than {floor:.3g} {unit} counts as {floor:.3g} {unit})"
    less = less if min(own[k], other[k]) < floor else ""
    return f"{_QUANTITIES[k]} {own[k]:.3g} {unit} predicted, {other[k]:.3g} {unit} in rollouts{less}"


def _narrowed_spreads(evidence, body):
    """Return in words where the removal of overlap took most of a spread that was given."""
    return [
        f"its {quantity} has a standard deviation of {after:.2g} {unit} at the start, in a direction in which"
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


def _uneven_quantity(evidence, body):
    return _QUANTITIES[int(np.argmax(evidence.asymmetries[body]))]


def _widened_quantity(evidence, body):
    factors = evidence.widening[body]
    return f"{_QUANTITIES[int(np.argmax(factors))]} by a factor of {factors.max():.3g}"


def _mean_errors(evidence, body):
    errors = evidence.propagator.standard_errors(evidence.snapshot.carry, evidence.scene)
    return f"{errors.position[body]:.3g} m and {errors.rotation[body]:.3g} rad"


def _kept_overlap(evidence, body):
    """Return the name of the deepest overlap that a body keeps, and its depth, as a text."""
    name, depth = _deepest_kept(evidence, body)
    return "something" if name is None else f"{name} by {depth:.3g} m"


def _kept_name(evidence, body):
    """Return the name of the deepest overlap that a body keeps."""
    return _deepest_kept(evidence, body)[0] or "something"


def _deepest_kept(evidence, body):
    """Return the quoted name of the deepest overlap that a body keeps, or None, and the depth [m]."""
    scene, depths = evidence.scene, evidence.start.kept_overlaps
    bodies = len(scene.bodies)
    own = np.concatenate([np.maximum(depths[body, :bodies], depths[:, body]), depths[body, bodies:]])
    other = int(np.argmax(own))
    # without a depth it overlapped something when it settled
    return None if own[other] == 0.0 else f"'{printable(thing_names(scene)[other])}'", float(own[other])


def _density(evidence, body):
    own = evidence.scene.bodies[body]
    return f"{own.mass:.3g} kg and {own.model.volume:.3g} m^3"


def _mean_depth(evidence, body):
    depths, _ = overlaps(evidence.scene, evidence.snapshot.belief.mean[None])
    return f"{depths[0, body]:.3g} m"


# -- the start ---------------------------------------------------------------------------------------


@_measure(
    Status.INITIAL_OVERLAP,
    0.02,
    "overlaps another body or the environment at the start; give poses without overlap, or use the preset"
    " 'everyday' with 'overlap: project'",
)
def initial_overlap(evidence):
    """Depth of the overlap that one in twenty states of the belief exceeds, or that of the mean, over the
    body's radius. Only where the scene keeps overlap.
    """
    start = evidence.start
    return start.overlap / start.shapes[:, 3] if evidence.scene.overlap == "keep" else None


@_measure(
    Status.INITIAL_OVERLAP, math.inf, "overlapped at the start, and was moved to the nearest pose without"
)
def overlap_share(evidence):
    """Share of the samples or points in which the body overlapped something at the start and was moved. It
    raises no flag.
    """
    found = evidence.start.found
    return None if found is None else (found.overlap > OVERLAP_TOLERANCE).mean(axis=0)


@_measure(
    Status.INITIAL_OVERLAP,
    0.02,
    "overlaps {detail} at the start and has no free pose within its covariance; the overlap stays; check the"
    " poses of both, or give it a larger covariance",
    detail=_kept_overlap,
)
def overlap_kept(evidence):
    """Deepest overlap that could not be removed, in any sample or point, over the body's radius."""
    found = evidence.start.found
    if found is None or evidence.scene.overlap == "keep":
        return None
    return found.kept.max(axis=0) / evidence.start.shapes[:, 3]


@_measure(
    Status.INITIAL_OVERLAP,
    0.5,
    "overlaps {detail} at the start in most samples or points; the two poses contradict each other",
    detail=_kept_name,
)
def overlap_certain(evidence):
    """Share of the samples or points that keep an overlap."""
    found = evidence.start.found
    if found is None or evidence.scene.overlap == "keep":
        return None
    return (found.kept > OVERLAP_TOLERANCE).mean(axis=0)


@_measure(
    Status.INITIAL_OVERLAP,
    0.98,
    "is in the same place as another body at the start; the two poses contradict each other; check them",
)
def coincidence(evidence):
    """1 less the distance between the centres of mass of two bodies that overlap at the start, over the
    smaller body's radius. Above the limit, nothing says in which direction they are to part. Only where the
    scene does not keep overlap.
    """
    return None if evidence.scene.overlap == "keep" else evidence.start.coincidence


@_measure(
    Status.INITIAL_OVERLAP,
    0.01,
    "some samples or points were moved by more than 5 standard deviations, to remove overlap or to rest;"
    " check its pose, or give it a larger covariance",
)
def overlap_moved(evidence):
    """Share of the samples or points that projection or settling moved by more than 5 standard deviations of
    the belief. A sigma point may move by one standard deviation more than it lies from the mean.
    """
    scene, start, found = evidence.scene, evidence.start, evidence.start.found
    if found is None or (scene.overlap == "keep" and not any(body.at_rest for body in scene.bodies)):
        return None
    # chosen points lie far out themselves, and may be moved as far
    drawn = start.samples is not None and math.isfinite(start.samples)
    far = _FAR if drawn else max(_FAR, 1.0 + math.sqrt(0.5 * len(found.moved)))
    return (found.moved > far).mean(axis=0)


@_measure(
    Status.INITIAL_OVERLAP,
    math.radians(15.0),
    "is set at_rest, and tilted far until something held it; check its orientation, and what is below it",
    unit="rad",
)
def settled_tilt(evidence):
    """Angle by which a body at rest tilted until contacts held it, root mean square [rad]."""
    found = evidence.start.found
    if found is None or not any(body.at_rest for body in evidence.scene.bodies):
        return None
    return np.sqrt((found.tilted**2).mean(axis=0))


@_measure(
    Status.INITIAL_OVERLAP,
    0.05,
    "is set at_rest, and nothing holds it; put something below it, or remove at_rest",
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
    error=lambda own: own["rotation_std"] * own.get("spread_error", own.get("few_samples", 0.0)),
)
def rotation_std(evidence):
    """Largest standard deviation of the rotation about any axis [rad], or that of the rollouts that the
    spread was compared with, if it is smaller. It raises the flag where it exceeds the limit by two standard
    errors, which are ``spread_error`` or ``few_samples`` of it.
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
    return result


@_measure(
    Status.OUTSIDE_VALIDITY,
    1.0,
    f"its points turn more than half a turn from the mean, where rotations repeat; take {_SAMPLED}",
)
def point_turn(evidence):
    """Angle between the rotations of the farthest sigma points and the mean, over half a turn: at the start,
    and of a body that touched nothing also now.
    """
    start, moving = evidence.start, evidence.scene.moving
    if start.directions is None or not len(moving):
        return None
    far = np.sqrt(start.directions.sum() + len(evidence.scene.uncertain) + 0.5)
    rotations = start.blocks[:, ERR_ROTATION, ERR_ROTATION], evidence.flown_rotations
    largest = np.linalg.eigvalsh(np.stack(rotations))[..., -1].max(axis=0)
    result = np.zeros(len(evidence.scene.bodies))
    result[moving] = far * np.sqrt(np.maximum(largest, 0.0)) / math.pi
    return result


@_measure(
    Status.OUTSIDE_VALIDITY,
    2.0,
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
    MOST_FLIGHT_TURN,
    "its spread is of first order in the rotation of a step, and was not compared with rollouts; lower dt,"
    f" now {{dt:.3g}} s, to {{shorter:.2g}} s, or take {_EXACT_FLIGHT}",
    unit="rad",
    unless_compared=True,
)
def flight_rotation(evidence):
    """Rotation in one step [rad], at the start or now, with methods whose covariance is of first order in it.
    Spreads of rotations across the axis are too large by 19 % at the limit, by a factor of 2 at 3.8, and
    without bound at whole turns. Above the limit they are compared with those of rollouts; it then raises no
    flag.
    """
    return evidence.step_turn if evidence.propagator.traits.separate_collisions else None


@_measure(
    Status.OUTSIDE_VALIDITY,
    0.2,
    f"its outcome changes at the mean: {{detail}} has other slopes on either side; take {_ESTIMATED}",
    detail=lambda evidence, body: _QUANTITIES[int(np.argmax(evidence.slope_changes[body]))],
)
def slope_change(evidence):
    """Difference of the slopes of position or rotation on either side of the mean, over the slopes' mean,
    whichever is larger. Slopes along all uncertain directions are compared together, by standard deviation.
    Slopes that the accuracy of contacts makes do not count.
    For ``linearization``, except with the explicit integrator.
    """
    return None if evidence.slope_changes is None else evidence.slope_changes.max(axis=1)


@_measure(
    Status.OUTSIDE_VALIDITY,
    1.0,
    "has a mass that does not fit its size, {detail}; is its mesh in millimetres? Scale it to metres, or"
    " correct the mass",
    detail=_density,
)
def density_misfit(evidence):
    """Factor by which the mean density is outside of 0.1 to 100 000 kg/m^3, which foam and metals are within.
    Not with the explicit integrator.
    """
    if evidence.scene.integrator == "explicit":
        return None
    densities = np.array([body.mass / body.model.volume for body in evidence.scene.bodies])
    return np.maximum(_DENSITIES[0] / densities, densities / _DENSITIES[1])


@_measure(Status.OUTSIDE_VALIDITY, 0.3, "too few samples for a spread")
def few_samples(evidence):
    """Relative uncertainty of a spread that comes from the number of samples; 1 for a single sample. No value
    if only one outcome is possible.
    """
    if not isinstance(evidence.propagator, Samples) or evidence.start.deterministic:
        return None
    others = len(evidence.history.first_time) - 1
    return np.full(len(evidence.scene.bodies), min(1.0, 1.0 / math.sqrt(2.0 * max(others, 0.5))))


@_measure(Status.OUTSIDE_VALIDITY, math.inf, "no surface fits the rollouts", in_contact=True)
def surface_error(evidence):
    """Mean square error of the response surface at rollouts that it was not fitted to, over the variance.
    At 1 the answer consists of the rollouts alone. It raises no flag.
    """
    return evidence.own_measures.get("surface_error")


@_measure(
    Status.OUTSIDE_VALIDITY,
    0.35,
    "rests on too few rollouts, with standard errors of the mean of {detail}; more of them help",
    detail=_mean_errors,
    in_contact=True,
)
def mean_error(evidence):
    """Standard error of the mean position or rotation over the standard deviation, whichever is larger. For
    propagators with a response surface.
    """
    return evidence.own_measures.get("mean_error")


@_measure(Status.OUTSIDE_VALIDITY, 0.25, "its spread rests on too few rollouts; more of them help")
def spread_error(evidence):
    """Standard error of the standard deviation of position or rotation, over that standard deviation,
    whichever is larger. For propagators with a response surface.
    """
    return evidence.own_measures.get("spread_error")


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


@_measure(Status.OUTSIDE_VALIDITY, 1.05, "ended before its accuracy was reached; allow more time or runs")
def missed_goal(evidence):
    """Largest error over its limit, or 32 over the number of rollouts. For ``auto``."""
    return evidence.own_measures.get("missed_goal")


@_measure(
    Status.OUTSIDE_VALIDITY,
    0.5,
    f"its spread after a contact was not compared with rollouts; ask for some, or take {_ESTIMATED}",
    in_contact=True,
)
def unchecked(evidence):
    """1 for a body that touched something, if the method has one nominal rollout and no rollouts were asked
    for. Its spread is wrong by more than a factor of 2 more often than not.
    """
    nominal = evidence.propagator.traits.mean_update == "nominal"
    return np.ones(len(evidence.scene.bodies)) if nominal and evidence.spreads is None else None


@_measure(
    Status.OUTSIDE_VALIDITY,
    0.0,
    f"its spread after a contact leaves out {{detail}}; take {_DRAWING}",
    detail=lambda evidence, body: ", ".join(evidence.left_out),
    in_contact=True,
    unless_compared=True,
)
def left_out(evidence):
    """Number of standard deviations of materials and impacts that the method cannot carry, and left out. It
    raises no flag where the spread was compared with that of rollouts, which have them.
    """
    return np.full(len(evidence.scene.bodies), float(len(evidence.left_out))) if evidence.left_out else None


@_measure(
    Status.OUTSIDE_VALIDITY,
    30.0,
    f"too many uncertain directions for the method's points; take {_SAMPLED}",
    in_contact=True,
    unless_compared=True,
)
def directions(evidence):
    """Number of uncertain directions of the scene. Points lie farther out
    the more there are. It raises no flag where the spread was compared with that of rollouts.
    """
    scene, of_moving = evidence.scene, evidence.start.directions
    if of_moving is None:
        return None
    return np.full(len(scene.bodies), float(of_moving.sum() + len(scene.uncertain)))


@_measure(
    Status.OUTSIDE_VALIDITY,
    2.5,
    f"opposite points do not move oppositely in {{detail}}; take {_SAMPLED}",
    detail=_uneven_quantity,
    in_contact=True,
    unless_compared=True,
)
def unevenness(evidence):
    """Spread of sigma points over the part of it that is opposite in the pairs, of position or rotation,
    whichever is larger. Above 1.05 the spread is compared with that of rollouts; it then raises no flag.
    """
    return None if evidence.start.directions is None else evidence.asymmetry


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
    error=lambda own: own.get("mean_pose_error", 0.0),
)
def mean_penetration(evidence):
    """Depth of the deepest overlap of the mean pose, over the largest standard deviation of the position on
    any axis, limited to 0.2 to 2 mm. Overlap that is kept from the start, or as deep as that of one in twenty
    rollouts, does not count. It raises the flag where it exceeds the limit by two ``mean_pose_error``. Not
    with the explicit integrator, whose contacts are soft.
    """
    scene, start, belief = evidence.scene, evidence.start, evidence.snapshot.belief
    # the mean of a nominal method is a rollout's own pose
    if evidence.propagator.traits.mean_update == "nominal" or scene.integrator == "explicit":
        return None
    depths, _ = overlaps(scene, belief.mean[None])
    kept = start.overlap if start.found is None else np.maximum(start.overlap, start.found.kept.max(axis=0))
    scale, depth = _depth_scales(evidence), depths[0] - kept
    if (depth > scale).any() and evidence.states is not None:
        own, _ = overlaps(scene, evidence.states[_looked_at(evidence.states)])
        depth = depth - np.quantile(own, _USUAL, axis=0)
    return np.maximum(depth, 0.0) / scale


@_measure(Status.MEAN_NOT_POSSIBLE, math.inf, "the mean pose rests on too few rollouts", in_contact=True)
def mean_pose_error(evidence):
    """Standard error of the mean pose, over the largest standard deviation of the position along any axis,
    limited to 0.2 to 2 mm as in ``mean_penetration``. It raises no flag.
    """
    if not isinstance(evidence.propagator, Samples) or evidence.scene.integrator == "explicit":
        return None
    return mean_pose_errors(evidence) / _depth_scales(evidence)


def _looked_at(states):
    """Return the indices of the states whose depths are computed, evenly spaced.

    The first ones of many sigma points lie on one side of the mean.
    """
    count = len(states)
    return np.linspace(0, count - 1, min(count, _LOOKED_AT)).round().astype(int)


def _depth_scales(evidence):
    """Return the unit of `mean_penetration` (B,), a limited standard deviation of the position [m]."""
    std, belief = np.zeros(len(evidence.scene.bodies)), evidence.snapshot.belief
    P = belief.blocks[:, ERR_POSITION, ERR_POSITION]
    std[evidence.scene.moving] = np.sqrt(np.maximum(np.linalg.eigvalsh(P)[:, -1], 0.0))
    return np.clip(std, *_MEAN_DEPTHS)


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
    Status.NOT_CONVERGED, 0.02, "energy was gained; a smaller dt, now {dt:.3g} s, helps", in_contact=True
)
def energy_gain(evidence):
    """Energy gained, over the initial energy, the work of gravity and the energy of overlap at the start.
    Bodies that touched share their energy. With several rollouts, a lower bound of the mean.
    """
    scene, start, belief = evidence.scene, evidence.start, evidence.snapshot.belief
    if scene.acts:  # which adds energy
        return None
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


@_measure(
    Status.NOT_CONVERGED,
    0.05,
    "ends inside the environment or a fixed body; a smaller dt, now {dt:.3g} s, helps",
    in_contact=True,
)
def penetration_share(evidence):
    """Share of the rollouts in which the body ends deeper inside the environment or a fixed body than 5 % of
    its radius, without the overlap that it keeps from the start. With the explicit integrator also deeper
    than the radius of its largest sphere. Not in scenes with actions; of 64 samples at most.
    """
    scene, start, states = evidence.scene, evidence.start, evidence.states
    if scene.acts or states is None:  # actions move bodies whether there is room or not
        return None
    kept = np.zeros(len(scene.bodies))
    if scene.overlap == "keep":
        kept = start.overlap
    elif start.found is not None:
        kept = start.found.kept
        kept = kept if len(kept) == len(states) else kept.max(axis=0)
    some = _looked_at(states)
    depths, _ = overlaps(scene, states[some], among_moving=False)
    limit = _PENETRATION * start.shapes[:, 3]
    if scene.integrator == "explicit":  # where spheres are springs: deeper than one can push back
        limit = np.maximum(limit, start.shapes[:, 2])
    return (depths - (kept[some] if kept.ndim == 2 else kept) > limit).mean(axis=0)


@_measure(
    Status.NOT_CONVERGED,
    0.02,
    "energy was lost in contacts that conserve it; a smaller dt, now {dt:.3g} s, helps",
    in_contact=True,
)
def energy_loss(evidence):
    """Energy lost, over the largest kinetic energy at the start, the first contact or the end. Only
    where all contacts are elastic and without friction, parameters are certain, and nothing else takes
    energy. Falls from less than 1 mm do not count. Not with the explicit integrator.
    """
    scene, start, states, belief = evidence.scene, evidence.start, evidence.states, evidence.snapshot.belief
    if scene.acts or not evidence.conserving.any():
        return None
    if states is not None:
        position, kinetic = states[..., POSITION].mean(axis=0), kinetic_energies(scene, start.mass, states)
    else:
        position, (kinetic, _) = belief.mean[:, POSITION], kinetic_moments(scene, start, belief, 1)
    bodies, times = len(scene.bodies), evidence.history.first_time
    first = np.minimum(times.min(axis=2), times[:, :, :bodies].min(axis=1))  # of each rollout
    reached = np.isfinite(first)
    mean = np.where(reached, first, 0.0).sum(axis=0) / np.maximum(reached.sum(axis=0), 1)
    lost = lost_share(scene, start, position, kinetic, mean, evidence.group)
    return np.ma.masked_array(lost, ~evidence.conserving)


@_measure(
    Status.NOT_CONVERGED,
    1.3,
    "the step is too long for the stiffness of contacts; lower dt, now {dt:.3g} s, to {shorter:.2g} s",
    in_contact=True,
)
def step_times_frequency(evidence):
    """Angle of a contact's oscillation in one explicit step [rad], at the highest speed that start, end and
    gravity suggest. Up to the limit an impact of two spheres changes their energy by 4 % at most, at 1.8 by
    70 %.
    """
    scene, radius = evidence.scene, evidence.start.shapes[:, 2]
    if scene.integrator != "explicit":
        return None
    frequency = [
        impact_frequency(evidence.highest_speed[k], 1.0 / body.mass, radius[k], scene.stiffness)
        for k, body in enumerate(scene.bodies)
    ]
    return scene.dt * np.array(frequency)


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
    MOST_TRAVEL,
    "can pass through something within one step; lower dt, now {dt:.3g} s, to {shorter:.2g} s",
)
def step_travel(evidence):
    """Relative travel in one explicit step of the body and something that it meets, at a step or between two,
    in a dozen rollouts: over the sum of their thicknesses. These are the diameter of a body's largest sphere,
    and the least extent of an element. Balls that hit each other centrally overlap during two steps at the
    limit, and need not touch from twice the limit on. The value is 0 within the limit.
    """
    return None if evidence.step_motion is None else evidence.step_motion[:, 0]


@_measure(
    Status.NOT_CONVERGED,
    MOST_TURN,
    "turns too far in one step, or what it meets does, for contacts to be seen; lower dt, now {dt:.3g} s, to"
    " {shorter:.2g} s",
    unit="rad",
)
def step_rotation(evidence):
    """Rotation in one explicit step of the body, or of something that it meets, as in ``step_travel`` [rad].
    Without contact, rotations are exact at any step. Balls turn without effect.
    """
    return None if evidence.step_motion is None else evidence.step_motion[:, 1]


@_measure(
    Status.NOT_CONVERGED,
    0.025,
    "the step is too long for contacts that roll or tip; lower dt to {shorter:.2g} s, or better to 1/240 s",
    unit="s",
    in_contact=True,
)
def contact_step(evidence):
    """Time step of a body in contact [s]. Beyond the limit, rolling bodies lose speed, and boxes tip over.
    Not with the explicit integrator.
    """
    scene = evidence.scene
    return np.full(len(scene.bodies), scene.dt) if scene.integrator != "explicit" else None
