"""Reality: recorded pushes of a block over a table by one and two finger tips."""

from __future__ import annotations

import math
import time

import numpy as np

from unc_physics.calibration.scores import mahalanobis_rank
from unc_physics.prediction.predict import predict
from unc_physics.propagators.registry import make_propagator

from ..goals import Figure, goal_tables, goals_met_by
from ..jobs import Job, Outcome, Row, Settings
from ..methods import MONTE_CARLO
from ..recorded_pushes import KINDS, REPEATS_STD, planar, push_scene, recorded_pushes, seen
from ..results import Results, Rows
from ..scores import bootstrap
from ..tables import number, table

TITLE = "Pushes"
SAMPLES = 50
_QUICK = 30  # pushes of each kind
_A_JOB = 20  # pushes
#: A single rollout with nothing uncertain, and a block that stays where it is.
NOMINAL, STAYS = "sigma_points", "stays"
METHODS = {NOMINAL: "one rollout", MONTE_CARLO: f"mean of {SAMPLES} samples", STAYS: "the block stays"}
POSITION, ROTATION, RANK, COST = "position_error", "rotation_error", "rank", "cpu_time"
LEVEL = 0.9
_GOALS = {"point": (1.7e-3, math.radians(1.8)), "two_point_rotation": (4e-3, None)}


def jobs(settings: Settings) -> list[Job]:
    """Some pushes of one kind each."""
    pushes, found = recorded_pushes(), []
    for kind, name in enumerate(KINDS):
        own = np.flatnonzero(pushes.kind == kind)
        count = min(_QUICK, len(own)) if settings.quick else len(own)
        for first in range(0, count, _A_JOB):
            last = min(first + _A_JOB, count)
            parameters = settings.parameters(
                kind=name, first=first, last=last, of=count, samples_each=SAMPLES
            )
            found.append(Job("pushes", parameters, cost=0.05 * (last - first) * SAMPLES))
    return found


def run(job: Job) -> Outcome:
    """Predict where the block is after each push, and compare."""
    p, pushes = job.parameters, recorded_pushes()
    own = np.flatnonzero(pushes.kind == KINDS.index(p["kind"]))
    order = np.random.default_rng(p["base_seed"]).permutation(own)[: p["of"]]
    rows = []
    for k in order[p["first"] : p["last"]].tolist():
        found, seed = seen(k), job.seed(f"push {k}") % 2**31
        start = push_scene(k, uncertain=False)
        began = time.process_time()
        end = predict(start.scene, start.belief, NOMINAL, start.horizon).belief.mean[0]
        rows.append(Row(NOMINAL, COST, "s", time.process_time() - began, None, k))
        rows += _errors(NOMINAL, planar(end), found, None, k)
        rows += _errors(STAYS, planar(start.belief.mean[0]), found, None, k)
        unsure = push_scene(k)
        propagator = make_propagator(MONTE_CARLO, samples=p["samples_each"], seed=seed)
        began = time.process_time()
        prediction = predict(unsure.scene, unsure.belief, propagator, unsure.horizon)
        rows.append(Row(MONTE_CARLO, COST, "s", time.process_time() - began, SAMPLES, k, seed))
        places = _about(planar(prediction.samples()[:, 0]), found)
        rows += _errors(MONTE_CARLO, found + places.mean(axis=0), found, SAMPLES, k, seed)
        places += np.random.default_rng(seed).normal(size=places.shape) * REPEATS_STD
        middle = places.mean(axis=0)
        rank = mahalanobis_rank(places - middle, -middle)
        rows.append(Row(MONTE_CARLO, RANK, "1", float(rank), SAMPLES, k, seed))
    return Outcome(rows)


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
    """Errors of the final pose, coverage, and goals."""
    rows = results.rows("pushes")
    about = (
        "Real pushes of an aluminium block by one and two finger tips at 2.5 mm/s or 2.5 degrees/s (see the"
        " README beside the data). Root mean square and median of the final pose's error, position of the"
        " centre of mass, with 95 % of a bootstrap over pushes; nothing is tuned in the single rollout. Both"
        f" frictions, where the load is and the pusher's frame are uncertain in the {SAMPLES} samples; their"
        " regions also count by how much pushes of the same command end apart (0.84 mm, 1.3 degrees).\n"
    )
    lines = []
    for kind in rows.unique("kind"):
        own = rows.where(kind=kind)
        for method, title in METHODS.items():
            position, rotation = (_values(own, method, quantity) for quantity in (POSITION, ROTATION))
            covered = _coverage(own) if method == MONTE_CARLO else None
            lines.append(
                [
                    f"{kind.replace('_', ' ')}, {len(position)}",
                    title,
                    f"{1e3 * _rms(position):.2f} ({_interval(1e3 * position)})",
                    f"{1e3 * np.median(position):.2f}",
                    f"{math.degrees(_rms(rotation)):.2f} ({_interval(np.degrees(rotation))})",
                    f"{math.degrees(np.median(rotation)):.2f}",
                    "" if covered is None else f"{100 * covered:.0f} %",
                ]
            )
    head = [
        "pushes",
        "",
        "rms [mm]",
        "median",
        "rms [degrees]",
        "median",
        f"in the {100 * LEVEL:.0f} % region",
    ]
    cost = _values(rows, NOMINAL, COST)
    spent = f"A push takes {1e3 * np.median(cost):.0f} ms of CPU time (median).\n"
    return "\n".join([about, table(head, lines), spent, goal_tables({"Goals": figures(results)["Goals"]})])


def _values(rows: Rows, method, quantity):
    return rows.where(method=method, quantity=quantity).values()


def _coverage(rows):
    return float(np.mean(_values(rows, MONTE_CARLO, RANK) <= LEVEL))


def _rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def _interval(values):
    low, high = bootstrap(np.square(values), np.random.default_rng(0))
    return f"{math.sqrt(low):.2f} to {math.sqrt(high):.2f}"


def figures(results: Results) -> dict[str, list[Figure]]:
    """The figures that have goals."""
    rows, found = results.rows("pushes"), []
    for kind, (length, angle) in _GOALS.items():
        own = rows.where(kind=kind)
        if not len(own):
            continue
        case = kind.replace("_", " ")
        position = 1e3 * _rms(_values(own, NOMINAL, POSITION))
        found.append(Figure("error of the position, rms", case, position, "mm", 1e3 * length, at_most=True))
        if angle is not None:
            rotation = math.degrees(_rms(_values(own, NOMINAL, ROTATION)))
            goal = number(math.degrees(angle))
            found.append(
                Figure("error of the yaw, rms", case, rotation, "degrees", float(goal), at_most=True)
            )
        off = 100.0 * abs(_coverage(own) - LEVEL)
        found.append(Figure("coverage less 90 %", case, off, "%", 5.0, at_most=True))
    return {"Goals": found}


verdict = goals_met_by(figures)
