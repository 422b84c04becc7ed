"""Fits what a scene's model leaves open to recorded motions."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec

import numpy as np

from ..checks.errors import NotSupportedError
from ..checks.validation import integer
from ..scene.scene import Scene
from .adjustable import DEFAULT, Model, chosen, with_values
from .flight import flight_gravity, pose_noise
from .motions import Motion
from .objective import SAMPLES, TIMES, Objective, Recorded, Scores, recorded
from .search import Search
from .uncertainty import refine, refining

EVALUATIONS = 80
_SEARCHED = 12  # motions, at most, that values are sought with before all say how sure they are
_LEVEL = 0.9  # of the regions by which a model is doubted
_SURE = 4.0  # standard errors by which it is missed then: it is asked four times, of values that err too
_NOISE = 3.0  # errors of recorded poses over what one flight shows of them, to begin with


@dataclass(frozen=True)
class Fitted:
    """A number that was fitted.

    Attributes
    ----------
    name, unit, about : str
    before : float
        The scene's own.
    value : float
    std : float
        Of the value, as motions differ; at most what the search allows.
    settled : bool
        Whether the score has its minimum at the value, and curves: if not, the data do not determine it.
    """

    name: str
    unit: str
    about: str
    before: float
    value: float
    std: float
    settled: bool


@dataclass(frozen=True, eq=False)
class Calibration:
    """What `calibrate` found.

    Attributes
    ----------
    before, after : Model
        The scene as it was given, with the noise that the flights show, and with the fitted values.
    fitted : tuple of Fitted
    scores_before, scores_after : tuple of Scores
        Of each motion that was used, by other draws than the fit's.
    recorded : tuple of Recorded
        These motions.
    gravity : (3,) array or None
        What the free flights say of it, world axes [m/s^2]; None without long ones.
    objective : tuple of 2 floats
        Mean score before and after, the lower the better.
    evaluations : int
        Models that were tried.
    bounds : tuple of (float, float)
        Between which each value was sought.
    """

    before: Model
    after: Model
    fitted: tuple[Fitted, ...]
    scores_before: tuple[Scores, ...]
    scores_after: tuple[Scores, ...]
    recorded: tuple[Recorded, ...]
    gravity: np.ndarray | None
    objective: tuple[float, float]
    evaluations: int
    bounds: tuple[tuple[float, float], ...]

    @property
    def scene(self) -> Scene:
        """The scene with the fitted values."""
        return self.after.scene

    @property
    def doubts(self) -> tuple[str, ...]:
        """What speaks against the fit, in sentences: small regions, values at a bound or not settled."""
        found, count = [], len(self.recorded)
        least = _LEVEL - _SURE * math.sqrt(_LEVEL * (1.0 - _LEVEL) / count)
        for what, quantity in (("positions", "position_rank"), ("rotations", "rotation_rank")):
            for when, k in (("first time", 0), ("end", -1)):
                share = np.mean([getattr(one, quantity)[k] <= _LEVEL for one in self.scores_after])
                if share < least:
                    found.append(
                        f"the region of {_LEVEL:.0%} holds only {share:.0%} of {what} at the {when}: the"
                        " model lacks something, or the data are not what the scene says"
                    )
        for one, (low, high) in zip(self.fitted, self.bounds, strict=True):
            if one.value >= high * (1.0 - 1e-6) or (low > 0.0 and one.value <= low * (1.0 + 1e-6)):
                found.append(f"{one.name} ends at the bound of what is sought, {one.value:.3g}")
        loose = [one.name for one in self.fitted if not one.settled]
        if loose:
            found.append(
                f"the motions do not determine {', '.join(loose)}: the score hardly changes with it, or was"
                " still falling; record more motions, try more models, or fit less"
            )
        return tuple(found)


def calibrate(
    motions: Sequence[Motion],
    scene: Scene,
    fit: Sequence[str] = DEFAULT,
    *,
    times: Sequence[float] = TIMES,
    samples: int = SAMPLES,
    evaluations: int = EVALUATIONS,
    seed: int = 0,
    progress: Callable[[int, int, float], object] | None = None,
) -> Calibration:
    """Fit friction, restitution, inertia and errors of the model to recorded motions.

    Each motion is predicted from the state that its first poses give, by Monte Carlo, and compared with what
    came by energy scores of position and rotation at several times and by the logarithmic score of how the
    body lies at the end. All models see the same random numbers.

    Parameters
    ----------
    motions : sequence of Motion
    scene : Scene
        One body and its surroundings, with the implicit integrator; its values are where the search begins.
    fit : sequence of str
        Names of what is fitted (`adjustable.adjustables`).
    times : sequence of float
        At which predictions are scored, beside each motion's end [s].
    samples : int
        Of each motion's prediction.
    evaluations : int
        Models that the search tries on a dozen of the motions, at least four times as many as there are
        things to fit. After it some more tell how sure the values are.
    seed : int
    progress : callable, optional
        Called with the number of models tried, of about how many, and the best score so far. What it raises
        ends the fit.

    Raises
    ------
    InvalidOptionError, InvalidRequestError, NotSupportedError
    """
    _require_scipy()
    if scene.integrator != "implicit":
        raise NotSupportedError("needs the implicit integrator", field="integrator", value=scene.integrator)
    adjusted = chosen(scene, fit)
    samples = integer(samples, "samples", low=4)
    evaluations = integer(evaluations, "evaluations", low=4 * len(adjusted))
    found = recorded(motions, scene, times)
    noise = [_NOISE * value for value in pose_noise([one.start for one in found])]
    before = Model(scene, max(noise[0], 1e-6), max(noise[1], 1e-5))
    first = with_values(before, adjusted, {one.name: one.begin(before) for one in adjusted})
    told = _Progress(evaluations + refining(len(adjusted)), progress)
    few = Objective(found[:_SEARCHED], samples, seed)
    search = Search(few, first, adjusted, told)
    search.approach()
    if evaluations - search.tried > 2 * len(adjusted):
        search.run(evaluations - search.tried)
    every = Objective(found, samples, seed)
    score_before = every.per_motion(before).mean()
    estimate = refine(few, every, first, adjusted, search.values, told)
    after = with_values(first, adjusted, estimate.values)
    check = Objective(found, max(samples, 100), seed + 1)
    objective = score_before, every.per_motion(after).mean()
    return Calibration(
        before,
        after,
        tuple(
            Fitted(
                one.name,
                one.unit,
                one.about,
                one.get(before),
                estimate.values[one.name],
                estimate.stds[one.name],
                estimate.settled[one.name],
            )
            for one in adjusted
        ),
        tuple(check.scores(before)),
        tuple(check.scores(after)),
        tuple(found),
        flight_gravity(motions, scene),
        (float(objective[0]), float(objective[1])),
        told.tried,
        tuple((one.low, one.high) for one in adjusted),
    )


class _Progress:
    """Counts the models that are tried, and reports them."""

    def __init__(self, about: int, report: Callable[[int, int, float], object] | None):
        self.tried, self._about, self._report, self._best = 0, about, report, math.inf

    def __call__(self, score: float) -> None:
        self.tried, self._best = self.tried + 1, min(self._best, score)
        if self._report is not None:
            self._report(self.tried, max(self._about, self.tried), self._best)


def _require_scipy():
    if find_spec("scipy") is None:
        raise NotSupportedError("calibration needs scipy: pip install 'unc_physics[calibration]'")
