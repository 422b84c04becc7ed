"""Snapshot of a prediction at one time: the belief, rollouts, first contacts, and modes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, NoReturn

import numpy as np

from ..checks.errors import InvalidRequestError
from ..propagators.modes import Mode, only_mode, split
from ..propagators.point_pairs import opposite_points
from ..scene.belief import Belief
from ..scene.origins import gaussian_at_origins, points_at_origins, states_at_origins
from ..scene.scene import Scene


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
    method : {'samples', 'gaussian', 'certain'}
        ``samples``: share of rollouts, which `predict` simulates for events where the propagator has none.
        ``gaussian``: share of states drawn from the belief, or of the propagator's rollouts for contacts.
        After a contact this is not a probability, so that the interval is 0 to 1. ``certain``: there is only
        one outcome.
    rollouts : int
        Number of simulated rollouts behind the estimate.
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


class Counted(NamedTuple):
    """R rollouts up to one time, in which events are counted."""

    states: np.ndarray  # (R, B, 13)
    first_contacts: np.ndarray  # (R, B, B + E), as in `Snapshot`
    effective: Callable[[np.ndarray], np.ndarray]  # as in `Snapshot`


@dataclass(eq=False)
class _Derived:
    """Results of a snapshot that were computed when they were first asked for."""

    samples: np.ndarray | None = None
    at_origins: dict[bool, Belief] = field(default_factory=dict)  # by whether they are joint
    modes: dict[int, tuple[Mode, ...]] = field(default_factory=dict)  # by body


@dataclass(frozen=True, eq=False)
class Snapshot:
    """Prediction at one time.

    Attributes
    ----------
    time : float
        Simulated time from the start [s].
    belief : Belief
    carry : NamedTuple or None
        The propagator's persistent state, of all bodies.
    rollout_states : (R, B, 13) array or None
        States of the rollouts behind `samples`; None where the answer is a Gaussian.
    drawn : callable, optional
        Draws the samples where they are not the rollouts, from the response surface of the rollouts, which
        may take longer than the prediction.
    points : (2 n + 1, B, 13) array or None
        States of pairs of points, as `PointPairs.point_states`.
    first_contacts : (R, B, B + E) array or None
        When bodies i < j, or body i and element j - B, first touched in each rollout, up to this time [s];
        infinite without contact.
    effective : callable or None
        Takes in which rollouts events happen (E, R), and returns how many independent rollouts would give
        shares as accurate (E,); None for R.
    counted : Counted or None
        Rollouts in which events are counted instead, where the propagator has no samples and `predict` was
        asked for events.
    wide : (R, B, 13) array or None
        States of rollouts of a belief that is twice as wide, where the propagator looked for rare outcomes.
    """

    time: float
    belief: Belief
    carry: Any = None
    rollout_states: np.ndarray | None = None
    drawn: Callable[[], np.ndarray] | None = None
    points: np.ndarray | None = None
    first_contacts: np.ndarray | None = None
    effective: Callable[[np.ndarray], np.ndarray] | None = None
    counted: Counted | None = None
    wide: np.ndarray | None = None
    _derived: _Derived = field(default_factory=_Derived, init=False, repr=False)

    def __getitem__(self, key: object) -> NoReturn:
        raise InvalidRequestError(
            f"is no entry of a Snapshot; a body at a time is prediction.body(name, time={self.time:g})",
            field="key",
            value=key,
        )

    @property
    def samples(self) -> np.ndarray | None:
        """(N, B, 13): equally probable states of the answer, as in `Belief.mean`; None for a Gaussian."""
        if self.drawn is None:
            return self.rollout_states
        if self._derived.samples is None:
            self._derived.samples = self.drawn()
        return self._derived.samples

    def at_time(self, time: float) -> Snapshot:
        """Return the same snapshot at another time [s]; both share what is computed from their data."""
        other = replace(self, time=time)
        object.__setattr__(other, "_derived", self._derived)
        return other

    def at_model_origins(self, scene: Scene, joint: bool = False) -> Belief:
        """Return the moments at the models' own origins instead of the centres of mass.

        They are computed from rollouts or points if there are some, and otherwise from the Gaussian.
        With ``joint`` they include the covariances between bodies.
        """
        known = self._derived.at_origins
        if joint not in known:
            belief = self.belief
            if not joint:
                belief = Belief.trusted(belief.mean, belief.blocks, belief.moving)
            origins = np.array([body.model.origin for body in scene.bodies])
            if self.rollout_states is not None:
                found = states_at_origins(belief, self.rollout_states, origins)
            elif self.points is not None:
                one, other = opposite_points(self.points, scene.moving)
                found = points_at_origins(belief, self.points, 0.5 * (one - other), origins)
            else:
                found = gaussian_at_origins(belief, origins)
            known[joint] = found
        return known[joint]

    def modes(self, scene: Scene, body: int) -> tuple[Mode, ...]:
        """Return the outcomes of a body, by its index, the most probable first.

        A single Gaussian if there are no samples, or the body does not move freely.
        """
        if self.rollout_states is None or not scene.bodies[body].free:
            return (only_mode(self.belief, body),)
        known = self._derived.modes
        if body not in known:
            found = split(self.rollout_states[:, body], scene.bodies[body].model.bounding_radius)
            known[body] = found if len(found) > 1 else (only_mode(self.belief, body),)
        return known[body]
