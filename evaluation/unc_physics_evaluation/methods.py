"""What is compared, and how it is written and drawn: all propagators, limits and other engines."""

from __future__ import annotations

from typing import NamedTuple

from unc_physics.propagators.base import Propagator
from unc_physics.propagators.names import REFERENCE as MONTE_CARLO
from unc_physics.propagators.registry import PROPAGATORS, make_propagator

from .jobs import Job

FLOOR, GAUSSIAN = "floor", "gaussian"
OURS = "ours"
#: Propagators with other options than their own: the paper's sigma points go in all directions.
VARIANTS = {"sigma_points_full": ("sigma_points", {"points": "full"})}


class Look(NamedTuple):
    """How a method is written and drawn, in Okabe and Ito's colours for colour-blind readers."""

    label: str
    color: str
    marker: str = ""
    line: str = "-"


LOOKS = {name: Look(cls.label, cls.color, cls.marker) for name, cls in PROPAGATORS.items()} | {
    "sigma_points_full": Look("sigma points, full", "#56B4E9", "d"),
    GAUSSIAN: Look("best Gaussian", "#D55E00", line="--"),
    FLOOR: Look("floor", "#999999", line=":"),
    OURS: Look("unc_physics", PROPAGATORS[MONTE_CARLO].color, PROPAGATORS[MONTE_CARLO].marker),
    "pybullet": Look("PyBullet", "#8C6D31", "P"),
    "mujoco": Look("MuJoCo", "#7F3C8D", "X"),
}
_GREYS = {5: "#BDBDBD", 10: "#8C8C8C", 50: "#5A5A5A", 100: "#2B2B2B"}


def methods(job: Job) -> dict[str, Propagator]:
    """All propagators but Monte Carlo with their own options, then the variants."""
    made = {
        name: make_propagator(name, **({"seed": job.seed(name)} if "seed" in cls.options() else {}))
        for name, cls in PROPAGATORS.items()
        if name != MONTE_CARLO
    }
    return made | {name: make_propagator(of, **options) for name, (of, options) in VARIANTS.items()}


def label(method: str, samples: int | None = None) -> str:
    """A method's name for people."""
    if method == MONTE_CARLO and samples is not None:
        return f"MC-{samples}"
    return LOOKS[method].label if method in LOOKS else method.replace("_", " ")


def color(method: str, samples: int | None = None) -> str:
    """A method's colour; Monte Carlo with more samples is darker."""
    if method == MONTE_CARLO and samples in _GREYS:
        return _GREYS[samples]
    return LOOKS[method].color
