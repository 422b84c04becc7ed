"""The propagators by name; a new one is a new file and a line here."""

from __future__ import annotations

from typing import Any

from ..errors import InvalidOptionError, UnknownPropagatorError
from .base import Propagator
from .linearization import Linearization
from .local_sampling import LocalSampling
from .monte_carlo import MonteCarlo
from .sigma_points import SigmaPoints
from .surrogate import Surrogate

PROPAGATORS: dict[str, type[Propagator]] = {cls.name: cls for cls in (Linearization, Surrogate, SigmaPoints, LocalSampling, MonteCarlo)}


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
