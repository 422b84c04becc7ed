"""Scenes with bodies on prescribed paths in other engines.

Masses, inertias, frictions of each pair and initial states are ours. Before each step a prescribed body is
put where its path says. In MuJoCo such a body is a mocap body; contacts take it to stand still, so its
velocity is given as that of its surface. In PyBullet it is a body without mass whose velocity is set.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from unc_physics.checks.errors import NotSupportedError
from unc_physics.scene.environment import Plane
from unc_physics.scene.kinematic_states import path_states
from unc_physics.spatial.layout import ANGULAR_VELOCITY, POSITION, QUATERNION, VELOCITY

from .engines import PrincipalBody

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
    """Settings of an engine.

    Attributes
    ----------
    dt : float
        [s]
    iterations : int
        Iterations of PyBullet's solver in a step.
    contact_time : float
        Time constant of MuJoCo's contacts [s].
    firm_friction : float
        Ratio of the stiffness of friction to that of contacts in MuJoCo (``impratio``).
    """

    dt: float
    iterations: int = 50
    contact_time: float = 0.02
    firm_friction: float = 1.0

    def words(self, engine: str) -> str:
        """Return a description for a report."""
        first = f"{1e3 * self.dt:.3g} ms steps"
        if engine == "pybullet":
            return f"{first}, {self.iterations} iterations"
        return f"{first}, contacts of {1e3 * self.contact_time:.3g} ms, impratio {self.firm_friction:g}"


def shapes_of(body) -> list[Shape]:
    """Return the spheres of a body's model as shapes; raise if there are many."""
    model = body.model
    if len(model.radii) <= _MOST_SPHERES:
        return [Shape("sphere", (r,), c) for c, r in zip(model.centers, model.radii.tolist(), strict=True)]
    raise NotSupportedError("needs shapes of its own in other engines", field="model", value=model.name)


class Motion(NamedTuple):
    """Motion of a body's principal axes: position, quaternion (x, y, z, w), and velocities in the world's
    axes and in its own axes.
    """

    place: np.ndarray
    q: np.ndarray
    velocity: np.ndarray
    spin: np.ndarray
    own_velocity: np.ndarray
    own_spin: np.ndarray


def _motions(body: PrincipalBody, states: np.ndarray) -> list[Motion]:
    """Return the motion of the principal axes in each of a body's states (n, 13)."""
    states = np.array(states)
    velocity, spin = states[:, VELOCITY], states[:, ANGULAR_VELOCITY]
    turned = Rotation.from_quat(states[:, QUATERNION]) * body.axes
    back = turned.inv()
    columns = states[:, POSITION], turned.as_quat(), velocity, spin, back.apply(velocity), back.apply(spin)
    return [Motion(*row) for row in zip(*columns, strict=True)]


class ActionEngine:
    """Scene with actions in an engine; ``shapes`` has the shapes of bodies that `shapes_of` refuses."""

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
        """Return whether two bodies never collide, because neither moves freely."""
        return not (self._scene.bodies[a].free or self._scene.bodies[b].free)

    def run(self, start: np.ndarray, horizon: float) -> tuple[np.ndarray, float]:
        """Return the states (B, 13) at the horizon and the CPU time of the engine's steps [s].

        Parameters
        ----------
        start : (B, 13) array
        horizon : float
            [s]
        """
        steps, spent = round(horizon / self._settings.dt), 0.0
        kinematic = self._kinematic(steps + 1)
        self._begin([_motions(body, state[None])[0] for body, state in zip(self._bodies, start, strict=True)])
        for step in range(steps + 1):
            for k, motions in kinematic.items():
                self._put(k, motions[step])
            if step < steps:
                began = time.process_time()
                self._step()
                spent += time.process_time() - began
        return self._states(), spent

    def _kinematic(self, count):
        """Return the motions of each prescribed body, one for each step."""
        times = self._settings.dt * np.arange(count)
        return {
            k: _motions(self._bodies[k], path_states(self._scene, k, times))
            for k, body in enumerate(self._scene.bodies)
            if body.trajectory is not None
        }


def text_of(values) -> str:
    """Format numbers for the engines' files."""
    return " ".join(repr(value) for value in np.asarray(values, float).tolist())


def check_solid(solid) -> None:
    """Refuse an element of the environment other than a plane at rest.

    Raises
    ------
    NotSupportedError
        If it is another one.
    """
    if not isinstance(solid, Plane) or np.any(solid.moving_surface):
        raise NotSupportedError("is no plane at rest", field="environment", value=type(solid).__name__)
