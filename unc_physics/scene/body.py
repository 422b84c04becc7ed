"""A rigid body: a sphere-packed shape with a mass and a surface; validated and frozen."""

from __future__ import annotations

import weakref
from dataclasses import dataclass

import numpy as np

from ..checks.array_field import Array, MaybeArray, OptionalNumber, array_field
from ..checks.errors import InvalidMassError, InvalidModelError, InvalidRequestError
from ..checks.validation import array, flag, non_negative, numbers, positive
from ..geometry.packing_file import SpherePacking, check_inertia
from ..physics import sphere_tree
from ..physics.hull import hull_spheres
from .materials import Surface, check_surface

#: Lightest and heaviest mass [kg]: beyond, numbers run out.
MASSES = 1e-50, 1e50
_trees, _hulls = weakref.WeakKeyDictionary(), weakref.WeakKeyDictionary()


def known_mass(mass: float | None, model: SpherePacking, fixed: bool, field: str) -> float:
    """The mass that a body has [kg]: the one given, or its model's own.

    A fixed body needs none; where nothing is known it is 1, which has no effect.

    Raises
    ------
    InvalidMassError, NotFiniteError
        If the mass is not a positive finite number, or is not given where the model has none.
    """
    if mass is not None:
        mass = positive(mass, field, InvalidMassError)
        if not MASSES[0] <= mass <= MASSES[1]:
            raise InvalidMassError(
                f"must be between {MASSES[0]:g} and {MASSES[1]:g} kg", field=field, value=mass
            )
        return mass
    if model.mass is not None:
        return model.mass
    if fixed:
        return 1.0
    raise InvalidMassError(f"must be given, since model '{model.name}' has no mass of its own", field=field)


@dataclass(frozen=True, eq=False)
class RigidBody(Surface):
    """A rigid body: a sphere-packed shape with a mass; friction and restitution are those of a `Surface`.

    Attributes
    ----------
    name : str
        Unique in its scene.
    model : SpherePacking
        Shape and inertia per unit mass; body frame with the centre of mass (COM) at the origin.
    mass : float
        [kg], positive; by default the model's own. It has no effect on a fixed body, which needs none.
    fixed : bool
        Whether the body never moves.
    mass_std : float
        Standard deviation of the mass [kg]; the inertia follows the mass. It varies as ``mass exp(z mass_std
        / mass)`` with a standard normal z, so that it stays positive.
    center_of_mass_std : (3,) array
        Standard deviations of the COM's place in the body, about the model's, body axes [m]; one number
        stands for three. States and beliefs stay those of the model's COM; the inertia about the COM stays
        the model's.
    at_rest : bool
        Whether the body stands still at time 0, on what is below it: before a prediction begins, it is
        settled there, so that its height and tilt come from contact, whatever the belief says of them. Its
        mean velocities must be zero, and their covariance counts as zero. Needs the implicit integrator and
        gravity; not for a fixed body.

    inertia : (3, 3) array, optional
        Inertia about the COM per unit mass, body axes [m^2]; by default the model's. Three numbers are the
        principal moments along the body's axes, one number stands for three equal ones.

    Raises
    ------
    InvalidMassError
        If the mass is not a positive finite number, or is not given where the model has none.
    InvalidRequestError, NotFiniteError
        For anything else out of range.
    """

    name: str
    model: SpherePacking
    mass: OptionalNumber = array_field(None)
    fixed: bool = False
    mass_std: float = 0.0
    center_of_mass_std: Array = array_field(0.0)
    at_rest: bool = False
    inertia: MaybeArray = array_field(None)

    def __post_init__(self):
        if not isinstance(self.name, str) or not self.name:
            raise InvalidRequestError("must be a non-empty text", field="name", value=self.name)
        if not isinstance(self.model, SpherePacking):
            raise InvalidRequestError(
                "must be a SpherePacking", field=f"model of body '{self.name}'", value=self.model
            )
        check_surface(self, f" of body '{self.name}'")
        field = f"center_of_mass_std of body '{self.name}'"
        std = numbers(self.center_of_mass_std, field)
        std = array(np.full(3, std) if std.ndim == 0 else std, (3,), field)
        non_negative(float(std.min()), field)
        checked = {
            "fixed": flag(self.fixed, f"fixed of body '{self.name}'"),
            "mass": known_mass(self.mass, self.model, self.fixed, f"mass of body '{self.name}'"),
            "mass_std": non_negative(self.mass_std, f"mass_std of body '{self.name}'", InvalidMassError),
            "center_of_mass_std": std,
            "at_rest": flag(self.at_rest, f"at_rest of body '{self.name}'"),
        }
        if self.inertia is not None:
            checked["inertia"] = _checked_inertia(
                self.inertia, self.model.bounding_radius, f"inertia of body '{self.name}'"
            )
        if checked["mass_std"] > checked["mass"]:
            raise InvalidMassError(
                "must not exceed the mass", field=f"mass_std of body '{self.name}'", value=self.mass_std
            )
        if checked["at_rest"] and checked["fixed"]:
            raise InvalidRequestError(
                "must be false for a fixed body", field=f"at_rest of body '{self.name}'", value=True
            )
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    @property
    def unit_inertia(self) -> np.ndarray:
        """(3, 3): inertia about the COM per unit mass, body axes [m^2]: the one given, or the model's."""
        return self.model.inertia if self.inertia is None else self.inertia


def _checked_inertia(value, reach, field):
    """An inertia tensor (3, 3) from itself, its three diagonal entries, or one number for these."""
    found = numbers(value, field)
    if found.ndim < 2:
        found = np.diag(array(np.full(3, found) if found.ndim == 0 else found, (3,), field))
    found = array(found, (3, 3), field)
    try:
        check_inertia(found, reach)
    except InvalidModelError as error:
        raise InvalidRequestError(error.problem, field=field, value=error.value) from None
    return found


def tree_of(model: SpherePacking):
    """Sphere tree of a packing (`physics.sphere_tree.build`), built once and kept as long as the packing."""
    if model not in _trees:
        _trees[model] = sphere_tree.build(np.array(model.centers), np.array(model.radii))
    return _trees[model]


def hull_of(model: SpherePacking) -> np.ndarray:
    """Spheres of a packing that can touch a plane (`physics.hull.hull_spheres`), kept as long as it."""
    if model not in _hulls:
        _hulls[model] = hull_spheres(np.array(model.centers), np.array(model.radii))
    return _hulls[model]
