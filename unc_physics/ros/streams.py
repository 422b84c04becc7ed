"""Stream: predict scenes from topics, and publish predictions for several horizons."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from diagnostic_msgs.msg import KeyValue
from geometry_msgs.msg import PoseWithCovariance, PoseWithCovarianceStamped, TransformStamped, Vector3
from std_msgs.msg import Header

from unc_physics_msgs.msg import Prediction, PredictionRequest, Scene

from ..checks.errors import PredictionTimeoutError
from .diagnostics import Problem, ThrottledWarnings
from .markers import MarkerTopic, OccupancyTopics
from .messages.clocks import stamp_age, stamp_problem
from .messages.fields import duration, seconds
from .messages.prediction import write_answer
from .messages.request import TimeLimits
from .messages.scene import AllSkippedError
from .parameters import Settings
from .scene_topics import OVERRIDABLE, SceneTopics, prepared, topic_name
from .stream_pace import Pace

#: End of the names of frames of predicted and of tracked objects, after the object's id.
PREDICTED, TRACKED = "_predicted", "_tracked"
_SAME_TIME = 1e-6  # s
_SHORTEST = 1e-3  # s, time limit of a scene that is nearly too old
_SEED = 1  # equal for all scenes, so that equal scenes have equal predictions


class Stream:
    """Predictions of each scene from ``~/scene``, from trackers, or from detectors."""

    def __init__(self, server):
        self._server = server
        self._warn = ThrottledWarnings(server.log)
        node = server.node
        self._predictions = node.create_publisher(
            Prediction, "~/predictions", 1, qos_overriding_options=OVERRIDABLE
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
        """Predict a scene."""
        self._server.diagnostics.predictions.heard()
        self.keep_pace(streamed.pace, functools.partial(self._predict, streamed))

    def keep_pace(self, pace: Pace, predict: Callable[[float | None], bool]) -> float:
        """Predict an input, and adapt the rollouts of later ones to the time that it takes.

        ``predict`` takes the limit of that time [s], or None, and returns whether it published a prediction.
        Returns how much longer it took than twice the limit, by default the time between inputs [s].
        """
        began, counts = time.perf_counter(), self._server.diagnostics.predictions
        limit = pace.limit(self._server.settings.stream_time_budget)
        published = predict(limit)
        took = time.perf_counter() - began
        pace.took(took, limit)
        if published and limit is not None and took > limit:
            counts.add("late predictions")
            counts.warn(
                f"late: a prediction took {took:.3g} s, and the stream's limit is {limit:.3g} s", Problem.LATE
            )
        return took if limit is None else max(0.0, took - 2.0 * limit)

    def _replaced(self):
        self._server.diagnostics.predictions.add("replaced inputs")

    def _predict(self, streamed, limit):
        """Predict a scene and publish the result; errors go to the log and the diagnostics.

        Returns whether a prediction was published.
        """
        server, settings, header = self._server, self._server.settings, streamed.scene.header
        published = False
        with server.errors_to(lambda problem: self._warn("failed", f"a scene was not predicted: {problem}")):
            if (reason := stamp_problem(server.node, header.stamp, settings)) is not None:
                counts = server.diagnostics.predictions
                counts.warn(f"dropped inputs: {reason}")
                counts.add("dropped inputs")
                self._warn("dropped", f"a scene was dropped: {reason}")
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
        job = server.read(request_of(scene, settings), limits=TimeLimits(max(allowed, _SHORTEST)))
        return replace(job, propagator=streamed.pace.adapted(job.propagator, limit))

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
            text = f"object '{skipped.key}' was left out: {skipped.value}"
            self._warn("left out", text)
            counts.warn(f"skipped objects: {text}")
        if (delay := stamp_age(server.node, message.header.stamp)) is not None:
            counts.set("last delay of the stream [s]", delay)

    def _is_over(self, stamp):
        """Return whether the last horizon has passed, and record it."""
        age, last = stamp_age(self._server.node, stamp), max(self._server.settings.horizons)
        if age is None or age <= last:
            return False
        counts = self._server.diagnostics.predictions
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
            self._poses[name] = self._server.node.create_publisher(PoseWithCovarianceStamped, topic, 1)
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
