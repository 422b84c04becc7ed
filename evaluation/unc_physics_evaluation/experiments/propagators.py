"""Time of the propagators, beside their goals: with ever more spheres, bodies and threads."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from itertools import pairwise

import numba
import numpy as np

from unc_physics import Belief, make_propagator, predict
from unc_physics.dynamics.rollout import simulate
from unc_physics.propagators.base import Propagator

from ..comparison import CPU_TIME, TIME_RATIO, rollout_cost, time_rows
from ..goals import Figure, goal_tables, goals_met_by, milliseconds, ratio
from ..jobs import Job, Outcome, Row, Settings
from ..methods import MONTE_CARLO, label, methods
from ..provenance import threads
from ..results import Results, Rows
from ..scenarios import LARGE, MODELS, collision, has_packing, many_collisions, missing_packings
from ..tables import number
from ..timing import timed

TITLE = "Time of the propagators"
SPHERES = (10, 100, 1000, 10_000, LARGE)
BODIES = (2, 8, 32, 64)
CALLS = MORE = 20  # so few steps lead to no contact
NOMINAL = "nominal_rollout"
#: How many times faster than MC-10 with 1000 and 10 000 spheres.
GOALS = {"linearization": 9.0, "surrogate": 5.0, "local_sampling": 3.0, "sigma_points": 0.7}


def jobs(settings: Settings) -> list[Job]:
    """Each section in the scenes that it needs, alone on the machine."""
    rounds = 3 if settings.quick else 15
    spheres = SPHERES[:3] if settings.quick else SPHERES
    cases = [("methods", model, n, rounds) for model in MODELS for n in spheres if has_packing(model, n)]
    if not settings.quick:
        cases += [("large", model, LARGE, rounds) for model in MODELS if has_packing(model, LARGE)]
    cases += [("dispatch", "bunny", 10, 3 * rounds), ("bodies", "bunny", 100, rounds)]
    if threads() > 1:
        cases.append(("threads", "bunny", 1000, rounds))
    return [
        Job(
            "propagators",
            settings.parameters(section=section, model=model, spheres=n, rounds=count),
            cost=5.0 + 150 * count * rollout_cost(n),
            alone=True,
        )
        for section, model, n, count in cases
    ]


def missing(settings: Settings) -> list[str]:
    """Packings that there are not, and threads."""
    gaps = [] if settings.quick else missing_packings()
    return gaps if threads() > 1 else [*gaps, "propagators on two threads: this machine lends one"]


def run(job: Job) -> Outcome:
    """Times of one section."""
    return Outcome(SECTIONS[job.parameters["section"]](job))


def report(results: Results) -> str:
    """A table of each section, with what is met and missed."""
    return goal_tables(_figures(results))


def _everyone(job, samples) -> Mapping[tuple[str, int | None], Propagator]:
    """All propagators by method and samples."""
    made = methods(job)
    rollouts = make_propagator(MONTE_CARLO, samples=samples, seed=job.seed(MONTE_CARLO))
    return {(MONTE_CARLO, samples): rollouts, **made}


def _methods(job) -> list[Row]:
    """Whole predictions, and the nominal rollout.

    Each round has another mean, drawn from the belief: one nominal rollout may have far more or less contact
    than those about it, and would say more of the scene than of the method.
    """
    p = job.parameters
    scene, belief, horizon = collision(p["model"], p["spheres"])
    means = belief.sample(p["rounds"], np.random.default_rng(job.seed("means")))

    def predicts(propagator):
        return lambda k: predict(scene, Belief(means[k], belief.covariance), propagator, horizon)

    def rolls(k):
        simulate(means[k : k + 1].copy(), scene.world, round(horizon / scene.dt))

    functions = {key: predicts(propagator) for key, propagator in _everyone(job, 10).items()}
    return time_rows({**functions, (NOMINAL, None): rolls}, p["rounds"])


def _large(job) -> list[Row]:
    """One rollout with all spheres and with a tenth of them, from the same sampled initial states."""
    p = job.parameters
    sizes = {_size(n): collision(p["model"], n) for n in (LARGE, LARGE // 10)}
    _, belief, _ = sizes[_size(LARGE)]
    states = belief.sample(p["rounds"], np.random.default_rng(job.seed("states")))

    def rolls(scene, horizon) -> Callable[[int], object]:
        return lambda k: simulate(states[k : k + 1].copy(), scene.world, round(horizon / scene.dt))

    functions = {(NOMINAL, None, name): rolls(scene, horizon) for name, (scene, _, horizon) in sizes.items()}
    return timed(functions, p["rounds"])


def _threads(job) -> list[Row]:
    """Wall time on one thread and on two, of what propagates several states."""
    p = job.parameters
    scene, belief, horizon = collision(p["model"], p["spheres"])

    def predicts(propagator, count):
        def run(k):
            numba.set_num_threads(count)
            predict(scene, belief, propagator, horizon)

        return run

    functions = {
        (*key, _on(count)): predicts(propagator, count)
        for key, propagator in _everyone(job, 100).items()
        if propagator.traits.mean_update == "estimated"
        for count in (1, 2)
    }
    return timed(functions, p["rounds"], time.perf_counter)


def _dispatch(job) -> list[Row]:
    """Predictions of one step, and of some more."""
    p = job.parameters
    scene, belief, _ = collision(p["model"], p["spheres"])

    def predicts(propagator, steps):
        def run(k):
            for _ in range(CALLS):
                predict(scene, belief, propagator, steps * scene.dt)

        return run

    functions = {
        (*key, _ahead(steps)): predicts(propagator, steps)
        for key, propagator in _everyone(job, 10).items()
        for steps in (1, 1 + MORE)
    }
    return timed(functions, p["rounds"])


def _bodies(job) -> list[Row]:
    """Scenes of ever more bodies, in pairs that collide, by what knows one body at a time."""
    p = job.parameters
    scenes = {count: many_collisions(count // 2, p["model"], p["spheres"]) for count in BODIES}

    def predicts(propagator, scene, belief, horizon):
        return lambda k: predict(scene, belief, propagator, horizon)

    functions = {
        (*key, _of(count)): predicts(propagator, *case)
        for key, propagator in methods(job).items()
        if not propagator.traits.cross_body
        for count, case in scenes.items()
    }
    return timed(functions, p["rounds"])


SECTIONS = {
    "methods": _methods,
    "large": _large,
    "threads": _threads,
    "dispatch": _dispatch,
    "bodies": _bodies,
}


def _size(spheres):
    return f"{CPU_TIME}_{spheres}_spheres"


def _on(count):
    return f"wall_time_{count}_threads"


def _ahead(steps):
    return f"{CPU_TIME}_{steps}_steps"


def _of(count):
    return f"{CPU_TIME}_{count}_bodies"


def _figures(results) -> dict[str, list[Figure]]:
    rows = results.rows("propagators")
    of = {section: rows.where(section=section) for section in SECTIONS}
    return {
        "MC-10's CPU time over that of each propagator, another mean in each round": [
            figure
            for here in _by_scene(of["methods"])
            for method, samples in here.curves()
            if method != MONTE_CARLO
            for figure in _method_figures(here, method, samples)
        ],
        "CPU time of one rollout with 100 000 spheres over that with 10 000": [
            _figure(here, NOMINAL, _size(LARGE), _size(LARGE // 10), here[0]["model"], 6.0, at_most=True)
            for here in _by_scene(of["large"])
        ],
        "Wall time on one thread over that on two": [
            _figure(
                of["threads"].where(method=method, samples=samples),
                label(method, samples),
                _on(1),
                _on(2),
                "bunny 1000",
                1.7,
            )
            for method, samples in of["threads"].curves()
        ],
        "Python's share of a prediction of two bodies (dispatch, checks, sampling, moments): one step, less"
        " what a step more costs": [
            _dispatch_figure(of["dispatch"].where(method=method, samples=samples), label(method, samples))
            for method, samples in of["dispatch"].curves()
        ],
        "CPU time of a body over that in a scene of two, in pairs that collide": [
            _figure(
                of["bodies"].where(method=method),
                label(method),
                _of(count),
                _of(BODIES[0]),
                f"{count} bodies",
                1.2,
                at_most=True,
                share=BODIES[0] / count,
            )
            for method in of["bodies"].unique("method")
            for _, count in pairwise(BODIES)
        ],
    }


def _by_scene(rows) -> list[Rows]:
    found = (rows.where(model=model, spheres=n) for model in MODELS for n in rows.unique("spheres"))
    return [here for here in found if here]


def _method_figures(rows, method, samples):
    """Times and, of what rests on one nominal rollout, how much of it that is."""
    spheres, found = rows[0]["spheres"], rows.where(method=method, samples=samples)
    times, nominal = found.where(quantity=CPU_TIME), rows.where(method=NOMINAL, quantity=CPU_TIME)
    note = f"{number(1e3 * times.median())} ms"
    if method != NOMINAL:
        note += f", {number(ratio(times, nominal))} nominal rollouts"
    goal = GOALS.get(method) if spheres in (1000, 10_000) else None
    faster = 1.0 / found.where(quantity=TIME_RATIO).median()
    return [
        Figure(
            f"MC-10 / {label(method, samples)}", f"{rows[0]['model']} {spheres}", faster, "x", goal, note=note
        )
    ]


def _dispatch_figure(rows, what):
    one, more = (rows.where(quantity=_ahead(steps)) for steps in (1, 1 + MORE))
    step = float(np.median(more.values() - one.values())) / CALLS / MORE
    share = one.median() / CALLS - step
    note = f"a step more costs {number(1e6 * step)} us"
    return Figure(what, "bunny 10", 1e3 * share, "ms", 0.1, at_most=True, note=note)


def _figure(rows, what, slow, fast, case, goal, at_most=False, share=1.0):
    """How many times longer one time is than another, the first taken by a ``share``."""
    times = [rows.where(quantity=quantity) for quantity in (slow, fast)]
    return Figure(what, case, share * ratio(*times), "x", goal, at_most, milliseconds(*times))


verdict = goals_met_by(_figures)
