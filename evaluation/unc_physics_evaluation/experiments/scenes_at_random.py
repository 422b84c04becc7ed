"""Random everyday scenes: how many bodies each method gets wrong, and whether flags or intervals say so."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from unc_physics import make_propagator, predict
from unc_physics.checks.errors import DivergedError, NotSupportedError
from unc_physics.prediction.body_status import BodyStatus
from unc_physics.prediction.diagnostics import RULES, raised
from unc_physics.prediction.probability import CONFIDENCE
from unc_physics.prediction.status import assess
from unc_physics.propagators.auto import Auto
from unc_physics.spatial.layout import ERR_POSITION, ERR_ROTATION
from unc_physics.spatial.moments import mean_and_errors

from ..answers import NOTHING, Answer, Counts, Moments, count, distance
from ..everyday_scenes import KINDS, kind_of, scene_at_random
from ..goals import Figure, goals_met_by
from ..jobs import Job, Outcome, Row, Settings
from ..judgement import IGNORED, SHAPE
from ..methods import MONTE_CARLO
from ..results import Results, Rows
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
#: Shares that `auto` is to reach: wrong, and wrong and silent, of all bodies; falsely flagged, of the good.
GOALS = 0.03, 0.005, 0.03
FACTOR, MEAN, FLAGS, UNCONFIRMED, COVERED = (
    "spread factor",
    "mean error",
    "flags",
    "flags not confirmed",
    "intervals hold",
)
TIME = "wall time"


def jobs(settings: Settings) -> list[Job]:
    """One for each scene."""
    scenes, outcomes = (QUICK_SCENES, QUICK_OUTCOMES) if settings.quick else (SCENES, OUTCOMES)
    return [
        Job("scenes_at_random", settings.parameters(scene=k, truth=outcomes), cost=outcomes * 5e-3)
        for k in range(scenes)
    ]


def run(job: Job) -> Outcome:
    """Distance of each body's moments from the truth, its flags, and whether its intervals hold."""
    scene, belief, horizon = scene_at_random(job.parameters["scene"])
    own = make_propagator(MONTE_CARLO, samples=job.parameters["truth"], seed=job.seed("truth"))
    truth = predict(scene, belief, own, horizon)
    confirmed = [reasons(status, surely=False) for status in assess(truth)]
    rows = []
    for name in METHODS:
        rows += method_rows(job, name, truth, confirmed)
    return Outcome(rows)


def reasons(status: BodyStatus, *, surely: bool = True) -> set[str]:
    """Names of the measures that raise flags of a body."""
    return {name for name in raised(status.measures, surely=surely) if RULES[name].flag not in IGNORED}


def method_rows(job: Job, name: str, truth, confirmed) -> list[Row]:
    """Rows of one method; none where it does not take the scene.

    A flag is confirmed where the same measure of the truth is above its limit, surely or not. Of those that
    say that no mean stands for the outcomes (`SHAPE`), any one of the truth's confirms any. That a goal is
    missed is confirmed where the truth's outcomes vary so much (`misses_goal`).
    """
    scene, belief, horizon = scene_at_random(job.parameters["scene"])
    of, options = METHODS[name]
    own = make_propagator(of, **options)
    seed = job.seed(name) if "seed" in own.options() else None
    if seed is not None:
        own = make_propagator(of, **options, seed=seed)
    try:
        prediction = predict(scene, belief, own, horizon)
        statuses = assess(prediction)
    except NotSupportedError:
        return []
    except DivergedError:
        return [
            Row(name, what, "1", value, None, k, seed)
            for k in scene.moving
            for what, value in ((FACTOR, np.inf), (MEAN, np.inf), (FLAGS, 1), (UNCONFIRMED, 1), (COVERED, 0))
        ]
    rows = [Row(name, TIME, "s", prediction.wall_time, None, 0, seed)]
    for k in scene.moving.tolist():
        found, true = (Moments(one.belief.mean[k], one.belief.marginal(k)) for one in (prediction, truth))
        factor, mean_error = distance(found, true)
        flags = reasons(statuses[k])
        known = confirmed[k] | (SHAPE if confirmed[k] & SHAPE else set())
        if isinstance(own, Auto) and misses_goal(truth, k, len(prediction.at().rollout_states), own):
            known = known | {"missed_goal"}
        values = {
            FACTOR: factor,
            MEAN: mean_error,
            FLAGS: len(flags),
            UNCONFIRMED: len(flags - known),
            COVERED: holds(statuses[k].measures, found, true),
        }
        rows += [Row(name, what, "1", float(value), None, k, seed) for what, value in values.items()]
    return rows


def misses_goal(truth, body: int, rollouts: int, own: Auto) -> bool:
    """Whether so many independent rollouts know a body's mean and spread less surely than asked.

    The standard errors are those of the truth's outcomes.
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


def holds(measures: Mapping[str, float], found: Moments, true: Moments) -> bool:
    """Whether intervals of the reported standard errors, as wide as those of probabilities, hold."""
    if not {"spread_error", "mean_error"} <= set(measures):
        return False
    factor, _ = distance(found, true)
    _, mean_error = distance(true, found)  # over the predicted standard deviation
    of_spread, of_mean = (CONFIDENCE * measures[name] for name in ("spread_error", "mean_error"))
    return mean_error <= of_mean and abs(np.log(factor)) <= np.log1p(of_spread)


def answers(rows: Rows) -> dict[str, list[Answer]]:
    """The answers of each method, one for each body that it took."""
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


def sections(results: Results) -> dict[str, list[Figure]]:
    """The shares of `auto` beside their goals."""
    own = answers(results.rows("scenes_at_random")).get("auto", [])
    if not own:
        return {}
    counts = count(own)
    shares = counts.wrong_share, counts.silent_share, counts.false_share
    words = "wrong", "wrong without flag or interval", "good ones flagged"
    return {
        TITLE: [
            Figure(what, "auto", share, "", goal, at_most=True)
            for what, share, goal in zip(words, shares, GOALS, strict=True)
        ]
    }


verdict = goals_met_by(sections)


def report(results: Results) -> str:
    """Tables of all methods, and of `auto` by kind of scene."""
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
