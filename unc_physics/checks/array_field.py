"""Fields of dataclasses that are given one type and hold another: anything like an array becomes an array."""

from __future__ import annotations

from dataclasses import MISSING, field
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike

Given_contra = TypeVar("Given_contra", contravariant=True)
Kept_co = TypeVar("Kept_co", covariant=True)


class Converted(Protocol[Given_contra, Kept_co]):
    """Tells type checkers that a field is given one type and holds another, made by ``__post_init__``."""

    def __get__(self, instance: object, owner: type | None = None, /) -> Kept_co: ...

    def __set__(self, instance: object, value: Given_contra, /) -> None: ...


Array = Converted[ArrayLike, np.ndarray]
#: As `Array`, or None.
MaybeArray = Converted[ArrayLike | None, np.ndarray | None]
#: As `Array`; without one, the class chooses.
OptionalArray = Converted[ArrayLike | None, np.ndarray]
#: A number; without one, the class chooses.
OptionalNumber = Converted[float | None, float]


def array_field(default: Any = MISSING) -> Any:
    """A dataclass's field of one of these types; required where no default is given."""
    return field(default=default)
