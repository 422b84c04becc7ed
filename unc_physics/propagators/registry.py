"""The propagators by name, those of other packages included (`names`)."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

from ..checks.errors import InvalidOptionError, UnknownPropagatorError
from ..checks.names import one_of, removed, suggestion
from ..checks.validation import instance
from .base import Propagator
from .names import BUILT_IN, entries

_left_out: dict[str, str] = {}  # propagators of other packages that cannot be imported, and why


def _load() -> dict[str, type[Propagator]]:
    """Import all propagators; warn about those of other packages that cannot be imported."""
    found = {}
    for name, entry in entries().items():
        try:
            cls = entry.load()
            if not (isinstance(cls, type) and issubclass(cls, Propagator) and cls.name == name):
                raise TypeError(f"{entry.value} is no subclass of Propagator whose name is '{name}'")
            cls()  # with its default options; refuses one that lacks a method
        except Exception as error:
            if name in BUILT_IN:
                raise
            _left_out[name] = str(error)
            warnings.warn(f"the propagator '{name}' is left out: {error}", RuntimeWarning, stacklevel=2)
        else:
            found[name] = cls
    return found


PROPAGATORS: dict[str, type[Propagator]] = _load()


def names_where(holds: Callable[[Propagator], bool], conjunction: str = "and") -> str:
    """Return the names of the propagators whose default instance satisfies a condition, as ``a, b and c``."""
    *most, last = [name for name, cls in PROPAGATORS.items() if holds(cls())]
    return f"{', '.join(most)} {conjunction} {last}" if most else last


def make_propagator(name: str, **options: Any) -> Propagator:
    """Return a propagator by its name, with some of its options set.

    Raises
    ------
    UnknownPropagatorError
        If no propagator has that name.
    InvalidOptionError
        If it has no such option, or the option cannot take the value.
    LimitExceededError
        If an option's value is above its limit.
    """
    return _made(name, options)


def _made(name, options):
    """Return a propagator; options of any name are allowed."""
    instance(name, str, "name")
    if name not in PROPAGATORS:
        why = f"; it was left out, since {_left_out[name]}" if name in _left_out else ""
        raise UnknownPropagatorError(f"{one_of(name, PROPAGATORS)}{why}", field="propagator", value=name)
    cls = PROPAGATORS[name]
    known = cls.options()
    for option, value in options.items():
        if option not in known:
            takes = f"its options are {', '.join(known)}" if known else "it takes none"
            problem = removed(option) or f"is no option of {name}; {takes}{suggestion(option, known)}"
            raise InvalidOptionError(problem, field=option, value=value)
    return cls(**options)


def propagator_from_texts(
    name: str, options: dict[str, Any], samples: int | None = None, seed: int | None = None
) -> Propagator:
    """Return a propagator from options that may be texts; samples and seed only where it takes them."""
    options = dict(options)
    known = (
        {}
        if name not in PROPAGATORS
        else {option.name: option for option in PROPAGATORS[name].described_options()}
    )
    for key, value in (("samples", samples), ("seed", seed)):
        if value is not None and key in known:
            if key in options:
                raise InvalidOptionError("is given twice, once as an option", field=key, value=value)
            options[key] = value
    for key, value in options.items():
        if key in known and isinstance(value, str):
            options[key] = known[key].from_text(value)
    return _made(name, options)
