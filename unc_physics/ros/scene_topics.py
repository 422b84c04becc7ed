"""Topics of scenes, tracked objects and detections."""

from __future__ import annotations

import contextlib
import copy
import functools
import re
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from types import MappingProxyType
from typing import NamedTuple

from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from std_msgs.msg import Header

from unc_physics_msgs.msg import Scene

from ..checks.errors import UncPhysicsError
from .detected import Detection3DArray, Detections, detected_object, read_detections, settle_detected
from .messages.clocks import on_clock_jump, stamp_problem
from .messages.frames import Frames
from .models import ModelLibrary
from .node_environment import NodeEnvironment
from .parameters import ParameterServer, Settings
from .stream_pace import Pace

#: Depth, history and reliability have parameters such as ``qos_overrides./TOPIC.subscription.depth``.
OVERRIDABLE = QoSOverridingOptions.with_default_policies()
_WAITING = 16  # scenes that wait for a transform at a time
_NONE: Mapping[str, str] = MappingProxyType({})


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
    """

    def __init__(
        self,
        node,
        parameters: ParameterServer,
        library: ModelLibrary,
        frames: Frames,
        work: Callable[[StreamedScene], object],
        replaced: Callable[[], object],
    ):
        self._node, self._parameters, self._library = node, parameters, library
        self._frames, self._work, self._replaced = frames, work, replaced
        self._waiting = ThreadPoolExecutor(_WAITING, thread_name_prefix="transforms")
        self._sources: list[_StreamSource] = []
        self._single: dict[str, Detections] = {}  # newest detection of each object's own topic
        self._subscriptions = []
        self._subscribe(Scene, "~/scene", self._source(detected=False).put)
        if not parameters.settings.track:
            self._of_trackers, self._of_detectors = self._source(detected=True), self._source(detected=True)
            self._detections = DetectionTopics(
                node, parameters, library, self._of_one, self._of_many, depth=1
            )
            self._subscriptions += self._detections.subscriptions
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
        self._single.clear()
        for source in self._sources:
            source.pace.reset()

    def _of_one(self, found):
        """Pass on the scene of all objects with topics of their own, as they are now."""
        settings, header = self._parameters.settings, found.header
        self._single[found.objects[0].id] = found
        objects = [
            own
            for other in self._single.values()
            if other is found
            or (
                other.header.frame_id == header.frame_id
                and stamp_problem(self._node, other.header.stamp, settings) is None
            )
            for own in other.objects
        ]
        # marked as at rest or not for this scene alone
        self._of_trackers.put(Scene(header=header, objects=copy.deepcopy(objects)))

    def _of_many(self, found):
        """Pass on the scene of all detections."""
        self._of_detectors.put(Scene(header=found.header, objects=found.objects), found.skipped)


class DetectionTopics:
    """Topics of detections: ``~/detections``, and ``~/observed/ID`` for each of `Settings.observed`.

    Parameters
    ----------
    node : rclpy Node
    parameters : ParameterServer
    library : ModelLibrary
    of_one, of_many : callable
        Take the `Detections` of a topic of one object, and of an array.
    depth : int
        Number of messages of a topic that wait in the middleware.

    Attributes
    ----------
    subscriptions : list
    """

    def __init__(
        self,
        node,
        parameters: ParameterServer,
        library: ModelLibrary,
        of_one: Callable[[Detections], object],
        of_many: Callable[[Detections], object],
        depth: int,
    ):
        def one(name, kind, message):
            state = detected_object(name, kind, message.pose, library, parameters.settings)
            of_one(Detections(message.header, [state], {name}, {}))

        self.subscriptions = [
            subscribe(
                node,
                PoseWithCovarianceStamped,
                f"~/observed/{topic_name(name)}",
                functools.partial(one, name, kind),
                depth,
            )
            for name, kind in parameters.settings.observed.items()
        ]
        if Detection3DArray is not None:
            self.subscriptions.append(
                subscribe(
                    node,
                    Detection3DArray,
                    "~/detections",
                    lambda message: of_many(read_detections(message, library, parameters.settings)),
                    depth,
                )
            )


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


def topic_name(text: str) -> str:
    """Return a text as the last part of a topic name."""
    name = re.sub(r"[^A-Za-z0-9_]", "_", text)
    return name if name[:1].isalpha() else f"_{name}"


def subscribe(node, kind: type, topic: str, callback: Callable, depth: int = 1):
    """Subscribe by best effort, which matches all publishers, including sensors; users may override it."""
    profile = QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)
    return node.create_subscription(kind, topic, callback, profile, qos_overriding_options=OVERRIDABLE)
