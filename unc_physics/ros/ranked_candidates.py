"""Candidates of a request that has a score: ranked by rollouts with common draws, the best one first."""

from __future__ import annotations

import copy

from unc_physics_msgs.msg import CandidatePrediction, Probability

from ..checks.errors import CanceledError, ErrorCode, NotSupportedError, PredictionTimeoutError
from ..prediction.contest import Entrant, Failed
from ..prediction.rank import rank_entrants
from ..propagators.names import REFERENCE
from .requests import Outcome, read_request, write_answer, write_error
from .scores import read_score


def rank_candidates(server, request, candidates, seed: int, time_limit: float | None):
    """The entries of all candidates, those with an error last.

    Parameters
    ----------
    server : PredictionServer
    request : PredictCandidates.Request
    candidates : sequence of (PredictionRequest, list of str)
        The request for the scene of each, and what errors call its objects.
    seed : int
    time_limit : float or None
        Longest wall time [s].

    Returns
    -------
    entries : list of CandidatePrediction
    error : UncPhysicsError or None
        What ended the ranking early.

    Raises
    ------
    UncPhysicsError
        If the score, or what all candidates share, is refused.
    """
    entries = [CandidatePrediction(candidate=candidate.id) for candidate in request.candidates]
    jobs = {}
    for k, (own, fields) in enumerate(candidates):
        own.seed = seed
        with server.errors_into(entries[k].result):
            jobs[k] = read_request(own, server.settings, server.library, server.frames, fields=fields)
    order, error = [], None
    while jobs:
        try:
            ranking = _ranking(server, request, [*jobs.values()], time_limit)
            order = _write(server, request, ranking, jobs, entries)
            break
        except Failed as failed:  # the others are ranked without it
            k = [*jobs][failed.entrant]
            jobs.pop(k)
            write_error(entries[k].result, failed.error)
            server.diagnostics.failed(str(failed.error))
        except (PredictionTimeoutError, CanceledError) as caught:
            error = caught
            if caught.prediction is not None:
                order = _write(server, request, caught.prediction, jobs, entries)
            for k in jobs:
                write_error(entries[k].result, caught)
            break
    return [entries[k] for k in order] + [entry for k, entry in enumerate(entries) if k not in order], error


def with_reference(request):
    """The request of all candidates, for the propagator whose samples are rollouts.

    Raises
    ------
    NotSupportedError
        If it names another one.
    """
    if request.propagator not in ("", REFERENCE):
        raise NotSupportedError(
            f"must be {REFERENCE} or empty where there is a score, which counts its rollouts",
            field="propagator",
            value=request.propagator,
        )
    own = copy.copy(request)
    own.propagator = REFERENCE
    return own


def _ranking(server, request, jobs, time_limit):
    """The ranking of some candidates' jobs."""
    first = jobs[0]
    score = read_score(request.score, first.regions, first.scene)
    entrants = [Entrant(str(k), job.scene, job.belief) for k, job in enumerate(jobs)]

    return rank_entrants(
        entrants,
        first.propagator,
        score.event,
        first.horizon,
        times=first.times,
        smallest_first=score.smallest_first,
        budget=request.budget or None,
        max_computation_time=time_limit,
        progress=lambda done, budget: server.check_open(),
        keep_samples=first.return_samples,
    )


def _write(server, request, ranking, jobs, entries):
    """Write a ranking into the candidates' entries; returns their order."""
    order, places = [], [*jobs]
    for action in ranking:
        k = places[int(action.name)]
        entry, prediction, job = entries[k], action.prediction, jobs[k]
        with server.errors_into(entry.result):
            own = job._replace(propagator=prediction.propagator)
            samples = None if prediction.kept is None else list(prediction.kept)
            outcome = Outcome(prediction, samples)
            write_answer(entry.prediction, request.request.scene.header, server.settings, own, outcome)
            entry.score = Probability(available=True, **action.score._asdict())
            entry.difference, entry.difference_std = action.difference.value, action.difference.std
            entry.clearly_worse = action.clearly_worse
            server.diagnostics.predicted(prediction)
        if entry.result.error_code == ErrorCode.NONE:
            order.append(k)
    return order
