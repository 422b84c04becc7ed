"""Laws of the rotation group, near the identity, near a half turn, and in between."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation
from twins import states as twin

from unc_physics.spatial import moments, rotation

ROUND_OFF = 1e-14
SUBNORMAL = 1e-300  # below it numbers lose digits
ROUND_OFF_NEAR_PI = (
    1e-12  # the axis of a rotation by pi - e is known to round-off / e only where |w| is lost: it is not
)

ANGLES = [0.0, 1e-300, 1e-8, 0.9e-4, 1.1e-4, 1e-3, 0.5, 2.0, np.pi - 1e-3, np.pi - 1e-8, np.pi]

directions = (
    arrays(float, 3, elements=st.floats(-1, 1))
    .filter(lambda v: np.linalg.norm(v) > 0.1)
    .map(lambda v: v / np.linalg.norm(v))
)
angles = st.one_of(st.sampled_from(ANGLES), st.floats(0.0, np.pi))
rotation_vectors = st.builds(lambda d, a: d * a, directions, angles)
quaternions = rotation_vectors.map(lambda r: rotation.exp(*r))


def matrix(q):
    out = np.empty((3, 3))
    rotation.write_matrix(q, out[None], 0)
    return out


@given(rotation_vectors)
def test_exp_equals_scipy(r):
    np.testing.assert_allclose(rotation.exp(*r), Rotation.from_rotvec(r).as_quat(), atol=ROUND_OFF)


@given(rotation_vectors)
def test_log_undoes_exp(r):
    back = np.array(rotation.log(rotation.exp(*r)))
    if np.linalg.norm(r) > np.pi - 1e-7:  # r and r - 2 pi r/|r| are one rotation there
        assert (
            min(np.abs(back - r).max(), np.abs(back + r * (2 * np.pi / np.linalg.norm(r) - 1)).max())
            < ROUND_OFF_NEAR_PI
        )
    else:
        np.testing.assert_allclose(back, r, rtol=ROUND_OFF_NEAR_PI, atol=SUBNORMAL)


@given(rotation_vectors)
def test_log_is_at_most_pi_and_does_not_see_the_sign(r):
    q = rotation.exp(*r)
    plus, minus = np.array(rotation.log(q)), np.array(rotation.log(tuple(-c for c in q)))
    assert np.linalg.norm(plus) <= np.pi * (1 + ROUND_OFF)
    if q[3] != 0.0:
        np.testing.assert_array_equal(plus, minus)


@given(quaternions, quaternions, quaternions)
def test_group_axioms(a, b, c):
    identity = (0.0, 0.0, 0.0, 1.0)
    multiply = rotation.multiply
    np.testing.assert_allclose(multiply(multiply(a, b), c), multiply(a, multiply(b, c)), atol=ROUND_OFF)
    np.testing.assert_allclose(multiply(a, identity), a, atol=0)
    np.testing.assert_allclose(multiply(a, rotation.conjugate(a)), identity, atol=ROUND_OFF)
    np.testing.assert_allclose(matrix(multiply(a, b)), matrix(a) @ matrix(b), atol=ROUND_OFF)


@given(quaternions, arrays(float, 3, elements=st.floats(-10, 10)))
def test_matrix_is_a_rotation_and_equals_scipy(q, v):
    R = matrix(q)
    np.testing.assert_allclose(R, Rotation.from_quat(q).as_matrix(), atol=ROUND_OFF)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=ROUND_OFF)
    np.testing.assert_allclose(rotation.rotation_matrices(q), R, atol=ROUND_OFF)
    np.testing.assert_allclose(rotation.cross_matrices(v) @ R[0], np.cross(v, R[0]), atol=100 * ROUND_OFF)
    np.testing.assert_allclose(rotation.rotate(R, *v), R @ v, atol=100 * ROUND_OFF)
    np.testing.assert_allclose(rotation.rotate_back(R, *rotation.rotate(R, *v)), v, atol=100 * ROUND_OFF)


numbers = arrays(float, 3, elements=st.floats(-100, 100))


@st.composite
def states(draw):
    return np.concatenate([draw(numbers), draw(numbers), draw(quaternions), draw(numbers)])


@st.composite
def errors(draw):
    return np.concatenate([draw(numbers), draw(numbers), draw(rotation_vectors), draw(numbers)])


def boxplus(x, d):
    out = np.empty(13)
    moments.boxplus(x, d, out)
    return out


def boxminus(y, x):
    out = np.empty(12)
    moments.boxminus(y, x, out)
    return out


@given(states(), errors())
def test_boxplus_equals_the_twin(x, d):
    ours, theirs = boxplus(x, d), twin.boxplus(x, d)
    theirs[6:10] *= np.sign(ours[6:10] @ theirs[6:10])
    np.testing.assert_allclose(ours, theirs, atol=ROUND_OFF)


@given(states(), errors())
def test_boxminus_undoes_boxplus(x, d):
    if np.linalg.norm(d[6:9]) > np.pi - 1e-6:  # where two errors lead to one state
        return
    np.testing.assert_allclose(boxminus(boxplus(x, d), x), d, rtol=1e-9, atol=1e-12)
