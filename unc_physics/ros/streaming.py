"""Continuous prediction: scenes in on topics, predictions for several horizons out."""

from __future__ import annotations

import re

from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.qos import QoSProfile, ReliabilityPolicy

from unc_physics_msgs.msg import ObjectState, Prediction, PredictionRequest, Result, Scene

from ..checks.errors import ErrorCode, UncPhysicsError
from .background import Newest
from .durations import duration, seconds
from .markers import MarkerTopic
from .requests import read_request, write_answer
from .scene_reader import UNKNOWN

# as sensors and detectors send: best effort matches every publisher, and of what comes only the last counts
_NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
_SAME_TIME = 1e-6  # s
_REPORT_PERIOD = 5.0  # s, between warnings in the log
_SEED = 1  # of all scenes: their predictions differ as they do, and not by what was drawn


class Stream:
    """Predicts each scene that comes on ``~/scene``, from trackers, or from detectors.

    Each of these sources has a thread of its own, so that one that waits for a transform holds up no other.
    """

    def __init__(self, server):
        self._server = server
        self._sources = []
        node = server.node
        self._predictions = node.create_publisher(Prediction, "~/predictions", 1)
        self._markers = MarkerTopic(server, "~/stream_markers")
        self._poses = {}
        self._tracked = {}  # topic: (header, state) of its newest pose
        self._subscriptions = [node.create_subscription(Scene, "~/scene", self._source().put, _NEWEST)]
        settings = server.settings
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
                node.create_subscription(Detection3DArray, "~/detections", self._detect, _NEWEST)
            )

    def _source(self):
        self._sources.append(Newest(self._predict, self._server.diagnostics.replaced))
        return self._sources[-1]

    def close(self):
        """Take the topics back."""
        node = self._server.node
        for subscription in self._subscriptions:
            node.destroy_subscription(subscription)
        for source in self._sources:
            source.close()
        for publisher in (self._predictions, *self._poses.values()):
            node.destroy_publisher(publisher)
        self._markers.close()

    def _predict(self, scene):
        """Predict a scene and publish; a bad scene is told in the log and the diagnostics."""
        server, settings = self._server, self._server.settings
        result = Result()
        with server.errors_into(result):
            if (reason := self._out_of_time(scene.header.stamp, settings)) is not None:
                server.diagnostics.dropped()
                self._warn(f"a scene was dropped: {reason}")
                return
            times = sorted(set(settings.horizons))
            request = PredictionRequest(
                scene=scene,
                horizon=duration(times[-1]),
                propagator=settings.stream_propagator,
                seed=_SEED,
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
            self._markers.publish(scene.header, job, message)
            server.diagnostics.skipped(len(message.skipped))
            for skipped in message.skipped:
                self._warn(f"object '{skipped.key}' was left out: {skipped.value}")
            if (age := self._age(scene.header.stamp)) is not None:
                server.diagnostics.delayed(age)
        if result.error_code not in (ErrorCode.NONE, ErrorCode.CANCELED):
            self._warn(f"a scene was not predicted: {result.error_msg}")

    def _warn(self, text):
        self._server.log.warning(text, throttle_duration_sec=_REPORT_PERIOD)

    def _age(self, stamp):
        """Time since a stamp [s], None without a stamp."""
        if stamp.sec == 0 and stamp.nanosec == 0:
            return None
        now = self._server.node.get_clock().now().nanoseconds
        return 1e-9 * (now - stamp.sec * 1_000_000_000 - stamp.nanosec)  # rclpy's Time knows no negative ones

    def _out_of_time(self, stamp, settings):
        """What is wrong with the stamp of an input, None if nothing is."""
        if (age := self._age(stamp)) is None:
            return None
        if settings.max_input_age and age > settings.max_input_age:
            what = f"{age:.3g} s old, and max_input_age is {settings.max_input_age:g} s"
        elif settings.max_input_lead and -age > settings.max_input_lead:
            what = f"{-age:.3g} s in the future, and max_input_lead is {settings.max_input_lead:g} s"
        else:
            return None
        return f"its stamp is {what}; do all clocks agree, and all nodes have the same use_sim_time?"

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
        frame = message.header.frame_id
        objects = [
            state
            for header, state in self._tracked.values()
            if header is message.header
            or (header.frame_id == frame and self._out_of_time(header.stamp, settings) is None)
        ]
        self._of_trackers.put(Scene(header=message.header, objects=objects))

    def _detect(self, detections):
        """Predict the scene of all detections."""
        settings, library = self._server.settings, self._server.library
        if (scene := scene_of_detections(detections, library, settings.tracked_mass)).objects:
            self._of_detectors.put(scene)


def scene_of_detections(detections, library, mass) -> Scene:
    """The scene of a Detection3DArray; each detection's best hypothesis names the model, and those without
    one are left out.
    """
    objects, names = [], set()
    for k, detection in enumerate(detections.detections):
        if detection.results:
            best = max(detection.results, key=lambda result: result.hypothesis.score)
            name = detection.id or f"{best.hypothesis.class_id}_{k}"
            if name in names:  # some detectors write the class there
                name = f"{name}_{k}"
            names.add(name)
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
