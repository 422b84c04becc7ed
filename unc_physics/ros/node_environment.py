"""The node's environment: what surrounds the objects of scenes that bring no elements of their own."""

from __future__ import annotations

import copy
import importlib
import threading
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from rclpy.qos import QoSProfile
from std_msgs.msg import Header

from unc_physics_msgs.msg import Environment, Scene
from unc_physics_msgs.srv import SetEnvironment

from ..checks.errors import InvalidEnvironmentError
from ..scene.environment import element_names
from ..scene.scene_file import load_environment
from .messages.environment import element_id, read_environment, write_element
from .messages.frames import IDENTITY
from .messages.planning_scene import PlanningWorld
from .services import LATCHED, BackgroundService

_QUEUE = QoSProfile(depth=100)  # no difference of a planning scene may be lost
_WHOLE_SCENE = "/get_planning_scene"  # MoveIt's service
_WHOLE_WORLD = 4 | 8 | 16 | 2048  # names, geometry and attached objects of MoveIt's PlanningSceneComponents
#: Ways to set the environment, for messages to users.
HOW_TO_SET = (
    "set the parameter environment (a file), call ~/set_environment, publish ~/environment, or set"
    " planning_scene_topic"
)


class NodeEnvironment:
    """Elements from users and from MoveIt's planning scene, in the world frame; safe for threads."""

    def __init__(self):
        self._lock = threading.Lock()
        self._given: list[Any] | None = None
        self._planned: list[Any] | None = None
        self._version = 0

    @property
    def version(self) -> int:
        """Number of times that it was set."""
        return self._version

    @property
    def is_set(self) -> bool:
        """Whether any source has set it, also to no elements."""
        return self._given is not None or self._planned is not None

    def is_missing(self, settings) -> bool:
        """Return whether objects would fall for ever with a node's settings, as nothing has set it."""
        return any(settings.gravity) and not self.is_set

    def check_set(self, settings, objects: str) -> None:
        """Raise `InvalidEnvironmentError` if it is missing; ``objects`` says which objects would fall."""
        if self.is_missing(settings):
            raise InvalidEnvironmentError(
                f"must be set, as {objects} objects would fall for ever: {HOW_TO_SET}",
                field="the node's environment",
            )

    @property
    def message(self) -> Environment:
        """All elements; those of the planning scene replace others with the same id."""
        with self._lock:
            planned = self._planned or []
            ids = {element.id for element in planned}
            given = [element for element in self._given or [] if element.id not in ids]
        return Environment(elements=[*given, *planned])

    def set(self, elements: Iterable[Any]) -> None:
        """Replace the elements from users, which are EnvironmentElements in the world frame."""
        named = [_named(element, k) for k, element in enumerate(elements)]
        with self._lock:
            self._given = named
            self._version += 1

    def set_planned(self, elements: Iterable[Any]) -> None:
        """Replace the elements of the planning scene."""
        with self._lock:
            self._planned = list(elements)
            self._version += 1

    def load(self, path: str) -> None:
        """Replace the elements from users by those of a file (`load_environment`)."""
        elements = load_environment(path)
        pairs = zip(elements, element_names(elements), strict=True)
        self.set(write_element(element, name, f"environment[{k}]") for k, (element, name) in enumerate(pairs))

    def around(self, scene: Scene) -> Environment:
        """Return the environment of a scene of the world frame: the node's if it has no elements of its own.

        Elements with the id of an object are left out: a planning scene often has the objects, too.
        """
        if len(scene.environment.elements) or scene.environment.complete or not self.is_set:
            return scene.environment
        objects = {own.id for own in scene.objects}
        return Environment(
            elements=[element for element in self.message.elements if _object_of(element) not in objects]
        )


def objects_of(environment: Environment) -> set[str]:
    """Return the ids of the objects that elements of a planning scene belong to."""
    return {_object_of(element) for element in environment.elements}


def _object_of(element):
    return element.id.partition("/")[0]


def _named(element, k):
    """Return an element with an id; its place alone would change with other elements."""
    named = copy.copy(element)
    named.id = element_id(element, k)
    return named


class EnvironmentTopics:
    """The service ``~/set_environment`` and the topics that set and show the node's environment."""

    def __init__(self, server):
        self._server, node = server, server.node
        self._service = BackgroundService(server, SetEnvironment, "~/set_environment", self._set)
        self._subscriptions = [
            node.create_subscription(Environment, "~/environment", self._received, LATCHED)
        ]
        self._publisher = node.create_publisher(Environment, "~/current_environment", LATCHED)
        self._clients = []
        # planning scenes are processed one by one, in their order
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="environment")
        if topic := server.settings.planning_scene_topic:
            self._follow(topic)
        self.publish()

    def close(self):
        """Withdraw service and topics."""
        node = self._server.node
        self._service.close()
        for subscription in self._subscriptions:
            node.destroy_subscription(subscription)
        for client in self._clients:
            node.destroy_client(client)
        node.destroy_publisher(self._publisher)
        self._worker.shutdown(wait=False, cancel_futures=True)

    def publish(self):
        """Publish the current environment, if it is set."""
        if self._server.environment.is_set:
            self._publisher.publish(self._server.environment.message)

    def _set(self, request, response):
        with self._server.errors_into(response.result):
            environment = request.environment
            if (transform := self._server.frames.to_world(request.header, "header")) is not None:
                environment = transform.moved(environment)
            self._take(environment)

    def _received(self, message):
        self._worker.submit(self._take_received, message)

    def _take_received(self, message):
        warn = self._server.log.warning
        with self._server.errors_to(lambda problem: warn(f"an environment was ignored: {problem}")):
            self._take(message)

    def _take(self, environment):
        """Check an environment of the world frame, and take it over."""
        settings = self._server.settings
        read_environment(environment, self._server.library.shape_packer, settings.max_objects)
        self._server.environment.set(environment.elements)
        self.publish()

    def _follow(self, topic):
        """Follow MoveIt's planning scene."""
        try:
            scenes: Any = importlib.import_module("moveit_msgs.msg")
            services: Any = importlib.import_module("moveit_msgs.srv")
        except ImportError:
            self._server.log.warning("planning_scene_topic is set, but moveit_msgs is not installed")
            return
        node, self._world, self._asked = self._server.node, PlanningWorld(), False
        self._whole = node.create_client(services.GetPlanningScene, _WHOLE_SCENE)
        self._request = services.GetPlanningScene.Request()
        self._request.components.components = _WHOLE_WORLD
        self._clients.append(self._whole)
        self._subscriptions.append(
            node.create_subscription(
                scenes.PlanningScene,
                topic,
                lambda message: self._worker.submit(self._update, message),
                _QUEUE,
            )
        )

    def _update(self, message):
        """Apply a planning scene; ask for the whole one if the first message is a difference."""
        warn = self._server.log.warning
        with self._server.errors_to(lambda problem: warn(f"a planning scene was ignored: {problem}")):
            if message.is_diff and not self._asked and self._whole.service_is_ready():
                self._whole.call_async(self._request).add_done_callback(
                    lambda future: self._worker.submit(self._update, future.result().scene)
                )
            self._asked = True
            self._world.update(message)
            elements, problems = self._world.elements(self._pose_of_frame)
            for name, why in problems.items():
                self._server.log.warning(f"object '{name}' of the planning scene is left out: {why}")
            self._server.environment.set_planned(elements)
            self.publish()

    def _pose_of_frame(self, frame):
        """Return the pose of a frame in the world frame, by tf."""
        return self._server.frames.to_world(Header(frame_id=frame)) or IDENTITY
