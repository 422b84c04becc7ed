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


class Laws(NamedTuple):
    """Physics beyond the paper's, and the E elements of the environment.

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
    friction : float
        Coulomb's coefficient; 0 without friction.
    dissipation : float
        ``(1 - e^2) / 2`` of the coefficient of restitution e; 0 for elastic contacts.
    gyroscopic : bool
    robust : bool
        Whether steps are divided and kicks linearly implicit.
    thickness : (B,) float64
        Radius of the largest sphere of each body [m].
    smallest : (B,) float64
        Radius of the smallest.
    mass : (B,) float64
        [kg]
    inertia : (B, 3, 3) float64
        Body frame [kg m^2].
    """

    kind: np.ndarray
    position: np.ndarray
    R: np.ndarray
    size: np.ndarray
    friction: float
    dissipation: float
    gyroscopic: bool
    robust: bool
    thickness: np.ndarray
    smallest: np.ndarray
    mass: np.ndarray
    inertia: np.ndarray


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
    laws : Laws or None
        Their type decides what is compiled: functions take them as an argument of their own, ``world.laws``, since
        only an argument's being None removes a branch from the code.
    """

    bodies: Bodies
    tree: Tree
    gravity: np.ndarray
    dt: float
    decay: float
    stiffness: float
    stack_size: int
    laws: Laws
