"""The experiments, one module each.

A module defines

``TITLE`` : str
``jobs(settings)`` : list of Job
``missing(settings)`` : list of str, optional
    What is omitted because something is not installed, and how to get it.
``run(job)`` : Outcome
``report(results)`` : str
    Markdown from the rows of finished jobs; draws its figures.
``verdict(results)`` : str, optional
    A sentence on the result.
"""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

from unc_physics.checks.errors import InvalidOptionError

#: Experiments that run by default.
DEFAULT = ("paper", "engines", "head_to_head", "orders", "stability", "covariances", "regions", "calibration")
#: Experiments that take long alone on the machine, or need more than this package.
BY_NAME = (
    "scenes_at_random",
    "tracking",
    "reality",
    "packing",
    "latency",
    "releases",
    "same_bits",
    "distances",
)
NAMES = DEFAULT + BY_NAME


def experiment(name: str) -> ModuleType:
    """Return the module of an experiment.

    Raises
    ------
    InvalidOptionError
        If there is no experiment of this name.
    """
    if name not in NAMES:
        raise InvalidOptionError(f"must be one of {', '.join(NAMES)}", field="experiment", value=name)
    return import_module(f".{name}", __name__)
