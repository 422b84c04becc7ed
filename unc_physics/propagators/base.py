"""Interface of propagators: the methods that all have, and optional capabilities.

A propagator has options, `Propagator.init`, `Propagator.advance` and `Propagator.belief`. The classes below
it are capabilities: a propagator that inherits one has its methods, and callers ask
``isinstance(propagator, Anytime)``. ``docs/extending.md`` walks through an example.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np

from ..physics import contact_history as histories
from ..scene.belief import Belief
from ..scene.marks import Mark
from ..scene.physics_keys import INTEGRATORS
from ..scene.scene import Scene
from .options import Option

SAMPLES_LIMIT = 10_000_000


@dataclass(frozen=True)
class Traits:
    """A propagator's row in the paper's Table 1."""

    mean_update: str  # ``nominal`` (one rollout of the mean) or ``estimated`` (from points or samples)
    uncertainty: str  # what represents it
    cross_body: bool  # whether correlations between bodies are kept
    separate_collisions: bool  # whether integration and collisions change the uncertainty in separate ways
    collisions: str  # how collisions are treated


@dataclass(frozen=True)
class Supports:
    """The parts of a scene that a propagator supports beyond bodies, surfaces and uncertain states."""

    parameters: tuple[str, ...] = ()  # names of the uncertain parameters (`scene.UNCERTAIN_PARAMETERS`)
    #: integrators on which bodies may be prescribed, held or pushed, and surfaces may move (``Scene.acts``)
    actions: tuple[str, ...] = ()
    parameters_on: tuple[str, ...] = INTEGRATORS  # integrators on which these parameters may be uncertain
    impact_errors: bool = False  # whether each impact may have a random error (``Scene.draws_impacts``)
    #: whether states in which bodies overlap can be left out (``Scene.overlap`` ``'reject'``)
    overlap_rejection: bool = False


@dataclass(frozen=True)
class Propagator(ABC):
    """Carries a belief through a scene's dynamics.

    A concrete propagator is a frozen dataclass. Its fields are its options, each made by `options.option`
    and checked when the propagator is made. Command line and messages set options called ``samples`` and
    ``seed`` by these names. The first line of the docstring is the description that users read.

    A carry is a NamedTuple of exactly the persistent state, so that advancing in pieces equals advancing at
    once. It has the fields ``contact_history`` (`physics.contact_history.ContactHistory`, of its rollouts)
    and ``step`` (the number of steps done).

    Attributes
    ----------
    name : str
        Name in the registry, on the command line and in requests.
    traits : Traits
    integrators : tuple of str
        Supported values of ``Scene.integrator``.
    supports : Supports
    adds_energy : bool
        Whether something besides the scene moves its rollouts.
    """

    name: ClassVar[str]
    traits: ClassVar[Traits]
    integrators: ClassVar[tuple[str, ...]] = ("explicit",)
    supports: ClassVar[Supports] = Supports()
    adds_energy: ClassVar[bool] = False

    def __post_init__(self):
        for option in self.described_options():
            object.__setattr__(self, option.name, option.checked(getattr(self, option.name)))

    @abstractmethod
    def init(self, scene: Scene, belief: Belief) -> Any:
        """Return the carry that represents ``belief`` at time 0."""

    @abstractmethod
    def advance(self, carry: Any, scene: Scene, steps: int) -> Any:
        """Return the carry after ``steps`` time steps; the given one stays as it is.

        For a time between two steps it is called for one step with `Scene.with_short_step`. The returned
        carry is not advanced further, and its ``step`` becomes a fraction.
        """

    def advance_through(self, carry: Any, scene: Scene, marks: Sequence[Mark]) -> list[Any]:
        """Return the carry at each of several marks, ascending; the given one stays as it is.

        Carries at marks between two steps are not advanced further.
        """
        found = []
        for mark in marks:
            if mark.steps > carry.step:
                carry = self.advance(carry, scene, mark.steps - carry.step)
            at = carry
            if mark.rest > 0.0:
                at = self.advance(carry, scene.with_short_step(mark.steps, mark.rest), 1)
                at = at._replace(step=mark.fraction_of(scene.dt))
            found.append(at)
        return found

    @abstractmethod
    def belief(self, carry: Any, scene: Scene) -> Belief:
        """Return the belief that the carry represents."""

    def most_rollouts(self, scene: Scene, belief: Belief) -> int:
        """Return an upper bound of the number of rollouts that a carry holds; `Samples` have their own."""
        return 1

    @classmethod
    def described_options(cls) -> tuple[Option, ...]:
        """Return the options, with their types, limits and meaning."""
        found = ((one.name, one.metadata.get("option")) for one in fields(cls))
        return tuple(replace(option, name=name) for name, option in found if option is not None)

    @classmethod
    def options(cls) -> dict[str, Any]:
        """Return names and defaults of the options."""
        return {option.name: option.default for option in cls.described_options()}

    @classmethod
    def description(cls) -> str:
        """Return the first line of the docstring."""
        return (cls.__doc__ or "").strip().splitlines()[0]


class StandardErrors(NamedTuple):
    """Standard errors of each body's mean and standard deviation, all axes together.

    Those over the standard deviation take rotations as if they did not wrap around. They ignore how far a
    body of revolution turns about its axis, as this has no consequences.
    """

    #: position, rotation: (B,): of the mean [m], [rad]
    position: np.ndarray
    rotation: np.ndarray
    #: (B,): the larger of both, over the standard deviation, or over the accuracy of contacts if larger
    relative: np.ndarray
    #: position_spread, rotation_spread: (B,): of the standard deviation, over it
    position_spread: np.ndarray
    rotation_spread: np.ndarray

    @property
    def spread(self) -> np.ndarray:
        """(B,): the larger of `position_spread` and `rotation_spread`."""
        return np.maximum(self.position_spread, self.rotation_spread)


class Samples(ABC):
    """Capability: the answer consists of equally probable states."""

    resamples: ClassVar[bool] = False  # whether `own_samples` are made of fewer rollouts
    #: whether the belief at time 0 has the moments of random draws, and not those of the given belief
    random_moments: ClassVar[bool] = False
    joint_when_used: ClassVar[bool] = False  # whether beliefs are `Belief.of_errors`

    @property
    @abstractmethod
    def own_sample_count(self) -> int:
        """Number N of `own_samples`."""

    @abstractmethod
    def own_samples(self, carry: Any, scene: Scene) -> np.ndarray:
        """Return the states (N, B, 13) that the answer consists of."""

    def rollout_states(self, carry: Any, scene: Scene) -> np.ndarray:
        """Return the simulated states (R, B, 13); by default `own_samples`."""
        return self.own_samples(carry, scene)

    def share_caches(self, carries: Sequence[Any]) -> None:
        """Let carries of one prediction, in ascending order of time, share cached results.

        The last carry is evaluated first.
        """

    def effective_counts(self, carry: Any, happened: np.ndarray) -> np.ndarray:
        """Return how many independent rollouts would give shares as accurate as these, (E,).

        ``happened`` (E, R) is whether each of E events happens in each of the simulated rollouts.
        """
        return np.full(len(happened), float(happened.shape[1]))

    def standard_errors(self, carry: Any, scene: Scene) -> StandardErrors | None:
        """Return the standard errors of means and spreads; None where there is no estimate."""
        return None

    def measures(self, carry: Any, scene: Scene) -> dict[str, np.ndarray]:
        """Return measures (B,) of the answer's quality, by their names in `prediction.diagnostics.RULES`."""
        return {}


class Rollouts(ABC):
    """Capability: the carry is a set of rollouts that can be simulated in portions.

    The methods with a body are for carries with ``states`` (N, B, 13), ``parameters`` (N, K) and a contact
    history.
    """

    @abstractmethod
    def init_rollouts(self, scene: Scene, belief: Belief, first: int, last: int) -> Any:
        """Return the carry at time 0 of the rollouts from the ``first`` to before the ``last``."""

    def concatenate(self, carry: Any, additional: Any) -> Any:
        """Return one carry of some rollouts and those that follow them, after equally many steps."""
        return carry._replace(
            states=np.concatenate([carry.states, additional.states]),
            parameters=np.concatenate([carry.parameters, additional.parameters]),
            contact_history=histories.stacked(carry.contact_history, additional.contact_history),
        )


class Spent(NamedTuple):
    """Time used by an anytime prediction, and measures of its present accuracy."""

    time: float  # wall time since it began [s]
    rollouts: float  # the share of its rollouts in that [s]
    answers: int  # number of times at which a belief is wanted
    #: (T E,): half widths of the confidence intervals of the requested probabilities at all times, over the
    #: quantile of the confidence level: about their standard errors
    probability_errors: np.ndarray
    #: largest factor by which rare outcomes may widen a body's spread; None if no search was made
    rare: float | None = None


class Anytime(Rollouts):
    """Capability: rollouts are added until the answer is accurate enough, or time is up."""

    @abstractmethod
    def additional_rollouts(self, carry: Any, scene: Scene, spent: Spent) -> int:
        """Return the number of rollouts to add; 0 ends the prediction."""

    def within(self, time: float) -> Any:
        """Return this propagator so that after a wall time [s] it adds no rollouts to its first ones."""
        return self

    def looks_far(self, carry: Any, scene: Scene) -> bool:
        """Return whether to search for rare outcomes before the prediction ends (`Spent.rare`)."""
        return False


class PointPairs(ABC):
    """Capability: the state is a middle point and pairs of points on opposite sides of it."""

    @abstractmethod
    def directions(self, initial: Belief) -> np.ndarray:
        """Return the number of directions (M,) in which each moving body's points are spread."""

    @abstractmethod
    def point_states(self, carry: Any, scene: Scene) -> np.ndarray:
        """Return the states (2 n + 1, B, 13) of the middle point, of n points, and of the opposite points."""


def rollout_count(carry: Any) -> int:
    """Return the number of rollouts that a carry consists of."""
    return len(carry.contact_history.first_time)
