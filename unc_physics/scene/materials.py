"""What surfaces are made of: friction and restitution of bodies, of environment elements, and of a scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..checks.errors import InvalidOptionError, InvalidRequestError, UncPhysicsError
from ..checks.validation import non_negative, share

#: What the explicit step does of itself, so that it may be said: elastic, overlap as it is, none of the rest.
_EXPLICIT = {
    "friction": 0.0,
    "restitution": 1.0,
    "friction_std": 0.0,
    "restitution_std": 0.0,
    "sleep": False,
    "at_rest": False,
    "impact_direction_std": 0.0,
    "impact_point_std": 0.0,
    "impact_friction_std": 0.0,
    "surface_tilt_std": 0.0,
    "torsional_friction": 0.0,
    "attached_to": None,
    "overlap": "keep",
}
#: Restitution of each integrator where none is named.
DEFAULT_RESTITUTION = {"explicit": 1.0, "implicit": 0.0}


class Materials(NamedTuple):
    """Friction and restitution of a scene's B bodies, then of its E elements: their own, or the scene's.

    A contact has the geometric mean of its two partners' values.

    Attributes
    ----------
    friction : (B + E,) float64
        Coulomb's coefficient.
    restitution : (B + E,) float64
        From 0, no rebound, to 1, elastic.
    """

    friction: np.ndarray
    restitution: np.ndarray


@dataclass(frozen=True, eq=False, kw_only=True)
class Surface:
    """What the contacts of a body, or of an element of the environment, are like.

    Attributes
    ----------
    friction : float, optional
        Coefficient of Coulomb friction; None takes the scene's.
    friction_std : float
        Its standard deviation; it varies as ``friction exp(z friction_std / friction)``, z standard normal.
    restitution : float, optional
        Coefficient of restitution, 0 to 1; None takes the scene's.
    restitution_std : float
        Its standard deviation; it varies as ``restitution + z restitution_std``, cut off at 0 and 1.
    torsional_friction : float, optional
        Most moment against a contact's spin about its normal, over the normal force [m]: about two thirds of
        the radius of the patch that touches, times friction. A contact has the geometric mean of its two
        partners' values, or the one that there is. Needs the implicit integrator.
    """

    friction: float | None = None
    friction_std: float = 0.0
    restitution: float | None = None
    restitution_std: float = 0.0
    torsional_friction: float | None = None


def check_surface(thing, of="", error: type[UncPhysicsError] = InvalidRequestError) -> None:
    """Check the numbers of a `Surface`, or of a scene, and make them floats.

    Parameters
    ----------
    thing : frozen dataclass
    of : str
        What errors write behind the field's name.
    error : type of UncPhysicsError

    Raises
    ------
    UncPhysicsError
        Of the given type, or `NotFiniteError`.
    """
    for name, check in (("friction", non_negative), ("restitution", share)):
        value = getattr(thing, name)
        if value is not None:
            value = check(value, f"{name}{of}", error)
        field = f"{name}_std{of}"
        std = non_negative(getattr(thing, f"{name}_std"), field, error)
        if std > 0.0:
            if value is None or (name == "friction" and value == 0.0):
                raise error(f"needs {name} beside it, whose standard deviation it is", field=field, value=std)
            limit = value if name == "friction" else 1.0
            if std > limit:
                raise error(f"must not exceed {limit:.6g}", field=field, value=std)
        object.__setattr__(thing, name, value)
        object.__setattr__(thing, f"{name}_std", std)
    if isinstance(thing, Surface) and thing.torsional_friction is not None:
        value = non_negative(thing.torsional_friction, f"torsional_friction{of}", error)
        object.__setattr__(thing, "torsional_friction", value)


def refuse_with_explicit(thing, place="") -> None:
    """Raise `InvalidOptionError` if a surface, a scene or settings ask for what the explicit step cannot do.

    Parameters
    ----------
    thing : object
        Those of its fields count that are named here, as far as it has them.
    place : str
        What errors write before the field's name.
    """
    for name, own in _EXPLICIT.items():
        value = getattr(thing, name, None)
        if value is not None and value != own:
            only = f"{own:g}" if isinstance(own, float) else str(own).lower()
            raise InvalidOptionError(
                "needs 'integrator: implicit', which the preset 'everyday' has ('physics: everyday' in a"
                f" file); with 'explicit' it must be {only} or absent",
                field=f"{place}{name}",
                value=value,
            )


def combined(shared, surfaces, restitution) -> Materials:
    """The materials of some surfaces: their own, or else the shared ones.

    Parameters
    ----------
    shared : object
        Its friction and restitution count, where they are not None.
    surfaces : sequence of Surface
    restitution : float
        Where there is neither; of friction, that is 0.
    """

    def of_all(name, absent):
        last = _first(getattr(shared, name), absent)
        return np.array([_first(getattr(surface, name), last) for surface in surfaces])

    return Materials(of_all("friction", 0.0), of_all("restitution", restitution))


def varied(name, value, std, z) -> float:
    """A friction or a restitution, ``z`` standard deviations from its value."""
    if name == "friction":
        return float(value * np.exp(z * std / value))
    return min(max(value + z * std, 0.0), 1.0)


def _first(*values):
    """The first of some values that is not None."""
    return next(value for value in values if value is not None)
