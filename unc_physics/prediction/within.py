"""The computation time that a prediction is allowed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from ..checks.errors import PredictionTimeoutError
from ..physics.compile_time import clock
from ..physics.time_limit import TimeLimit

_LEAST = 0.05  # s, wall time that kernels always have, so that most answers have a first step


class Within(NamedTuple):
    """The computation time that is allowed [s], if any, since when [s], and what ends kernels by then, if
    anything does.
    """

    allowed: float | None
    started: float
    limit: TimeLimit | None

    @property
    def over(self):
        """Whether it ran out."""
        return self.allowed is not None and clock() - self.started > self.allowed

    def complete(self, compute: Callable[..., Any], *arguments) -> Any:
        """What a function computes; None if its kernels were ended early.

        What was ended while kernels were still compiled, which does not count, is computed again.
        """
        while self.allowed is not None and self.limit is not None:
            self.limit.within(max(self.allowed - (clock() - self.started), _LEAST))
            result = compute(*arguments)
            if not self.limit.passed:
                return result
            if self.over:
                return None
        return compute(*arguments)

    def error(self, reached, horizon):
        """That it ran out."""
        where = f"after {reached:.6g} s of {horizon:.6g} s simulated" if reached else "before the first step"
        return PredictionTimeoutError(f"ran out {where}", field="max_computation_time", value=self.allowed)
