"""Fits what a scene's model leaves open to recorded motions."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec

import numpy as np

from ..checks.errors import NotSupportedError, UncPhysicsError
from ..checks.validation import integer
from ..scene.scene import Scene
from .adjustable import DEFAULT, Adjustable, Model, chosen, with_values
from .flight import flight_gravity, pose_noise
from .motions import Motion
from .objective import SAMPLES, TIMES, Objective, Recorded, Scores, recorded

EVALUATIONS = 150
_FIRST_STEP, _LAST_STEP = 1.0, 0.1  # of the search, in an adjustable's steps
_PROBE = 0.7  # how far from the best values curvature is looked for, likewise
_LEVEL = 0.9  # of the regions by which a model is doubted
_NEAR = 3.0  # within which tried models tell how values depend on each other, likewise
_FLAT = 1e-6  # the least curvature that counts
_MOST = 0.8  # how far two values may stand in for each other
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
    """

    name: str
    unit: str
    about: str
    before: float
    value: float
    std: float


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
        """What speaks against the fitted model, in sentences: regions too small, values at a bound."""
        found, count = [], len(self.recorded)
        least = _LEVEL - 3.0 * math.sqrt(_LEVEL * (1.0 - _LEVEL) / count)
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
        Models to try, at least twice as many as there are things to fit.
    seed : int
    progress : callable, optional
        Called with the number of models tried, of all, and the best score so far. What it raises ends the
        fit.

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
    search = Search(Objective(found, samples, seed), first, adjusted, evaluations, progress)
    values = search.run(evaluations - 2 * len(adjusted))
    values, stds = search.with_uncertainty(values)
    after = with_values(first, adjusted, values)
    check = Objective(found, max(samples, 100), seed + 1)
    objective = search.objective.per_motion(before).mean(), search.objective.per_motion(after).mean()
    return Calibration(
        before,
        after,
        tuple(
            Fitted(one.name, one.unit, one.about, one.get(before), values[one.name], stds[one.name])
            for one in adjusted
        ),
        tuple(check.scores(before)),
        tuple(check.scores(after)),
        tuple(found),
        flight_gravity(motions, scene),
        (float(objective[0]), float(objective[1])),
        search.tried,
        tuple((one.low, one.high) for one in adjusted),
    )


class Search:
    """A search for the values under which motions are predicted best.

    Parameters
    ----------
    objective : Objective
    model : Model
        Where it begins.
    adjusted : sequence of Adjustable
    evaluations : int
        Models that will be tried in all; for the progress.
    progress : callable, optional
        As in `calibrate`.
    """

    def __init__(
        self,
        objective: Objective,
        model: Model,
        adjusted: Sequence[Adjustable],
        evaluations: int,
        progress: Callable[[int, int, float], object] | None = None,
    ):
        self.objective, self.model, self.adjusted = objective, model, list(adjusted)
        self.evaluations, self._progress = evaluations, progress
        self._points: list[np.ndarray] = []
        self._scores: list[np.ndarray] = []
        self._lower = np.array([one.scaled(one.low) for one in self.adjusted])
        self._upper = np.array([one.scaled(one.high) for one in self.adjusted])

    @property
    def tried(self) -> int:
        """Number of models tried."""
        return len(self._points)

    def run(self, evaluations: int) -> dict[str, float]:
        """The best values after so many models.

        SciPy's COBYQA: quadratic models in a trust region, without derivatives, within bounds. Scores by
        samples are rough at small steps, so it ends before it sees them.
        """
        from scipy.optimize import minimize

        begin = np.array([one.scaled(one.get(self.model)) for one in self.adjusted])
        minimize(
            lambda x: float(self._try(x).mean()),
            np.clip(begin, self._lower, self._upper),
            method="COBYQA",
            bounds=list(zip(self._lower, self._upper, strict=True)),
            options={
                "maxfev": evaluations,
                "initial_tr_radius": _FIRST_STEP,
                "final_tr_radius": _LAST_STEP,
                "scale": False,
            },
        )
        return self._values(self._best())

    def with_uncertainty(self, values: dict[str, float]) -> tuple[dict[str, float], dict[str, float]]:
        """The best values and their standard deviations, from how scores change around them.

        Two more models for each value show slopes and curvature; slopes differ from motion to motion, and
        curvature says how far the best values would have moved for others (the sandwich estimator). Returns
        the best values again, since one of these models may be better.
        """
        center = np.array([one.scaled(values[one.name]) for one in self.adjusted])
        middle, count = self._try(center, again=False), len(self.adjusted)
        slopes, curvature = np.zeros((len(middle), count)), np.zeros(count)
        for k in range(count):
            ends, at = [], []
            for side in (-_PROBE, _PROBE):
                x = center.copy()
                x[k] = np.clip(x[k] + side, self._lower[k], self._upper[k])
                if x[k] == center[k]:  # at a bound: both on one side
                    x[k] -= 2.0 * side
                at.append(x[k] - center[k])
                ends.append(self._try(x))
            (a, b), (low, high) = at, ends
            # a parabola through the three
            second = 2.0 * ((high - middle) / b - (low - middle) / a) / (b - a)
            slopes[:, k] = (high - middle) / b - 0.5 * second * b
            curvature[k] = second.mean()
        H = self._hessian(center, float(middle.mean()), slopes.mean(axis=0), curvature)
        spread = np.atleast_2d(np.cov(slopes.T)) / len(middle)
        widest = (self._upper - self._lower) / math.sqrt(12.0)  # of what could be anything
        std = np.minimum(np.sqrt(np.diagonal(np.linalg.solve(H, np.linalg.solve(H, spread).T))), widest)
        best = self._best()
        stds = {
            one.name: float(one.step * s * (one.unscaled(x) if one.relative else 1.0))
            for one, s, x in zip(self.adjusted, std, best, strict=True)
        }
        return self._values(best), stds

    def _hessian(self, center, middle, slope, curvature):
        """Second derivatives of the mean score: those on the diagonal are known, others by all points near.

        Ridge regression leaves at 0 what the points do not tell. What would hardly curve is let curve up a
        little, which gives wide uncertainties.
        """
        near = [
            (x - center, own.mean())
            for x, own in zip(self._points, self._scores, strict=True)
            if 0.0 < np.linalg.norm(x - center) < _NEAR
        ]
        H, (i, j) = np.diag(curvature), np.triu_indices(len(center), 1)
        if near and len(i):
            d = np.array([x for x, _ in near])
            rest = np.array([score for _, score in near]) - middle - d @ slope - 0.5 * d**2 @ curvature
            pairs = d[:, i] * d[:, j]
            H[i, j] = np.linalg.solve(pairs.T @ pairs + np.eye(len(i)), pairs.T @ rest)
            H[j, i] = H[i, j]
        size = np.sqrt(np.maximum(np.diagonal(H), _FLAT))
        C = np.clip(H / np.outer(size, size), -_MOST, _MOST)
        np.fill_diagonal(C, 1.0)
        values, vectors = np.linalg.eigh(C)
        return (vectors * np.maximum(values, 1.0 - _MOST)) @ vectors.T * np.outer(size, size)

    def _try(self, x, again=True):
        """Scores (M,) of the motions at scaled values; remembered."""
        if not again:
            for point, known in zip(self._points, self._scores, strict=True):
                if np.array_equal(point, x):
                    return known
        try:
            model = with_values(self.model, self.adjusted, self._values(x))
            found = self.objective.per_motion(model)
        except UncPhysicsError:
            if not self._scores:
                raise
            found = self._scores[0] * 10.0  # such as a diverging simulation: no candidate
        self._points.append(np.array(x))
        self._scores.append(found)
        if self._progress is not None:
            best = min(float(own.mean()) for own in self._scores)
            self._progress(self.tried, self.evaluations, best)
        return found

    def _best(self):
        return self._points[int(np.argmin([own.mean() for own in self._scores]))]

    def _values(self, x):
        return {one.name: one.unscaled(float(v)) for one, v in zip(self.adjusted, x, strict=True)}


def _require_scipy():
    if find_spec("scipy") is None:
        raise NotSupportedError("calibration needs scipy: pip install 'unc_physics[calibration]'")
