"""Errors over CPU time of our methods and of a user's loop around ``mujoco.rollout``, on everyday scenes.

The loop is Monte Carlo: it draws states of the belief, simulates them, and takes the moments of positions and
the share of an event. Each engine is compared with its own truth, so that only the statistics differ. Errors
are root mean squares over replicates: of mean positions, over their spread; of the spread, relative; and of
the probability of one event.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from typing import NamedTuple

import numpy as np

from unc_physics import Belief, Event, FellOff, InRegion, Scene, Upright, predict
from unc_physics.prediction.events import RolloutOutcomes
from unc_physics.prediction.regions import BoxRegion
from unc_physics.scene.actions import PosePath
from unc_physics.scene.body import RigidBody
from unc_physics.scene.environment import Box, Plane
from unc_physics.shapes.library import load_model
from unc_physics.spatial.layout import POSITION, QUATERNION, VELOCITY

from ..engines import MuJoCoRollouts
from ..jobs import Job, Outcome, Row, Settings
from ..methods import MONTE_CARLO, OURS, label, look, method_of
from ..plots import log_axis, new_figure, save
from ..results import Results, Rows
from ..rollouts import missing_engines
from ..scenarios import (
    boxes_and_cans,
    can_off_shelf,
    carton_off_shelf,
    five_into_bin,
    resting,
    salt_box_into_bin,
    spread,
)
from ..tables import number

TITLE = "Head to head"
LOOP = "mujoco"
#: Methods with an event asked for, and `PLAIN` without.
SIZES = (30, 100, 300)
METHODS = (
    *(f"{MONTE_CARLO} samples={count}" for count in SIZES),
    *(f"cloud runs={count}" for count in (12, 16, 32, 64, 128)),
    "sigma_points",
    "auto",
)
PLAIN = "auto without event"
TIME, ROLLOUTS, TRUTH = "CPU time", "rollouts", "truth"
MEAN, SPREAD, PROBABILITY = "mean", "spread", "probability"
ERRORS = {MEAN: "mean, over the spread", SPREAD: "spread, relative", PROBABILITY: "probability"}
#: The errors at which times are compared, and how many of the loop's rollouts have that of the mean.
MEAN_GOAL, PROBABILITY_GOAL, LOOP_ROLLOUTS = 0.1, 0.05, 100
RATE = 240  # steps in a second
_AT_ONCE = 100  # rollouts of the loop in one call, whose memory grows with their steps


class Case(NamedTuple):
    """A scene with the belief, the horizon [s] and an event, and about the cost of a rollout [s]."""

    scene: Scene
    belief: Belief
    horizon: float
    event: Event
    cost: float


class Answer(NamedTuple):
    """Means (B, 3) and spreads (B,) of the positions of moving bodies [m], and a probability."""

    mean: np.ndarray
    spread: np.ndarray
    probability: float


def push() -> tuple[Scene, Belief, float]:
    """Return a carton on a table that a finger pushes beside its middle with 8 cm/s."""
    speed, start = 0.08, np.array([-0.06, 0.01, 0.02])
    horizon, upright = 1.5, (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))
    path = PosePath(
        times=(0.0, 2.0),
        positions=[start, start + [2.0 * speed, 0.0, 0.0]],
        linear_velocities=[[speed, 0.0, 0.0]] * 2,
    )
    carton, finger = load_model("salt_box"), load_model("salt_box").scaled(0.15)
    bodies = [
        RigidBody("salt_box", carton, 0.52),
        # its mass counts in the other engine only, where a heavy body keeps its speed
        RigidBody("finger", replace(finger, name="salt_box"), 1000.0, trajectory=path),
    ]
    mean = resting([[0.0, 0.0, 0.0235], start])
    mean[0, QUATERNION], mean[1, VELOCITY] = upright, (speed, 0.0, 0.0)
    covariance = spread(1, position=(0.004, 0.004, 0.0), rotation=(0.0, 0.1, 0.0))
    scene = Scene.everyday(bodies, exact=True, environment=[Plane(name="table")], friction=0.3)
    return scene, Belief(mean, covariance, moving=scene.moving), horizon


def demo() -> tuple[Scene, Belief, float]:
    """Return a can that is thrown at a carton on a table, as in ``examples/scenes/table.yaml``."""
    bodies = [RigidBody(name, load_model(name)) for name in ("salt_box", "can")]
    mean = resting([[0.12, 0.0, 0.062], [-0.25, 0.0, 0.2]])
    mean[1, QUATERNION], mean[1, VELOCITY] = (0.0, 0.2, 0.0, math.sqrt(0.96)), (1.6, 0.0, 0.0)
    covariance = spread(2, position=0.01, rotation=0.05, velocity=0.03)
    covariance[0] = spread(1, position=(0.005, 0.005, 0.0), rotation=(0.0, 0.0, 0.03))[0]
    table = Box((0.9, 0.6, 0.04), (0.0, 0.0, -0.02), name="table")
    scene = Scene.everyday(bodies, exact=True, environment=[table], restitution=0.2)
    return scene, Belief(mean, covariance), 1.2


#: Scenes with their events, and about the cost of a rollout [s].
CASES: dict[str, tuple[Callable[[], tuple[Scene, Belief, float]], Event, float]] = {
    "carton off shelf": (carton_off_shelf, FellOff("salt_box"), 0.002),
    "salt box into bin": (salt_box_into_bin, Upright("salt_box"), 0.002),
    "can off shelf": (can_off_shelf, FellOff("can"), 0.002),
    "push": (push, InRegion("salt_box", BoxRegion("left", (1.0, 1.0, 1.0), (0.0, 0.494, 0.0))), 0.002),
    "table of the demo": (demo, Upright("can"), 0.003),
    "five into bin": (five_into_bin, Upright("can1"), 0.015),
    "ten into bin": (partial(boxes_and_cans, 10), Upright("salt_box"), 0.03),
}
_QUICK = ("salt box into bin", "push")


def case(name: str) -> Case:
    """Return a scene by its name."""
    make, event, cost = CASES[name]
    scene, belief, horizon = make()
    return Case(replace(scene, dt=1.0 / RATE), belief, horizon, event, cost)


def jobs(settings: Settings) -> list[Job]:
    """Return a job for each scene."""
    found = []
    for name in _QUICK if settings.quick else CASES:
        cost = CASES[name][2]
        truth, replicates = (300, 2) if settings.quick else (1500, 4) if cost > 0.01 else (4000, 6)
        parameters = settings.parameters(scene=name, truth_samples=truth, replicates=replicates)
        found.append(Job("head_to_head", parameters, 2.0 * cost * (truth + 1500 * replicates)))
    return found


def missing(settings: Settings) -> list[str]:
    """Return MuJoCo if it is not installed."""
    return [line for line in missing_engines("head_to_head") if "MuJoCo" in line]


def run(job: Job) -> Outcome:
    """Return times and errors of all methods in one scene, replicate by replicate."""
    p, own = job.parameters, case(str(job.parameters["scene"]))
    count, replicates, rows = int(p["truth_samples"]), int(p["replicates"]), []
    truth = _predicted(own, f"{MONTE_CARLO} samples={count} seed={job.seed('truth')}")[0]
    rows.append(Row(OURS, TRUTH, "1", truth.probability, count))
    for text in (*METHODS, PLAIN):
        method = text.removesuffix(" without event")
        seeded = method != "sigma_points"
        short = own._replace(horizon=2.0 / RATE)
        _predicted(short, method, text != PLAIN)  # compiles kernels, or loads them
        for k in range(replicates if seeded else 1):
            seed = f" seed={job.seed(f'replicate {k}')}" if seeded else ""
            found, seconds, rollouts = _predicted(own, method + seed, text != PLAIN)
            rows += _rows(text, found, truth, seconds, rollouts, k)
    if find_spec(LOOP):
        simulator = MuJoCoRollouts(own.scene, "primitive")
        truth = _looped(own, simulator, count, job.seed("truth"))[0]
        rows.append(Row(LOOP, TRUTH, "1", truth.probability, count))
        for size in SIZES:
            for k in range(replicates):
                found, seconds = _looped(own, simulator, size, job.seed(f"replicate {k}"))
                rows += _rows(LOOP, found, truth, seconds, size, k)
    return Outcome(rows)


def _predicted(own: Case, method: str, asks: bool = True) -> tuple[Answer, float, int]:
    """Return the answer of one of our methods, its CPU time [s] and its rollouts."""
    propagator = method_of(method)
    events = [own.event] if asks else []
    started = time.process_time()
    prediction = predict(own.scene, own.belief, propagator, own.horizon, events=events)
    probability = prediction.probability(own.event) if asks else None
    seconds = time.process_time() - started
    belief, moving = prediction.belief, prediction.belief.moving
    spreads = np.sqrt(np.trace(belief.blocks[:, :3, :3], axis1=1, axis2=2))
    answer = Answer(
        belief.mean[moving, POSITION], spreads, math.nan if probability is None else probability.estimate
    )
    last = prediction.at()
    return answer, seconds, 0 if last.rollout_states is None else len(last.rollout_states)


def _looped(own: Case, simulator: MuJoCoRollouts, count: int, seed: int) -> tuple[Answer, float]:
    """Return the answer of the loop with ``count`` rollouts, and its CPU time [s]."""
    steps = round(own.horizon * RATE)
    started = time.process_time()
    starts = own.belief.sample(count, np.random.default_rng(seed))
    parts = [simulator.run_all(starts[k : k + _AT_ONCE], steps) for k in range(0, count, _AT_ONCE)]
    states = np.concatenate(parts)
    places = states[:, own.belief.moving, POSITION]
    spreads = np.sqrt(places.var(axis=0).sum(axis=1))
    happened = own.event.happened(RolloutOutcomes(own.scene, own.belief.mean, states))
    answer = Answer(places.mean(axis=0), spreads, float(happened.mean()))
    return answer, time.process_time() - started


def _rows(method, found, truth, seconds, rollouts, replicate):
    """Return the rows of one answer."""
    of_mean = np.sqrt(np.mean(((found.mean - truth.mean) ** 2).sum(axis=1) / truth.spread**2))
    of_spread = np.sqrt(np.mean((found.spread / truth.spread - 1.0) ** 2))
    values = seconds, float(of_mean), float(of_spread), abs(found.probability - truth.probability)
    units = {TIME: "s"} | dict.fromkeys(ERRORS, "1")
    return [
        Row(method, quantity, unit, value, rollouts, replicate)
        for (quantity, unit), value in zip(units.items(), values, strict=True)
    ]


def curves(rows: Rows) -> dict[str, dict[str, np.ndarray]]:
    """Return median times [s], rollouts and root mean squared errors by method, from the rows of one scene.

    Each is an array over the sizes of a method. `auto` chooses its own size, so that it has one.
    """
    found: dict[str, dict[str, list[float]]] = {}
    timed = [row for row in rows if row["quantity"] == TIME]
    chosen = dict.fromkeys(
        (row["method"], row["samples"] if row["method"] == LOOP else None) for row in timed
    )
    for method, size in chosen:
        own = rows.where(method=method) if size is None else rows.where(method=method, samples=size)
        name = method if method == PLAIN else method.partition(" ")[0]
        curve = found.setdefault(name, {quantity: [] for quantity in (TIME, ROLLOUTS, *ERRORS)})
        curve[TIME].append(own.where(quantity=TIME).median())
        curve[ROLLOUTS].append(float(np.median([row["samples"] for row in own.where(quantity=TIME)])))
        for quantity in ERRORS:
            values = np.array([row["value"] for row in own.where(quantity=quantity)], float)
            curve[quantity].append(float(np.sqrt(np.mean(values**2))))
    return {name: {key: np.array(values) for key, values in one.items()} for name, one in found.items()}


def time_to(curve: dict[str, np.ndarray], quantity: str, goal: float) -> float:
    """Return the time [s] at which an error reaches ``goal``; infinite without one.

    Between the measured sizes, which double, logarithms are interpolated.
    """
    times, errors = curve[TIME], curve[quantity]
    reached = np.flatnonzero(errors <= goal)
    if not len(reached):
        return math.inf
    k = reached[0]
    if k == 0 or not errors[k] > 0.0:
        return float(times[k])
    share = math.log(errors[k - 1] / goal) / math.log(errors[k - 1] / errors[k])
    return float(times[k - 1] * (times[k] / times[k - 1]) ** share)


def ratios(rows: Rows) -> tuple[str, str, str]:
    """Return our shortest times over the loop's, for mean and probability, and what an event costs.

    The loop's time is that of its rollouts for which the standard error is the goal.
    """
    found = curves(rows)
    auto = found["auto"][TIME][0] / found[PLAIN][TIME][0]
    if LOOP not in found:
        return "", "", number(auto)
    a_rollout = float(np.median(found[LOOP][TIME] / np.array(SIZES)))
    p = rows.where(method=LOOP, quantity=TRUTH)[0]["value"]
    shown = []
    for quantity, goal, count in (
        (MEAN, MEAN_GOAL, LOOP_ROLLOUTS),
        (PROBABILITY, PROBABILITY_GOAL, p * (1.0 - p) / PROBABILITY_GOAL**2),
    ):
        times = {name: time_to(one, quantity, goal) for name, one in found.items() if name != LOOP}
        best = min(times, key=lambda name: times[name])
        missed = math.isinf(times[best]) or count == 0.0
        shown.append("" if missed else f"{number(times[best] / (a_rollout * count))} ({label(best)})")
    return shown[0], shown[1], number(auto)


def report(results: Results) -> str:
    """Return errors and times, ratios, and small multiples of all scenes."""
    rows, lines, compared = results.rows("head_to_head"), [], []
    scenes = [name for name in CASES if rows.where(scene=name)]
    for scene in scenes:
        own = rows.where(scene=scene)
        for name, curve in curves(own).items():
            for seconds, rollouts, *errors in zip(*curve.values(), strict=True):
                cells = ("" if math.isnan(error) else number(error) for error in errors)
                size = f"{rollouts:.0f}" if rollouts else ""
                lines.append([scene, _label(name), size, number(1e3 * seconds), *cells])
        truths = (own.where(method=method, quantity=TRUTH) for method in (OURS, LOOP))
        shares = (f"{found[0]['value']:.3f}" if found else "" for found in truths)
        compared.append([scene, str(CASES[scene][1]), *shares, *ratios(own)])
    path = results.figure("head_to_head")
    _draw(path, {scene: curves(rows.where(scene=scene)) for scene in scenes})
    columns = [
        "scene",
        "method",
        "rollouts",
        "CPU time [ms]",
        *(f"error of {name}" for name in ERRORS.values()),
    ]
    errors = results.table("head_to_head", columns, lines)
    head = [
        "scene",
        "event",
        "probability",
        "in MuJoCo",
        f"time for the mean to {MEAN_GOAL:g} of the spread, over MuJoCo",
        f"time for the probability to ±{PROBABILITY_GOAL:g}, over MuJoCo",
        "auto with event over auto without",
    ]
    picture = f"![Errors over CPU time](figures/{path.name})"
    return "\n".join([results.table("head_to_head_ratios", head, compared), picture, "", errors])


def _label(name):
    return f"{label(LOOP)} loop" if name == LOOP else label(name) if name != PLAIN else PLAIN


def _draw(path, found):
    """Draw a column of panels for each scene, and a line for each error."""
    figure = new_figure(2.6 * len(found) + 1.0, 7.0)
    panels = figure.subplots(len(ERRORS), len(found), squeeze=False, sharex="col")
    for column, (scene, own) in zip(panels.T, found.items(), strict=True):
        column[0].set_title(scene, fontsize=9)
        for ax, (quantity, text) in zip(column, ERRORS.items(), strict=True):
            for name, curve in own.items():
                if name != PLAIN:
                    style = look(name)
                    ax.plot(
                        1e3 * curve[TIME],
                        np.maximum(curve[quantity], 1e-3),
                        color=style.color,
                        marker=style.marker,
                        markersize=5,
                        linewidth=1.0,
                        label=_label(name),
                    )
            log_axis(ax, "x")
            log_axis(ax, "y")
            if column[0] is panels[0, 0]:
                ax.set_ylabel(f"error of {text}", fontsize=9)
        column[-1].set_xlabel("CPU time [ms]", fontsize=9)
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), fontsize=9)
    save(figure, path)
