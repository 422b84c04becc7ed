"""State of a tracker at one time, and what does not change from one measurement to the next."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..propagators.monte_carlo import MonteCarlo
from ..propagators.rollouts import RolloutCarry
from ..scene.scene import Scene
from .ensemble import Gates
from .hypotheses import Track
from .noise import ContactNoise
from .symmetry import NONE, Symmetry

#: Longest simulated time between additions of contact noise [s].
_PIECE = 1.0 / 30.0


def go_on() -> None:
    """Interrupt nothing."""


class State(NamedTuple):
    """Immutable state of a tracker at one time.

    Attributes
    ----------
    carry : RolloutCarry
        The members.
    contact_share : (B,) array
        Share of the members in which each body was recently in contact.
    tracks : tuple of Track
        Of the moving bodies.
    tied : (M, M) bool array
        Which moving bodies were correlated at the start.
    """

    carry: RolloutCarry
    contact_share: np.ndarray
    tracks: tuple[Track, ...]
    tied: np.ndarray


@dataclass(frozen=True, eq=False)
class TrackedScene:
    """Simulated scene of a tracker, and options of its members and corrections.

    Attributes
    ----------
    scene : Scene
    symmetries : mapping of str to Symmetry
        Of bodies, by their names.
    propagator : MonteCarlo
        Its samples are the members.
    noise : ContactNoise
    gates : Gates
    origin : float
        Time of step 0, on the clock of the measurements [s].
    interrupt : callable
        Called between pieces of the simulation; an exception from it ends them.
    """

    scene: Scene
    symmetries: Mapping[str, Symmetry]
    propagator: MonteCarlo
    noise: ContactNoise
    gates: Gates
    origin: float
    interrupt: Callable[[], object] = go_on

    @cached_property
    def piece(self) -> int:
        """Number of steps between additions of contact noise."""
        return max(1, math.floor(_PIECE / self.scene.dt + 1e-6))

    @cached_property
    def names(self) -> list[str]:
        """Names of the bodies."""
        return [body.name for body in self.scene.bodies]

    def step(self, time: float) -> int:
        """Return the number of the step that is nearest to a time [s]."""
        return round((time - self.origin) / self.scene.dt)

    def delay(self, state: State, time: float) -> float:
        """Return the time since the last step of the members [s]."""
        return time - self.origin - state.carry.step * self.scene.dt

    def symmetry(self, body: int) -> Symmetry:
        """Return the symmetry of a body."""
        return self.symmetries.get(self.names[body], NONE)
