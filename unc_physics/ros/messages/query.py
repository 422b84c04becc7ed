"""Arguments of the client's predictions, checked."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, TypedDict

from unc_physics_msgs.msg import PredictionRequest
from unc_physics_msgs.srv import Fork

from ...checks.errors import DuplicateIdError, LimitExceededError, NotSupportedError
from ...checks.validation import instance, integer, positive
from ...prediction.events import Event, FellOff, InRegion, Touches, checked_events
from ...prediction.regions import BoxRegion
from ...prediction.request_checks import check_supported, marks_of
from ...propagators.base import Propagator
from ...propagators.registry import make_propagator
from ...scene.belief import Belief
from ...scene.marks import Mark
from ...scene.scene import Scene
from .events import message_of, object_events


class RequestedOutputs(NamedTuple):
    """Requested outputs besides means and marginal covariances; each has a field ``return_<name>``.

    Attributes
    ----------
    covariance, joint_covariance : bool
        Complete covariance of each object; joint covariance of all moving objects.
    probabilities : bool
        Probabilities of contact, rest, uprightness and falls.
    modes : bool
        Split outcomes as weighted Gaussians.
    center_of_mass : bool
        States and covariances of the centres of mass, too.
    """

    covariance: bool = False
    joint_covariance: bool = False
    probabilities: bool = False
    modes: bool = False
    center_of_mass: bool = False

    @classmethod
    def read(cls, request: PredictionRequest | Fork.Request) -> RequestedOutputs:
        """Return the outputs that a request asks for."""
        return cls(*(getattr(request, f"return_{name}") for name in cls._fields))

    def fields(self) -> dict[str, bool]:
        """Return the fields of a request that asks for these outputs."""
        return {f"return_{name}": value for name, value in self._asdict().items()}


MARGINALS_ONLY = RequestedOutputs()


class Options(TypedDict, total=False):
    """Keywords that `Client.predict`, which documents them, and other methods accept."""

    times: Sequence[float] | None
    seed: int | None
    samples: int | None
    max_computation_time: float | None
    keep_samples: int
    events: Iterable[Event]
    modes: bool
    joint_covariance: bool | None


@dataclass(frozen=True, eq=False, kw_only=True)
class Query:
    """Checked arguments of `Client.predict`.

    Attributes
    ----------
    scene : Scene
    belief : Belief
    propagator : Propagator
    marks : list of Mark
        Times at which a belief is requested, ascending.
    seed : int or None
        None if the node chooses it.
    max_computation_time : float or None
        [s]
    keep_samples : int
    regions : tuple of BoxRegion
    outputs : RequestedOutputs
    """

    scene: Scene
    belief: Belief
    propagator: Propagator
    marks: list[Mark]
    seed: int | None = None
    max_computation_time: float | None = None
    keep_samples: int = 0
    regions: tuple[BoxRegion, ...] = ()
    outputs: RequestedOutputs = MARGINALS_ONLY


def make_query(
    scene: Scene,
    belief: Belief,
    propagator: str | Propagator,
    horizon: float | None,
    *,
    times: Sequence[float] | None = None,
    seed: int | None = None,
    samples: int | None = None,
    max_computation_time: float | None = None,
    keep_samples: int = 0,
    events: Iterable[Event] = (),
    modes: bool = False,
    joint_covariance: bool | None = None,
) -> Query:
    """Check the arguments of `Client.predict`.

    Raises
    ------
    UncPhysicsError
        A subclass that names the argument.
    """
    instance(scene, Scene, "scene")
    instance(belief, Belief, "belief")
    instance(propagator, (str, Propagator), "propagator")
    belief.check_fits(scene)
    if isinstance(propagator, str):
        propagator = make_propagator(propagator)
    elif seed is None:
        seed = getattr(propagator, "seed", None)
    own = {"seed": seed, "samples": samples}
    known = propagator.options()
    own = {name: value for name, value in own.items() if value is not None and name in known}
    propagator = replace(propagator, **own)
    check_supported(scene, propagator)
    if max_computation_time is not None:
        max_computation_time = positive(max_computation_time, "max_computation_time")
    regions, probabilities = split_events(checked_events(events, scene))
    joint = propagator.traits.cross_body if joint_covariance is None else bool(joint_covariance)
    return Query(
        scene=scene,
        belief=belief,
        propagator=propagator,
        marks=marks_of(scene, horizon, times),
        seed=None if seed is None else whole_number(seed, "seed", 64),
        max_computation_time=max_computation_time,
        keep_samples=whole_number(keep_samples, "keep_samples", 32),
        regions=regions,
        outputs=RequestedOutputs(not joint, joint, probabilities, bool(modes), center_of_mass=True),
    )


def split_events(events: Iterable[Event]) -> tuple[tuple[BoxRegion, ...], bool]:
    """Return the regions of events, and whether there are events without a region.

    Raises
    ------
    DuplicateIdError
        If two regions have the same name.
    NotSupportedError
        If an event has no message.
    """
    regions, others = {}, False
    for event in events:
        if isinstance(event, InRegion):
            region = regions.setdefault(event.region.name, event.region)
            if event != InRegion(event.object, region):
                raise DuplicateIdError("is the name of two regions", field="events", value=region.name)
        elif isinstance(event, Touches) or event in object_events(event.names):
            others = True
        else:
            message_of(event, "events")  # raises for a combined event, and for another limit than the default
            assert isinstance(event, FellOff)
            raise NotSupportedError(
                f"is not in a node's answer; ask for FellOff('{event.object}'), off what carried it, or rank"
                " actions by this event",
                field=f"support of '{event}'",
                value=event.support,
            )
    return tuple(regions.values()), others


def whole_number(value: int, field: str, bits: int) -> int:
    """Return an integer that fits in a message field of ``bits`` bits."""
    value = integer(value, field, low=0)
    if value >= 2**bits:
        raise LimitExceededError(f"must be below 2^{bits}", field=field, value=value)
    return value
