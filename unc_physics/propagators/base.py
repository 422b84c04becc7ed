"""What every propagator is: a carry with its persistent state, and what other modules need to know of it.

``docs/extending.md`` walks through one.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, ClassVar, NamedTuple

import numpy as np

from ..checks.errors import NotSupportedError
from ..physics import contact_history as histories
from ..physics.contact_history import ContactHistory
from ..physics.rollout import rollout
from ..scene.belief import Belief
from ..scene.parameters import rollout_varied
from ..scene.scene import Scene
from .free_flight import Flight
from .joining import Frame, Part
from .modes import split
from .options import Option

SAMPLES_LIMIT = 10_000_000


@dataclass(frozen=True)
class Traits:
    """A propagator's row in the paper's Table 1.

    Attributes
    ----------
    mean_update : str
        ``nominal`` (one rollout of the mean) or ``estimated`` (from points or samples).
    uncertainty : str
        What represents it.
    cross_body : bool
        Whether correlations between bodies are kept.
    separate_collisions : bool
        Whether integration and collisions change the uncertainty in separate ways.
    collisions : str
        How collisions are treated.
    """

    mean_update: str
    uncertainty: str
    cross_body: bool
    separate_collisions: bool
    collisions: str


class Errors(NamedTuple):
    """How far each body's mean may be off: standard errors, all axes together.

    Attributes
    ----------
    position, rotation : (B,) array
        [m], [rad].
    relative : (B,) array
        The larger of both, over the standard deviation; as if rotations did not wrap around.
    """

    position: np.ndarray
    rotation: np.ndarray
    relative: np.ndarray


class Spent(NamedTuple):
    """What a prediction that may grow has taken, and what is still to come.

    Attributes
    ----------
    time : float
        Wall time since it began [s].
    rollouts : float
        What its rollouts took of that [s].
    answers : int
        At how many times a belief is to be made of them.
    """

    time: float
    rollouts: float
    answers: int


class Mode(NamedTuple):
    """One of the outcomes that a body's state splits into.

    Attributes
    ----------
    weight : float
        Its probability.
    mean : (13,) array
        State ``[p, v, q, omega]``, as in `Belief`.
    covariance : (12, 12) array
        Of the error state about it, as in `Belief`.
    """

    weight: float
    mean: np.ndarray
    covariance: np.ndarray


@dataclass(frozen=True)
class Propagator(ABC):
    """Carries a belief through a scene's dynamics.

    A concrete propagator is a frozen dataclass whose fields are its options, each made by `options.option`
    and checked when the propagator is made (a ``__post_init__`` of its own calls this one's); ``samples`` and
    ``seed`` are also what command line and messages call by these names. Its carry is a NamedTuple of exactly
    the persistent state, so that advancing in pieces equals advancing at once. The first line of its
    docstring says what it is.

    Attributes
    ----------
    name : str
        By which it is asked for.
    traits : Traits
    label : str
        What people read; by default the name with spaces.
    color, marker : str
        Of its lines and points in figures, as Matplotlib has them.
    integrators : tuple of str
        Those of `Scene` that it runs on.
    varies_parameters : bool
        Whether uncertain parameters of the scene count.
    varied : tuple of str
        Names of those that count although others do not.
    takes_actions : tuple of str
        Integrators on which bodies may be prescribed, held or pushed, and surfaces may move (``Scene.acts``).
    draws_impacts : bool
        Whether it draws the errors of impacts (``Scene.draws_impacts``).
    rejects_overlap : bool
        Whether it can leave out the share of a belief in which bodies overlap (``Scene.overlap``
        ``'reject'``).
    draws_together : bool
        Whether the spread of all bodies is drawn together, so that islands take their parts of it (`part`).
    flies : bool
        Whether a body that nothing can reach may go many steps at once (`fly`).
    points_in_pairs : bool
        Whether its state is points in opposite pairs (`opposite_points`).
    emits : bool
        Whether its own samples are made of fewer rollouts (`rollout_states`).
    grows : bool
        Whether rollouts are added until the answer is sure enough (`further`, `begun`, `together`).
    """

    name: ClassVar[str]
    traits: ClassVar[Traits]
    label: ClassVar[str]
    color: ClassVar[str] = "#A6761D"
    marker: ClassVar[str] = "p"
    integrators: ClassVar[tuple[str, ...]] = ("explicit",)
    varies_parameters: ClassVar[bool] = False
    varied: ClassVar[tuple[str, ...]] = ()
    takes_actions: ClassVar[tuple[str, ...]] = ()
    draws_impacts: ClassVar[bool] = False
    rejects_overlap: ClassVar[bool] = False
    draws_together: ClassVar[bool] = False
    flies: ClassVar[bool] = False
    points_in_pairs: ClassVar[bool] = False
    emits: ClassVar[bool] = False
    grows: ClassVar[bool] = False

    def __init_subclass__(cls, **keywords):
        super().__init_subclass__(**keywords)
        if "label" not in vars(cls) and "name" in vars(cls):
            cls.label = cls.name.replace("_", " ")

    def __post_init__(self):
        for option in self.described_options():
            object.__setattr__(self, option.name, option.checked(getattr(self, option.name)))

    @abstractmethod
    def init(self, scene: Scene, belief: Belief) -> Any:
        """The carry that stands for ``belief`` at time 0."""

    @abstractmethod
    def advance(self, carry: Any, scene: Scene, steps: int) -> Any:
        """The carry after ``steps`` time steps; the given one stays as it is."""

    @abstractmethod
    def belief(self, carry: Any, scene: Scene) -> Belief:
        """The belief that the carry stands for."""

    @abstractmethod
    def join(self, carries: Sequence[Any], parts: Sequence[Part], frame: Frame) -> Any:
        """One carry for the bodies of several islands, which are independent of each other until now.

        Parameters
        ----------
        carries : sequence
            Of the islands, after as many steps each.
        parts : sequence of Part
            Where each island's bodies are among the joint ones (`joining.joined_means`,
            `joining.joined_history`).
        frame : Frame
            The joint bodies.
        """

    def contact_history(self, carry: Any) -> ContactHistory:
        """What its N rollouts remember of their contacts: those of `own_samples`, where it has as many.

        By default the carry's field of that name.
        """
        return carry.contact_history

    def rollouts(self, carry: Any) -> int:
        """How many rollouts an answer consists of; by default as many as its contact history knows of."""
        return len(self.contact_history(carry).first_time)

    def rollouts_for(self, scene: Scene, belief: Belief) -> int:
        """How many rollouts a prediction takes, at most; by default those of `own_sample_count`, or one."""
        return self.own_sample_count or 1

    def own_samples(self, carry: Any, scene: Scene) -> np.ndarray | None:
        """(N, B, 13): the states that the answer consists of; None where it is a Gaussian."""
        return None

    @property
    def own_sample_count(self) -> int | None:
        """How many `own_samples` an answer has; None where it is a Gaussian."""
        return None

    def rollout_states(self, carry: Any, scene: Scene) -> np.ndarray | None:
        """(N, B, 13): the states that were simulated, which islands keep apart; None where those of a
        Gaussian are.

        By default the `own_samples`.
        """
        return self.own_samples(carry, scene)

    def standard_errors(self, carry: Any, scene: Scene) -> Errors | None:
        """How far each body's mean may be off; None where the propagator does not know."""
        return None

    def measures(self, carry: Any, scene: Scene) -> dict[str, np.ndarray]:
        """What the propagator itself knows of its answer's quality: values (B,) by the names in
        `prediction.status_rules.RULES`.
        """
        return {}

    def modes(self, carry: Any, scene: Scene, body: int) -> tuple[Mode, ...]:
        """What one body's state splits into, most probable first.

        By default as its `own_samples` do; a single Gaussian where there are none.
        """
        states = self.own_samples(carry, scene)
        if states is not None and scene.bodies[body].free:
            found = split(states[:, body], self.rollouts(carry), scene.bodies[body].model.bounding_radius)
            return tuple(Mode(*mode) for mode in found)
        belief = self.belief(carry, scene)
        return (Mode(1.0, belief.mean[body].copy(), belief.marginal(body).copy()),)

    def further(self, carry: Any, scene: Scene, spent: Spent) -> int:
        """How many rollouts more the answer is to rest on; for those that grow."""
        return 0

    def begun(self, scene: Scene, belief: Belief, first: int, last: int) -> Any:
        """The carry at time 0 of some of the rollouts, from the ``first`` to before the ``last``."""
        raise NotSupportedError(f"has no part in {self.name}", field="rollouts")

    def together(self, carry: Any, further: Any) -> Any:
        """One carry of some rollouts and those that follow them, after as many steps."""
        raise NotSupportedError(f"has no part in {self.name}", field="rollouts")

    def some(self, carry: Any, rollouts: slice) -> Any:
        """The carry of some of its rollouts, for those that have `begun` and `together`; it may share
        arrays.
        """
        raise NotSupportedError(f"has no part in {self.name}", field="rollouts")

    @property
    def compared_with_rollouts(self) -> bool:
        """Whether a status has to compare its spread with that of rollouts.

        By default where that rests on a single nominal one, or on points in pairs.
        """
        return self.traits.mean_update == "nominal" or self.points_in_pairs

    def directions(self, initial: Belief) -> np.ndarray | None:
        """(M,): number of directions in which each moving body's points are spread; None without points."""
        return None

    def opposite_points(self, carry: Any, scene: Scene) -> tuple[np.ndarray, np.ndarray]:
        """Errors (n, M, 12) of points about a middle one, and those of the points opposite to them."""
        raise NotSupportedError(f"have no opposites by {self.name}", field="points")

    def doubtful_since(self, carry: Any) -> np.ndarray | None:
        """(B,): when contacts of each body first would have done something else within a standard deviation
        [s], infinite if never; None where that does not matter.
        """
        return None

    def part(self, carry: Any, bodies: np.ndarray, parameters: Sequence[int]) -> Any:
        """An island's carry, from that of all bodies; for those that draw together.

        Parameters
        ----------
        carry : NamedTuple
        bodies : (b,) int array
            The island's, ascending.
        parameters : sequence of int
            Which of the scene's uncertain parameters are about them.
        """
        raise NotSupportedError(f"have no part in what {self.name} draws for all bodies", field="islands")

    def fly(self, carry: Any, flight: Flight) -> Any:
        """The carry of a single body after a free flight; for those that fly."""
        raise NotSupportedError(f"have no closed form of a free flight by {self.name}", field="islands")

    @classmethod
    def described_options(cls) -> tuple[Option, ...]:
        """The options, with their types, limits and meaning."""
        return tuple(Option.of(member) for member in fields(cls) if "description" in member.metadata)

    @classmethod
    def options(cls) -> dict[str, Any]:
        """Names and defaults of the options."""
        return {option.name: option.default for option in cls.described_options()}

    @classmethod
    def description(cls) -> str:
        """What it is, in a sentence: its docstring's first line."""
        return (cls.__doc__ or "").strip().splitlines()[0]


def rolled(carry, scene, steps):
    """The carry of states that run through the full simulator, ``steps`` time steps on."""
    states, history = carry.states.copy(), histories.copy(carry.contact_history)
    if scene.uncertain:
        rollout_varied(states, history, scene, carry.parameters, carry.step, steps)
    else:
        rollout(states, history, scene.world, carry.step, steps)
    return carry._replace(states=states, contact_history=history, step=carry.step + steps)


def some_rollouts(carry, rollouts):
    """The carry of some of its rollouts, which shares their arrays."""
    return carry._replace(
        states=carry.states[rollouts],
        parameters=carry.parameters[rollouts],
        contact_history=histories.samples(carry.contact_history, rollouts),
    )


def one_after_the_other(carry, further):
    """The carry of some rollouts and of others of the same scene that follow them, after as many steps."""
    return carry._replace(
        states=np.concatenate([carry.states, further.states]),
        parameters=np.concatenate([carry.parameters, further.parameters]),
        contact_history=histories.stacked(carry.contact_history, further.contact_history),
    )


def symmetric_root(P: np.ndarray) -> np.ndarray:
    """Symmetric square roots of covariances (..., n, n) (Eq. 12); round-off below zero counts as zero."""
    if np.count_nonzero(P) == np.count_nonzero(
        np.diagonal(P, axis1=-2, axis2=-1)
    ):  # no need to look for eigenvectors
        return np.sqrt(np.maximum(P, 0.0))
    values, vectors = np.linalg.eigh(P)
    return (vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :]) @ np.swapaxes(vectors, -1, -2)
