"""What every propagator is: a carry that holds its persistent state, and three functions on it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, fields
from typing import Any, ClassVar

import numpy as np

from ..checks.errors import InvalidOptionError, LimitExceededError
from ..checks.validation import integer
from ..physics import contact_history as histories
from ..physics.rollout import rollout
from ..scene.belief import Belief
from ..scene.parameters import rollout_varied
from ..scene.scene import Scene

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


@dataclass(frozen=True)
class Propagator(ABC):
    """Carries a belief through a scene's dynamics.

    Class attributes: ``name``; ``traits``; ``varies_parameters``, whether uncertain parameters of the scene
    count; ``integrators``, those that it runs on.

    A concrete propagator is a frozen dataclass whose fields are its options, checked when it is made. Its carry
    is a NamedTuple of exactly the persistent state, so that advancing in pieces equals advancing at once.
    """

    name: ClassVar[str]
    traits: ClassVar[Traits]
    varies_parameters: ClassVar[bool] = False
    integrators: ClassVar[tuple[str, ...]] = ("explicit",)

    @abstractmethod
    def init(self, scene: Scene, belief: Belief) -> Any:
        """The carry that stands for ``belief`` at time 0."""

    @abstractmethod
    def advance(self, carry: Any, scene: Scene, steps: int) -> Any:
        """The carry after ``steps`` time steps; the given one stays as it is."""

    @abstractmethod
    def belief(self, carry: Any, scene: Scene) -> Belief:
        """The belief that the carry stands for."""

    def own_samples(self, carry: Any, scene: Scene) -> np.ndarray | None:
        """(N, B, 13): the states that the answer consists of; None where it is a Gaussian."""
        return None

    @classmethod
    def options(cls) -> dict[str, Any]:
        """Names and defaults of the options."""
        return {field.name: field.default for field in fields(cls)}

    def _check_count(self, option: str, low: int = 1, high: int = SAMPLES_LIMIT) -> None:
        value = integer(getattr(self, option), option, low=low, error=InvalidOptionError)
        if value > high:
            raise LimitExceededError(f"must be at most {high}", field=option, value=value)


def rolled(carry, scene, steps):
    """The carry of states that run through the full simulator, ``steps`` time steps on."""
    states, history = carry.states.copy(), histories.copy(carry.contact_history)
    if scene.uncertain:
        rollout_varied(states, history, scene, carry.parameters, carry.step, steps)
    else:
        rollout(states, history, scene.world, carry.step, steps)
    return carry._replace(states=states, contact_history=history, step=carry.step + steps)


def symmetric_root(P: np.ndarray) -> np.ndarray:
    """Symmetric square roots of covariances (..., n, n) (Eq. 12); round-off below zero counts as zero."""
    if np.count_nonzero(P) == np.count_nonzero(np.diagonal(P, axis1=-2, axis2=-1)):  # no need to look for eigenvectors
        return np.sqrt(np.maximum(P, 0.0))
    values, vectors = np.linalg.eigh(P)
    return (vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :]) @ np.swapaxes(vectors, -1, -2)
