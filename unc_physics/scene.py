"""What is simulated: rigid bodies, their models, and the physics between them; validated and frozen."""

from __future__ import annotations

import math
import weakref
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from .environment import Element, check_element, element_names
from .errors import (
    DuplicateIdError,
    InvalidEnvironmentError,
    InvalidHorizonError,
    InvalidMassError,
    InvalidOptionError,
    InvalidRequestError,
    NoObjectsError,
)
from .geometry.packing_file import SpherePacking
from .physics import sphere_tree
from .physics.world import Bodies, Surroundings, World
from .validation import array, non_negative, number, numbers, positive

#: What of the scene's own parameters may be uncertain, and what that takes.
_STDS = {
    "stiffness_std": "stiffness", "friction_std": "friction", "restitution_std": "restitution", "gravity_direction_std": "gravity",
}

#: How steps are taken: as in the paper, or divided and linearly implicit where contacts need it.
INTEGRATORS = ("explicit", "robust")

_trees = weakref.WeakKeyDictionary()


class UncertainParameter(NamedTuple):
    """One direction in which a parameter of a scene is uncertain.

    Attributes
    ----------
    name : str
        Of the parameter: the field that holds its standard deviation, without ``_std``.
    body : int
        Index of the body that it belongs to; -1 for one of the whole scene.
    axis : int
        Which of its directions, for parameters that have several.
    std : float
    """

    name: str
    body: int
    axis: int
    std: float


@dataclass(frozen=True, eq=False)
class RigidBody:
    """A rigid body: a sphere-packed shape with a mass.

    Attributes
    ----------
    name : str
        Unique in its scene.
    model : SpherePacking
        Shape and inertia per unit mass; body frame with the centre of mass (COM) at the origin.
    mass : float
        [kg], positive; has no effect on a fixed body.
    fixed : bool
        Whether the body never moves.
    mass_std : float
        Standard deviation of the mass [kg]; the inertia follows the mass. It varies as ``mass exp(z mass_std / mass)``
        with a standard normal z, so that it stays positive.
    center_of_mass_std : (3,) array
        Standard deviations of the COM's place in the body, about the model's, body axes [m]; one number stands for three.
        States and beliefs stay those of the model's COM; the inertia about the COM stays the model's.

    Raises
    ------
    InvalidMassError
        If the mass is not a positive finite number.
    InvalidRequestError, NotFiniteError
        For anything else out of range.
    """

    name: str
    model: SpherePacking
    mass: float = 1.0
    fixed: bool = False
    mass_std: float = 0.0
    center_of_mass_std: np.ndarray = 0.0

    def __post_init__(self):
        if not isinstance(self.name, str) or not self.name:
            raise InvalidRequestError("must be a non-empty text", field="name", value=self.name)
        if not isinstance(self.model, SpherePacking):
            raise InvalidRequestError("must be a SpherePacking", field=f"model of body '{self.name}'", value=self.model)
        if not isinstance(self.fixed, (bool, np.bool_)):
            raise InvalidRequestError("must be true or false", field=f"fixed of body '{self.name}'", value=self.fixed)
        field = f"center_of_mass_std of body '{self.name}'"
        std = numbers(self.center_of_mass_std, field)
        std = array(np.full(3, std) if std.ndim == 0 else std, (3,), field)
        non_negative(std.min(), field)
        checked = {
            "mass": positive(self.mass, f"mass of body '{self.name}'", InvalidMassError),
            "mass_std": non_negative(self.mass_std, f"mass_std of body '{self.name}'", InvalidMassError),
            "center_of_mass_std": std,
        }
        if checked["mass_std"] > checked["mass"]:
            raise InvalidMassError("must not exceed the mass", field=f"mass_std of body '{self.name}'", value=self.mass_std)
        for name, value in checked.items():
            object.__setattr__(self, name, value)


@dataclass(frozen=True, eq=False)
class Scene:
    """Rigid bodies and the physics that acts on them; holds no state.

    Attributes
    ----------
    bodies : tuple of RigidBody
    dt : float
        Time step [s].
    stiffness : float
        kappa of the penalty force [N/m^3] (the paper's Eq. 4).
    damping : float
        Decay rate of all velocities [1/s].
    gravity : (3,) array
        World frame [m/s^2].
    environment : tuple of Element
        Fixed surroundings: planes, boxes, spheres, cylinders and capsules.
    friction : float, optional
        Coefficient of Coulomb friction of all contacts; None means that there is none.
    restitution : float, optional
        Coefficient of restitution of all contacts, 0 to 1; None means elastic contacts, as does 1.
    gyroscopic : bool
        Whether a turning body keeps its angular momentum, instead of its angular velocity as in the paper.
    integrator : {'explicit', 'robust'}
        The paper's step, or one that is divided and linearly implicit where contacts need it.
    islands : bool
        Whether groups of bodies that cannot touch within the horizon are predicted each by itself.
    stiffness_std, friction_std : float
        Standard deviations, in the units of what they belong to, which then varies as ``m exp(z std / m)`` with a
        standard normal z; only what is positive can be uncertain.
    restitution_std : float
        Standard deviation; the coefficient varies as ``restitution + z std``, cut off at 0 and 1.
    gravity_direction_std : float
        Of gravity's tilts about each of two axes across it [rad]; its size stays.

    Raises
    ------
    NoObjectsError, DuplicateIdError, InvalidRequestError, InvalidHorizonError, InvalidOptionError,
    InvalidEnvironmentError, NotFiniteError
        For an empty scene, a repeated name, a physical constant out of range, or a bad time step.
    """

    bodies: tuple[RigidBody, ...]
    dt: float = 0.01
    stiffness: float = 1e4
    damping: float = 0.0
    gravity: np.ndarray = (0.0, 0.0, 0.0)
    environment: tuple[Element, ...] = ()
    friction: float | None = None
    restitution: float | None = None
    gyroscopic: bool = False
    integrator: str = "explicit"
    islands: bool = False
    stiffness_std: float = 0.0
    friction_std: float = 0.0
    restitution_std: float = 0.0
    gravity_direction_std: float = 0.0

    def __post_init__(self):
        try:
            bodies = tuple(self.bodies)
        except TypeError:
            raise InvalidRequestError("must be a sequence of RigidBody", field="bodies", value=self.bodies) from None
        if not bodies:
            raise NoObjectsError("must name at least one body", field="bodies")
        for k, body in enumerate(bodies):
            if not isinstance(body, RigidBody):
                raise InvalidRequestError("must be a RigidBody", field=f"bodies[{k}]", value=body)
        names = [body.name for body in bodies]
        for k, name in enumerate(names):
            if name in names[:k]:
                raise DuplicateIdError("is the name of two bodies", field=f"bodies[{k}].name", value=name)
        checked = {
            "bodies": bodies,
            "dt": positive(self.dt, "dt", InvalidHorizonError),
            "stiffness": non_negative(self.stiffness, "stiffness"),
            "damping": non_negative(self.damping, "damping"),
            "gravity": array(self.gravity, (3,), "gravity"),
            "environment": _elements(self.environment, names),
            "friction": None if self.friction is None else non_negative(self.friction, "friction"),
            "restitution": None if self.restitution is None else _share(self.restitution, "restitution"),
            "gyroscopic": _flag(self.gyroscopic, "gyroscopic"),
            "islands": _flag(self.islands, "islands"),
        } | {field: non_negative(getattr(self, field), field) for field in _STDS}
        if self.integrator not in INTEGRATORS:
            raise InvalidOptionError(f"must be one of {', '.join(INTEGRATORS)}", field="integrator", value=self.integrator)
        for field, value in checked.items():
            object.__setattr__(self, field, value)
        for field, owner in _STDS.items():
            self._check_std(field, getattr(self, field), owner, getattr(self, owner))

    @staticmethod
    def _check_std(field, std, owner, value):
        """Raise `InvalidRequestError` unless ``owner`` of that value can have that standard deviation."""
        if std == 0.0:
            return
        if value is None or (owner != "restitution" and not np.any(value)):
            raise InvalidRequestError(f"needs a scene with {owner}", field=field, value=std)
        most = {"restitution": 1.0, "gravity": math.pi}.get(owner, value)
        if std > most:
            raise InvalidRequestError(f"must not exceed {most:.6g}", field=field, value=std)

    @cached_property
    def moving(self) -> np.ndarray:
        """(M,) int64: indices of the bodies that are not fixed."""
        return np.array([k for k, body in enumerate(self.bodies) if not body.fixed], np.int64)

    @cached_property
    def uncertain(self) -> tuple[UncertainParameter, ...]:
        """The directions in which parameters are uncertain, those of the scene first."""
        found = [
            UncertainParameter(field.removesuffix("_std"), -1, axis, getattr(self, field))
            for field in _STDS if getattr(self, field) for axis in range(2 if field == "gravity_direction_std" else 1)
        ]
        for k in self.moving.tolist():
            body = self.bodies[k]
            if body.mass_std:
                found.append(UncertainParameter("mass", k, 0, body.mass_std))
            found += [UncertainParameter("center_of_mass", k, a, std) for a, std in enumerate(body.center_of_mass_std) if std]
        return tuple(found)

    @cached_property
    def world(self) -> World:
        """The scene as the kernels take it."""
        shifted = {parameter.body for parameter in self.uncertain if parameter.name == "center_of_mass"}
        # bodies of one model share a tree, but for those whose spheres move about the centre of mass
        owners = [(body.model, k if k in shifted else -1) for k, body in enumerate(self.bodies)]
        own = list(dict.fromkeys(owners))
        models = [model for model, _ in own]
        trees = [tree_of(model) for model in models]
        nodes = np.cumsum([0, *(len(child) for _, child, _ in trees)])
        spheres = np.cumsum([0, *(len(model) for model in models)])
        children = [_shifted(child, nodes[k], spheres[k]) for k, (_, child, _) in enumerate(trees)]
        depth = sorted((depth for *_, depth in trees), reverse=True)
        deepest = depth[0] + depth[min(1, len(depth) - 1)]
        tree = sphere_tree.Tree(
            np.concatenate([bounds for bounds, *_ in trees]),
            np.concatenate(children),
            np.concatenate([model.centers for model in models]),
            np.concatenate([model.radii for model in models]),
        )
        resistance = np.array([math.inf if body.fixed else body.mass for body in self.bodies])
        inverse = np.array([np.linalg.inv(body.model.inertia) for body in self.bodies])
        reach = {model: np.max(np.linalg.norm(model.centers, axis=1) + model.radii) for model in models}
        bodies = Bodies(
            moving=np.array([not body.fixed for body in self.bodies]),
            mass=np.array([body.mass for body in self.bodies]),
            inertia=np.array([body.mass * body.model.inertia for body in self.bodies]),
            inverse_mass=1.0 / resistance,
            inverse_inertia=inverse / resistance[:, None, None],
            radius=np.array([reach[body.model] for body in self.bodies]),
            root=np.array([nodes[own.index(owner)] for owner in owners]),
            mass=np.array([body.mass for body in self.bodies]),
            inertia=np.array([body.mass * body.model.inertia for body in self.bodies]),
        )
        stack_size = sphere_tree.WIDTH**2 * deepest + 1
        # a writable copy: read-only arrays would compile every kernel once more
        return World(
            bodies, tree, np.array(self.gravity), self.dt, math.exp(-self.damping * self.dt), self.stiffness, stack_size,
            surroundings=self._surroundings(), implicit=None)

    def _surroundings(self) -> Surroundings | None:
        """Environment and gyroscopic term; None, for which the kernels compile without them, where there is neither."""
        elements = self.environment
        if not (elements or self.gyroscopic):
            return None
        return Surroundings(
            kind=np.array([element.kind for element in elements], np.int64),
            position=np.array([element.position for element in elements]).reshape(-1, 3),
            R=np.array([element.rotation for element in elements]).reshape(-1, 3, 3),
            size=np.array([element.size_row for element in elements]).reshape(-1, 3),
            gyroscopic=bool(self.gyroscopic),
        )


def tree_of(model: SpherePacking):
    """Sphere tree of a packing (`physics.sphere_tree.build`), built at its first use and kept as long as the packing."""
    if model not in _trees:
        _trees[model] = sphere_tree.build(np.array(model.centers), np.array(model.radii))
    return _trees[model]


def _elements(environment, names):
    """The environment as a tuple; its names and the bodies' must differ."""
    try:
        elements = tuple(environment)
    except TypeError:
        raise InvalidEnvironmentError("must be a sequence of elements", field="environment", value=environment) from None
    for k, element in enumerate(elements):
        check_element(element, f"environment[{k}]")
    taken = set(names)
    for k, name in enumerate(element_names(elements)):
        if name in taken:
            raise DuplicateIdError("is the name of two things", field=f"environment[{k}].name", value=name)
        taken.add(name)
    return elements


def _share(value, field):
    result = number(value, field)
    if not 0.0 <= result <= 1.0:
        raise InvalidRequestError("must be between 0 and 1", field=field, value=value)
    return result


def _flag(value, field):
    if not isinstance(value, (bool, np.bool_)):
        raise InvalidRequestError("must be true or false", field=field, value=value)
    return bool(value)


def _shifted(child, first_node, first_sphere):
    """Children of one tree as entries of several trees that stand one behind the other."""
    shifted = np.where(child < 0, child - first_sphere, child + first_node)
    return np.where(child == sphere_tree.EMPTY, child, shifted).astype(np.int32)
