"""Stream: predict scenes from topics, and publish predictions for several horizons."""

from __future__ import annotations

import contextlib
import copy
import functools
import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import MappingProxyType
from typing import Any, NamedTuple

from diagnostic_msgs.msg import KeyValue
from geometry_msgs.msg import PoseWithCovariance, PoseWithCovarianceStamped, TransformStamped, Vector3
from std_msgs.msg import Header

from unc_physics_msgs.msg import Prediction, PredictionRequest, Scene

from ..checks.errors import PredictionTimeoutError, UncPhysicsError
from .detected import OVERRIDABLE, Detections, detection_subscriptions, settle_detected, subscribe, topic_name
from .diagnostics import Problem, ThrottledWarnings
from .markers import MarkerTopic, OccupancyTopics
from .messages.clocks import on_clock_jump, stamp_age, stamp_problem
from .messages.fields import duration, seconds
from .messages.prediction import write_answer
from .messages.request import TimeLimits
from .messages.scene import AllSkippedError
from .parameters import Settings
from .stream_pace import LatestWorker, Pace

#: End of the names of frames of predicted and of tracked objects, after the object's id.
PREDICTED, TRACKED = "_predicted", "_tracked"
_WAITING = 16  # scenes that wait for a transform at a time
_SAME_TIME = 1e-6  # s
_SHORTEST = 1e-3  # s, time limit of a scene that is nearly too old
_SEED = 1  # equal for all scenes, so that equal scenes have equal predictions


class StreamedScene(NamedTuple):
    """Input of a stream.

    Attributes
    ----------
    scene : Scene
        In the frame of its header.
    source : _SceneSource
    skipped : dict of str
        Reasons of omitted objects, by id.
    problem : UncPhysicsError or None
        Reason why the scene cannot be predicted.
    """

    scene: Scene
    source: _SceneSource
    skipped: Mapping[str, str]
    problem: UncPhysicsError | None = None


class _SceneSource:
    """Source of scenes with a thread of its own.

    Scenes wait for their transforms in other threads, so that none holds up a later one.

    Parameters
    ----------
    stream : Stream
    detected : bool
        Whether its objects were detected, so that supports decide which of them are at rest.
    """

    def __init__(self, stream: Stream, detected: bool):
        self.pace, self.detected, self._stream = Pace(), detected, stream
        self.worker = LatestWorker(stream.work, stream.replaced)
        self._lock, self._arrived, self._passed = threading.Lock(), 0, 0

    def put(self, scene: Scene, skipped: Mapping[str, str] = MappingProxyType({})) -> None:
        """Pass on a scene once its transform is there, unless a later one is faster."""
        self.pace.arrived()
        self._arrived += 1
        streamed = StreamedScene(scene, self, skipped)
        if self._stream.server.frames.is_world(scene.header.frame_id):
            self._pass(streamed, self._arrived)
        else:
            with contextlib.suppress(RuntimeError):  # the node is closing
                self._stream.waiting.submit(self._wait, streamed, self._arrived)

    def _wait(self, streamed, number):
        header = streamed.scene.header
        try:
            self._stream.server.frames.to_world(header, "header" if self.detected else "scene.header")
        except UncPhysicsError as error:
            streamed = streamed._replace(problem=error)
        self._pass(streamed, number)

    def _pass(self, streamed, number):
        with self._lock:
            late = number < self._passed
            if not late:
                self._passed = number
                self.worker.put(streamed)
        if late:
            self._stream.replaced()


class Stream:
    """Predictions of each scene from ``~/scene``, from trackers, or from detectors.

    A jump of the clock back, as of a bag that starts again, empties the transforms.
    """

    def __init__(self, server):
        self.server = server
        self._warn = ThrottledWarnings(server.log)
        node = server.node
        self._predictions = node.create_publisher(
            Prediction, "~/predictions", 1, qos_overriding_options=OVERRIDABLE
        )
        self._transforms = TransformTopic(server)
        self._markers = MarkerTopic(server, "~/stream_markers")
        self._occupancy = OccupancyTopics(server)
        self._poses = {}
        self.waiting = ThreadPoolExecutor(_WAITING, thread_name_prefix="transforms")
        self._single: dict[str, Detections] = {}  # newest detection of each object's own topic
        self._sources = [_SceneSource(self, detected=False)]
        self._subscriptions = [subscribe(node, Scene, "~/scene", self._sources[0].put)]
        if not server.settings.track:
            self._sources += [_SceneSource(self, detected=True), _SceneSource(self, detected=True)]
            self._subscriptions += detection_subscriptions(server, self._of_one, self._of_many, depth=1)
        self._jumps = on_clock_jump(node, self._jumped)

    @property
    def is_wanted(self) -> bool:
        """Whether anybody receives predictions."""
        settings = self.server.settings
        topics = self._predictions, self._markers, self._occupancy
        own = any(topic.get_subscription_count() for topic in topics)
        return own or settings.publish_tf or any(settings.pose_objects)

    def close(self):
        """Withdraw the topics."""
        node = self.server.node
        self._jumps.unregister()
        for subscription in self._subscriptions:
            node.destroy_subscription(subscription)
        self.waiting.shutdown(wait=False, cancel_futures=True)
        for source in self._sources:
            source.worker.close()
        for publisher in (self._predictions, *self._poses.values()):
            node.destroy_publisher(publisher)
        self._markers.close()
        self._occupancy.close()
        self._transforms.close()

    def _jumped(self, _):
        """Forget what belongs to the time before a jump of the clock."""
        self.server.log.warning("the clock changed or jumped back: transforms and streams start anew")
        self.server.frames.clear()
        self._single.clear()
        for source in self._sources:
            source.pace.reset()

    def _of_one(self, found):
        """Pass on the scene of all objects with topics of their own, as they are now."""
        node, settings, header = self.server.node, self.server.settings, found.header
        self._single[found.objects[0].id] = found
        objects = [
            own
            for other in self._single.values()
            if other is found
            or (
                other.header.frame_id == header.frame_id
                and stamp_problem(node, other.header.stamp, settings) is None
            )
            for own in other.objects
        ]
        # marked as at rest or not for this scene alone
        self._sources[1].put(Scene(header=header, objects=copy.deepcopy(objects)))

    def _of_many(self, found):
        """Pass on the scene of all detections."""
        self._sources[2].put(Scene(header=found.header, objects=found.objects), found.skipped)

    def work(self, streamed: StreamedScene) -> None:
        """Predict a scene."""
        self.server.diagnostics.predictions.heard()
        self.keep_pace(streamed.source.pace, functools.partial(self._predict, streamed))

    def keep_pace(self, pace: Pace, predict: Callable[[float | None], bool]) -> float:
        """Predict an input, and adapt the rollouts of later ones to the time that it takes.

        ``predict`` takes the limit of that time [s], or None, and returns whether it published a prediction.
        Returns how much longer it took than twice the limit, by default the time between inputs [s].
        """
        began, counts = time.perf_counter(), self.server.diagnostics.predictions
        limit = pace.limit(self.server.settings.stream_time_budget)
        published = predict(limit)
        took = time.perf_counter() - began
        pace.took(took, limit)
        if published and limit is not None and took > limit:
            counts.add("late predictions")
            counts.warn(
                f"late: a prediction took {took:.3g} s, and the stream's limit is {limit:.3g} s", Problem.LATE
            )
        return took if limit is None else max(0.0, took - 2.0 * limit)

    def replaced(self) -> None:
        """Count a scene that a newer one replaced."""
        self.server.diagnostics.predictions.add("replaced inputs")

    def _predict(self, streamed, limit):
        """Predict a scene and publish the result; errors go to the log and the diagnostics.

        Returns whether a prediction was published.
        """
        server, settings, header = self.server, self.server.settings, streamed.scene.header
        counts = server.diagnostics.predictions
        with server.errors_to(lambda problem: self._warn("failed", f"a scene was not predicted: {problem}")):
            if (reason := stamp_problem(server.node, header.stamp, settings)) is not None:
                counts.warn(f"dropped inputs: {reason}")
                counts.add("dropped inputs")
                self._warn("dropped", f"a scene was dropped: {reason}")
                return False
            scene, skipped = self._prepared(streamed, settings)
            if self._is_over(header.stamp):
                return False
            message, job = Prediction(), None
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
                return True
        return False

    def _prepared(self, streamed, settings):
        """Return a scene to predict, and the reasons of objects left out by their ids.

        Detected objects are transformed to the world frame, and marked as at rest where they stand.
        """
        if streamed.problem is not None:
            raise streamed.problem
        scene, server = streamed.scene, self.server
        if not streamed.source.detected or not scene.objects:
            return scene, dict(streamed.skipped)
        server.environment.check_set(settings, "detected")
        if (transform := server.frames.to_world(scene.header, "header")) is not None:
            scene = transform.moved(scene)
            scene.header = Header(stamp=scene.header.stamp)
        scene, skipped = settle_detected(scene, server.environment.message, server.library, settings)
        return scene, skipped | dict(streamed.skipped)

    def _job(self, streamed, scene, limit, settings):
        """Return the job of a scene, with the rollouts and the time that the stream leaves it."""
        server = self.server
        allowed, age = settings.max_computation_time, stamp_age(server.node, scene.header.stamp)
        if age is not None:  # its horizon must not pass meanwhile
            allowed = min(allowed, max(settings.horizons) - age)
        job = server.read(request_of(scene, settings), limits=TimeLimits(max(allowed, _SHORTEST)))
        return replace(job, propagator=streamed.source.pace.adapted(job.propagator, limit))

    def publish(self, message, job) -> None:
        """Publish a prediction, with poses, markers and occupancy; ``job`` is None if it is empty."""
        server, settings = self.server, self.server.settings
        self._predictions.publish(message)
        if job is not None:
            self._publish_poses(message, settings)
            self._markers.publish(message.header, job, message)
            self._occupancy.publish(job, message)
        counts = server.diagnostics.predictions
        counts.add("skipped objects", len(message.skipped))
        for skipped in message.skipped:
            text = f"object '{skipped.key}' was left out: {skipped.value}"
            self._warn("left out", text)
            counts.warn(f"skipped objects: {text}")
        if (delay := stamp_age(server.node, message.header.stamp)) is not None:
            counts.set("last delay of the stream [s]", delay)

    def _is_over(self, stamp):
        """Return whether the last horizon has passed, and record it."""
        age, last = stamp_age(self.server.node, stamp), max(self.server.settings.horizons)
        if age is None or age <= last:
            return False
        counts = self.server.diagnostics.predictions
        counts.add("expired predictions")
        counts.warn("late: the last horizon of a prediction had passed", Problem.LATE)
        self._warn(
            "expired",
            f"a prediction was dropped: its scene is {age:.3g} s old, and its last horizon is {last:g} s",
        )
        return True

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
            self._poses[name] = self.server.node.create_publisher(PoseWithCovarianceStamped, topic, 1)
        return self._poses[name]


def request_of(scene: Scene, settings: Settings) -> PredictionRequest:
    """Return the request for a streamed scene from the parameters."""
    *times, horizon = sorted(set(settings.horizons))
    return PredictionRequest(
        scene=scene,
        horizon=duration(horizon),
        times=[duration(time) for time in times],
        propagator=settings.stream_propagator,
        seed=_SEED,
        return_probabilities=settings.stream_probabilities,
        skip_invalid_objects=True,
    )


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
