"""A client of the node for those who have a `Scene` and a `Belief`: the library's own call, over ROS."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from os import PathLike
from typing import TYPE_CHECKING, Any, TypedDict

import numpy as np
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from unc_physics_msgs.action import PredictLong
from unc_physics_msgs.msg import Candidate, ModelInfo, ModelList, PredictionRequest, Result
from unc_physics_msgs.srv import GetCapabilities, ListModels, LoadModel, Predict, PredictCandidates

from ..checks.errors import (
    InvalidModelError,
    InvalidRequestError,
    LimitExceededError,
    NotSupportedError,
    UncPhysicsError,
    UnknownModelError,
    error_of,
)
from ..checks.validation import instance, integer, positive
from ..prediction.actions import Action, apply_action
from ..prediction.events import Event
from ..prediction.predict import check_supported, steps_of
from ..prediction.prediction import Prediction
from ..prediction.rank import Ranking
from ..prediction.regions import BoxRegion, checked_regions
from ..propagators.base import Propagator
from ..propagators.names import DEFAULT, REFERENCE
from ..propagators.registry import make_propagator
from ..scene.belief import Belief
from ..scene.scene import Scene
from .connection import Connection
from .prediction_reader import read_answer
from .ranking_messages import changed_objects, read_ranking
from .request_writer import Question, write_object, write_request
from .scores import write_score

if TYPE_CHECKING:
    from typing_extensions import Self, Unpack

_LATCHED = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
_THREADS = 8  # as the node's own: so many of its answers are waited for side by side
_LOOK_AT_PACKING = 0.2  # s


class Options(TypedDict, total=False):
    """The keywords of `Client.predict`, for those of its other methods that take them, too."""

    times: Sequence[float] | None
    seed: int | None
    samples: int | None
    max_computation_time: float | None
    keep_samples: int
    regions: BoxRegion | Sequence[BoxRegion]
    probabilities: bool
    modes: bool
    joint_covariance: bool | None


class Client:
    """Asks a node what `unc_physics.predict` would answer, with the same arguments and the same answer.

    For example::

        with Client() as client:
            prediction = client.predict(scene, belief, "sigma_points", horizon=1.0)
            prediction["mug"].position, prediction["mug"].position_std

    The node must have the models of the scene's bodies, by their packings' names (`load_model`).

    Parameters
    ----------
    node : rclpy Node, optional
        Whose executor spins in another thread than those that call the client. By default the client has a
        node, a context and a spinning thread of its own, which need no ``rclpy.init``.
    server : str
        Name of the node that predicts.
    timeout : float
        How long to wait for that node to appear [s].

    Notes
    -----
    Methods block until the answer is there; those whose names end in ``_async`` return a
    ``concurrent.futures.Future`` of it. rclpy's own futures cannot be waited for without an executor at hand;
    these can, in any thread, and an asyncio program awaits them by ``asyncio.wrap_future``.

    Several threads may use one client.
    """

    def __init__(self, node: Node | None = None, *, server: str = "/unc_physics", timeout: float = 10.0):
        if not isinstance(server, str) or not server.strip("/"):
            raise InvalidRequestError("must be the name of a node", field="server", value=server)
        self._server = server.rstrip("/")
        self._connection = Connection(node, self._server, positive(timeout, "timeout"))
        self._models: dict[str, ModelInfo] = {}
        self._pool = ThreadPoolExecutor(_THREADS, "unc_physics client")
        self._subscription = self._connection.node.create_subscription(
            ModelList, f"{self._server}/models", self._keep_models, _LATCHED
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Wait no longer for answers, and take everything back; a node that was given stays as it was."""
        if not self._connection.end():
            return
        self._pool.shutdown(cancel_futures=True)
        self._connection.node.destroy_subscription(self._subscription)
        self._connection.close()

    def predict(
        self,
        scene: Scene,
        belief: Belief,
        propagator: str | Propagator = DEFAULT,
        horizon: float | None = None,
        *,
        times: Sequence[float] | None = None,
        seed: int | None = None,
        samples: int | None = None,
        max_computation_time: float | None = None,
        keep_samples: int = 0,
        regions: BoxRegion | Sequence[BoxRegion] = (),
        probabilities: bool = False,
        modes: bool = False,
        joint_covariance: bool | None = None,
    ) -> Prediction:
        """Predict where the bodies of a scene will be, and how surely.

        What the answer's methods tell beyond means and covariances must be asked for here.

        Parameters
        ----------
        scene : Scene
            In the node's world frame. All of its physics is sent; the node's parameters do not count.
        belief : Belief
        propagator : str or Propagator
        horizon : float, optional
            [s]
        times : sequence of float, optional
            Times at which a belief is wanted [s], ascending, as for `unc_physics.predict`. The node computes
            at all multiples of their greatest common divisor.
        seed : int, optional
            Of all draws; by default that of a `Propagator` that has one, and otherwise one that the node
            chooses and `Prediction.seed` tells.
        samples : int, optional
            Number of samples of a sampled propagator, in place of its own.
        max_computation_time : float, optional
            Wall time after which the prediction ends with an error [s].
        keep_samples : int, optional
            How many samples to return at each of the times (`Prediction.kept`, and `Prediction.samples` at
            the horizon), of any propagator. Messages hold their poses; their velocities are NaN.
        regions : BoxRegion or sequence of BoxRegion, optional
            That `PredictedBody.probability_in` will be asked for.
        probabilities : bool
            Whether `PredictedBody.contact_with` and `PredictedBody.rest_probability` will be.
        modes : bool
            Whether `PredictedBody.modes` will be.
        joint_covariance : bool, optional
            Whether beliefs hold the covariance of all bodies together, instead of each body's own; by default
            where the propagator keeps it.

        Returns
        -------
        Prediction

        Raises
        ------
        NotActiveError
            If no node of that name answers.
        UnknownModelError, InvalidModelError
            If the node does not have the model of a body, or another one of its name.
        NotSupportedError
            If messages have no room for what the scene holds.
        UncPhysicsError
            What the node refuses, of the class that `unc_physics.predict` raises. The ``prediction`` of
            `PredictionTimeoutError` ends at the time reached.
        """
        question = self._question(
            scene,
            belief,
            propagator,
            horizon,
            times=times,
            seed=seed,
            samples=samples,
            max_computation_time=max_computation_time,
            keep_samples=keep_samples,
            regions=regions,
            probabilities=probabilities,
            modes=modes,
            joint_covariance=joint_covariance,
        )
        request = self._request(question)
        answer = self._connection.call(Predict, "predict", Predict.Request(request=request))
        return read_answer(answer.result, answer.prediction, question)

    def predict_async(
        self,
        scene: Scene,
        belief: Belief,
        propagator: str | Propagator = DEFAULT,
        horizon: float | None = None,
        **options: Unpack[Options],
    ) -> Future[Prediction]:
        """As `predict`, without waiting; the future raises what `predict` does."""
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
            One for each alternative, by a name of its own; each body is known independently of the others.
        propagator, horizon, **options
            As for `predict`; the seed is one for all.

        Returns
        -------
        dict of Prediction
            By the candidates' names, in their order.

        Raises
        ------
        UncPhysicsError
            As `predict`, for the first candidate that has an error, which it names.
        """
        if not candidates:
            raise InvalidRequestError("must name at least one candidate", field="candidates")
        questions = {
            name: self._question(scene, belief, propagator, horizon, **options)
            for name, belief in candidates.items()
        }
        for name, belief in candidates.items():
            if not belief.independent:
                raise NotSupportedError(
                    "must have a covariance for each body, not one of all together",
                    field=f"candidates['{name}']",
                )
        first = next(iter(questions.values()))
        request = PredictCandidates.Request(
            request=self._request(first),
            candidates=[
                Candidate(id=name, objects=self._changed(scene, first.belief, belief))
                for name, belief in candidates.items()
            ],
        )
        answer = self._connection.call(PredictCandidates, "predict_candidates", request)
        if not answer.predictions:
            raise error_of(answer.result.error_code or Result.INTERNAL, answer.result.error_msg)
        found = {}
        for told in answer.predictions:
            try:
                found[told.candidate] = read_answer(told.result, told.prediction, questions[told.candidate])
            except UncPhysicsError as error:
                named = type(error)(f"{error} in candidate '{told.candidate}'")
                named.prediction = error.prediction
                raise named from None
        return found

    def rank(
        self,
        scene: Scene,
        belief: Belief,
        actions: Mapping[str, Action],
        score: Event,
        horizon: float | None = None,
        *,
        smallest_first: bool = False,
        rollouts: int = 1000,
        budget: int = 0,
        **options: Unpack[Options],
    ) -> Ranking:
        """As `unc_physics.rank`, by the node.

        Parameters
        ----------
        scene, belief, actions, score, horizon, smallest_first
            As for `unc_physics.rank`. Actions change bodies and what is known of them; the environment and
            the physics are one for all.
        rollouts : int
            Most of one action.
        budget : int
            Most of all actions together; 0 for that of `unc_physics.rank`.
        **options
            As for `predict`, but for ``samples``.

        Returns
        -------
        Ranking
            Its predictions answer what ``options`` ask for.

        Raises
        ------
        NotSupportedError
            If messages have no room for an action or the score.
        UncPhysicsError
            As `predict`, and for the first action that has an error, which it names.
        """
        instance(actions, Mapping, "actions")
        instance(score, Event, "score")
        if not actions:
            raise InvalidRequestError("must name at least one action", field="actions")
        messages, asked = write_score(score, smallest_first)
        regions = checked_regions(options.pop("regions", ()))
        options["regions"] = [*regions, *(region for region in asked if region not in regions)]
        options["samples"] = _whole(rollouts, "rollouts", 32)
        base = self._question(scene, belief, REFERENCE, horizon, **options)
        fields = {name: f"actions[{name!r}]" for name in actions}
        questions = {
            name: self._question(
                *apply_action(scene, belief, action, fields[name]), REFERENCE, horizon, **options
            )
            for name, action in actions.items()
        }
        request = PredictCandidates.Request(
            request=self._request(base),
            candidates=[
                Candidate(id=name, objects=changed_objects(base, question, self._model_info, fields[name]))
                for name, question in questions.items()
            ],
            score=messages,
            budget=_whole(budget, "budget", 32),
        )
        answer = self._connection.call(PredictCandidates, "predict_candidates", request)
        return read_ranking(answer, questions, score, smallest_first)

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
        """As `predict`, by the node's action: without its time limit, with progress, and to be canceled.

        Parameters
        ----------
        scene, belief, propagator, horizon, **options
            As for `predict`.
        progress : callable, optional
            As for `unc_physics.predict`: called now and then with the number of steps done and of all steps.
            What it raises ends the prediction; an `UncPhysicsError` then has a ``prediction`` that ends at
            the time reached.
        cancel : threading.Event, optional
            Ends the prediction when another thread sets it.

        Raises
        ------
        CanceledError
            After ``cancel``; its ``prediction`` ends at the time reached.
        UncPhysicsError
            As `predict`, and what ``progress`` raises.
        """
        question = self._question(scene, belief, propagator, horizon, **options)
        goal = PredictLong.Goal(request=self._request(question))
        steps = question.steps[-1]

        def look(feedback):
            if progress is not None:
                progress(min(round(feedback.fraction_done * steps), steps), steps)

        answer, stopped = self._connection.run(PredictLong, "predict_long", goal, look, cancel)
        try:
            prediction = read_answer(answer.result, answer.prediction, question)
        except UncPhysicsError as error:
            if stopped is None:
                raise
            stopped.prediction = error.prediction
            raise stopped from None
        if stopped is not None:  # too late to be canceled
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
        """As `predict_long`, without waiting; ``cancel`` is how to end it."""
        return self._pool.submit(
            self.predict_long, scene, belief, propagator, horizon, progress=progress, cancel=cancel, **options
        )

    def capabilities(self) -> GetCapabilities.Response:
        """Propagators with their traits and options, features, limits, physics and versions of the node."""
        return self._connection.call(GetCapabilities, "get_capabilities", GetCapabilities.Request())

    def models(self) -> dict[str, ModelInfo]:
        """The models that the node knows, by name."""
        answer = self._connection.call(ListModels, "list_models", ListModels.Request())
        self._keep_models(answer)
        return dict(self._models)

    def load_model(
        self, path: str | PathLike[str], name: str = "", *, replace: bool = False, spheres: int = 0
    ) -> ModelInfo:
        """Let the node read a model's file or pack a mesh; returns when the model is ready.

        Parameters
        ----------
        path : path
            Of an ``.npz`` or a mesh, where the node runs.
        name : str, optional
            By default that in the file, or the file's.
        replace : bool
            Whether it may replace a model of that name.
        spheres : int, optional
            Of a mesh: how many to pack it with; by default the node's number.

        Raises
        ------
        InvalidModelError, InvalidMeshError, DuplicateIdError
            For a file that is no model, or a name that is taken.
        """
        request = LoadModel.Request(path=str(path), name=name, replace=replace, spheres=spheres)
        answer = self._connection.call(LoadModel, "load_model", request)
        if answer.result.error_code:
            raise error_of(answer.result.error_code, answer.result.error_msg)
        info = answer.model
        while info.status == ModelInfo.STATUS_PACKING:
            time.sleep(_LOOK_AT_PACKING)
            info = self.models()[info.name]
        self.models()
        if info.status == ModelInfo.STATUS_FAILED:
            raise InvalidModelError(f"could not be loaded: {info.status_msg}", field=info.name)
        return info

    def _question(
        self,
        scene,
        belief,
        propagator,
        horizon,
        *,
        times=None,
        seed=None,
        samples=None,
        max_computation_time=None,
        keep_samples=0,
        regions=(),
        probabilities=False,
        modes=False,
        joint_covariance=None,
    ) -> Question:
        """The arguments of `predict`, checked."""
        instance(scene, Scene, "scene")
        instance(belief, Belief, "belief")
        instance(propagator, (str, Propagator), "propagator")
        belief.check_fits(scene)
        if isinstance(propagator, str):
            propagator = make_propagator(propagator)
        elif seed is None:
            seed = getattr(propagator, "seed", None)
        given = {"seed": seed, "samples": samples}
        known = propagator.options()
        propagator = replace(
            propagator,
            **{name: value for name, value in given.items() if value is not None and name in known},
        )
        check_supported(scene, propagator)
        allowed = max_computation_time
        return Question(
            scene,
            belief,
            propagator,
            None if seed is None else _whole(seed, "seed", 64),
            steps_of(scene, horizon, times),
            None if allowed is None else positive(allowed, "max_computation_time"),
            _whole(keep_samples, "keep_samples", 32),
            checked_regions(regions),
            bool(probabilities),
            bool(modes),
            propagator.traits.cross_body if joint_covariance is None else bool(joint_covariance),
        )

    def _request(self, question: Question) -> PredictionRequest:
        """The message, after a look at the node's models again where one seems to be another."""
        try:
            return write_request(question, self._model_info)
        except InvalidModelError:
            self.models()
            return write_request(question, self._model_info)

    def _changed(self, scene, base, belief):
        """States of the bodies that a belief tells otherwise than the base."""
        differs = (base.mean != belief.mean).any(axis=1)
        for b in scene.moving.tolist():
            differs[b] |= not np.array_equal(base.marginal(b), belief.marginal(b))
        return [write_object(scene, belief, int(b), self._model_info) for b in np.flatnonzero(differs)]

    def _model_info(self, name: str) -> ModelInfo:
        if name not in self._models and name not in self.models():
            raise UnknownModelError(
                "is not known to the node; client.load_model(path) gives it the file",
                field="model",
                value=name,
            )
        return self._models[name]

    def _keep_models(self, message: Any) -> None:
        self._models = {info.name: info for info in message.models}


def _whole(value, field, bits):
    """A number that a message's field of so many bits can hold."""
    value = integer(value, field, low=0)
    if value >= 2**bits:
        raise LimitExceededError(f"must be below 2^{bits}", field=field, value=value)
    return value
