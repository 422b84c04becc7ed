"""Session: repeated predictions of a scene with other propagators and uncertainty."""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np

from ..checks.errors import NotSupportedError, UncPhysicsError
from ..checks.shown import plain_digits, printable
from ..prediction.events import AtRest, encounters, moving_names
from ..prediction.predict import predict
from ..prediction.prediction import Prediction
from ..prediction.status import assess
from ..prediction.tables import duration_text
from ..propagators.base import Propagator
from ..propagators.registry import PROPAGATORS, make_propagator
from ..scene.belief import Belief
from ..scene.scene import Scene
from .adjusting import adjustable, adjusted
from .frames import AnimationFrames, frames_of

_MOST_LINES = 12  # most probabilities listed


def check_installed(what: str) -> None:
    """Raise `NotSupportedError`, as ``what`` needs them, unless the page's libraries are installed."""
    missing = [name for name in ("viser", "trimesh") if find_spec(name) is None]
    if missing:
        raise NotSupportedError(
            f"{what} needs {' and '.join(missing)}: install the extra 'view', or pip install"
            f" {' '.join(missing)}"
        )


class Session:
    """Viewed scene and belief, as given and as adjusted.

    The page shows so many ``frames`` up to the horizon [s], and ``ghosts`` samples in each. The propagator is
    the first one.
    """

    def __init__(
        self, scene: Scene, belief: Belief, horizon: float, propagator: Propagator, frames: int, ghosts: int
    ):
        self.scene, self._belief, self._horizon = scene, belief, horizon
        self._frames, self._ghosts = frames, ghosts
        self._chosen = propagator
        self._values: dict[str, float] = {}
        self.propagator = propagator
        self.quantities = adjustable(scene, belief)
        self.prediction: Prediction | None = None

    @property
    def propagators(self) -> list[str]:
        """Names of propagators that support the scene's integrator."""
        names = [name for name, kind in PROPAGATORS.items() if self.scene.integrator in kind.integrators]
        return names if self.propagator.name in names else [self.propagator.name, *names]

    def choose(self, name: str) -> None:
        """Use another propagator from now on; the initial one keeps its options."""
        self.propagator = self._chosen if name == self._chosen.name else make_propagator(name)

    def adjust(self, key: str, value: float) -> None:
        """Set a quantity from now on."""
        self._values[key] = value

    def reset(self) -> None:
        """Undo all adjustments."""
        self._values = {}

    def predict(self) -> AnimationFrames:
        """Predict the current scene with the current choices and adjustments."""
        scene, belief = adjusted(self.scene, self._belief, self._values)
        steps = max(round(self._horizon / scene.dt), 1)
        marks = np.unique(np.linspace(0, steps, self._frames).round().astype(int))[1:]
        times = (marks * scene.dt).tolist()
        self.prediction = predict(
            scene, belief, self.propagator, times[-1], times=times, events=_events(scene)
        )
        return frames_of(self.prediction, self._ghosts)

    def summary(self) -> str:
        """Return the last prediction as Markdown: bodies, probabilities, and status flags."""
        prediction = self.prediction
        if prediction is None:
            return ""
        lines = [f"**{prediction.propagator.name}**, {duration_text(prediction.wall_time)}", ""]
        for body in prediction.bodies:
            if not (body.fixed or body.prescribed):
                std = ", ".join(plain_digits(1e3 * value, 2) for value in body.position_std)
                lines.append(f"- **{_plain(body.name)}**: ± {std} mm")
        lines += ["", *self._probabilities(prediction), ""]
        try:
            statuses = [status for status in assess(prediction, rollouts=0) if status.flags]
        except UncPhysicsError as error:
            return "\n".join([*lines, _plain(str(error))])
        for status in statuses:
            flags = " ".join(flag.name or "" for flag in status.flags)
            lines.append(f"- {_plain(status.body)}: *{flags}*: {_plain(status.message)}")
        return "\n".join(lines)

    def _probabilities(self, prediction):
        found = [(event, prediction.probability(event)) for event in _events(prediction.scene)]
        informative = [(event, p) for event, p in found if p.estimate > 0.0 and p.high - p.low < 1.0]
        lines = [f"- {_plain(str(event))}: **{p.estimate:.2f}**" for event, p in informative[:_MOST_LINES]]
        for body, modes in self._modes(prediction):
            lines.append(f"- {_plain(body)}: outcomes of {modes}")
        return lines or ["- probabilities: ask a propagator with samples"]

    def _modes(self, prediction):
        """Yield bodies with several outcomes, and the probabilities of these."""
        for body in prediction.bodies:
            certain = body.fixed or body.prescribed
            weights = [] if certain else [mode.weight for mode in body.modes]
            if len(weights) > 1:
                yield body.name, ", ".join(f"**{weight:.2f}**" for weight in weights)


def _events(scene):
    """Return the events whose probabilities are shown."""
    return [*encounters(scene), *(AtRest(name) for name in moving_names(scene))]


def _plain(text):
    """Escape Markdown characters in a text."""
    return "".join(f"\\{mark}" if mark in "\\`*_{}[]<>#|!" else mark for mark in printable(text))
