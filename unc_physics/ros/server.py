"""Services, action and topics of the node, for any kind of node."""

from __future__ import annotations

import contextlib
import copy
import functools
import math
import os
import threading
import time
import traceback
from collections.abc import Callable, Iterable
from concurrent import futures
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from unc_physics_msgs.msg import Prediction as PredictionMessage
from unc_physics_msgs.msg import PredictionRequest, Result
from unc_physics_msgs.srv import Predict

from ..checks.errors import CanceledError, ErrorCode, InvalidOptionError, NotReadyError, UncPhysicsError
from ..checks.names import hint
from ..checks.shown import printable
from ..compiler.compile_time import FIRST_USE
from ..compiler.refusal import CompilationRefused, refused_compilation
from ..prediction import warm_up as core
from ..prediction.prediction import Prediction
from ..prediction.request_checks import marks_of
from ..propagators.names import REFERENCE
from ..shapes.distance import signed_distance
from ..spatial.layout import POSITION, QUATERNION
from .candidates import CandidatesService
from .diagnostics import Diagnostics, LibraryLog, ThrottledWarnings
from .long_prediction import LongPrediction
from .markers import MarkerTopic
from .messages.fields import seconds, write_error
from .messages.frames import Frames
from .messages.prediction import write_answer
from .messages.request import UNLIMITED, Job, RequestedOutputs, TimeLimits, as_sent, read_request
from .messages.scene import FieldNames
from .models import ModelLibrary, ModelTopics
from .node_environment import EnvironmentTopics, NodeEnvironment
from .parameters import ParameterServer
from .services import BackgroundService, CapabilitiesService
from .stability import StabilityService
from .streams import Stream
from .tracking import Tracking
from .tracks import warm_up_tracker

_INTERFACES = (
    ModelTopics,
    EnvironmentTopics,
    CapabilitiesService,
    CandidatesService,
    LongPrediction,
    StabilityService,
)
# upper limit; predictions run in numba's threads, these mostly wait, for example for a transform
_THREADS = 64
_COMPILED_ANSWER = 1.0  # s, of computation for an answer that only compiles
_CHECK_PERIOD = 0.1  # s, between checks of a request that waits for a kernel
_DELIVERY = 0.3  # s, that services stay after an answer
_LONG_WARM_UP = 5.0  # s, warm-up of one propagator that is logged


class PredictionServer:
    """Services, action and topics of the node; call `prepare` before `open`.

    Parameters
    ----------
    node : rclpy Node or LifecycleNode
    """

    def __init__(self, node):
        self.node = node
        self.log = node.get_logger()
        self._library_log = LibraryLog(self.log)
        self.warn = ThrottledWarnings(self.log)
        self.parameters = ParameterServer(node)
        # a ModelLibrary after `prepare`; Frames, Diagnostics and a MarkerTopic after `open`
        self.library: Any = None
        self.frames: Any = None
        self.diagnostics: Any = None
        self.markers: Any = None
        self.tracking: Any = None  # a Tracking after `open`, with the parameter track
        self.environment = NodeEnvironment()
        self.pool: ThreadPoolExecutor | None = None
        self.ending: str | None = None  # reason why predictions end
        self.answered = 0.0  # time of the newest answer that a thread of the pool sent [s]
        self._warned_zeros = self._warned_misspelt = False
        self._opened, self._lock = threading.Lock(), threading.Lock()
        self._compiler: Any = None  # a thread that compiles for requests, after `open`
        self._compiling: dict[str, futures.Future] = {}  # by kernel
        self._open = []

    @property
    def settings(self):
        """Current values of the parameters."""
        return self.parameters.settings

    @property
    def is_open(self) -> bool:
        """Whether all interfaces are advertised."""
        return bool(self._open)

    def prepare(self) -> None:
        """Find the models and warm up the kernels, which takes minutes with an empty cache."""
        started = time.perf_counter()
        self.library = ModelLibrary(self.settings.models_dir, self.settings.allow_model_paths)
        if (folder := self.settings.models_dir) and not os.path.isdir(os.path.expanduser(folder)):
            self.log.warning(f"models_dir is no folder: {printable(folder)}")
        self._check_models()
        if self.settings.environment:
            self.environment.load(os.path.expanduser(self.settings.environment))
        names = dict.fromkeys(filter(None, self.settings.warm_up))
        if names:
            names[self.settings.stream_propagator] = None
        self.log.info(
            f"warming up {', '.join(names) or 'nothing'}: seconds where its kernels are compiled, minutes at"
            " the very first start; services are advertised after that"
        )
        warm_up(names, self.settings, self._log_warm)
        if self.settings.track:
            core.warm_up((REFERENCE,), self.settings.physics, warm_up_tracker)
        self.log.info(
            f"warmed up in {time.perf_counter() - started:.1f} s; models:"
            f" {', '.join(self.library.models) or 'none'}"
        )

    def _check_models(self):
        """Raise an error for classes in the parameters whose model is unknown."""
        settings = self.settings
        named = [
            ("observed_objects", settings.classes.get(kind, (kind,))[0])
            for kind in settings.observed.values()
        ]
        for parameter, model in [*named, *(("class_models", own.model) for own in settings.classes.values())]:
            if model not in self.library:
                known = self.library.models
                raise InvalidOptionError(
                    f"names an unknown model{hint(model, known)}", field=parameter, value=model
                )

    def _log_warm(self, name, seconds):
        if seconds > _LONG_WARM_UP:
            self.log.info(f"{name} is warm after {seconds:.0f} s")

    def open(self) -> None:
        """Advertise all interfaces."""
        with self._opened:
            self.ending = None
            self.frames = self.frames or Frames(
                self.node, self.settings.world_frame, lambda: self.settings.transform_timeout
            )
            self.diagnostics, self.markers = Diagnostics(self), MarkerTopic(self, "~/markers")
            self.pool = ThreadPoolExecutor(_THREADS, thread_name_prefix="requests")
            self._compiler = ThreadPoolExecutor(1, thread_name_prefix="compilation")
            self._open = [self.diagnostics, self.markers]
            for interface in _INTERFACES:
                self._open.append(interface(self))
            self._open.append(BackgroundService(self, Predict, "~/predict", self._predict))
            stream = Stream(self)
            self._open.append(stream)
            if self.settings.track:
                self.tracking = Tracking(self, stream)
                self._open.append(self.tracking)
        self._warn_misspelt()
        self.log.info("ready")

    def _warn_misspelt(self):
        """Warn once about unknown parameters of the node's start."""
        if not self._warned_misspelt:
            self._warned_misspelt = True
            for name, meant in self.parameters.misspelt().items():
                self.log.warning(f"parameter '{name}' is unknown and has no effect{meant}")

    def close(self, why: str = "is shutting down") -> None:
        """Withdraw all interfaces; running predictions end with the error CANCELED.

        Parameters
        ----------
        why : str
            The node's state in these errors.
        """
        self.ending = why
        with self._opened:
            if self.pool is not None:
                self.pool.shutdown()
                self._compiler.shutdown(cancel_futures=True)
            # the middleware loses an answer if its service is gone before the client has read it
            time.sleep(max(0.0, self.answered + _DELIVERY - time.monotonic()))
            while self._open:
                self._open.pop().close()

    def discard(self) -> None:
        """Delete files and detach from the library's log; call this last."""
        self._library_log.close()
        if self.library is not None:
            self.library.discard()

    def check_open(self) -> None:
        """Raise `CanceledError` if predictions must end."""
        if self.ending is not None:
            raise CanceledError(self.ending, field="the node")

    def read(
        self, request: PredictionRequest, *, limits: TimeLimits = UNLIMITED, fields: FieldNames | None = None
    ) -> Job:
        """Read and check a request in the node's environment.

        Parameters
        ----------
        request : PredictionRequest
        limits : TimeLimits, optional
        fields : FieldNames, optional
            As for `read_request`.

        Raises
        ------
        UncPhysicsError
        """
        return read_request(
            request,
            self.settings,
            self.library,
            self.frames,
            limits=limits,
            fields=fields,
            environment_of=self.environment.around,
        )

    def predict(self, job: Job, progress=None) -> Prediction:
        """Run a job until it is done or `close` ends it.

        Parameters
        ----------
        job : Job
        progress : callable, optional
            Called periodically with the job, the steps done and the total; an exception from it ends the
            prediction.

        Raises
        ------
        UncPhysicsError
        """

        def report(done, steps):
            self.check_open()
            if progress is not None:
                progress(job, done, steps)

        if job.zeros_replaced and not self._warned_zeros:
            self._warned_zeros = True
            self.log.warning(
                "a covariance of zeros was read as unknown and takes the defaults of the parameters; set "
                "zero_covariance to 'exact' if it means exactly known (logged once)"
            )
        for name, changes in job.notes.items():
            self.diagnostics.predictions.add("changed covariances")
            self.warn("covariance", f"object '{name}': {'; '.join(changes)}")
        prediction = job.run(report)
        self.diagnostics.predicted(prediction)
        return prediction

    def _predict(self, request, response):
        """Answer a call of ``~/predict``; calls run concurrently."""
        settings = self.settings
        limits = TimeLimits(settings.max_computation_time, settings.default_time_budget)
        return self.answer(response, request.request, limits=limits)

    def answer(
        self,
        message,
        request: PredictionRequest,
        *,
        progress=None,
        limits: TimeLimits = UNLIMITED,
        fields: FieldNames | None = None,
        check: Callable[[], object] = lambda: None,
        compiles: bool = False,
    ) -> Callable[[], None] | None:
        """Predict and write the answer or the error into ``message``; never raises.

        Returns a function that publishes the markers, to be called after the answer is sent.

        Parameters
        ----------
        message : message
            Message with a ``result`` and a ``prediction``.
        request : PredictionRequest
        progress : callable, optional
            As for `predict`.
        limits : TimeLimits, optional
        fields : FieldNames, optional
            As for `read`.
        check : callable, optional
            Called periodically while another thread compiles; an exception from it ends the waiting.
        compiles : bool
            Whether this thread compiles kernels that are missing. Otherwise it waits for a thread that does,
            as long as the prediction may take.
        """
        with self.errors_into(message.result):
            asked = seconds(request.max_computation_time)
            longest = min(asked or math.inf, math.inf if limits.limit is None else limits.limit)
            end, waited = time.monotonic() + longest, set()
            while True:
                try:
                    with refused_compilation(not compiles):
                        return self._answer(message, request, progress, limits, fields)
                except CompilationRefused as refused:
                    message.prediction = PredictionMessage()
                    compiles = str(refused) in waited  # the other thread did not get as far as this kernel
                    waited.add(str(refused))
                    if not compiles:
                        self._wait_for_kernel(request, str(refused), end, check)

    def _answer(self, message, request, progress, limits, fields):
        """Predict, write the answer into ``message``, and return a function that publishes the markers."""
        settings, header = self.settings, request.scene.header
        try:
            job = self.read(request, limits=limits, fields=fields)
            try:
                write_answer(message.prediction, header, settings, job, self.predict(job, progress))
            except UncPhysicsError as error:
                if error.prediction is not None:
                    write_answer(message.prediction, header, settings, job, error.prediction)
                raise
        except UncPhysicsError as error:
            raise as_sent(error, request) from None
        return functools.partial(self.markers.publish, header, job, message.prediction)

    def _wait_for_kernel(self, request, kernel, end, check):
        """Wait until a kernel of a request is compiled in the background.

        Parameters
        ----------
        request : PredictionRequest
        kernel : str
        end : float
            Latest time, on the monotonic clock [s].
        check : callable
            Called periodically; an exception from it ends the waiting.

        Raises
        ------
        NotReadyError
            At the latest time.
        """
        compiled = self._compile_for(request, kernel)
        while not compiled.done():
            self.check_open()
            check()
            if (left := end - time.monotonic()) <= 0.0:
                raise NotReadyError(
                    f"still compiles kernel '{kernel}' for this request, which takes {FIRST_USE}; ask again,"
                    " or start the node with its propagator in the parameter warm_up",
                    field="the node",
                )
            futures.wait([compiled], min(left, _CHECK_PERIOD))

    def _compile_for(self, request, kernel) -> futures.Future:
        """Return the future of the compilation of what a request needs, by answering it in the background."""
        with self._lock:
            self.check_open()
            if kernel in self._compiling:
                return self._compiling[kernel]
            compiled = self._compiler.submit(self._compile, copy.deepcopy(request), kernel)
            self._compiling[kernel] = compiled
        return compiled

    def _compile(self, request, kernel):
        began = time.perf_counter()
        self.log.info(f"compiling for a request: kernel '{kernel}' and what else it needs")
        try:
            self.answer(Predict.Response(), request, limits=TimeLimits(_COMPILED_ANSWER), compiles=True)
        finally:
            with self._lock:
                self._compiling.pop(kernel, None)
        self.log.info(f"compiled in {time.perf_counter() - began:.1f} s")

    @contextlib.contextmanager
    def errors_to(self, report: Callable[[str], object]):
        """Report the message of an exception of the ``with`` block, unless it ends a prediction as asked."""
        result = Result()
        with self.errors_into(result):
            yield
        if result.error_code not in (ErrorCode.NONE, ErrorCode.CANCELED):
            report(result.error_msg)

    @contextlib.contextmanager
    def errors_into(self, result: Result):
        """Write an exception of the ``with`` block into a request's result; no request ends the node."""
        try:
            yield
        except UncPhysicsError as error:
            write_error(result, error)
        except Exception as error:  # noqa: BLE001
            self.log.error(f"a fault of the node:\n{traceback.format_exc()}")
            write_error(result, error)
        if result.error_code not in (ErrorCode.NONE, ErrorCode.CANCELED):
            self.diagnostics.failed(result.error_code, result.error_msg)


def warm_up(names: Iterable[str], settings, done: Callable[[str, float], object]) -> None:
    """Compile or load the kernels of propagators, and of the node's physics, detections and answers.

    ``done`` is called with the name of each propagator and its duration [s].
    """
    begun = time.perf_counter()

    def answer(scene, belief, propagator, horizon):
        nonlocal begun
        job = Job(
            scene=scene,
            belief=belief,
            models=(core.MODEL,) * len(scene.bodies),
            propagator=propagator,
            marks=marks_of(scene, horizon, None),
            seed=1,
            return_samples=2,
            outputs=RequestedOutputs(True, propagator.traits.cross_body, True, True),
        )
        message = PredictionMessage()
        write_answer(message, message.header, settings, job, job.run())
        first, second, *_ = zip(scene.bodies, belief.mean, strict=True)
        signed_distance(*_placed(*first), *_placed(*second))  # of detections from what they stand on
        begun, before = time.perf_counter(), begun
        done(propagator.name, begun - before)

    core.warm_up(names, settings.physics, answer)


def _placed(body, state):
    """Return a body's model and pose."""
    return body.model, (state[POSITION], state[QUATERNION])
