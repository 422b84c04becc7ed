"""Execution of jobs on an executor; jobs have seeds, so their order does not change results."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing

from unc_physics.checks.errors import UncPhysicsError
from unc_physics.prediction.executors import AnyExecutor, Workers

from .jobs import Job, Outcome
from .provenance import machine, versions
from .results import Results

TICK = 1.0  # s, least time between drawings of the progress bar
LOG_INTERVAL = 60.0  # s, between lines of progress in a log file


def run_job(job: Job) -> tuple[Outcome, dict[str, str]]:
    """Run a job; return its outcome, and the versions and the machine."""
    from .experiments import experiment

    outcome = experiment(job.experiment).run(job)
    made_with = "; ".join(f"{name} {number}" for name, number in versions().items())
    return outcome, {"versions": made_with, "machine": machine()}


def run_jobs(jobs: Sequence[Job], results: Results, executor: AnyExecutor) -> dict[str, str]:
    """Run the jobs without results, with a progress bar on a terminal, or a line a minute in a log file.

    Parameters
    ----------
    jobs : sequence of Job
    results : Results
        Finished jobs are read from it and added to it.
    executor : AnyExecutor

    Returns
    -------
    dict of str to str
        Keys of the jobs that failed, and why.
    """
    from tqdm import tqdm

    missing = results.missing(jobs)
    total = sum(job.cost for job in jobs)
    failures = {}
    if not missing:
        return failures
    terminal = sys.stderr.isatty()
    shown = "{elapsed} passed, {remaining} left{postfix}"
    shown = "{desc}: {percentage:3.0f}%" + (f"|{{bar}}| {shown}" if terminal else f", {shown}\n")
    with (
        closing(Workers(executor, chunk_time=0.0)) as workers,  # one job at a time
        tqdm(
            total=total,
            initial=total - sum(job.cost for job in missing),
            mininterval=TICK if terminal else LOG_INTERVAL,
            miniters=0,
            desc="evaluate",
            bar_format=shown,
        ) as progress,
    ):
        for job, outcome in _finished_jobs(workers, missing, lambda: progress.update(0)):
            if isinstance(outcome, UncPhysicsError):
                failures[f"{job.experiment} {job.key}"] = str(outcome)
            else:
                results.add(job, *outcome)
            progress.set_postfix_str(f"last: {job.experiment}", refresh=False)
            progress.update(job.cost)
    return failures


def _finished_jobs(workers: Workers, jobs: Sequence[Job], tick: Callable[[], object]) -> Iterator[tuple]:
    """Yield jobs and outcomes as they finish: the longest start first, those that must be alone last."""
    together = sorted((job for job in jobs if not job.alone), key=lambda job: -job.cost)
    for batch in (together, *([job] for job in jobs if job.alone)):
        for _, job, outcome in workers.results(_outcome, batch, tick):
            yield job, outcome


def _outcome(job):
    try:
        return run_job(job)
    except UncPhysicsError as error:
        return error
