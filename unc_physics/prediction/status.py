"""How far each body's prediction can be trusted: flags, and the measures that they were judged by."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..checks.errors import InvalidOptionError, LimitExceededError
from ..checks.validation import instance, integer
from ..propagators.base import SAMPLES_LIMIT
from .few_rollouts import rollout_spreads
from .prediction import Prediction
from .status_measures import left_open, measures_at, needs_rollouts, start_of, unevenness_at_times
from .status_rules import BodyStatus, judged

#: Rollouts with which `assess` compares what rests on a single nominal one.
ROLLOUTS = 12
#: With how many at least where that leaves open whether a spread is wrong.
SURE = 64


def assess(prediction: Prediction, *, rollouts: int = ROLLOUTS) -> tuple[BodyStatus, ...]:
    """Check what can be checked of a prediction at its end.

    Parameters
    ----------
    prediction : Prediction
    rollouts : int, optional
        How many to compare with, for a propagator that asks for it (`Propagator.compared_with_rollouts`); it
        costs as many rollouts, where there is something to touch, or a gyroscopic term; of points in pairs,
        where they touched something and are uneven, or many, or may have turned by half a turn since. Where
        spreads differ by a factor of 1.4 to 2.7, or of 1.1 to 2.7 with doubtful contacts, 64 rollouts at
        least decide. With 0, what touched by a single nominal rollout is flagged as unchecked.

    Returns
    -------
    tuple of BodyStatus
        One for each body, in the scene's order; a fixed body's has no measures.

    Notes
    -----
    The measures, each compared with its limit in `status_rules.RULES`; bodies that touched each other,
    directly or through others, share their energy:

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
        a step [rad], at the highest speed that start, end and gravity suggest. Up to the limit an impact of
        two spheres changes their energy by at most 4 %, at 1.8 by 70 %, and one of many contacts by more.
    ``impact_over_capacity``
        With the explicit integrator: kinetic energy at that speed over what two spheres as large as the
        body's largest take up before they pass through each other (`contact_model.capacity`).
    ``directions``
        Of points that are spread along directions, for a body that touched something: in how many directions
        the bodies that they are spread for together are uncertain. Points lie farther out the more there are,
        and most of them move a single body. It raises no flag where rollouts spread alike.
    ``rotation_std``
        Largest standard deviation of the rotation about any axis that the body would have at the end without
        contact [rad]; not of a propagator with samples of its own.
    ``spread_disagreement``
        The factor by which predicted spreads and those of a few rollouts differ, of position or rotation,
        whichever is worse. The rollouts begin with the belief's own mean and covariance, so that it is 1
        where all is linear.
    ``doubtful_contacts``
        The same of a body for which contacts, or their order in an impact, would have been others within a
        standard deviation (`Propagator.doubtful_since`): there a smaller factor is enough.
    ``few_samples``
        Of a propagator with samples of its own: by which share of itself a spread is uncertain for their
        number alone, which one sample leaves unknown (1).
    ``unevenness``
        Of points in opposite pairs: spread of position or rotation, over that of what is opposite in the
        pairs, whichever is larger. What is not comes from curvature, by which points far out tell too much.
        Above 1.05 rollouts are asked, and it raises no flag; what bends alike on both sides shows in these
        alone.
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
    return prediction.answers.statuses(prediction, compared_rollouts(rollouts))


def compared_rollouts(rollouts: int, field: str = "rollouts") -> int:
    """With how many rollouts to compare, checked; one alone has no spread."""
    if integer(rollouts, field, low=0) == 1:
        raise InvalidOptionError("must be 0, or at least 2", field=field, value=rollouts)
    if rollouts > SAMPLES_LIMIT:
        raise LimitExceededError(f"must be at most {SAMPLES_LIMIT}", field=field, value=rollouts)
    return rollouts


@np.errstate(all="ignore")
def judge(prediction: Prediction, rollouts: int) -> tuple[tuple[BodyStatus, ...], ...]:
    """The statuses of a prediction that was made here."""
    scene, start = prediction.scene, start_of(prediction)
    uneven = unevenness_at_times(prediction, start)
    spreads = [None] * len(prediction.times)
    if rollouts > 0 and needs_rollouts(prediction, start, uneven):
        spreads = rollout_spreads(scene, prediction.initial, prediction.times, rollouts)
        if rollouts < SURE and left_open(prediction, start, spreads):
            spreads = rollout_spreads(scene, prediction.initial, prediction.times, SURE)
    return tuple(
        tuple(
            judged(scene, body.name, measures)
            for body, measures in zip(
                scene.bodies,
                measures_at(scene, start, prediction, time, belief, spread, bent, motion),
                strict=True,
            )
        )
        for time, belief, spread, bent, motion in zip(
            prediction.times,
            prediction.beliefs,
            spreads,
            uneven,
            prediction.answers.motions(len(prediction.times)),
            strict=True,
        )
    )
