"""What may happen in a rollout, yes or no: in a region, upright, touched something, fell off, at rest.

Shares of rollouts in which an event happens are probabilities, and what actions are ranked by (`rank`).
Events combine: ``InRegion("cup", bin) & Upright("cup")``, and ``~Touches("cup", "wall")``.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..checks.array_field import OptionalArray, array_field
from ..checks.errors import InvalidRequestError
from ..checks.names import hint
from ..checks.validation import array, instance, positive
from ..physics.layout import ANGULAR_VELOCITY, POSITION, QUATERNION, VELOCITY
from ..physics.rotation import rotation_matrix
from ..scene.environment import element_names
from ..scene.scene import Scene
from .regions import BoxRegion

#: What stands for any element of the environment.
ENVIRONMENT = "environment"
#: Speeds below which a body counts as at rest [m/s], [rad/s].
REST_SPEED, REST_ANGULAR_SPEED = 0.01, math.radians(5.0)
#: How far what stands upright may lean [rad].
UPRIGHT_ANGLE = math.radians(45.0)
_LEVEL = 1e-9  # of a plane's normal, from up


class Seen(NamedTuple):
    """What N rollouts of a scene showed.

    Attributes
    ----------
    scene : Scene
    start : (B, 13) array
        The given mean at time 0.
    states : (N, B, 13) array
        At the horizon.
    first : (N, B, B + E) array
        Times of first contacts [s], as in `ContactHistory`.
    """

    scene: Scene
    start: np.ndarray
    states: np.ndarray
    first: np.ndarray


class Event(ABC):
    """Something that happens in a rollout or does not."""

    @abstractmethod
    def happened(self, seen: Seen) -> np.ndarray:
        """(N,) bool: in which rollouts it did."""

    @abstractmethod
    def check(self, scene: Scene, field: str) -> None:
        """Raise `InvalidRequestError` unless it can be told of the scene; the event is called ``field``."""

    @property
    def parts(self) -> tuple[tuple[Event, bool], ...]:
        """The events that happen together, or itself; each with whether it happens, or does not."""
        return ((self, True),)

    def __and__(self, other: Event) -> Event:
        instance(other, Event, "what is combined with &")
        return _Both(self, other)

    def __invert__(self) -> Event:
        return _Not(self)


@dataclass(frozen=True, eq=False)
class _OfBody(Event):
    """An event of one body, at the horizon unless it says otherwise."""

    object: str

    def check(self, scene, field):
        _index(
            self.object, [body.name for body in scene.bodies], f"{field}.object", "is no body of the scene"
        )

    def _states(self, seen):
        """(N, 13): of the body."""
        return seen.states[:, _body(self.object, seen.scene)]


@dataclass(frozen=True, eq=False)
class InRegion(_OfBody):
    """The body's centre of mass lies in a region.

    Attributes
    ----------
    object : str
    region : BoxRegion
    """

    region: BoxRegion

    def __post_init__(self):
        instance(self.region, BoxRegion, "region")

    def happened(self, seen):
        return self.region.contains(self._states(seen)[:, POSITION])

    def __str__(self):
        return f"{self.object} in {self.region.name}"


@dataclass(frozen=True, eq=False)
class AtRest(_OfBody):
    """The body is at rest: its centre of mass is slower than ``speed`` [m/s], and it turns slower than
    ``angular_speed`` [rad/s].
    """

    speed: float = REST_SPEED
    angular_speed: float = REST_ANGULAR_SPEED

    def __post_init__(self):
        for name in ("speed", "angular_speed"):
            positive(getattr(self, name), name)

    def happened(self, seen):
        states = self._states(seen)
        slow = np.linalg.norm(states[:, VELOCITY], axis=1) < self.speed
        return slow & (np.linalg.norm(states[:, ANGULAR_VELOCITY], axis=1) < self.angular_speed)

    def __str__(self):
        return f"{self.object} at rest"


@dataclass(frozen=True, eq=False)
class Upright(_OfBody):
    """The body stands upright: an axis of it leans from up by less than an angle.

    Up is against gravity, and along z where there is none.

    Attributes
    ----------
    object : str
    axis : (3,) array, optional
        The axis, in the body's frame; by default the one that points up in its given pose at time 0, so that
        it stands as it did.
    angle : float
        [rad]
    """

    axis: OptionalArray = array_field(None)
    angle: float = UPRIGHT_ANGLE

    def __post_init__(self):
        if positive(self.angle, "angle") > math.pi:
            raise InvalidRequestError("must be at most pi", field="angle", value=self.angle)
        if self.axis is not None:
            axis = array(self.axis, (3,), "axis")
            if not np.linalg.norm(axis) > 0.0:
                raise InvalidRequestError("must have a direction", field="axis", value=axis.tolist())
            object.__setattr__(self, "axis", axis / np.linalg.norm(axis))

    def happened(self, seen):
        up = up_of(seen.scene)
        axis = self.axis
        if axis is None:
            axis = rotation_matrix(seen.start[_body(self.object, seen.scene), QUATERNION]).T @ up
        return turned(self._states(seen)[:, QUATERNION], axis) @ up > math.cos(self.angle)

    def __str__(self):
        return f"{self.object} upright"


@dataclass(frozen=True, eq=False)
class FellOff(_OfBody):
    """The body fell off what carried it.

    Attributes
    ----------
    object : str
    support : str
        A body or an element of the environment: the body's centre of mass is below its highest point. Empty:
        the centre of mass is lower than in its given pose at time 0 by more than ``drop``.
    drop : float, optional
        [m]; by default the radius about the centre of mass that encloses the body: it cannot come down
        further by toppling on what carried it.
    """

    support: str = ""
    drop: float | None = None

    def __post_init__(self):
        if self.drop is not None:
            positive(self.drop, "drop")
            if self.support:
                raise InvalidRequestError("must not be given beside support", field="drop", value=self.drop)

    def check(self, scene, field):
        super().check(scene, field)
        if self.support:
            self._top(scene, None, f"{field}.support")

    def happened(self, seen):
        scene, up = seen.scene, up_of(seen.scene)
        heights = self._states(seen)[:, POSITION] @ up
        if self.support:
            return heights < self._top(scene, seen.states, "support")
        b = _body(self.object, scene)
        drop = scene.bodies[b].model.bounding_radius if self.drop is None else self.drop
        return heights < seen.start[b, POSITION] @ up - drop

    def _top(self, scene, states, field):
        """Height of the support's highest point [m], one for each rollout if it is a body."""
        up = up_of(scene)
        names = [body.name for body in scene.bodies] + element_names(scene.environment)
        k = _index(self.support, names, field, "is neither a body nor an element of the environment")
        if k < len(scene.bodies):
            if self.support == self.object:
                raise InvalidRequestError("must be another one", field=field, value=self.support)
            return None if states is None else _top_of_body(scene.bodies[k].model, states[:, k], up)
        element = scene.environment[k - len(scene.bodies)]
        if element.shape == "plane":
            if element.normal @ up < 1.0 - _LEVEL:
                raise InvalidRequestError(
                    "is a plane that is not level, and has no highest point", field=field, value=self.support
                )
            return float(element.position @ up)
        low, high = element.bounds
        corners = np.where(np.indices((2, 2, 2)).reshape(3, 8).T, high, low) @ element.rotation.T
        return float(np.max(corners @ up) + element.position @ up)

    def __str__(self):
        return f"{self.object} fell off {self.support}".removesuffix(" ")


@dataclass(frozen=True, eq=False)
class Touches(_OfBody):
    """The body touches another one, an element of the environment, or ``environment``, which is any of its
    elements, at some time up to the horizon.
    """

    other: str

    def check(self, scene, field):
        super().check(scene, field)
        self._columns(scene, f"{field}.other")

    def happened(self, seen):
        b, columns = _body(self.object, seen.scene), self._columns(seen.scene, "other")
        if isinstance(columns, int):  # another body; a pair is kept under the lower index
            return np.isfinite(seen.first[:, min(b, columns), max(b, columns)])
        return np.isfinite(seen.first[:, b, columns]).any(axis=1)

    def _columns(self, scene, field):
        """Index of the other body; or of elements, as a slice of the columns of first contacts."""
        names, elements = [body.name for body in scene.bodies], element_names(scene.environment)
        if self.other == ENVIRONMENT:
            return slice(len(names), None)
        problem = "is neither a body, nor an element of the environment, nor 'environment'"
        k = _index(self.other, names + elements, field, problem)
        if self.other == self.object:
            raise InvalidRequestError("must be another one", field=field, value=self.other)
        return k if k < len(names) else slice(k, k + 1)

    def __str__(self):
        return f"{self.object} touches {self.other}"


@dataclass(frozen=True, eq=False)
class _Both(Event):
    """Two events happen."""

    one: Event
    other: Event

    def happened(self, seen):
        return self.one.happened(seen) & self.other.happened(seen)

    def check(self, scene, field):
        self.one.check(scene, field)
        self.other.check(scene, field)

    @property
    def parts(self):
        return (*self.one.parts, *self.other.parts)

    def __str__(self):
        return f"{self.one} and {self.other}"


@dataclass(frozen=True, eq=False)
class _Not(Event):
    """An event does not happen."""

    event: Event

    def happened(self, seen):
        return ~self.event.happened(seen)

    def check(self, scene, field):
        self.event.check(scene, field)

    @property
    def parts(self):
        one, *more = self.event.parts
        return ((self, True),) if more else ((one[0], not one[1]),)

    def __str__(self):
        return f"not ({self.event})" if len(self.event.parts) > 1 else f"not {self.event}"


def up_of(scene: Scene) -> np.ndarray:
    """(3,): the direction against gravity; the z axis where there is none."""
    strength = np.linalg.norm(scene.gravity)
    return -scene.gravity / strength if strength > 0.0 else np.array([0.0, 0.0, 1.0])


def turned(q: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """(N, 3): an axis (3,) of bodies with quaternions (N, 4), in the world frame."""
    cross = 2.0 * np.cross(q[:, :3], axis)
    return axis + q[:, 3:] * cross + np.cross(q[:, :3], cross)


def _top_of_body(model, states, up):
    """(N,): height of the highest point of a body in states (N, 13) [m]."""
    own_up = np.array([rotation_matrix(q).T @ up for q in states[:, QUATERNION]])
    return states[:, POSITION] @ up + (own_up @ model.centers.T + model.radii).max(axis=1)


def _body(name, scene):
    return next(k for k, body in enumerate(scene.bodies) if body.name == name)


def _index(name, names, field, problem):
    if name not in names:
        raise InvalidRequestError(f"{problem}{hint(str(name), names)}", field=field, value=name)
    return names.index(name)


#: Names of the events about a body that need nothing else, as commands and files have them.
OF_BODY: dict[str, Callable[[str], Event]] = {"at_rest": AtRest, "upright": Upright, "fell_off": FellOff}
