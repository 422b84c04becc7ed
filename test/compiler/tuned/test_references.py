"""NamedTuples reach compiled functions as one pointer, and read there as what they are."""

from typing import NamedTuple

import numpy as np
import pytest

from unc_physics.compiler import inner, kernel


class Inside(NamedTuple):
    weights: np.ndarray
    flag: bool


class Outside(NamedTuple):
    offset: float
    nothing: None
    inside: Inside
    table: np.ndarray


class Pair(NamedTuple):
    first: Outside
    second: Outside


@inner
def weighted(outside, row):
    total = outside.offset if outside.inside.flag else 0.0
    for column in range(outside.table.shape[1]):
        total += outside.inside.weights[column] * outside.table[row, column]
    return total


@inner
def of_inside(inside):
    return inside.weights.sum()


@inner
def of_pair(pair):
    """A NamedTuple that is made of references."""
    return weighted(pair.first, 0) - weighted(pair.second, 1) + of_inside(pair.first.inside)


@kernel
def of_all(outside):
    other = Outside(1.0, None, Inside(outside.inside.weights * 2.0, False), outside.table)
    answers = np.empty(len(outside.table))
    for row in range(len(outside.table)):
        answers[row] = weighted(outside, row) + of_pair(Pair(outside, other))
    return answers


@pytest.mark.parametrize("flag", [False, True])
def test_attributes_are_those_of_the_named_tuple(flag):
    table, weights = np.arange(6.0).reshape(2, 3), np.array([1.0, 10.0, 100.0])
    found = of_all(Outside(0.5, None, Inside(weights, flag), table))
    rows = table @ weights + 0.5 * flag
    assert found == pytest.approx(rows + rows[0] - 2.0 * table[1] @ weights + 111.0)


@kernel
def moved(outside, by):
    return Outside(outside.offset + by, None, outside.inside, outside.table)


@kernel
def of_moved(outside):
    """What is returned outlives each call, also where the next one is given other values."""
    first = moved(outside, 1.0)
    second = first
    for k in range(3):
        second = moved(second, 10.0 * k)
    return weighted(first, 0), weighted(second, 0), weighted(moved(first, 0.5), 1)


def test_what_a_function_returns_outlives_its_call():
    found = of_moved(Outside(0.5, None, Inside(np.ones(3), True), np.arange(6.0).reshape(2, 3)))
    assert found == pytest.approx((3.0 + 1.5, 3.0 + 31.5, 12.0 + 2.0))


@inner
def handed_back(outside):
    return Outside(0.0, None, outside.inside, outside.table)


@kernel
def of_handed_back(outside):
    return weighted(handed_back(outside), 0)


def test_an_inner_function_that_returns_arrays_is_refused():
    """It counts no references, so the array would be freed while others still use it."""
    with pytest.raises(TypeError, match="handed_back is an inner function and returns an array"):
        of_handed_back(Outside(0.5, None, Inside(np.ones(3), True), np.ones((2, 3))))
