"""Jobs, the parts of a sweep: what a job computes determines its key and its seeds."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np


@dataclass(frozen=True)
class Job:
    """Part of an experiment that runs independently.

    Attributes
    ----------
    experiment : str
        Name of the experiment, a module in `experiments`.
    parameters : mapping of str to str, int or float
        Everything that the results depend on.
    cost : float
        Estimated time on one thread [s], for the order of jobs and the remaining time.
    alone : bool
        Whether no other job may run, because wall time on all threads is measured.
    """

    experiment: str
    parameters: Mapping[str, str | int | float]
    cost: float = 1.0
    alone: bool = False

    @property
    def key(self) -> str:
        """Unique text of the job within its experiment."""
        return " ".join(f"{name}={value}" for name, value in self.parameters.items())

    def seed(self, purpose: str) -> int:
        """Return a seed of 32 bits for one purpose within this job."""
        digest = hashlib.sha256(f"{self.experiment} {self.key} {purpose}".encode()).digest()
        return int.from_bytes(digest[:4], "little")


class Row(NamedTuple):
    """One measured value.

    Attributes
    ----------
    method : str
        Name of a propagator or of another method (`methods`).
    quantity, unit : str
    value : float
    samples : int or None
        Number of Monte Carlo's samples.
    replicate : int
        Number of the repeated measurement.
    seed : int or None
        Seed of the random numbers; None without any.
    """

    method: str
    quantity: str
    unit: str
    value: float
    samples: int | None = None
    replicate: int = 0
    seed: int | None = None


@dataclass(frozen=True)
class Outcome:
    """Result of a job: rows, and named arrays for pictures."""

    rows: list[Row]
    arrays: dict[str, np.ndarray] = field(default_factory=dict)


@dataclass(frozen=True)
class Settings:
    """A user's options for a sweep.

    Attributes
    ----------
    quick : bool
        Whether to run a reduced sweep of minutes.
    seed : int
        Sweeps with different seeds are independent.
    meshes : str, optional
        Folder of meshes that are not in the repository.
    data : str, optional
        Folder of recorded motions instead of the package's (`recorded_sets`).
    methods : tuple of str
        Propagators that the experiment on the paper compares, too (`methods.method_of`).
    """

    quick: bool = False
    seed: int = 0
    meshes: str | None = None
    data: str | None = None
    methods: tuple[str, ...] = ()

    def parameters(self, **parameters) -> dict:
        """Return a job's parameters, including those that all jobs share."""
        # the seeds of published results depend on this key
        return {**parameters, "distance": "exact", "base_seed": self.seed}
