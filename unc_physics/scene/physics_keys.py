"""Keys of a scene's physics and their checks, for `Scene`, scene files, and the node."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

from ..checks.errors import InvalidHorizonError, InvalidOptionError, LimitExceededError
from ..checks.names import one_of
from ..checks.validation import array, flag, non_negative, positive, share

#: Integrators: the paper's explicit step of spheres, and the one of exact shapes that friction and rest need.
INTEGRATORS = ("explicit", "implicit")
_SUCCESSORS = {"robust": "implicit"}
#: Treatments of initial overlap.
OVERLAPS = ("project", "reject", "keep")
_MOST_GRAVITY = 1e6  # m/s^2 along each axis, as in centrifuges


class PhysicsKey(NamedTuple):
    """Key of the physics; the field of the same name in `Scene` holds the default."""

    #: takes a value and the field's name; returns the value to keep, or raises an `UncPhysicsError`
    check: Callable[[Any, str], Any]
    meaning: str  # description with unit, for users
    law: bool = False  # whether null disables the law; otherwise null means unset


#: Longest time step; longer ones are taken for a number of steps a second [s].
LONGEST_STEP = 0.25


def check_integrator(name: Any, field: str = "integrator") -> str:
    """Return the name, or raise `InvalidOptionError` if it is not an integrator."""
    if isinstance(name, str) and name in _SUCCESSORS:
        raise InvalidOptionError(
            f"must be '{_SUCCESSORS[name]}' now, which has taken the place of '{name}'",
            field=field,
            value=name,
        )
    return _one_of(INTEGRATORS, name, field)


def _one_of(choices, name, field):
    if not isinstance(name, str) or name not in choices:
        raise InvalidOptionError(one_of(name, choices), field=field, value=name)
    return name


def _time_step(value, field):
    step = positive(value, field, InvalidHorizonError)
    if step > LONGEST_STEP:
        rate = step if step > 1.0 else 240.0
        raise InvalidHorizonError(
            f"is in seconds and must be at most {LONGEST_STEP:g}; for {rate:g} steps a second write"
            f" {1.0 / rate:.4g}",
            field=field,
            value=value,
        )
    return step


def _gravity(value, field):
    gravity = array(value, (3,), field)
    if abs(gravity).max() > _MOST_GRAVITY:
        raise LimitExceededError(
            f"must be at most {_MOST_GRAVITY:.0f} m/s^2 along each axis", field=field, value=gravity.tolist()
        )
    return gravity


#: All keys of the physics.
PHYSICS_KEYS = {
    "dt": PhysicsKey(_time_step, "Time step [s]."),
    "stiffness": PhysicsKey(
        non_negative,
        "Stiffness of contacts, force per overlap volume [N/m^3], at least 0, with 'explicit' only; 'auto':"
        " at which no body presses deeper into another than 5 % of its largest sphere's radius.",
    ),
    "damping": PhysicsKey(non_negative, "Decay rate of all velocities [1/s].", law=True),
    "friction": PhysicsKey(
        non_negative,
        "Coefficient of Coulomb friction of all contacts; 0: none, as 'explicit' needs.",
        law=True,
    ),
    "restitution": PhysicsKey(
        share, "Coefficient of restitution of all contacts; 1: elastic, as 'explicit' needs.", law=True
    ),
    "rolling_friction": PhysicsKey(
        non_negative,
        "Rolling friction of all contacts: largest moment against rolling per normal force [m]; needs"
        " 'implicit'.",
        law=True,
    ),
    "impact_friction_speed": PhysicsKey(
        positive,
        "Closing speed at which friction of an impact is half of that of sliding [m/s]; null: it does not"
        " depend on the speed.",
        law=True,
    ),
    "stiffness_std": PhysicsKey(non_negative, "Standard deviation of the stiffness [N/m^3]."),
    "friction_std": PhysicsKey(non_negative, "Standard deviation of the friction."),
    "restitution_std": PhysicsKey(non_negative, "Standard deviation of the restitution."),
    "gravity_direction_std": PhysicsKey(
        non_negative, "Standard deviation of gravity's tilts about each of two axes across it [rad]."
    ),
    "impact_direction_std": PhysicsKey(
        non_negative,
        "Standard deviation of the turn of an impact's impulse about each axis [rad], drawn anew at each"
        " impact, by propagators that draw samples.",
    ),
    "impact_point_std": PhysicsKey(
        non_negative,
        "Standard deviation of the shift along the surface of where an impact acts [m], drawn likewise.",
    ),
    "impact_friction_std": PhysicsKey(
        non_negative,
        "Standard deviation of the factor of friction in an impact (of its logarithm), drawn likewise.",
    ),
    "gyroscopic": PhysicsKey(
        flag,
        "Whether turning bodies keep their angular momentum; otherwise their angular velocity, as in the"
        " paper.",
        law=True,
    ),
    "sleep": PhysicsKey(
        flag, "Whether what rests is not computed until something pushes it; not with 'explicit'.", law=True
    ),
    "gravity": PhysicsKey(_gravity, "Gravity in the world frame, 3 numbers [m/s^2].", law=True),
    "integrator": PhysicsKey(
        check_integrator,
        "How steps are taken: as in the paper, with penalty forces of spheres ('explicit'), or with contacts"
        " of exact shapes that are solved for, with friction and rest ('implicit').",
    ),
    "overlap": PhysicsKey(
        partial(_one_of, OVERLAPS), f"What becomes of overlap at the start: {', '.join(OVERLAPS)}."
    ),
}
