"""Where streamed scenes come from: whole scenes, single objects that are tracked, or detections."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.qos import QoSProfile, ReliabilityPolicy

from unc_physics_msgs.msg import ObjectState, PredictionRequest, Scene

from ..checks.errors import UncPhysicsError
from .background import Newest
from .durations import duration
from .models import ModelLibrary
from .parameters import ParameterServer, Settings
from .scene_reader import UNKNOWN

# as sensors and detectors send: best effort matches every publisher, and of what comes only the last counts
_NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
_SEED = 1  # of all scenes: their predictions differ as they do, and not by what was drawn


class SceneTopics:
    """Hands on the newest scene of each source.

    Each source has a thread of its own, so that one that waits for a transform holds up no other.

    Parameters
    ----------
    node : rclpy Node
    parameters : ParameterServer
    library : ModelLibrary
    work : callable
        Takes a Scene; raises nothing.
    replaced : callable
        Called, without arguments, for each scene that a newer one replaced before its turn.
    under : str
        Name under which the topics ``scene`` and ``detections`` are.
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
        self._sources: list[Newest] = []
        self._tracked: dict[str, Any] = {}  # topic: (header, state) of its newest pose
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
        self._sources.append(Newest(self._work, self._replaced))
        return self._sources[-1]

    def close(self) -> None:
        """Take the topics back."""
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        for source in self._sources:
            source.close()

    def _track(self, topic, model, message):
        """Hand on the scene of all objects that are tracked now."""
        settings = self._parameters.settings
        state = _at_unknown_velocity(topic, model, message.pose, self._library, settings.tracked_mass)
        self._tracked[topic] = message.header, state
        frame = message.header.frame_id
        objects = [
            state
            for header, state in self._tracked.values()
            if header is message.header
            or (header.frame_id == frame and out_of_time(self._node, header.stamp, settings) is None)
        ]
        self._of_trackers.put(Scene(header=message.header, objects=objects))

    def _detect(self, detections):
        """Hand on the scene of all detections."""
        settings = self._parameters.settings
        if (scene := scene_of_detections(detections, self._library, settings.tracked_mass)).objects:
            self._of_detectors.put(scene)


def request_of(scene: Scene, settings: Settings) -> PredictionRequest:
    """What a streamed scene asks for, by the parameters."""
    return PredictionRequest(
        scene=scene,
        horizon=duration(max(settings.horizons)),
        propagator=settings.stream_propagator,
        seed=_SEED,
        return_probabilities=settings.stream_probabilities,
        skip_unknown_models=True,
    )


def age(node, stamp) -> float | None:
    """Time since a stamp [s], by the node's clock; None without a stamp."""
    if stamp.sec == 0 and stamp.nanosec == 0:
        return None
    now = node.get_clock().now().nanoseconds
    return 1e-9 * (now - stamp.sec * 1_000_000_000 - stamp.nanosec)  # rclpy's Time knows no negative ones


def out_of_time(node, stamp, settings) -> str | None:
    """What is wrong with the stamp of an input, None if nothing is."""
    if (old := age(node, stamp)) is None:
        return None
    if settings.max_input_age and old > settings.max_input_age:
        what = f"{old:.3g} s old, and max_input_age is {settings.max_input_age:g} s"
    elif settings.max_input_lead and -old > settings.max_input_lead:
        what = f"{-old:.3g} s in the future, and max_input_lead is {settings.max_input_lead:g} s"
    else:
        return None
    return f"its stamp is {what}; do all clocks agree, and all nodes have the same use_sim_time?"


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
