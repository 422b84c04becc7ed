"""Fit uncertain parameters of a scene to recorded motions."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from importlib.util import find_spec
from typing import NamedTuple

import numpy as np

from ..checks.errors import NotSupportedError
from ..checks.validation import integer
from ..prediction.executors import ROUND_CHUNK_TIME, AnyExecutor, Workers
from ..scene.scene import Scene
from .adjustable import Adjustable, Model, chosen, fitted_by_default
from .flight import FlightGravity, FlightStart, flight_gravity, pose_noise
from .motions import Motion
from .objective import DRAWS, TIMES, Objective, Recorded, Scores, Simulator, recorded, simulated
from .posterior import Posterior
from .recording_checks import check_recording
from .search import ParameterSearch
from .uncertainty import refine, refining

EVALUATIONS = 80
_SEARCHED = 12  # motions, at most, of the search; the uncertainty is then estimated from all motions
_LEVEL = 0.9  # level of the regions whose coverage is checked
_SURE = 4.0  # standard errors below it that raise a doubt: there are four checks, and fitted values err
_CLEAR = 3.0  # standard deviations from 0 of a spread that is not zero
_UPPER_QUANTILE = 1.645  # of a normal number, which exceeds it with a probability of 5 %
_NOISE = 3.0  # first guess of the noise of recorded poses, over the residuals of free flights


@dataclass(frozen=True)
class Fitted:
    """A number that was fitted.

    Attributes
    ----------
    name, unit, about : str
    before : float
        Value in the given scene.
    value : float
    std : float
        Standard deviation of the value, from the differences between motions; at most that of the prior.
    determined : bool
        Whether the standard deviation is clearly below that of the prior.
    """

    name: str
    unit: str
    about: str
    before: float
    value: float
    std: float
    determined: bool

    @property
    def may_be_zero(self) -> bool:
        """Whether it is a spread that the motions determine to less than three standard deviations from 0."""
        return self.name.endswith("_std") and self.determined and self.value < _CLEAR * self.std

    @property
    def upper_bound(self) -> float:
        """Value that a spread exceeds with a probability of 5 %: its logarithm is fitted."""
        return self.value * math.exp(_UPPER_QUANTILE * self.std / self.value)


@dataclass(frozen=True, eq=False, repr=False)
class Calibration:
    """Result of `calibrate`.

    Attributes
    ----------
    before, after : Model
        Before: the given scene, with the pose noise of the free flights. After: with the fitted values.
    fitted : tuple of Fitted
    scores_before, scores_after : tuple of Scores
        Of each motion that was used, with other random draws than the fit.
    recorded : tuple of Recorded
        The motions that were used.
    gravity : FlightGravity or None
        ``acceleration`` (3,) of the free flights, world axes, and ``std`` (3,) of its error [m/s^2]; None
        without long flights.
    objective : tuple of 2 floats
        Mean score before and after, the lower the better.
    evaluations : int
        Number of parameter sets that were tried.
    bounds : tuple of (float, float)
        Bounds of the search for each value.
    """

    before: Model
    after: Model
    fitted: tuple[Fitted, ...]
    scores_before: tuple[Scores, ...]
    scores_after: tuple[Scores, ...]
    recorded: tuple[Recorded, ...]
    gravity: FlightGravity | None
    objective: tuple[float, float]
    evaluations: int
    bounds: tuple[tuple[float, float], ...]

    def __repr__(self) -> str:
        values = (f"{one.name} {one.before:.3g} -> {one.value:.3g} +- {one.std:.2g}" for one in self.fitted)
        return f"<Calibration by {len(self.recorded)} motions: {', '.join(values)}>"

    @property
    def scene(self) -> Scene:
        """The scene with the fitted values."""
        return self.after.scene

    @property
    def doubts(self) -> tuple[str, ...]:
        """Sentences about problems of the fit: low coverage, values at a bound, undetermined or near zero."""
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
            if not low * (1.0 + 1e-6) < one.value < high * (1.0 - 1e-6) and one.determined:
                found.append(f"{one.name} ends at the bound of what is sought, {one.value:.3g}")
        loose = [one.name for one in self.fitted if not one.determined]
        if loose:
            names = ", ".join(loose)
            found.append(f"the motions do not determine {names}: these values stay close to their priors")
        zero = [f"{one.name} (at most {one.upper_bound:.2g})" for one in self.fitted if one.may_be_zero]
        if zero:
            found.append(f"not clearly above zero, with upper bounds of 95 %: {', '.join(zero)}")
        return tuple(found)


def calibrate(
    motions: Sequence[Motion],
    scene: Scene,
    fit: Sequence[str] | None = None,
    *,
    times: Sequence[float] = TIMES,
    samples: int | None = None,
    evaluations: int = EVALUATIONS,
    seed: int = 0,
    executor: AnyExecutor = None,
    progress: Callable[[int, int, float], object] | None = None,
) -> Calibration:
    """Fit friction, restitution, inertia and errors of the model to recorded motions, all jointly.

    Each motion is predicted from the state that its first poses give, by Monte Carlo, and compared with the
    recorded poses: by energy scores of position and rotation at several times, and by the Brier score of the
    side on which the body ends. All models see the same random numbers. Where the motions say little, a
    penalty keeps values near their priors, whose medians are the scene's values.

    Parameters
    ----------
    motions : sequence of Motion
    scene : Scene
        One body and its surroundings, not with the explicit integrator; its values are the priors' medians.
    fit : sequence of str, optional
        Names of what is fitted (`adjustable.adjustables`); by default all but laws of impacts that the scene
        lacks (`adjustable.fitted_by_default`).
    times : sequence of float
        At which predictions are scored, beside each motion's end [s].
    samples : int, optional
        Of each motion's prediction; by default 16 of 30 motions, and more of fewer.
    evaluations : int
        Models that the search tries on a dozen of the motions, at least four times as many as there are
        things to fit. Some more, on all motions, follow for the uncertainty of the values.
    seed : int
    executor : concurrent.futures.Executor, callable or str, optional
        Predicts the motions, as in `predict_many`; by default this process. The result does not depend on it.
    progress : callable, optional
        Called with the number of models tried, of about how many, and the best score so far. What it raises
        ends the fit.

    Raises
    ------
    InvalidOptionError, InvalidRequestError, NotSupportedError
    """
    _require_scipy()
    if scene.integrator == "explicit":
        raise NotSupportedError(
            "must be 'implicit'; 'explicit' has no friction", field="integrator", value="explicit"
        )
    adjusted = chosen(scene, fitted_by_default(scene) if fit is None else fit)
    evaluations = integer(evaluations, "evaluations", low=4 * len(adjusted))
    check_recording(motions, scene)
    found = recorded(motions, scene, times)
    samples = max(4, DRAWS // len(found)) if samples is None else integer(samples, "samples", low=4)
    before = with_noise(scene, found)
    count_models = _Progress(evaluations + refining(len(adjusted)), progress)
    Objective(found[:1], samples, seed).scores(before)  # this process compiles, and workers load
    with closing(Workers(executor, ROUND_CHUNK_TIME)) as workers:
        result = fit_model(found, before, adjusted, samples, evaluations, seed, count_models, workers=workers)
        check = Objective(found, max(samples, 100), seed + 1, workers=workers)
        scores_before, scores_after = check.scores(before), check.scores(result.model)
    return Calibration(
        before,
        result.model,
        result.fitted,
        tuple(scores_before),
        tuple(scores_after),
        tuple(found),
        flight_gravity(motions, scene),
        result.scores,
        count_models.tried,
        tuple((one.low, one.high) for one in adjusted),
    )


def with_noise(scene: Scene, motions: Sequence[Recorded]) -> Model:
    """Return a model of a scene with the errors of poses that the flights of motions show."""
    starts = [one.start for one in motions if isinstance(one.start, FlightStart)]
    position, rotation = (_NOISE * value for value in pose_noise(starts))
    return Model(scene, max(position, 1e-6), max(rotation, 1e-5))


class Fit(NamedTuple):
    """Result of `fit_model`."""

    #: with the fitted values; the uncertainty of friction and restitution is part of their spread
    model: Model
    fitted: tuple[Fitted, ...]
    #: (float, float): mean scores of the motions before and after, without the penalty
    scores: tuple[float, float]


def fit_model(
    motions: Sequence[Recorded],
    before: Model,
    adjusted: Sequence[Adjustable],
    samples: int,
    evaluations: int,
    seed: int,
    report_score: Callable[[float], object] = lambda score: None,
    simulate: Simulator = simulated,
    workers: Workers | None = None,
) -> Fit:
    """Return the model under which motions are predicted best, for any simulator.

    The values of ``before`` are the medians of the priors. Samples, evaluations and seed are those of
    `calibrate`. ``report_score`` is called with the mean penalised score of each model that is tried, and
    ``simulate`` makes the predictions, on ``workers`` if there are some.
    """
    workers = workers or Workers()
    few = Objective(motions[:_SEARCHED], samples, seed, simulate, workers=workers)
    search = ParameterSearch(Posterior(few, before, adjusted, report_score, len(motions)))
    search.approach()
    if evaluations - search.tried > 2 * len(adjusted):
        search.run(evaluations - search.tried)
    # other draws than those to which the best values are adapted
    every = Objective(motions, samples, seed + 2, simulate, workers=workers)
    score_before = every.per_motion(before).mean()
    posterior = Posterior(every, before, adjusted, report_score)
    estimate = refine(posterior, search.best)
    model = posterior.with_values(estimate.x)
    score_after = every.per_motion(model).mean()
    values, fitted = posterior.values(estimate.x), []
    for one, std, determined in zip(adjusted, estimate.stds, estimate.determined, strict=True):
        value = values[one.name]
        own = float(min(one.prior_std * std * (value if one.relative else 1.0), one.high - one.low))
        fitted.append(Fitted(one.name, one.unit, one.about, one.get(before), value, own, bool(determined)))
    return Fit(_widened(model, fitted), tuple(fitted), (float(score_before), float(score_after)))


def _widened(model, fitted):
    """Return a model whose spread of friction and restitution includes the uncertainty of the fit."""
    scene, changes = model.scene, {}
    for one in fitted:
        if one.name in ("friction", "restitution"):
            spread = f"{one.name}_std"
            changes[spread] = math.hypot(getattr(scene, spread), one.std)
    return model._replace(scene=replace(scene, **changes))


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
