"""The service ``~/predict_candidates``: rank alternatives of a scene by their outcomes."""

from __future__ import annotations

import copy
import os
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

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
    UncPhysicsError,
)
from ..checks.names import hint
from ..prediction.candidates import Candidate, CandidateError
from ..prediction.rank import rank_candidates
from ..propagators.names import REFERENCE
from .messages.fields import duration, write_error
from .messages.prediction import write_answer
from .messages.ranking import read_score, write_ranked_action
from .messages.request import Job, TimeLimits
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
        started, server = time.perf_counter(), self._server
        with server.errors_into(response.result):
            _check(request, server.settings)
            if request.score:
                request.request = _with_reference(request.request)
            limits = TimeLimits(server.settings.max_computation_time)
            base = server.read(request.request, limits=limits)
            size, limit = base.answer_bytes() * len(request.candidates), server.settings.max_response_bytes
            if size > limit:
                raise LimitExceededError(
                    f"would take {size} bytes, and the limit is {limit}; ask for fewer states, samples or"
                    " candidates",
                    field="the answer",
                )
            response.seed = base.seed
            candidates = RequestedCandidates(server, request, base.seed)
            if request.score:
                error = candidates.rank(base.max_computation_time)
                if error is not None:
                    write_error(response.result, error)
            else:
                candidates.predict(self._pool, started, base.max_computation_time)
                late = [own for own in candidates.entries if own.result.error_code == ErrorCode.TIMEOUT]
                if late:
                    response.result = late[0].result
            response.predictions = candidates.entries
        response.computation_time = duration(time.perf_counter() - started)


class RequestedCandidates:
    """Candidates of one request, and their entries in its answer.

    Parameters
    ----------
    server : PredictionServer
    request : PredictCandidates.Request
    seed : int
        Seed of all candidates.

    Attributes
    ----------
    entries : list of CandidatePrediction
        In the order of the request; after `rank` by score, and entries with an error are last.
    """

    def __init__(self, server, request, seed: int):
        self._server, self._request, self._seed = server, request, seed
        self.entries = [CandidatePrediction(candidate=candidate.id) for candidate in request.candidates]

    def predict(self, pool: ThreadPoolExecutor, started: float, time_limit: float | None) -> None:
        """Predict all candidates concurrently within ``time_limit`` [s] after ``started``."""
        list(pool.map(lambda k: self._predict(k, started, time_limit), range(len(self.entries))))

    def rank(self, time_limit: float | None) -> UncPhysicsError | None:
        """Rank all candidates, and order their entries.

        Parameters
        ----------
        time_limit : float or None
            Longest wall time [s].

        Returns
        -------
        UncPhysicsError or None
            Error that ended the ranking early.

        Raises
        ------
        UncPhysicsError
            If the score or the shared part of the request is invalid.
        """
        jobs: dict[int, Job] = {}
        for k, entry in enumerate(self.entries):
            with self._server.errors_into(entry.result):
                own, fields = self._own_request(k)
                jobs[k] = self._server.read(own, fields=fields)
        order: list[int] = []
        ended = None
        while jobs:
            try:
                order = self._write(self._ranking([*jobs.values()], time_limit), jobs)
                break
            except CandidateError as failed:  # rank the others without it
                k = [*jobs][failed.candidate]
                jobs.pop(k)
                write_error(self.entries[k].result, failed.error)
                self._server.diagnostics.failed(str(failed.error))
            except (PredictionTimeoutError, CanceledError) as error:
                ended = error
                if error.prediction is not None:
                    order = self._write(error.prediction, jobs)
                for k in jobs.keys() - set(order):
                    write_error(self.entries[k].result, error)
                break
        others = [k for k in range(len(self.entries)) if k not in order]
        self.entries = [self.entries[k] for k in [*order, *others]]
        return ended

    def _predict(self, k, started, time_limit):
        """Write the entry of candidate k."""
        entry = self.entries[k]
        if time_limit is not None:
            time_limit = max(started + time_limit - time.perf_counter(), 1e-3)
        with self._server.errors_into(entry.result):
            own, fields = self._own_request(k)
            self._server.answer(entry, own, limits=TimeLimits(time_limit), fields=fields)

    def _own_request(self, k):
        """Return the request of candidate k, and the names of its objects and actions in error messages."""
        own, fields = _with_candidate(self._request, k)
        own.seed = self._seed
        return own, fields

    def _ranking(self, jobs, time_limit):
        """Return the ranking of some candidates' jobs."""
        first = jobs[0]
        score = read_score(self._request.score, first.regions, first.scene)
        return rank_candidates(
            [Candidate(str(k), job.scene, job.belief) for k, job in enumerate(jobs)],
            first.propagator,
            score.event,
            first.horizon,
            times=first.times,
            smallest_first=score.smallest_first,
            budget=self._request.budget or None,
            max_computation_time=time_limit,
            progress=lambda done, budget: self._server.check_open(),
        )

    def _write(self, ranking, jobs):
        """Write a ranking into the entries; return the indices of those without an error, best first."""
        order, ranked = [], [*jobs]
        header = self._request.request.scene.header
        for action in ranking:
            k, prediction = ranked[int(action.name)], action.prediction
            entry, job = self.entries[k], replace(jobs[k], propagator=prediction.propagator)
            with self._server.errors_into(entry.result):
                write_answer(entry.prediction, header, self._server.settings, job, prediction)
                write_ranked_action(entry, action)
                self._server.diagnostics.predicted(prediction)
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
