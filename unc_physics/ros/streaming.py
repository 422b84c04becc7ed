"""Continuous prediction: scenes in on topics, predictions for several horizons out."""

from __future__ import annotations

import re

from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.time import Time

from unc_physics_msgs.msg import ObjectState, Prediction, PredictionRequest, Result, Scene

from ..checks.errors import UncPhysicsError
from .background import Newest
from .durations import duration, seconds
from .requests import read_request, write_answer
from .scene_reader import UNKNOWN

# newest wins: while one scene is predicted, only the last of those that come is kept
_NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
_SAME_TIME = 1e-6  # s
_REPORT_PERIOD = 5.0  # s, between warnings in the log


class Stream:
    """Predicts each scene that comes on ``~/scene``, from trackers, or from detectors."""

    def __init__(self, server):
        self._server = server
        node = server.node
        self._newest = Newest(self._predict, server.diagnostics.replaced)
        self._predictions = node.create_publisher(Prediction, "~/predictions", 1)
        self._poses = {}
        self._tracked = {}  # topic: (stamp, state) of its newest pose
        self._subscriptions = [node.create_subscription(Scene, "~/scene", self._newest.put, _NEWEST)]
        settings = server.settings
        for topic, model in zip(settings.tracked_topics, settings.tracked_models, strict=True):
            if topic:
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
            self._subscriptions.append(
                node.create_subscription(Detection3DArray, "~/detections", self._detect, _NEWEST)
            )

    def close(self):
        """Take the topics back."""
        self._newest.close()
        node = self._server.node
        for subscription in self._subscriptions:
            node.destroy_subscription(subscription)
        for publisher in (self._predictions, *self._poses.values()):
            node.destroy_publisher(publisher)

    def _predict(self, scene):
        """Predict a scene and publish; a bad scene is told in the log and the diagnostics."""
        server, settings = self._server, self._server.settings
        if self._is_old(scene.header.stamp, settings.max_input_age):
            server.diagnostics.dropped()
            return
        result = Result()
        with server.errors_into(result):
            times = sorted(set(settings.horizons))
            request = PredictionRequest(
                scene=scene,
                horizon=duration(times[-1]),
                propagator=settings.stream_propagator,
                return_probabilities=settings.stream_probabilities,
                skip_unknown_models=True,
            )
            job = read_request(
                request, settings, server.library, server.frames, time_limit=settings.max_computation_time
            )
            job = job._replace(times=times[:-1])
            message = Prediction()
            write_answer(message, scene.header, settings, job, server.predict(job))
            self._predictions.publish(message)
            self._publish_poses(message, settings)
            server.markers.publish(scene.header, job, message)
            for skipped in message.skipped:
                self._warn(f"an object was left out: {skipped.value}")
            if (delay := self._age(scene.header.stamp)) is not None:
                server.diagnostics.delayed(delay)
        if result.error_code:
            self._warn(f"a scene was not predicted: {result.error_msg}")

    def _warn(self, text):
        self._server.log.warning(text, throttle_duration_sec=_REPORT_PERIOD)

    def _age(self, stamp):
        """Time since a stamp [s], None without a stamp."""
        if stamp.sec == 0 and stamp.nanosec == 0:
            return None
        clock = self._server.node.get_clock()
        return 1e-9 * (clock.now() - Time.from_msg(stamp, clock_type=clock.clock_type)).nanoseconds

    def _is_old(self, stamp, limit):
        age = self._age(stamp)
        return bool(limit) and age is not None and age > limit

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

    def _track(self, topic, model, message):
        """Predict the scene of all objects that are tracked now."""
        library, settings = self._server.library, self._server.settings
        state = _at_unknown_velocity(topic, model, message.pose, library, settings.tracked_mass)
        self._tracked[topic] = message.header, state
        frame, age = message.header.frame_id, settings.max_input_age
        objects = [
            state
            for header, state in self._tracked.values()
            if header.frame_id == frame and not self._is_old(header.stamp, age)
        ]
        self._newest.put(Scene(header=message.header, objects=objects), "tracked")

    def _detect(self, detections):
        """Predict the scene of all detections."""
        settings, library = self._server.settings, self._server.library
        if (scene := scene_of_detections(detections, library, settings.tracked_mass)).objects:
            self._newest.put(scene, "detected")


def scene_of_detections(detections, library, mass) -> Scene:
    """The scene of a Detection3DArray; each detection's best hypothesis names the model, and those without
    one are left out.
    """
    objects = []
    for k, detection in enumerate(detections.detections):
        if detection.results:
            best = max(detection.results, key=lambda result: result.hypothesis.score)
            name = detection.id or f"{best.hypothesis.class_id}_{k}"
            objects.append(_at_unknown_velocity(name, best.hypothesis.class_id, best.pose, library, mass))
    return Scene(header=detections.header, objects=objects)


def _at_unknown_velocity(name, model, pose, library, mass):
    """An object whose velocity is not known, with the given mass [kg] if its model has none."""
    state = ObjectState(id=name, model=model, pose=pose)
    state.twist.covariance[0] = UNKNOWN
    try:
        state.mass = mass if library.shape(model).mass is None else 0.0
    except UncPhysicsError:
        pass  # reported when the scene is read
    return state


def topic_name(text: str) -> str:
    """A text as the last part of a topic's name."""
    name = re.sub(r"[^A-Za-z0-9_]", "_", text)
    return name if name[:1].isalpha() else f"_{name}"
