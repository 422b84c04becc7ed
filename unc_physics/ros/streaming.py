"""Continuous prediction: scenes in on topics, predictions for several horizons out."""

from __future__ import annotations

import re

from geometry_msgs.msg import PoseWithCovarianceStamped

from unc_physics_msgs.msg import Prediction, Result

from ..checks.errors import ErrorCode
from .durations import seconds
from .markers import MarkerTopic
from .requests import read_request, write_answer
from .scene_topics import SceneTopics, age, out_of_time, request_of

_SAME_TIME = 1e-6  # s
_REPORT_PERIOD = 5.0  # s, between warnings in the log


class Stream:
    """Predicts each scene that comes on ``~/scene``, from trackers, or from detectors."""

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
        """Take the topics back."""
        node = self._server.node
        self._topics.close()
        for publisher in (self._predictions, *self._poses.values()):
            node.destroy_publisher(publisher)
        self._markers.close()

    def _predict(self, scene):
        """Predict a scene and publish; a bad scene is told in the log and the diagnostics."""
        server, settings = self._server, self._server.settings
        result = Result()
        with server.errors_into(result):
            if (reason := out_of_time(server.node, scene.header.stamp, settings)) is not None:
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
            if (delay := age(server.node, scene.header.stamp)) is not None:
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


def topic_name(text: str) -> str:
    """A text as the last part of a topic's name."""
    name = re.sub(r"[^A-Za-z0-9_]", "_", text)
    return name if name[:1].isalpha() else f"_{name}"
