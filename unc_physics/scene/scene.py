"""Scenes: rigid bodies and the physics between them; validated and frozen."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ..checks.array_field import Converted, OptionalArray, array_field
from ..checks.errors import (
    DuplicateIdError,
    InvalidEnvironmentError,
    InvalidOptionError,
    InvalidRequestError,
    NoObjectsError,
)
from ..checks.names import hint, with_named_arguments
from ..checks.shown import counted, counted_bodies, shown
from ..checks.validation import flag
from ..physics.actions import Actions
from ..physics.paper import sphere_tree
from ..physics.paper.world import Bodies, Environment, World
from ..physics.stops import Stops
from .action_arrays import actions_of
from .body import RigidBody, shape_of
from .environment import Element, check_element, check_not_reserved, element_names
from .marks import Mark
from .materials import (
    DEFAULT_RESTITUTION,
    SURFACE_OF_CONTACT,
    Materials,
    Surface,
    check_surface,
    combined,
    refuse_with_explicit,
)
from .pairs import PairMaterial, checked_pairs
from .physics_keys import PHYSICS_KEYS, check_integrator
from .presets import EXACT_PRESETS, PRESETS, with_changes

#: Names of all uncertain parameters (`Scene.uncertain`).
UNCERTAIN_PARAMETERS = (
    "stiffness",
    *Materials._fields,
    "gravity_direction",
    "mass",
    "center_of_mass",
    "surface_tilt",
    "released_at",
    "trajectory",
)
#: Standard deviations of errors drawn at each impact, and the most that each may be: half a turn [rad], the
#: size of the largest things that robots handle [m], and four orders of magnitude of friction.
IMPACT_STDS = {"impact_direction_std": math.pi, "impact_point_std": 10.0, "impact_friction_std": 10.0}

#: Default treatment of initial overlap.
DEFAULT_OVERLAP = {"implicit": "project", "explicit": "keep"}
#: Default kappa of explicit scenes [N/m^3].
STIFFNESS = 1e4


class UncertainParameter(NamedTuple):
    """One direction in which a parameter of a scene is uncertain."""

    name: str  # name of the field with its standard deviation, without ``_std``
    body: int  # index of its body; B + e for element e of the environment, -1 for the whole scene
    axis: int  # index of the direction, for parameters with several
    std: float


@with_named_arguments
@dataclass(frozen=True, eq=False)
class Scene:
    """Rigid bodies and the physics that acts on them, without state.

    Attributes
    ----------
    bodies : tuple of RigidBody
    dt : float
        Time step [s].
    stiffness : float, optional
        kappa of the penalty force [N/m^3] (the paper's Eq. 4), by default `STIFFNESS`. The implicit
        integrator has none: its contacts are rigid.
    damping : float
        Decay rate of all velocities [1/s].
    gravity : (3,) array, optional
        World frame [m/s^2]; by default zero. Scenes with an environment, friction or bodies at rest must set
        it.
    environment : tuple of Element
        Fixed surroundings, of the shapes in `environment.ELEMENTS`.
    friction : float, optional
        Coefficient of Coulomb friction of all bodies and elements without their own; None means no friction.
        Needs the implicit integrator.
    restitution : float, optional
        Coefficient of restitution, 0 to 1, of all bodies and elements without their own. None means 0, or 1
        with the explicit integrator, whose contacts are elastic.
    rolling_friction : float, optional
        Largest moment against rolling per normal force [m] of all bodies and elements without their own. None
        means 0. Needs the implicit integrator.
    gyroscopic : bool
        Whether rotation conserves angular momentum, instead of angular velocity as in the paper.
    integrator : {'explicit', 'implicit'}
        The paper's step of spheres with penalty forces, or a step of exact shapes that solves for contacts.
    stiffness_std, friction_std : float
        Standard deviations, in the parameter's unit. With z standard normal, the parameter is ``m exp(z std /
        m)``; its value m must be positive.
    restitution_std : float
        Standard deviation; restitution is ``restitution + z std``, clipped to [0, 1]. As with friction, it
        belongs to a contact: each surface without its own value has an independent draw with
        `SURFACE_OF_CONTACT` times as much.
    gravity_direction_std : float
        Tilt of gravity about each of two perpendicular axes [rad]; its magnitude is fixed.
    impact_friction_speed : float, optional
        Closing speed v0 at which an impact has half of the friction [m/s]. At closing speed v it has
        ``friction / (1 + v / v0)``; sliding has the whole friction. None means that friction does not depend
        on speed. Needs the implicit integrator.
    impact_direction_std, impact_point_std, impact_friction_std : float
        Standard deviations of errors that sampling propagators draw at each impact of two partners. They
        rotate the impulse about each axis [rad], shift its point along the surface [m], and scale friction
        (standard deviation of the logarithm). Need the implicit integrator.
    sleep : bool
        Whether bodies at rest sleep until something pushes them. Needs the implicit integrator.
    overlap : {'project', 'reject', 'keep'}
        Treatment of overlap at time 0, of bodies or of a body and the environment. ``project`` moves samples
        from the mean's pose to their own until contacts stop them. ``reject`` discards them, with Monte
        Carlo only. ``keep`` changes nothing. By default, or None, ``keep`` with the explicit integrator,
        which supports nothing else, and ``project`` with others.
    pairs : tuple of PairMaterial
        Friction and restitution between two things, in place of the means of their own; as mappings, like
        ``{"between": ["mug", "tray"], "friction": 0.3}``. Needs the implicit integrator.

    Raises
    ------
    NoObjectsError, DuplicateIdError, InvalidRequestError, InvalidHorizonError, InvalidOptionError,
    InvalidEnvironmentError, NotFiniteError
        For an empty scene, a repeated name, a physical constant out of range, a bad time step, or laws that
        the integrator does not support.
    """

    bodies: Sequence[RigidBody]
    dt: float = 0.01
    stiffness: float | None = None
    damping: float = 0.0
    gravity: OptionalArray = array_field(None)
    environment: Sequence[Element] = ()
    friction: float | None = None
    restitution: float | None = None
    rolling_friction: float | None = None
    gyroscopic: bool = False
    integrator: str = "explicit"
    stiffness_std: float = 0.0
    friction_std: float = 0.0
    restitution_std: float = 0.0
    gravity_direction_std: float = 0.0
    impact_friction_speed: float | None = None
    impact_direction_std: float = 0.0
    impact_point_std: float = 0.0
    impact_friction_std: float = 0.0
    sleep: bool = False
    overlap: str | None = None
    pairs: Converted[Sequence[Mapping[str, Any] | PairMaterial], tuple[PairMaterial, ...]] = array_field(())

    def __repr__(self) -> str:
        bodies = counted_bodies([body.name for body in self.bodies])
        elements = counted(len(self.environment), "element")
        return f"<Scene of {bodies} and {elements}; {self.integrator}, dt {self.dt:.5g} s>"

    def __post_init__(self):
        try:
            bodies = tuple(self.bodies)
        except TypeError:
            instead = "[body]" if isinstance(self.bodies, RigidBody) else ""
            raise InvalidRequestError(
                _not_a_list("RigidBody", self.bodies, instead), field="bodies"
            ) from None
        if not bodies:
            raise NoObjectsError("must name at least one body", field="bodies")
        for k, body in enumerate(bodies):
            if not isinstance(body, RigidBody):
                raise InvalidRequestError("must be a RigidBody", field=f"bodies[{k}]", value=body)
        names = [body.name for body in bodies]
        for k, name in enumerate(names):
            check_not_reserved(name, f"bodies[{k}].name")
            if name in names[:k]:
                raise DuplicateIdError("is the name of two bodies", field=f"bodies[{k}].name", value=name)
        object.__setattr__(self, "bodies", bodies)
        object.__setattr__(self, "environment", _elements(self.environment, names))
        check_integrator(self.integrator)
        explicit = self.integrator == "explicit"
        pairs = checked_pairs(self.pairs, names, element_names(self.environment))
        object.__setattr__(self, "pairs", pairs)
        names_gravity = self.gravity is not None
        if not explicit:
            self._refuse_stiffness()
        chosen = {
            "gravity": np.zeros(3),
            "overlap": DEFAULT_OVERLAP[self.integrator],
            "stiffness": STIFFNESS if explicit else None,
        }
        for spec in fields(self):
            if spec.name in PHYSICS_KEYS:
                value = getattr(self, spec.name)
                if value is None and spec.default is None:
                    value = chosen.get(spec.name)
                else:
                    value = PHYSICS_KEYS[spec.name].check(value, spec.name)
                object.__setattr__(self, spec.name, value)
        check_surface(self)
        if explicit:
            self._refuse_what_needs_implicit()
        if not names_gravity:
            self._check_needs_no_gravity()
        self._check_attachments(names)
        self._check_at_rest()
        self._check_std("stiffness", self.stiffness, "a stiffness above 0")
        self._check_std("gravity_direction", math.pi if self.gravity.any() else 0.0, "gravity")
        for field, most in IMPACT_STDS.items():
            self._check_std(field.removesuffix("_std"), most)

    def _refuse_what_needs_implicit(self):
        """Raise `InvalidOptionError` if an option is set that the explicit step does not support."""
        refuse_with_explicit(self)
        for kind, things in (("bodies", self.bodies), ("environment", self.environment)):
            for k, thing in enumerate(things):
                refuse_with_explicit(thing, f"{kind}[{k}].")
        for k, element in enumerate(self.environment):
            if element.moving_surface.any():
                raise InvalidOptionError(
                    "needs 'integrator: implicit', since without friction nothing feels it",
                    field=f"environment[{k}].surface_velocity",
                )

    def _refuse_stiffness(self):
        """Raise `InvalidOptionError` if the implicit integrator is given a stiffness."""
        for field, absent in (("stiffness", None), ("stiffness_std", 0.0)):
            if getattr(self, field) != absent:
                raise InvalidOptionError(
                    "must be absent with 'integrator: implicit', whose contacts are rigid; the paper's"
                    " 'explicit' has it",
                    field=field,
                    value=getattr(self, field),
                )

    def _check_attachments(self, names):
        """Raise `InvalidRequestError` unless each holding body exists and is not itself attached."""
        for k, body in enumerate(self.bodies):
            if body.attached_to is None:
                continue
            field = f"bodies[{k}].attached_to"
            if body.attached_to not in names:
                raise InvalidRequestError(
                    f"is no body of the scene{hint(body.attached_to, names)}",
                    field=field,
                    value=body.attached_to,
                )
            seen, other = [body.name], self.bodies[names.index(body.attached_to)]
            while other.attached_to is not None and other.name not in seen:
                seen.append(other.name)
                if other.attached_to not in names:
                    break
                other = self.bodies[names.index(other.attached_to)]
            if other.name in seen:
                circle = " to ".join([*seen, other.name])
                raise InvalidRequestError(f"goes in a circle: {circle}", field=field, value=body.attached_to)
            if self.bodies[names.index(body.attached_to)].free:
                raise InvalidRequestError(
                    "must name a body with a trajectory, or a fixed one; this one moves by itself",
                    field=field,
                    value=body.attached_to,
                )

    def _check_needs_no_gravity(self):
        """Raise `InvalidRequestError` if gravity is not set but the scene appears to need it."""
        reasons = {
            "an environment": self.environment,
            "friction": any(surface.friction for surface in (self, *self.bodies)),
            "bodies at rest": any(body.at_rest for body in self.bodies),
        }
        if found := [reason for reason, holds in reasons.items() if holds]:
            raise InvalidRequestError(
                f"must be given, as the scene has {found[0]}: use physics 'everyday' (Scene.everyday in"
                " Python), or give gravity, [0, 0, -9.81] or [0, 0, 0]",
                field="gravity",
            )

    def _check_at_rest(self):
        """Raise `InvalidRequestError` if a body is at rest without gravity."""
        for k, body in enumerate(self.bodies):
            if body.at_rest and not self.gravity.any():
                raise InvalidRequestError(
                    "needs gravity, which the scene does not have", field=f"bodies[{k}].at_rest"
                )

    def _check_std(self, name, most, owner=""):
        """Raise `InvalidRequestError` if a standard deviation exceeds ``most``; None counts as 0."""
        field, std = f"{name}_std", getattr(self, f"{name}_std")
        if std > 0.0 and not most:
            raise InvalidRequestError(f"needs a scene with {owner}", field=field, value=std)
        if std > 0.0 and std > most:
            raise InvalidRequestError(f"must not exceed {most:.6g}", field=field, value=std)

    @classmethod
    def everyday(cls, bodies: Sequence[RigidBody], *, exact: bool = False, **overrides: Any) -> Scene:
        """Return a scene with the preset ``everyday``, in which bodies fall, slide and rest.

        Friction and restitution are those of unknown household objects, and so uncertain. Impacts have random
        errors.

        Parameters
        ----------
        bodies : sequence of RigidBody
        exact : bool
            Whether friction and restitution are certain, and impacts have no errors.
        **overrides
            Fields of `Scene` that override the preset; None disables a law. A friction or restitution is
            exact unless its standard deviation is given, too.
        """
        presets = EXACT_PRESETS if flag(exact, "exact") else PRESETS
        return cls(bodies, **with_changes(presets["everyday"], overrides))

    @cached_property
    def moving(self) -> np.ndarray:
        """Indices (M,) int64 of the bodies that are neither fixed nor prescribed."""
        return np.array([k for k, body in enumerate(self.bodies) if body.free], np.int64)

    @cached_property
    def actions(self) -> Actions:
        """Actions on the bodies, as the kernels' arrays."""
        return actions_of(self.bodies, self.environment)

    @cached_property
    def acts(self) -> bool:
        """Whether there are prescribed bodies, attachments, wrenches, drag, or moving surfaces."""
        a = self.actions
        return bool(len(a.kinematic) or len(a.wrench_body) or len(a.surface))

    @cached_property
    def uncertain(self) -> tuple[UncertainParameter, ...]:
        """Uncertain directions of all parameters; the scene's parameters come first."""
        found = [
            UncertainParameter(field.removesuffix("_std"), -1, axis, getattr(self, field))
            for field, axes in (("stiffness_std", 1), ("gravity_direction_std", 2))
            if getattr(self, field)
            for axis in range(axes)
        ]
        for k in self.moving.tolist():
            body = self.bodies[k]
            if body.mass_std:
                found.append(UncertainParameter("mass", k, 0, body.mass_std))
            found += [
                UncertainParameter("center_of_mass", k, a, std)
                for a, std in enumerate(body.center_of_mass_std)
                if std
            ]
            if body.released_at_std:
                found.append(UncertainParameter("released_at", k, 0, body.released_at_std))
        for k, body in enumerate(self.bodies):
            found += [
                UncertainParameter("trajectory", k, axis, std)
                for axis, std in enumerate(body.trajectory_std.tolist())
                if std
            ]
        for k, surface in enumerate(self.surfaces if self.has_partners else ()):  # each has its own draw
            # a contact has the mean of two independent draws: without own values they give it the scene's std
            stds = {
                name: SURFACE_OF_CONTACT * getattr(self, f"{name}_std")
                if getattr(surface, name) is None
                else getattr(surface, f"{name}_std")
                for name in Materials._fields
            }
            found += [UncertainParameter(name, k, 0, std) for name, std in stds.items() if std]
            tilt = getattr(surface, "surface_tilt_std", 0.0)
            found += [UncertainParameter("surface_tilt", k, axis, tilt) for axis in range(2) if tilt]
        return tuple(found)

    @property
    def has_partners(self) -> bool:
        """Whether there are two things that can touch each other."""
        return len(self.surfaces) > 1

    @property
    def draws_impacts(self) -> bool:
        """Whether impacts are possible, and each has a random error."""
        return self.has_partners and any(getattr(self, name) > 0.0 for name in IMPACT_STDS)

    @property
    def surfaces(self) -> tuple[Surface, ...]:
        """Surfaces of the bodies, then of the environment's elements."""
        return (*self.bodies, *self.environment)

    @cached_property
    def materials(self) -> Materials:
        """Friction and restitution of the `surfaces`."""
        return combined(self, self.surfaces, DEFAULT_RESTITUTION[self.integrator])

    @cached_property
    def world(self) -> World:
        """The scene as the arrays of the explicit step's kernels."""
        assert self.stiffness is not None  # of scenes with the explicit integrator
        shifted = {parameter.body for parameter in self.uncertain if parameter.name == "center_of_mass"}
        # bodies of one shape share a tree, except those with an uncertain centre of mass
        owners = [(shape_of(body.model), k if k in shifted else -1) for k, body in enumerate(self.bodies)]
        own = list(dict.fromkeys(owners))
        shapes = [shape for shape, _ in own]
        trees = [shape.tree for shape in shapes]
        nodes = np.cumsum([0, *(len(child) for _, child, _ in trees)])
        spheres = np.cumsum([0, *(len(shape.radii) for shape in shapes)])
        children = [_shifted(child, nodes[k], spheres[k]) for k, (_, child, _) in enumerate(trees)]
        depth = sorted((depth for *_, depth in trees), reverse=True)
        deepest = depth[0] + depth[min(1, len(depth) - 1)]
        tree = sphere_tree.Tree(
            np.concatenate([bounds for bounds, *_ in trees]),
            np.concatenate(children),
            np.concatenate([shape.centers for shape in shapes]),
            np.concatenate([shape.radii for shape in shapes]),
        )
        resistance = np.array([body.mass if body.free else math.inf for body in self.bodies])
        inverse = np.array([np.linalg.inv(body.unit_inertia) for body in self.bodies])
        reach = {shape: np.max(np.linalg.norm(shape.centers, axis=1) + shape.radii) for shape in shapes}
        bodies = Bodies(
            moving=np.array([body.free for body in self.bodies]),
            mass=np.array([body.mass for body in self.bodies]),
            inertia=np.array([body.mass * body.unit_inertia for body in self.bodies]),
            inverse_mass=1.0 / resistance,
            inverse_inertia=inverse / resistance[:, None, None],
            radius=np.array([reach[shape] for shape, _ in owners]),
            root=np.array([nodes[own.index(owner)] for owner in owners]),
        )
        stack_size = sphere_tree.AT_ONCE * sphere_tree.WIDTH**2 * deepest + 1
        # a writable copy: read-only arrays would compile every kernel again
        return World(
            bodies,
            tree,
            np.array(self.gravity),
            self.dt,
            self.decay,
            self.stiffness,
            stack_size,
            environment=self._environment(),
        )

    @cached_property
    def start(self) -> float:
        """Time at which step 0 would begin [s]; nonzero only in a `with_short_step`."""
        return 0.0

    @cached_property
    def decay(self) -> float:
        """Factor on all velocities in a step."""
        return math.exp(-self.damping * self.dt)

    @cached_property
    def radii(self) -> np.ndarray:
        """Radius of a ball about each body's centre of mass that contains it, (B,) [m]."""
        if self.integrator == "explicit":
            return self.world.bodies.radius
        return np.array([body.model.bounding_radius for body in self.bodies])

    def with_short_step(self, steps: int, rest: float) -> Scene:
        """Return the scene with a next step of only ``rest`` seconds, after ``steps`` whole steps.

        For `Propagator.advance`. The step keeps its number, and so its random draws.
        """
        short = copy(self)
        object.__setattr__(short, "dt", rest)
        for computed in ("world", "decay"):
            short.__dict__.pop(computed, None)
        short.__dict__["start"] = steps * (self.dt - rest)
        return short

    def stops(self, begin: int, marks: Sequence[Mark]) -> Stops:
        """Return the stops of rollouts that have done ``begin`` steps, at marks that are ascending."""
        steps = np.array([mark.steps for mark in marks], np.int64)
        return Stops(steps - begin, np.array([mark.rest for mark in marks]))

    def _environment(self) -> Environment | None:
        """Return environment, actions and gyroscopic term; None if there are none.

        With None, the kernels compile without them.
        """
        elements = self.environment
        if not (elements or self.gyroscopic or self.acts):
            return None
        return Environment(
            kind=np.array([element.kind for element in elements], np.int64),
            position=np.array([element.position for element in elements]).reshape(-1, 3),
            R=np.array([element.rotation for element in elements]).reshape(-1, 3, 3),
            size=np.array([element.size_row for element in elements]).reshape(-1, 3),
            gyroscopic=bool(self.gyroscopic),
            actions=self.actions,
        )


def _not_a_list(kinds, value, instead):
    """Return the problem of a value that is no list of some ``kinds``; ``instead`` shows it in a list."""
    given = "None" if value is None else f"a single {type(value).__name__}" if instead else shown(value)
    return f"must be a list of {kinds}, not {given}{instead and f'; write {instead}'}"


def _elements(environment, names):
    """Return the environment as a tuple; raise an error if names of elements and bodies repeat."""
    try:
        if isinstance(environment, str):
            raise TypeError
        elements = tuple(environment)
    except TypeError:
        instead = f"[{type(environment).__name__}(...)]" if isinstance(environment, Element) else ""
        problem = _not_a_list("elements, such as Plane and Box", environment, instead)
        raise InvalidEnvironmentError(problem, field="environment") from None
    for k, element in enumerate(elements):
        check_element(element, f"environment[{k}]")
    taken = set(names)
    for k, name in enumerate(element_names(elements)):
        check_not_reserved(name, f"environment[{k}].name")
        if name in taken:
            raise DuplicateIdError("is the name of two things", field=f"environment[{k}].name", value=name)
        taken.add(name)
    return elements


def _shifted(child, first_node, first_sphere):
    """Return the children of one tree as entries of several concatenated trees."""
    shifted = np.where(child < 0, child - first_sphere, child + first_node)
    return np.where(child == sphere_tree.EMPTY, child, shifted).astype(np.int32)
