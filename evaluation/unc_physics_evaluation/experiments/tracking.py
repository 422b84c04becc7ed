"""Tracking of recorded tosses through contact, and of a body that a hand takes."""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np
from scipy.spatial.transform import Rotation

from unc_physics.spatial.layout import POSITION
from unc_physics.tracking.measurements import PoseMeasurement

from ..jobs import Job, Outcome, Row, Settings
from ..particle_filter import ParticleFollower
from ..recorded_tosses import recorded_tosses
from ..results import Results, Rows
from ..scenarios import resting
from ..tables import number, table
from ..tracked_tosses import (
    NOISE,
    TABLE,
    FilterFollower,
    Frames,
    Score,
    TrackerFollower,
    frames_of,
    scores,
    tracked_scene,
)

TITLE = "Tracking"
TRACKER, FILTER, PREDICTED = "tracker", "constant_velocity", "constant_velocity_predict"
#: Numbers of rollouts of particle filters, and the rate [Hz] at which they follow.
PARTICLES, PARTICLE_RATE = {"particle_filter_200": 200, "particle_filter_1000": 1000}, 30.0
FULL, QUICK, FOR_PARTICLES = 80, 8, 40  # tosses
_A_JOB = 20
#: Conditions and rates [Hz].
CONDITIONS = (("plain", 148.0), ("plain", 30.0), ("plain", 10.0), ("gap", 30.0), ("outliers", 30.0))
HAND = "hand"
FLIGHT, CONTACT = "in flight", "after contact"
_LIFT, _LIFTED_AT = 0.4, 1.5  # m/s, s
_NEAR = 8e-3  # m
_RUNS = 20
_COST = {148.0: 2.0, 30.0: 1.0, 10.0: 0.5}


def jobs(settings: Settings) -> list[Job]:
    """Return jobs for the tosses by method, condition and rate, and for the hand."""
    count, found = QUICK if settings.quick else FULL, []

    def add(cost, **parameters):
        found.append(Job("tracking", settings.parameters(**parameters), cost=cost))

    for first in range(0, count, _A_JOB):
        part = {"first": first, "tosses": min(_A_JOB, count - first)}
        for condition, rate in CONDITIONS:
            add(_COST[rate] * part["tosses"], by=TRACKER, condition=condition, rate=rate, **part)
        for method in (FILTER, PREDICTED):
            add(0.5 * part["tosses"], by=method, condition="plain", rate=30.0, **part)
        if first < FOR_PARTICLES and _has_mujoco():
            for method, particles in PARTICLES.items():
                cost = 0.006 * particles * part["tosses"]
                add(cost, by=method, condition="plain", rate=PARTICLE_RATE, **part)
    runs = 4 if settings.quick else _RUNS
    add(runs, by=TRACKER, condition=HAND, rate=30.0, first=0, tosses=runs)
    return found


def missing(settings: Settings) -> list[str]:
    """Return the particle filters if their engine is missing."""
    return [] if _has_mujoco() else ["tracking by particle filters in MuJoCo: pip install mujoco"]


def _has_mujoco():
    return find_spec("mujoco") is not None


def run(job: Job) -> Outcome:
    """Follow the tosses of one part."""
    p, rows = job.parameters, []
    # the same tosses and errors of poses for all methods
    order = np.random.default_rng(int(p["base_seed"])).permutation(len(recorded_tosses().states))
    numbers = order[int(p["first"]) : int(p["first"]) + int(p["tosses"])]
    for k in numbers.tolist():
        if p["condition"] == HAND:
            rows += _hand(k)
        else:
            rows += _toss(k, str(p["by"]), str(p["condition"]), float(p["rate"]), int(p["base_seed"]))
    return Outcome(rows)


def _toss(k, method, condition, rate, seed):
    """Return rows of one toss."""
    scene = tracked_scene(recorded_tosses())
    frames = frames_of(recorded_tosses(), k, rate, condition, seed)
    if method == TRACKER:
        follower = TrackerFollower(scene, frames, seed)
    elif method in PARTICLES:
        follower = ParticleFollower(scene, frames, seed, PARTICLES[method])
    else:
        follower = FilterFollower(scene, frames, seed, physics=method == PREDICTED)
    # the first pose says nothing of velocities; the next one begins
    found = list(scores(follower, frames, ahead_every=max(1, round(rate / 10.0))))[1:]
    rows = []
    for phase, chosen in ((FLIGHT, False), (CONTACT, True)):
        some = [one for one in found if one.in_contact is chosen]
        rows += _means(some, phase, method, k, seed)
    rows.append(
        Row(method, "false alarm", "1", float(any(one.carried for one in found)), replicate=k, seed=seed)
    )
    return rows


_UNITS = {"position": "m", "rotation": "rad", "velocity": "m/s", "ahead_position": "m", "seconds": "s"}


def _means(some, phase, method, k, seed):
    """Return rows of the means over frames that have a value."""
    rows = []
    for place, name in enumerate(Score._fields):
        if name in ("in_contact", "carried"):
            continue
        values = np.array([one[place] for one in some], float)
        values = values[np.isfinite(values)]
        if len(values):
            rows.append(
                Row(
                    method,
                    f"{name} {phase}",
                    _UNITS.get(name, "1"),
                    float(values.mean()),
                    len(values),
                    k,
                    seed,
                )
            )
    return rows


def _hand(seed):
    """Return rows of a cube that rests on the table until a hand lifts it: time until its error is small."""
    scene, times = tracked_scene(recorded_tosses()), np.arange(0.0, 3.0, 1.0 / 30.0)
    model = scene.bodies[0].model
    truth = resting(np.zeros((len(times), 3)))
    truth[:, 2] = TABLE.offset + float((model.centers[:, 2] + model.radii).max())
    truth[:, 2] += _LIFT * np.maximum(times - _LIFTED_AT, 0.0)
    truth[times > _LIFTED_AT, 5] = _LIFT
    errors = NOISE * np.random.default_rng(seed).standard_normal((len(times), 6))
    turned = Rotation.from_quat(np.column_stack([0.5 * errors[:, 3:], np.ones(len(times))])).as_quat()
    measured = np.concatenate([truth[:, POSITION] + errors[:, :3], turned], axis=1)
    none, every = np.zeros(len(times), bool), np.ones(len(times), bool)
    follower = TrackerFollower(scene, Frames(times, truth, measured, none, every, every), seed)
    late = _LIFTED_AT
    for time, pose, x in zip(times.tolist(), measured, truth, strict=True):
        follower.correct(time, PoseMeasurement(pose, NOISE))
        error = np.linalg.norm(follower.belief(time).mean[0, POSITION] - x[POSITION])
        if time > _LIFTED_AT and error > _NEAR:
            late = time + 1.0 / 30.0
    return [Row(TRACKER, f"time to follow {HAND}", "s", late - _LIFTED_AT, replicate=seed, seed=seed)]


_COLUMNS = (
    ("NEES position", "nees_position", 1.0),
    ("NEES rotation", "nees_rotation", 1.0),
    ("mm", "position", 1e3),
    ("degrees", "rotation", 180.0 / np.pi),
    ("m/s", "velocity", 1.0),
    ("next pose: log score", "next_log", 1.0),
    ("in 90 % region, %", "next_inside", 100.0),
    ("0.2 s ahead: mm", "ahead_position", 1e3),
    ("log score", "ahead_log", 1.0),
    ("in 90 % region of position, %", "ahead_inside_position", 100.0),
    ("of rotation, %", "ahead_inside_rotation", 100.0),
)
_TIME = "CPU time of a correction, ms", "seconds", 1e3


def report(results: Results) -> str:
    """Return tables of consistency, accuracy and predictions."""
    rows, lines = results.rows("tracking"), []
    for method in (FILTER, PREDICTED, TRACKER):
        for condition, rate in CONDITIONS:
            some = rows.where(method=method, condition=condition, rate=rate)
            for phase in (FLIGHT, CONTACT):
                cells = _cells(some, phase, _COLUMNS)
                if some and np.isfinite(cells[0]):
                    lines.append([f"{method}, {rate:.0f} Hz, {condition}, {phase}", *map(number, cells)])
    head = ["follower, rate, condition, phase", *(title for title, *_ in _COLUMNS)]
    parts = [results.table("tracking", head, lines)]
    parts.append("NEES: the mean squared error over its variance; 1 is right.\n")
    parts.append(_beside_particles(results))
    parts.append(table(["", "value"], [[words, value] for words, value in _single(rows)]))
    return "\n".join(parts)


def _beside_particles(results):
    """Return the comparison of all methods on the tosses of the particle filters."""
    rows, lines = results.rows("tracking").where(condition="plain", rate=PARTICLE_RATE), []
    tosses = {row["replicate"] for row in rows if row["method"] in PARTICLES}
    for method in (FILTER, PREDICTED, *PARTICLES, TRACKER):
        some = Rows([row for row in rows.where(method=method) if row["replicate"] in tosses])
        for phase in (FLIGHT, CONTACT):
            cells = _cells(some, phase, (*_COLUMNS, _TIME))
            if some and np.isfinite(cells[0]):
                lines.append([f"{method}, {phase}", *map(number, cells)])
    head = ["follower, phase", *(title for title, *_ in (*_COLUMNS, _TIME))]
    return results.table("tracking_particles", head, lines)


def _cells(rows, phase, columns):
    return [_mean(rows.where(quantity=f"{name} {phase}")) * scale for _, name, scale in columns]


def _mean(rows: Rows) -> float:
    """Return the mean over frames of rows with means of their frames."""
    if not rows:
        return float("nan")
    weights = np.array([row["samples"] or 1 for row in rows], float)
    return float(np.average(rows.values(), weights=weights))


def _single(rows):
    """Return single values in words."""
    plain = rows.where(method=TRACKER, condition="plain")
    yield "tosses with a false alarm of a hand, %", number(100.0 * plain.where(quantity="false alarm").mean())
    taken = rows.where(quantity=f"time to follow {HAND}").values()
    if len(taken):
        yield (
            "a hand takes it: within 8 mm again after, s (mean, most)",
            f"{taken.mean():.2f}, {taken.max():.2f}",
        )


def verdict(results: Results) -> str:
    """Return whether the tracker's covariances match its errors."""
    rows = results.rows("tracking").where(method=TRACKER)
    found = []
    for condition, rate in CONDITIONS:
        some = rows.where(condition=condition, rate=rate)
        for phase in (FLIGHT, CONTACT):
            found += [
                _mean(some.where(quantity=f"{name} {phase}")) for name in ("nees_position", "nees_rotation")
            ]
    found = [value for value in found if np.isfinite(value)]
    right = sum(0.8 <= value <= 1.2 for value in found)
    return f"{right} of {len(found)} NEES are within 20 % of 1 ({min(found):.2f} to {max(found):.2f})"
