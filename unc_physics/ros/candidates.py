"""The service ``~/predict_candidates``: rank alternatives of a scene by their outcomes."""

from __future__ import annotations

import copy
import os
import time
from concurrent.futures import ThreadPoolExecutor

from unc_physics_msgs.msg import CandidatePrediction
from unc_physics_msgs.srv import PredictCandidates

from ..checks.errors import (
    CanceledError,
    DuplicateIdError,
    ErrorCode,
    InvalidRequestError,
    LimitExceededError,
    NotSupportedError,
    PredictionTimeoutError,
)
from ..checks.names import hint
from ..prediction.candidates import Candidate, Failed
from ..prediction.rank import rank_candidates
from ..propagators.names import REFERENCE
from .messages.fields import duration, write_error
from .messages.prediction import write_answer
from .messages.ranking import read_score, write_ranked_action
from .messages.request import read_request
from .messages.scene import FieldNames
from .services import BackgroundService


class CandidatesService:
    """Service that predicts all candidates with the same seed, so that they differ only by their states."""

    def __init__(self, server):
        self._server = server
        self._service = BackgroundService(server, PredictCandidates, "~/predict_candidates", self._predict)
        self._pool = ThreadPoolExecutor(os.cpu_count() or 1)

    def close(self):
        """Withdraw the service."""
        self._service.close()
        self._pool.shutdown(wait=False)

    def _predict(self, request, response):
        started = time.perf_counter()
        with self._server.errors_into(response.result):
            settings = self._server.settings
            _check(request, settings)
            if request.score:
                request.request = _with_reference(request.request)
            base = read_request(
                request.request,
                settings,
                self._server.library,
                self._server.frames,
                time_limit=settings.max_computation_time,
                complete=self._server.environment.complete,
            )
            size = base.answer_bytes() * len(request.candidates)
            if size > settings.max_response_bytes:
                raise LimitExceededError(
                    f"would take {size} bytes, and the limit is {settings.max_response_bytes}; ask for fewer"
                    " states, samples or candidates",
                    field="the answer",
                )
            response.seed = base.seed
            if request.score:
                self._rank(request, response, base)
                response.computation_time = duration(time.perf_counter() - started)
                return
            deadline = None if base.max_computation_time is None else started + base.max_computation_time
            response.predictions = list(
                self._pool.map(
                    lambda k: self._candidate(request, k, base.seed, deadline), range(len(request.candidates))
                )
            )
            late = [entry for entry in response.predictions if entry.result.error_code == ErrorCode.TIMEOUT]
            if late:
                response.result = late[0].result
        response.computation_time = duration(time.perf_counter() - started)

    def _rank(self, request, response, base):
        """Write the candidates' entries, ordered by their score."""
        entries, error = _rank_candidates(self._server, request, base.seed, base.max_computation_time)
        response.predictions = entries
        if error is not None:
            write_error(response.result, error)

    def _candidate(self, request, k, seed, deadline):
        """Return the entry of candidate k, whose prediction ends at the deadline."""
        entry = CandidatePrediction(candidate=request.candidates[k].id)
        left = None if deadline is None else max(deadline - time.perf_counter(), 1e-3)
        with self._server.errors_into(entry.result):
            own, fields = _with_candidate(request, k)
            own.seed = seed
            self._server.answer(entry, own, time_limit=left, fields=fields)
        return entry


def _rank_candidates(server, request, seed: int, time_limit: float | None):
    """Return the entries of all candidates by score; entries with an error are last.

    Parameters
    ----------
    server : PredictionServer
    request : PredictCandidates.Request
    seed : int
    time_limit : float or None
        Longest wall time [s].

    Returns
    -------
    entries : list of CandidatePrediction
    error : UncPhysicsError or None
        Error that ended the ranking early.

    Raises
    ------
    UncPhysicsError
        If the score or the shared part of the request is invalid.
    """
    entries = [CandidatePrediction(candidate=candidate.id) for candidate in request.candidates]
    jobs = {}
    for k, entry in enumerate(entries):
        with server.errors_into(entry.result):
            own, fields = _with_candidate(request, k)
            own.seed = seed
            jobs[k] = read_request(
                own,
                server.settings,
                server.library,
                server.frames,
                fields=fields,
                complete=server.environment.complete,
            )
    order, error = [], None
    while jobs:
        try:
            ranking = _ranking(server, request, [*jobs.values()], time_limit)
            order = _write(server, request, ranking, jobs, entries)
            break
        except Failed as failed:  # rank the others without it
            k = [*jobs][failed.candidate]
            jobs.pop(k)
            write_error(entries[k].result, failed.error)
            server.diagnostics.failed(str(failed.error))
        except (PredictionTimeoutError, CanceledError) as caught:
            error = caught
            if caught.prediction is not None:
                order = _write(server, request, caught.prediction, jobs, entries)
            for k in jobs.keys() - set(order):
                write_error(entries[k].result, caught)
            break
    return [entries[k] for k in order] + [entry for k, entry in enumerate(entries) if k not in order], error


def _ranking(server, request, jobs, time_limit):
    """Return the ranking of some candidates' jobs."""
    first = jobs[0]
    score = read_score(request.score, first.regions, first.scene)
    candidates = [Candidate(str(k), job.scene, job.belief) for k, job in enumerate(jobs)]

    return rank_candidates(
        candidates,
        first.propagator,
        score.event,
        first.horizon,
        times=first.times,
        smallest_first=score.smallest_first,
        budget=request.budget or None,
        max_computation_time=time_limit,
        progress=lambda done, budget: server.check_open(),
    )


def _write(server, request, ranking, jobs, entries):
    """Write a ranking into the candidates' entries; return their order."""
    order, places = [], [*jobs]
    for action in ranking:
        k = places[int(action.name)]
        entry, prediction, job = entries[k], action.prediction, jobs[k]
        with server.errors_into(entry.result):
            own = job._replace(propagator=prediction.propagator)
            write_answer(entry.prediction, request.request.scene.header, server.settings, own, prediction)
            write_ranked_action(entry, action)
            server.diagnostics.predicted(prediction)
        if entry.result.error_code == ErrorCode.NONE:
            order.append(k)
    return order


def _with_candidate(request, k):
    """Return the request for candidate k, and the names of its objects and actions in error messages.

    Raises
    ------
    InvalidRequestError, DuplicateIdError
        If it replaces an object that is not in the scene, or the same one twice.
    """
    candidate = request.candidates[k]
    known = {message.id for message in request.request.scene.objects}
    replaced = {}
    for j, message in enumerate(candidate.objects):
        field = f"candidates[{k}].objects[{j}].id"
        if message.id not in known:
            problem = f"is no object of the scene{hint(message.id, known)}"
            raise InvalidRequestError(problem, field=field, value=message.id)
        if message.id in replaced:
            raise DuplicateIdError("is the id of two objects", field=field, value=message.id)
        replaced[message.id] = j
    own = copy.copy(request.request)
    own.scene = copy.copy(own.scene)
    objects, object_names = [], []
    for i, message in enumerate(own.scene.objects):
        j = replaced.get(message.id)
        objects.append(message if j is None else candidate.objects[j])
        object_names.append(f"scene.objects[{i}]" if j is None else f"candidates[{k}].objects[{j}]")
    own.scene.objects = objects
    named = replaced.keys() | {action.object for action in candidate.actions}
    kept = [(f"actions[{i}]", one) for i, one in enumerate(own.actions) if one.object not in named]
    kept += [(f"candidates[{k}].actions[{i}]", one) for i, one in enumerate(candidate.actions)]
    own.actions = [action for _, action in kept]
    return own, FieldNames(object_names, [name for name, _ in kept])


def _check(request, settings):
    """Raise an error for missing or too many candidates, and for two of the same id."""
    if not request.candidates:
        raise InvalidRequestError("must name at least one candidate", field="candidates")
    if len(request.candidates) > settings.max_candidates:
        raise LimitExceededError(
            f"must be at most {settings.max_candidates}", field="candidates", value=len(request.candidates)
        )
    ids = set()
    for k, candidate in enumerate(request.candidates):
        if candidate.id in ids:
            raise DuplicateIdError(
                "is the id of two candidates", field=f"candidates[{k}].id", value=candidate.id
            )
        ids.add(candidate.id)


def _with_reference(request):
    """Return the request with the propagator whose samples are rollouts.

    Raises
    ------
    NotSupportedError
        If it names another propagator.
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
