"""The service ``~/predict_candidates``: rank alternatives of a scene by their outcomes."""

from __future__ import annotations

import copy
import os
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

from unc_physics_msgs.msg import CandidatePrediction, Result
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
from ..prediction.rank import Candidate, rank_candidates
from ..propagators.names import REFERENCE
from .messages.events import read_score
from .messages.fields import duration, write_error
from .messages.prediction import write_answer
from .messages.request import Job, TimeLimits, check_memory
from .messages.scene import FieldNames
from .services import BackgroundService


class CandidatesService(BackgroundService):
    """Service that predicts all candidates with the same seed, so that they differ only by their states."""

    def __init__(self, server):
        self._server = server
        super().__init__(server, PredictCandidates, "~/predict_candidates", self._predict)

    def _predict(self, request, response):
        started, server = time.perf_counter(), self._server
        with server.errors_into(response.result):
            _check(request, server.settings)
            limits = TimeLimits(server.settings.max_computation_time)
            base = server.read(request.request, limits=limits)
            check_memory(base, server.settings, len(request.candidates))
            response.seed = base.seed
            entries = [CandidatePrediction(candidate=candidate.id) for candidate in request.candidates]
            if request.score:
                order = rank_entries(server, request, base, entries, response.result)
                entries.sort(key=lambda entry: order.get(entry.candidate, len(order)))
            else:
                self._predict_each(request, base, entries, started)
                late = [own.result for own in entries if own.result.error_code == ErrorCode.TIMEOUT]
                response.result = late[0] if late else response.result
            response.predictions = entries
        response.computation_time = duration(time.perf_counter() - started)

    def _predict_each(self, request, base, entries, started):
        """Predict all candidates concurrently, within the time limit since ``started``."""

        def answer(k):
            limit = base.max_computation_time
            if limit is not None:
                limit = max(started + limit - time.perf_counter(), 1e-3)
            with self._server.errors_into(entries[k].result):
                own, fields = _with_candidate(request, k, base.seed)
                self._server.answer(entries[k], own, limits=TimeLimits(limit), fields=fields)

        with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
            list(pool.map(answer, range(len(entries))))


def rank_entries(
    server, request: PredictCandidates.Request, base: Job, entries: list[CandidatePrediction], result: Result
) -> dict[str, int]:
    """Rank the candidates of a request, write them into their entries, and return their places by name.

    A candidate with an error has no place; its entry holds the error. An error that ended the ranking is
    written into ``result``, and into each entry that has no answer. ``base`` is the job of the request
    without candidates.

    Raises
    ------
    UncPhysicsError
        If the score or the shared part of the request is invalid.
    """
    jobs: dict[str, Job] = {}
    for k, entry in enumerate(entries):
        with server.errors_into(entry.result):
            own, fields = _with_candidate(request, k, base.seed)
            jobs[entry.candidate] = server.read(own, fields=fields)
    if not jobs:
        return {}
    of = {entry.candidate: entry for entry in entries}

    def fail(name, error):
        with server.errors_into(of[name].result):
            raise error

    event, negated = read_score([*request.score], base.regions, next(iter(jobs.values())).scene)
    try:
        ranking = rank_candidates(
            {name: Candidate(job.scene, job.belief, job.marks) for name, job in jobs.items()},
            base.propagator,
            event,
            fail,
            budget=request.budget or None,
            max_computation_time=base.max_computation_time,
            progress=lambda done, budget: server.check_open(),
        )
    except (PredictionTimeoutError, CanceledError) as error:
        write_error(result, error)
        ranking = error.prediction or ()
        for name in jobs.keys() - {action.name for action in ranking}:
            if of[name].result.error_code == ErrorCode.NONE:
                write_error(of[name].result, error)
    places = {}
    for action in ranking:
        entry, job = of[action.name], replace(jobs[action.name], propagator=action.prediction.propagator)
        with server.errors_into(entry.result):
            header = request.request.scene.header
            write_answer(entry.prediction, header, server.settings, job, action.prediction)
            _write_ranked_action(entry, action, negated)
            server.diagnostics.predicted(action.prediction)
            places[action.name] = len(places)
    return places


def _write_ranked_action(entry, action, negated):
    """Write a ranked action into a candidate's entry; ``negated`` is that of `read_score`."""
    found, difference = action.score, action.difference.value
    entry.score, entry.score_low, entry.score_high = found.estimate, found.low, found.high
    if negated:
        entry.score, entry.score_low, entry.score_high = 1 - found.estimate, 1 - found.high, 1 - found.low
        difference = -difference
    entry.difference, entry.difference_std = difference, action.difference.std
    if action.margin is not None:
        entry.has_margin, entry.margin = True, float(action.margin)
    entry.tied, entry.clearly_worse = action.tied, action.clearly_worse


def _with_candidate(request, k, seed):
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
    own.scene, own.seed = copy.copy(own.scene), seed
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
    """Raise an error for missing, equal or too many candidates, or a propagator without rollouts.

    With a score, an empty propagator becomes the one whose samples are rollouts.
    """
    candidates, inner = request.candidates, request.request
    if not candidates:
        raise InvalidRequestError("must name at least one candidate", field="candidates")
    if len(candidates) > settings.max_objects:
        raise LimitExceededError(
            f"must be at most {settings.max_objects}", field="candidates", value=len(candidates)
        )
    ids = [candidate.id for candidate in candidates]
    for k, name in enumerate(ids):
        if name in ids[:k]:
            raise DuplicateIdError("is the id of two candidates", field=f"candidates[{k}].id", value=name)
    if request.score and inner.propagator not in ("", REFERENCE):
        raise NotSupportedError(
            f"must be {REFERENCE} or empty where there is a score, which counts its rollouts",
            field="propagator",
            value=inner.propagator,
        )
    if request.score:
        inner.propagator = REFERENCE
