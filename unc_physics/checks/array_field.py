"""Fields of dataclasses that are given anything like an array, and hold an array."""

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
#: As `Array`; without one, the class chooses.
OptionalArray = Converted[ArrayLike | None, np.ndarray]


def array_field(default: Any = MISSING) -> Any:
    """A dataclass's field of type `Array`; required where no default is given."""
    return field(default=default)
