"""What a prediction answers: beliefs at one or more times, and each body by its name."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ..checks.validation import integer
from ..physics.contact_history import ContactHistory
from ..propagators.base import Propagator
from ..scene.belief import Belief
from ..scene.scene import Scene
from .answers import Answers

if TYPE_CHECKING:
    from .predicted_body import PredictedBody, Trajectory

#: The point whose position and velocity are told.
Origin = Literal["center_of_mass", "model"]


@dataclass(frozen=True, eq=False)
class Prediction:
    """Beliefs at one or more times.

    Attributes
    ----------
    scene : Scene
        As it was simulated, with the stiffness that was chosen for it.
    propagator : Propagator
    times : tuple of float
        Simulated time of each belief from the start [s], ascending; the last is the horizon.
    beliefs : tuple of Belief
    wall_time : float
        What the prediction took, the time to compile or load kernels left out [s].
    initial : Belief
        What was given.
    answers : Answers
        What tells everything else.
    kept : tuple of (n, B, 13) arrays, or None
        States at each of the times, of a propagator with samples of its own; None where none were to be kept.
    """

    scene: Scene
    propagator: Propagator
    times: tuple[float, ...]
    beliefs: tuple[Belief, ...]
    wall_time: float
    initial: Belief
    answers: Answers
    kept: tuple[np.ndarray, ...] | None = None

    @cached_property
    def start(self) -> Belief:
        """The belief at time 0 that was really used: without overlap, and at rest where bodies are said to
        be.

        Of points or samples it has the moments; where none was moved, it is what was given.
        """
        return self.answers.start(self)

    def __getitem__(self, name: str) -> PredictedBody:
        """The body of that name at the horizon, as `body` gives it."""
        return self.body(name)

    def body(
        self, name: str, *, time: float | None = None, origin: Origin = "center_of_mass"
    ) -> PredictedBody:
        """What is predicted of one body.

        Parameters
        ----------
        name : str
        time : float, optional
            One of the prediction's times [s]; by default the last, the horizon.
        origin : {'center_of_mass', 'model'}
            The point whose position and velocity are told: that of beliefs and scene files, or the model's
            own origin, as in messages.

        Raises
        ------
        InvalidRequestError
            If there is no such body, or nothing was predicted for that time.
        InvalidOptionError
            If there is no such origin.
        """
        from .predicted_body import PredictedBody

        return PredictedBody(self, name, self.times[-1] if time is None else time, origin)

    @property
    def bodies(self) -> tuple[PredictedBody, ...]:
        """All bodies at the horizon, in the scene's order."""
        return tuple(self.body(body.name) for body in self.scene.bodies)

    def trajectory(self, name: str, *, origin: Origin = "center_of_mass") -> Trajectory:
        """One body at all of the prediction's times, as arrays; the arguments are those of `body`."""
        from .predicted_body import Trajectory

        return Trajectory.of([self.body(name, time=time, origin=origin) for time in self.times])

    @property
    def belief(self) -> Belief:
        """The last belief."""
        return self.beliefs[-1]

    @property
    def time(self) -> float:
        """Simulated time of the last belief [s]."""
        return self.times[-1]

    @property
    def carry(self) -> Any:
        """The propagator's persistent state at the end, a NamedTuple."""
        return self.answers.carry

    @property
    def contact_history(self) -> ContactHistory:
        """What the propagator's rollouts remember of their contacts."""
        return self.propagator.contact_history(self.carry)

    @property
    def seed(self) -> int | None:
        """The seed that was used; None for a propagator that draws nothing."""
        return getattr(self.propagator, "seed", None)

    def samples(self, count: int | None = None) -> np.ndarray:
        """States at the horizon that are drawn from the answer, the same at each call.

        Parameters
        ----------
        count : int, optional
            How many; the first ones of a larger number. A propagator that has samples gives its own, by
            default all of them; otherwise the last belief is drawn from, with the prediction's seed or 0.

        Returns
        -------
        (count, B, 13) array
            As in `Belief.mean`; a fixed body's are all alike.

        Raises
        ------
        InvalidRequestError
            If ``count`` is no number of samples, or is needed and not given.
        LimitExceededError
            If the propagator has samples of its own, and fewer.
        """
        if count is not None:
            count = integer(count, "count", low=1)
        return self.answers.samples(self, count)
