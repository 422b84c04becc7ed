"""Sets of recorded motions of one object each, from folders: what `evaluate reality` predicts.

A folder holds sets, itself and each folder in it. A set is one of

* ``scene.yaml``, the scene file of one body and its surroundings, and ``motions.csv`` or ``motions.npz`` as
  `calibrate` reads them; each motion begins in free flight and ends at rest;
* ``tosses.npz``, of the cube of ContactNets (``data/tosses/README.md``);
* ``household_tosses.npz`` and ``meshes/NAME.obj``, several objects (``data/household_tosses/README.md``);
* ``pushes.npz``, pushes of a block (``data/pushes/README.md``).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from unc_physics.calibration.adjustable import FITTABLE, Adjustable, Model, chosen
from unc_physics.calibration.calibrate import with_noise
from unc_physics.calibration.flight import fit_start, flight_gravity
from unc_physics.calibration.motions import Motion, read_motions
from unc_physics.calibration.objective import Recorded, recorded
from unc_physics.checks.errors import InvalidRequestError
from unc_physics.scene.belief import Belief
from unc_physics.scene.body import RigidBody
from unc_physics.scene.environment import Plane
from unc_physics.scene.scene import Scene
from unc_physics.scene.scene_file import load_scene
from unc_physics.shapes.solid_mesh import load_solid

from .polyhedron import SHARP, Polyhedron, box
from .recorded_pushes import KINDS, recorded_pushes
from .recorded_tosses import recorded_tosses

DATA = Path(__file__).parent / "data"
_GRAVITY_HOUSEHOLD = (0.0, 0.0, -9.4)  # m/s^2, as its flights fall: the scale of its tags is 4 % off
_MASSES = {"cube": 0.37}
#: Errors of recorded poses [m], [rad], as the READMEs of both recordings give them after contact.
_NOISE_TOSSES, _NOISE_HOUSEHOLD = (3e-4, 4e-3), (1e-3, 3e-3)
_CORNER = 3e-3  # m
_LONG = 0.5  # s, that each motion lasts at least: it ends at rest


class KnownStart(NamedTuple):
    """A start with a recorded covariance; `flight.FlightStart` fits one.

    Attributes
    ----------
    state : (13,) array
    covariance : (12, 12) array
    """

    state: np.ndarray
    covariance: np.ndarray

    def belief(self, position_noise: float, rotation_noise: float) -> Belief:
        """Return the belief at time 0; it does not depend on errors of later poses."""
        return Belief(self.state[None], self.covariance[None])


class RecordedSet(NamedTuple):
    """Motions of one object on one table.

    Attributes
    ----------
    name : str
    scene : Scene
        Scene of a user who knows only the shapes.
    motions : tuple of Motion
    noise : (float, float), optional
        Standard deviations of recorded poses [m], [rad]; None if they are fitted to flights.
    starts : tuple of KnownStart, optional
        None if starts are fitted to the first poses.
    gravity : (3,) array, optional
        Measured acceleration of flights in this recording, if known [m/s^2].
    solid : Polyhedron, optional
        The object, if its corners may be rounded.
    """

    name: str
    scene: Scene
    motions: tuple[Motion, ...]
    noise: tuple[float, float] | None = None
    starts: tuple[KnownStart, ...] | None = None
    gravity: Sequence[float] | None = None
    solid: Polyhedron | None = None

    def recorded(self, scene: Scene, chosen: Sequence[int]) -> list[Recorded]:
        """Return motions with their starts in a scene."""
        motions = [_until(self.motions[k], _LONG) for k in chosen]
        found = recorded(motions, scene, starts=self._starts_of(chosen))
        assert len(found) == len(chosen)
        return found

    def _starts_of(self, chosen):
        return None if self.starts is None else [self.starts[k] for k in chosen]

    def model(self, chosen: Sequence[int], scene: Scene) -> Model:
        """Return the scene, and the errors of poses estimated from motions."""
        if self.noise is not None:
            return Model(scene, *self.noise)
        return with_noise(scene, self.recorded(scene, chosen))

    def measured_scene(self, chosen: Sequence[int]) -> Scene:
        """Return the scene with the gravity measured in motions, which depends on the recording's scale."""
        gravity = self.gravity
        if gravity is None:
            measured = flight_gravity([self.motions[k] for k in chosen], self.scene)
            gravity = None if measured is None else measured.acceleration
        return self.scene if gravity is None else replace(self.scene, gravity=gravity)

    def adjusted(self, names: Sequence[str] = FITTABLE) -> list[Adjustable]:
        """Return the fitted parameters with priors: those of `calibrate` and the radius of corners."""
        solid = self.solid
        if solid is None:
            return chosen(self.scene, names)

        def put(model, value):
            body = model.scene.bodies[0]
            own = replace(body, model=solid.packing(value), inertia=body.unit_inertia)
            return model._replace(scene=replace(model.scene, bodies=[own]))

        corner = Adjustable(
            "corner_radius",
            "m",
            "of the body's corners",
            SHARP,
            0.02,
            0.7,
            get=lambda model: float(model.scene.bodies[0].model.radii[0]),
            put=put,
            relative=True,
            typical=_CORNER,
            keeps_scene=False,
        )
        return [*chosen(self.scene, names), corner]


class PushSet(NamedTuple):
    """Pushes of one kind.

    Attributes
    ----------
    name : str
    folder : Path
    pushes : tuple of int
    """

    name: str
    folder: Path
    pushes: tuple[int, ...]

    @property
    def motions(self) -> tuple[int, ...]:
        """The pushes."""
        return self.pushes


def read_sets(folder: Path | str | None = None) -> dict[str, RecordedSet | PushSet]:
    """Read all sets of a folder, by name; by default those of this package.

    Raises
    ------
    InvalidRequestError
        If there is none.
    """
    return dict(_own_sets()) if folder is None else _read_folder(Path(folder))


@cache
def _own_sets():
    """Return the sets of this package, cached because each job needs them and reading takes seconds."""
    return _read_folder(DATA)


def _read_folder(folder):
    if not folder.is_dir():
        raise InvalidRequestError("must be a folder of recorded motions", field="--data", value=str(folder))
    found: dict[str, RecordedSet | PushSet] = {}
    for own in (folder, *sorted(path for path in folder.iterdir() if path.is_dir())):
        for name, read in _LAYOUTS.items():
            if (own / name).is_file():
                found |= {one.name: one for one in read(own) if len(one.motions) > 1}
    if not found:
        raise InvalidRequestError(
            f"holds no set of at least two motions: {', '.join(_LAYOUTS)}", field="--data", value=str(folder)
        )
    return found


def _from_scene(folder):
    scene = load_scene(str(folder / "scene.yaml")).scene
    paths = [path for path in (folder / "motions.csv", folder / "motions.npz") if path.is_file()]
    if not paths:
        raise InvalidRequestError("needs motions.csv or motions.npz", field="--data", value=str(folder))
    motions = read_motions(paths[0])
    yield RecordedSet(folder.resolve().name, scene, _in_flight(motions, scene))


def _in_flight(motions, scene):
    """Return the motions whose start can be fitted."""
    return tuple(motion for motion in motions if fit_start(motion, scene) is not None)


def _until(motion, time):
    """Return the motion, extended at its last pose until a time [s]."""
    if motion.duration >= time:
        return motion
    return Motion(motion.name, [*motion.times, time], [*motion.poses, motion.poses[-1]])


def _on_table(solid: Polyhedron, mass: float, table: float) -> Scene:
    return Scene.everyday(
        [RigidBody(solid.name, solid.packing(), mass)], environment=[Plane(offset=table, name="table")]
    )


def _tosses(folder):
    tosses = recorded_tosses(folder)
    solid = box("cube", np.full(3, 2.0 * tosses.half_width))
    every = range(len(tosses.states))
    level, table = tosses.level(every), tosses.rest_height(every) - tosses.half_width
    scene = _on_table(solid, tosses.mass, table)
    motions = _in_flight([tosses.motion(k, level) for k in every], scene)
    yield RecordedSet("cube tosses", scene, motions, _NOISE_TOSSES, solid=solid)


def _household(folder):
    with np.load(folder / "household_tosses.npz") as file:
        data = {name: file[name] for name in file.files}
    for name in dict.fromkeys(data["object"][data["usable"]].tolist()):
        mesh = load_solid(folder / "meshes" / f"{name}.obj")[0]
        vertices = np.unique(mesh.corners.reshape(-1, 3).round(9), axis=0)
        solid = Polyhedron(name, vertices, mesh.inertia)
        motions, starts = [], []
        for k in np.flatnonzero(data["usable"] & (data["object"] == name)):
            first, last = data["offsets"][k] + data["flight"][k][1], data["offsets"][k + 1]
            up = np.array([0.0, 0.0, data["table_height"][k]])
            # the last rotation is an edge of a median of three
            poses = np.hstack([data["position"][first : last - 1] - up, data["quaternion"][first : last - 1]])
            times = np.arange(len(poses)) / data["rate"][k]
            motions.append(Motion(f"{name} {data['toss'][k]}", times, poses))
            state = data["start"][k].copy()
            state[:3] -= up
            starts.append(KnownStart(state, data["start_covariance"][k].astype(float)))
        scene = _on_table(solid, _MASSES.get(name, 0.056), 0.0)
        yield RecordedSet(
            f"household {name}",
            scene,
            tuple(motions),
            _NOISE_HOUSEHOLD,
            tuple(starts),
            _GRAVITY_HOUSEHOLD,
            solid,
        )


def _pushes(folder):
    kind = recorded_pushes(folder).kind
    for k, name in enumerate(KINDS):
        own = tuple(np.flatnonzero(kind == k).tolist())
        yield PushSet(f"pushes, {name.replace('_', ' ')}", folder, own)


_LAYOUTS: dict[str, Callable] = {
    "scene.yaml": _from_scene,
    "tosses.npz": _tosses,
    "household_tosses.npz": _household,
    "pushes.npz": _pushes,
}
