"""Suggestions for unknown names."""

from __future__ import annotations

import difflib
import functools
import inspect
from collections.abc import Callable, Iterable
from dataclasses import fields
from typing import Any, TypeVar

from .errors import InvalidRequestError

#: What other simulators call a field, and its names here.
_ELSEWHERE = {
    "mu": "friction",
    "friction_coefficient": "friction",
    "bounce": "restitution",
    "coefficient_of_restitution": "restitution",
    "pos": "position",
    "xyz": "position",
    "quat": "orientation",
    "quaternion": "orientation",
    "rotation": "orientation",
    "velocity": "linear_velocity",
    "omega": "angular_velocity",
    **dict.fromkeys(("sphere", "box", "cylinder", "capsule"), "shape"),
}
#: Keys, arguments and options of earlier versions, and what to do instead.
_REMOVED = {
    "islands": "was removed in version 0.3: leave it out; for many bodies take 'cloud'",
    "--levels": "was removed in version 0.3: leave it out",
    "marker_cells": "was removed in version 0.3: leave it out",
    "max_flight_steps": "was removed in version 0.3: leave it out",
    "return_center_of_mass": "was removed in version 0.3: leave it out; states are those of the models'"
    " origins, and center_of_mass of ~/models is the vector from there to the centre of mass",
    "reduce": "was removed in version 0.3: leave it out; 'cloud' leaves common motion to a closed form",
    "smallest_first": "was removed in version 0.3: negate the score instead (~event)",
    "wait_for_compilation": "was removed in version 0.3: leave it out; all requests wait",
    "--workers": "was removed in version 0.3: --executor processes:N takes N processes",
}
Class = TypeVar("Class", bound=type)
Function = TypeVar("Function", bound=Callable[..., Any])


def hint(name: str, known: Iterable[str]) -> str:
    """Return the end of a sentence about an unknown name: the closest known name, or all if they are few."""
    known = list(known)
    if meant := suggestion(name, known):
        return meant
    shown = known[:10] + ["..."] * (len(known) > 10)
    return f"; there {'is' if len(known) == 1 else 'are'} {', '.join(shown)}" if known else "; there is none"


def suggestion(name: object, known: Iterable[str]) -> str:
    """Return the end of a sentence about an unknown name: the known name that is meant, or nothing."""
    known = list(known)
    if not isinstance(name, str):
        return ""
    close = [own for own in [_ELSEWHERE.get(name)] if own in known]
    close += difflib.get_close_matches(name[:50], known, n=1)
    return f"; did you mean '{close[0]}'?" if close else ""


def removed(name: str) -> str | None:
    """Return the problem of a key, argument or option of an earlier version; None of other names."""
    return _REMOVED.get(name)


def one_of(name: object, known: Iterable[str]) -> str:
    """Return the problem of an unknown name: the known names, and the closest of them."""
    known = list(known)
    return f"must be one of {', '.join(known)}{suggestion(name, known)}"


def with_named_arguments(cls: Class) -> Class:
    """Decorate a dataclass so that an unknown keyword is refused with the known one that is meant.

    Its ``repr`` shows the fields that differ from their defaults, unless the class has its own.
    """
    cls.__init__ = with_known_keywords(cls.__init__, lambda self: type(self).__name__)
    if cls.__repr__ is object.__repr__:
        cls.__repr__ = _given_fields  # pyright: ignore[reportAttributeAccessIssue]
    return cls


def _given_fields(self) -> str:
    shown = []
    for field in fields(self):
        value = getattr(self, field.name)
        if hasattr(value, "tolist"):
            if field.default is not None and (value == field.default).all():
                continue
            text = str(value.tolist()) if value.ndim < 2 else f"{value.shape} array"
        elif value == field.default:
            continue
        else:
            text = repr(value)
        shown.append(f"{field.name}={text}")
    return f"{type(self).__name__}({', '.join(shown)})"


def with_known_keywords(function: Function, name_of: Callable[..., str] | None = None) -> Function:
    """Decorate a function likewise; ``name_of`` returns its name in errors, from its first argument."""
    known = [name for name in inspect.signature(function).parameters if name != "self"]

    @functools.wraps(function)
    def checked(*values, **given):
        for name, value in given.items():
            if name not in known:
                owner = function.__name__ if name_of is None else name_of(values[0])
                problem = removed(name) or f"is no argument of {owner}{hint(name, known)}"
                raise InvalidRequestError(problem, field=name, value=value)
        return function(*values, **given)

    return checked  # pyright: ignore[reportReturnType]
