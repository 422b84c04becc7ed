"""Options of propagators: dataclass fields with type, limits and meaning."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from ..checks.errors import InvalidOptionError, LimitExceededError
from ..checks.validation import integer, number

_KINDS = {int: "an integer", float: "a number", bool: "true or false", str: "a text"}
_TRUTHS = {"true": True, "false": False}


@dataclass(frozen=True)
class Option:
    """One option of a propagator.

    Attributes
    ----------
    name : str
    default : int, float, bool or str
        Its type is the type of the option.
    description : str
        A few words without a full stop.
    choices : tuple of str
        All values of a text with few values.
    low, high : number, optional
        Limits of a number, inclusive.
    positive : bool
        Whether a number must be above 0.
    """

    name: str
    default: Any
    description: str = ""
    choices: tuple[str, ...] = ()
    low: float | None = None
    high: float | None = None
    positive: bool = False

    @property
    def kind(self) -> type:
        """Type of its values."""
        return type(self.default)

    def from_text(self, text: str) -> Any:
        """Return its value from a text; raises `InvalidOptionError`."""
        try:
            return _TRUTHS[text.lower()] if self.kind is bool else self.kind(text)
        except (ValueError, KeyError):
            raise InvalidOptionError(f"must be {_KINDS[self.kind]}", field=self.name, value=text) from None

    def checked(self, value: Any) -> Any:
        """Return the value if it is valid; raise `InvalidOptionError` or `LimitExceededError` otherwise."""
        error = InvalidOptionError
        if self.kind is int:
            value = integer(value, self.name, low=-math.inf if self.low is None else self.low, error=error)
        elif self.kind is float:
            value = number(value, self.name, error)
            if self.low is not None and value < self.low:
                raise error(f"must be at least {self.low:g}", field=self.name, value=value)
        elif not isinstance(value, self.kind):
            raise error(f"must be {_KINDS[self.kind]}", field=self.name, value=value)
        if self.positive and value <= 0:
            raise error("must be positive", field=self.name, value=value)
        if self.high is not None and value > self.high:
            raise LimitExceededError(f"must be at most {self.high}", field=self.name, value=value)
        if self.choices and value not in self.choices:
            raise error(f"must be {' or '.join(map(repr, self.choices))}", field=self.name, value=value)
        return value

    def as_text(self) -> str:
        """Return its description, choices and default in one line."""
        takes = f" ({' or '.join(self.choices)})" if self.choices else ""
        return f"{self.description}{takes}; default {self.default}"


def option(default: Any, description: str, **limits: Any) -> Any:
    """Return a dataclass field of a propagator that is an option, with these attributes of `Option`."""
    return field(default=default, metadata={"option": Option("", default, description, **limits)})
