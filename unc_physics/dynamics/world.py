"""What the kernels know of a scene: plain arrays in NamedTuples."""

from typing import NamedTuple

import numpy as np

from ..collision.sphere_tree import Tree
from .actions import Actions
from .implicit_world import Implicit


class Bodies(NamedTuple):
    """Constants of the B bodies.

    Attributes
    ----------
    moving : (B,) bool
    mass : (B,) float64
        [kg]; has no meaning for a fixed body.
    inertia : (B, 3, 3) float64
        About the centre of mass, body frame [kg m^2]; has no meaning for a fixed body.
    inverse_mass : (B,) float64
        1/kg; 0 for a fixed body.
    inverse_inertia : (B, 3, 3) float64
        Body frame [1/(kg m^2)]; 0 for a fixed body.
    radius : (B,) float64
        Of a ball about the centre of mass that holds all spheres [m].
    root : (B,) int64
        Root node of the body's sphere tree.
    """

    moving: np.ndarray
    mass: np.ndarray
    inertia: np.ndarray
    inverse_mass: np.ndarray
    inverse_inertia: np.ndarray
    radius: np.ndarray
    root: np.ndarray


class Surroundings(NamedTuple):
    """The E elements of the environment, what acts on bodies from outside, and whether free flight goes
    beyond the paper's.

    Attributes
    ----------
    kind : (E,) int64
        Of the elements' shapes (`shapes.KINDS`).
    position : (E, 3) float64
        Origins of the elements' frames: a point of a plane, otherwise the middle [m].
    R : (E, 3, 3) float64
        ``R_world_element``; a plane's normal is its z axis.
    size : (E, 3) float64
        What each shape's file takes for its size [m].
    gyroscopic : bool
        Whether a turning body keeps its angular momentum, instead of its angular velocity as in the paper.
    actions : Actions
    """

    kind: np.ndarray
    position: np.ndarray
    R: np.ndarray
    size: np.ndarray
    gyroscopic: bool
    actions: Actions


class World(NamedTuple):
    """A scene without its state.

    Attributes
    ----------
    bodies : Bodies
    tree : Tree
        Sphere trees of all models; bodies of one model share one.
    gravity : (3,) float64
        World frame [m/s^2].
    dt : float
        Time step [s].
    start : float
        Time before step 0 [s]: step ``k`` of the implicit integrator begins at ``start + k dt``. It is 0 but
        for the short step before a time that is no multiple of ``dt``.
    decay : float
        Factor on all velocities in a step, ``exp(-damping dt)``.
    stiffness : float
        kappa [N/m^3].
    stack_size : int
        Room that a search through two trees needs at most.
    surroundings : Surroundings or None
        None for the paper's physics, for which the kernels compile without them. Functions whose code depends
        on that take them as an argument of their own: numba removes a branch only where an argument is None.
    implicit : Implicit or None
        What the implicit step knows besides; None for the explicit one.
    """

    bodies: Bodies
    tree: Tree
    gravity: np.ndarray
    dt: float
    start: float
    decay: float
    stiffness: float
    stack_size: int
    surroundings: Surroundings | None
    implicit: Implicit | None
