"""Snapshot of a prediction at one time: the belief, rollouts, first contacts, and modes."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, NoReturn

import numpy as np

from ..checks.errors import InvalidRequestError, NotSupportedError
from ..propagators.base import PointPairs, Propagator
from ..propagators.modes import Mode, only_mode, split
from ..scene.belief import Belief
from ..scene.origins import gaussian_at_origins, points_at_origins, states_at_origins
from ..scene.scene import Scene
from .body_status import BodyStatus
from .events import Event
from .first_contacts import Flights


@dataclass(frozen=True)
class Probability:
    """Probability of an event with its interval.

    Attributes
    ----------
    estimate : float
        From 0 to 1.
    low, high : float
        Interval that holds the true probability of the model in all but one of a thousand answers; 0 and 1 if
        nothing is known.
    method : {'samples', 'flights', 'gaussian', 'certain', 'node'}
        ``samples``: share of the propagator's samples or rollouts. ``flights``: share of samples of the
        initial belief that fly until their first contacts; flights that do not decide the event count half.
        ``gaussian``: share of states drawn from the belief, or of the propagator's rollouts for contacts.
        After a contact this is not a probability, so that the interval is 0 to 1. ``certain``: there is only
        one outcome. ``node``: as received from a node.
    rollouts : int
        Number of simulated rollouts or flights behind the estimate.
    """

    estimate: float
    low: float
    high: float
    method: str
    rollouts: int


class ContactTime(NamedTuple):
    """Time of the first contact of two things, given that they touch.

    Attributes
    ----------
    mean, std : float
        Mean and standard deviation from the start [s]. A contact has the time of the end of its step, so it
        is up to one ``dt`` late.
    """

    mean: float
    std: float


class RemoteAnswers(NamedTuple):
    """Answers of a prediction that was made elsewhere."""

    statuses: tuple[BodyStatus, ...]  # one for each body
    modes: tuple[tuple[Mode, ...], ...] | None  # of each body; None where they were not asked for
    probabilities: Mapping[Event, Probability]  # of the events that were asked for
    contact_times: Mapping[Event, ContactTime]  # of those among them that are contacts
    at_origins: Belief | None = None  # at the models' own origins


@dataclass(frozen=True, eq=False)
class Snapshot:
    """Prediction at one time.

    Attributes
    ----------
    time : float
        Simulated time from the start [s].
    belief : Belief
    carry : NamedTuple or None
        The propagator's persistent state, of all bodies; None where the prediction was made elsewhere.
    draw : callable or None
        Makes `samples`; None where the answer is a Gaussian.
    draw_rollouts : callable or None
        Makes `rollout_states`.
    first_contacts : (R, B, B + E) array or None
        When bodies i < j, or body i and element j - B, first touched in each rollout, up to this time [s];
        infinite without contact.
    flights : Flights or None
        Samples of the initial belief up to their first contacts, where `predict` was asked for events that
        need them.
    received : RemoteAnswers or None
        Answers of a prediction that was made elsewhere.
    wide : (R, B, 13) array or None
        States of rollouts of a belief that is twice as wide, where the propagator looked for rare outcomes.
    """

    time: float
    belief: Belief
    carry: Any = None
    draw: Callable[[], np.ndarray] | None = None
    draw_rollouts: Callable[[], np.ndarray] | None = None
    first_contacts: np.ndarray | None = None
    flights: Flights | None = None
    received: RemoteAnswers | None = None
    wide: np.ndarray | None = None

    def __getitem__(self, key: object) -> NoReturn:
        raise InvalidRequestError(
            f"is no entry of a Snapshot; a body at a time is prediction.body(name, time={self.time:g})",
            field="key",
            value=key,
        )

    @cached_property
    def samples(self) -> np.ndarray | None:
        """(N, B, 13): equally probable states of the answer, as in `Belief.mean`."""
        return None if self.draw is None else self.draw()

    @cached_property
    def rollout_states(self) -> np.ndarray | None:
        """(R, B, 13): states of the rollouts behind `samples`; None without samples."""
        return None if self.draw_rollouts is None else self.draw_rollouts()

    def at_time(self, time: float) -> Snapshot:
        """Return the same snapshot at another time [s]; both share what is computed from the carry."""
        self.__dict__.setdefault("at_origins", {})
        self.__dict__.setdefault("split", {})
        other = copy.copy(self)
        other.__dict__["time"] = time
        return other

    def at_model_origins(self, scene: Scene, propagator: Propagator, joint: bool = False) -> Belief:
        """Return the moments at the models' own origins instead of the centres of mass.

        They are computed from rollouts or points if the propagator has some, and otherwise from the Gaussian.
        With ``joint`` they include the covariances between bodies.
        """
        known = self.__dict__.setdefault("at_origins", {})
        if joint not in known:
            belief = self.belief
            if not joint:
                belief = Belief.trusted(belief.mean, belief.blocks, belief.moving)
            origins = np.array([body.model.origin for body in scene.bodies])
            if self.received is not None and self.received.at_origins is not None:
                found = self.received.at_origins
            elif self.rollout_states is not None:
                found = states_at_origins(belief, self.rollout_states, origins)
            elif isinstance(propagator, PointPairs) and self.carry is not None:
                points = propagator.point_states(self.carry, scene)
                one, other = propagator.opposite_points(self.carry, scene)
                found = points_at_origins(belief, points, 0.5 * (one - other), origins)
            else:
                found = gaussian_at_origins(belief, origins)
            known[joint] = found
        return known[joint]

    def modes(self, scene: Scene, body: int) -> tuple[Mode, ...]:
        """Return the outcomes of a body, by its index, the most probable first.

        A single Gaussian if there are no samples, or the body does not move freely.
        """
        if self.received is not None:
            if self.received.modes is None:
                raise NotSupportedError(
                    "was not asked for; with modes=True the client's predict has those at the horizon",
                    field="modes",
                )
            return self.received.modes[body]
        if self.rollout_states is None or not scene.bodies[body].free:
            return (only_mode(self.belief, body),)
        known = self.__dict__.setdefault("split", {})
        if body not in known:
            found = split(self.rollout_states[:, body], scene.bodies[body].model.bounding_radius)
            known[body] = found if len(found) > 1 else (only_mode(self.belief, body),)
        return known[body]
