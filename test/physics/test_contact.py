"""Laws of the contact of two spheres."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from twins import contact as twin

from unc_physics.collision.contact_model import lens

ROUND_OFF = 1e-12

radii = st.floats(1e-3, 1e3)
shares = st.one_of(st.just(0.0), st.floats(1e-100, 1.2))


@given(radii, radii, shares)
def test_lens_equals_the_twin(ri, rj, share):
    d = share * (ri + rj)
    volume, lever = lens(d, ri, rj)
    # caps of a big ball cut off by a small one are small differences of big numbers
    cancelled = 1e-13 * max(ri, rj) ** 2 * min(ri, rj)
    assert volume == pytest.approx(float(twin.lens_volume(d, ri, rj)), rel=1e-9, abs=cancelled)
    if volume > 0.0:
        assert lever == pytest.approx(
            float(twin.lever(d, ri, rj)), rel=ROUND_OFF, abs=ROUND_OFF * max(ri, rj)
        )


def test_lens_equals_an_integral():
    """The volume as an integral over discs, by no formula of lenses at all."""
    ri, rj, d = 1.0, 0.7, 1.1
    x, dx = np.linspace(-1.0, 2.0, 2_000_001, retstep=True)
    disc2 = np.minimum(ri**2 - x**2, rj**2 - (x - d) ** 2)
    integral = np.pi * np.maximum(disc2, 0.0).sum() * dx
    QUADRATURE = 1e-6
    assert lens(d, ri, rj)[0] == pytest.approx(integral, rel=QUADRATURE)


@given(radii, radii)
def test_limits(ri, rj):
    small = 4.0 / 3.0 * np.pi * min(ri, rj) ** 3
    assert lens(ri + rj, ri, rj)[0] == 0.0
    assert lens(2.0 * (ri + rj), ri, rj)[0] == 0.0
    assert lens(0.0, ri, rj)[0] == pytest.approx(small)
    assert lens(0.5 * abs(ri - rj), ri, rj)[0] == pytest.approx(small)


@given(radii, radii)
def test_continuous_where_the_smaller_sphere_goes_inside(ri, rj):
    inside = abs(ri - rj)
    before, at = lens(inside * (1 + 1e-9) + 1e-12 * ri, ri, rj), lens(inside, ri, rj)
    assert before[0] == pytest.approx(at[0], rel=1e-5)
    assert before[1] == pytest.approx(at[1], abs=1e-5 * (ri + rj))


@given(radii, radii, st.floats(0.001, 0.999))
def test_volume_and_contact_point_see_no_order(ri, rj, share):
    d = share * (ri + rj)
    (vij, lij), (vji, lji) = lens(d, ri, rj), lens(d, rj, ri)
    assert vij == pytest.approx(vji, rel=1e-9)
    assert lij + lji == pytest.approx(d, abs=ROUND_OFF * (ri + rj))


@given(radii, radii, st.floats(0.01, 0.98))
def test_volume_shrinks_with_distance(ri, rj, share):
    d = share * (ri + rj)
    near, far = lens(d, ri, rj)[0], lens(d * 1.01, ri, rj)[0]
    assert far < near or (far == near and 1.01 * d <= abs(ri - rj) * (1 + ROUND_OFF))


@given(radii, radii, st.floats(0.01, 0.99), st.floats(1e-3, 1e3))
def test_scales_with_the_cube_of_length(ri, rj, share, s):
    d = share * (ri + rj)
    (v, lever), (vs, levers) = lens(d, ri, rj), lens(s * d, s * ri, s * rj)
    assert vs == pytest.approx(s**3 * v, rel=1e-6, abs=1e-12 * s**3 * min(ri, rj) ** 3)
    assert levers == pytest.approx(s * lever, abs=1e-9 * s * (ri + rj))


@given(radii, radii, st.floats(0.01, 0.99))
def test_contact_point_lies_in_both_spheres(ri, rj, share):
    d = share * (ri + rj)
    lever = lens(d, ri, rj)[1]
    assert abs(lever) <= ri * (1 + ROUND_OFF)
    assert abs(d - lever) <= rj * (1 + ROUND_OFF)
