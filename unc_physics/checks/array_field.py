"""Types of dataclass fields that accept array-like values and hold arrays."""

from __future__ import annotations

from dataclasses import MISSING, field
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike

Given_contra = TypeVar("Given_contra", contravariant=True)
Kept_co = TypeVar("Kept_co", covariant=True)


class Converted(Protocol[Given_contra, Kept_co]):
    """Type of a field whose stored type, made by ``__post_init__``, differs from the assigned one."""

    def __get__(self, instance: object, owner: type | None = None, /) -> Kept_co: ...

    def __set__(self, instance: object, value: Given_contra, /) -> None: ...


Array = Converted[ArrayLike, np.ndarray]
#: Array-like value, or None.
MaybeArray = Converted[ArrayLike | None, np.ndarray | None]
#: Array-like value; None selects the class's default.
OptionalArray = Converted[ArrayLike | None, np.ndarray]
#: Number; None selects the class's default.
OptionalNumber = Converted[float | None, float]


def array_field(default: Any = MISSING) -> Any:
    """Return a dataclass field of one of these types; without a default it is required."""
    return field(default=default)
