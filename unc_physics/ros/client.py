"""Client of the node: builds messages from names and numbers, sends them, and returns messages."""

from __future__ import annotations

import contextlib
import re
import threading
import time
from array import array as packed_array
from collections.abc import Iterable, Mapping
from functools import partial
from typing import Any

import numpy as np
import rclpy
from builtin_interfaces.msg import Duration
from diagnostic_msgs.msg import KeyValue
from geometry_msgs.msg import Pose, PoseWithCovariance, Twist, TwistWithCovariance, Vector3
from rclpy.exceptions import InvalidHandle
from rclpy.executors import SingleThreadedExecutor
from shape_msgs.msg import Plane, SolidPrimitive

from unc_physics_msgs import msg, srv

from ..checks.errors import InvalidRequestError, NotActiveError, NotReadyError, error_of
from ..checks.names import hint, removed
from ..checks.validation import array, flag, instance, integer, number, positive
from .messages import fields as convert
from .services import LATCHED

_PERIOD = 0.1  # s, between checks of the time-out, and of whether node and client have ended
_NOBODY = "is offered by no node; start one (with track:=true for tracked objects), and check ROS_DOMAIN_ID"
_LATE = "has not answered; give a longer timeout, and spin that node in another thread than the caller's"
#: Messages that numbers stand for: how many, and what makes a message of them.
_OF_NUMBERS: dict[type, tuple[tuple[int, ...], Any]] = {
    Vector3: ((3,), convert.vector_message),
    Pose: ((3, 7), lambda v: convert.pose_message(v[:3], v[3:] if len(v) == 7 else (0, 0, 0, 1))),
    Twist: ((6,), lambda v: convert.twist_message(v[:3], v[3:])),
    Plane: ((4,), lambda v: Plane(coef=v)),
    PoseWithCovariance: ((3, 7), lambda v: PoseWithCovariance(pose=_OF_NUMBERS[Pose][1](v))),
    TwistWithCovariance: ((6,), lambda v: TwistWithCovariance(twist=_OF_NUMBERS[Twist][1](v))),
}


def make_message(kind: Any, /, **fields: Any) -> Any:
    """Return a message of a class with these fields, and with the flags of its optional numbers.

    A duration is a number [s]. Vectors are 3 numbers, planes 4, twists 6, and poses 3 or 7. For example
    ``make_message(Physics, friction=0.4)``.
    """
    message = kind()
    known = message.get_fields_and_field_types()
    for name, value in fields.items():
        if name not in known:
            problem = removed(name) or f"is no field of {kind.__name__}{hint(name, known)}"
            raise InvalidRequestError(problem, field=name)
        setattr(message, name, _converted(getattr(message, name), value, name))
        if f"has_{name}" in known:
            setattr(message, f"has_{name}", True)
    return message


def object_state(
    id: str, model: str, pose: Any, covariance: Any = None, twist_covariance: Any = None, **fields: Any
) -> msg.ObjectState:
    """Return an object of a scene.

    Parameters
    ----------
    id, model : str
        The model is one of `Client.models`, or empty where ``primitive`` or ``mesh`` is given.
    pose : (3,) or (7,) array
        Position [m] and quaternion (x, y, z, w) of the model's origin.
    covariance, twist_covariance : (6,) or (6, 6) array, optional
        Covariances of pose and twist about fixed axes, or their diagonals; by default unknown.
    **fields
        Other fields of ``ObjectState``, such as ``twist`` [m/s, rad/s], ``kind``, ``mass`` or ``at_rest``.
    """
    twist = fields.pop("twist", [0.0] * 6)
    given = {
        "pose": make_message(PoseWithCovariance, pose=pose, covariance=_matrix(covariance)),
        "twist": make_message(TwistWithCovariance, twist=twist, covariance=_matrix(twist_covariance)),
    }
    return make_message(msg.ObjectState, id=id, model=model, **given | fields)


def environment(
    planes: Mapping[str, Any] | None = None, boxes: Mapping[str, tuple[Any, Any]] | None = None
) -> msg.Environment:
    """Return all that surrounds the objects of a scene, by id.

    A plane is four numbers: the solid is where ``a x + b y + c z + d <= 0`` [m]. A box is its edge lengths
    (3,) [m] and its pose (3,) or (7,). Append other elements to the field ``elements``.
    """
    found = [make_message(msg.EnvironmentElement, id=id, plane=plane) for id, plane in (planes or {}).items()]
    for id, (size, pose) in (boxes or {}).items():
        box = make_message(SolidPrimitive, type=SolidPrimitive.BOX, dimensions=size)
        found.append(make_message(msg.EnvironmentElement, id=id, primitive=box, pose=pose))
    return msg.Environment(elements=found, complete=True)


def prediction_request(
    objects: Iterable[msg.ObjectState], horizon: float, environment: Any = None, **fields: Any
) -> msg.PredictionRequest:
    """Return a request.

    The horizon is in seconds, and the environment by default the node's own. Of the other ``fields`` of
    ``PredictionRequest``, ``times`` are numbers [s], and ``propagator_options`` are a mapping.
    """
    scene = make_message(msg.Scene, objects=objects, environment=environment or msg.Environment())
    return make_message(msg.PredictionRequest, scene=scene, horizon=horizon, **fields)


def poses_of(message: Any) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return poses (S, 7) and their covariances (S, 6, 6) of each object of a message, by id.

    The message is a ``Prediction``, with S states of an object, or ``TrackedObjects``, with one. Poses are as
    in `object_state`, and covariances about fixed axes.
    """
    found = {}
    for own in message.objects:
        states = [state.pose for state in own.states] if hasattr(own, "states") else [own.pose]
        poses = [[*convert.xyz(one.pose.position), *convert.xyzw(one.pose.orientation)] for one in states]
        found[own.id] = np.array(poses), np.array([one.covariance for one in states]).reshape(-1, 6, 6)
    return found


class Client(contextlib.AbstractContextManager["Client"]):
    """Client of a prediction node, with a node and a thread of its own.

    So its calls return, or time out, in the callbacks of any executor, too. Several threads may use it.

    An error in an answer is raised as the exception of its code; ``prediction`` of the exception is the part
    that was done. `NotActiveError` is raised if no answer comes in time, or the node ends.

    Parameters
    ----------
    server : str
        Name of the prediction node.
    timeout : float
        Longest time of a call [s], from the search for the node to its answer; each method takes another
        one. A first request may wait for compilation for two minutes.
    """

    def __init__(self, server: str = "/unc_physics", timeout: float = 30.0):
        self._server, self._timeout = server.rstrip("/"), positive(timeout, "timeout")
        self._lock, self._closed = threading.Lock(), threading.Event()
        self._made: dict[str, Any] = {}  # clients and the subscription, by name
        self._newest: dict[str, Any] = {}  # messages of topics
        self._context = rclpy.Context()
        rclpy.init(context=self._context)
        self._node: Any = rclpy.create_node("unc_physics_client", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._thread = threading.Thread(target=self._executor.spin, daemon=True)
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End all calls, and release all resources."""
        if not self._closed.is_set():
            self._closed.set()
            self._executor.shutdown()
            self._thread.join()
            self._node.destroy_node()
            self._context.try_shutdown()

    def predict(self, request: msg.PredictionRequest, timeout: float | None = None) -> msg.Prediction:
        """Return the prediction of a request; wait, up to the timeout, while the node compiles for it."""
        end = self._end(timeout)
        while True:
            try:
                left = max(end - time.monotonic(), _PERIOD)
                return self._call(srv.Predict, "predict", left, request=request).prediction
            except NotReadyError:
                if time.monotonic() > end:
                    raise

    def rank(
        self, request: msg.PredictionRequest, candidates: Any, timeout: float | None = None, **fields: Any
    ) -> srv.PredictCandidates.Response:
        """Return the predictions of alternatives with the same draws, the best first if there is a ``score``.

        ``candidates`` are messages ``Candidate``; the error of one is in the ``result`` of its entry. Other
        fields of ``PredictCandidates`` are ``score``, a list of messages ``Score``, and ``budget``.
        """
        given = {"request": request, "candidates": candidates} | fields
        return self._call(srv.PredictCandidates, "predict_candidates", timeout, **given)

    def assess_stability(
        self,
        object: str,
        objects: Iterable[msg.ObjectState] = (),
        timeout: float | None = None,
        **fields: Any,
    ) -> srv.AssessStability.Response:
        """Return how probable it is that an object stays where it is.

        It is one of ``objects`` in the node's environment, or of the tracker without them. Other fields are
        ``duration`` [s], ``distance`` [m], ``angle`` [rad], ``confidence``, ``physics`` and ``scene``.
        """
        given = {"object": object, "scene": make_message(msg.Scene, objects=objects)} | fields
        return self._call(srv.AssessStability, "assess_stability", timeout, **given)

    def capabilities(self, timeout: float | None = None) -> srv.GetCapabilities.Response:
        """Return the node's propagators, features, limits, physics and versions."""
        return self._call(srv.GetCapabilities, "get_capabilities", timeout)

    def models(self, timeout: float | None = None) -> dict[str, msg.ModelInfo]:
        """Return the models that objects can refer to, by name."""
        self._newest_of(msg.ModelList, "models", LATCHED, timeout, lambda message: True)
        return {info.name: info for info in self._newest["models"].models}

    def load_model(self, path: Any, timeout: float | None = None, **fields: Any) -> msg.ModelInfo:
        """Make the node read a model or pack a mesh, a file on its machine; wait until that is done.

        Other fields of ``LoadModel`` are ``name``, ``replace`` and ``spheres``.
        """
        end = self._end(timeout)
        info: Any = self._call(srv.LoadModel, "load_model", timeout, path=str(path), **fields).model
        while info.status == msg.ModelInfo.STATUS_PACKING:
            time.sleep(_PERIOD)
            if time.monotonic() > end:
                raise NotActiveError("is still packing; give a longer timeout", field="the node")
            info = self.models(max(end - time.monotonic(), _PERIOD)).get(info.name, info)
        return info

    def set_environment(self, environment: msg.Environment, timeout: float | None = None) -> None:
        """Replace the node's environment, which scenes without elements have; in the node's world frame."""
        self._call(srv.SetEnvironment, "set_environment", timeout, environment=environment)

    def tracked(self, after: float = 0.0, timeout: float | None = None) -> msg.TrackedObjects:
        """Return the newest message of the node's tracker; wait until its stamp is ``after`` [s] or later."""
        self._newest_of(
            msg.TrackedObjects,
            "tracked",
            1,
            timeout,
            lambda message: 1e-9 * convert.nanoseconds(message.header.stamp) >= after,
            "; start the node with track:=true, and observe objects",
        )
        return self._newest["tracked"]

    def _newest_of(self, kind, name, quality, timeout, is_wanted, problem="; start a node"):
        """Subscribe to a topic, and wait until its newest message is a wanted one."""
        end, topic = self._end(timeout), f"{self._server}/{name}"
        keep = partial(self._newest.__setitem__, name)
        self._once(topic, self._node.create_subscription, kind, topic, keep, quality)

        def is_there():
            return name in self._newest and is_wanted(self._newest[name])

        self._wait(is_there, topic, end, f"has no message{problem}")

    def fork(self, timeout: float | None = None, **fields: Any) -> srv.Fork.Response:
        """Return a prediction from the tracker's belief; ``fields`` are those of ``Fork``, as ``horizon``."""
        return self._call(srv.Fork, "fork", timeout, **fields)

    def reset(self, ids: Iterable[str] = (), timeout: float | None = None) -> None:
        """Make the node's tracker forget objects, by default all."""
        self._call(srv.Reset, "reset", timeout, ids=ids)

    def _end(self, timeout):
        """Return when a call times out, on the monotonic clock."""
        if self._closed.is_set():
            raise NotActiveError("is closed", field="the client")
        return time.monotonic() + (self._timeout if timeout is None else positive(timeout, "timeout"))

    def _once(self, name, make, *arguments):
        """Return the client or subscription of a name, made on first use."""
        with self._lock:
            if name not in self._made:
                self._made[name] = make(*arguments)
            return self._made[name]

    def _call(self, kind, name, timeout, /, **fields):
        """Return the answer of a service, or raise the error in it."""
        end, name, done = self._end(timeout), f"{self._server}/{name}", threading.Event()
        request = make_message(kind.Request, **fields)
        try:
            client = self._once(name, self._node.create_client, kind, name)
            self._wait(client.service_is_ready, name, end, _NOBODY)
            future = client.call_async(request)
            future.add_done_callback(lambda _: done.set())
            try:
                self._wait(done.is_set, name, end, _LATE, done, client.service_is_ready)
            finally:
                client.remove_pending_request(future)
        except InvalidHandle:  # `close` destroyed the client since `_wait` looked
            raise NotActiveError("is closed", field="the client") from None
        return _checked(future.result(), request)

    def _wait(self, is_done, name, end, problem, changed=None, is_offered=lambda: True):
        """Wait until something is done; raise an error at the time-out, or if it cannot be done any more."""
        while not is_done():
            if self._closed.is_set():
                raise NotActiveError("is closed", field="the client")
            if not is_offered():
                raise NotActiveError("ended before it answered; see the node's log", field=name)
            if (left := end - time.monotonic()) <= 0.0:
                raise NotActiveError(problem, field=name)
            (changed or self._closed).wait(min(left, _PERIOD))


def _checked(answer, request):
    """Return an answer, or raise the error in it; the first word is its field where the request has that."""
    result = getattr(answer, "result", None)
    if result is None or not result.error_code:
        return answer
    error = error_of(result.error_code, result.error_msg)
    field, _, problem = error.problem.partition(" ")
    known = {*request.get_fields_and_field_types(), *msg.PredictionRequest.get_fields_and_field_types()}
    if re.split(r"[.[]", field)[0] in known:
        error = type(error)(problem, field=field)
    error.prediction = getattr(answer, "prediction", answer)
    raise error


def _matrix(values):
    """Return a covariance (6, 6) from itself or its diagonal; -1 in the first entry means unknown."""
    values = [-1.0, 0.0, 0.0, 0.0, 0.0, 0.0] if values is None else values
    return np.diag(values) if np.ndim(values) == 1 else values


def _converted(default, value: Any, name):
    """Return a value for a field, which has a default of the field's type."""
    kind, size = type(default), np.size(value)
    if kind in _OF_NUMBERS and not isinstance(value, kind):
        sizes, make = _OF_NUMBERS[kind]
        return make(array(value, (size if size in sizes else sizes[0],), name))
    if kind in (np.ndarray, packed_array):
        numbers = array(np.ravel(np.asarray(value)), (np.size(default) or size,), name)
        return numbers if kind is np.ndarray else convert.packed(numbers)
    if kind is list and isinstance(value, Mapping):
        return [KeyValue(key=key, value=str(one)) for key, one in value.items()]
    if kind is list:
        return [convert.duration(one) if isinstance(one, (int, float)) else one for one in value]
    if kind is Duration and not isinstance(value, Duration):
        return convert.duration(number(value, name))
    if kind in (bool, int, float):
        return integer(value, name, low=0) if kind is int else (flag if kind is bool else number)(value, name)
    instance(value, kind, name)
    return value
