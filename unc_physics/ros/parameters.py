"""The node's parameters: one table with defaults, ranges and descriptions, and the settings.

``python -m unc_physics.ros.parameters`` prints them as the file ``config/unc_physics.yaml``.
"""

from __future__ import annotations

import argparse
import functools
import math
import re
import sys
from dataclasses import Field, dataclass, field, fields
from typing import Any, NamedTuple

import yaml
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.exceptions import InvalidTopicNameException
from rclpy.validate_topic_name import validate_topic_name

from ..checks.errors import InvalidOptionError, UncPhysicsError
from ..checks.names import removed, suggestion
from ..propagators.names import ANYTIME, REFERENCE, SURFACE
from ..propagators.registry import PROPAGATORS
from ..scene.physics_keys import PHYSICS_KEYS
from ..scene.presets import PRESETS, certain, with_changes
from .messages.covariances import CovarianceDefaults

_EVERYDAY = PRESETS["everyday"]
AXES = "x", "y", "z"
#: Points of a model's box that a detection's pose may be about.
BASE, CENTER = "base", "center"
#: Pattern of the entries of lists, and the same in words.
_FORMS = {
    "class_models": (r"[^=]+=[^=@]+(@(base|center))?", "CLASS=MODEL, CLASS=MODEL@base or CLASS=MODEL@center"),
    "observed_objects": (r"[^=]+(=[^=]+)?", "ID or ID=CLASS"),
    "symmetric_models": (r"[^:]+(:[xyz])?", "MODEL, or MODEL:x, MODEL:y or MODEL:z"),
}
#: Parameters of earlier versions, and what to do instead.
_REMOVED = {
    name: f"was removed in version 0.3: {instead}"
    for names, instead in (
        ("damping gyroscopic integrator overlap sleep stiffness", "set it in 'physics' of a request"),
        (
            "max_candidates max_elements max_long_computation_time max_long_predictions max_regions "
            + "max_response_bytes max_return_samples max_samples max_spheres max_states max_steps",
            "the limits are max_horizon, max_objects, max_memory and max_computation_time",
        ),
        ("default_position_std default_orientation_std", "give both numbers of default_pose_std"),
        (
            "default_linear_velocity_std default_angular_velocity_std",
            "give both numbers of default_twist_std",
        ),
        ("observed_models", "write ID=MODEL in observed_objects"),
        ("status_rollouts tracking_members", "leave it out"),
        ("stream_max_computation_time", "it is stream_time_budget"),
        ("symmetry_axes", "write MODEL:AXIS in symmetric_models"),
        (
            "tracked_models tracked_topics",
            "write ID=MODEL in observed_objects, and remap ~/observed/ID to the topic",
        ),
    )
    for name in names.split()
}


class ClassModel(NamedTuple):
    """Model of a detected class, and the point that a detection's pose is about.

    Attributes
    ----------
    model : str
    origin : str
        ``base`` or ``center`` of the model's box; empty for the model's own origin.
    """

    model: str
    origin: str = ""


def parameter(default: Any, description, *, low=0.0, high=1e6, choices=(), read_only=False) -> Any:
    """Return a field of `Settings` that is a ROS parameter; ranges of numbers include their ends."""
    is_number = isinstance(default, (int, float)) and not isinstance(default, bool)
    limits = (low, high) if is_number else None
    meta = {"description": description, "limits": limits, "choices": choices, "read_only": read_only}
    return field(default=default, metadata=meta)


def physics_key(key, default: Any = None, **limits) -> Any:
    """Return a parameter for a key of the physics; the default is the everyday preset's value."""
    default = _EVERYDAY[key] if default is None else default
    return parameter(default, PHYSICS_KEYS[key].meaning, **limits)


@dataclass(frozen=True)
class Settings:
    """Values of all parameters of the node at one time; units are SI and radians.

    Raises
    ------
    InvalidOptionError
        If a value is not finite or not one of its choices.
    """

    models_dir: str = parameter(
        "", "Folder of the models; empty: the library of this package.", read_only=True
    )
    allow_model_paths: bool = parameter(
        False,
        "Whether ~/load_model takes files, and objects may name model files by their path.",
        read_only=True,
    )
    world_frame: str = parameter("world", "Frame of predictions and of gravity.", read_only=True)

    environment: str = parameter(
        "",
        "File with the key 'environment', as in scene files: the surroundings of scenes without elements;"
        " empty: none.",
        read_only=True,
    )
    planning_scene_topic: str = parameter(
        "",
        "Topic of MoveIt's planning scene, such as /monitored_planning_scene. Its collision objects join that"
        " environment; empty: none. Needs moveit_msgs.",
        read_only=True,
    )

    transform_timeout: float = parameter(
        0.2,
        "Longest time that a scene waits for a missing transform [s]; other scenes do not wait for it.",
        high=60.0,
    )

    default_propagator: str = parameter(
        ANYTIME, "Propagator of requests that name none.", choices=tuple(PROPAGATORS)
    )
    dt: float = physics_key("dt", low=1e-6, high=1.0)
    gravity: tuple[float, ...] = physics_key("gravity")
    friction: float = physics_key("friction", high=100.0)
    restitution: float = physics_key("restitution", high=1.0)
    exact: bool = parameter(
        False,
        "Whether friction and restitution are certain, and impacts have no errors. Otherwise friction and"
        " restitution are those of unknown household objects where they are not set.",
    )
    warm_up: tuple[str, ...] = parameter(
        (ANYTIME, REFERENCE),
        "Propagators whose kernels are compiled, or loaded, before the node is ready, beside the"
        " stream_propagator; empty: none at all. Kernels of other"
        " propagators are compiled at their first request. Propagators of other packages that do not support"
        " the integrator are left out.",
        choices=tuple(PROPAGATORS),
        read_only=True,
    )

    zero_covariance: str = parameter(
        "default",
        "Meaning of a pose or twist covariance of zeros: unknown, so that the default replaces it"
        " ('default'), or exactly known ('exact').",
        choices=("default", "exact"),
    )
    default_pose_std: tuple[float, ...] = parameter(
        (0.01, 0.05), "Standard deviations of an unknown position [m] and orientation [rad]."
    )
    default_twist_std: tuple[float, ...] = parameter(
        (0.05, 0.1), "Standard deviations of an unknown velocity [m/s] and angular velocity [rad/s]."
    )

    max_horizon: float = parameter(60.0, "Maximum horizon of a request [s].")
    max_objects: int = parameter(
        200,
        "Maximum number of objects, of elements of an environment, of regions, and of candidates, each.",
        low=1,
        high=10_000,
    )
    max_memory: float = parameter(
        512.0, "Maximum memory of an answer and the rollouts that it is computed from [MB].", low=1.0
    )
    max_computation_time: float = parameter(
        30.0,
        "Longest wall time of an answer by service [s]; requests may ask for less. Goals of the action take"
        " as long as they ask for.",
        low=1e-3,
    )
    default_time_budget: float = parameter(
        1.0,
        f"Wall time after which {ANYTIME} adds no more rollouts to its first ones [s], in calls of ~/predict"
        " without wanted errors, time_budget and propagator_options; 0: none.",
    )

    horizons: tuple[float, ...] = parameter(
        (0.2, 0.5, 1.0, 2.0), "Times for which streamed scenes are predicted [s]."
    )
    stream_propagator: str = parameter(SURFACE, "Propagator for streamed scenes.", choices=tuple(PROPAGATORS))
    stream_time_budget: float = parameter(
        0.0,
        "Wall time that a streamed scene is to take [s]; if one takes longer, later ones get fewer rollouts."
        " 0: half the time between inputs.",
    )
    stream_probabilities: bool = parameter(
        False, "Whether predictions of streamed scenes have probabilities of contact and rest."
    )
    max_input_age: float = parameter(
        0.5, "Streamed scenes whose stamp is older are dropped [s]; 0 takes all."
    )
    max_input_lead: float = parameter(
        0.1, "Streamed scenes whose stamp is farther in the future are dropped [s]; 0 takes all."
    )
    pose_objects: tuple[str, ...] = parameter(
        ("",),
        "Ids of streamed objects whose predicted pose is also published on a topic of its own, "
        "~/predicted_pose/ID, with _ in place of what a topic's name cannot hold.",
    )
    pose_horizon: float = parameter(1.0, "Which of the horizons those poses are predicted for [s].")
    publish_tf: bool = parameter(
        False,
        "Whether the poses of all streamed objects at that horizon are published on /tf, too, as frames "
        "ID_predicted in the world frame with the stamp of the scene. Needs tf2_msgs.",
    )
    tracked_mass: float = parameter(
        1.0, "Mass of tracked and detected objects whose model gives none [kg].", low=1e-9, high=1e9
    )

    class_models: tuple[str, ...] = parameter(
        ("",),
        "Models of detected classes: each CLASS=MODEL, or CLASS=MODEL@base or CLASS=MODEL@center where poses"
        " are those of the middle of the model's base or box. Other classes are names of models.",
        read_only=True,
    )
    track: bool = parameter(
        False,
        "Whether the node tracks the objects of ~/detections and ~/observed/ID: it keeps a belief about"
        " them through contact and occlusion, publishes it on ~/tracked, and predicts from it.",
        read_only=True,
    )
    observed_objects: tuple[str, ...] = parameter(
        ("",),
        "Objects that are observed on topics of PoseWithCovarianceStamped, ~/observed/ID, with _ in place of"
        " what a topic's name cannot hold: each ID, or ID=CLASS where ID is no class or model.",
        read_only=True,
    )
    symmetric_models: tuple[str, ...] = parameter(
        ("",),
        "Models that look the same at every angle about an axis: each MODEL, or MODEL:AXIS with x, y or z"
        " in the model's coordinates, which is z otherwise.",
        read_only=True,
    )
    association: str = parameter(
        "id",
        "Rule that assigns observations to objects: by id, and by distance if there is no id ('id'); or"
        " always by distance to objects of the same model ('distance'), which needs SciPy.",
        choices=("id", "distance"),
    )
    association_distance: float = parameter(
        0.2,
        "Largest distance of an observation without an id from its object's expected position [m].",
        high=1e3,
    )
    forget_after: float = parameter(
        30.0, "Time without accepted observations after which an object is forgotten [s]; 0: never."
    )
    tracking_window: float = parameter(
        0.5, "Largest delay of an observation [s].", low=1e-3, high=60.0, read_only=True
    )
    tracked_rate: float = parameter(
        10.0,
        "How often ~/tracked is published while no observations arrive [Hz].",
        low=0.01,
        high=1e3,
        read_only=True,
    )

    occupancy_probability: float = parameter(
        0.95,
        "Probability with which each box of ~/occupancy and ~/occupancy_scene contains its object.",
        high=0.999999,
    )

    service_introspection: str = parameter(
        "metadata",
        "Content of ~/SERVICE/_service_event for each call: nothing ('disabled'), who called and when"
        " ('metadata'), or also requests and answers ('contents').",
        choices=("disabled", "metadata", "contents"),
        read_only=True,
    )

    markers: tuple[str, ...] = parameter(
        ("predicted", "environment"),
        "Content of ~/markers and ~/stream_markers for each object, and whether they show the environment.",
        choices=("predicted", "initial", "ellipsoid", "rotation", "environment"),
    )
    marker_lifetime: float = parameter(
        10.0, "Duration for which markers are shown [s]; 0: until other markers replace them."
    )

    def __post_init__(self):
        for spec in fields(self):
            value = getattr(self, spec.name)
            chosen = value if isinstance(value, tuple) else (value,)
            if any(isinstance(number, float) and not math.isfinite(number) for number in chosen):
                raise InvalidOptionError("must be finite", field=spec.name, value=value)
            choices = spec.metadata["choices"]
            if choices and not set(chosen) <= {*choices, *([""] if isinstance(value, tuple) else [])}:
                raise InvalidOptionError(f"must be one of {', '.join(choices)}", field=spec.name, value=value)
        pairs = ((name, getattr(self, name)) for name in ("default_pose_std", "default_twist_std"))
        for name, is_valid, problem in (
            *(
                (own, len(std) == 2 and min(std) >= 0.0, "must have 2 numbers, at least 0")
                for own, std in pairs
            ),
            ("gravity", len(self.gravity) == 3, "must have 3 numbers"),
            (
                "horizons",
                self.horizons and 0.0 < min(self.horizons) <= max(self.horizons) <= self.max_horizon,
                f"must be above 0 and at most {self.max_horizon} s",
            ),
            ("planning_scene_topic", _is_topic(self.planning_scene_topic), "is no name of a topic"),
            ("world_frame", self.world_frame, "must not be empty"),
        ):
            if not is_valid:
                value = getattr(self, name)
                raise InvalidOptionError(
                    problem, field=name, value=list(value) if isinstance(value, tuple) else value
                )
        for name, (pattern, form) in _FORMS.items():
            for entry in filter(None, getattr(self, name)):
                if not re.fullmatch(pattern, entry):
                    raise InvalidOptionError(f"must be {form}", field=name, value=entry)

    @functools.cached_property
    def covariance_defaults(self) -> CovarianceDefaults:
        """Defaults of unknown covariances, and the meaning of zero covariances."""
        stds = *self.default_pose_std, *self.default_twist_std
        return CovarianceDefaults.from_stds(*stds, zero_is_exact=self.zero_covariance == "exact")

    @functools.cached_property
    def physics(self) -> dict:
        """Physics of the scenes, as arguments of `Scene`."""
        given = {key: getattr(self, key) for key in PHYSICS_KEYS if hasattr(self, key)} | {"sleep": True}
        # a friction or restitution that was set is exact
        unchanged = [key for key in ("friction", "restitution") if getattr(self, key) == _EVERYDAY[key]]
        changes = {key: value for key, value in given.items() if key not in unchanged}
        return with_changes(certain(_EVERYDAY) if self.exact else _EVERYDAY, changes)

    @functools.cached_property
    def classes(self) -> dict[str, ClassModel]:
        """Models of detected classes by the classes."""
        entries = (entry.partition("=") for entry in filter(None, self.class_models))
        parts = ((name, *model.partition("@")) for name, _, model in entries)
        return {name: ClassModel(model, origin) for name, model, _, origin in parts}

    @functools.cached_property
    def observed(self) -> dict[str, str]:
        """Classes of the objects with topics of their own, by id."""
        parts = (entry.partition("=") for entry in filter(None, self.observed_objects))
        return {name: kind or name for name, _, kind in parts}

    @functools.cached_property
    def symmetries(self) -> dict[str, str]:
        """Axes of symmetric models by the models."""
        parts = (entry.rpartition(":") for entry in filter(None, self.symmetric_models))
        return {model or last: last if model else AXES[-1] for model, _, last in parts}


def _is_topic(name):
    try:
        return not name or validate_topic_name(name)
    except InvalidTopicNameException:
        return False


def descriptor(spec: Field) -> ParameterDescriptor:
    """Return the descriptor of a parameter, which `ros2 param describe` shows."""
    meta = spec.metadata
    result = ParameterDescriptor(
        description=meta["description"],
        read_only=meta["read_only"],
        additional_constraints=f"one of {', '.join(meta['choices'])}" if meta["choices"] else "",
    )
    if meta["limits"]:
        low, high = meta["limits"]
        if isinstance(spec.default, float):
            result.floating_point_range = [FloatingPointRange(from_value=float(low), to_value=float(high))]
        else:
            result.integer_range = [IntegerRange(from_value=low, to_value=high)]
    return result


class ParameterServer:
    """Parameters of the node and their current `settings`; invalid changes are rejected."""

    def __init__(self, node):
        # rclpy has no public name for what is given at the start; without it there are no such errors
        self._given = getattr(node, "_parameter_overrides", {})
        for name in self._given:
            if problem := _REMOVED.get(name) or removed(name):
                raise InvalidOptionError(problem, field=name)
        values = {}
        for spec in fields(Settings):
            default = list(spec.default) if isinstance(spec.default, tuple) else spec.default
            values[spec.name] = _plain(node.declare_parameter(spec.name, default, descriptor(spec)).value)
        self.settings = Settings(**values)
        self._node = node
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._take_over)

    def misspelt(self) -> dict[str, str]:
        """Return unknown parameters from the node's start, each with a `names.suggestion`."""
        known = [spec.name for spec in fields(Settings)]
        return {
            name: suggestion(name, known)
            for name in self._given
            if not self._node.has_parameter(name) and not name.startswith("qos_overrides.")
        }

    def _changed(self, parameters):
        known = {spec.name for spec in fields(Settings)}
        changes = {change.name: _plain(change.value) for change in parameters if change.name in known}
        values = {name: getattr(self.settings, name) for name in known}
        return Settings(**(values | changes))

    def _check(self, parameters):
        try:
            self._changed(parameters)
        except UncPhysicsError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _take_over(self, parameters):
        self.settings = self._changed(parameters)


def _plain(value) -> Any:
    """Return arrays of a parameter as tuples, and other values unchanged.

    rclpy reads an empty array as None.
    """
    if value is None:
        return ()
    return value if isinstance(value, (str, bool, int, float)) else tuple(value)


def parameter_table() -> str:
    """Return all parameters as a Markdown table."""
    lines = ["| parameter | default | range | what it is |", "|---|---|---|---|"]
    for spec in fields(Settings):
        meta = spec.metadata
        if meta["choices"]:
            allowed = ", ".join(meta["choices"])
        else:
            allowed = "{:g} to {:g}".format(*meta["limits"]) if meta["limits"] else ""
        name = f"`{spec.name}`" + (" (read-only)" if meta["read_only"] else "")
        lines.append(f"| {name} | `{_default(spec)}` | {allowed} | {meta['description']} |")
    return "\n".join(lines)


def parameter_file() -> str:
    """Return all parameters with their defaults as a parameter file."""
    lines = [
        "# All parameters of the node with their defaults; the documentation's reference has their ranges.",
        "# Made by: python -m unc_physics.ros.parameters > config/unc_physics.yaml",
        "/**:",
        "  ros__parameters:",
    ]
    for spec in fields(Settings):
        lines += [f"    # {spec.metadata['description']}", f"    {spec.name}: {_default(spec)}"]
    return "\n".join(lines)


def _default(spec):
    """Return the default as YAML that ROS reads with the same type."""
    value = list(spec.default) if isinstance(spec.default, tuple) else spec.default
    text = yaml.safe_dump(value, default_flow_style=True, width=1000).removesuffix("...\n").strip()
    return '""' if value == "" else text


def main(arguments=None) -> int:
    """Print the parameter file."""
    parser = argparse.ArgumentParser(prog="unc_physics.ros.parameters", description=__doc__)
    parser.parse_args(arguments)
    print(parameter_file())
    return 0


if __name__ == "__main__":
    sys.exit(main())
