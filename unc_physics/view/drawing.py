"""Drawing of a scene in the page: static objects, and objects that move with the time line."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..checks.shown import printable
from ..plots.palette import body_color
from ..scene.scene import Scene
from ..shapes.primitives import primitive
from .frames import AnimationFrames
from .meshes import element_mesh, fitted_mesh, joined_spheres, quaternion_of

_ELEMENT = (214, 209, 199)  # RGB, 0 to 255
_SPHERES = 600  # largest spheres of each body that are drawn
_FINE = ((80, 3), (250, 2), (10**9, 1))  # number of spheres, and subdivisions of each up to that number
_THROUGH = 0.6  # opacity of walls, so that objects behind them are visible
_GHOST_SPHERES = 40
_GHOST_OPACITY, _ELLIPSOID_OPACITY = 0.12, 0.35
_WORLD = 1.2  # half the edge of a drawn plane, relative to the visible scene


class Drawing:
    """Drawing of a scene on a viser server, with the ``frames`` that are shown now.

    The first frames determine the camera and the planes' size. Bodies with a mesh file, by name, are drawn
    with it instead of their spheres.
    """

    def __init__(
        self, server: Any, scene: Scene, frames: AnimationFrames, meshes: Mapping[str, str] | None = None
    ):
        self._page, self._meshes = server.scene, meshes or {}
        self._ghosts_shown = self._ellipsoids_shown = True
        self._frame = 0
        self._drawing = threading.RLock()  # the time line runs while sliders move
        self.scene, self.frames = scene, frames
        low, high = bounds_of(scene, frames)
        self._page.configure_default_lights(cast_shadow=False)  # much faster without a GPU
        self._draw_environment(low, high)
        self._bodies = [self._body(k, self._meshes.get(body.name)) for k, body in enumerate(scene.bodies)]
        self._ghosts = [self._ghost(k) for k in range(len(scene.bodies))]
        self._ellipsoids: list[list[Any]] = [[] for _ in scene.bodies]
        self._time = self._page.add_label("/time", "", position=_above(low, high), anchor="bottom-center")
        self.show(self._frame)
        _look(server, low, high)

    def _draw_environment(self, low, high):
        extent = _WORLD * float((high - low).max())
        middle = 0.5 * (low + high)
        for k, element in enumerate(self.scene.environment):
            vertices, faces = element_mesh(element, extent)
            position = np.array(element.position, float)
            if element.shape == "plane":  # draw the visible part
                normal = element.rotation[:, 2]
                position = middle - (middle - position) @ normal * normal
            self._page.add_mesh_simple(
                f"/environment/{k}",
                *_single(vertices, faces),
                color=_ELEMENT,
                opacity=_THROUGH if element.finite else None,
                flat_shading=element.shape in ("box", "plane"),
                side="double",
                position=position,
                wxyz=quaternion_of(element.rotation),
            )

    def _body(self, k, mesh):
        """Add a frame with the body's spheres or mesh, and its name."""
        body, color = self.scene.bodies[k], self._color(k)
        frame = self._page.add_frame(f"/bodies/{k}", show_axes=False)
        if mesh is not None:
            vertices, faces = fitted_mesh(mesh, body.model)
            self._page.add_mesh_simple(
                f"/bodies/{k}/mesh", *_single(vertices, faces), color=color, flat_shading=True
            )
        else:
            count = min(len(body.model), _SPHERES)
            fine = next(fine for most, fine in _FINE if count <= most)
            vertices, faces = primitive("sphere", (1.0,), fine)
            self._page.add_batched_meshes_simple(
                f"/bodies/{k}/spheres",
                *_single(vertices, faces),
                batched_wxyzs=np.tile(np.array([1.0, 0.0, 0.0, 0.0], np.float32), (count, 1)),
                batched_positions=body.model.centers[:count].astype(np.float32),
                batched_scales=body.model.radii[:count].astype(np.float32),
                batched_colors=color,
            )
        self._page.add_label(f"/bodies/{k}/name", printable(body.name))
        return frame

    def _ghost(self, k):
        """Add a body's samples as instances of a coarse shape; return None if there are none."""
        body = self.scene.bodies[k]
        count = self.frames.ghost_positions.shape[1]
        if not body.free or count == 0:
            return None
        vertices, faces = joined_spheres(body.model, _GHOST_SPHERES, 1)
        return self._page.add_batched_meshes_simple(
            f"/ghosts/{k}",
            *_single(vertices, faces),
            batched_wxyzs=self.frames.ghost_orientations[0, :, k].astype(np.float32),
            batched_positions=self.frames.ghost_positions[0, :, k].astype(np.float32),
            batched_colors=self._color(k),
            opacity=_GHOST_OPACITY,
            cast_shadow=False,
            receive_shadow=False,
            visible=self._ghosts_shown,
        )

    def _color(self, k):
        return tuple(round(255 * part) for part in body_color(k, self.scene.bodies[k].fixed))

    def replace(self, frames: AnimationFrames) -> None:
        """Show another prediction of the scene."""
        with self._drawing:
            count = self.frames.ghost_positions.shape[1]
            self.frames = frames
            if frames.ghost_positions.shape[1] != count:
                for ghost in self._ghosts:
                    if ghost is not None:
                        ghost.remove()
                self._ghosts = [self._ghost(k) for k in range(len(self.scene.bodies))]
            self.show(self._frame)

    def show(self, frame: int) -> None:
        """Show a frame; larger indices show the last one."""
        with self._drawing:
            frames = self.frames
            self._frame = frame = min(frame, len(frames.times) - 1)
            self._time.text = f"t = {frames.times[frame]:.2f} s"
            for k, body in enumerate(self._bodies):
                body.position, body.wxyz = frames.positions[frame, k], frames.orientations[frame, k]
                ghost = self._ghosts[k]
                if ghost is not None and self._ghosts_shown:
                    ghost.batched_positions = frames.ghost_positions[frame, :, k].astype(np.float32)
                    ghost.batched_wxyzs = frames.ghost_orientations[frame, :, k].astype(np.float32)
                self._show_ellipsoids(k, frames.ellipsoids[frame][k] if self._ellipsoids_shown else ())

    def _show_ellipsoids(self, k, wanted):
        """Show an ellipsoid for each of a body's modes, and hide the others."""
        shown = self._ellipsoids[k]
        vertices, faces = primitive("sphere", (1.0,), 3)
        while len(shown) < len(wanted):
            shown.append(
                self._page.add_mesh_simple(
                    f"/ellipsoids/{k}/{len(shown)}",
                    *_single(vertices, faces),
                    color=self._color(k),
                    opacity=_ELLIPSOID_OPACITY,
                    cast_shadow=False,
                    receive_shadow=False,
                )
            )
        for j, handle in enumerate(shown):
            handle.visible = j < len(wanted)
            if j < len(wanted):
                handle.position, handle.wxyz = wanted[j].position, wanted[j].orientation
                handle.scale = tuple(wanted[j].half_axes.tolist())

    def show_ghosts(self, shown: bool) -> None:
        """Show or hide samples."""
        with self._drawing:
            self._ghosts_shown = shown
            for ghost in self._ghosts:
                if ghost is not None:
                    ghost.visible = shown
            self.show(self._frame)

    def show_ellipsoids(self, shown: bool) -> None:
        """Show or hide ellipsoids."""
        with self._drawing:
            self._ellipsoids_shown = shown
            self.show(self._frame)


def _single(vertices, faces):
    """Return a mesh in the types that viser sends."""
    return vertices.astype(np.float32), faces.astype(np.uint32)


def bounds_of(scene: Scene, frames: AnimationFrames) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and highest corner, each (3,), of the bodies in all frames [m]."""
    radius = np.array([body.model.bounding_radius for body in scene.bodies])[:, None]
    return (frames.positions - radius).min(axis=(0, 1)), (frames.positions + radius).max(axis=(0, 1))


def _above(low, high):
    middle = 0.5 * (low + high)
    return middle[0], middle[1], high[2] + 0.1 * (high - low).max()


def _look(server, low, high):
    """Point the camera at the whole scene, from the front and slightly above."""
    middle, size = 0.5 * (low + high), float(np.linalg.norm(high - low))
    server.initial_camera.look_at = tuple(middle.tolist())
    server.initial_camera.position = tuple((middle + size * np.array([0.3, -0.9, 0.7])).tolist())
    server.initial_camera.up = (0.0, 0.0, 1.0)
