"""Random everyday scenes: share of wrong predictions of each method, and of those without warning."""

from __future__ import annotations

import numpy as np

from unc_physics import make_propagator, predict
from unc_physics.checks.errors import DivergedError, NotSupportedError
from unc_physics.prediction.body_status import BodyStatus
from unc_physics.prediction.diagnostics import RULES, raised
from unc_physics.prediction.probability import NORMAL_QUANTILE
from unc_physics.prediction.status import assess
from unc_physics.propagators.auto import Auto
from unc_physics.propagators.base import Samples, StandardErrors
from unc_physics.spatial.layout import ERR_POSITION, ERR_ROTATION
from unc_physics.spatial.moments import mean_and_errors

from ..answers import NOTHING, Answer, Counts, Moments, count, distance
from ..everyday_scenes import KINDS, kind_of, scene_at_random
from ..jobs import Job, Outcome, Row, Settings
from ..methods import MONTE_CARLO
from ..results import Results, Rows
from ..stability_document import IGNORED, SHAPE
from ..tables import table

TITLE = "Random everyday scenes: wrong, and said so"
SCENES, OUTCOMES = 204, 1000
QUICK_SCENES, QUICK_OUTCOMES = 4 * len(KINDS), 500
#: What is asked, by what people read.
METHODS = {
    "auto": ("auto", {}),
    "cloud": ("cloud", {}),
    "sigma points": ("sigma_points", {}),
    "linearization": ("linearization", {}),
    "surrogate": ("surrogate", {}),
    "local sampling": ("local_sampling", {}),
    "MC-32": (MONTE_CARLO, {"samples": 32}),
}
FACTOR, MEAN, FLAGS, UNCONFIRMED, COVERED = (
    "spread factor",
    "mean error",
    "flags",
    "flags not confirmed",
    "intervals hold",
)
TIME = "wall time"


def jobs(settings: Settings) -> list[Job]:
    """Return a job for each scene."""
    scenes, outcomes = (QUICK_SCENES, QUICK_OUTCOMES) if settings.quick else (SCENES, OUTCOMES)
    return [
        Job("scenes_at_random", settings.parameters(scene=k, truth=outcomes), cost=outcomes * 5e-3)
        for k in range(scenes)
    ]


def run(job: Job) -> Outcome:
    """Return each body's errors, its flags, and whether its intervals contain the truth."""
    scene, belief, horizon = scene_at_random(job.parameters["scene"])
    own = make_propagator(MONTE_CARLO, samples=job.parameters["truth"], seed=job.seed("truth"))
    truth = predict(scene, belief, own, horizon)
    confirmed = [reasons(status) for status in assess(truth)]
    rows = []
    for name in METHODS:
        rows += method_rows(job, name, truth, confirmed)
    return Outcome(rows)


def reasons(status: BodyStatus) -> set[str]:
    """Return the names of the measures that raise flags of a body."""
    return {name for name in raised(status.measures) if RULES[name].flag not in IGNORED}


def method_rows(job: Job, name: str, truth, confirmed) -> list[Row]:
    """Return rows of one method; none if it does not support the scene.

    A flag is confirmed if the same measure of the truth exceeds its limit. Any measure of
    `SHAPE` confirms any other, as they all mean that no mean represents the outcomes. A missed goal is
    confirmed if the truth's outcomes vary enough (`misses_goal`).
    """
    scene, belief, horizon = scene_at_random(job.parameters["scene"])
    kind, options = METHODS[name]
    propagator = make_propagator(kind, **options)
    seed = job.seed(name) if "seed" in propagator.options() else None
    if seed is not None:
        propagator = make_propagator(kind, **options, seed=seed)
    try:
        prediction = predict(scene, belief, propagator, horizon)
        statuses = assess(prediction)
    except NotSupportedError:
        return []
    except DivergedError:
        return [
            Row(name, quantity, "1", value, None, k, seed)
            for k in scene.moving
            for quantity, value in (
                (FACTOR, np.inf),
                (MEAN, np.inf),
                (FLAGS, 1),
                (UNCONFIRMED, 1),
                (COVERED, 0),
            )
        ]
    rows = [Row(name, TIME, "s", prediction.wall_time, None, 0, seed)]
    errors = propagator.standard_errors(prediction.carry, scene) if isinstance(propagator, Samples) else None
    for k in scene.moving.tolist():
        found, true = (Moments(one.belief.mean[k], one.belief.marginal(k)) for one in (prediction, truth))
        factor, mean_error = distance(found, true)
        flags = reasons(statuses[k])
        truth_flags = confirmed[k] | (SHAPE if confirmed[k] & SHAPE else set())
        if isinstance(propagator, Auto) and misses_goal(
            truth, k, len(prediction.at().rollout_states), propagator
        ):
            truth_flags = truth_flags | {"missed_goal"}
        values = {
            FACTOR: factor,
            MEAN: mean_error,
            FLAGS: len(flags),
            UNCONFIRMED: len(flags - truth_flags),
            COVERED: holds(errors, k, found, true),
        }
        rows += [Row(name, quantity, "1", float(value), None, k, seed) for quantity, value in values.items()]
    return rows


def misses_goal(truth, body: int, rollouts: int, own: Auto) -> bool:
    """Return whether a number of independent rollouts misses the goal for a body's mean and spread.

    The standard errors are computed from the truth's outcomes.
    """
    states = np.ascontiguousarray(truth.at().rollout_states[:, body : body + 1])
    errors = mean_and_errors(states, np.arange(1))[1]
    if 1.0 / np.sqrt(rollouts) > own.error:
        return True
    for block, nothing in zip((ERR_POSITION, ERR_ROTATION), NOTHING, strict=True):
        squares = (errors[:, block] ** 2).sum(axis=1)
        variance = max(squares.mean(), nothing**2)
        if squares.std() / (2.0 * variance * np.sqrt(rollouts)) > own.spread_error:
            return True
    return False


def holds(errors: StandardErrors | None, body: int, found: Moments, true: Moments) -> bool:
    """Return whether intervals from the reported standard errors of a body contain the truth."""
    if errors is None:
        return False
    factor, _ = distance(found, true)
    _, mean_error = distance(true, found)  # over the predicted standard deviation
    of_spread, of_mean = (NORMAL_QUANTILE * own[body] for own in (errors.spread, errors.relative))
    return bool(mean_error <= of_mean and abs(np.log(factor)) <= np.log1p(of_spread))


def answers(rows: Rows) -> dict[str, list[Answer]]:
    """Return the answers of each method, one for each predicted body."""
    found: dict[str, dict[tuple, dict[str, float]]] = {}
    for row in rows:
        if row["quantity"] != TIME:
            key = row["scene"], row["replicate"]
            found.setdefault(row["method"], {}).setdefault(key, {})[row["quantity"]] = row["value"]
    return {
        name: [
            Answer(one[FACTOR], one[MEAN], one[FLAGS] > 0, one[UNCONFIRMED] > 0, one[COVERED] > 0)
            for one in bodies.values()
        ]
        for name, bodies in found.items()
    }


def report(results: Results) -> str:
    """Return tables of all methods, and of `auto` by kind of scene."""
    rows = results.rows("scenes_at_random")
    lines = [_line(name, count(own)) for name, own in answers(rows).items()]
    by_kind = []
    for kind in KINDS:
        own = answers(Rows(row for row in rows if kind_of(row["scene"]) == kind))
        by_kind.append(_line(kind, count(own.get("auto", []))))
    head = ["bodies", "wrong", "wrong, not said", "good", "good, flagged"]
    of_auto = table(["kind", *head], by_kind)
    return f"{table(['method', *head], lines)}\n`auto` by kind of scene:\n\n{of_auto}"


def _line(name: str, counts: Counts) -> list[str]:
    return [name, *map(str, counts)]
