"""Reality: recorded pushes of a block over a table, as we, a limit surface and other engines predict them."""

from __future__ import annotations

import math
import time

import numpy as np

from unc_physics.calibration.scores import mahalanobis_rank
from unc_physics.prediction.predict import predict
from unc_physics.propagators.registry import make_propagator

from ..action_engines import FINE, OWN
from ..goals import Figure, goal_tables, goals_met_by
from ..jobs import Job, Outcome, Row, Settings
from ..limit_surface import pushed
from ..methods import MONTE_CARLO, OURS, label
from ..push_engines import pushed_in
from ..recorded_pushes import KINDS, REPEATS_STD, planar, planar_before, push_scene, recorded_pushes, seen
from ..results import Results, Rows
from ..rollouts import available, missing_engines
from ..scores import bootstrap, rms, rms_difference
from ..tables import number, table
from ..tip_friction import STD, two_tip_friction

TITLE = "Pushes"
SAMPLES = 50
_QUICK = 12  # pushes of each kind
_A_JOB = 20  # pushes
#: A single rollout with nothing uncertain, a block that stays where it is, and an ellipsoidal limit surface.
NOMINAL, STAYS, LIMIT_SURFACE = "sigma_points", "stays", "limit_surface"
_FINE = "_fine"
#: With the friction of two tips that their forces tell, in place of the single tip's.
MEASURED = "_measured"
METHODS = {
    NOMINAL: "one rollout",
    MONTE_CARLO: f"mean of {SAMPLES} samples",
    STAYS: "the block stays",
    LIMIT_SURFACE: "ellipsoidal limit surface",
} | {
    f"{engine}{end}": f"{label(engine)}, {settings[engine].words(engine)}"
    for engine in OWN
    for end, settings in (("", OWN), (_FINE, FINE))
}
METHODS |= {
    f"{name}{MEASURED}": f"{METHODS[name]}, friction from the two tips' forces"
    for name in (NOMINAL, MONTE_CARLO, LIMIT_SURFACE)
}
#: By whom, and about how long a push takes each [s].
_BY = {OURS: 0.05 * SAMPLES, MEASURED: 0.05 * SAMPLES, LIMIT_SURFACE: 0.3, "mujoco": 0.6, "pybullet": 0.6}
POSITION, ROTATION, RANK, COST = "position_error", "rotation_error", "rank", "cpu_time"
LEVEL = 0.9
_GOALS = {"point": (1.7e-3, math.radians(1.8)), "two_point_rotation": (4e-3, None)}


def jobs(settings: Settings) -> list[Job]:
    """Some pushes of one kind each, by ours, by the limit surface, or by another engine."""
    pushes, found = recorded_pushes(), []
    for kind, name in enumerate(KINDS):
        own = np.flatnonzero(pushes.kind == kind)
        count = min(_QUICK, len(own)) if settings.quick else len(own)
        for first in range(0, count, _A_JOB):
            last = min(first + _A_JOB, count)
            for by in (OURS, *([MEASURED] if kind else []), LIMIT_SURFACE, *available()[1:]):
                parameters = settings.parameters(
                    by=by, kind=name, first=first, last=last, of=count, samples_each=SAMPLES
                )
                found.append(Job("pushes", parameters, cost=_BY[by] * (last - first)))
    return found


def missing(settings: Settings) -> list[str]:
    """Engines that are not installed."""
    return missing_engines("pushes")


def run(job: Job) -> Outcome:
    """Predict where the block is after each push, and compare."""
    p, pushes = job.parameters, recorded_pushes()
    own = np.flatnonzero(pushes.kind == KINDS.index(p["kind"]))
    order = np.random.default_rng(p["base_seed"]).permutation(own)[: p["of"]]
    predicted = {OURS: _ours, MEASURED: _with_measured_friction, LIMIT_SURFACE: _by_limit_surface}.get(
        p["by"], _in_engine
    )
    return Outcome([row for k in order[p["first"] : p["last"]].tolist() for row in predicted(job, k)])


def _ours(job, k):
    """A single rollout, a block that stays, and samples."""
    return [*_rollouts(job, k), *_errors(STAYS, planar_before(k), seen(k), None, k)]


def _with_measured_friction(job, k):
    """The same, and a limit surface, with the friction that the two tips' forces tell."""
    friction = two_tip_friction()
    rows = _rollouts(job, k, (friction, STD)) + _errors(LIMIT_SURFACE, pushed(k, friction), seen(k), None, k)
    return [row._replace(method=row.method + MEASURED) for row in rows]


def _rollouts(job, k, tip_friction=None):
    """A single rollout, and samples."""
    p, found, seed = job.parameters, seen(k), job.seed(f"push {k}") % 2**31
    start = push_scene(k, False, tip_friction)
    began = time.process_time()
    end = predict(start.scene, start.belief, NOMINAL, start.horizon).belief.mean[0]
    rows = [Row(NOMINAL, COST, "s", time.process_time() - began, None, k)]
    rows += _errors(NOMINAL, planar(end), found, None, k)
    unsure = push_scene(k, True, tip_friction)
    propagator = make_propagator(MONTE_CARLO, samples=p["samples_each"], seed=seed)
    began = time.process_time()
    prediction = predict(unsure.scene, unsure.belief, propagator, unsure.horizon)
    rows.append(Row(MONTE_CARLO, COST, "s", time.process_time() - began, SAMPLES, k, seed))
    places = _about(planar(prediction.samples()[:, 0]), found)
    rows += _errors(MONTE_CARLO, found + places.mean(axis=0), found, SAMPLES, k, seed)
    places += np.random.default_rng(seed).normal(size=places.shape) * REPEATS_STD
    middle = places.mean(axis=0)
    rank = mahalanobis_rank(places - middle, -middle)
    return [*rows, Row(MONTE_CARLO, RANK, "1", float(rank), SAMPLES, k, seed)]


def _by_limit_surface(job, k):
    return _errors(LIMIT_SURFACE, pushed(k), seen(k), None, k)


def _in_engine(job, k):
    """At the engine's own settings, and at finer ones."""
    engine, rows = job.parameters["by"], []
    for end, settings in (("", OWN), (_FINE, FINE)):
        place, spent = pushed_in(engine, settings[engine], k)
        rows.append(Row(engine + end, COST, "s", spent, None, k))
        rows += _errors(engine + end, place, seen(k), None, k)
    return rows


def _about(places, found):
    """Places (..., 3) relative to the one that was seen, the yaw between -pi and pi."""
    away = places - found
    away[..., 2] = (away[..., 2] + math.pi) % (2.0 * math.pi) - math.pi
    return away


def _errors(method, place, found, samples, k, seed=None):
    away = _about(np.array(place, float), found)
    return [
        Row(method, POSITION, "m", float(np.hypot(away[0], away[1])), samples, k, seed),
        Row(method, ROTATION, "rad", float(abs(away[2])), samples, k, seed),
    ]


def report(results: Results) -> str:
    """Errors of the final pose, what others are off by more than we, coverage, and goals."""
    rows = results.rows("pushes")
    lines = []
    for kind in rows.unique("kind"):
        own = rows.where(kind=kind)
        lines += [_line(own, kind, method, title) for method, title in METHODS.items()]
    head = ["pushes", "", "rms [mm]", "median", "less ours", "rms [degrees]", "median", "less ours"]
    head += [f"in the {100 * LEVEL:.0f} % region", "CPU time [ms], median"]
    found = table(head, [line for line in lines if line])
    return "\n".join([found, goal_tables(figures(results))])


def _line(rows, kind, method, title):
    """A line of the table; nothing where there is none of the method."""
    errors = {quantity: _by_push(rows, method, quantity) for quantity in (POSITION, ROTATION)}
    if not errors[POSITION]:
        return []
    cells = [f"{kind.replace('_', ' ')}, {len(errors[POSITION])}", title]
    for quantity, factor in ((POSITION, 1e3), (ROTATION, math.degrees(1.0))):
        ours, theirs = _by_push(rows, NOMINAL, quantity), errors[quantity]
        values = factor * np.array(list(theirs.values()))
        cells += [f"{rms(values):.2f} ({_interval(values)})", f"{np.median(values):.2f}"]
        both = factor * np.array([[theirs[k], ours[k]] for k in theirs if k in ours]).reshape(-1, 2)
        if method == NOMINAL or not len(both):
            cells.append("")
            continue
        low, high = rms_difference(*both.T, np.random.default_rng(0))
        cells.append(f"{rms(both[:, 0]) - rms(both[:, 1]):+.2f} ({low:+.2f} to {high:+.2f})")
    cells.append(f"{100 * _coverage(rows, method):.0f} %" if method.startswith(MONTE_CARLO) else "")
    cost = _values(rows, method, COST)
    return [*cells, number(1e3 * float(np.median(cost))) if len(cost) else ""]


def _by_push(rows, method, quantity):
    return {row["replicate"]: row["value"] for row in rows.where(method=method, quantity=quantity)}


def _values(rows: Rows, method, quantity):
    return rows.where(method=method, quantity=quantity).values()


def _coverage(rows, method=MONTE_CARLO):
    return float(np.mean(_values(rows, method, RANK) <= LEVEL))


def _interval(values):
    low, high = bootstrap(np.square(values), np.random.default_rng(0))
    return f"{math.sqrt(low):.2f} to {math.sqrt(high):.2f}"


def figures(results: Results) -> dict[str, list[Figure]]:
    """The figures that have goals."""
    rows, found = results.rows("pushes"), []
    for kind, (length, angle) in _GOALS.items():
        own = rows.where(kind=kind, by=OURS)
        if not len(own):
            continue
        case = kind.replace("_", " ")
        position = 1e3 * rms(_values(own, NOMINAL, POSITION))
        found.append(Figure("error of the position, rms", case, position, "mm", 1e3 * length, at_most=True))
        if angle is not None:
            rotation = math.degrees(rms(_values(own, NOMINAL, ROTATION)))
            goal = number(math.degrees(angle))
            found.append(
                Figure("error of the yaw, rms", case, rotation, "degrees", float(goal), at_most=True)
            )
        off = 100.0 * abs(_coverage(own) - LEVEL)
        found.append(Figure("coverage less 90 %", case, off, "%", 5.0, at_most=True))
    return {"Goals": found}


verdict = goals_met_by(figures)
