"""What a robot does, in other engines: bodies on paths, belts, and what is held until it is let go.

The same masses, inertias, frictions of each pair that touches and starts as ours. Before each step all that
is prescribed is put where its path says. In MuJoCo such a body is a mocap body; contacts take those to stand
still, so its velocity is given as that of its surface, as is a belt's. In PyBullet it is a body without mass
whose velocity is set, and a belt is put back after each step. A held thing is put where its hand is.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from unc_physics.checks.errors import NotSupportedError
from unc_physics.physics.actions import carry_along
from unc_physics.physics.layout import ANGULAR_VELOCITY, POSITION, QUATERNION, VELOCITY
from unc_physics.scene.action_arrays import path_states
from unc_physics.scene.environment import Box, Plane

from .engines import PRIMITIVES, PrincipalBody

_MOST_SPHERES = 4  # of a model that is given as its spheres


class Shape(NamedTuple):
    """A primitive of a body.

    Attributes
    ----------
    kind : {'box', 'sphere', 'cylinder'}
    size : tuple of float
        A box's sides, a sphere's radius, or a cylinder's radius and length [m].
    place : (3,) array
        In the body's frame [m].
    turned : Rotation
        From the shape's axes to the body's.
    """

    kind: str
    size: tuple[float, ...]
    place: np.ndarray
    turned: Rotation = Rotation.identity()


class Settings(NamedTuple):
    """How an engine is run.

    Attributes
    ----------
    dt : float
        [s]
    iterations : int
        Of PyBullet's solver, in a step.
    contact_time : float
        Time constant of MuJoCo's contacts [s].
    firm_friction : float
        How much stiffer than contacts MuJoCo's friction is (``impratio``).
    """

    dt: float
    iterations: int = 50
    contact_time: float = 0.02
    firm_friction: float = 1.0

    def words(self, engine: str) -> str:
        """They as a reader is told."""
        first = f"{1e3 * self.dt:.3g} ms steps"
        if engine == "pybullet":
            return f"{first}, {self.iterations} iterations"
        return f"{first}, contacts of {1e3 * self.contact_time:.3g} ms, impratio {self.firm_friction:g}"


def shapes_of(body) -> list[Shape]:
    """A body's shapes: the box or cylinder that its model is, as large as its spheres, or its few spheres."""
    model = body.model
    if len(model.radii) <= _MOST_SPHERES:
        return [Shape("sphere", (r,), c) for c, r in zip(model.centers, model.radii.tolist(), strict=True)]
    if model.name not in PRIMITIVES:
        raise NotSupportedError("is no primitive in other engines", field="model", value=model.name)
    reach = model.radii[:, None]
    low, high = (model.centers - reach).min(axis=0), (model.centers + reach).max(axis=0)
    x, y, z = (high - low).tolist()
    kind = PRIMITIVES[model.name]
    return [Shape(kind, (x, y, z) if kind == "box" else (0.5 * x, z), 0.5 * (low + high))]


class Motion(NamedTuple):
    """A body's principal axes and how they move: place, quaternion (x, y, z, w), velocities in the world's
    axes, and in its own.
    """

    place: np.ndarray
    q: np.ndarray
    velocity: np.ndarray
    spin: np.ndarray
    own_velocity: np.ndarray
    own_spin: np.ndarray


def _motions(body: PrincipalBody, states: np.ndarray) -> list[Motion]:
    """Motions from a body's states (n, 13)."""
    states = np.array(states)
    velocity, spin = states[:, VELOCITY], states[:, ANGULAR_VELOCITY]
    turned = Rotation.from_quat(states[:, QUATERNION]) * body.axes
    back = turned.inv()
    columns = states[:, POSITION], turned.as_quat(), velocity, spin, back.apply(velocity), back.apply(spin)
    return [Motion(*row) for row in zip(*columns, strict=True)]


class ActionEngine:
    """A scene with actions in an engine; ``shapes`` are those of bodies that `shapes_of` does not know."""

    def __init__(self, scene, settings: Settings, shapes: Mapping[str, Sequence[Shape]] | None = None):
        self._scene, self._settings = scene, settings
        self._bodies = [PrincipalBody(body) for body in scene.bodies]
        own = dict(shapes or {})
        self._shapes = [
            [self._principal(one, shape) for shape in own.get(body.name) or shapes_of(body)]
            for body, one in zip(scene.bodies, self._bodies, strict=True)
        ]
        self._make()

    @staticmethod
    def _principal(body, shape):
        back = body.axes.inv()
        return shape._replace(place=back.apply(np.array(shape.place)), turned=back * shape.turned)

    def _friction(self, partner):
        return self._scene.friction if partner.friction is None else partner.friction

    def _apart(self, a, b):
        """Whether two bodies are never to touch: one holds the other, or neither moves freely."""
        one, other = self._scene.bodies[a], self._scene.bodies[b]
        return one.attached_to == other.name or other.attached_to == one.name or not (one.free or other.free)

    def run(
        self, start: np.ndarray, horizon: float, released: Mapping[int, float] | None = None
    ) -> tuple[np.ndarray, float]:
        """States (B, 13) at the horizon, and the CPU time of the engine's steps [s].

        Parameters
        ----------
        start : (B, 13) array
        horizon : float
            [s]
        released : mapping of int to float, optional
            When bodies are let go in place of their own times [s].
        """
        steps, spent = round(horizon / self._settings.dt), 0.0
        driven = self._driven(start, steps + 1, released or {})
        self._begin([_motions(body, state[None])[0] for body, state in zip(self._bodies, start, strict=True)])
        for step in range(steps + 1):
            for k, motions in driven.items():
                if step < len(motions):
                    self._put(k, motions[step])
            if step < steps:
                began = time.process_time()
                self._step()
                spent += time.process_time() - began
        return self._states(), spent

    def _driven(self, start, count, released):
        """What is put where before each of so many steps, by the body; of held ones until they are let go."""
        scene, dt = self._scene, self._settings.dt
        times = dt * np.arange(count)
        paths = {
            k: path_states(scene, k, times) for k, b in enumerate(scene.bodies) if b.trajectory is not None
        }
        found = {k: _motions(self._bodies[k], states) for k, states in paths.items()}
        names = [body.name for body in scene.bodies]
        for k, body in enumerate(scene.bodies):
            if body.attached_to is not None:
                hand = paths[names.index(body.attached_to)]
                own = hand[times <= released.get(k, body.released_at) - 0.5 * dt]
                carried = carry_along(np.repeat(start[None], len(own), axis=0), k, hand[:1].copy(), own)
                found[k] = _motions(self._bodies[k], carried[:, k])
        return found


def text_of(values) -> str:
    """Numbers as the engines' files take them."""
    return " ".join(repr(value) for value in np.asarray(values, float).tolist())


def belt_velocity(solid) -> np.ndarray:
    """Velocity (3,) of an element's surface [m/s]."""
    return np.array(solid.moving_surface[:3])


def check_solid(solid) -> None:
    """Refuse an element of the environment that is not known here.

    Raises
    ------
    NotSupportedError
        If it is no plane or box, or turns.
    """
    if not isinstance(solid, Plane | Box) or np.any(solid.moving_surface[3:]):
        raise NotSupportedError("is no plane or box", field="environment", value=type(solid).__name__)
