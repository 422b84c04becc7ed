"""The anytime answer: how many rollouts it takes, how sure it says it is, and whether it keeps its time."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from unc_physics import Belief, BodyBelief, RigidBody, Scene, load_model, load_scene, make_propagator, predict
from unc_physics.propagators.base import rollout_count

from ..comparison import mean_errors
from ..jobs import Job, Outcome, Row, Settings
from ..methods import MONTE_CARLO
from ..results import Results
from ..tables import number, table

TITLE = "The anytime answer"
SCENES = ("demo", "two_bunnies", "can_off_shelf", "salt_box_on_table", "drop_into_bin")
EXAMPLES = Path("examples/scenes")
SEEDS = 6  # of the answers that are judged
BUDGETS = (12, 16, 32, 64, 128, 256, 512, 1000)  # rollouts at which auto is stopped
SLOW, FEWER = 3e-3, 256  # CPU time of a rollout [s], above which there are no more than so many
LIMITS = (0.1, 0.3, 1.0)  # s
ROUNDS = 5
TIMES = 50  # of a trajectory
USED, CPU, ERROR, CLAIMED, SHARE, ROLLOUT = (
    "rollouts",
    "cpu_time",
    "error",
    "claimed",
    "time_share",
    "rollout",
)
TRAJECTORY, AT_END = "auto_trajectory", "auto_at_end"


def jobs(settings: Settings) -> list[Job]:
    """One for each scene, alone on the machine."""
    truth, most = (2000, 64) if settings.quick else (4000, BUDGETS[-1])
    return [
        Job("anytime", settings.parameters(scene=name, truth=truth, most=most), cost=60.0, alone=True)
        for name in SCENES
    ]


def run(job: Job) -> Outcome:
    """Rollouts, CPU times and errors of one scene, and how limits of time are kept."""
    case = (
        demo()
        if job.parameters["scene"] == "demo"
        else load_scene(EXAMPLES / f"{job.parameters['scene']}.yaml")
    )
    truth = _answer(case, MONTE_CARLO, samples=job.parameters["truth"], seed=job.seed("truth"))[0].belief
    _, cpu = _answer(case, MONTE_CARLO, samples=32)
    most = min(int(job.parameters["most"]), FEWER if cpu > 32 * SLOW else BUDGETS[-1])
    rows = [*_judged(case, truth, None)]
    for runs in BUDGETS:
        if runs <= most:
            rows += _judged(case, truth, runs)
    return Outcome([*rows, *_trajectories(case), *_kept(case)])


def demo():
    """What `make demo` asks the node, without it: two bunnies, a second before they meet."""
    model, half = load_model("bunny").prefix(1000).scaled(6.0), math.sqrt(0.5)
    bodies = [RigidBody(name, model, 1.0) for name in ("left", "right")]
    scene = Scene(bodies, dt=0.01, stiffness=1e4, damping=0.3)
    left = BodyBelief(
        position=(-1.2, 0.0, 0.0),
        position_std=0.03,
        orientation=(0.0, half, half, 0.0),
        linear_velocity=(0.6, 0.0, 0.35),
    )
    right = BodyBelief(
        position=(1.2, 0.0, 0.1),
        position_std=0.03,
        orientation=(half, 0.0, 0.0, half),
        linear_velocity=(-0.6, 0.0, 0.35),
    )
    return scene, Belief.of(scene, {"left": left, "right": right}), 5.0


def report(results: Results) -> str:
    """Tables: what it takes by itself, errors at equal time, and limits of time."""
    rows = results.rows("anytime")
    head = ["scene", "rollouts", "time [ms]", "over Monte Carlo's", "over cloud's", "error", "as it says"]
    head += ["Monte Carlo's in that time"]
    lines = []
    for name in rows.unique("scene"):
        for runs in (None, *sorted(rows.where(scene=name, method="cloud").unique("samples"))):
            found = rows.where(scene=name, samples=runs)
            auto, cloud, other = (found.where(method=method) for method in ("auto", "cloud", MONTE_CARLO))
            cpu = auto.where(quantity=CPU).median()
            over = [cpu / method.where(quantity=CPU).median() for method in (other, cloud)]
            judged = auto.where(quantity=ERROR), auto.where(quantity=CLAIMED), other.where(quantity=ERROR)
            used = f"by itself: {auto.where(quantity=USED).median():.0f}" if runs is None else str(runs)
            lines.append([name, used, *map(number, (1e3 * cpu, *over, *map(_rms, judged)))])
    shares = [
        [
            name,
            *(
                f"{found.median():.2f} ({found.values().max():.2f})"
                for limit in LIMITS
                if (found := rows.where(scene=name, quantity=SHARE, samples=round(1e3 * limit)))
            ),
            number(1e3 * rows.where(scene=name, quantity=ROLLOUT).median()),
        ]
        for name in rows.unique("scene")
    ]
    paths = [
        [
            name,
            *(
                number(1e3 * rows.where(scene=name, method=method, quantity=CPU).median())
                for method in (TRAJECTORY, AT_END)
            ),
        ]
        for name in rows.unique("scene")
    ]
    return "\n".join(
        [
            table(head, lines),
            f"### CPU time of an answer at {TIMES} times, and at one [ms]\n",
            table(["scene", f"{TIMES} times", "one"], paths),
            "### Wall time over the limit, median (most), and of a rollout [ms]\n",
            table(["scene", *(f"{limit:g} s" for limit in LIMITS), "rollout"], shares),
        ]
    )


def _rms(rows):
    return float(np.sqrt(np.mean(np.square(rows.values())))) if rows else math.nan


def _answer(case, name, times=(), clock=time.process_time, **options):
    """A prediction, and the time that it took [s]."""
    scene, belief, horizon = case
    began = clock()
    prediction = predict(scene, belief, make_propagator(name, **options), horizon, times=list(times))
    return prediction, clock() - began


def _judged(case, truth, runs) -> Iterator[Row]:
    """Errors and CPU times of auto, stopped at so many rollouts or by itself, of cloud with as many, and of
    Monte Carlo with as many and in as much time as auto.
    """
    options = {} if runs is None else {"runs": runs, "error": 0.0}
    for seed in range(SEEDS):
        found, cpu = _answer(case, "auto", seed=seed, **options)
        used = rollout_count(found.carry)
        status = found.propagator.measures(found.carry, found.scene)
        _, of_cloud = _answer(case, "cloud", seed=seed, runs=used)
        _, as_many = _answer(case, MONTE_CARLO, samples=used, seed=seed)
        other, _ = _answer(case, MONTE_CARLO, samples=max(2, round(used * cpu / as_many)), seed=seed)
        for method, quantity, unit, value in (
            ("auto", USED, "1", used),
            ("auto", CPU, "s", cpu),
            ("cloud", CPU, "s", of_cloud),
            (MONTE_CARLO, CPU, "s", as_many),
            ("auto", ERROR, "std", float(mean_errors(found.belief, truth).max())),
            ("auto", CLAIMED, "std", float(status["mean_error"].max())),
            (MONTE_CARLO, ERROR, "std", float(mean_errors(other.belief, truth).max())),
        ):
            yield Row(method, quantity, unit, value, runs, seed, seed)


def _trajectories(case) -> Iterator[Row]:
    """CPU times of answers at many times, and at the end alone."""
    times = case[2] * np.arange(1, TIMES) / TIMES
    for k in range(ROUNDS):
        yield Row(TRAJECTORY, CPU, "s", _answer(case, "auto", times, seed=k)[1], None, k, k)
        yield Row(AT_END, CPU, "s", _answer(case, "auto", seed=k)[1], None, k, k)


def _kept(case) -> Iterator[Row]:
    """Wall time over its limit, and what a rollout takes."""
    for limit in LIMITS:
        for k in range(ROUNDS):
            found, wall = _answer(case, "auto", clock=time.perf_counter, time=limit, error=0.0, seed=k)
            used = rollout_count(found.carry)
            yield Row("auto", SHARE, "1", wall / limit, round(1e3 * limit), k, k)
            yield Row("auto", ROLLOUT, "s", wall / used, round(1e3 * limit), k, k)
