"""Many predictions, on any executor."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing, nullcontext
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ..checks.errors import InvalidRequestError, NotReadyError, UncPhysicsError
from ..checks.validation import instance, integer
from ..compiler.backend import FOLDER
from ..compiler.refusal import CompilationRefused, refused_compilation
from ..propagators.base import Propagator
from ..propagators.names import ANYTIME
from ..propagators.registry import PROPAGATORS, make_propagator, propagator_from_texts
from ..scene.belief import Belief
from ..scene.entries import check_keys, read_numbers
from ..scene.scene import Scene
from ..scene.scene_file import scene_from_dict
from .actions import OF_BELIEF, Action, about_action, apply_action
from .answer_store import AnswerStore
from .body_status import BodyStatus
from .event_entries import read_event
from .events import Event
from .executors import AnyExecutor, Workers, in_order
from .predict import predict
from .snapshot import Probability
from .status import assess_all

_LINE_KEYS = ("scene", "propagator", "options", "times", "events", "seed")
_SCENES = 64  # kept in a process, for lines with the same one
_scenes: dict[tuple, Scene] = {}


class Request(NamedTuple):
    """What `predict_many` predicts; the fields are arguments of `predict`.

    Attributes
    ----------
    scene : Scene
    belief : Belief
    propagator : str or Propagator
        With a name, the seed is the request's number.
    times : sequence of float, or float
        Times, or the horizon alone [s].
    events : sequence of Event
    """

    scene: Scene
    belief: Belief
    propagator: str | Propagator = ANYTIME
    times: Sequence[float] | float | None = None
    events: Sequence[Event] = ()

    def read(self, number: int) -> Request:
        """Return the request with a propagator that has the seed of the request's number."""
        if not isinstance(self.propagator, str):
            return self
        seeded = self.propagator in PROPAGATORS and "seed" in PROPAGATORS[self.propagator].options()
        options = {"seed": number} if seeded else {}
        return self._replace(propagator=make_propagator(self.propagator, **options))


class RequestLine(NamedTuple):
    """A request as JSON with the keys `_LINE_KEYS`, which workers read; the number is that of the line."""

    number: int
    text: str
    models: str | None = None
    folder: str | None = None

    def read(self, number: int) -> Request:
        """Return the request; errors name the key and its value."""
        try:
            entry = json.loads(self.text)
        except ValueError as error:
            raise InvalidRequestError(f"is not JSON: {error}", value=self.text) from None
        check_keys(entry, _LINE_KEYS, "request")
        given = {"propagator": ANYTIME, "options": {}, "events": [], "seed": number}
        given |= {key: value for key, value in entry.items() if value is not None}
        for key, kind in (("options", dict), ("events", list), ("propagator", str)):
            instance(given[key], kind, key)
        try:
            scene, belief, horizon = scene_from_dict(given.get("scene"), self.models, self.folder)
        except UncPhysicsError as error:
            raise error.at("scene" if error.field == "scene" else f"scene.{error.field}") from None
        options, seed = given["options"], integer(given["seed"], "seed", low=0)
        seed = None if "seed" in options else seed
        propagator = propagator_from_texts(given["propagator"], options, seed=seed)
        times = given.get("times")
        if times is not None:
            times = times if isinstance(times, list) else [times]
            times = read_numbers(times, (len(times),), "times").tolist()
        events = [read_event(event, f"events[{k}]") for k, event in enumerate(given["events"])]
        scene = _shared(scene, given["scene"])
        return Request(scene, belief, propagator, horizon if times is None else times, events)


def _shared(scene, content):
    """Return the scene that was read first of content that differs in beliefs only: its arrays are made once.

    A model is the same object as long as its file is unchanged.
    """
    bodies = [{key: body[key] for key in body if key not in OF_BELIEF} for body in content["bodies"]]
    key = json.dumps(content | {"bodies": bodies, "horizon": None}), *(body.model for body in scene.bodies)
    if len(_scenes) >= _SCENES:
        _scenes.clear()
    return _scenes.setdefault((*key, scene.stiffness), scene)


@dataclass(frozen=True, eq=False)
class RequestAnswer:
    """Prediction of one request, without what only the process that made it needs.

    Attributes
    ----------
    number : int
        The request's.
    seed : int or None
        As in `Prediction.seed`.
    bodies : tuple of str
    times : (T,) array
        [s].
    means : (T, B, 13) array
        As in `Belief.mean`.
    covariances : (T, B, 12, 12) array
        Of each body, as `Belief.marginal`.
    probabilities : tuple of dict of str to Probability
        At each time, by the text of the event.
    statuses : tuple of tuple of BodyStatus
        At each time, of each body, as those of `assess_all`.
    wall_time : float
        As in `Prediction.wall_time` [s].
    error : UncPhysicsError or None
        Why there is no prediction; the arrays are then None.
    """

    number: int
    seed: int | None = None
    bodies: tuple[str, ...] = ()
    times: Any = None
    means: Any = None
    covariances: Any = None
    probabilities: tuple[dict[str, Probability], ...] = ()
    statuses: tuple[tuple[BodyStatus, ...], ...] = ()
    wall_time: float = 0.0
    error: UncPhysicsError | None = None


def predict_many(
    requests: Iterable[Request | RequestLine | tuple] | Request | tuple,
    executor: AnyExecutor = None,
    *,
    actions: Iterable[Action] | None = None,
    store: Any = None,
    progress: Callable[[int], object] | None = None,
) -> Iterator[RequestAnswer]:
    """Predict many requests, and yield their answers in order.

    An answer has the same bits as a single `predict`, whatever the executor, the number of workers and the
    order in which they work. They get chunks of about a second, in which each prediction uses one thread.
    The chunk of a worker that is lost is repeated. Workers load kernels that this process compiles.

    Parameters
    ----------
    requests : iterable of Request
        Also tuples of their fields, which may be a generator; or a single one, with ``actions``.
    executor : concurrent.futures.Executor, callable or str, optional
        By default the predictions are made in this process. ``"processes:4"`` uses four processes of this
        machine, ``"dask://HOST:PORT"`` a Dask cluster, and others are given as an executor, or as a function
        that makes one. A process pool that loses a process is broken: only those of a text or a function are
        made anew.
    actions : iterable of action, optional
        As in `rank`, so also beliefs: the request is predicted after each.
    store : path-like, optional
        Folder of Parquet files, which gets a row for each body and time. Requests that it holds already are
        not predicted, and have no answer.
    progress : callable, optional
        Called with the number of answers so far, about once a second.

    Yields
    ------
    RequestAnswer
        Also where a request cannot be predicted: `RequestAnswer.error` says why.

    Raises
    ------
    InvalidRequestError
        If the folder holds another request of the same number.
    NotReadyError
        If workers do not find kernels that this process compiled.
    OutputError, NotSupportedError, InvalidOptionError
        If the folder cannot be written, pyarrow or Dask is missing, or there is no such executor.
    """
    if actions is not None:
        single = _request(requests)
        requests = (_after(single, *numbered) for numbered in enumerate(actions))
    return in_order(_answers(requests, executor, store, progress))


def _request(fields):
    """Return a request of its fields."""
    if isinstance(fields, tuple) and 2 <= len(fields) <= len(Request._fields):
        return Request(*fields)
    raise InvalidRequestError("must be a scene, a belief, a propagator, times and events", field="a request")


class _Wrong(NamedTuple):
    """In place of a request that cannot be made."""

    error: UncPhysicsError

    def read(self, number: int) -> Request:
        """Raise the error."""
        raise self.error


def _after(request, number, action):
    try:
        scene, belief = apply_action(request.scene, request.belief, action)
    except UncPhysicsError as error:
        return _Wrong(about_action(number, error))
    return request._replace(scene=scene, belief=belief)


class _Asked(NamedTuple):
    """A request with its number, and how often this process had compiled kernels for workers before."""

    number: int
    request: Request | RequestLine | _Wrong
    compiled: int


class _Refused(NamedTuple):
    """What a worker answers in place of compiling a kernel."""

    kernel: str
    folder: str


def _answers(requests, executor, store, progress):
    """Yield what `Workers.results` does."""
    done, compiled = 0, 0

    def asked():
        for number, request in enumerate(requests):
            if isinstance(request, RequestLine):
                number = request.number
            elif not isinstance(request, (Request, _Wrong)):
                request = _request(request)
            if stored is None or not stored.has(number, request):
                yield _Asked(number, request, compiled)

    def look():
        if progress is not None:
            progress(done)

    with (
        nullcontext() if store is None else closing(AnswerStore(store)) as stored,
        closing(Workers(executor)) as workers,
    ):
        answer = partial(_answer, compiles=workers.here)
        found: Any
        for k, one, found in workers.results(answer, asked(), look):
            if isinstance(found, _Refused):
                if one.compiled < compiled:  # it was sent before the kernels were there
                    workers.repeat(k, one._replace(compiled=compiled))
                    continue
                if not isinstance(_answer(one, compiles=False), _Refused):
                    raise NotReadyError(
                        f"has no kernel '{found.kernel}' in {found.folder}, which is in {FOLDER} here; let"
                        " NUMBA_CACHE_DIR name a folder that all see, or run 'unc_physics warm-up' there",
                        field="a worker",
                    )
                found = _answer(one, compiles=True)
                compiled += 1
            elif isinstance(found, UncPhysicsError):
                found = RequestAnswer(one.number, error=found)
            if stored is not None and found.error is None:
                stored.add(found, one.request)
            done += 1
            yield k, one, found
        look()


def _answer(asked: _Asked, compiles: bool) -> RequestAnswer | _Refused:
    """Return the answer to a request, unless it needs a kernel that may not be compiled."""
    number = asked.number
    try:
        with refused_compilation(not compiles):
            scene, belief, propagator, times, events = asked.request.read(number)
            alone = times is None or isinstance(times, (int, float, np.number))
            when: dict[str, Any] = {"horizon" if alone else "times": times}
            found = predict(scene, belief, propagator, events=events, **when)
            probabilities = tuple(
                {str(event): found.probability(event, time=time) for event in events} for time in found.times
            )
            statuses = assess_all(found)
    except CompilationRefused as refused:
        return _Refused(str(refused), str(FOLDER))
    except UncPhysicsError as error:
        error.prediction = None  # of which nothing is sent
        return RequestAnswer(number, error=error)
    bodies = range(len(scene.bodies))
    return RequestAnswer(
        number,
        found.seed,
        tuple(body.name for body in scene.bodies),
        np.array(found.times),
        np.array([belief.mean for belief in found.beliefs]),
        np.array([[belief.marginal(b) for b in bodies] for belief in found.beliefs]),
        probabilities,
        statuses,
        found.wall_time,
    )
