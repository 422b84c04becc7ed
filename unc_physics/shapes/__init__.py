"""Shapes of bodies: convex pieces, sphere packings, meshes, and the library of models."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .distance import SignedDistance, signed_distance

__all__ = ["SignedDistance", "signed_distance"]


def __getattr__(name):
    """Import a public name on first use, as importing numba takes a second."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from . import distance

    return getattr(distance, name)
