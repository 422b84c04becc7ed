"""Events that happen in a rollout or do not: in a region, upright, touching, fallen off, at rest.

``Prediction.probability`` estimates how probable an event is, and `rank` ranks actions by one. Events are
combined by ``&``, ``|`` and ``~``: ``InRegion("cup", bin) & Upright("cup") & ~Touches("cup", "pot")``.
"""

from __future__ import annotations

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import Any, ClassVar, NamedTuple, TypeVar

import numpy as np

from ..checks.array_field import OptionalArray, array_field
from ..checks.errors import InvalidRequestError
from ..checks.names import hint
from ..checks.validation import array, instance, positive
from ..scene.environment import ENVIRONMENT, element_names, thing_names
from ..scene.scene import Scene
from ..shapes.pieces import farthest
from ..spatial.layout import ANGULAR_VELOCITY, POSITION, QUATERNION, VELOCITY
from ..spatial.rotation import rotate_vectors, rotation_matrix
from .regions import BoxRegion

#: Speeds below which a body counts as at rest [m/s], [rad/s].
REST_SPEED, REST_ANGULAR_SPEED = 0.01, math.radians(5.0)
#: How far what stands upright may lean [rad].
UPRIGHT_ANGLE = math.radians(45.0)
_LEVEL = 1e-9  # of a plane's normal, from up


Kind = TypeVar("Kind", bound="type[Event]")
#: Classes of events by their keys on the command line (`register_event`).
EVENTS: dict[str, type[Event]] = {}


def register_event(kind: Kind) -> Kind:
    """Add a class of events to `EVENTS`; its key is its name in snake case.

    `event_entries` then reads the event from the command line.
    """
    EVENTS[re.sub(r"(?<!^)(?=[A-Z])", "_", kind.__name__).lower()] = kind
    return kind


_FAR = 8.0  # standard deviations from an event's border, beyond which a margin says nothing more


class RolloutOutcomes(NamedTuple):
    """Equally probable outcomes of a scene up to one time."""

    scene: Scene
    start: np.ndarray  # (B, 13): the given mean at time 0
    states: np.ndarray  # (N, B, 13): at that time, as in `Belief.mean`
    #: (N, B, B + E): times of first contacts [s], as in `ContactHistory`; None where they are not known
    first_contacts: np.ndarray | None = None


class Event(ABC):
    """Something that happens in a rollout or does not. Events with the same arguments are equal."""

    #: Whether it depends on contacts on the way, not on the states alone.
    needs_contacts: bool = False

    @abstractmethod
    def happened(self, outcomes: RolloutOutcomes) -> np.ndarray:
        """Return in which outcomes (N,) the event happens."""

    @abstractmethod
    def check(self, scene: Scene, field: str) -> None:
        """Raise `InvalidRequestError` unless it is about what is in the scene; errors call it ``field``."""

    @property
    @abstractmethod
    def names(self) -> frozenset[str]:
        """Names of the bodies and elements that it is about."""

    def margin(self, outcomes: RolloutOutcomes) -> float | None:
        """Return the median distance of the outcomes from the event's border, in standard deviations.

        It is positive if the event happens in more than half of the outcomes, and clipped to +-8. Contacts
        have no distance and are ignored. Returns None if the event has no distance, or if contacts decide it,
        so that the distances of the other parts contradict the outcomes.
        """
        distances = self.scaled_distances(outcomes)
        if distances is None:
            return None
        margin = float(np.clip(np.median(distances), -_FAR, _FAR))
        share = float(self.happened(outcomes).mean())
        return None if margin * (share - 0.5) < 0.0 else margin

    def scaled_distances(self, outcomes: RolloutOutcomes) -> np.ndarray | None:
        """Return distances (N,) of the outcomes from the event's border, in standard deviations.

        They are positive where the event happens. Returns None if the event has no distance.
        """
        return None

    @property
    def parts(self) -> tuple[tuple[Event, bool], ...]:
        """The events of a conjunction, or the event itself, each with whether it must happen or must not."""
        return ((self, True),)

    def __and__(self, other: Event) -> Event:
        instance(other, Event, "what is combined with &")
        return _Both(self, other)

    def __or__(self, other: Event) -> Event:
        instance(other, Event, "what is combined with |")
        return _Either(self, other)

    def __bool__(self) -> bool:
        """Refuse ``and``, ``or`` and ``not``, which would take one of two events without a word."""
        raise TypeError("an event is neither true nor false; combine events by &, | and ~")

    def __invert__(self) -> Event:
        return _Not(self)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Event) and self._key() == other._key()

    def __hash__(self) -> int:
        return hash(self._key())

    def _key(self):
        """Return the class and the values that two equal events share."""
        values = [getattr(self, one.name) for one in fields(self)]  # pyright: ignore[reportArgumentType]
        return (type(self), *map(_hashable, values))


@dataclass(frozen=True, eq=False)
class BodyEvent(Event):
    """An event of one body's state."""

    object: str

    def happened(self, outcomes):
        return self.distances(outcomes) > 0.0

    def scaled_distances(self, outcomes):
        found = self.distances(outcomes)
        std = float(found.std())
        return found / std if std > 0.0 else np.copysign(math.inf, found)

    @abstractmethod
    def distances(self, outcomes: RolloutOutcomes) -> np.ndarray:
        """Return distances of the states from the event's border (N,), positive where it happens.

        An event without a distance returns 1 and -1; its `scaled_distances` are None.
        """

    def check(self, scene, field):
        _index(
            self.object, [body.name for body in scene.bodies], f"{field}.object", "names no body of the scene"
        )

    @property
    def names(self):
        return frozenset([self.object])

    def states(self, outcomes: RolloutOutcomes) -> np.ndarray:
        """Return the states of the body (N, 13), as in `Belief.mean`."""
        return outcomes.states[:, _body(self.object, outcomes.scene)]


@register_event
@dataclass(frozen=True, eq=False)
class InRegion(BodyEvent):
    """The body's centre of mass lies in a region.

    Attributes
    ----------
    object : str
    region : BoxRegion
    """

    region: BoxRegion

    def __post_init__(self):
        instance(self.region, BoxRegion, "region")

    def distances(self, outcomes) -> np.ndarray:
        return self.region.depths(self.states(outcomes)[:, POSITION])

    def __str__(self):
        return f"{self.object} in {self.region.name}"


@register_event
@dataclass(frozen=True, eq=False)
class AtRest(BodyEvent):
    """The body is at rest: its centre of mass is slower than ``speed`` [m/s], and it turns slower than
    ``angular_speed`` [rad/s].
    """

    speed: float = REST_SPEED
    angular_speed: float = REST_ANGULAR_SPEED

    def __post_init__(self):
        for name in ("speed", "angular_speed"):
            positive(getattr(self, name), name)

    def distances(self, outcomes) -> np.ndarray:
        states = self.states(outcomes)
        speeds = np.linalg.norm(states[:, VELOCITY], axis=1) / self.speed
        spins = np.linalg.norm(states[:, ANGULAR_VELOCITY], axis=1) / self.angular_speed
        return 1.0 - np.maximum(speeds, spins)

    def __str__(self):
        return f"{self.object} at rest"


@register_event
@dataclass(frozen=True, eq=False)
class Upright(BodyEvent):
    """The body stands upright: an axis of it leans from up by less than an angle.

    Up is against gravity, and along z where there is none.

    Attributes
    ----------
    object : str
    axis : (3,) array, optional
        The axis, in the body's frame. By default, the axis that points up in the given pose at time 0.
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

    def distances(self, outcomes) -> np.ndarray:
        up = up_of(outcomes.scene)
        axis = self.axis
        if axis is None:
            axis = rotation_matrix(outcomes.start[_body(self.object, outcomes.scene), QUATERNION]).T @ up
        upward = rotate_vectors(self.states(outcomes)[:, QUATERNION], axis) @ up
        return self.angle - np.arccos(np.clip(upward, -1.0, 1.0))

    def __str__(self):
        return f"{self.object} upright"


@register_event
@dataclass(frozen=True, eq=False)
class FellOff(BodyEvent):
    """The body falls off what carries it.

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
            self._checked_support(scene, f"{field}.support")

    @property
    def names(self):
        return frozenset([self.object, self.support] if self.support else [self.object])

    def distances(self, outcomes) -> np.ndarray:
        scene, up = outcomes.scene, up_of(outcomes.scene)
        heights = self.states(outcomes)[:, POSITION] @ up
        if self.support:
            return self._top(scene, outcomes.states) - heights
        b = _body(self.object, scene)
        drop = scene.bodies[b].model.bounding_radius if self.drop is None else self.drop
        return outcomes.start[b, POSITION] @ up - drop - heights

    def _checked_support(self, scene, field):
        """Return the index of the support among bodies and elements; raise if it has no highest point."""
        problem, names = "is neither a body nor an element of the environment", thing_names(scene)
        k = _index(self.support, names, field, problem)
        if self.support == self.object:
            raise InvalidRequestError("must be another one", field=field, value=self.support)
        if k >= len(scene.bodies):
            element = scene.environment[k - len(scene.bodies)]
            is_level = element.shape == "plane" and element.normal @ up_of(scene) >= 1.0 - _LEVEL
            if not (is_level or element.finite):
                kind = "a plane that is not level" if element.shape == "plane" else "unbounded"
                raise InvalidRequestError(
                    f"is {kind}, and has no highest point", field=field, value=self.support
                )
        return k

    def _top(self, scene, states):
        """Return the height of the support's highest point [m], (N,) if it is a body."""
        k, up = self._checked_support(scene, "support"), up_of(scene)
        if k < len(scene.bodies):
            return _top_of_body(scene.bodies[k].model, states[:, k], up)
        element = scene.environment[k - len(scene.bodies)]
        highest = element.outermost(up[None])[0] if element.finite else element.position
        return float(highest @ up)

    def __str__(self):
        return f"{self.object} fell off {self.support}".removesuffix(" ")


@register_event
@dataclass(frozen=True, eq=False)
class Touches(BodyEvent):
    """The body touches another body or an element, at some time up to the time of the question.
    ``environment`` stands for any element.

    Which of two bodies is named first does not matter.
    """

    needs_contacts = True
    other: str

    def check(self, scene, field):
        super().check(scene, field)
        k = self._columns(scene, f"{field}.other")
        both = [_body(self.object, scene), *([k] if isinstance(k, int) else [])]
        if not any(scene.bodies[body].free for body in both):
            raise InvalidRequestError(
                f"is nothing that '{self.object}' can touch, as neither moves freely",
                field=f"{field}.other",
                value=self.other,
            )

    @property
    def names(self):
        return frozenset([self.object, self.other])

    def first_times(self, outcomes: RolloutOutcomes) -> np.ndarray:
        """Return the times of the first contact (N,) [s], infinite without one."""
        b, columns = _body(self.object, outcomes.scene), self._columns(outcomes.scene, "other")
        first = outcomes.first_contacts
        assert first is not None
        if isinstance(columns, int):  # another body; a pair is kept under the lower index
            return first[:, min(b, columns), max(b, columns)]
        return first[:, b, columns].min(axis=1, initial=np.inf)

    def scaled_distances(self, outcomes):
        return None

    def distances(self, outcomes) -> np.ndarray:
        return np.where(np.isfinite(self.first_times(outcomes)), 1.0, -1.0)

    def _key(self):
        return (Touches, self.names)

    def _columns(self, scene, field):
        """Return the index of the other body, or the columns of first contacts with elements as a slice."""
        bodies = len(scene.bodies)
        if self.other == ENVIRONMENT:
            return slice(bodies, None)
        problem = "is neither a body, nor an element of the environment, nor 'environment'"
        k = _index(self.other, thing_names(scene), field, problem)
        if self.other == self.object:
            raise InvalidRequestError("must be another one", field=field, value=self.other)
        return k if k < bodies else slice(k, k + 1)

    def __str__(self):
        return f"{self.object} touches {self.other}"


@dataclass(frozen=True, eq=False)
class _Pair(Event):
    """Two events combined by the same operation on distances and truth values."""

    combine: ClassVar[Any]  # a ufunc
    one: Event
    other: Event

    @property
    def needs_contacts(self):
        return self.one.needs_contacts or self.other.needs_contacts

    @property
    def names(self):
        return self.one.names | self.other.names

    def check(self, scene, field):
        self.one.check(scene, field)
        self.other.check(scene, field)

    def scaled_distances(self, outcomes):
        """Return the combined distances of both events, or the distances of the event that has some."""
        one, other = self.one.scaled_distances(outcomes), self.other.scaled_distances(outcomes)
        if one is None or other is None:
            return other if one is None else one
        return self.combine(one, other)

    def happened(self, outcomes):
        return self.combine(self.one.happened(outcomes), self.other.happened(outcomes))


class _Both(_Pair):
    """Two events happen."""

    combine = np.minimum

    @property
    def parts(self):
        return (*self.one.parts, *self.other.parts)

    def __str__(self):
        return " and ".join(_bracketed(event, _Either) for event in (self.one, self.other))


class _Either(_Pair):
    """One of two events happens, or both."""

    combine = np.maximum

    def __str__(self):
        return " or ".join(_bracketed(event, _Both) for event in (self.one, self.other))


@dataclass(frozen=True, eq=False)
class _Not(Event):
    """An event does not happen."""

    event: Event

    @property
    def needs_contacts(self):
        return self.event.needs_contacts

    @property
    def names(self):
        return self.event.names

    def happened(self, outcomes):
        return ~self.event.happened(outcomes)

    def scaled_distances(self, outcomes):
        found = self.event.scaled_distances(outcomes)
        return None if found is None else -found

    def check(self, scene, field):
        self.event.check(scene, field)

    @property
    def parts(self):
        one, *more = self.event.parts
        return ((self, True),) if more else ((one[0], not one[1]),)

    def __str__(self):
        return f"not {_bracketed(self.event, _Pair)}"


def checked_events(events: Iterable[Event], scene: Scene) -> tuple[Event, ...]:
    """Return events as a tuple, after checking that each is about the scene."""
    try:
        found = tuple(events)
    except TypeError:
        raise InvalidRequestError("must be a sequence of Event", field="events", value=events) from None
    for k, event in enumerate(found):
        instance(event, Event, f"events[{k}]")
        event.check(scene, f"events[{k}]")
    return found


def encounters(scene: Scene) -> list[Touches]:
    """Return all possible contacts with a moving body.

    First pairs of bodies, in the scene's order; then each moving body with each element of the environment,
    and with the environment as a whole.
    """
    elements = element_names(scene.environment)
    found = [
        Touches(one.name, other.name)
        for k, one in enumerate(scene.bodies)
        for other in scene.bodies[k + 1 :]
        if one.free or other.free
    ]
    for k in scene.moving:
        name = scene.bodies[k].name
        found += [Touches(name, element) for element in (*elements, *([ENVIRONMENT] if elements else []))]
    return found


def moving_names(scene: Scene) -> list[str]:
    """Return the names of the bodies that move, in the scene's order."""
    return [scene.bodies[k].name for k in scene.moving]


def up_of(scene: Scene) -> np.ndarray:
    """Return the direction against gravity (3,), or the z axis without gravity."""
    strength = np.linalg.norm(scene.gravity)
    return -scene.gravity / strength if strength > 0.0 else np.array([0.0, 0.0, 1.0])


def _top_of_body(model, states, up):
    """Return the height of the highest point of a body in states (N, 13): (N,) [m]."""
    own_up = np.array([rotation_matrix(q).T @ up for q in states[:, QUATERNION]])
    return states[:, POSITION] @ up + farthest(model.pieces, own_up)


def _bracketed(event, kind):
    """Return an event as a text, in brackets if it is of a kind."""
    return f"({event})" if isinstance(event, kind) else str(event)


def _hashable(value):
    """Return the hashable value of an event's field."""
    if isinstance(value, np.ndarray):
        return tuple(value.ravel().tolist())
    if isinstance(value, BoxRegion):
        return tuple(_hashable(getattr(value, one.name)) for one in fields(value))
    return value


def _body(name, scene):
    return next(k for k, body in enumerate(scene.bodies) if body.name == name)


def _index(name, names, field, problem):
    if name not in names:
        raise InvalidRequestError(f"{problem}{hint(str(name), names)}", field=field, value=name)
    return names.index(name)
