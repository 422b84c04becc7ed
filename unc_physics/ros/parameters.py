"""The node's parameters: one table with defaults, ranges and descriptions, and the settings.

``python -m unc_physics.ros.parameters`` prints them as the file ``config/unc_physics.yaml``.
"""

from __future__ import annotations

import argparse
import functools
import math
import sys
from dataclasses import Field, dataclass, field, fields
from types import SimpleNamespace
from typing import Any

import yaml
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.exceptions import InvalidTopicNameException
from rclpy.validate_topic_name import validate_topic_name

from ..checks.errors import InvalidOptionError, UncPhysicsError
from ..checks.names import removed, suggestion
from ..checks.validation import non_negative
from ..prediction.diagnosis import compared_rollouts
from ..propagators.names import ANYTIME, REFERENCE
from ..propagators.registry import PROPAGATORS, names_where
from ..scene.materials import refuse_with_explicit
from ..scene.physics_keys import INTEGRATORS, OVERLAPS, PHYSICS_KEYS, check_integrator
from ..scene.presets import PRESETS, certain, with_changes
from ..scene.stiffness import AUTO
from .messages.covariances import CovarianceDefaults

_EVERYDAY = PRESETS["everyday"]
_AUTO_OVERLAP = "auto"
AXES = "x", "y", "z"
_REJECTING = names_where(lambda propagator: propagator.supports.overlap_rejection)


def parameter(default, description, *, low=None, high=None, choices=(), read_only=False):
    """Return a field of `Settings` that is a ROS parameter; ranges include their ends."""
    meta = {"description": description, "low": low, "high": high, "choices": choices, "read_only": read_only}
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
        low=0.0,
        high=60.0,
    )

    default_propagator: str = parameter(
        ANYTIME, "Propagator of requests that name none.", choices=tuple(PROPAGATORS)
    )
    dt: float = physics_key("dt", low=1e-6, high=1.0)
    stiffness: float | str = physics_key("stiffness", AUTO)
    damping: float = physics_key("damping", 0.0, low=0.0, high=1e3)
    gravity: tuple[float, ...] = physics_key("gravity")

    friction: float = physics_key("friction", low=0.0, high=100.0)
    restitution: float = physics_key("restitution", low=0.0, high=1.0)
    exact: bool = parameter(
        False,
        "Whether friction and restitution are certain, and impacts have no errors. Otherwise friction and"
        " restitution are those of unknown household objects where they are not set.",
    )
    gyroscopic: bool = physics_key("gyroscopic")
    integrator: str = physics_key("integrator", choices=INTEGRATORS)
    sleep: bool = physics_key("sleep", True)
    overlap: str = parameter(
        _AUTO_OVERLAP,
        "Rule for the part of a belief in which objects overlap at the start: moved to the nearest"
        f" poses without overlap ('project'), left out ('reject', by {_REJECTING} alone), or left in"
        " ('keep'); 'auto': 'project' with 'implicit', and 'keep' with 'explicit', which has no other.",
        choices=(_AUTO_OVERLAP, *OVERLAPS),
    )
    warm_up: tuple[str, ...] = parameter(
        (ANYTIME, REFERENCE),
        "Propagators whose kernels are compiled, or loaded, before the node is ready; kernels of other"
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
    default_position_std: float = parameter(
        0.01, "Standard deviation of an unknown position [m].", low=0.0, high=1e3
    )
    default_orientation_std: float = parameter(
        0.05, "Standard deviation of an unknown orientation [rad].", low=0.0, high=10.0
    )
    default_linear_velocity_std: float = parameter(
        0.05, "Standard deviation of an unknown velocity [m/s].", low=0.0, high=1e3
    )
    default_angular_velocity_std: float = parameter(
        0.1, "Standard deviation of an unknown angular velocity [rad/s].", low=0.0, high=1e3
    )

    status_rollouts: int = parameter(
        0,
        "Number of rollouts with which the status compares the spread of propagators with one nominal"
        " rollout, and of chosen points that move unevenly or turn far; 24 more if these are not decisive. 0:"
        " no comparison; the spread of one nominal rollout after a contact is then flagged as unchecked.",
        low=0,
        high=1000,
    )

    max_horizon: float = parameter(60.0, "Maximum horizon of a request [s].", low=0.0, high=1e6)
    max_steps: int = parameter(
        100_000, "Maximum number of time steps of a prediction.", low=1, high=100_000_000
    )
    max_objects: int = parameter(100, "Maximum number of objects of a request.", low=1, high=10_000)
    max_spheres: int = parameter(100_000, "Maximum number of spheres of one object.", low=1, high=10_000_000)
    max_elements: int = parameter(200, "Maximum number of elements of an environment.", low=0, high=10_000)
    max_regions: int = parameter(100, "Maximum number of regions of a request.", low=0, high=10_000)
    max_samples: int = parameter(
        20_000,
        "Maximum number of samples of a propagator; a larger default is lowered to it.",
        low=1,
        high=10_000_000,
    )
    max_states: int = parameter(
        1_000, "Maximum number of states in the trajectory of one object.", low=1, high=100_000
    )
    max_return_samples: int = parameter(
        1_000, "Maximum number of pose samples for each object and time.", low=0, high=1_000_000
    )
    max_response_bytes: int = parameter(
        16_000_000,
        "Maximum size of the states, samples and covariances of one answer [bytes].",
        low=10_000,
        high=2**31,
    )
    max_computation_time: float = parameter(
        30.0,
        "Longest wall time of a prediction by service [s]; requests may ask for less.",
        low=1e-3,
        high=1e6,
    )

    default_time_budget: float = parameter(
        1.0,
        f"Wall time after which {ANYTIME} adds no more rollouts to its first ones [s], in calls of ~/predict"
        " without wanted errors, time_budget and propagator_options; 0: none.",
        low=0.0,
        high=1e6,
    )
    max_long_computation_time: float = parameter(
        600.0, "Longest wall time of a goal of the action [s]; goals may ask for less.", low=1e-3, high=1e6
    )

    max_candidates: int = parameter(100, "Maximum number of candidates of a request.", low=1, high=10_000)
    max_long_predictions: int = parameter(
        2, "Maximum number of goals of the action that are computed at a time.", low=1, high=4, read_only=True
    )

    horizons: tuple[float, ...] = parameter(
        (0.2, 0.5, 1.0, 2.0), "Times for which streamed scenes are predicted [s]."
    )
    stream_propagator: str = parameter(ANYTIME, "Propagator for streamed scenes.", choices=tuple(PROPAGATORS))
    stream_max_computation_time: float = parameter(
        0.0,
        "Wall time that a streamed scene is to take [s]; if one takes longer, later ones get fewer rollouts."
        " 0: half the time between inputs.",
        low=0.0,
        high=1e6,
    )
    stream_probabilities: bool = parameter(
        False, "Whether predictions of streamed scenes have probabilities of contact and rest."
    )
    max_input_age: float = parameter(
        0.5, "Streamed scenes whose stamp is older are dropped [s]; 0 takes all.", low=0.0, high=1e6
    )
    max_input_lead: float = parameter(
        0.1,
        "Streamed scenes whose stamp is farther in the future are dropped [s]; 0 takes all.",
        low=0.0,
        high=1e6,
    )
    pose_objects: tuple[str, ...] = parameter(
        ("",),
        "Ids of streamed objects whose predicted pose is also published on a topic of its own, "
        "~/predicted_pose/ID, with _ in place of what a topic's name cannot hold.",
    )
    pose_horizon: float = parameter(
        1.0, "Which of the horizons those poses are predicted for [s].", low=0.0, high=1e6
    )
    publish_tf: bool = parameter(
        False,
        "Whether the poses of all streamed objects at that horizon are published on /tf, too, as frames "
        "ID_predicted in the world frame with the stamp of the scene. Needs tf2_msgs.",
    )
    tracked_topics: tuple[str, ...] = parameter(
        ("",), "Topics of PoseWithCovarianceStamped, each of a single tracked object.", read_only=True
    )
    tracked_models: tuple[str, ...] = parameter(
        ("",), "Model of the object of each tracked topic.", read_only=True
    )
    tracked_mass: float = parameter(
        1.0, "Mass of tracked and detected objects whose model gives none [kg].", low=1e-9, high=1e9
    )

    track: bool = parameter(
        False,
        "Whether the node tracks the objects of ~/observations and ~/observed/ID: it keeps a belief about"
        " them through contact and occlusion, publishes it on ~/tracked, and predicts from it.",
        read_only=True,
    )
    observed_objects: tuple[str, ...] = parameter(
        ("",),
        "Ids of objects that are observed on topics of PoseWithCovarianceStamped, ~/observed/ID, with _ in"
        " place of what a topic's name cannot hold.",
        read_only=True,
    )
    observed_models: tuple[str, ...] = parameter(("",), "Model of each of those objects.", read_only=True)
    symmetric_models: tuple[str, ...] = parameter(
        ("",), "Models that look the same at every angle about an axis.", read_only=True
    )
    symmetry_axes: tuple[str, ...] = parameter(
        ("",),
        "Axis of symmetry of each of these models, in the model's coordinates.",
        choices=AXES,
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
        low=0.0,
        high=1e3,
    )
    forget_after: float = parameter(
        30.0,
        "Time without accepted observations after which an object is forgotten [s]; 0: never.",
        low=0.0,
        high=1e6,
    )
    tracking_window: float = parameter(
        0.5, "Largest delay of an observation [s].", low=1e-3, high=60.0, read_only=True
    )
    tracking_members: int = parameter(
        64, "Number of rollouts of the tracker.", low=8, high=10_000, read_only=True
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
        low=0.0,
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
        10.0,
        "Duration for which markers are shown [s]; 0: until other markers replace them.",
        low=0.0,
        high=1e6,
    )

    def __post_init__(self):
        check_integrator(self.integrator)
        for spec in fields(self):
            value = getattr(self, spec.name)
            chosen = value if isinstance(value, tuple) else (value,)
            if any(isinstance(number, float) and not math.isfinite(number) for number in chosen):
                raise InvalidOptionError("must be finite", field=spec.name, value=value)
            choices = spec.metadata["choices"]
            if choices and not set(chosen) <= {*choices, *([""] if isinstance(value, tuple) else [])}:
                raise InvalidOptionError(f"must be one of {', '.join(choices)}", field=spec.name, value=value)
        object.__setattr__(self, "stiffness", _stiffness(self.stiffness))
        compared_rollouts(self.status_rollouts, "status_rollouts")
        if self.integrator == "explicit":
            refuse_with_explicit(SimpleNamespace(**self.physics))
        elif self.stiffness != AUTO:
            raise InvalidOptionError(
                f"must be '{AUTO}' with 'integrator: implicit', whose contacts are rigid",
                field="stiffness",
                value=self.stiffness,
            )
        if len(self.gravity) != 3:
            raise InvalidOptionError("must have 3 numbers", field="gravity", value=list(self.gravity))
        if not self.horizons or min(self.horizons) <= 0.0 or max(self.horizons) > self.max_horizon:
            raise InvalidOptionError(
                f"must be above 0 and at most {self.max_horizon} s",
                field="horizons",
                value=list(self.horizons),
            )
        for names, partners, partner in (
            ("tracked_topics", "tracked_models", "a model"),
            ("observed_objects", "observed_models", "a model"),
            ("symmetric_models", "symmetry_axes", "an axis"),
        ):
            count, given = len(getattr(self, names)), getattr(self, partners)
            if len(given) != count:
                raise InvalidOptionError(
                    f"must name {partner} for each of the {count} {names}", field=partners, value=list(given)
                )
            if partner == "a model" and (
                open_ones := [n for n, p in zip(getattr(self, names), given) if n and not p]
            ):
                raise InvalidOptionError(
                    f"must name a model for '{open_ones[0]}' of {names}", field=partners, value=list(given)
                )
        topics = [("tracked_topics", topic) for topic in self.tracked_topics]
        for name, topic in [*topics, ("planning_scene_topic", self.planning_scene_topic)]:
            try:
                if topic:
                    validate_topic_name(topic)
            except InvalidTopicNameException:
                raise InvalidOptionError("is no name of a topic", field=name, value=topic) from None
        if not self.world_frame:
            raise InvalidOptionError("must not be empty", field="world_frame")

    @functools.cached_property
    def covariance_defaults(self) -> CovarianceDefaults:
        """Defaults of unknown covariances, and the meaning of zero covariances."""
        return CovarianceDefaults.from_stds(
            self.default_position_std,
            self.default_orientation_std,
            self.default_linear_velocity_std,
            self.default_angular_velocity_std,
            self.zero_covariance == "exact",
        )

    @functools.cached_property
    def physics(self) -> dict:
        """Physics of the scenes, as arguments of `Scene`."""
        overlap = None if self.overlap == _AUTO_OVERLAP else self.overlap
        given = {key: getattr(self, key) for key in PHYSICS_KEYS if hasattr(self, key)}
        given |= {"overlap": overlap, "sleep": self.sleep and self.integrator != "explicit"}
        # a friction or restitution that was set is exact
        unchanged = [key for key in ("friction", "restitution") if getattr(self, key) == _EVERYDAY[key]]
        changes = {key: value for key, value in given.items() if key not in unchanged}
        return with_changes(certain(_EVERYDAY) if self.exact else _EVERYDAY, changes)


def _stiffness(value):
    """Return a number or 'auto'; YAML, and so `ros2 param set`, reads 1e6 as a string."""
    if value == AUTO:
        return value
    try:
        value = float(value) if isinstance(value, str) else value
    except ValueError:
        pass
    if isinstance(value, str | bool | tuple):
        raise InvalidOptionError(f"must be a number or '{AUTO}'", field="stiffness", value=value)
    return non_negative(value, "stiffness", InvalidOptionError)


def descriptor(spec: Field) -> ParameterDescriptor:
    """Return the descriptor of a parameter, which `ros2 param describe` shows."""
    meta = spec.metadata
    result = ParameterDescriptor(
        description=meta["description"],
        read_only=meta["read_only"],
        dynamic_typing=spec.name == "stiffness",
        additional_constraints=f"one of {', '.join(meta['choices'])}" if meta["choices"] else "",
    )
    if meta["low"] is not None:
        if isinstance(spec.default, float):
            result.floating_point_range = [
                FloatingPointRange(from_value=float(meta["low"]), to_value=float(meta["high"]))
            ]
        else:
            result.integer_range = [IntegerRange(from_value=meta["low"], to_value=meta["high"])]
    return result


class ParameterServer:
    """Parameters of the node and their current `settings`; invalid changes are rejected."""

    def __init__(self, node):
        # rclpy has no public name for what is given at the start; without it there are no such errors
        self._given = getattr(node, "_parameter_overrides", {})
        for name in self._given:
            if problem := removed(name):
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
            allowed = "" if meta["low"] is None else f"{meta['low']:g} to {meta['high']:g}"
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
