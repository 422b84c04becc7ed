"""A prediction: snapshots of the bodies at one or more times, and each body by its name."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NoReturn, overload

import numpy as np

from ..checks.errors import InvalidRequestError, LimitExceededError, NotSupportedError
from ..checks.validation import instance, integer, number
from ..dynamics.contact_history import ContactHistory
from ..plots.scene_picture import draw_prediction
from ..propagators.base import Propagator
from ..scene.belief import Belief
from ..scene.marks import RESOLUTION
from ..scene.scene import Scene
from . import probability as probabilities
from .events import Event, Touches
from .predicted_body import Origin, PredictedBody, Trajectory
from .simulated_scene import left_out
from .snapshot import ContactTime, Probability, Snapshot
from .tables import FEW_LINES, as_dict, as_table, preformatted

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False)
class Prediction:
    """Snapshots at one or more times.

    ``prediction["mug"]`` is a body at the horizon, ``prediction[:3]`` the prediction that ends at the third
    time.

    Attributes
    ----------
    scene : Scene
        As it was simulated, with the stiffness that was chosen for it.
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
    """

    scene: Scene
    propagator: Propagator
    snapshots: tuple[Snapshot, ...]
    initial: Belief
    start: Belief
    wall_time: float
    asked: Scene | None = None
    points_history: ContactHistory | None = None

    def __str__(self) -> str:
        return as_table(self, FEW_LINES)

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
        return draw_prediction(self, title)

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
        """The propagator's persistent state at the end, a NamedTuple; None from a node."""
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
        NotSupportedError
            If the prediction comes from a node that was not asked for samples.
        """
        snapshot = self.at(time)
        if count is not None:
            count = integer(count, "count", low=1)
        own = snapshot.samples
        if own is None and snapshot.received is not None:
            raise NotSupportedError(
                "was not asked for; give the client's predict keep_samples, their number", field="samples"
            )
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
        NotSupportedError
            If the prediction comes from a node that was not asked for the event.
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
