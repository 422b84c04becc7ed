"""Bodies on prescribed paths in MuJoCo (`action_engine_base`)."""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np
from scipy.spatial.transform import Rotation

from .action_engine_base import ActionEngine, check_solid, text_of

_MOCAP = ' mocap="true"'


class MuJoCoActions(ActionEngine):
    """Scene in MuJoCo: elliptic cones, Newton's method, and the friction of each pair of shapes."""

    def _make(self):
        import mujoco

        self._mujoco, s = mujoco, self._settings
        text, geoms = [], []  # of geoms: body, -1 for the environment, and friction
        for k, (body, one, shapes) in enumerate(
            zip(self._scene.bodies, self._bodies, self._shapes, strict=True)
        ):
            moment = " ".join(repr(value) for value in one.inertia.tolist())
            head = (
                f'<freejoint/><inertial pos="0 0 0" mass="{one.mass!r}" diaginertia="{moment}"/>'
                if body.free
                else ""
            )
            inner = "".join(
                _geom(f"g{len(geoms) + n}", shape, 0.0 if body.free else 1.0)
                for n, shape in enumerate(shapes)
            )
            geoms += [(k, self._friction(body))] * len(shapes)
            text.append(f'<body name="b{k}"{"" if body.free else _MOCAP}>{head}{inner}</body>')
        for solid in self._scene.environment:
            text.append(_solid(f"g{len(geoms)}", solid))
            geoms.append((-1, self._friction(solid)))
        pairs = [
            f'<pair geom1="g{i}" geom2="g{j}" condim="3" friction="{mu!r} {mu!r} 0 0 0"'
            f' solref="{s.contact_time!r} 1"/>'
            for (i, (a, p)), (j, (b, q)) in combinations(enumerate(geoms), 2)
            if self._may_touch(a, b)
            for mu in [max(math.sqrt(p * q), 1e-5)]
        ]
        gravity = " ".join(map(repr, self._scene.gravity.tolist()))
        self._model = model = mujoco.MjModel.from_xml_string(
            f'<mujoco><option cone="elliptic" timestep="{s.dt!r}" impratio="{s.firm_friction!r}"'
            f' tolerance="1e-10" gravity="{gravity}"/>'
            '<default><geom contype="0" conaffinity="0" mass="0"/></default>'
            f"<worldbody>{''.join(text)}</worldbody><contact>{''.join(pairs)}</contact></mujoco>"
        )
        self._data = mujoco.MjData(model)
        self._joint, self._mocap, free = {}, {}, 0
        for k, (body, one) in enumerate(zip(self._scene.bodies, self._bodies, strict=True)):
            if body.free:
                damping = [one.mass] * 3 + one.inertia.tolist()
                model.dof_damping[6 * free : 6 * free + 6] = self._scene.damping * np.array(damping)
                self._joint[k], free = free, free + 1
            else:
                self._mocap[k] = len(self._mocap)
        # MuJoCo orders geoms by their bodies
        geom = mujoco.mjtObj.mjOBJ_GEOM
        indices = iter([mujoco.mj_name2id(model, geom, f"g{n}") for n in range(len(geoms))])
        self._surfaces = [
            [(next(indices), shape.place, shape.turned.as_matrix()) for shape in shapes]
            for shapes in self._shapes
        ]

    def _may_touch(self, a, b):
        if a == b:
            return False
        if min(a, b) < 0:
            return self._scene.bodies[max(a, b)].free
        return not self._apart(a, b)

    def _begin(self, start):
        self._mujoco.mj_resetData(self._model, self._data)
        for k, motion in enumerate(start):
            self._put(k, motion)

    def _put(self, k, motion):
        data, (x, y, z, w) = self._data, motion.q
        if k in self._joint:
            at = self._joint[k]
            data.qpos[7 * at : 7 * at + 7] = [*motion.place, w, x, y, z]
            data.qvel[6 * at : 6 * at + 6] = [*motion.velocity, *motion.own_spin]
            return
        at = self._mocap[k]
        data.mocap_pos[at], data.mocap_quat[at] = motion.place, (w, x, y, z)
        for n, place, turned in self._surfaces[k]:
            velocity = motion.own_velocity + np.cross(motion.own_spin, place)
            self._model.geom_surfacevel[n] = [*(velocity @ turned), *(motion.own_spin @ turned)]

    def _step(self):
        self._mujoco.mj_step(self._model, self._data)

    def _states(self):
        found, data = np.zeros((len(self._bodies), 13)), self._data
        for k, body in enumerate(self._bodies):
            if k in self._joint:
                at = self._joint[k]
                rotation = Rotation.from_quat(data.qpos[7 * at + 3 : 7 * at + 7][[1, 2, 3, 0]])
                velocity, spin = data.qvel[6 * at : 6 * at + 3], data.qvel[6 * at + 3 : 6 * at + 6]
                place = data.qpos[7 * at : 7 * at + 3]
                found[k] = body.state(place, velocity, rotation, rotation.apply(spin))
            else:
                q = data.mocap_quat[self._mocap[k]][[1, 2, 3, 0]]
                place = data.mocap_pos[self._mocap[k]]
                found[k] = body.state(place, np.zeros(3), Rotation.from_quat(q), np.zeros(3))
        return found

    def close(self) -> None:
        """Leave the engine; nothing to do."""


def _geom(name, shape, surface):
    """Return a geom of a body; ``surface`` marks one whose surface may move."""
    size = {"box": [0.5 * side for side in shape.size]}.get(shape.kind, shape.size)
    if shape.kind == "cylinder":
        size = shape.size[0], 0.5 * shape.size[1]
    q = shape.turned.as_quat()[[3, 0, 1, 2]]
    return (
        f'<geom name="{name}" type="{shape.kind}" size="{text_of(size)}" pos="{text_of(shape.place)}"'
        f' quat="{text_of(q)}" surfacevel="{surface} 0 0"/>'
    )


def _solid(name, solid):
    """Return the geom of a plane."""
    check_solid(solid)
    q = text_of(Rotation.from_matrix(solid.rotation).as_quat()[[3, 0, 1, 2]])
    return f'<geom name="{name}" type="plane" size="0 0 1" pos="{text_of(solid.position)}" quat="{q}"/>'
