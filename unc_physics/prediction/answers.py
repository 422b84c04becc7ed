"""What answers questions about a prediction, beyond its beliefs."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..propagators.base import Mode
from ..scene.belief import Belief

if TYPE_CHECKING:
    from .motion import Motion
    from .prediction import Prediction
    from .probabilities import (
        ContactProbability,
        FallProbability,
        RegionProbability,
        RestProbability,
        UprightProbability,
    )
    from .regions import BoxRegion
    from .status_rules import BodyStatus


class Answers(ABC):
    """Answers what a `Prediction` is asked.

    Where a prediction was made, they are computed when asked for (`computed.Computed`); where it came from
    elsewhere, they are looked up, and what was not told raises `NotSupportedError`. Arguments are checked
    already.
    """

    @property
    @abstractmethod
    def carry(self) -> Any:
        """The propagator's persistent state at the end."""

    def carries(self, last: int) -> Sequence[Any]:
        """The propagator's persistent states at the last of the prediction's times; None where they are not
        kept.
        """
        return [None] * last

    def motions(self, last: int) -> Sequence[Motion | None]:
        """What the rollouts move with at the last of the prediction's times; None where the belief is of
        themselves.
        """
        return [None] * last

    @abstractmethod
    def start(self, prediction: Prediction) -> Belief:
        """As `Prediction.start`."""

    @abstractmethod
    def samples(self, prediction: Prediction, count: int | None) -> np.ndarray:
        """As `Prediction.samples`."""

    @abstractmethod
    def modes(self, prediction: Prediction, body: int) -> tuple[Mode, ...]:
        """As `PredictedBody.modes`, of the body with that index."""

    @abstractmethod
    def contacts(self, prediction: Prediction, flights: int) -> tuple[ContactProbability, ...]:
        """As `contact_probabilities`."""

    @abstractmethod
    def regions(
        self, prediction: Prediction, regions: Sequence[BoxRegion], flights: int
    ) -> tuple[RegionProbability, ...]:
        """As `region_probabilities`."""

    @abstractmethod
    def rest(
        self, prediction: Prediction, speed: float, angular_speed: float, flights: int
    ) -> tuple[RestProbability, ...]:
        """As `rest_probabilities`."""

    @abstractmethod
    def upright(self, prediction: Prediction, angle: float, flights: int) -> tuple[UprightProbability, ...]:
        """As `upright_probabilities`."""

    @abstractmethod
    def fallen(self, prediction: Prediction, flights: int) -> tuple[FallProbability, ...]:
        """As `fall_probabilities`."""

    @abstractmethod
    def statuses(self, prediction: Prediction, rollouts: int) -> tuple[tuple[BodyStatus, ...], ...]:
        """As `assess_all`."""
