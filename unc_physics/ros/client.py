"""Client of the node, with the arguments and results of the library: scenes, beliefs, predictions."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from os import PathLike
from typing import TYPE_CHECKING, Any

from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.node import Node

from unc_physics_msgs.action import PredictLong
from unc_physics_msgs.msg import ModelInfo, ModelList, PredictionRequest, TrackedObjects
from unc_physics_msgs.srv import (
    Fork,
    GetCapabilities,
    ListModels,
    LoadModel,
    Predict,
    PredictCandidates,
    Reset,
)

from ..checks.errors import (
    InvalidModelError,
    InvalidRequestError,
    NotActiveError,
    NotSupportedError,
    UncPhysicsError,
    UnknownModelError,
)
from ..checks.validation import instance, number, positive
from ..geometry.packing_file import SpherePacking
from ..prediction.actions import Action, apply_action
from ..prediction.events import Event
from ..prediction.prediction import Prediction
from ..prediction.rank import Ranking
from ..propagators.base import Propagator
from ..propagators.names import DEFAULT, REFERENCE
from ..scene.belief import Belief
from ..scene.body import RigidBody
from ..scene.scene import Scene
from ..tracking.measurements import PoseMeasurement
from .connection import Connection
from .messages.actions import write_actions
from .messages.environment import write_region
from .messages.fields import duration, read_error, stamp_of
from .messages.prediction import read_answer
from .messages.query import Options, Query, RequestedOutputs, make_query, split_events, whole_number
from .messages.ranking import read_candidate, read_ranking, write_candidate, write_score
from .messages.request import write_request
from .messages.scene import write_object
from .messages.tracking import TrackedBody, TrackedPrediction, read_fork, read_tracked, write_measurement
from .models import GivenPackings, ModelLibrary
from .newest_message import NewestMessage
from .services import LATCHED
from .streams import topic_name

if TYPE_CHECKING:
    from typing_extensions import Self, Unpack

_THREADS = 8  # threads that wait for answers
_PACKING_POLL_PERIOD = 0.2  # s
_DISCOVERY_POLL_PERIOD = 0.01  # s
_QUEUED = 20  # messages that wait in the middleware
_RESET_TIMEOUT = 0.5  # s, until the tracker's message after a reset arrives


class Client:
    """Client with the arguments and results of `unc_physics.predict`, which a node computes.

    For example::

        with Client() as client:
            prediction = client.predict(scene, belief, "sigma_points", horizon=1.0)
            prediction["mug"].position, prediction["mug"].position_std

    The node must have the models of the scene's bodies under the names of their packings (`load_model`).

    Parameters
    ----------
    node : rclpy Node, optional
        Its executor must spin in a thread other than the callers of the client. By default the client has its
        own node, context and spinning thread, which need no ``rclpy.init``.
    server : str
        Name of the prediction node.
    timeout : float
        Time to wait for that node to appear [s].

    Notes
    -----
    Methods block until the answer arrives; methods whose names end in ``_async`` return a
    ``concurrent.futures.Future``. Any thread can wait for such a future without an executor. An asyncio
    program awaits it by ``asyncio.wrap_future``.

    Several threads may use one client.
    """

    def __init__(self, node: Node | None = None, *, server: str = "/unc_physics", timeout: float = 10.0):
        if not isinstance(server, str) or not server.strip("/"):
            raise InvalidRequestError("must be the name of a node", field="server", value=server)
        self._server, self._timeout = server.rstrip("/"), positive(timeout, "timeout")
        self._connection = Connection(node, self._server, self._timeout)
        self._models: dict[str, ModelInfo] = {}
        self._pool = ThreadPoolExecutor(_THREADS, "unc_physics client")
        self._subscription = self._connection.node.create_subscription(
            ModelList, f"{self._server}/models", self._keep_models, LATCHED
        )
        self._topics = threading.Lock()
        self._tracked: NewestMessage | None = None
        self._observers: dict[str, Any] = {}
        self._library: ModelLibrary | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Stop waiting for answers and release all resources; a given node is kept."""
        if not self._connection.end():
            return
        self._pool.shutdown(cancel_futures=True)
        self._connection.node.destroy_subscription(self._subscription)
        if self._tracked is not None:
            self._tracked.close()
        for publisher in self._observers.values():
            self._connection.node.destroy_publisher(publisher)
        if self._library is not None:
            self._library.discard()
        self._connection.close()

    def predict(
        self,
        scene: Scene,
        belief: Belief,
        propagator: str | Propagator = DEFAULT,
        horizon: float | None = None,
        **options: Unpack[Options],
    ) -> Prediction:
        """Predict where the bodies of a scene will be, and how certain that is.

        Results beyond means and covariances must be requested here.

        Parameters
        ----------
        scene : Scene
            In the node's world frame. All of its physics is sent and replaces the node's parameters.
        belief : Belief
        propagator : str or Propagator
        horizon : float, optional
            [s]
        times : sequence of float, optional
            Times of the beliefs [s], ascending, as for `unc_physics.predict`. The node computes at all
            multiples of their greatest common divisor.
        seed : int, optional
            Seed of all draws; by default the seed of a `Propagator`. Otherwise the node chooses one
            (`Prediction.seed`).
        samples : int, optional
            Number of samples of a sampled propagator, which replaces its own.
        max_computation_time : float, optional
            Wall time after which the prediction ends with an error [s].
        keep_samples : int, optional
            Number of samples to return at each time (`Prediction.samples`), for any propagator. Messages hold
            their poses; their velocities are NaN.
        events : iterable of Event, optional
            Events for `Prediction.probability` at the horizon, not combined and with their default limits;
            `FellOff` without a support.
        modes : bool
            Whether to return `PredictedBody.modes`.
        joint_covariance : bool, optional
            Whether beliefs hold the joint covariance of all bodies instead of separate ones; by default if
            the propagator estimates it.

        Returns
        -------
        Prediction

        Raises
        ------
        NotActiveError
            If no node with that name answers.
        UnknownModelError, InvalidModelError
            If the node does not have the model of a body, or has a different model with its name.
        NotSupportedError
            If messages cannot describe a part of the scene.
        UncPhysicsError
            The node's error, of the class that `unc_physics.predict` raises. The ``prediction`` of
            `PredictionTimeoutError` ends at the time reached.
        """
        query = make_query(scene, belief, propagator, horizon, **options)
        request = self._request(query)
        answer = self._connection.call(Predict, "predict", Predict.Request(request=request))
        return read_answer(answer.result, answer.prediction, query)

    def predict_async(
        self,
        scene: Scene,
        belief: Belief,
        propagator: str | Propagator = DEFAULT,
        horizon: float | None = None,
        **options: Unpack[Options],
    ) -> Future[Prediction]:
        """Predict as `predict` does, without waiting; the future raises the errors of `predict`."""
        return self._pool.submit(self.predict, scene, belief, propagator, horizon, **options)

    def predict_candidates(
        self,
        scene: Scene,
        candidates: Mapping[str, Belief],
        propagator: str | Propagator = DEFAULT,
        horizon: float | None = None,
        **options: Unpack[Options],
    ) -> dict[str, Prediction]:
        """Predict alternatives of one scene with the same draws, such as several release poses.

        `rank` orders them by a score, with few rollouts for clear losers.

        Parameters
        ----------
        scene : Scene
        candidates : mapping of str to Belief
            One belief for each alternative, by name; with independent bodies.
        propagator, horizon, **options
            As for `predict`; the seed is shared.

        Returns
        -------
        dict of Prediction
            By the candidates' names, in their order.

        Raises
        ------
        UncPhysicsError
            As `predict`; the error of a candidate names it.
        """
        if not candidates:
            raise InvalidRequestError("must name at least one candidate", field="candidates")
        queries = {
            name: make_query(scene, belief, propagator, horizon, **options)
            for name, belief in candidates.items()
        }
        for name, belief in candidates.items():
            if not belief.independent:
                raise NotSupportedError(
                    "must have a covariance for each body, not one of all together",
                    field=f"candidates['{name}']",
                )
        first = next(iter(queries.values()))
        request = PredictCandidates.Request(
            request=self._request(first),
            candidates=[
                write_candidate(name, first, query, self._model_info, f"candidates['{name}']")
                for name, query in queries.items()
            ],
        )
        answer = self._connection.call(PredictCandidates, "predict_candidates", request)
        if not answer.predictions:
            raise read_error(answer.result)
        return {
            entry.candidate: read_candidate(entry, queries[entry.candidate]) for entry in answer.predictions
        }

    def rank(
        self,
        scene: Scene,
        belief: Belief,
        actions: Mapping[str, Action],
        score: Event,
        horizon: float | None = None,
        *,
        rollouts: int = 1000,
        budget: int = 0,
        **options: Unpack[Options],
    ) -> Ranking:
        """Rank actions as `unc_physics.rank` does, by the node.

        Parameters
        ----------
        scene, belief, actions, score, horizon
            As for `unc_physics.rank`. Actions change bodies and the belief about them, not the environment
            and the physics.
        rollouts : int
            Largest number of rollouts of one action.
        budget : int
            Largest number of rollouts of all actions; 0 for the default of `unc_physics.rank`.
        **options
            As for `predict`, except ``samples``.

        Returns
        -------
        Ranking
            Its predictions have the results that ``options`` request.

        Raises
        ------
        NotSupportedError
            If messages cannot describe an action or the score.
        UncPhysicsError
            As `predict`; the error of an action names it.
        """
        instance(actions, Mapping, "actions")
        instance(score, Event, "score")
        if not actions:
            raise InvalidRequestError("must name at least one action", field="actions")
        messages, asked = write_score(score)
        options["events"] = [*options.get("events", ()), *asked]
        options["samples"] = whole_number(rollouts, "rollouts", 32)
        base = make_query(scene, belief, REFERENCE, horizon, **options)
        fields = {name: f"actions[{name!r}]" for name in actions}
        queries = {
            name: make_query(
                *apply_action(scene, belief, action, fields[name]), REFERENCE, horizon, **options
            )
            for name, action in actions.items()
        }
        request = PredictCandidates.Request(
            request=self._request(base),
            candidates=[
                write_candidate(name, base, query, self._model_info, fields[name])
                for name, query in queries.items()
            ],
            score=messages,
            budget=whole_number(budget, "budget", 32),
        )
        answer = self._connection.call(PredictCandidates, "predict_candidates", request)
        return read_ranking(answer, queries, score)

    def predict_long(
        self,
        scene: Scene,
        belief: Belief,
        propagator: str | Propagator = DEFAULT,
        horizon: float | None = None,
        *,
        progress: Callable[[int, int], object] | None = None,
        cancel: threading.Event | None = None,
        **options: Unpack[Options],
    ) -> Prediction:
        """Predict by the node's action, with a longer time limit, progress, and cancellation.

        Parameters
        ----------
        scene, belief, propagator, horizon, **options
            As for `predict`.
        progress : callable, optional
            As for `unc_physics.predict`: called periodically with the number of steps done and the total. An
            exception from it ends the prediction. An `UncPhysicsError` then has a ``prediction`` that ends at
            the time reached.
        cancel : threading.Event, optional
            Ends the prediction when another thread sets it.

        Raises
        ------
        CanceledError
            After ``cancel``; its ``prediction`` ends at the time reached.
        UncPhysicsError
            As `predict`, and exceptions from ``progress``.
        """
        query = make_query(scene, belief, propagator, horizon, **options)
        goal = PredictLong.Goal(request=self._request(query))
        steps = query.marks[-1].count

        def report(feedback):
            if progress is not None:
                progress(min(round(feedback.fraction_done * steps), steps), steps)

        answer, stopped = self._connection.run(PredictLong, "predict_long", goal, report, cancel)
        try:
            prediction = read_answer(answer.result, answer.prediction, query)
        except UncPhysicsError as error:
            if stopped is None:
                raise
            stopped.prediction = error.prediction
            raise stopped from None
        if stopped is not None:  # too late to cancel
            stopped.prediction = prediction
            raise stopped
        return prediction

    def predict_long_async(
        self,
        scene: Scene,
        belief: Belief,
        propagator: str | Propagator = DEFAULT,
        horizon: float | None = None,
        *,
        progress: Callable[[int, int], object] | None = None,
        cancel: threading.Event | None = None,
        **options: Unpack[Options],
    ) -> Future[Prediction]:
        """Predict as `predict_long` does, without waiting; set ``cancel`` to end it."""
        return self._pool.submit(
            self.predict_long, scene, belief, propagator, horizon, progress=progress, cancel=cancel, **options
        )

    def observe(self, name: str, measurement: PoseMeasurement, stamp: float | None = None) -> float:
        """Publish an observation of an object to the node's tracker.

        The first observation of an object waits until the node receives it.

        Parameters
        ----------
        name : str
            Id of the object, which the node's parameter ``observed_objects`` names.
        measurement : PoseMeasurement
            In the node's world frame, with ``origin="model"``.
        stamp : float, optional
            When it was measured [s]; by default when it is published, on the clock of the client's node.

        Returns
        -------
        float
            The stamp [s].

        Raises
        ------
        NotActiveError
            If no node tracks this object.
        """
        instance(measurement, PoseMeasurement, "measurement")
        message = PoseWithCovarianceStamped(pose=write_measurement(measurement))
        node = self._connection.node
        topic = f"{self._server}/observed/{topic_name(name)}"
        with self._topics:
            if name not in self._observers:
                self._observers[name] = node.create_publisher(PoseWithCovarianceStamped, topic, _QUEUED)
            publisher = self._observers[name]
        deadline = time.monotonic() + self._timeout
        while not publisher.get_subscription_count():
            if time.monotonic() > deadline:
                raise NotActiveError(
                    f"has no subscriber within {self._timeout:g} s; start the node with track:=true, and name"
                    " the object in its parameters observed_objects and observed_models",
                    field=topic,
                )
            time.sleep(_DISCOVERY_POLL_PERIOD)
        time_of = node.get_clock().now().nanoseconds if stamp is None else round(1e9 * number(stamp, "stamp"))
        message.header.stamp = stamp_of(time_of)
        if self._tracked is not None:
            self._tracked.skip_old()
        publisher.publish(message)
        return 1e-9 * time_of

    def tracked(self) -> dict[str, TrackedBody]:
        """Wait for the next message of the node's tracker; return the tracked objects by their ids.

        After `reset`, messages from before it do not count. The newest one after it does, without a wait,
        unless `observe` was called meanwhile.

        Raises
        ------
        NotActiveError
            If none arrives: nothing is observed, or no node tracks objects.
        """
        return read_tracked(self._tracked_topic().next(self._timeout))

    def _tracked_topic(self) -> NewestMessage:
        topic = f"{self._server}/tracked"
        with self._topics:
            if self._tracked is None:
                self._tracked = NewestMessage(self._connection.node, TrackedObjects, topic)
            return self._tracked

    def fork(
        self,
        horizon: float | None = None,
        *,
        times: Sequence[float] | None = None,
        robot: Iterable[RigidBody] = (),
        events: Iterable[Event] = (),
        keep_samples: int = 0,
        modes: bool = False,
        joint_covariance: bool = True,
        models: Mapping[str, SpherePacking] | None = None,
    ) -> TrackedPrediction:
        """Predict from what the node's tracker knows, without a scene; the tracker does not change.

        Parameters
        ----------
        horizon : float, optional
            From the tracker's time on [s]; by default the last of ``times``, or of the node's parameter
            ``horizons``.
        times : sequence of float, optional
            Times of the beliefs [s], ascending.
        robot : iterable of RigidBody
            Prescribed bodies, such as a gripper's links. Their paths begin at the tracker's time, and replace
            those of bodies that the tracker has.
        events, keep_samples, modes, joint_covariance
            As for `predict`.
        models : mapping of str to SpherePacking, optional
            The node's models, by name; by default those of the library that comes with the package.

        Returns
        -------
        TrackedPrediction
            Its ``scene`` is the tracked one. Its ``stamp`` is the tracker's time, from which its times count.

        Raises
        ------
        InvalidRequestError
            If nothing is tracked.
        NotActiveError
            If no node tracks objects.
        UncPhysicsError
            As `predict`.
        """
        asked = [positive(one, "times") for one in times or ()]
        if horizon is not None and positive(horizon, "horizon") not in asked:
            asked.append(horizon)
        regions, probabilities = split_events(events)
        joint = bool(joint_covariance)
        outputs = RequestedOutputs(not joint, joint, probabilities, bool(modes), center_of_mass=True)
        keep_samples = whole_number(keep_samples, "keep_samples", 32)
        request = Fork.Request(
            times=[duration(one) for one in asked[:-1]],
            regions=[write_region(region) for region in regions],
            return_samples=keep_samples,
            **outputs.fields(),
        )
        if asked:
            request.horizon = duration(asked[-1])
        links = list(robot)
        if links:
            scene = Scene(links, gravity=(0.0, 0.0, 0.0))
            belief = Belief.of(scene, {})
            request.objects = [write_object(scene, belief, b, self._model_info) for b in range(len(links))]
            request.actions = [action for body in links for action in write_actions(body)]
        answer = self._call_tracker(Fork, "fork", request)
        if answer.result.error_code:
            raise read_error(answer.result)
        if self._library is None:
            self._library = ModelLibrary()
        return read_fork(answer, request, asked, regions, GivenPackings(models or {}, self._library))

    def reset(self, names: Iterable[str] = ()) -> None:
        """Make the node's tracker forget objects, by default all.

        Raises
        ------
        InvalidRequestError
            If a name is unknown; nothing is forgotten then.
        """
        forgotten, tracked = set(names), self._tracked_topic()

        def is_after(message):
            known = {own.id for own in message.objects}
            return not (known & forgotten if forgotten else known)

        with tracked.from_first(is_after) as wait:
            answer = self._call_tracker(Reset, "reset", Reset.Request(ids=list(forgotten)))
            if answer.result.error_code:
                raise read_error(answer.result)
            if not wait(_RESET_TIMEOUT) and not forgotten:  # the topic is not connected yet
                tracked.set(TrackedObjects())

    def _call_tracker(self, service_type: Any, name: str, request: Any) -> Any:
        """Return the answer of a tracker's service; raise `NotActiveError` if the node does not track."""
        if not self._connection.offers(service_type, name) and "tracking" not in self.capabilities().features:
            raise NotActiveError(
                "is not offered, as the node does not track; start it with track:=true",
                field=f"{self._server}/{name}",
            )
        return self._connection.call(service_type, name, request)

    def capabilities(self) -> GetCapabilities.Response:
        """Return the node's propagators with traits and options, features, limits, physics and versions."""
        return self._connection.call(GetCapabilities, "get_capabilities", GetCapabilities.Request())

    def models(self) -> dict[str, ModelInfo]:
        """Return the models of the node by name."""
        answer = self._connection.call(ListModels, "list_models", ListModels.Request())
        self._keep_models(answer)
        return dict(self._models)

    def load_model(
        self, path: str | PathLike[str], name: str = "", *, replace: bool = False, spheres: int = 0
    ) -> ModelInfo:
        """Make the node read a model file or pack a mesh; return when the model is ready.

        Parameters
        ----------
        path : path
            Path of an ``.npz`` or a mesh, on the node's machine.
        name : str, optional
            By default the name in the file, or the file's name.
        replace : bool
            Whether it may replace a model of the same name.
        spheres : int, optional
            Number of spheres of a mesh; by default the node's number.

        Raises
        ------
        InvalidModelError, InvalidMeshError, DuplicateIdError
            If the file is not a model, or the name is taken.
        """
        request = LoadModel.Request(path=str(path), name=name, replace=replace, spheres=spheres)
        answer = self._connection.call(LoadModel, "load_model", request)
        if answer.result.error_code:
            raise read_error(answer.result)
        info = answer.model
        while info.status == ModelInfo.STATUS_PACKING:
            time.sleep(_PACKING_POLL_PERIOD)
            info = self.models()[info.name]
        self.models()
        if info.status == ModelInfo.STATUS_FAILED:
            raise InvalidModelError(f"could not be loaded: {info.status_msg}", field=info.name)
        return info

    def _request(self, query: Query) -> PredictionRequest:
        """Return the message; fetch the node's models again if a model seems to differ."""
        try:
            return write_request(query, self._model_info)
        except InvalidModelError:
            self.models()
            return write_request(query, self._model_info)

    def _model_info(self, name: str) -> ModelInfo:
        if name not in self._models and name not in self.models():
            raise UnknownModelError(
                "is not known to the node; client.load_model(path) gives it the file, which"
                " save_packing(path, model) writes",
                field="model",
                value=name,
            )
        return self._models[name]

    def _keep_models(self, message: Any) -> None:
        self._models = {info.name: info for info in message.models}
