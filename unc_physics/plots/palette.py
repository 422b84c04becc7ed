"""Colors of bodies in pictures, in the browser, and in RViz."""

from __future__ import annotations

#: Red, green and blue, 0 to 1, of the first, second, ... body.
BODIES = ((0.16, 0.45, 0.72), (0.85, 0.42, 0.14), (0.24, 0.60, 0.30), (0.58, 0.40, 0.74), (0.75, 0.22, 0.25))
#: Color of fixed bodies.
FIXED = (0.55, 0.55, 0.55)


def body_color(index: int, fixed: bool = False) -> tuple[float, float, float]:
    """Return the color of a body by its index in the scene."""
    return FIXED if fixed else BODIES[index % len(BODIES)]
