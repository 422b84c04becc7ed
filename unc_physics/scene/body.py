"""Rigid bodies: a sphere-packed shape with a mass and a surface; validated and frozen."""

from __future__ import annotations

import hashlib
import math
import weakref
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..checks.array_field import Array, MaybeArray, OptionalNumber, array_field
from ..checks.errors import InvalidMassError, InvalidModelError, InvalidRequestError
from ..checks.names import with_named_arguments
from ..checks.validation import array, flag, instance, non_negative, number, numbers, positive
from ..physics.paper import sphere_tree
from ..shapes.packing_file import SpherePacking, check_inertia
from .actions import PosePath, Wrench, six_stds
from .body_belief import three_stds
from .materials import Surface, check_surface

#: Range of masses [kg] without overflow or underflow.
MASSES = 1e-50, 1e50
_shapes: weakref.WeakValueDictionary[bytes, CollisionShape] = (
    weakref.WeakValueDictionary()
)  # by hash of spheres
_shape_of: weakref.WeakKeyDictionary[SpherePacking, CollisionShape] = weakref.WeakKeyDictionary()


def known_mass(mass: float | None, model: SpherePacking, fixed: bool, field: str) -> float:
    """Return a body's mass [kg]: the given mass, or the model's.

    Raises `InvalidMassError` or `NotFiniteError`. A fixed body needs no mass; without one it is 1, which has
    no effect.
    """
    if mass is not None:
        return valid_mass(mass, field)
    if model.mass is not None:
        return model.mass
    if fixed:
        return 1.0
    raise InvalidMassError(f"must be given, since model '{model.name}' has no mass of its own", field=field)


def valid_mass(mass: float, field: str) -> float:
    """Return a given mass [kg]; raise `InvalidMassError` or `NotFiniteError` if it is out of range."""
    mass = positive(mass, field, InvalidMassError)
    if not MASSES[0] <= mass <= MASSES[1]:
        raise InvalidMassError(f"must be between {MASSES[0]:g} and {MASSES[1]:g} kg", field=field, value=mass)
    return mass


@with_named_arguments
@dataclass(frozen=True, eq=False, repr=False)
class RigidBody(Surface):
    """Rigid body with a sphere-packed shape and a mass; its friction and restitution are fields of `Surface`.

    Attributes
    ----------
    name : str
        Unique in its scene.
    model : SpherePacking
        Shape and inertia per unit mass; the centre of mass (COM) is the origin of the body frame.
    mass : float
        [kg], positive; by default the model's. A fixed body needs none.
    fixed : bool
        Whether the body never moves.
    mass_std : float
        Standard deviation of the mass [kg]; the inertia scales with the mass. With z standard normal, the
        mass is ``mass exp(z mass_std / mass)``, which is always positive.
    center_of_mass_std : (3,) array
        Standard deviations of the COM along the body axes [m]; one number stands for three. States and
        beliefs still refer to the model's COM. The inertia about the COM does not change.
    at_rest : bool
        Whether the body rests on a support at time 0. A prediction first settles it, so that contact
        determines its height and tilt. Its mean velocities must be zero; their covariance is ignored. Needs
        the implicit integrator and gravity; not for fixed bodies.

    inertia : (3, 3) array, optional
        Inertia about the COM per unit mass, body axes [m^2]; by default the model's. Three numbers are
        principal moments along the body axes; one number stands for three equal ones.
    trajectory : PosePath, optional
        Path of a prescribed body. The body follows it exactly, unaffected by contacts and without
        uncertainty. It needs no mass, and its state in a belief is ignored.
    trajectory_std : (6,) array
        Standard deviations of an offset of the whole path at its first pose: a translation along the body
        axes [m] and a rotation about them [rad].
    attached_to : str, optional
        Name of a prescribed or fixed body to which this body is rigidly attached for a time. The belief of
        this body holds at time 0. Needs the implicit integrator.
    attached_at : float
        Time at which it is attached [s]; if 0, the belief's velocities are ignored.
    released_at : float, optional
        Time at which it is released [s]; None means never. It then moves freely with its current velocity.
    released_at_std : float
        Standard deviation of the release time [s].
    wrenches : tuple of Wrench
        Wrenches on the body in addition to gravity and contacts, while it moves freely.
    drag : float
        Drag area of the body in air, C_d A [m^2], by default 0: no drag. The force at the COM is
        ``-0.5 rho C_d A |v| v``, with the density of air rho = 1.2 kg/m^3. It acts while the body moves
        freely and has no torque. A cube that tumbles has a C_d of about 1, a ball about 0.5.

    Raises
    ------
    InvalidMassError
        If the mass is not a positive finite number, or is missing and the model has none.
    InvalidRequestError, NotFiniteError
        If another field is out of range.
    """

    name: str
    model: SpherePacking
    mass: OptionalNumber = array_field(None)
    fixed: bool = False
    mass_std: float = 0.0
    center_of_mass_std: Array = array_field(0.0)
    at_rest: bool = False
    inertia: MaybeArray = array_field(None)
    trajectory: PosePath | None = None
    trajectory_std: Array = array_field(0.0)
    attached_to: str | None = None
    attached_at: float = 0.0
    released_at: float | None = None
    released_at_std: float = 0.0
    wrenches: Sequence[Wrench] = ()
    drag: float = 0.0

    def __post_init__(self):
        if not isinstance(self.name, str) or not self.name:
            raise InvalidRequestError("must be a non-empty text", field="name", value=self.name)
        if not isinstance(self.model, SpherePacking):
            loaded = f", as load_model({self.model!r}) returns" if isinstance(self.model, str) else ""
            raise InvalidRequestError(
                f"must be a SpherePacking{loaded}", field=f"model of body '{self.name}'", value=self.model
            )
        of = f" of body '{self.name}'"
        check_surface(self, of)
        if self.trajectory is not None:
            instance(self.trajectory, PosePath, f"trajectory{of}")
        checked = {
            "fixed": flag(self.fixed, f"fixed{of}"),
            "mass": known_mass(self.mass, self.model, not self.free, f"mass{of}"),
            "mass_std": non_negative(self.mass_std, f"mass_std{of}", InvalidMassError),
            "center_of_mass_std": three_stds(self.center_of_mass_std, f"center_of_mass_std{of}"),
            "at_rest": flag(self.at_rest, f"at_rest{of}"),
            "trajectory_std": six_stds(self.trajectory_std, f"trajectory_std{of}"),
            "attached_at": non_negative(self.attached_at, f"attached_at{of}"),
            "released_at_std": non_negative(self.released_at_std, f"released_at_std{of}"),
            "wrenches": tuple(self.wrenches),
            "drag": non_negative(self.drag, f"drag{of}"),
        }
        if self.released_at is not None:
            checked["released_at"] = number(self.released_at, f"released_at{of}")
        if self.inertia is not None:
            checked["inertia"] = _checked_inertia(self.inertia, self.model.bounding_radius, f"inertia{of}")
        for k, wrench in enumerate(checked["wrenches"]):
            instance(wrench, Wrench, f"wrenches[{k}]{of}")
        for name, value in checked.items():
            object.__setattr__(self, name, value)
        if self.mass_std > self.mass:
            raise InvalidMassError("must not exceed the mass", field=f"mass_std{of}", value=self.mass_std)
        for name, is_wrong, problem in self._contradictions():
            if is_wrong:
                value = getattr(self, name)
                shown = value if isinstance(value, (bool, float)) else None
                raise InvalidRequestError(problem, field=f"{name}{of}", value=shown)

    def _contradictions(self):
        """Yield fields that may contradict others, whether they do, and the problem."""
        path, holder, stop = self.trajectory is not None, self.attached_to, self.released_at
        kind = "fixed" if self.fixed else "prescribed"
        yield "at_rest", self.at_rest and not self.free, f"must be false for a {kind} body"
        yield "trajectory", path and self.fixed, "must be absent: the body is fixed"
        uncertain = self.mass_std or self.center_of_mass_std.any()
        yield "mass_std", path and uncertain, "must be zero or absent: the body is prescribed"
        yield "trajectory_std", not path and self.trajectory_std.any(), "needs a trajectory beside it"
        for name in ("wrenches", "drag"):
            yield name, getattr(self, name) and not self.free, "must be absent: no force moves this body"
        for name in ("attached_at", "released_at", "released_at_std"):
            yield name, holder is None and getattr(self, name), "needs attached_to beside it"
        if holder is None:
            return
        yield "attached_to", not isinstance(holder, str) or not holder, "must be the name of a body"
        yield "attached_to", holder == self.name, "must be another body than itself"
        yield "attached_to", not self.free, "must be absent: the body is fixed or prescribed"
        held = self.at_rest and self.attached_at == 0.0
        yield "at_rest", held, "must be false, as the body is held at time 0"
        late = f"must be later than attached_at, {self.attached_at:.6g} s"
        yield "released_at", stop is not None and stop <= self.attached_at, late
        yield "released_at_std", self.released_at_std and stop is None, "needs released_at beside it"

    @property
    def free(self) -> bool:
        """Whether the body is neither fixed nor prescribed."""
        return not self.fixed and self.trajectory is None

    @property
    def released(self) -> float:
        """Time of release [s]; infinite if never."""
        return math.inf if self.released_at is None else self.released_at

    @property
    def unit_inertia(self) -> np.ndarray:
        """Inertia about the COM per unit mass, body axes [m^2], as (3, 3)."""
        return self.model.inertia if self.inertia is None else self.inertia


def _checked_inertia(value, reach, field):
    """Return an inertia tensor (3, 3) from a tensor, its three diagonal entries, or one number for these."""
    found = numbers(value, field)
    if found.ndim < 2:
        found = np.diag(array(np.full(3, found) if found.ndim == 0 else found, (3,), field))
    found = array(found, (3, 3), field)
    try:
        check_inertia(found, reach)
    except InvalidModelError as error:
        raise InvalidRequestError(error.problem, field=field, value=error.value) from None
    return found


class CollisionShape:
    """Spheres of a packing, and their tree (`physics.paper.sphere_tree.build`)."""

    def __init__(self, centers: np.ndarray, radii: np.ndarray):
        # writable copies: read-only arrays would compile every kernel again
        self.centers, self.radii = np.array(centers), np.array(radii)
        self.tree = sphere_tree.build(self.centers, self.radii)


def shape_of(model: SpherePacking) -> CollisionShape:
    """Return the collision shape of a packing, which packings with the same spheres share."""
    if model not in _shape_of:
        key = hashlib.sha256(model.centers.tobytes() + model.radii.tobytes()).digest()
        shape = _shapes.get(key)
        if shape is None:
            shape = _shapes[key] = CollisionShape(model.centers, model.radii)
        _shape_of[model] = shape
    return _shape_of[model]
