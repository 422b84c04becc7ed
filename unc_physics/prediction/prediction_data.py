"""Data of a prediction: the scene, the snapshots, and what they began with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..checks.errors import InvalidRequestError, LimitExceededError
from ..checks.validation import integer, number
from ..physics.contact_history import ContactHistory
from ..propagators.base import Propagator
from ..scene.belief import Belief
from ..scene.marks import RESOLUTION
from ..scene.scene import Scene
from .simulated_scene import left_out
from .snapshot import Snapshot


@dataclass(frozen=True, eq=False)
class PredictionData:
    """Data of a `prediction.Prediction`, which documents the attributes.

    Statuses, tables and predictions of single bodies are computed from it.
    """

    scene: Scene
    propagator: Propagator
    snapshots: tuple[Snapshot, ...]
    initial: Belief
    start: Belief
    wall_time: float
    asked: Scene | None = None
    points_history: ContactHistory | None = None
    first: Any = None

    @property
    def left_out(self) -> tuple[str, ...]:
        """Fields of the uncertain materials and impacts that the propagator cannot carry, and left out."""
        return () if self.asked is None else left_out(self.asked, self.propagator)

    @property
    def times(self) -> tuple[float, ...]:
        """Simulated time of each snapshot from the start [s], ascending."""
        return tuple(snapshot.time for snapshot in self.snapshots)

    @property
    def beliefs(self) -> tuple[Belief, ...]:
        """The belief of each snapshot."""
        return tuple(snapshot.belief for snapshot in self.snapshots)

    def at(self, time: float | None = None) -> Snapshot:
        """Return the snapshot of a time.

        Parameters
        ----------
        time : float, optional
            One of the prediction's times [s]; by default the last, the horizon.

        Raises
        ------
        InvalidRequestError
            If nothing was predicted for that time.
        """
        if not self.snapshots:
            raise InvalidRequestError(
                "is an empty slice, without any time; take a slice that contains one of the times",
                field="prediction",
            )
        if time is None:
            return self.snapshots[-1]
        times, time = np.array(self.times), number(time, "time")
        k = int(np.abs(times - time).argmin())
        if abs(times[k] - time) > RESOLUTION:
            raise InvalidRequestError(
                f"is no time of the prediction, of which {times[k]:g} s is the nearest; predict with"
                " times=[...]",
                field="time",
                value=time,
            )
        return self.snapshots[k]

    @property
    def belief(self) -> Belief:
        """The last belief."""
        return self.at().belief

    @property
    def time(self) -> float:
        """Simulated time of the last belief [s]."""
        return self.at().time

    @property
    def carry(self) -> Any:
        """The propagator's persistent state at the end, a NamedTuple."""
        return self.at().carry

    @property
    def seed(self) -> int | None:
        """The seed that was used; None for a propagator that draws nothing."""
        return getattr(self.propagator, "seed", None)

    def samples(self, count: int | None = None, *, time: float | None = None) -> np.ndarray:
        """Draw states from the prediction, the same at each call.

        Parameters
        ----------
        count : int, optional
            How many; the first ones of a larger number. A propagator that has samples gives its own, by
            default all of them; otherwise the belief is drawn from, with the prediction's seed or 0.
        time : float, optional
            As in `at`.

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
        snapshot = self.at(time)
        if count is not None:
            count = integer(count, "count", low=1)
        own = snapshot.samples
        if own is None:
            if count is None:
                raise InvalidRequestError(
                    f"must be given: {self.propagator.name} has no samples of its own", field="count"
                )
            return snapshot.belief.sample(count, np.random.default_rng(self.seed or 0))
        if count is not None and count > len(own):
            raise LimitExceededError(
                f"must be at most the {len(own)} samples of the prediction", field="count", value=count
            )
        return own[:count].copy()
