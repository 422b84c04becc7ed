"""Heaps of cubes that fall into a bin: growth of CPU time with their number, and convergence of contacts."""

from __future__ import annotations

import time
from dataclasses import replace
from importlib.util import find_spec

import numpy as np

from unc_physics.compiler.threads import single_thread
from unc_physics.dynamics import contact_history
from unc_physics.dynamics.rollout import rollout
from unc_physics.prediction.diagnostics import RULES
from unc_physics.prediction.overlap_depths import overlaps
from unc_physics.spatial.layout import POSITION

from ..engines import PEERS
from ..goals import Figure, goal_tables, goals_met_by
from ..jobs import Job, Outcome, Row, Settings
from ..methods import OURS, label
from ..results import Results
from ..scenarios import cubes_into_bin
from ..tables import number, table

TITLE = "Heaps"
COUNTS, SPHERES = (100, 200, 300), 500
LARGE_COUNT, LARGE_SPHERES = 100, 2000
ENGINE = "pybullet"
TIME, UNCONVERGED, RESIDUAL = "cpu_time_per_second", "unconverged_bodies", "largest_residual"
CREEP, DEPTH = "creep", "depth"
GROWTH_GOAL = 5.6  # CPU time with the most cubes over that with the fewest
_PARTS = 8  # of a rollout, of which the last shows how far bodies creep
_SLEEP = {False: "", True: " with sleep"}
_COSTS = {100: 4.0, 200: 12.0, 300: 25.0}  # of a round of all methods [s]


def jobs(settings: Settings) -> list[Job]:
    """One for each number of cubes and of spheres."""
    cases = [(count, SPHERES) for count in (COUNTS[:1] if settings.quick else COUNTS)]
    if not settings.quick:
        cases.append((LARGE_COUNT, LARGE_SPHERES))
    rounds = 1 if settings.quick else 3
    return [
        Job(
            "heaps",
            settings.parameters(bodies=bodies, spheres=spheres, rounds=rounds),
            cost=rounds * _COSTS[bodies] * spheres / SPHERES,
            alone=True,
        )
        for bodies, spheres in cases
    ]


def missing(settings: Settings) -> list[str]:
    """PyBullet, where it is not installed."""
    if find_spec(ENGINE) is None:
        return [f"heaps in {label(ENGINE)}: not installed; pip install {ENGINE}"]
    return []


def run(job: Job) -> Outcome:
    """CPU times, from the fall until all lie, of ours and of PyBullet, without and with sleep in turns."""
    p, rows = job.parameters, []
    with single_thread():
        _advance(*cubes_into_bin(2, p["spheres"])[:2], 0.01)  # compiles, or loads what is compiled
        for k in range(p["rounds"]):
            seed = job.seed(f"starts {k}")
            scene, mean, horizon = cubes_into_bin(p["bodies"], p["spheres"], seed)
            for sleep in (False, True):
                measured = _advance(replace(scene, sleep=sleep), mean, horizon)
                rows += [Row(OURS + _SLEEP[sleep], *of, None, k, seed) for of in measured]
            if find_spec(ENGINE) is not None and p["spheres"] == SPHERES:
                for sleep in (False, True):
                    seconds = _peer_time(replace(scene, sleep=sleep), mean, horizon)
                    rows.append(Row(ENGINE + _SLEEP[sleep], TIME, "s", seconds, None, k, seed))
    return Outcome(rows)


def report(results: Results) -> str:
    """CPU times beside the goal, then what became of the heaps."""
    rows = results.rows("heaps")
    timed, lines, states = rows.where(quantity=TIME, spheres=SPHERES), [], []
    for method in timed.unique("method"):
        here = timed.where(method=method)
        medians = [here.where(bodies=bodies).median() for bodies in COUNTS]
        lines.append([_title(method), *map(number, medians), number(medians[-1] / medians[0])])
    for spheres in rows.unique("spheres"):
        for bodies in rows.where(spheres=spheres).unique("bodies"):
            here = rows.where(spheres=spheres, bodies=bodies, method=OURS)
            of = {name: here.where(quantity=name) for name in (UNCONVERGED, RESIDUAL, CREEP, DEPTH)}
            states.append(
                [f"{bodies} cubes, {spheres} spheres", f"{of[UNCONVERGED].mean():.0f}"]
                + [f"{of[RESIDUAL].median():.0e}"]
                + [number(1e6 * of[name].median()) for name in (CREEP, DEPTH)]
            )
    head = ["", *(f"{bodies} cubes" for bodies in COUNTS), "growth"]
    return "\n".join(
        [
            "### CPU time of a simulated second [s]\n",
            table(head, lines),
            goal_tables(_figures(results)),
            table(["", "unconverged", "residual", "creep [um]", "depth [um]"], states),
        ]
    )


def _figures(results) -> dict[str, list[Figure]]:
    rows, found = results.rows("heaps").where(quantity=TIME, spheres=SPHERES), []
    for method in rows.unique("method"):
        here = rows.where(method=method)
        growth = here.where(bodies=COUNTS[-1]).median() / here.where(bodies=COUNTS[0]).median()
        goal = GROWTH_GOAL if method == OURS else None
        if np.isfinite(growth):
            found.append(
                Figure(_title(method), f"{COUNTS[0]} to {COUNTS[-1]} cubes", growth, "x", goal, True)
            )
    return {"Growth of CPU time": found}


verdict = goals_met_by(_figures)


def _title(method):
    engine, _, rest = method.partition(" ")
    return f"{label(engine)} {rest}".strip()


def _advance(scene, mean, horizon) -> list[tuple[str, str, float]]:
    """Quantities, units and values of one rollout of ours."""
    world, states = scene.world, mean[None].copy()
    history = contact_history.fresh(1, world)
    steps, spent, before = max(round(horizon / scene.dt / _PARTS), 1), 0.0, mean
    for part in range(_PARTS):
        before, started = states[0].copy(), time.process_time()
        rollout(states, history, world, part * steps, steps)
        spent += time.process_time() - started
    residual = history.solver.residual[0]
    moved = np.linalg.norm(states[0, :, POSITION] - before[:, POSITION], axis=1)
    return [
        (TIME, "s", spent / (_PARTS * steps * scene.dt)),
        (UNCONVERGED, "1", float(np.count_nonzero(residual > RULES["contact_residual"].limit))),
        (RESIDUAL, "1", float(residual.max())),
        (CREEP, "m", float(moved.max())),
        (DEPTH, "m", float(overlaps(scene, states)[0].max())),
    ]


def _peer_time(scene, mean, horizon) -> float:
    """CPU time of a simulated second in PyBullet [s]."""
    peer = PEERS[ENGINE](scene, "primitive")
    try:
        peer.begin(mean)
        started = time.process_time()
        peer.advance(round(horizon / scene.dt))
        return (time.process_time() - started) / horizon
    finally:
        peer.close()
