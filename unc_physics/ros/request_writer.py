"""From the core to messages, for a client: a request from a scene and the belief about it.

What the node reads from it (`scene_reader`) is that scene and that belief again, to round-off.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from diagnostic_msgs.msg import KeyValue
from geometry_msgs.msg import Point, Pose, Quaternion, Vector3
from shape_msgs.msg import Plane as PlaneMessage
from shape_msgs.msg import SolidPrimitive

from unc_physics_msgs.msg import BoxRegion as BoxRegionMessage
from unc_physics_msgs.msg import (
    EnvironmentElement,
    JointCovariance,
    Material,
    ModelInfo,
    ObjectState,
    PredictionRequest,
)
from unc_physics_msgs.msg import Scene as SceneMessage

from ..checks.errors import InvalidModelError, NotSupportedError
from ..geometry.packing_file import ROUND_OFF, SpherePacking
from ..physics.layout import ANGULAR_VELOCITY, POSITION, QUATERNION, VELOCITY
from ..physics.origin import at_origin, congruent, error_map
from ..prediction.regions import BoxRegion
from ..propagators.base import Propagator
from ..scene.belief import Belief
from ..scene.body import RigidBody
from ..scene.environment import Box, Cylinder, Element, Plane, Sphere, element_names
from ..scene.materials import Surface
from ..scene.physics_keys import PHYSICS_KEYS
from ..scene.scene import Scene
from .action_messages import surface_velocity, write_actions
from .arrays import block_diagonal, packed
from .durations import duration
from .physics_message import physics_message
from .surroundings import MATERIAL_FIELDS

_SNAP = 1e-13  # relative; a scale of two radii is off by round-off


@dataclass(frozen=True, eq=False)
class Question:
    """What a client asks a node.

    Attributes
    ----------
    scene : Scene
    belief : Belief
    propagator : Propagator
    seed : int or None
        None lets the node choose.
    steps : list of int
        Numbers of steps after which a belief is wanted, ascending.
    max_computation_time : float or None
        [s]
    keep_samples : int
    regions : tuple of BoxRegion
    probabilities, modes, joint_covariance : bool
    """

    scene: Scene
    belief: Belief
    propagator: Propagator
    seed: int | None
    steps: list[int]
    max_computation_time: float | None
    keep_samples: int
    regions: tuple[BoxRegion, ...]
    probabilities: bool
    modes: bool
    joint_covariance: bool


def write_request(question: Question, model_info: Callable[[str], ModelInfo]) -> PredictionRequest:
    """The request that asks a question.

    Parameters
    ----------
    question : Question
    model_info : callable
        What the node knows about a model of some name; raises `UnknownModelError`.

    Raises
    ------
    UnknownModelError, InvalidModelError
        If the node does not have a body's model, or another one under its name.
    NotSupportedError
        If messages have no room for an element of the environment.
    """
    steps, dt = question.steps, question.scene.dt
    propagator = question.propagator
    options = {name: getattr(propagator, name) for name in propagator.options()}
    if question.seed is None:
        options.pop("seed", None)
    request = PredictionRequest(
        scene=write_scene(question.scene, question.belief, model_info),
        horizon=duration(steps[-1] * dt),
        physics=physics_message({key: getattr(question.scene, key) for key in PHYSICS_KEYS}),
        propagator=propagator.name,
        propagator_options=[KeyValue(key=name, value=str(value)) for name, value in options.items()],
        seed=question.seed or 0,
        regions=[write_region(region) for region in question.regions],
        return_probabilities=question.probabilities,
        return_modes=question.modes,
        return_joint_covariance=question.joint_covariance,
        return_covariance=not question.joint_covariance,
        return_samples=question.keep_samples,
    )
    if len(steps) > 1:  # the other multiples are left out of the answer
        request.trajectory_period = duration(math.gcd(*steps) * dt)
    if question.max_computation_time is not None:
        request.max_computation_time = duration(question.max_computation_time)
    return request


def write_scene(scene: Scene, belief: Belief, model_info: Callable[[str], ModelInfo]) -> SceneMessage:
    """A scene and the belief about it, in the node's world frame; raises as `write_request`."""
    message = SceneMessage(
        objects=[write_object(scene, belief, b, model_info) for b in range(len(scene.bodies))]
    )
    names = element_names(scene.environment)
    message.environment.elements = [
        _element(element, name, f"environment[{k}]")
        for k, (element, name) in enumerate(zip(scene.environment, names, strict=True))
    ]
    moving = scene.moving.tolist()
    if not belief.independent and moving:
        origins = [np.array(scene.bodies[b].model.origin) for b in moving]
        maps = [
            error_map(np.array(belief.mean[b]), origin) for b, origin in zip(moving, origins, strict=True)
        ]
        C = congruent(block_diagonal(maps), np.array(belief.joint))
        ids = [scene.bodies[b].name for b in moving]
        message.joint_covariance = [JointCovariance(object_ids=ids, data=packed(C))]
    return message


def write_object(scene: Scene, belief: Belief, b: int, model_info: Callable[[str], ModelInfo]) -> ObjectState:
    """What is known of body ``b``; raises as `write_request`."""
    body: RigidBody = scene.bodies[b]
    state, C, *_ = at_origin(
        np.array(belief.mean[b]), np.array(belief.marginal(b)), np.array(body.model.origin)
    )
    field = f"model of body '{body.name}'"
    message = ObjectState(
        id=body.name,
        kind=ObjectState.FIXED if body.fixed else ObjectState.DYNAMIC,
        model=body.model.name,
        spheres=len(body.model),
        scale=scale_of(body.model, model_info(body.model.name), field),
        mass=float(body.mass),
        mass_std=float(body.mass_std),
        center_of_mass_std=_vector(body.center_of_mass_std),
        material=_material(body),
        at_rest=body.at_rest,
        inertia=[] if body.inertia is None else packed(body.inertia.ravel()),
    )
    write_actions(body, message)
    message.pose.pose = _pose(state[POSITION], state[QUATERNION])
    message.twist.twist.linear, message.twist.twist.angular = (
        _vector(state[VELOCITY]),
        _vector(state[ANGULAR_VELOCITY]),
    )
    if body.free:
        message.covariance = packed(C)
    return message


def write_region(region: BoxRegion) -> BoxRegionMessage:
    """A region to ask about."""
    return BoxRegionMessage(
        id=region.name, pose=_pose(region.position, region.orientation), size=_vector(region.size)
    )


def scale_of(packing: SpherePacking, info: ModelInfo, field: str) -> float:
    """The factor from the node's model to a packing of its name.

    Raises
    ------
    InvalidModelError
        If the two are not the same but for their size, or the node's is not ready.
    """
    if info.status != ModelInfo.STATUS_READY:
        raise InvalidModelError(f"is not ready: {info.status_msg}", field=field, value=packing.name)
    scale = packing.bounding_radius / info.bounding_radius
    if abs(scale - round(scale, 9)) < _SNAP * scale:
        scale = round(scale, 9)
    center = np.array([info.center_of_mass.x, info.center_of_mass.y, info.center_of_mass.z])
    compared = {
        "inertia": (packing.inertia.ravel() / scale**2, np.array(info.inertia)),
        "origin": (packing.origin / scale, -center),
        "volume": (packing.volume / scale**3, info.volume),
    }
    size = {"inertia": np.abs(info.inertia).max(), "origin": info.bounding_radius, "volume": info.volume}
    differs = [
        name for name, (own, told) in compared.items() if np.abs(own - told).max() > ROUND_OFF * size[name]
    ]
    if len(packing) > info.spheres:
        differs.append("number of spheres")
    if differs:
        raise InvalidModelError(
            f"is another one than the node's: it differs in {' and '.join(differs)};"
            " client.load_model(path, replace=True) gives the node its file",
            field=field,
            value=packing.name,
        )
    return float(scale)


def _element(element: Element, name: str, field: str) -> EnvironmentElement:
    message = EnvironmentElement(
        id=name, material=_material(element), surface_tilt_std=element.surface_tilt_std
    )
    if isinstance(element, Plane):
        message.plane = [PlaneMessage(coef=np.array([*element.normal, -element.offset]))]
        message.surface_velocity = surface_velocity(element, (0.0, 0.0, 0.0))
        return message
    if isinstance(element, Box):
        kind, size = SolidPrimitive.BOX, element.size
    elif isinstance(element, Sphere):
        kind, size = SolidPrimitive.SPHERE, [element.radius]
    elif isinstance(element, Cylinder):
        kind, size = SolidPrimitive.CYLINDER, [element.length, element.radius]
    else:
        raise NotSupportedError(
            f"is a {element.shape}, for which messages have no room; take a cylinder, or a fixed body with a"
            " model of that shape",
            field=field,
            value=name,
        )
    message.primitive = [SolidPrimitive(type=kind, dimensions=packed(size))]
    message.pose = _pose(element.position, element.orientation)
    message.surface_velocity = surface_velocity(element, element.position)
    return message


def _material(surface: Surface) -> Material:
    given = {name: getattr(surface, name) for name in MATERIAL_FIELDS}
    known = {name: value for name, value in given.items() if value}
    known |= {name: given[name] for name in ("friction", "restitution") if given[name] is not None}
    return Material(**{name: packed([value]) for name, value in known.items()})


def _pose(position, q) -> Pose:
    x, y, z = map(float, position)
    qx, qy, qz, qw = map(float, q)
    return Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(x=qx, y=qy, z=qz, w=qw))


def _vector(v) -> Vector3:
    x, y, z = map(float, v)
    return Vector3(x=x, y=y, z=z)
