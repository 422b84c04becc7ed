"""The computation time that a prediction is allowed."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from ..checks.errors import PredictionTimeoutError
from ..compiler.compile_time import clock
from ..compiler.time_limit import TimeLimit
from ..scene.scene import Scene

LOOK_UP_AFTER = 0.02  # s, wall time between checks of the clock and reports of progress
_LEAST = 0.05  # s, wall time that kernels always get, so that most answers have a first step
# time of a piece: share of the time spent or allowed, and largest time [s]. Pieces should be few, as each
# begins a new contact search in all rollouts, and its threads wait for the slowest one
_SHARE_OF_SPENT, _SHARE_OF_ALLOWED, _LONGEST = 0.5, 0.05, 0.25
# time of a piece whose rollouts are separate calls: multiple of the time spent, and share of the time left
_TIMES_SPENT, _SHARE_OF_REST = 8.0, 0.8


class ComputeBudget(NamedTuple):
    """Computation time that a prediction may take.

    Attributes
    ----------
    allowed : float or None
        Limit of the wall time [s].
    started : float
        Beginning of the wall time [s].
    limit : TimeLimit or None
        Ends running kernels; None if they cannot be ended.
    """

    allowed: float | None
    started: float
    limit: TimeLimit | None

    @property
    def over(self):
        """Whether the time ran out."""
        return self.allowed is not None and clock() - self.started > self.allowed

    def complete(self, compute: Callable[..., Any], *arguments) -> Any:
        """Return a function's result; None if its kernels were ended early.

        Compile time does not count: a call that was ended while kernels were compiled is repeated.
        """
        while self.allowed is not None and self.limit is not None:
            self.limit.within(max(self.allowed - (clock() - self.started), _LEAST))
            result = compute(*arguments)
            if not self.limit.passed:
                return result
            if self.over:
                return None
        return compute(*arguments)

    def next_piece(self, steps: int, took: float, scene: Scene) -> int:
        """Return the number of steps of the next piece of a prediction, when ``steps`` steps took ``took`` s.

        Where each rollout is a separate call, it takes as long as dozens of steps. The time limit is checked
        between these calls, so a piece may be longer: several times as long as all before it. A piece is lost
        if time runs out meanwhile.
        """
        spent = clock() - self.started
        if not _calls_each_rollout(scene):
            in_time = self.allowed is None or self.limit is not None  # however long the piece is
            allowed = math.inf if self.allowed is None else self.allowed
            longest = min(max(_SHARE_OF_SPENT * spent, _SHARE_OF_ALLOWED * allowed), _LONGEST)
            longest = longest if in_time else 0.0
            return _fitting(steps, took, max(LOOK_UP_AFTER, longest), 4)
        left = math.inf if self.allowed is None else self.allowed - spent
        longest = max(LOOK_UP_AFTER, min(_TIMES_SPENT * spent, _SHARE_OF_REST * left))
        return _fitting(steps, took, longest, 32)

    def error(self, reached, horizon):
        """Return the error of a budget that ran out."""
        where = f"after {reached:.6g} s of {horizon:.6g} s simulated" if reached else "before the first step"
        return PredictionTimeoutError(f"ran out {where}", field="max_computation_time", value=self.allowed)


def first_piece(scene: Scene) -> int:
    """Return the number of steps of the first piece of a prediction."""
    return 8 if _calls_each_rollout(scene) else 1


def _calls_each_rollout(scene):
    """Return whether each rollout is a separate call: explicit ones with uncertain parameters."""
    return scene.integrator == "explicit" and bool(scene.uncertain)


def _fitting(steps, took, longest, growth):
    """Return the steps that fit in a time [s] at the last pace; at most ``growth`` times as many."""
    return max(1, min(growth * steps, round(steps * longest / max(took, 1e-9))))
