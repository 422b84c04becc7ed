"""A scene as the data of the explicit step's kernels: arrays in NamedTuples."""

from typing import NamedTuple

import numpy as np

from ..actions import Actions
from .sphere_tree import Tree


class Bodies(NamedTuple):
    """Constants of the B bodies.

    Attributes
    ----------
    moving : (B,) bool
    mass : (B,) float64
        [kg]; undefined for a fixed body.
    inertia : (B, 3, 3) float64
        About the centre of mass, body frame [kg m^2]; undefined for a fixed body.
    inverse_mass : (B,) float64
        1/kg; 0 for a fixed body.
    inverse_inertia : (B, 3, 3) float64
        Body frame [1/(kg m^2)]; 0 for a fixed body.
    radius : (B,) float64
        Radius of a ball about the centre of mass that contains all spheres [m].
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


class Environment(NamedTuple):
    """The E elements of the environment, the actions, and the choice of the gyroscopic term.

    Attributes
    ----------
    kind : (E,) int64
        Indices of the elements' shapes (`physics.paper.solids.KINDS`).
    position : (E, 3) float64
        Origins of the elements' frames: a point of a plane, otherwise the centre [m].
    R : (E, 3, 3) float64
        ``R_world_element``; a plane's normal is its z axis.
    size : (E, 3) float64
        Size parameters [m], as defined in each shape's module.
    gyroscopic : bool
        Whether rotation conserves angular momentum, instead of angular velocity as in the paper.
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
        Sphere trees of all models; bodies with the same model share a tree.
    gravity : (3,) float64
        World frame [m/s^2].
    dt : float
        Time step [s].
    decay : float
        Factor on all velocities in a step, ``exp(-damping dt)``.
    stiffness : float
        kappa [N/m^3].
    stack_size : int
        Largest stack size of a search through two trees.
    environment : Environment or None
        None for the paper's physics, for which kernels compile without surroundings. Functions that depend on
        this take them as a separate argument, since numba removes branches only for arguments that are None.
    """

    bodies: Bodies
    tree: Tree
    gravity: np.ndarray
    dt: float
    decay: float
    stiffness: float
    stack_size: int
    environment: Environment | None
