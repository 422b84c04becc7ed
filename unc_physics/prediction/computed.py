"""Answers about a prediction that was made here, computed from what the propagator left."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..checks.errors import InvalidRequestError, LimitExceededError
from ..propagators.base import Mode
from ..scene.belief import Belief
from .answers import Answers

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


class Computed(Answers):
    """Computes when asked; what for is imported then, as most predictions are asked little.

    Parameters
    ----------
    carry : NamedTuple
        The propagator's persistent state at the end.
    began : callable
        Gives the belief of the points or samples that it began with.
    reached : sequence of callables
        Each gives the state at one of the prediction's times, None where it was not kept.
    motions : sequence of Motion or None
        Of the rollouts at these times, where the answer is made of more samples.
    """

    def __init__(
        self,
        carry: Any,
        began: Callable[[], Belief],
        reached: Sequence[Callable[[], Any]],
        motions: Sequence[Motion | None],
    ):
        self._carry, self._began, self._reached, self._motions = carry, began, reached, motions
        self._start: Belief | None = None

    @property
    def carry(self) -> Any:
        return self._carry

    def carries(self, last: int) -> Sequence[Any]:
        return [carry() for carry in self._reached[-last:]]

    def motions(self, last: int) -> Sequence[Motion | None]:
        return self._motions[-last:]

    def start(self, prediction: Prediction) -> Belief:
        if self._start is None:  # once for all that is asked of parts of a prediction, too
            scene, start = prediction.scene, prediction.contact_history.start
            moved = start is not None and (start.moved.any() or any(body.at_rest for body in scene.bodies))
            began = moved or scene.overlap == "reject"
            self._start = self._began() if began else prediction.initial
        return self._start

    def samples(self, prediction: Prediction, count: int | None) -> np.ndarray:
        propagator = prediction.propagator
        own = propagator.own_samples(self.carry, prediction.scene)
        if own is None:
            if count is None:
                raise InvalidRequestError(
                    f"must be given: {propagator.name} has no samples of its own", field="count"
                )
            return prediction.belief.sample(count, np.random.default_rng(prediction.seed or 0))
        if count is not None and count > len(own):
            raise LimitExceededError(
                f"must be at most the {len(own)} samples of the prediction", field="count", value=count
            )
        return own[:count].copy()

    def modes(self, prediction: Prediction, body: int) -> tuple[Mode, ...]:
        return prediction.propagator.modes(self.carry, prediction.scene, body)

    def contacts(self, prediction: Prediction, flights: int) -> tuple[ContactProbability, ...]:
        from .outcomes import share_of_contacts

        return share_of_contacts(prediction, flights)

    def regions(
        self, prediction: Prediction, regions: Sequence[BoxRegion], flights: int
    ) -> tuple[RegionProbability, ...]:
        from .outcomes import share_inside

        return share_inside(prediction, regions, flights)

    def rest(
        self, prediction: Prediction, speed: float, angular_speed: float, flights: int
    ) -> tuple[RestProbability, ...]:
        from .outcomes import share_at_rest

        return share_at_rest(prediction, speed, angular_speed, flights)

    def upright(self, prediction: Prediction, angle: float, flights: int) -> tuple[UprightProbability, ...]:
        from .outcomes import share_upright

        return share_upright(prediction, angle, flights)

    def fallen(self, prediction: Prediction, flights: int) -> tuple[FallProbability, ...]:
        from .outcomes import share_fallen

        return share_fallen(prediction, flights)

    def statuses(self, prediction: Prediction, rollouts: int) -> tuple[tuple[BodyStatus, ...], ...]:
        from .status import judge

        return judge(prediction, rollouts)
