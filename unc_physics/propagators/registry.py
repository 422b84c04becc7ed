"""The propagators by name; a new one is a new file and a line here."""

from __future__ import annotations

from typing import Any

from ..checks.errors import InvalidOptionError, UnknownPropagatorError
from .base import Propagator
from .linearization import Linearization
from .local_sampling import LocalSampling
from .monte_carlo import MonteCarlo
from .sigma_points import SigmaPoints
from .surrogate import Surrogate

PROPAGATORS: dict[str, type[Propagator]] = {cls.name: cls for cls in (Linearization, Surrogate, SigmaPoints, LocalSampling, MonteCarlo)}

_KINDS = {int: "an integer", float: "a number"}


def make_propagator(name: str, **options: Any) -> Propagator:
    """A propagator by its name, with some of its options set.

    Raises
    ------
    UnknownPropagatorError
        If there is none of that name.
    InvalidOptionError
        If it has no such option, or the option cannot take the value.
    """
    if name not in PROPAGATORS:
        raise UnknownPropagatorError(f"must be one of {', '.join(PROPAGATORS)}", field="propagator", value=name)
    cls = PROPAGATORS[name]
    known = cls.options()
    for option, value in options.items():
        if option not in known:
            takes = f"its options are {', '.join(known)}" if known else "it takes none"
            raise InvalidOptionError(f"is no option of {name}; {takes}", field=option, value=value)
    return cls(**options)


def propagator_from_texts(name: str, options: dict[str, Any], samples: int | None = None, seed: int | None = None) -> Propagator:
    """A propagator from options whose values may be texts; samples and seed are left out where it takes none.

    Raises
    ------
    UnknownPropagatorError, InvalidOptionError, LimitExceededError
    """
    options = dict(options)
    known = PROPAGATORS[name].options() if name in PROPAGATORS else {}
    for key, value in (("samples", samples), ("seed", seed)):
        if value is not None and key in known:
            options.setdefault(key, value)
    for key, value in options.items():
        kind = type(known.get(key))
        if kind in (int, float) and isinstance(value, str):
            try:
                options[key] = kind(value)
            except ValueError:
                raise InvalidOptionError(f"must be {_KINDS[kind]}", field=key, value=value) from None
    return make_propagator(name, **options)
