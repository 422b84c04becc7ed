"""Friction and restitution of bodies, of environment elements, and of a scene."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..checks.errors import InvalidOptionError, InvalidRequestError, UncPhysicsError
from ..checks.names import one_of
from ..checks.validation import non_negative, share
from .material_table import MATERIALS

#: Values of the explicit step, which may be given explicitly: elastic contacts, overlap kept, no other law.
_EXPLICIT = {
    "material": None,  # first, as its friction and restitution were not given
    "friction": 0.0,
    "restitution": 1.0,
    "friction_std": 0.0,
    "restitution_std": 0.0,
    "sleep": False,
    "at_rest": False,
    "impact_friction_speed": None,
    "impact_direction_std": 0.0,
    "impact_point_std": 0.0,
    "impact_friction_std": 0.0,
    "surface_tilt_std": 0.0,
    "torsional_friction": 0.0,
    "rolling_friction": 0.0,
    "pairs": (),
    "attached_to": None,
    "overlap": "keep",
}
#: Standard deviation of a surface over that of a contact of two such surfaces, as a contact has their mean.
SURFACE_OF_CONTACT = math.sqrt(2.0)
#: Restitution of each integrator if none is given.
DEFAULT_RESTITUTION = {"explicit": 1.0, "implicit": 0.0}


class Materials(NamedTuple):
    """Friction and restitution of a scene's B bodies, then of its E elements.

    Surfaces without their own value have the scene's. A contact has the geometric mean of its two partners'
    values.
    """

    friction: np.ndarray  # (B + E,) float64: coefficient of Coulomb friction
    restitution: np.ndarray  # (B + E,) float64: coefficient of restitution, from 0, no rebound, to 1, elastic


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Surface:
    """Contact properties of a body or of an element of the environment.

    Attributes
    ----------
    friction : float, optional
        Coefficient of Coulomb friction; None takes the scene's.
    friction_std : float
        Standard deviation; friction is ``friction exp(z friction_std / friction)`` with z standard normal.
    restitution : float, optional
        Coefficient of restitution, 0 to 1; None takes the scene's.
    restitution_std : float
        Standard deviation; restitution is ``restitution + z restitution_std``, clipped to [0, 1].
    torsional_friction : float, optional
        Largest moment about the contact normal per normal force [m]: about two thirds of the radius of the
        contact patch times friction. A contact has the geometric mean of its partners' values, or the only
        one given. Needs the implicit integrator.
    rolling_friction : float, optional
        Largest moment against rolling per normal force [m]; None takes the scene's. A contact has the
        geometric mean of its partners' values. Acts where one of the surfaces is round. Needs the implicit
        integrator.
    material : str, optional
        Name in `material_table.MATERIALS`. Its friction and restitution, with their standard deviations,
        replace those that are not given. The table's standard deviations are those of a contact of two such
        surfaces, so that each surface has `SURFACE_OF_CONTACT` times as much. Needs the implicit integrator.
    """

    friction: float | None = None
    friction_std: float = 0.0
    restitution: float | None = None
    restitution_std: float = 0.0
    torsional_friction: float | None = None
    rolling_friction: float | None = None
    material: str | None = None


def check_surface(thing, of="", error: type[UncPhysicsError] = InvalidRequestError) -> None:
    """Check the numbers of a `Surface` or of a scene, and convert them to floats.

    ``of`` ends the field's name in errors, which are of the type ``error``, or `NotFiniteError`.
    """
    material = getattr(thing, "material", None)
    if material is not None:
        if not isinstance(material, str) or material not in MATERIALS:
            raise error(one_of(material, MATERIALS), field=f"material{of}", value=material)
        material = MATERIALS[material]
    for name, check in (("friction", non_negative), ("restitution", share)):
        value, std = getattr(thing, name), getattr(thing, f"{name}_std")
        field = f"{name}_std{of}"
        if value is not None:
            value = check(value, f"{name}{of}", error)
        std = non_negative(std, field, error)
        if value is None and material is not None:
            value, std = getattr(material, name), std or SURFACE_OF_CONTACT * getattr(material, f"{name}_std")
        if std > 0.0:
            if value is None or (name == "friction" and value == 0.0):
                raise error(f"needs {name} beside it, whose standard deviation it is", field=field, value=std)
            limit = value if name == "friction" else 1.0
            if std > limit:
                raise error(f"must not exceed {limit:.6g}", field=field, value=std)
        object.__setattr__(thing, name, value)
        object.__setattr__(thing, f"{name}_std", std)
    for name in ("torsional_friction", "rolling_friction") if isinstance(thing, Surface) else ():
        if getattr(thing, name) is not None:
            object.__setattr__(thing, name, non_negative(getattr(thing, name), f"{name}{of}", error))


def refuse_with_explicit(thing, place="") -> None:
    """Raise `InvalidOptionError` if an option is set that the explicit step does not support.

    Of a surface, a scene or settings, only fields listed in `_EXPLICIT` are checked; ``place`` begins their
    names.
    """
    for name, own in _EXPLICIT.items():
        value = getattr(thing, name, None)
        if value is not None and value != own:
            only = f"{own:g}" if isinstance(own, float) else str(own).lower() if own != () else "empty"
            raise InvalidOptionError(
                "needs 'integrator: implicit', which the preset 'everyday' has ('physics: everyday' in a"
                f" file); with 'explicit' it must be {only} or absent",
                field=f"{place}{name}",
                value=value,
            )


def combined(shared, surfaces, restitution) -> Materials:
    """Return the materials of surfaces: their own values, or else those of ``shared``.

    The defaults are a friction of 0 and the given ``restitution``.
    """

    def of_all(name, absent):
        last = _first(getattr(shared, name), absent)
        return np.array([_first(getattr(surface, name), last) for surface in surfaces])

    return Materials(of_all("friction", 0.0), of_all("restitution", restitution))


def _first(*values):
    """Return the first of several values that is not None."""
    return next(value for value in values if value is not None)
