"""Models of simple shapes: a ball is one sphere; others are packed once and kept in the user's cache."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import logging
from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np

from ..checks.errors import InvalidModelError, NotSupportedError, UncPhysicsError
from ..checks.names import hint
from ..checks.validation import FARTHEST, array, positive
from .library import cache_dir
from .mass_properties import mass_properties
from .packing_file import SpherePacking, load_packing, save_packing
from .pieces import Hull, Lathe, box, box_about, capsule, cylinder
from .pieces import ball as piece_ball
from .primitives import primitive

#: Shapes with the names of their sizes, as in the environment.
SIZES = {
    "sphere": ("radius",),
    "box": ("size",),
    "cylinder": ("radius", "length"),
    "capsule": ("radius", "length"),
}
#: Number of spheres of a packed shape.
SPHERES = 600


def primitive_model(shape: str, **size) -> SpherePacking:
    """Return the model of a sphere, box, cylinder or capsule about its centre.

    Its piece is the shape itself. So is the packing of a sphere. The others are packed with 600 spheres when
    something first asks for these, as the explicit integrator does. That needs the extra ``geometry`` and
    takes up to a minute for a new size. Afterwards the packing is read from the cache folder.

    Parameters
    ----------
    shape : {'sphere', 'box', 'cylinder', 'capsule'}
    **size
        ``radius`` of a sphere; ``size`` (3,) of a box, its edge lengths; ``radius`` and ``length`` of a
        cylinder, or of the straight part of a capsule, along its z axis [m].

    Returns
    -------
    SpherePacking
        Without a mass, so a body needs one.

    Raises
    ------
    InvalidModelError
        If there is no such shape, or a size is missing, unknown or not positive.
    """
    if shape not in SIZES:
        raise InvalidModelError(f"is no shape{hint(str(shape), SIZES)}", field="shape", value=shape)
    for name in size:
        if name not in SIZES[shape]:
            raise InvalidModelError(f"is no size of a {shape}{hint(name, SIZES[shape])}", field=name)
    lengths = []
    for name in SIZES[shape]:
        if size.get(name) is None:
            raise InvalidModelError("must be given", field=name)
        values = array(size[name], (3,), name, InvalidModelError) if name == "size" else [size[name]]
        for k, value in enumerate(values):
            place = f"{name}[{k}]" if name == "size" else name
            lengths.append(positive(value, place, InvalidModelError))
            if lengths[-1] > FARTHEST:
                raise InvalidModelError(f"must be at most {FARTHEST:g} m", field=place, value=value)
    return ball(lengths[0]) if shape == "sphere" else _primitive(shape, tuple(lengths), SPHERES, shape)


def primitive_pieces(shape: str, lengths: Sequence[float]) -> tuple[Hull | Lathe, ...]:
    """Return the piece of a shape about its centre, from its sizes in the order of `SIZES` [m]."""
    if shape == "box":
        return (box(np.ravel(lengths)),)
    return ({"sphere": piece_ball, "cylinder": cylinder, "capsule": capsule}[shape](*lengths),)


@functools.lru_cache(maxsize=256)
def ball(radius: float) -> SpherePacking:
    """Return the packing of a ball, which is a single sphere; ``radius`` in m."""
    return SpherePacking(
        name="sphere",
        centers=np.zeros((1, 3)),
        radii=np.array([radius]),
        inertia=0.4 * radius**2 * np.eye(3),
        volume=4.0 / 3.0 * np.pi * radius**3,
        origin=np.zeros(3),
        bounding_radius=radius,
        pieces=primitive_pieces("sphere", [radius]),
    )


class PrimitiveModel(SpherePacking):
    """Model of a box, cylinder or capsule, whose spheres are packed when something first asks for them.

    So does `dataclasses.replace`, which returns a `SpherePacking`.
    """

    _key: tuple[str, tuple[float, ...], int]  # shape, sizes and number of spheres

    def __new__(cls, **fields):
        return SpherePacking(**fields)

    def __reduce__(self):
        return _primitive, (*self._key, self.name)

    def __getattr__(self, name):
        if name not in _OF_SPHERES:
            raise AttributeError(name)
        shape, lengths, count = self._key
        packing = _packed(shape, lengths).prefix(count)
        for field in _OF_SPHERES:
            object.__setattr__(self, field, getattr(packing, field))
        return getattr(self, name)

    def __repr__(self):
        return f"PrimitiveModel({self._key[0]!r}, {self._key[1]})"

    def __len__(self):
        return self._key[2]

    @property
    def extent_loss(self):
        assert len(self.radii)  # asks for the spheres
        return super().extent_loss

    def _first(self, k):
        return _primitive(*self._key[:2], k, self.name)

    def named(self, name):
        return _primitive(*self._key, name)

    def scaled(self, s):
        scale, (shape, lengths, count) = positive(s, "scale", InvalidModelError), self._key
        return _primitive(shape, tuple(scale * each for each in lengths), count, self.name)


_OF_SPHERES = ("centers", "radii", "surface_gap", "measured_spheres", "extent_losses")


@functools.lru_cache(maxsize=256)
def _primitive(shape, lengths, count, name):
    """Return the model of a box, cylinder or capsule with sizes in the order of `SIZES`."""
    (piece,) = pieces = primitive_pieces(shape, lengths)
    volume, _, inertia = mass_properties(pieces)
    model = object.__new__(PrimitiveModel)
    values = {one.name: one.default for one in fields(SpherePacking) if one.name not in _OF_SPHERES}
    values |= {"name": name, "inertia": inertia, "volume": float(volume), "origin": np.zeros(3)}
    values |= {"pieces": pieces, "pieces_kind": shape, "bounds": box_about(pieces)}
    values["bounding_radius"] = float(np.linalg.norm(piece.outline(), axis=1).max() + piece.rounding)
    if shape == "cylinder":
        values["bounding_radius"] = float(np.hypot(lengths[0], 0.5 * lengths[1]))
    for key, value in (values | {"_key": (shape, lengths, count)}).items():
        if isinstance(value, np.ndarray):
            value.flags.writeable = False
        object.__setattr__(model, key, value)
    return model


@functools.lru_cache(maxsize=256)
def _packed(shape, lengths):
    """Return the packing of a shape, from the cache folder if it is there."""
    from .. import __version__

    digest = hashlib.sha256(repr((shape, lengths, SPHERES, __version__)).encode()).hexdigest()[:16]
    path = cache_dir().parent / "shapes" / f"{shape}_{digest}.npz"
    if path.is_file():
        with contextlib.suppress(UncPhysicsError):  # a damaged file is made again
            return replace(load_packing(path), pieces=primitive_pieces(shape, lengths))
    logging.getLogger("unc_physics").warning(
        "Packing a %s with %d spheres (once for each size, up to half a minute) ...", shape, SPHERES
    )
    try:
        from .packing import pack_solid
        from .solid_mesh import make_solid
        from .supports import capsule_supports

        supports = capsule_supports(*lengths) if shape == "capsule" else None
        solid = make_solid(shape, *primitive(shape, lengths))
        pieces = primitive_pieces(shape, lengths)
        packing = pack_solid(solid, SPHERES, supports=supports, pieces=pieces)
    except ImportError as error:
        raise NotSupportedError(
            f"needs {error.name} to be packed: pip install 'unc_physics[geometry]'", field=shape
        ) from None
    with contextlib.suppress(OSError):  # without a folder to write to it is packed in each process
        path.parent.mkdir(parents=True, exist_ok=True)
        save_packing(path, packing)
    return packing
