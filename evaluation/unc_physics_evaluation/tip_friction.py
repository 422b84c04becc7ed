"""Friction of the two tips of recorded pushes, from the forces while the block slid along them.

The README beside the data gives the friction of the single tip, from its forces. Those of the two tips are
less exact, as their zero may be taken in touch: only pushes that began half a millimetre off are taken here.
Where the block ended, beside where the tips did, says whether it slid, and which way.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from .recorded_pushes import FOLDER, planar_before, recorded_pushes, seen

_SLID, _OFF, _PRESSED = 5e-3, 5e-4, 1.5  # m along the tips, m before touch, N
_LAST = 0.4  # of the samples of a push, when it is under way
STD = 0.05


@cache
def two_tip_friction() -> float:
    """Median share of the force along the tips in that across them, where it opposes the sliding."""
    shares = force_shares()
    return float(np.median(shares[shares > 0.0]))


@cache
def force_shares() -> np.ndarray:
    """(n,): force along the tips over that across them, in each push that slid; above zero against it."""
    pushes = recorded_pushes()
    with np.load(FOLDER / "pushes.npz") as file:
        offset, forces, gaps = file["pusher_offset"], file["pusher_force"], file["start_gap"]
        yaws = file["pusher_pose"][:, 3]
    found = []
    for k in np.flatnonzero((pushes.kind > 0) & (gaps >= _OFF)).tolist():
        own = slice(*offset[k : k + 2])
        there = np.isfinite(forces[own]).all(axis=1)
        force, yaw, slid = forces[own][there], yaws[own][there].astype(float), _slid(k)
        late = slice(int((1.0 - _LAST) * len(force)), None)
        if abs(slid) < _SLID or not len(force[late]):
            continue
        across = np.median(_along(force, yaw)[late])
        aside = np.median(_along(force, yaw + 0.5 * np.pi)[late])
        if across > _PRESSED:
            found.append(-np.sign(slid) * aside / across)
    return np.array(found)


def _along(vectors, angle):
    return vectors[..., 0] * np.cos(angle) + vectors[..., 1] * np.sin(angle)


def _slid(k):
    """How far the block went along the tips in push ``k``, to the left of their direction [m]."""
    path, (before, after) = recorded_pushes().paths[k], (planar_before(k), seen(k))
    places = ((place[:2] - pose[1:3], pose[3]) for place, pose in ((before, path[0]), (after, path[-1])))
    first, last = (float(_along(place, yaw + 0.5 * np.pi)) for place, yaw in places)
    return last - first
