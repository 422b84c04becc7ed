"""The derivative of a step by central differences, which the closed form is held against."""

import math
from typing import NamedTuple

import numpy as np

from ..physics.compiled import inner
from ..physics.contact_model import lens_lever
from ..physics.explicit_step import drift, kick
from ..physics.layout import ERROR, STATE, Q
from ..physics.moments import boxminus, boxplus
from ..physics.rotation import cross, write_matrix
from ..physics.workspace import Workspace
from .contact_derivative import contact_geometry

_STEP = 1e-6  # in units of the error state


class Differences(NamedTuple):
    """Room for finite differences: states before a step and perturbed, an error, and for the steps."""

    before: np.ndarray
    forth: np.ndarray
    back: np.ndarray
    error: np.ndarray
    work: Workspace


@inner
def difference_root(room, method, world):
    """Replace each column of the root by the central difference of the regularized step along it."""
    root, error_block = method.root, method.error_block
    for c in range(root.shape[1]):
        length = 0.0
        for row in range(len(root)):
            length += root[row, c] * root[row, c]
        if length == 0.0:
            continue
        h = _STEP / math.sqrt(length)
        for side, state in ((h, room.forth), (-h, room.back)):
            _perturb(room.before, root, c, side, error_block, room.error, state)
            for i in range(len(state)):
                write_matrix((state[i, Q], state[i, Q + 1], state[i, Q + 2], state[i, Q + 3]), room.work.R, i)
            regularized_step(state, world, room.work, method.dominant)
        for i in range(len(error_block)):
            if error_block[i] >= 0:
                boxminus(room.forth[i], room.back[i], room.error)
                for k in range(ERROR):
                    root[ERROR * error_block[i] + k, c] = room.error[k] / (2.0 * h)


@inner
def regularized_step(x, world, work, dominant):
    """The step that ``F_t`` differentiates: dominant contacts, held volumes, Eq. 10's normals."""
    drift(x, world, None, work)
    for k in range(dominant.count[0]):
        i, j = dominant.bodies[k]
        arm_i, arm_j, D, ri, rj = contact_geometry(x, work.R, world.tree, dominant, k)
        d = math.sqrt(D[0] * D[0] + D[1] * D[1] + D[2] * D[2])
        scale = world.stiffness * dominant.volume[k] / (d + ri + rj)
        share = lens_lever(d, ri, rj)[0] / d
        f = (scale * D[0], scale * D[1], scale * D[2])
        tau_i = cross(f, (arm_i[0] + share * D[0], arm_i[1] + share * D[1], arm_i[2] + share * D[2]))
        share -= 1.0
        tau_j = cross((arm_j[0] + share * D[0], arm_j[1] + share * D[1], arm_j[2] + share * D[2]), f)
        for c in range(3):
            work.wrench[i, c] -= f[c]
            work.wrench[i, 3 + c] += tau_i[c]
            work.wrench[j, c] += f[c]
            work.wrench[j, 3 + c] += tau_j[c]
        work.touched[i] = work.touched[j] = True
    kick(x, world, work)


@inner
def _perturb(x, root, c, h, error_block, error, out):
    """``x`` boxplus ``h`` times column ``c`` of the root, into ``out``; ``error`` (12,) is room."""
    for i in range(len(x)):
        if error_block[i] >= 0:
            for k in range(ERROR):
                error[k] = h * root[ERROR * error_block[i] + k, c]
            boxplus(x[i], error, out[i])
        else:
            for k in range(STATE):
                out[i, k] = x[i, k]
