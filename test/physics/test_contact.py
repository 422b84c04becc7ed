"""Laws of the contact of two spheres, and of a sphere and a plane."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from twins import contact as twin

from unc_physics.physics.paper.contact_model import cap, lens, shallow_volume, stopping_stiffness

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


@pytest.mark.parametrize("ri, rj, d", [(1.0, 0.7, 1.1), (0.7, 1.0, 0.4), (1.0, 0.5, 0.3), (1.0, 0.7, 1.8)])
def test_lens_equals_an_integral(ri, rj, d):
    """The volume as an integral over discs, by no formula of lenses at all."""
    x, dx = np.linspace(-1.0, 2.0, 2_000_001, retstep=True)
    disc2 = np.minimum(ri**2 - x**2, rj**2 - (x - d) ** 2)
    integral = np.pi * np.maximum(disc2, 0.0).sum() * dx
    QUADRATURE = 1e-6
    assert lens(d, ri, rj)[0] == pytest.approx(integral, rel=QUADRATURE)


@given(radii, radii, st.floats(0.001, 0.999))
def test_volume_and_contact_point_see_no_order(ri, rj, share):
    d = share * (ri + rj)
    (vij, lij), (vji, lji) = lens(d, ri, rj), lens(d, rj, ri)
    assert vij == pytest.approx(vji, rel=1e-9)
    assert lij + lji == pytest.approx(d, abs=ROUND_OFF * (ri + rj))


@pytest.mark.parametrize("ri, rj", [(0.3, 0.3), (0.3, 0.05), (0.3, math.inf)])
def test_shallow_overlaps_are_those_of_small_depths(ri, rj):
    """Volume, and the stiffness that stops a mass, to leading order, against those of the lens or the cap."""
    R = ri if math.isinf(rj) else ri * rj / (ri + rj)
    depths = 1e-4 * R * np.linspace(0.0, 1.0, 201)
    volumes = np.array(
        [cap(ri - d, ri)[0] if math.isinf(rj) else lens(ri + rj - d, ri, rj)[0] for d in depths]
    )
    d, LEADING_ORDER = depths[-1], 1e-3
    assert shallow_volume(R, d) == pytest.approx(volumes[-1], rel=LEADING_ORDER)
    energy = stopping_stiffness(0.3, 4.0, R, d) * np.trapezoid(volumes, depths)
    assert energy == pytest.approx(0.5 * 0.3 * 4.0, rel=LEADING_ORDER)
