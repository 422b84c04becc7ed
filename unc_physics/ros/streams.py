"""Streams: predict scenes from topics, and publish predictions for several horizons."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.qos import QoSProfile, ReliabilityPolicy

from unc_physics_msgs.msg import ObjectState, Prediction, PredictionRequest, Result, Scene

from ..checks.errors import ErrorCode, UncPhysicsError
from .markers import MarkerTopic
from .messages.fields import duration, seconds
from .messages.prediction import write_answer
from .messages.request import read_request
from .messages.scene import UNKNOWN
from .models import ModelLibrary
from .parameters import ParameterServer, Settings

_SAME_TIME = 1e-6  # s
_REPORT_PERIOD = 5.0  # s, between warnings in the log
# best effort matches all publishers, including sensors
_NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
_SEED = 1  # equal for all scenes, so that equal scenes have equal predictions


class Stream:
    """Predictions of each scene from ``~/scene``, from trackers, or from detectors."""

    def __init__(self, server):
        self._server = server
        node = server.node
        self._predictions = node.create_publisher(Prediction, "~/predictions", 1)
        self._markers = MarkerTopic(server, "~/stream_markers")
        self._poses = {}
        self._topics = SceneTopics(
            node, server.parameters, server.library, self._predict, server.diagnostics.replaced
        )

    def close(self):
        """Withdraw the topics."""
        node = self._server.node
        self._topics.close()
        for publisher in (self._predictions, *self._poses.values()):
            node.destroy_publisher(publisher)
        self._markers.close()

    def _predict(self, scene):
        """Predict a scene and publish the result; errors go to the log and the diagnostics."""
        server, settings = self._server, self._server.settings
        result = Result()
        with server.errors_into(result):
            if (reason := stamp_problem(server.node, scene.header.stamp, settings)) is not None:
                server.diagnostics.dropped()
                self._warn(f"a scene was dropped: {reason}")
                return
            job = read_request(
                request_of(scene, settings),
                settings,
                server.library,
                server.frames,
                time_limit=settings.max_computation_time,
            )
            job = job._replace(times=sorted(set(settings.horizons))[:-1])
            message = Prediction()
            write_answer(message, scene.header, settings, job, server.predict(job))
            self._predictions.publish(message)
            self._publish_poses(message, settings)
            self._markers.publish(scene.header, job, message)
            server.diagnostics.skipped(len(message.skipped))
            for skipped in message.skipped:
                self._warn(f"object '{skipped.key}' was left out: {skipped.value}")
            if (delay := stamp_age(server.node, scene.header.stamp)) is not None:
                server.diagnostics.delayed(delay)
        if result.error_code not in (ErrorCode.NONE, ErrorCode.CANCELED):
            self._warn(f"a scene was not predicted: {result.error_msg}")

    def _warn(self, text):
        self._server.log.warning(text, throttle_duration_sec=_REPORT_PERIOD)

    def _publish_poses(self, message, settings):
        for predicted in message.objects:
            if predicted.id not in settings.pose_objects:
                continue
            for state in predicted.states:
                if abs(seconds(state.time_from_start) - settings.pose_horizon) < _SAME_TIME:
                    self._pose_publisher(predicted.id).publish(
                        PoseWithCovarianceStamped(header=message.header, pose=state.pose)
                    )

    def _pose_publisher(self, name):
        if name not in self._poses:
            topic = f"~/predicted_pose/{topic_name(name)}"
            self._poses[name] = self._server.node.create_publisher(PoseWithCovarianceStamped, topic, 1)
        return self._poses[name]


class SceneTopics:
    """Sources of streamed scenes: whole scenes, tracked objects and detections.

    Each source has its own thread, so that none waits for the transforms of another.

    Parameters
    ----------
    node : rclpy Node
    parameters : ParameterServer
    library : ModelLibrary
    work : callable
        Takes the latest Scene of a source; must not raise.
    replaced : callable
        Called without arguments for each scene that a newer one replaced.
    under : str
        Namespace of the topics ``scene`` and ``detections``.
    """

    def __init__(
        self,
        node,
        parameters: ParameterServer,
        library: ModelLibrary,
        work: Callable[[Scene], object],
        replaced: Callable[[], object],
        under: str = "~",
    ):
        self._node, self._parameters, self._library = node, parameters, library
        self._work, self._replaced = work, replaced
        self._sources: list[LatestWorker] = []
        self._tracked: dict[str, Any] = {}  # header and state of each topic's newest pose
        self._subscriptions = [node.create_subscription(Scene, f"{under}/scene", self._source().put, _NEWEST)]
        settings = parameters.settings
        topics = [
            pair for pair in zip(settings.tracked_topics, settings.tracked_models, strict=True) if pair[0]
        ]
        if topics:
            self._of_trackers = self._source()
        for topic, model in topics:
            self._subscriptions.append(
                node.create_subscription(
                    PoseWithCovarianceStamped,
                    topic,
                    lambda message, topic=topic, model=model: self._track(topic, model, message),
                    _NEWEST,
                )
            )
        try:
            from vision_msgs.msg import Detection3DArray  # pyright: ignore[reportMissingImports]  (optional)
        except ImportError:
            pass
        else:
            self._of_detectors = self._source()
            self._subscriptions.append(
                node.create_subscription(Detection3DArray, f"{under}/detections", self._detect, _NEWEST)
            )

    def _source(self):
        self._sources.append(LatestWorker(self._work, self._replaced))
        return self._sources[-1]

    def close(self) -> None:
        """Withdraw the topics."""
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        for source in self._sources:
            source.close()

    def _track(self, topic, model, message):
        """Pass on the scene of all currently tracked objects."""
        settings = self._parameters.settings
        state = _object_of_unknown_velocity(topic, model, message.pose, self._library, settings.tracked_mass)
        self._tracked[topic] = message.header, state
        frame = message.header.frame_id
        objects = [
            state
            for header, state in self._tracked.values()
            if header is message.header
            or (header.frame_id == frame and stamp_problem(self._node, header.stamp, settings) is None)
        ]
        self._of_trackers.put(Scene(header=message.header, objects=objects))

    def _detect(self, detections):
        """Pass on the scene of all detections."""
        settings = self._parameters.settings
        if (scene := scene_of_detections(detections, self._library, settings.tracked_mass)).objects:
            self._of_detectors.put(scene)


class LatestWorker:
    """Thread that processes the latest item; a new item replaces a waiting one.

    Parameters
    ----------
    work : callable
        Takes one item; must not raise.
    replaced : callable
        Called without arguments for each replaced item.
    """

    def __init__(self, work, replaced):
        self._work, self._replaced = work, replaced
        self._items = []
        self._changed = threading.Condition()
        self._closed = False
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def put(self, item) -> None:
        """Replace the waiting item."""
        with self._changed:
            late = bool(self._items)
            self._items = [item]
            self._changed.notify()
        if late:
            self._replaced()

    def close(self) -> None:
        """Wait until the current item is done; drop the waiting one."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join()

    def _run(self):
        while True:
            with self._changed:
                while not (self._items or self._closed):
                    self._changed.wait()
                if self._closed:
                    return
                item = self._items.pop()
            self._work(item)


def request_of(scene: Scene, settings: Settings) -> PredictionRequest:
    """Return the request for a streamed scene from the parameters."""
    return PredictionRequest(
        scene=scene,
        horizon=duration(max(settings.horizons)),
        propagator=settings.stream_propagator,
        seed=_SEED,
        return_probabilities=settings.stream_probabilities,
        skip_unknown_models=True,
    )


def stamp_age(node, stamp) -> float | None:
    """Return the time since a stamp [s] by the node's clock; None for a zero stamp."""
    if stamp.sec == 0 and stamp.nanosec == 0:
        return None
    now = node.get_clock().now().nanoseconds
    return 1e-9 * (now - stamp.sec * 1_000_000_000 - stamp.nanosec)  # rclpy's Time has no negative values


def stamp_problem(node, stamp, settings) -> str | None:
    """Return why an input is dropped because of its stamp; None if it is valid."""
    if (old := stamp_age(node, stamp)) is None:
        return None
    if settings.max_input_age and old > settings.max_input_age:
        what = f"{old:.3g} s old, and max_input_age is {settings.max_input_age:g} s"
    elif settings.max_input_lead and -old > settings.max_input_lead:
        what = f"{-old:.3g} s in the future, and max_input_lead is {settings.max_input_lead:g} s"
    else:
        return None
    return f"its stamp is {what}; do all clocks agree, and all nodes have the same use_sim_time?"


def scene_of_detections(detections, library, mass) -> Scene:
    """Return the scene of a Detection3DArray.

    The best hypothesis of each detection names its model; detections without hypotheses are omitted.
    """
    objects, names = [], set()
    for k, detection in enumerate(detections.detections):
        if detection.results:
            best = max(detection.results, key=lambda result: result.hypothesis.score)
            name = detection.id or f"{best.hypothesis.class_id}_{k}"
            if name in names:  # some detectors write the class into the id
                name = f"{name}_{k}"
            names.add(name)
            objects.append(
                _object_of_unknown_velocity(name, best.hypothesis.class_id, best.pose, library, mass)
            )
    return Scene(header=detections.header, objects=objects)


def _object_of_unknown_velocity(name, model, pose, library, mass):
    """Return an object with unknown velocity, with the given mass [kg] if its model has none."""
    state = ObjectState(id=name, model=model, pose=pose.pose)
    state.belief.pose_covariance = pose.covariance
    state.belief.twist_covariance[0] = UNKNOWN
    try:
        state.mass = mass if library.shape(model).mass is None else 0.0
    except UncPhysicsError:
        pass  # reported when the scene is read
    return state


def topic_name(text: str) -> str:
    """Return a text as the last part of a topic name."""
    name = re.sub(r"[^A-Za-z0-9_]", "_", text)
    return name if name[:1].isalpha() else f"_{name}"
