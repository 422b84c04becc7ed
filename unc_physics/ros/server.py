"""What the node offers, on whatever kind of node it runs."""

from __future__ import annotations

import contextlib
import functools
import os
import threading
import time
import traceback
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from unc_physics_msgs.msg import Result
from unc_physics_msgs.srv import ListModels

from ..checks.errors import CanceledError, ErrorCode, UncPhysicsError
from ..checks.shown import printable
from .background import HandOver
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
# at most: they begin when they are needed. Predictions compute outside Python's global lock, in other
# threads; what counts is that none that waits for a transform, say, keeps others waiting
_THREADS = 64
_LONG_WARM_UP = 5.0  # s, of one propagator: worth a line in the log


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
        self.hand_over: Any = None
        self.ending: str | None = None  # why predictions end
        self._said_zeros = self._said_misspelt = False
        self._opened = threading.Lock()
        self._open = []

    @property
    def settings(self):
        """Values of the parameters at this time."""
        return self.parameters.settings

    @property
    def is_open(self) -> bool:
        """Whether everything is advertised."""
        return bool(self._open)

    def prepare(self) -> None:
        """Find the models and warm up the kernels; takes minutes when nothing is in the cache yet."""
        started = time.perf_counter()
        self.library = ModelLibrary(self.settings.models_dir, self.settings.allow_model_paths)
        if (folder := self.settings.models_dir) and not os.path.isdir(os.path.expanduser(folder)):
            self.log.warning(f"models_dir is no folder: {printable(folder)}")
        names = [name for name in self.settings.warm_up if name]
        self.log.info(
            f"warming up {', '.join(names) or 'nothing'}: seconds where its kernels are compiled, minutes at"
            " the very first start; services are advertised after that"
        )
        warm_up(self.settings, self._said_warm)
        self.log.info(
            f"warmed up in {time.perf_counter() - started:.1f} s; models:"
            f" {', '.join(self.library.paths) or 'none'}"
        )

    def _said_warm(self, name, seconds):
        if seconds > _LONG_WARM_UP:
            self.log.info(f"{name} is warm after {seconds:.0f} s")

    def open(self) -> None:
        """Advertise everything."""
        with self._opened:
            self.ending = None
            self.frames = self.frames or Frames(
                self.node, self.settings.world_frame, lambda: self.settings.transform_timeout
            )
            self.diagnostics, self.markers = Diagnostics(self), MarkerTopic(self, "~/markers")
            self.pool = ThreadPoolExecutor(_THREADS, thread_name_prefix="requests")
            self.hand_over = HandOver(self, ListModels, "~/list_models")
            self._open = [self.hand_over, self.diagnostics, self.markers]
            for offer in _OFFERS:
                self._open.append(offer(self))
        self._tell_misspelt()
        self.log.info("ready")

    def _tell_misspelt(self):
        """Warn of parameters that the node was started with and does not know; once."""
        if not self._said_misspelt:
            self._said_misspelt = True
            for name, meant in self.parameters.misspelt().items():
                hint = f"; is '{meant}' meant?" if meant else ""
                self.log.warning(f"parameter '{name}' is unknown and has no effect{hint}")

    def close(self, why: str = "is shutting down") -> None:
        """Take everything back; predictions that are being made end with the error CANCELED, and are answered
        so.

        Parameters
        ----------
        why : str
            What those errors say of the node.
        """
        self.ending = why
        with self._opened:
            if self.pool is not None:
                self.pool.shutdown()
            while self._open:
                self._open.pop().close()

    def discard(self) -> None:
        """Delete what was written to disk, and leave the library's log; the last thing to do."""
        self._library_log.close()
        if self.library is not None:
            self.library.discard()

    def check_open(self) -> None:
        """Raise `CanceledError` if predictions are to end."""
        if self.ending is not None:
            raise CanceledError(self.ending, field="the node")

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
            self.check_open()
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
        if result.error_code not in (ErrorCode.NONE, ErrorCode.CANCELED):
            self.diagnostics.failed(result.error_msg)
