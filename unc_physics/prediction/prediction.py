"""A prediction: snapshots of the bodies at one or more times, and each body by its name."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NoReturn, overload

import numpy as np

from ..checks.errors import NotSupportedError
from ..checks.shown import counted_bodies
from ..checks.validation import instance
from ..plots.scene_picture import draw_prediction
from ..scene.contact_world import contact_table
from . import probability as probabilities
from .diagnosis import ROLLOUTS, judge
from .events import Event, Touches
from .predicted_body import Origin, PredictedBody, Trajectory
from .prediction_data import PredictionData
from .snapshot import ContactTime, Probability
from .tables import FEW_LINES, as_dict, as_table, as_text, preformatted

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False)
class Prediction(PredictionData):
    """Snapshots at one or more times.

    ``prediction["mug"]`` is a body at the horizon, ``prediction[:3]`` the prediction that ends at the third
    time.

    Attributes
    ----------
    scene : Scene
        As it was simulated.
    propagator : Propagator
    snapshots : tuple of Snapshot
        In order of time; the last is at the horizon.
    initial : Belief
        The belief at time 0 that was given.
    start : Belief
        The belief at time 0 that was used: without overlap, and settled where bodies are at rest. It
        has the moments of the propagator's points or samples; where none was moved, it is what was given.
    wall_time : float
        Wall time of the prediction, without compiling or loading kernels [s].
    asked : Scene, optional
        The scene with the uncertain parts that the propagator left out; None where it left out none.
    points_history : ContactHistory or None
        What points of the belief met at time 0, of a propagator with a single nominal rollout on the implicit
        step; its status needs it.
    first : NamedTuple or None
        The propagator's carry at time 0, if rollouts are added to it.
    """

    def __str__(self) -> str:
        if not self.snapshots:
            return as_table(self)
        (statuses,) = judge(replace(self, snapshots=(self.at(),)), ROLLOUTS)
        return as_text(self, statuses, FEW_LINES)

    def __repr__(self) -> str:
        bodies = counted_bodies([body.name for body in self.scene.bodies])
        return f"<Prediction of {bodies} by {self.propagator.name} at {len(self.times)} times>"

    def _repr_html_(self) -> str:
        return preformatted(str(self))

    def plot(self, title: str = "") -> Figure:
        """Draw the bodies now and at the horizon, from the side and from above.

        Parameters
        ----------
        title : str

        Returns
        -------
        matplotlib.figure.Figure
        """
        last = self.at()
        samples = last.samples if last.rollout_states is None else last.rollout_states
        modes = [last.modes(self.scene, k) for k in range(len(self.scene.bodies))]
        caption = f"predicted for {self.time:g} s ({self.propagator.name.replace('_', ' ')})"
        return draw_prediction(self.scene, (self.initial, *self.beliefs), samples, modes, caption, title)

    def to_dict(self) -> dict[str, Any]:
        """Return the prediction as plain Python values, as ``unc_physics schema prediction`` has them."""
        return as_dict(self, self.seed)

    @overload
    def __getitem__(self, key: str) -> PredictedBody: ...
    @overload
    def __getitem__(self, key: slice) -> Prediction: ...
    def __getitem__(self, key: str | slice) -> PredictedBody | Prediction:
        """Return the body of that name at the horizon, as `body`; or the prediction of a slice of times."""
        if isinstance(key, slice):
            return replace(self, snapshots=self.snapshots[key])
        return self.body(key)

    def __iter__(self) -> NoReturn:
        raise TypeError(
            "a Prediction is not iterable: iterate over its bodies (prediction.bodies) or over its times"
            " (prediction.snapshots)"
        )

    def body(
        self, name: str, *, time: float | None = None, origin: Origin = "center_of_mass"
    ) -> PredictedBody:
        """Return the prediction of one body.

        Parameters
        ----------
        name : str
        time : float, optional
            One of the prediction's times [s]; by default the last, the horizon.
        origin : {'center_of_mass', 'model'}
            Point of the positions and velocities: the centre of mass, as in beliefs and scene files, or the
            model's own origin, as in messages.

        Raises
        ------
        InvalidRequestError
            If there is no such body, or nothing was predicted for that time.
        InvalidOptionError
            If there is no such origin.
        """
        return PredictedBody(self, name, self.at(time), origin)

    @property
    def bodies(self) -> tuple[PredictedBody, ...]:
        """All bodies at the horizon, in the scene's order."""
        return tuple(self.body(body.name) for body in self.scene.bodies)

    def trajectory(self, name: str, *, origin: Origin = "center_of_mass") -> Trajectory:
        """Return one body at all times, as arrays; the arguments are those of `body`."""
        return Trajectory.of([PredictedBody(self, name, snapshot, origin) for snapshot in self.snapshots])

    def probability(self, event: Event, *, time: float | None = None) -> Probability:
        """Estimate the probability of an event.

        Parameters
        ----------
        event : Event
            For example ``InRegion("cup", bin) & ~Touches("cup", "wall")``. It refers to states at the time
            and to contacts up to it.
        time : float, optional
            As in `at`.

        Returns
        -------
        Probability
            The interval is 0 to 1 for a propagator without samples if the event was not given to `predict`.

        Raises
        ------
        InvalidRequestError
            If the event is about something that is not in the scene, or there is no such time.
        """
        instance(event, Event, "event")
        event.check(self.scene, "event")
        return probabilities.probability(self.scene, self.initial, self.at(time), event)

    def contact_time(self, event: Touches, *, time: float | None = None) -> ContactTime | None:
        """Return the time of the first contact, given that there is one; None if no outcome has a contact.

        Arguments and errors are those of `probability`.
        """
        instance(event, Touches, "event")
        event.check(self.scene, "event")
        return probabilities.contact_time(self.scene, self.initial, self.at(time), event)

    def contacts(self, *, time: float | None = None) -> np.ndarray:
        """Return the contacts of the simulated rollouts in the last step before a time.

        Parameters
        ----------
        time : float, optional
            As in `at`.

        Returns
        -------
        (n,) structured array
            Columns ``rollout``; ``first`` and ``second``, numbers of bodies, or of elements after all bodies;
            ``point`` in the middle of the gap [m] and ``normal`` from the first to the second, world frame;
            ``gap``, below zero for a depth [m]; ``impulse`` of the step on the second, world axes [N s].

        Raises
        ------
        NotSupportedError
            With the explicit integrator.
        InvalidRequestError
            If nothing was predicted for that time.
        """
        if self.scene.integrator == "explicit":
            raise NotSupportedError(
                "has no contacts as data; 'implicit' has", field="integrator", value=self.scene.integrator
            )
        return contact_table(self.scene, self.at(time).carry.contact_history)
