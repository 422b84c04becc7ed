"""Bodies on prescribed paths in PyBullet (`action_engine_base`)."""

from __future__ import annotations

import math
import tempfile
import warnings
from functools import cache
from itertools import combinations
from pathlib import Path

from .action_engine_base import ActionEngine, check_solid, text_of
from .engines import bullet_states


class PyBulletActions(ActionEngine):
    """Scene in PyBullet; close it before opening the next one.

    Free bodies have maximal coordinates. Prescribed bodies are massless and have minimal coordinates, so that
    contacts use their velocity.
    """

    def _make(self):
        import pybullet

        self._client = client = _bullet()
        s, scene = self._settings, self._scene
        client.setPhysicsEngineParameter(
            fixedTimeStep=s.dt, numSolverIterations=s.iterations, restitutionVelocityThreshold=0.0
        )
        client.setGravity(*scene.gravity.tolist())
        self._handles = []
        damping = 1.0 - math.exp(-scene.damping)
        restitution = math.sqrt(scene.restitution or 0.0)
        with tempfile.TemporaryDirectory() as folder:
            for k, (body, one) in enumerate(zip(scene.bodies, self._bodies, strict=True)):
                path = Path(folder) / f"{k}.urdf"
                path.write_text(_urdf(body, one, self._shapes[k]))
                handle = client.loadURDF(
                    str(path), flags=pybullet.URDF_USE_INERTIA_FROM_FILE, useMaximalCoordinates=body.free
                )
                client.changeDynamics(
                    handle,
                    -1,
                    linearDamping=damping,
                    angularDamping=damping,
                    lateralFriction=math.sqrt(self._friction(body)),
                    restitution=restitution,
                )
                self._handles.append(handle)
        for solid in scene.environment:
            check_solid(solid)
            shape = client.createCollisionShape(client.GEOM_PLANE, planeNormal=solid.normal.tolist())
            handle = client.createMultiBody(0.0, shape, basePosition=solid.position.tolist())
            client.changeDynamics(
                handle, -1, lateralFriction=math.sqrt(self._friction(solid)), restitution=restitution
            )
        for a, b in combinations(range(len(self._handles)), 2):
            if self._apart(a, b):
                client.setCollisionFilterPair(self._handles[a], self._handles[b], -1, -1, 0)

    def _begin(self, start):
        for k, motion in enumerate(start):
            self._put(k, motion)

    def _put(self, k, motion):
        client, handle = self._client, self._handles[k]
        client.resetBasePositionAndOrientation(handle, motion.place.tolist(), motion.q.tolist())
        client.resetBaseVelocity(handle, motion.velocity.tolist(), motion.spin.tolist())

    def _step(self):
        self._client.stepSimulation()

    def _states(self):
        return bullet_states(self._client, self._bodies, self._handles)

    def close(self) -> None:
        """Remove everything from the engine."""
        self._client.resetSimulation()


@cache
def _bullet():
    """Return the only PyBullet client of this process for actions; each new one would print a line."""
    import pybullet
    from pybullet_utils.bullet_client import BulletClient

    return BulletClient(connection_mode=pybullet.DIRECT)


def _urdf(body, one, shapes):
    """Return a body as URDF, massless if its path is prescribed."""
    lines = []
    for shape in shapes:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # at gimbal lock any of the equivalent angles will do
            x, y, z = shape.turned.as_euler("xyz").tolist()
        size = {
            "box": lambda s: f'<box size="{text_of(s)}"/>',
            "sphere": lambda s: f'<sphere radius="{s[0]!r}"/>',
            "cylinder": lambda s: f'<cylinder radius="{s[0]!r}" length="{s[1]!r}"/>',
        }[shape.kind](shape.size)
        place = f'<origin xyz="{text_of(shape.place)}" rpy="{x!r} {y!r} {z!r}"/>'
        lines.append(f"<collision>{place}<geometry>{size}</geometry></collision>")
    a, b, c = one.inertia.tolist() if body.free else (0.0, 0.0, 0.0)
    return (
        f'<robot name="{body.name}"><link name="body"><inertial><mass'
        f' value="{one.mass if body.free else 0.0!r}"/><inertia ixx="{a!r}" iyy="{b!r}" izz="{c!r}" ixy="0"'
        ' ixz="0" iyz="0"/></inertial>\n' + "\n".join(lines) + "\n</link></robot>\n"
    )
