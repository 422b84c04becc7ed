"""What the kernels know of a scene: plain arrays in NamedTuples."""

from typing import NamedTuple

import numpy as np

from .tree import Tree


class Bodies(NamedTuple):
    """Constants of the B bodies.

    Attributes
    ----------
    moving : (B,) bool
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
    inverse_mass: np.ndarray
    inverse_inertia: np.ndarray
    radius: np.ndarray
    root: np.ndarray


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
    decay : float
        Factor on all velocities in a step, ``exp(-damping dt)``.
    stiffness : float
        kappa [N/m^3].
    stack_size : int
        Room that a search through two trees needs at most.
    """

    bodies: Bodies
    tree: Tree
    gravity: np.ndarray
    dt: float
    decay: float
    stiffness: float
    stack_size: int
