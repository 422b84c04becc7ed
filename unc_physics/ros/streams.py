"""Streams: predict scenes from topics, and publish predictions for several horizons."""

from __future__ import annotations

import contextlib
import copy
import itertools
import re
import statistics
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import MappingProxyType
from typing import Any, NamedTuple

from diagnostic_msgs.msg import KeyValue
from geometry_msgs.msg import PoseWithCovariance, PoseWithCovarianceStamped, TransformStamped, Vector3
from rclpy.clock import JumpThreshold
from rclpy.duration import Duration
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from std_msgs.msg import Header

from unc_physics_msgs.msg import Prediction, PredictionRequest, Scene

from ..checks.errors import PredictionTimeoutError, UncPhysicsError
from ..propagators.base import Anytime, Propagator
from .detected import Detection3DArray, detected_object, scene_of_detections, settle_detected
from .environment import NodeEnvironment
from .markers import MarkerTopic, OccupancyTopics
from .messages.fields import duration, nanoseconds, seconds
from .messages.frames import Frames
from .messages.prediction import write_answer
from .messages.scene import AllSkippedError
from .models import ModelLibrary
from .parameters import ParameterServer, Settings

#: End of the names of frames of predicted and of tracked objects, after the object's id.
PREDICTED, TRACKED = "_predicted", "_tracked"
_SAME_TIME = 1e-6  # s
_REPORT_PERIOD = 5.0  # s, between warnings in the log
#: Depth, history and reliability have parameters such as ``qos_overrides./TOPIC.subscription.depth``.
_OVERRIDABLE = QoSOverridingOptions.with_default_policies()
_WAITING = 16  # scenes that wait for a transform at a time
_SHORTEST = 1e-3  # s, time limit of a scene that is nearly too old
_SEED = 1  # equal for all scenes, so that equal scenes have equal predictions

_INTERVALS = 5  # of the input, whose median is its period
_SHARES = 1.0, 0.75, 0.5, 0.375  # of a propagator's rollouts
_FEWEST = 12  # rollouts
_SHARE_OF_PERIOD = 0.5
_ROOM = 0.8  # share of the limit that more rollouts may take

_NONE: Mapping[str, str] = MappingProxyType({})


class Pace:
    """Rate of an input, and the share of rollouts with which its predictions keep their time limit."""

    def __init__(self):
        self._arrivals: deque[float] = deque(maxlen=_INTERVALS + 1)
        self._level = 0

    def reset(self) -> None:
        """Forget the input's rate; the share of rollouts stays."""
        self._arrivals.clear()

    def arrived(self) -> None:
        """Record an input."""
        self._arrivals.append(time.monotonic())

    def limit(self, asked: float) -> float | None:
        """Return the longest computation time [s]; None while the rate of the input is unknown.

        Parameters
        ----------
        asked : float
            The parameter ``stream_max_computation_time`` [s]; 0: half the input's period.
        """
        if asked:
            return asked
        times = list(self._arrivals)
        if len(times) < 3:
            return None
        period = statistics.median(later - earlier for earlier, later in itertools.pairwise(times))
        return _SHARE_OF_PERIOD * period

    def adapted(self, propagator: Propagator, limit: float | None) -> Propagator:
        """Return the propagator with as many rollouts as its last predictions had time for."""
        fitted: Any = propagator
        if limit is None:
            return propagator
        if isinstance(propagator, Anytime):
            return replace(fitted, time=limit)
        for option in ("runs", "samples"):
            if (count := getattr(propagator, option, 0)) > _FEWEST:
                return replace(fitted, **{option: max(_FEWEST, round(_SHARES[self._level] * count))})
        return propagator

    def took(self, seconds: float, limit: float | None) -> None:
        """Adapt the share of rollouts to the time that a prediction took [s]."""
        if limit is None:
            return
        if seconds > limit:
            fitting = _SHARES[self._level] * limit / seconds
            lower = range(self._level + 1, len(_SHARES))
            self._level = next((k for k in lower if _SHARES[k] <= fitting), len(_SHARES) - 1)
        elif self._level and seconds * _SHARES[self._level - 1] / _SHARES[self._level] < _ROOM * limit:
            self._level -= 1


class StreamedScene(NamedTuple):
    """Input of a stream.

    Attributes
    ----------
    scene : Scene
        In the frame of its header.
    detected : bool
        Whether its objects were detected, so that supports decide which of them are at rest.
    pace : Pace
        Of the scene's source.
    problem : UncPhysicsError or None
        Reason why the scene cannot be predicted.
    skipped : dict of str
        Reasons of omitted objects, by id.
    """

    scene: Scene
    detected: bool
    pace: Pace
    problem: UncPhysicsError | None = None
    skipped: Mapping[str, str] = _NONE


class Stream:
    """Predictions of each scene from ``~/scene``, from trackers, or from detectors."""

    def __init__(self, server):
        self._server = server
        node = server.node
        self._predictions = node.create_publisher(
            Prediction, "~/predictions", 1, qos_overriding_options=_OVERRIDABLE
        )
        self._transforms = TransformTopic(server)
        self._markers = MarkerTopic(server, "~/stream_markers")
        self._occupancy = OccupancyTopics(server)
        self._poses = {}
        self._topics = SceneTopics(
            node, server.parameters, server.library, server.frames, self._work, self._replaced
        )

    @property
    def is_wanted(self) -> bool:
        """Whether anybody receives predictions."""
        settings = self._server.settings
        topics = self._predictions, self._markers, self._occupancy
        own = any(topic.get_subscription_count() for topic in topics)
        return own or settings.publish_tf or any(settings.pose_objects)

    def close(self):
        """Withdraw the topics."""
        node = self._server.node
        self._topics.close()
        for publisher in (self._predictions, *self._poses.values()):
            node.destroy_publisher(publisher)
        self._markers.close()
        self._occupancy.close()
        self._transforms.close()

    def _work(self, streamed):
        """Predict a scene, and adapt the rollouts of later ones to the time that it took."""
        began = time.perf_counter()
        limit = streamed.pace.limit(self._server.settings.stream_max_computation_time)
        published = self._predict(streamed, limit)
        took = time.perf_counter() - began
        streamed.pace.took(took, limit)
        if published and limit is not None and took > limit:
            counts = self._server.diagnostics.predictions
            counts.add("late predictions")
            counts.warn(f"late: a prediction took {took:.3g} s, and the stream's limit is {limit:.3g} s")

    def _replaced(self):
        self._server.diagnostics.predictions.add("replaced inputs")

    def _predict(self, streamed, limit):
        """Predict a scene and publish the result; errors go to the log and the diagnostics.

        Returns whether a prediction was published.
        """
        server, settings, header = self._server, self._server.settings, streamed.scene.header
        published = False
        with server.errors_to(lambda problem: self._warn(f"a scene was not predicted: {problem}")):
            if (reason := stamp_problem(server.node, header.stamp, settings)) is not None:
                server.diagnostics.predictions.add("dropped inputs")
                self._warn(f"a scene was dropped: {reason}")
                return False
            scene, skipped = prepared(streamed, server.frames, server.environment, server.library, settings)
            message = Prediction()
            if self._is_over(header.stamp):
                return False
            job = None
            try:
                if scene.objects:
                    job = self._job(streamed, scene, limit, settings)
                    job = replace(job, skipped=job.skipped | skipped)
            except AllSkippedError as error:
                skipped = error.skipped | skipped
            if job is not None:
                try:
                    write_answer(message, header, settings, job, server.predict(job))
                except PredictionTimeoutError:
                    if self._is_over(header.stamp):
                        return False
                    raise
            else:
                message.header.stamp, message.header.frame_id = header.stamp, settings.world_frame
                message.skipped = [KeyValue(key=name, value=reason) for name, reason in skipped.items()]
            if not self._is_over(header.stamp):
                self.publish(message, job)
                published = True
        return published

    def _job(self, streamed, scene, limit, settings):
        """Return the job of a scene, with the rollouts and the time that the stream leaves it."""
        server = self._server
        allowed, age = settings.max_computation_time, stamp_age(server.node, scene.header.stamp)
        if age is not None:  # its horizon must not pass meanwhile
            allowed = min(allowed, max(settings.horizons) - age)
        job = server.read(request_of(scene, settings), time_limit=max(allowed, _SHORTEST))
        return replace(
            job,
            times=sorted(set(settings.horizons))[:-1],
            propagator=streamed.pace.adapted(job.propagator, limit),
        )

    def publish(self, message, job) -> None:
        """Publish a prediction, with poses, markers and occupancy; ``job`` is None if it is empty."""
        server, settings = self._server, self._server.settings
        self._predictions.publish(message)
        if job is not None:
            self._publish_poses(message, settings)
            self._markers.publish(message.header, job, message)
            self._occupancy.publish(job, message)
        counts = server.diagnostics.predictions
        counts.add("skipped objects", len(message.skipped))
        for skipped in message.skipped:
            self._warn(f"object '{skipped.key}' was left out: {skipped.value}")
        if (delay := stamp_age(server.node, message.header.stamp)) is not None:
            counts.set("last delay of the stream [s]", delay)

    def _is_over(self, stamp):
        """Return whether the last horizon has passed, and record it."""
        age, last = stamp_age(self._server.node, stamp), max(self._server.settings.horizons)
        if age is None or age <= last:
            return False
        counts = self._server.diagnostics.predictions
        counts.add("expired predictions")
        counts.warn("late: the last horizon of a prediction had passed")
        self._warn(
            f"a prediction was dropped: its scene is {age:.3g} s old, and its last horizon is {last:g} s"
        )
        return True

    def _warn(self, text):
        self._server.log.warning(text, throttle_duration_sec=_REPORT_PERIOD)

    def _publish_poses(self, message, settings):
        poses = {
            predicted.id: state.pose
            for predicted in message.objects
            for state in predicted.states
            if abs(seconds(state.time_from_start) - settings.pose_horizon) < _SAME_TIME
        }
        for name in poses.keys() & set(settings.pose_objects):
            self._pose_publisher(name).publish(
                PoseWithCovarianceStamped(header=message.header, pose=poses[name])
            )
        if settings.publish_tf:
            self._transforms.publish(message.header, poses)

    def _pose_publisher(self, name):
        if name not in self._poses:
            topic = f"~/predicted_pose/{topic_name(name)}"
            self._poses[name] = self._server.node.create_publisher(PoseWithCovarianceStamped, topic, 1)
        return self._poses[name]


class SceneTopics:
    """Sources of streamed scenes: whole scenes, tracked objects and detections.

    Each source has its own thread. Scenes wait for their transforms in other threads, so that none holds up a
    later one. A jump of the clock back, as of a bag that starts again, empties the transforms.

    Parameters
    ----------
    node : rclpy Node
    parameters : ParameterServer
    library : ModelLibrary
    frames : Frames
    work : callable
        Takes the latest `StreamedScene` of a source; must not raise.
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
        frames: Frames,
        work: Callable[[StreamedScene], object],
        replaced: Callable[[], object],
        under: str = "~",
    ):
        self._node, self._parameters, self._library = node, parameters, library
        self._frames, self._work, self._replaced = frames, work, replaced
        self._waiting = ThreadPoolExecutor(_WAITING, thread_name_prefix="transforms")
        self._sources: list[_StreamSource] = []
        self._tracked: dict[str, Any] = {}  # header and state of each topic's newest pose
        self._subscriptions = []
        self._subscribe(Scene, f"{under}/scene", self._source(detected=False).put)
        settings = parameters.settings
        topics = [
            pair for pair in zip(settings.tracked_topics, settings.tracked_models, strict=True) if pair[0]
        ]
        if topics:
            self._of_trackers = self._source(detected=True)
        for topic, model in topics:
            self._subscribe(
                PoseWithCovarianceStamped,
                topic,
                lambda message, topic=topic, model=model: self._track(topic, model, message),
            )
        if Detection3DArray is not None:
            self._of_detectors = self._source(detected=True)
            self._subscribe(Detection3DArray, f"{under}/detections", self._detect)
        self._jumps = on_clock_jump(node, self._jumped)

    def _subscribe(self, kind, topic, callback):
        self._subscriptions.append(subscribe(self._node, kind, topic, callback))

    def _source(self, detected):
        self._sources.append(_StreamSource(detected, self._frames, self._waiting, self._work, self._replaced))
        return self._sources[-1]

    def close(self) -> None:
        """Withdraw the topics."""
        self._jumps.unregister()
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        self._waiting.shutdown(wait=False, cancel_futures=True)
        for source in self._sources:
            source.close()

    def _jumped(self, _):
        """Forget what belongs to the time before a jump of the clock."""
        self._node.get_logger().warning("the clock changed or jumped back: transforms and streams start anew")
        self._frames.clear()
        self._tracked.clear()
        for source in self._sources:
            source.pace.reset()

    def _track(self, topic, model, message):
        """Pass on the scene of all currently tracked objects."""
        settings = self._parameters.settings
        state = detected_object(topic, model, message.pose, self._library, settings.tracked_mass)
        self._tracked[topic] = message.header, state
        frame = message.header.frame_id
        objects = [
            state
            for header, state in self._tracked.values()
            if header is message.header
            or (header.frame_id == frame and stamp_problem(self._node, header.stamp, settings) is None)
        ]
        # marked as at rest or not for this scene alone
        self._of_trackers.put(Scene(header=message.header, objects=copy.deepcopy(objects)))

    def _detect(self, detections):
        """Pass on the scene of all detections."""
        settings = self._parameters.settings
        self._of_detectors.put(*scene_of_detections(detections, self._library, settings.tracked_mass))


class _StreamSource:
    """Source of scenes, which wait for their transforms concurrently."""

    def __init__(self, detected, frames, waiting, work, replaced):
        self.pace = Pace()
        self._detected, self._frames, self._waiting = detected, frames, waiting
        self._replaced = replaced
        self._worker = LatestWorker(work, replaced)
        self._lock, self._arrived, self._passed = threading.Lock(), 0, 0

    def close(self):
        self._worker.close()

    def put(self, scene, skipped: Mapping[str, str] = _NONE):
        """Pass on a scene once its transform is there, unless a later one is faster."""
        self.pace.arrived()
        self._arrived += 1
        streamed = StreamedScene(scene, self._detected, self.pace, skipped=skipped)
        if self._frames.is_world(scene.header.frame_id):
            self._pass(streamed, self._arrived)
        else:
            with contextlib.suppress(RuntimeError):  # the node is closing
                self._waiting.submit(self._wait, streamed, self._arrived)

    def _wait(self, streamed, number):
        try:
            self._frames.to_world(streamed.scene.header, "header" if self._detected else "scene.header")
        except UncPhysicsError as error:
            streamed = streamed._replace(problem=error)
        self._pass(streamed, number)

    def _pass(self, streamed, number):
        with self._lock:
            late = number < self._passed
            if not late:
                self._passed = number
                self._worker.put(streamed)
        if late:
            self._replaced()


def prepared(
    streamed: StreamedScene,
    frames: Frames,
    environment: NodeEnvironment,
    library: ModelLibrary,
    settings: Settings,
) -> tuple[Scene, dict[str, str]]:
    """Return a scene to predict, and the reasons of objects left out by their ids.

    Detected objects are transformed to the world frame, and marked as at rest where they stand on something.

    Raises
    ------
    UncPhysicsError
        If the transform is missing, or the scene has detected objects, and there is no environment.
    """
    if streamed.problem is not None:
        raise streamed.problem
    scene = streamed.scene
    if not streamed.detected or not scene.objects:
        return scene, dict(streamed.skipped)
    environment.check_set(settings, "detected")
    if (transform := frames.to_world(scene.header, "header")) is not None:
        scene = transform.scene(scene)
        scene.header = Header(stamp=scene.header.stamp)
    scene, skipped = settle_detected(scene, environment.message, library, settings)
    reasons = {name: omission.reason for name, omission in skipped.items()}
    return scene, {**reasons, **streamed.skipped}


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
        skip_invalid_objects=True,
    )


def subscribe(node, kind: type, topic: str, callback: Callable, depth: int = 1):
    """Subscribe by best effort, which matches all publishers, including sensors; users may override it."""
    profile = QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)
    return node.create_subscription(kind, topic, callback, profile, qos_overriding_options=_OVERRIDABLE)


def on_clock_jump(node, callback: Callable):
    """Have a function called after jumps of a node's clock back, as of a bag that starts again."""
    threshold = JumpThreshold(min_forward=None, min_backward=Duration(nanoseconds=-1), on_clock_change=True)
    return node.get_clock().create_jump_callback(threshold, post_callback=callback)


def stamp_age(node, stamp) -> float | None:
    """Return the time since a stamp [s] by the node's clock; None for a zero stamp."""
    if stamp.sec == 0 and stamp.nanosec == 0:
        return None
    now = node.get_clock().now().nanoseconds
    return 1e-9 * (now - nanoseconds(stamp))  # rclpy's Time has no negative values


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


def topic_name(text: str) -> str:
    """Return a text as the last part of a topic name."""
    name = re.sub(r"[^A-Za-z0-9_]", "_", text)
    return name if name[:1].isalpha() else f"_{name}"


class TransformTopic:
    """Publisher of poses as transforms, made when it is first needed; needs tf2_msgs.

    Parameters
    ----------
    server : PredictionServer
    suffix : str
        End of the frames' names, after the object's id.
    """

    def __init__(self, server, suffix: str = PREDICTED):
        self._server, self._suffix = server, suffix
        self._publisher: Any = None
        self._missing = False

    def close(self) -> None:
        """Withdraw the topic."""
        if self._publisher is not None:
            self._server.node.destroy_publisher(self._publisher)

    def publish(self, header: Header, poses: Mapping[str, PoseWithCovariance]) -> None:
        """Publish the mean poses of objects by their ids."""
        if self._missing or not poses:
            return
        try:
            from tf2_msgs.msg import TFMessage  # pyright: ignore[reportMissingImports]  (optional)
        except ImportError:
            self._missing = True
            self._server.log.warning("publish_tf is set, but tf2_msgs is not installed")
            return
        if self._publisher is None:
            self._publisher = self._server.node.create_publisher(TFMessage, "/tf", 100)
        self._publisher.publish(TFMessage(transforms=transforms(header, poses, self._suffix)))


def transforms(
    header: Header, poses: Mapping[str, PoseWithCovariance], suffix: str = PREDICTED
) -> list[TransformStamped]:
    """Return the transforms from the header's frame to objects, with the header's stamp."""
    found = []
    for name, pose in poses.items():
        message = TransformStamped(header=header, child_frame_id=f"{name}{suffix}")
        p = pose.pose.position
        message.transform.translation = Vector3(x=p.x, y=p.y, z=p.z)
        message.transform.rotation = pose.pose.orientation
        found.append(message)
    return found
