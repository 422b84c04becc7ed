"""The service ``~/predict_candidates``: alternatives of one scene, to be ranked by their outcomes."""

from __future__ import annotations

import copy
import os
import time
from concurrent.futures import ThreadPoolExecutor

from unc_physics_msgs.msg import CandidatePrediction
from unc_physics_msgs.srv import PredictCandidates

from ..checks.errors import DuplicateIdError, ErrorCode, InvalidRequestError, LimitExceededError
from .background import BackgroundService
from .durations import duration
from .ranked_candidates import rank_candidates, with_reference
from .requests import answer_bytes, read_request, write_error


class CandidatesService:
    """Predicts all candidates with the same seed, so that they differ by their states alone."""

    def __init__(self, server):
        self._server = server
        self._service = BackgroundService(server, PredictCandidates, "~/predict_candidates", self._predict)
        self._pool = ThreadPoolExecutor(os.cpu_count() or 1)

    def close(self):
        """Take the service back."""
        self._service.close()
        self._pool.shutdown(wait=False)

    def _predict(self, request, response):
        started = time.perf_counter()
        with self._server.errors_into(response.result):
            settings = self._server.settings
            _check(request, settings)
            if request.score:
                request.request = with_reference(request.request)
            base = read_request(
                request.request,
                settings,
                self._server.library,
                self._server.frames,
                time_limit=settings.max_computation_time,
            )
            size = answer_bytes(base) * len(request.candidates)
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
        """Write the candidates' entries by their score."""
        candidates = [_with_candidate(request, k) for k in range(len(request.candidates))]
        entries, error = rank_candidates(
            self._server, request, candidates, base.seed, base.max_computation_time
        )
        response.predictions = entries
        if error is not None:
            write_error(response.result, error)

    def _candidate(self, request, k, seed, deadline):
        """The entry of candidate k, which ends at the deadline."""
        candidate = request.candidates[k]
        entry = CandidatePrediction(candidate=candidate.id)
        left = None if deadline is None else max(deadline - time.perf_counter(), 1e-3)
        own, fields = _with_candidate(request, k)
        own.seed = seed
        self._server.answer(entry, own, time_limit=left, fields=fields)
        return entry


def _with_candidate(request, k):
    """The request for the scene of candidate k, and what errors call its objects; all else is shared."""
    candidate = request.candidates[k]
    replaced = {message.id: j for j, message in enumerate(candidate.objects)}
    own = copy.copy(request.request)
    own.scene = copy.copy(own.scene)
    objects, fields = [], []
    for i, message in enumerate(own.scene.objects):
        j = replaced.get(message.id)
        objects.append(message if j is None else candidate.objects[j])
        fields.append(f"scene.objects[{i}]" if j is None else f"candidates[{k}].objects[{j}]")
    own.scene.objects = objects
    return own, fields


def _check(request, settings):
    """Refuse candidates that are none, too many, or do not belong to the scene."""
    if not request.candidates:
        raise InvalidRequestError("must name at least one candidate", field="candidates")
    if len(request.candidates) > settings.max_candidates:
        raise LimitExceededError(
            f"must be at most {settings.max_candidates}", field="candidates", value=len(request.candidates)
        )
    known = {message.id for message in request.request.scene.objects}
    ids = set()
    for k, candidate in enumerate(request.candidates):
        if candidate.id in ids:
            raise DuplicateIdError(
                "is the id of two candidates", field=f"candidates[{k}].id", value=candidate.id
            )
        ids.add(candidate.id)
        replaced = set()
        for j, message in enumerate(candidate.objects):
            field = f"candidates[{k}].objects[{j}].id"
            if message.id not in known:
                raise InvalidRequestError("is no object of the scene", field=field, value=message.id)
            if message.id in replaced:
                raise DuplicateIdError("is the id of two objects", field=field, value=message.id)
            replaced.add(message.id)
