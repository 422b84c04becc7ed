"""Temporary arrays of a rollout, computed anew in each step."""

from typing import NamedTuple

import numpy as np

from ...compiler import kernel
from ...compiler.arrays import booleans, empty, integers, small_integers, zeros
from ...spatial.layout import Q
from ...spatial.rotation import write_matrix
from .broad_phase import FIRST_STEPS
from .contact_free import UNKNOWN
from .narrow_phase import RECORD
from .sphere_tree import AT_ONCE, ROOM, Scratch

_PAIRS_AT_ONCE = 1024


class Workspace(NamedTuple):
    """Arrays of one rollout.

    Attributes
    ----------
    R : (B, 3, 3) float64
        ``R_world_body`` at the current pose.
    wrench : (B, 6) float64
        Force [N] and torque about the centre of mass [N m], world frame.
    touched : (B,) bool
        Whether a contact force acts on each body in this step.
    order : (B,) int64
        Bodies sorted along x.
    reach : (B,) float64
        Radius of a ball about each body's position that it cannot leave in some steps [m].
    max_travel, zero_travel : (B,) float64
        Bound on the travel of a body's points in these steps [m]; zeros.
    contact_free_steps : (2,) int64
        Number of steps ahead without possible contacts, and number of steps for the next test. For scenes
        with environment.
    touching : (1,) bool
        Whether anything touched in the last step that could have contacts; also True before the first such
        step.
    low : (B,) float64
        Lower end of each body's ball along x [m].
    near : (B (B - 1) / 2, 2) int64
        Pairs of bodies that may touch.
    speed : (B,) float64
        Bound on the motion of a body's points in a step [m].
    travel : (B,) float64
        Sum of ``speed`` since the rollout began [m].
    separation_bound : (B, B, 2) float64
        For a pair i < j: sum of travels up to which they cannot touch [m], and number of steps for the next
        separation test.
    R_ij : (3, 3) float64
        Rotation from body j's to body i's frame, for the current pair.
    search, overlap_query : Scratch
        ``overlap_query`` has so little room that a search ends at the first candidates.
    """

    R: np.ndarray
    wrench: np.ndarray
    touched: np.ndarray
    order: np.ndarray
    reach: np.ndarray
    max_travel: np.ndarray
    zero_travel: np.ndarray
    contact_free_steps: np.ndarray
    touching: np.ndarray
    low: np.ndarray
    near: np.ndarray
    speed: np.ndarray
    travel: np.ndarray
    separation_bound: np.ndarray
    R_ij: np.ndarray
    search: Scratch
    overlap_query: Scratch


@kernel(noinline=True)
def workspace(x, world):
    """Return a workspace for a rollout that starts at state ``x`` (B, 13)."""
    count = len(x)
    R = empty((count, 3, 3))
    for i in range(count):
        write_matrix((x[i, Q], x[i, Q + 1], x[i, Q + 2], x[i, Q + 3]), R, i)
    stack = small_integers((world.stack_size, 2))
    tested, masks, records = small_integers((AT_ONCE, 2)), integers(AT_ONCE), empty((_PAIRS_AT_ONCE, RECORD))
    search = Scratch(stack, small_integers((_PAIRS_AT_ONCE, 2)), tested, masks, records)
    # ends at the first candidates
    overlap_query = Scratch(stack, small_integers((ROOM, 2)), tested, masks, records)
    separation_bound = zeros((count, count, 2))
    for i in range(count):
        for j in range(i + 1, count):
            separation_bound[i, j, 1] = FIRST_STEPS
    return Workspace(
        R,
        zeros((count, 6)),
        booleans(count),
        np.arange(count),
        empty(count),
        zeros(count),
        zeros(count),
        np.array([UNKNOWN, 1]),
        np.ones(1, np.bool_),
        empty(count),
        integers((count * (count - 1) // 2, 2)),
        zeros(count),
        zeros(count),
        separation_bound,
        empty((3, 3)),
        search,
        overlap_query,
    )
