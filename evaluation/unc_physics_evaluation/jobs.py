"""Jobs: the pieces of a sweep, known and seeded by what they compute, wherever they run."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np


@dataclass(frozen=True)
class Job:
    """A piece of an experiment that runs by itself.

    Attributes
    ----------
    experiment : str
        Name of the experiment, a module in `experiments`.
    parameters : mapping of str to str, int or float
        All that the results depend on.
    cost : float
        About how long it takes on one thread [s]; for the order of work and the time left only.
    alone : bool
        Whether it measures wall time on all threads, so that nothing else should run.
    """

    experiment: str
    parameters: Mapping[str, str | int | float]
    cost: float = 1.0
    alone: bool = False

    @property
    def key(self) -> str:
        """Text that tells the job from every other of its experiment."""
        return " ".join(f"{name}={value}" for name, value in self.parameters.items())

    def seed(self, purpose: str) -> int:
        """A seed of 32 bits for one purpose within this job."""
        digest = hashlib.sha256(f"{self.experiment} {self.key} {purpose}".encode()).digest()
        return int.from_bytes(digest[:4], "little")


class Row(NamedTuple):
    """One figure.

    Attributes
    ----------
    method : str
        Name of a propagator or of what is compared with it (`methods`).
    quantity, unit : str
    value : float
    samples : int or None
        Of Monte Carlo.
    replicate : int
        Which of several measurements of the same thing.
    seed : int or None
        Of the draws behind it; None where nothing is drawn.
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
    """What a job yields: rows, and arrays by name where a picture needs them."""

    rows: list[Row]
    arrays: dict[str, np.ndarray] = field(default_factory=dict)


@dataclass(frozen=True)
class Settings:
    """What a user can choose about a sweep.

    Attributes
    ----------
    quick : bool
        Whether a first look in two minutes is wanted, in place of results.
    seed : int
        A sweep with another one is independent.
    meshes : str, optional
        Folder of the meshes that are no part of the repository.
    data : str, optional
        Folder of recorded motions, in place of the package's (`recorded_sets`).
    """

    quick: bool = False
    seed: int = 0
    meshes: str | None = None
    data: str | None = None

    def parameters(self, **parameters) -> dict:
        """A job's parameters, those that all jobs share included."""
        # the seeds of published results depend on this key
        return {**parameters, "distance": "exact", "base_seed": self.seed}
