"""What the node offers, on whatever kind of node it runs."""

from __future__ import annotations

import threading
import time
import traceback

from rclpy.callback_groups import ReentrantCallbackGroup

from unc_physics_msgs.srv import Predict

from ..errors import CanceledError, UncPhysicsError
from .models import ModelLibrary
from .parameters import ParameterServer
from .requests import Job, read_request, run, write_answer, write_error
from .warm_up import warm_up


class PredictionServer:
    """The node's services; `prepare` comes before `open`.

    Parameters
    ----------
    node : rclpy Node or LifecycleNode
    """

    def __init__(self, node):
        self.node = node
        self.log = node.get_logger()
        self.parameters = ParameterServer(node)
        self.library: ModelLibrary | None = None
        self._stopping = threading.Event()
        self._said_zeros = False
        self._closers = []

    @property
    def settings(self):
        """Values of the parameters at this time."""
        return self.parameters.settings

    def prepare(self) -> None:
        """Find the models and warm up the kernels; takes seconds when nothing is in the cache yet."""
        started = time.perf_counter()
        self.library = ModelLibrary(self.settings.models_dir, self.settings.allow_model_paths)
        warm_up(self.settings, Predict.Response)
        self.log.info(f"warmed up in {time.perf_counter() - started:.1f} s; models: {', '.join(self.library.paths) or 'none'}")

    def open(self) -> None:
        """Advertise the services."""
        self._stopping.clear()
        node = self.node
        service = node.create_service(Predict, "~/predict", self._predict, callback_group=ReentrantCallbackGroup())
        self._closers.append(lambda: node.destroy_service(service))
        self.log.info(f"ready: {service.srv_name if hasattr(service, 'srv_name') else '~/predict'}")

    def close(self) -> None:
        """Take the services back."""
        while self._closers:
            self._closers.pop()()

    def stop(self) -> None:
        """End predictions that are being made, with the error CANCELED."""
        self._stopping.set()

    def predict(self, job: Job, progress=None):
        """Run a job; `stop` ends it.

        Raises
        ------
        UncPhysicsError
        """
        def look(done, steps):
            if self._stopping.is_set():
                raise CanceledError("is shutting down", field="the node")
            if progress is not None:
                progress(done, steps)

        if job.zeros_replaced and not self._said_zeros:
            self._said_zeros = True
            self.log.warning(
                "a covariance of zeros was read as unknown and takes the defaults of the parameters; set "
                "zero_covariance to 'exact' if it means exactly known (said once)"
            )
        return run(job, look)

    def answer(self, message, header, request, *, time_limit=None, progress=None) -> None:
        """Predict what a request asks for, and write the answer or the error into ``message``; never raises."""
        settings = self.settings
        try:
            job = read_request(request, settings, self.library, time_limit=time_limit)
            try:
                write_answer(message, header, settings, job, self.predict(job, progress))
            except UncPhysicsError as error:
                if hasattr(error, "outcome"):
                    write_answer(message, header, settings, job, error.outcome)
                raise
        except UncPhysicsError as error:
            write_error(message, error)
        except Exception as error:  # noqa: BLE001  (whatever a request holds, the node lives on)
            self.log.error(f"a fault of the node:\n{traceback.format_exc()}")
            write_error(message, error)

    def _predict(self, request, response):
        self.answer(response, request.header, request, time_limit=self.settings.max_computation_time)
        return response
