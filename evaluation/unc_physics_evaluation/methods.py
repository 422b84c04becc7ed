"""Compared methods with labels and colours: all propagators, limits and other engines."""

from __future__ import annotations

from typing import NamedTuple

from unc_physics.propagators.base import Propagator
from unc_physics.propagators.names import REFERENCE as MONTE_CARLO
from unc_physics.propagators.registry import PROPAGATORS, propagator_from_texts

from .jobs import Job

FLOOR, GAUSSIAN, MARGINAL, STILL = "floor", "gaussian", "marginal", "still"
OURS = "ours"
#: The paper's sigma points, which go in all directions.
FULL_POINTS = "sigma_points points=full"


class Look(NamedTuple):
    """Label and line style of a method, in Okabe and Ito's colours for colour-blind readers."""

    label: str
    color: str
    marker: str = ""
    line: str = "-"


_MONTE_CARLO = Look("Monte Carlo", "#000000", "o")
#: Of propagators of other packages, with their own names.
_OTHER_COLOR, _OTHER_MARKER = "#A6761D", "p"
LOOKS = {name: Look(name.replace("_", " "), _OTHER_COLOR, _OTHER_MARKER) for name in PROPAGATORS} | {
    "linearization": Look("linearization", "#0072B2", "s"),
    "surrogate": Look("surrogate", "#E69F00", "^"),
    "sigma_points": Look("sigma points", "#009E73", "D"),
    "local_sampling": Look("local sampling", "#CC79A7", "v"),
    MONTE_CARLO: _MONTE_CARLO,
    "cloud": Look("cloud", "#CC3311", "*"),
    "auto": Look("auto", "#882255", "P"),
    FULL_POINTS: Look("sigma points, full", "#56B4E9", "d"),
    GAUSSIAN: Look("best Gaussian", "#D55E00", line="--"),
    FLOOR: Look("floor", "#999999", line=":"),
    MARGINAL: Look("outcomes of others", "#E69F00", line=":"),
    STILL: Look("stays where it is", "#999999", line=":"),
    OURS: _MONTE_CARLO._replace(label="unc_physics"),
    "pybullet": Look("PyBullet", "#8C6D31", "P"),
    "mujoco": Look("MuJoCo", "#7F3C8D", "X"),
}
_GREYS = {5: "#BDBDBD", 10: "#8C8C8C", 50: "#5A5A5A", 100: "#2B2B2B"}


def method_of(text: str, job: Job | None = None) -> Propagator:
    """Return the propagator that a text names, with a job's seed if it takes one.

    Parameters
    ----------
    text : str
        Its name, and options as ``key=value``, parted by spaces: ``sigma_points points=full``.
    job : Job, optional

    Raises
    ------
    UnknownPropagatorError, InvalidOptionError, LimitExceededError
        If there is no such propagator, or an option does not fit.
    """
    name, *texts = text.split() or [""]
    options = dict(part.partition("=")[::2] for part in texts)
    seed = None if job is None or "seed" in options else job.seed(text)
    return propagator_from_texts(name, options, seed=seed)


def text_of(propagator: Propagator) -> str:
    """Return a propagator's name and the options that differ from their defaults, as for `method_of`."""
    defaults, own = propagator.options(), {}
    for name, default in defaults.items():
        value = getattr(propagator, name)
        if value != default and name != "seed":
            own[name] = f"{value:g}" if isinstance(value, float) else str(value).lower()
    return " ".join([propagator.name, *(f"{name}={value}" for name, value in own.items())])


def label(method: str, samples: int | None = None) -> str:
    """Return a method's label."""
    if method == MONTE_CARLO and samples is not None:
        return f"MC-{samples}"
    if samples is not None and method in PROPAGATORS:
        return f"{LOOKS[method].label}-{samples}"
    if method in LOOKS:
        return LOOKS[method].label
    name, _, options = method.partition(" ")
    return f"{label(name)}, {options}" if options else name.replace("_", " ")


def color(method: str, samples: int | None = None) -> str:
    """Return a method's colour; Monte Carlo with more samples is darker."""
    if method == MONTE_CARLO and samples in _GREYS:
        return _GREYS[samples]
    return look(method).color


def look(method: str) -> Look:
    """Return how a method is drawn: dashed as others of its name, if it is not listed with its options."""
    return LOOKS.get(method) or LOOKS[method.partition(" ")[0]]._replace(line="--")
