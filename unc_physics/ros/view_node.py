"""The executable ``unc_physics_view``: a browser page that shows streamed scenes."""

from __future__ import annotations

import threading
import traceback
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node

from unc_physics_msgs.msg import Environment, TrackedObjects

from ..checks.errors import UncPhysicsError
from ..view.page import Page
from ..view.session import Session, check_installed
from .detected import mass_of
from .diagnostics import ThrottledWarnings
from .environment import NodeEnvironment
from .messages.frames import Frames
from .messages.request import read_request
from .messages.tracking import scene_of_tracked
from .models import ModelLibrary
from .node import leave, run
from .parameters import ParameterServer
from .scene_topics import LatestWorker, SceneTopics, StreamedScene, prepared, stamp_problem
from .services import LATCHED
from .stream_pace import Pace
from .streams import request_of

_VIEW_PARAMETERS = {
    "host": ("127.0.0.1", "Address that the page listens on; everybody who reaches it sees the page."),
    "port": (8080, "Port that the page listens on."),
    "frames": (40, "Number of times that the page shows."),
    "ghosts": (20, "Number of samples that it draws."),
}


class ViewNode(Node):
    """Node that predicts the newest streamed scene as the prediction node does, and shows it.

    It has the parameters of that node and subscribes to the same topics, under ``unc_physics``, and to the
    objects that the node tracks. The page opens with the first scene.

    Attributes
    ----------
    page : Page or None
        None until the first scene.
    """

    failed, is_ready = None, True

    def __init__(self, node_name: str = "unc_physics_view", **others):
        super().__init__(node_name, **others)
        check_installed("the page")
        self._own: dict[str, Any] = {
            name: self.declare_parameter(
                name, default, ParameterDescriptor(description=description, read_only=True)
            ).value
            for name, (default, description) in _VIEW_PARAMETERS.items()
        }
        self.page: Page | None = None
        self._warn = ThrottledWarnings(self.get_logger())
        self._opening = threading.Lock()  # each source has its own thread
        self.parameters = ParameterServer(self)
        settings = self.parameters.settings
        self.library = ModelLibrary(settings.models_dir, settings.allow_model_paths)
        self.frames = Frames(self, settings.world_frame, lambda: self.parameters.settings.transform_timeout)
        self.environment = NodeEnvironment()
        self.create_subscription(
            Environment,
            "unc_physics/current_environment",
            lambda message: self.environment.set(message.elements),  # pyright: ignore[reportAttributeAccessIssue]
            LATCHED,
        )
        self.topics = SceneTopics(
            self, self.parameters, self.library, self.frames, self._show, lambda: None, "unc_physics"
        )
        self._newest_tracked = LatestWorker(self._show, lambda: None)
        self.create_subscription(TrackedObjects, "unc_physics/tracked", self._show_tracked, 1)
        self.get_logger().info("ready: waits for a scene")

    def _show_tracked(self, message):
        scene = scene_of_tracked(message, self._mass_of)
        self._newest_tracked.put(StreamedScene(scene, False, Pace()))

    def _mass_of(self, model):
        return mass_of(model, self.library, self.parameters.settings.tracked_mass)

    def _show(self, streamed):
        settings = self.parameters.settings
        try:
            if (reason := stamp_problem(self, streamed.scene.header.stamp, settings)) is not None:
                self._warn("dropped", f"a scene was dropped: {reason}")
                return
            scene, _ = prepared(streamed, self.frames, self.environment, self.library, settings)
            if not scene.objects:
                return
            job = read_request(
                request_of(scene, settings),
                settings,
                self.library,
                self.frames,
                environment_of=self.environment.around,
            )
            with self._opening:
                if self.page is None:
                    self._open(job)
                else:
                    self.page.follow(job.scene, job.belief)
        except UncPhysicsError as error:
            self._warn("failed", f"a scene is not shown: {error}")
        except Exception:  # noqa: BLE001  (no scene may end the node)
            self.get_logger().error(f"a fault of the node:\n{traceback.format_exc()}")

    def _open(self, job):
        host, port, frames, ghosts = self._own.values()
        session = Session(job.scene, job.belief, job.horizon, job.propagator, frames, ghosts)
        self.page = Page(session, host, port, "unc_physics")
        self.get_logger().info(f"http://{host}:{self.page.port} shows the scene")

    def close(self) -> None:
        """Unsubscribe and close the page."""
        self.topics.close()
        self._newest_tracked.close()
        if self.page is not None:
            self.page.close()

    def destroy_node(self):
        """Delete files and destroy the node."""
        self.library.discard()
        super().destroy_node()


def main(arguments=None) -> None:
    """Show scenes until SIGINT or SIGTERM, then end the process."""
    leave(run(ViewNode, arguments, "unc_physics_view"))


if __name__ == "__main__":
    main()
