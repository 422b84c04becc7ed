"""The executable ``unc_physics_replay``: predict a bag's detections offline, and report calibration.

Each message is predicted as the node does, for the times of later messages. The report says how often the
position that came next lay inside the 90 % region, which includes the detection's own covariance.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from geometry_msgs.msg import PoseWithCovariance

from unc_physics_msgs.msg import Prediction, Scene

from ..checks.errors import InvalidRequestError, NotSupportedError, UncPhysicsError
from ..prediction.request_checks import marks_of
from .detected import detected_object, read_detections, settle_detected
from .messages.fields import pose_message, xyz, xyzw
from .messages.frames import Frames
from .messages.prediction import write_answer
from .messages.request import read_request
from .models import ModelLibrary
from .node_environment import NodeEnvironment
from .parameters import Settings
from .streams import request_of

DETECTIONS, POSE = "vision_msgs/msg/Detection3DArray", "geometry_msgs/msg/PoseWithCovarianceStamped"
#: Share of outcomes in the region, and the square of its radius for three coordinates.
REGION, _SQUARE = 0.9, 6.251388631170325
_TOLERANCE = 0.15  # of a horizon: farthest that the time of a later message may be from it


class Outcome(NamedTuple):
    """A predicted position beside the one that was detected later.

    Attributes
    ----------
    horizon : float
        That was asked for [s].
    name : str
    error : float
        Distance [m].
    square : float
        Squared Mahalanobis distance, with the covariances of both.
    """

    horizon: float
    name: str
    error: float
    square: float


def read_bag(path: Path, topic: str | None) -> list[tuple[float, str, Any]]:
    """Return time [s], type and message of one topic with detections or poses, in order.

    Raises
    ------
    InvalidRequestError
        If no topic or several ones fit.
    NotSupportedError
        If no reader is installed.
    """
    found: dict[str, list[tuple[float, str, Any]]] = {}
    for name, kind, message in _messages(path):
        if kind in (DETECTIONS, POSE) and topic in (None, name):
            stamp = message.header.stamp
            found.setdefault(name, []).append((stamp.sec + 1e-9 * stamp.nanosec, kind, message))
    if len(found) != 1:
        names = ", ".join(sorted(found)) or f"none of {DETECTIONS} or {POSE}"
        raise InvalidRequestError(f"must name one topic of the bag: {names}", field="--topic", value=topic)
    (messages,) = found.values()
    return sorted(messages, key=lambda entry: entry[0])


def _messages(path) -> Iterator[tuple[str, str, Any]]:
    """Yield topic, type and message of a bag, a file or a folder."""
    files = sorted(path.glob("*.mcap")) if path.is_dir() else [path]
    if not path.exists() or not files:
        raise InvalidRequestError("is no bag", field="BAG", value=str(path))
    try:
        if all(file.suffix == ".mcap" for file in files):
            from mcap.reader import make_reader  # pyright: ignore[reportMissingImports]  (optional)
            from mcap_ros2.decoder import DecoderFactory  # pyright: ignore[reportMissingImports]

            for file in files:
                with file.open("rb") as stream:
                    reader = make_reader(stream, decoder_factories=[DecoderFactory()])
                    for schema, channel, _, message in reader.iter_decoded_messages():
                        yield channel.topic, schema.name if schema else "", message
            return
        import rosbag2_py  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise NotSupportedError(
            f"needs {error.name}: pip install mcap-ros2-support reads .mcap files, ROS's rosbag2_py others",
            field="BAG",
            value=str(path),
        ) from None
    from rclpy.serialization import deserialize_message
    from rosidl_runtime_py.utilities import get_message  # pyright: ignore[reportMissingImports]

    reader = rosbag2_py.SequentialReader()
    reader.open(rosbag2_py.StorageOptions(uri=str(path)), rosbag2_py.ConverterOptions("cdr", "cdr"))
    kinds = {entry.name: entry.type for entry in reader.get_all_topics_and_types()}
    while reader.has_next():
        name, data, _ = reader.read_next()
        if kinds[name] in (DETECTIONS, POSE):
            yield name, kinds[name], deserialize_message(data, get_message(kinds[name]))


def replay(
    messages: Sequence[tuple[float, str, Any]],
    environment: NodeEnvironment,
    settings: Settings,
    model: str = "",
) -> tuple[list[Outcome], dict[str, int]]:
    """Predict each message for the times of later ones.

    Parameters
    ----------
    messages : sequence of (float, str, message)
        As from `read_bag`.
    environment : NodeEnvironment
    settings : Settings
    model : str
        Of the object, for messages of a single pose.

    Returns
    -------
    outcomes : list of Outcome
    left_out : dict of int
        How many messages or objects were not predicted, by reason.
    """
    library = ModelLibrary(settings.models_dir)
    scenes = [_scene(kind, message, library, settings, model) for _, kind, message in messages]
    times = np.array([time for time, *_ in messages])
    outcomes, left_out = [], Counter()
    for k, (scene, unnamed) in enumerate(scenes):
        later = {}  # numbers of later messages by the horizon that they are closest to
        for horizon in settings.horizons:
            near = int(np.argmin(np.abs(times - times[k] - horizon)))
            if near > k and abs(times[near] - times[k] - horizon) < _TOLERANCE * horizon:
                later.setdefault(near, horizon)
        if not later:
            continue
        left_out["without a model"] += len(unnamed)
        try:
            scene, skipped = settle_detected(scene, environment.message, library, settings)
            left_out.update(reason.partition(",")[0] for reason in skipped.values())
            if not scene.objects:
                continue
            after = sorted(times[near] - times[k] for near in later)
            request = request_of(scene, settings)
            job = read_request(request, settings, library, Frames(), environment_of=environment.around)
            job = replace(job, marks=marks_of(job.scene, None, after))
            answer = Prediction()
            write_answer(answer, scene.header, settings, job, job.run())
        except UncPhysicsError as error:
            left_out[str(error)] += 1
            continue
        for place, near in enumerate(sorted(later)):
            outcomes += _outcomes(answer, place, scenes[near][0], later[near], settings)
    return outcomes, +left_out


def _scene(kind, message, library, settings, model) -> tuple[Scene, dict[str, str]]:
    """Return the scene of one message of a bag, and the reasons of omitted detections.

    Parts of the message may be of another reader's types.
    """
    if kind == POSE:
        own = detected_object("object", model, _pose(message.pose), library, settings)
        return Scene(objects=[own]), {}
    for detection in message.detections:
        for result in detection.results:
            result.pose = _pose(result.pose)
        if (box := getattr(detection, "bbox", None)) is not None:
            detection.bbox.center = pose_message(xyz(box.center.position), xyzw(box.center.orientation))
    found = read_detections(message, library, settings)
    return Scene(objects=found.objects), dict(found.skipped)


def _pose(message) -> PoseWithCovariance:
    found = PoseWithCovariance(pose=pose_message(xyz(message.pose.position), xyzw(message.pose.orientation)))
    found.covariance = np.array(message.covariance, float)
    return found


def _outcomes(answer, place, scene, horizon, settings):
    """Return the outcomes of one predicted state of each object that was detected later."""
    later, found = {own.id: own for own in scene.objects}, []
    for predicted in answer.objects:
        if (own := later.get(predicted.id)) is None:
            continue
        state = predicted.states[place].pose
        error = np.subtract(xyz(own.pose.pose.position), xyz(state.pose.position))
        read = settings.covariance_defaults.known_pose(own.pose.covariance, "pose.covariance")
        measured = read.with_unmeasured()
        P = (np.reshape(state.covariance, (6, 6)) + measured)[:3, :3]
        found.append(
            Outcome(
                horizon, predicted.id, float(np.linalg.norm(error)), float(error @ np.linalg.solve(P, error))
            )
        )
    return found


def report(outcomes: Sequence[Outcome], left_out: dict[str, int]) -> str:
    """Return a table of the outcomes by horizon, and what was left out."""
    lines = [f"{'horizon [s]':>11}  {'outcomes':>8}  {'in the 90 % region':>18}  {'median error [mm]':>17}"]
    for horizon in sorted({outcome.horizon for outcome in outcomes}):
        some = [outcome for outcome in outcomes if outcome.horizon == horizon]
        inside = np.mean([outcome.square <= _SQUARE for outcome in some])
        error = 1e3 * np.median([outcome.error for outcome in some])
        lines.append(f"{horizon:11g}  {len(some):8d}  {100.0 * inside:16.0f} %  {error:17.1f}")
    lines += [f"left out {count} times: {reason}" for reason, count in left_out.items()]
    return "\n".join(lines)


def main(arguments=None) -> int:
    """Replay a bag and print the report; return the exit status."""
    parser = argparse.ArgumentParser(prog="unc_physics_replay", description=__doc__)
    parser.add_argument("bag", metavar="BAG", help="file (.mcap) or folder of a bag; needs mcap-ros2-support")
    parser.add_argument("--topic", help="topic of the detections or poses (default: the only one)")
    parser.add_argument(
        "--environment", metavar="FILE", help="file with the key 'environment', as the parameter"
    )
    parser.add_argument("--model", default="", help="model of the object, for a topic of single poses")
    parser.add_argument(
        "--horizons",
        type=float,
        nargs="+",
        default=[0.2, 0.5, 1.0],
        metavar="S",
        help="(default 0.2 0.5 1.0)",
    )
    options = parser.parse_args(arguments)
    try:
        environment = NodeEnvironment()
        if options.environment:
            environment.load(options.environment)
        messages = read_bag(Path(options.bag), options.topic)
        if messages[0][1] == POSE and not options.model:
            raise InvalidRequestError("must be given for a topic of single poses", field="--model")
        outcomes, left_out = replay(
            messages, environment, Settings(horizons=tuple(options.horizons)), options.model
        )
        print(report(outcomes, left_out))
    except UncPhysicsError as error:
        print(f"unc_physics_replay: {error}", file=sys.stderr)
        return int(error.code)
    return 0


if __name__ == "__main__":
    sys.exit(main())
