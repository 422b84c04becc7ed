"""Real pushes of a block over a table, recorded by others, and scenes of them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from unc_physics.scene.actions import PosePath
from unc_physics.scene.belief import Belief
from unc_physics.scene.body import RigidBody
from unc_physics.scene.environment import Plane
from unc_physics.scene.scene import IMPACT_STDS, Scene
from unc_physics.shapes.packing_file import SpherePacking
from unc_physics.shapes.pieces import Hull, ball
from unc_physics.spatial.layout import POSITION, QUATERNION, STATE

FOLDER = Path(__file__).parent / "data" / "pushes"
KINDS = ("point", "two_point_translation", "two_point_rotation")
PATCH = 4  # the support by the whole face
DT = 1.0 / 120.0  # s
_TIP, EDGE, _SPACING, FOOT = 1.5e-4, 3e-3, 1.5e-4, 3e-3  # m: radii of tips, edges and feet; between spheres
_SIDE = 1e-3  # m, half of the flat side of the block's piece, at the tips' height
HEIGHT = 0.0125  # m, of the tips above the block's underside
#: Where the tips of a pusher with one, and of one with two are in its frame [m].
TIPS = np.zeros((1, 3)), np.array([[0.0, -0.025, 0.0], [0.0, 0.025, 0.0]])
#: What is not known of the pushes: standard deviations of both frictions, of where the load is, as feet rub
#: unlike each other [m], and of the pusher's frame [m].
_TABLE_STD, _LOAD_STD, _FRAME_STD = (0.02, 0.03), 4e-3, 5e-4
#: Friction of one tip, and of two, as the forces along them show in pushes that slide: mean and standard
#: deviation of each.
_TIP_FRICTION = (0.55, 0.1), (0.34, 0.05)
#: By how much pushes of the same command end apart: standard deviations of a place [m] and of the yaw [rad].
REPEATS_STD = 8.4e-4, 8.4e-4, math.radians(1.3)


class Pushes(NamedTuple):
    """Recorded pushes.

    Attributes
    ----------
    kind, support, surface : (N,) int arrays
    before, after : (N, 3) arrays
        Position of the block's right-angled corner on the table [m], and yaw [rad].
    paths : tuple of (n, 5) arrays
        Times [s], position [m] and yaw [rad] of each pusher's tip, or of the midpoint of its two tips.
    supports : (4, 3, 2) array
        Positions of the block's feet relative to that corner [m].
    polygon, com : arrays
        Corners (3, 2) and centre of mass (2,) relative to that corner [m].
    height, mass : float
        [m], [kg]
    table_friction : (2,) array
        Of each surface.
    """

    kind: np.ndarray
    support: np.ndarray
    surface: np.ndarray
    before: np.ndarray
    after: np.ndarray
    paths: tuple[np.ndarray, ...]
    supports: np.ndarray
    polygon: np.ndarray
    com: np.ndarray
    height: float
    mass: float
    table_friction: np.ndarray


@cache
def recorded_pushes(folder: Path = FOLDER) -> Pushes:
    """Read the pushes of a folder, with the tip's correction from the README of the package's data."""
    with np.load(folder / "pushes.npz") as file:
        data = {name: file[name] for name in file.files}
    shift = data["pusher_tip_correction_point"]
    paths = []
    for k, (first, last) in enumerate(
        zip(data["pusher_offset"][:-1], data["pusher_offset"][1:], strict=True)
    ):
        t, pose = data["pusher_t"][first:last], data["pusher_pose"][first:last].astype(float)
        yaw = np.unwrap(pose[:, 3])
        place = pose[:, :2].copy()
        if data["kind"][k] == 0:
            c, s = np.cos(yaw), np.sin(yaw)
            place += np.column_stack([c * shift[0] - s * shift[1], s * shift[0] + c * shift[1]])
        paths.append(_ascending(np.column_stack([t.astype(float), place, yaw])))
    return Pushes(
        data["kind"].astype(int),
        data["support_id"].astype(int),
        data["surface_id"].astype(int),
        data["object_planar_before"],
        data["object_planar_after"],
        tuple(paths),
        data["support_points"],
        data["object_polygon"],
        data["object_com"],
        float(data["object_height"]),
        float(data["object_mass"]),
        data["friction_surface_estimate"],
    )


def _ascending(path):
    """Return the rows of a path with ascending times."""
    kept = np.concatenate([[True], np.diff(np.maximum.accumulate(path[:, 0])) > 1e-6])
    return path[kept]


@cache
def block(support: int) -> SpherePacking:
    """Return the block's packing: small spheres along its edges at the height of the tips, and its feet."""
    pushes = recorded_pushes()
    corners, com = pushes.polygon, pushes.com
    low = -0.5 * pushes.height
    centers, radii = [], []
    for a, along, inward, length, margin in edges():
        places = np.arange(margin, length - margin, _SPACING)
        row = a + places[:, None] * along + EDGE * inward - com
        centers.append(np.column_stack([row, np.full(len(row), low + HEIGHT)]))
        radii.append(np.full(len(row), EDGE))
    feet = feet_of(support) - com
    centers.append(np.column_stack([feet, np.full(len(feet), low + FOOT)]))
    radii.append(np.full(len(feet), FOOT))
    places, sizes = np.concatenate(centers), np.concatenate(radii)
    own = edges()
    inset = [
        b.start - com + EDGE * (a.inward + b.inward) / (1.0 + a.inward @ b.inward)
        for a, b in zip([own[-1], *own], own, strict=False)
    ]
    reach = float(np.max(np.linalg.norm(places, axis=1) + sizes))
    return SpherePacking(
        name=f"block_{support}",
        centers=places,
        radii=sizes,
        inertia=_inertia(corners, com, pushes.height),
        volume=pushes.mass / 2700.0,
        origin=np.zeros(3),
        bounding_radius=reach,
        pieces=[
            Hull([(*corner, low + HEIGHT + z) for corner in inset for z in (-_SIDE, _SIDE)], EDGE),
            *(ball(FOOT, (*foot, low + FOOT)) for foot in feet),
        ],
    )


class Edge(NamedTuple):
    """An edge of the block.

    Attributes
    ----------
    start : (2,) array
        First end relative to the block's corner [m].
    along, inward : (2,) arrays
        Directions.
    length : float
        [m]
    margin : float
        Length without spheres at both ends, because spheres do not fill sharp corners [m].
    """

    start: np.ndarray
    along: np.ndarray
    inward: np.ndarray
    length: float
    margin: float


def edges() -> list[Edge]:
    """Return the block's edges."""
    corners, found = recorded_pushes().polygon, []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        length = float(np.linalg.norm(b - a))
        along = (b - a) / length
        inward = np.array([-along[1], along[0]])
        found.append(Edge(a, along, inward, length, EDGE / math.tan(math.radians(22.5))))
    return found


def feet_of(support: int) -> np.ndarray:
    """Return the positions (3, 2) of the block's feet relative to its corner [m].

    Three points with the face's mean distance from the centre represent the whole face.
    """
    pushes = recorded_pushes()
    if support != PATCH:
        return pushes.supports[support]
    arms = pushes.polygon - pushes.com
    mean = np.linalg.norm(face_points() - pushes.com, axis=1).mean()
    return pushes.com + arms * mean / np.linalg.norm(arms, axis=1).mean()


def face_points() -> np.ndarray:
    """Return evenly spread points (n, 2) of the block's face relative to its corner [m]."""
    _, one, other = recorded_pushes().polygon  # from the first, the right-angled one
    u, v = np.meshgrid(*[(np.arange(200) + 0.5) / 200] * 2)
    inside = (u + v) < 1.0
    return np.outer(u[inside], one) + np.outer(v[inside], other)


def _inertia(corners, com, height):
    """Return the inertia per unit mass of a right-angled prism about its centre of mass [m^2]."""
    x, y = corners[:, 0] - com[0], corners[:, 1] - com[1]
    xx, yy, xy = (x @ x) / 12.0, (y @ y) / 12.0, (x @ y) / 12.0
    zz = height**2 / 12.0
    return np.array([[yy + zz, -xy, 0.0], [-xy, xx + zz, 0.0], [0.0, 0.0, xx + yy]])


@cache
def pusher(tips: int) -> SpherePacking:
    """Return the packing of one tip, or of two tips 5 cm apart."""
    places = TIPS[tips - 1]
    reach = float(np.max(np.linalg.norm(places, axis=1))) + _TIP
    return SpherePacking(
        name=f"pusher_{tips}",
        centers=places,
        radii=np.full(tips, _TIP),
        inertia=1e-4 * np.eye(3),
        volume=1e-6,
        origin=np.zeros(3),
        bounding_radius=reach,
    )


class Frictions(NamedTuple):
    """Friction coefficients of the table and the tips in a push, and their standard deviations."""

    table: float
    tip: float
    table_std: float = 0.0
    tip_std: float = 0.0


def measured_frictions(k: int, folder: Path = FOLDER) -> Frictions:
    """Return the friction coefficients of push ``k``, measured by its forces."""
    pushes = recorded_pushes(folder)
    surface, tip = int(pushes.surface[k]), _TIP_FRICTION[min(pushes.kind[k], 1)]
    return Frictions(float(pushes.table_friction[surface]), tip[0], _TABLE_STD[surface], tip[1])


@dataclass(frozen=True)
class Push:
    """Scene, belief and duration [s] of a push."""

    scene: Scene
    belief: Belief
    horizon: float


def push_scene(
    k: int, frictions: Frictions | None, load_std: float = 0.0, frame_std: float = 0.0, folder: Path = FOLDER
) -> Push:
    """Return push ``k``.

    Parameters
    ----------
    k : int
    frictions : Frictions or None
        None selects the frictions of everyday objects, separate for block, tips and table.
    load_std, frame_std : float
        Standard deviations of the positions of the load and of the pusher [m].
    folder : Path
        Folder of the pushes.
    """
    pushes = recorded_pushes(folder)
    path = pushes.paths[k]
    times = path[:, 0] - path[0, 0]
    poses = np.column_stack([path[:, 1:3], np.full(len(path), HEIGHT)])
    yaw = 0.5 * path[:, 3]
    turned = np.column_stack([np.zeros((len(path), 2)), np.sin(yaw), np.cos(yaw)])
    block_surface: dict[str, Any] = {}
    tip_surface: dict[str, Any] = {}
    table_surface: dict[str, Any] = {}
    physics: dict[str, Any] = {}
    if frictions is None:
        unknown = Scene.everyday([RigidBody("block", block(int(pushes.support[k])), pushes.mass)])
        block_surface = {"friction": unknown.friction, "friction_std": unknown.friction_std}
        tip_surface = table_surface = block_surface
    else:
        # a contact has the geometric mean of its partners' frictions; the block's is 1
        table, tip, table_std, tip_std = frictions
        block_surface = {"friction": 1.0}
        tip_surface = {"friction": tip**2, "friction_std": 2.0 * tip * tip_std}
        table_surface = {"friction": table**2, "friction_std": 2.0 * table * table_std}
        physics = dict.fromkeys(("friction", "restitution", "impact_friction_speed"))
        physics |= dict.fromkeys(IMPACT_STDS, 0.0)
    model = block(int(pushes.support[k]))
    bodies = [
        RigidBody("block", model, pushes.mass, center_of_mass_std=(load_std, load_std, 0.0), **block_surface),
        RigidBody(
            "pusher",
            pusher(1 if pushes.kind[k] == 0 else 2),
            trajectory=PosePath(times=times, positions=poses, orientations=turned),
            trajectory_std=(frame_std, frame_std, 0.0, 0.0, 0.0, 0.0),
            **tip_surface,
        ),
    ]
    scene = Scene.everyday(
        bodies, dt=DT, environment=[Plane(name="table", **table_surface)], overlap="keep", **physics
    )
    mean = np.zeros((2, STATE))
    mean[:, QUATERNION] = 0.0, 0.0, 0.0, 1.0
    mean[0] = _state(pushes.before[k], pushes)
    return Push(scene, Belief.exact(mean, scene.moving), float(times[-1]) + 0.1)


def uncertain_push(k: int, measured: bool = True, folder: Path = FOLDER) -> Push:
    """Return push ``k`` with uncertain frictions, measured or not, and uncertain positions."""
    frictions = measured_frictions(k, folder) if measured else None
    return push_scene(k, frictions, _LOAD_STD, _FRAME_STD, folder)


def _state(planar, pushes):
    """Return the state (13,) of the block for the position and yaw (3,) of its corner on the table."""
    x, y, theta = planar
    c, s = math.cos(theta), math.sin(theta)
    state = np.zeros(STATE)
    state[POSITION] = (
        x + c * pushes.com[0] - s * pushes.com[1],
        y + s * pushes.com[0] + c * pushes.com[1],
        0.5 * pushes.height,
    )
    state[QUATERNION] = 0.0, 0.0, math.sin(0.5 * theta), math.cos(0.5 * theta)
    return state


def planar(states: np.ndarray) -> np.ndarray:
    """Return position on the table [m] and yaw [rad] (..., 3) of the centre of mass in states (..., 13)."""
    q = states[..., QUATERNION]
    yaw = 2.0 * np.arctan2(q[..., 2], q[..., 3])
    return np.concatenate([states[..., :2], yaw[..., None]], axis=-1)


def planar_before(k: int, folder: Path = FOLDER) -> np.ndarray:
    """Return the block's pose (3,) before push ``k``, as `planar`."""
    pushes = recorded_pushes(folder)
    return planar(_state(pushes.before[k], pushes))


def seen(k: int, folder: Path = FOLDER) -> np.ndarray:
    """Return the block's pose (3,) after push ``k``, as `planar`."""
    pushes = recorded_pushes(folder)
    return planar(_state(pushes.after[k], pushes))
