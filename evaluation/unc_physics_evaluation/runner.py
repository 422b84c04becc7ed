"""Execution of jobs in local processes; jobs have seeds, so their order does not change results."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager

from unc_physics.checks.errors import UncPhysicsError

from .jobs import Job, Outcome
from .provenance import machine, threads, versions
from .results import Results

TICK = 1.0  # s, between looks at the progress bar's clock
LOG_INTERVAL = 60.0  # s, between lines of progress in a log file


def run_job(job: Job) -> tuple[Outcome, dict[str, str]]:
    """Run a job; return its outcome, and the versions and the machine."""
    import numba

    from .experiments import experiment

    before = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        outcome = experiment(job.experiment).run(job)
    finally:
        numba.set_num_threads(before)
    made_with = "; ".join(f"{name} {number}" for name, number in versions().items())
    return outcome, {"versions": made_with, "machine": machine()}


def run_jobs(jobs: Sequence[Job], results: Results, workers: int | None = None) -> dict[str, str]:
    """Run the jobs without results, with a progress bar on a terminal, or a line a minute in a log file.

    Parameters
    ----------
    jobs : sequence of Job
    results : Results
        Finished jobs are read from it and added to it.
    workers : int, optional
        Number of processes; by default one for each of the processor's threads.

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
        tqdm(
            total=total,
            initial=total - sum(job.cost for job in missing),
            mininterval=TICK if terminal else LOG_INTERVAL,
            miniters=0,
            desc="evaluate",
            bar_format=shown,
        ) as progress,
        _executor(workers) as executor,
    ):
        for job, outcome in _finished_jobs(executor, missing, lambda: progress.update(0)):
            if isinstance(outcome, UncPhysicsError):
                failures[f"{job.experiment} {job.key}"] = str(outcome)
            else:
                results.add(job, *outcome)
            progress.set_postfix_str(f"last: {job.experiment}", refresh=False)
            progress.update(job.cost)
    return failures


def _finished_jobs(executor: Executor, jobs: Sequence[Job], tick: Callable[[], object]) -> Iterator[tuple]:
    """Yield jobs and outcomes as they finish: the longest start first, those that must be alone last."""
    together = sorted((job for job in jobs if not job.alone), key=lambda job: -job.cost)
    for batch in (together, *([job] for job in jobs if job.alone)):
        pending = {executor.submit(run_job, job): job for job in batch}
        while pending:
            done = wait(pending, TICK, FIRST_COMPLETED).done
            tick()
            for future in done:
                yield pending.pop(future), _outcome(future)


def _outcome(future):
    try:
        return future.result()
    except UncPhysicsError as error:
        return error
    except BrokenProcessPool:
        raise UncPhysicsError(
            "a process of the pool died, perhaps for want of memory; run again with fewer --workers"
        ) from None


@contextmanager
def _executor(workers) -> Iterator[Executor]:
    executor = ProcessPoolExecutor(
        workers or threads(), mp_context=multiprocessing.get_context("spawn"), initializer=_prepare_process
    )
    try:
        yield executor
    except BaseException:
        executor.shutdown(wait=False, cancel_futures=True)
        for process in multiprocessing.active_children():
            process.terminate()
        raise
    executor.shutdown()


def _prepare_process():
    """Ignore interrupts, and end with the parent process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()

    def watch():
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
