"""Tracking: topics and services of the objects that the node keeps a belief about."""

from __future__ import annotations

import contextlib
import functools
import math
import threading
from concurrent.futures import CancelledError, ThreadPoolExecutor
from typing import Any

from diagnostic_msgs.msg import KeyValue
from rclpy.clock import Clock, ClockType
from std_msgs.msg import Header

from unc_physics_msgs.msg import ActionArray, Prediction, TrackedObjects
from unc_physics_msgs.srv import Fork, Reset

from ..checks.errors import CanceledError, DivergedError, PredictionTimeoutError
from ..checks.names import hint
from ..compiler.compile_time import clock
from ..prediction.prediction import Prediction as CorePrediction
from ..prediction.request_checks import marks_of
from ..scene.belief import Belief
from ..scene.scene import Scene
from .detected import Detection3DArray, Detections, detection_subscriptions
from .diagnostics import Problem, ThrottledWarnings
from .messages.clocks import on_clock_jump, stamp_age, stamp_problem
from .messages.fields import nanoseconds, seconds, stamp_of
from .messages.prediction import write_answer
from .messages.request import RequestedOutputs, limited_regions, read_horizon, read_marks
from .node_environment import HOW_TO_SET
from .services import BackgroundService
from .stream_pace import LatestWorker, Pace
from .streams import TRACKED, TransformTopic
from .tracks import MEMBERS, Tracks

#: Topic of the paths of prescribed objects.
ACTIONS = "~/robot_motion"
_DEPTH = 20  # observations of a source that wait in the middleware
_PENDING = 100  # observations that wait for the tracker
_WAITING = 16  # of them, for a transform
#: Longest time that one call of the tracker computes [s]; a tracker that needs more never catches up.
_LONGEST_STEP = 1.0


class Tracking:
    """Observations and actions in, tracked objects and predictions out, and what-if questions.

    One thread corrects the tracker by observations, in the order of their arrival. Another predicts the
    newest belief. Observations wait for their transforms in other threads.

    Parameters
    ----------
    server : PredictionServer
    stream : Stream
        Publishes the predictions.
    """

    def __init__(self, server, stream):
        self._server, self._stream, node = server, stream, server.node
        self._warn = ThrottledWarnings(server.log)
        self._call = threading.local()  # end of the tracker's present call in each thread [s]
        self._tracks = Tracks(server.library, server.environment, self._check)
        self._lock = threading.Lock()  # of the tracks
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="tracking")
        self._waiting = ThreadPoolExecutor(_WAITING, thread_name_prefix="transforms")
        self._predictor, self._ended = LatestWorker(self._predict, lambda: None), threading.Event()
        self._pending, self._pending_lock = 0, threading.Lock()
        self._pace, self._predicted, self._unpredicted = Pace(), 0, 0  # newest stamp [ns], number of stamps
        self._skipped: dict[str, str] = {}
        self._is_going_on = self._is_unpublished = False
        self._clock: Any = node.get_clock()
        self._heard: tuple[int, int] | None = None  # newest stamp, and the clock when it arrived [ns]
        self._counts = server.diagnostics.track()
        self._tracked = node.create_publisher(TrackedObjects, "~/tracked", 1)
        self._transforms = TransformTopic(server, TRACKED)
        self._services = [
            BackgroundService(server, Fork, "~/fork", self._fork),
            BackgroundService(server, Reset, "~/reset", self._reset),
        ]
        if Detection3DArray is None:
            server.log.warning("vision_msgs is not installed: there is no topic ~/detections")
        correct = functools.partial(self._pass_on, self._correct)
        self._subscriptions = [
            *detection_subscriptions(server, correct, correct, _DEPTH),
            node.create_subscription(
                ActionArray, ACTIONS, functools.partial(self._pass_on, self._act), _DEPTH
            ),
        ]
        # a steady clock, as simulated time may stop
        self._timer = node.create_timer(
            1.0 / server.settings.tracked_rate, self._tick, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )
        self._jumps = on_clock_jump(node, self._jumped)
        self._warn_at_start()

    def close(self) -> None:
        """Withdraw topics and services."""
        node = self._server.node
        self._ended.set()
        self._jumps.unregister()
        node.destroy_timer(self._timer)
        for service in self._services:
            service.close()
        for subscription in self._subscriptions:
            node.destroy_subscription(subscription)
        self._waiting.shutdown(cancel_futures=True)
        self._worker.shutdown(cancel_futures=True)
        self._predictor.close()
        node.destroy_publisher(self._tracked)
        self._transforms.close()

    def _check(self):
        """End a call of the tracker that takes too long, or when the node closes."""
        self._server.check_open()
        if clock() > getattr(self._call, "end", math.inf):
            raise PredictionTimeoutError(
                f"took longer than {_LONGEST_STEP:g} s: are objects inside each other, or too many?",
                field="the tracker",
            )

    @contextlib.contextmanager
    def _limited(self, longest: float = _LONGEST_STEP):
        """Limit the time of the tracker's calls in a ``with`` block; compilation does not count."""
        self._call.end = clock() + longest
        try:
            yield
        finally:
            del self._call.end

    def _warn_at_start(self):
        """Warn about settings with which observations will be left out."""
        server, settings = self._server, self._server.settings
        for model in settings.symmetries:
            if model not in server.library:
                server.log.warning(
                    f"parameter symmetric_models: '{model}' is no model{hint(model, server.library.models)}"
                )
        if server.environment.is_missing(settings) and not settings.planning_scene_topic:
            server.log.warning(f"nothing is tracked before the node's environment is set: {HOW_TO_SET}")

    # -- input, in the executor's thread -----------------------------------------------------------

    def _pass_on(self, work, message):
        """Have the worker process a message, once its transform is there."""
        self._counts.heard()
        header = message.header
        if not (header.stamp.sec or header.stamp.nanosec):
            header.stamp = self._clock.now().to_msg()
        with self._pending_lock:
            if self._pending >= _PENDING:
                self._counts.add("dropped messages")
                return
            self._pending += 1
        with contextlib.suppress(RuntimeError):  # the node is closing
            if self._server.frames.is_world(header.frame_id):
                self._worker.submit(self._process, work, message, None)
            else:
                self._waiting.submit(self._transform, work, message)

    def _transform(self, work, message):
        with self._server.errors_to(lambda problem: self._leave_out(message, problem)):
            transform = self._server.frames.to_world(message.header, "header")
            with contextlib.suppress(RuntimeError):
                self._worker.submit(self._process, work, message, transform)
            return
        with self._pending_lock:
            self._pending -= 1

    def _tick(self):
        """Go on without observations, unless the worker still does."""
        if self._heard is not None and not self._is_going_on:
            self._is_going_on = True
            with contextlib.suppress(RuntimeError):
                self._worker.submit(self._go_on)

    def _jumped(self, _):
        """Forget what belongs to the time before a jump of the clock."""
        self._server.log.warning("the clock changed or jumped back: the tracker starts anew")
        with contextlib.suppress(RuntimeError):
            self._worker.submit(self._clear)

    # -- in the worker's thread --------------------------------------------------------------------

    def _process(self, work, message, transform):
        with self._pending_lock:
            self._pending -= 1
        settings = self._server.settings
        with self._guarded(lambda problem: self._leave_out(message, problem)):
            if (reason := stamp_problem(self._server.node, message.header.stamp, settings)) is None:
                work(message, transform, settings)
                return
            self._counts.add("dropped messages")
            self._counts.warn(f"dropped messages: {reason}")
            self._warn("dropped", f"a message to the tracker was dropped: {reason}")

    @contextlib.contextmanager
    def _guarded(self, report=None):
        """Limit the time of a ``with`` block, and start anew if the tracker cannot go on after it.

        ``report`` takes the message of an exception; by default it is logged.
        """
        report = report or (lambda problem: self._warn("failed", f"the tracker failed: {problem}"))
        with self._server.errors_to(report):
            try:
                with self._limited():
                    yield
            except (DivergedError, PredictionTimeoutError) as error:
                self._counts.warn(f"the tracker starts anew: {error}", Problem.FAULT)
                self._clear()
                raise

    def _leave_out(self, message, reason):
        """Report that a whole message was left out."""
        if isinstance(message, Detections):
            skipped = {own.id: reason for own in message.objects}
        else:
            skipped = {ACTIONS: reason}
        self._report_skipped(skipped)

    def _report_skipped(self, skipped):
        for name, reason in skipped.items():
            self._warn("left out", f"an observation of '{name}' was left out: {reason}")
        self._counts.add("skipped observations", len(skipped))
        if reason := next(iter(skipped.values()), ""):
            self._counts.warn(f"skipped observations: {reason}")
        with self._lock:
            self._skipped.update(skipped)

    def _correct(self, observation, transform, settings):
        objects = observation.objects
        if transform is not None:
            objects = transform.moved(objects)
        stamp, counts = nanoseconds(observation.header.stamp), self._counts
        with self._lock:
            found = self._tracks.observe(stamp, objects, observation.named, settings)
            counts.set("objects", len(self._tracks.names))
        counts.add("observations", len(objects))
        counts.add("rejected observations", found.rejected)
        counts.add("duplicate observations", found.duplicates)
        counts.add("new objects", found.births)
        for text in found.hints:
            counts.warn(text)
            self._server.log.warning(text)
        counts.add("late observations", len(objects) * found.is_late)
        if found.is_too_late:
            counts.add("observations beyond the window", len(objects))
            counts.warn(
                "observations beyond the window: observations are later than tracking_window of"
                f" {settings.tracking_window:g} s"
            )
        if (delay := stamp_age(self._server.node, observation.header.stamp)) is not None:
            counts.set("last delay [s]", delay)
        if skipped := {**observation.skipped, **found.skipped}:
            self._report_skipped(skipped)
        if self._heard is None or stamp > self._heard[0]:
            self._heard = stamp, self._clock.now().nanoseconds
        self._publish_after_others()

    def _act(self, message, transform, settings):
        objects, actions = message.objects, message.actions
        if transform is not None:
            objects, actions = transform.moved(objects), transform.moved(actions)
        with self._lock:
            self._tracks.act(nanoseconds(message.header.stamp), objects, actions, settings)

    def _go_on(self):
        """Publish the belief of the present time if no observation has come meanwhile."""
        settings, heard = self._server.settings, self._heard
        try:
            with self._guarded():
                if heard is not None:
                    self._advance(heard[0] + self._clock.now().nanoseconds - heard[1], settings)
        finally:
            self._is_going_on = False

    def _advance(self, stamp, settings):
        if stamp - self._tracks.stamp < 0.5e9 / settings.tracked_rate or not self._tracks.names:
            return
        with self._lock:
            self._tracks.advance(stamp, settings)
            self._counts.set("objects", len(self._tracks.names))
        self._publish()

    def _publish_after_others(self):
        """Publish the newest belief after the messages that wait now: they are often of the same image."""
        if not self._is_unpublished:
            self._is_unpublished = True
            with contextlib.suppress(RuntimeError):
                self._worker.submit(self._publish_newest)

    def _publish_newest(self):
        if self._is_unpublished:
            with self._guarded():
                self._publish()

    def _publish(self):
        """Publish the newest belief, and have it predicted."""
        self._is_unpublished = False
        with self._lock:
            dropped = self._tracks.take_dropped()
            present, skipped, self._skipped = self._tracks.fork(), self._skipped | dropped, {}
        for name, reason in dropped.items():
            self._warn("dropped objects", f"tracked object '{name}' was dropped: {reason}")
        present.arrive()
        with self._lock:
            self._tracks.keep(present)
        settings = self._server.settings
        stamp = present.stamp or self._clock.now().nanoseconds  # without objects there is no stamp
        header = Header(stamp=stamp_of(stamp), frame_id=settings.world_frame)
        message = TrackedObjects(header=header, objects=present.messages())
        message.skipped = [KeyValue(key=name, value=reason) for name, reason in skipped.items()]
        self._tracked.publish(message)
        if settings.publish_tf:
            self._transforms.publish(header, {own.id: own.pose for own in message.objects})
        if present.names and self._stream.is_wanted:
            if present.stamp > self._predicted:  # several messages may belong to one time
                self._predicted = present.stamp
                self._pace.arrived()
                with self._pending_lock:
                    self._unpredicted += 1
            self._predictor.put(present)

    def _clear(self):
        with self._lock:
            self._tracks.clear()
        self._heard, self._predicted = None, 0
        self._pace.reset()
        self._counts.set("objects", 0)
        self._publish()

    def _forget(self, ids):
        """Forget objects, by default all, and publish what is left."""
        if not ids:
            self._clear()
            return
        with self._lock:
            self._tracks.forget(ids, self._server.settings)
            self._counts.set("objects", len(self._tracks.names))
        self._publish()

    # -- predictions -------------------------------------------------------------------------------

    def _predict(self, present):
        """Predict a fork for the stream's horizons; must not raise.

        If it takes much longer than its limit, a pause leaves time for the tracker. The newest belief waits
        meanwhile.
        """
        with self._pending_lock:
            replaced, self._unpredicted = self._unpredicted - 1, 0
        self._server.diagnostics.predictions.add("replaced inputs", max(0, replaced))
        longer = self._stream.keep_pace(self._pace, functools.partial(self._predict_within, present))
        self._ended.wait(longer)

    def _predict_within(self, present, limit):
        """Predict a fork with as many of its members as the limit leaves time for, and publish the result.

        Returns whether it was published.
        """
        settings, published = self._server.settings, False
        with self._server.errors_to(
            lambda error: self._warn("not predicted", f"a tracked scene was not predicted: {error}")
        ):
            marks, message = marks_of(present.scene, None, sorted(set(settings.horizons))), Prediction()
            outputs = RequestedOutputs(probabilities=settings.stream_probabilities)
            members = self._pace.adapted(MEMBERS, limit)
            with self._limited(settings.max_computation_time):
                job, prediction = present.predict(marks, settings, outputs, propagator=members)
            self._write(message, job, prediction, present.stamp)
            self._stream.publish(message, job)
            published = True
        return published

    def _write(self, message, job, prediction: CorePrediction, stamp):
        settings, header = self._server.settings, Header(stamp=stamp_of(stamp))
        write_answer(message, header, settings, job, prediction)
        self._server.diagnostics.predicted(prediction)

    def _fork(self, request, response):
        server, settings = self._server, self._server.settings
        limit = self._limited(settings.max_computation_time)
        with server.errors_into(response.result), limit:
            with self._lock:
                present = self._tracks.fork()
            scene = present.scene
            horizon = max(settings.horizons)
            if seconds(request.horizon):
                horizon = read_horizon(request.horizon, settings)
            marks = read_marks(request, horizon, scene, settings)
            present.arrive()
            if request.actions:
                present.act(present.stamp, request.objects, request.actions, settings)
            job, prediction = present.predict(
                marks,
                settings,
                RequestedOutputs.read(request),
                limited_regions(request.regions, settings),
                request.return_samples,
            )
            self._write(response.prediction, job, prediction, present.stamp)
            response.scene, response.actions = present.scene_message()
            response.scene.header = response.prediction.header

    def motions(self, name: str) -> list[tuple[Scene, Belief]]:
        """Return the scene and the belief of the present time for each possible motion (`Tracks.motions`)."""
        with self._lock:
            present = self._tracks.fork()
        with self._limited(self._server.settings.max_computation_time):
            present.arrive()
        return present.motions(name)

    def _reset(self, request, response):
        with self._server.errors_into(response.result):
            try:  # in the worker, so that no belief from before is published later
                self._worker.submit(self._forget, request.ids).result()
            except (CancelledError, RuntimeError):
                raise CanceledError(self._server.ending, field="the node") from None
