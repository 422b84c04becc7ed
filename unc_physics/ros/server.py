"""What the node offers, on whatever kind of node it runs."""

from __future__ import annotations

import contextlib
import functools
import threading
import time
import traceback
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from unc_physics_msgs.msg import Result

from ..checks.errors import CanceledError, UncPhysicsError
from .candidates_service import CandidatesService
from .capabilities_service import CapabilitiesService
from .diagnostics import Diagnostics
from .frames import Frames
from .library_log import LibraryLog
from .long_prediction import LongPrediction
from .markers import MarkerTopic
from .model_topics import ModelTopics
from .models import ModelLibrary
from .parameters import ParameterServer
from .prediction_service import prediction_service
from .requests import Job, Outcome, read_request, run, write_answer, write_error
from .streaming import Stream
from .warm_up import warm_up

_OFFERS = (ModelTopics, CapabilitiesService, CandidatesService, LongPrediction, Stream, prediction_service)
# predictions compute outside Python's global lock; what counts is that none keeps the others waiting for a
# thread
_THREADS = 8


class PredictionServer:
    """The node's services, action and topics; `prepare` comes before `open`.

    Parameters
    ----------
    node : rclpy Node or LifecycleNode
    """

    def __init__(self, node):
        self.node = node
        self.log = node.get_logger()
        self._library_log = LibraryLog(self.log)
        self.parameters = ParameterServer(node)
        # a ModelLibrary from `prepare` on, and Frames, Diagnostics and a MarkerTopic from `open` on
        self.library: Any = None
        self.frames: Any = None
        self.diagnostics: Any = None
        self.markers: Any = None
        self.pool: ThreadPoolExecutor | None = None
        self._stopping = threading.Event()
        self._said_zeros = False
        self._open = []

    @property
    def settings(self):
        """Values of the parameters at this time."""
        return self.parameters.settings

    def prepare(self) -> None:
        """Find the models and warm up the kernels; takes seconds when nothing is in the cache yet."""
        started = time.perf_counter()
        self.library = ModelLibrary(self.settings.models_dir, self.settings.allow_model_paths)
        warm_up(self.settings)
        self.log.info(
            f"warmed up in {time.perf_counter() - started:.1f} s; models:"
            f" {', '.join(self.library.paths) or 'none'}"
        )

    def open(self) -> None:
        """Advertise everything."""
        self._stopping.clear()
        self.frames = self.frames or Frames(self.node, self.settings.world_frame)
        self.diagnostics, self.markers = Diagnostics(self), MarkerTopic(self)
        self.pool = ThreadPoolExecutor(_THREADS)
        self._open = [self.diagnostics, self.markers]
        for offer in _OFFERS:
            self._open.append(offer(self))
        self.log.info("ready")

    def close(self) -> None:
        """Take everything back; predictions that are being made end with the error CANCELED, and are answered
        so.
        """
        self._stopping.set()
        if self.pool is not None:
            self.pool.shutdown()
        while self._open:
            self._open.pop().close()

    def discard(self) -> None:
        """Delete what was written to disk, and leave the library's log; the last thing to do."""
        self._library_log.close()
        if self.library is not None:
            self.library.discard()

    def predict(self, job: Job, progress=None) -> Outcome:
        """Run a job; `stop` ends it.

        Parameters
        ----------
        job : Job
        progress : callable, optional
            Called now and then with the job, the steps done and all steps; what it raises ends the
            prediction.

        Raises
        ------
        UncPhysicsError
        """

        def look(done, steps):
            if self._stopping.is_set():
                raise CanceledError("is shutting down", field="the node")
            if progress is not None:
                progress(job, done, steps)

        if job.zeros_replaced and not self._said_zeros:
            self._said_zeros = True
            self.log.warning(
                "a covariance of zeros was read as unknown and takes the defaults of the parameters; set "
                "zero_covariance to 'exact' if it means exactly known (said once)"
            )
        outcome = run(job, look)
        self.diagnostics.predicted(outcome.prediction)
        return outcome

    def answer(self, message, request, *, progress=None, **how) -> Callable[[], None] | None:
        """Predict what a request asks for, and write the answer or the error into ``message``; never raises.

        Returns what may be done when the answer is on its way: to show its markers.

        Parameters
        ----------
        message : message
            With a ``result`` and a ``prediction``.
        request : PredictionRequest
        progress : callable, optional
            As for `predict`.
        **how
            As for `read_request`.
        """
        with self.errors_into(message.result):
            settings, header = self.settings, request.scene.header
            job = read_request(request, settings, self.library, self.frames, **how)
            try:
                write_answer(message.prediction, header, settings, job, self.predict(job, progress))
                return functools.partial(self.markers.publish, header, job, message.prediction)
            except UncPhysicsError as error:
                if error.prediction is not None:
                    write_answer(message.prediction, header, settings, job, error.prediction)
                raise

    @contextlib.contextmanager
    def errors_into(self, result: Result):
        """Write what is raised inside into a request's result: whatever that holds, the node lives on."""
        try:
            yield
        except UncPhysicsError as error:
            write_error(result, error)
        except Exception as error:  # noqa: BLE001
            self.log.error(f"a fault of the node:\n{traceback.format_exc()}")
            write_error(result, error)
        if result.error_code:
            self.diagnostics.failed(result.error_msg)
