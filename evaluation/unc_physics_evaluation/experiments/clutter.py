"""Clutter by the node: wall time, rollouts and error of its answers, and what a second thread is worth."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numba
import numpy as np

from unc_physics import Belief, make_propagator, predict

from ..comparison import POSITION_ERROR, WALL_TIME, error_rows, mean_errors, two_truths
from ..goals import Figure, goal_tables, goals_met_by, ratio
from ..jobs import Job, Outcome, Row, Settings
from ..methods import FLOOR, MONTE_CARLO, label
from ..provenance import threads
from ..results import Results
from ..scenarios import dropped_cans, lying_in_bin
from ..scores import rms
from ..tables import number, table
from ..timing import timed
from .latency import missing as missing_of_ros

TITLE = "Clutter by the node"
#: For each scene its maker, the wall time that `auto` is given and the goal for the median [s].
SCENES = {"lying_in_bin": (lying_in_bin, 0.05, 0.1), "dropped_cans": (dropped_cans, 0.02, 0.05)}
SAMPLES, EMITTED = 10, 250  # of Monte Carlo; of `auto`, whose rollouts they are drawn from
SUBSET = 500  # of the samples between which W1 is found
ON_THREADS, THREADS_GOAL = 100, 1.7  # samples of Monte Carlo; how many times faster on two threads
NODE, SECOND_THREAD = "node", "threads"
TRIP, CORE, CPU, USED = "round_trip", "core", "cpu_time", "rollouts"
ERROR, CLAIMED = "error", "claimed"


def jobs(settings: Settings) -> list[Job]:
    """Each scene by a node, then the threads without one, alone on the machine."""
    truth, calls, rounds = (500, 10, 2) if settings.quick else (4000, 100, 10)
    cases = [] if missing_of_ros(settings) else [(NODE, name, calls) for name in SCENES]
    if threads() > 1:
        cases.append((SECOND_THREAD, "lying_in_bin", rounds))
    return [
        Job(
            "clutter",
            settings.parameters(section=section, scene=scene, truth=truth, rounds=count),
            cost=60.0,
            alone=True,
        )
        for section, scene, count in cases
    ]


def missing(settings: Settings) -> list[str]:
    """ROS and threads, as far as they are not there."""
    gaps = [gap.replace("latency", "clutter") for gap in missing_of_ros(settings)]
    return gaps if threads() > 1 else [*gaps, "clutter on two threads: this machine lends one"]


def run(job: Job) -> Outcome:
    """Answers of a node to one scene beside the truth, or times on one thread and on two."""
    case = SCENES[job.parameters["scene"]][0]()
    return Outcome(_threads(job, *case) if job.parameters["section"] == SECOND_THREAD else _node(job, case))


def _node(job, case):
    from ..node_clutter import ask

    limit = SCENES[job.parameters["scene"]][1]
    asked = {
        MONTE_CARLO: make_propagator(MONTE_CARLO, samples=SAMPLES),
        "auto": make_propagator("auto", time=limit, error=0.0, samples=EMITTED),
    }
    answers = ask(case, asked, job.parameters["rounds"])
    numba.set_num_threads(numba.config.NUMBA_NUM_THREADS)
    truth, second = two_truths(*case, job)
    rows = []
    for method, found in answers.items():
        for k, answer in enumerate(found):
            claimed = answer.mean_error if method == "auto" else 1.0 / math.sqrt(answer.rollouts)
            for quantity, unit, value in (
                (TRIP, "s", answer.round_trip),
                (CORE, "s", answer.prediction.wall_time),
                (CPU, "s", answer.cpu_time),
                (USED, "1", answer.rollouts),
                (ERROR, "std", rms(mean_errors(answer.prediction.belief, truth.belief))),
                (CLAIMED, "std", claimed),
            ):
                rows.append(Row(method, quantity, unit, float(value), None, k, answer.prediction.seed))
    rows.append(Row(FLOOR, ERROR, "std", rms(mean_errors(second.belief, truth.belief)), seed=second.seed))
    first: dict[tuple[str, int | None], Belief | np.ndarray] = {
        (method, None): found[0].prediction.belief for method, found in answers.items()
    }
    return rows + error_rows(job, truth, second, first, (), min(SUBSET, len(truth.states)))


def _threads(job, scene, belief, horizon):
    """Wall time of Monte Carlo on one thread and on two."""
    propagator = make_propagator(MONTE_CARLO, samples=ON_THREADS, seed=job.seed(MONTE_CARLO))

    def predicts(count):
        def run(_):
            numba.set_num_threads(count)
            predict(scene, belief, propagator, horizon)

        return run

    functions: dict[tuple[str, int | None, str], Callable[[int], object]] = {
        (MONTE_CARLO, ON_THREADS, _on(count)): predicts(count) for count in (1, 2)
    }
    return timed(functions, job.parameters["rounds"], time.perf_counter)


def report(results: Results) -> str:
    """The goals, then times and errors of each scene."""
    rows = results.rows("clutter").where(section=NODE)
    head = ["", "p50 [ms]", "p95", "core", "CPU", "rollouts", "error of means", "as it says", "W1 over floor"]
    lines = []
    for scene in rows.unique("scene"):
        floor = rows.where(scene=scene, method=FLOOR, quantity=POSITION_ERROR).mean()
        for method in rows.where(scene=scene, quantity=TRIP).unique("method"):
            found = rows.where(scene=scene, method=method)
            trips = found.where(quantity=TRIP).values()
            lines.append(
                [
                    f"{scene.replace('_', ' ')}, {label(method)}",
                    *(number(1e3 * float(np.quantile(trips, share))) for share in (0.5, 0.95)),
                    *(number(1e3 * found.where(quantity=quantity).median()) for quantity in (CORE, CPU)),
                    number(found.where(quantity=USED).median()),
                    *(number(rms(found.where(quantity=quantity).values())) for quantity in (ERROR, CLAIMED)),
                    number(found.where(quantity=POSITION_ERROR).mean() / floor),
                ]
            )
    return (
        "A node in a process of its own is asked for the poses in 1 s of ten boxes and cans of 300 spheres"
        " that lie in a bin, and of five cans that drop onto a floor; positions are uncertain by 3 mm. Round"
        " trips are those at the client, over Fast DDS, each with another seed. Errors of means are over the"
        " truth's standard deviation, root mean squares over bodies, positions and rotations, and answers;"
        " Monte Carlo's number of samples says how large they are. W1 is that of the positions."
        f" `auto` draws {EMITTED} samples, from as few rollouts as it takes.\n\n"
        + (table(head, lines) if lines else "")
        + f"\n{goal_tables(_figures(results))}"
    )


def _figures(results):
    rows, found = results.rows("clutter"), []
    for scene, (_, _, goal) in SCENES.items():
        trips = rows.where(scene=scene, quantity=TRIP)
        for method in trips.unique("method"):
            of = f"{scene.replace('_', ' ')}, {label(method)}"
            p50 = 1e3 * trips.where(method=method).median()
            found.append(Figure("median round trip", of, p50, "ms", 1e3 * goal, at_most=True))
    gained = []
    if on_one := rows.where(quantity=_on(1)):
        gain = ratio(on_one, rows.where(quantity=_on(2)))
        gained.append(
            Figure(
                "two threads over one",
                f"{label(MONTE_CARLO, ON_THREADS)} in the bin",
                gain,
                "x",
                THREADS_GOAL,
            )
        )
    return {"Answers of the node": found, "Threads": gained}


def _on(count):
    return f"{WALL_TIME}_{count}"


verdict = goals_met_by(_figures)
