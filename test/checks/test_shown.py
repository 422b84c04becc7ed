"""Names and values of others in a line of text."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from unc_physics.checks.errors import UncPhysicsError
from unc_physics.checks.shown import drawn_text, plain_digits, printable, shown


def test_a_name_forges_no_line_and_commands_no_terminal():
    assert printable("a\nstatus: fine\x1b[31m") == "a\\nstatus: fine\\x1b[31m"
    assert printable("Häschen 兎") == "Häschen 兎"


@given(st.text())
def test_any_text_becomes_one_printable_line(text):
    assert printable(text).isprintable()
    assert UncPhysicsError(f"is {text}", field=text, value=text).args[0].isprintable()


@pytest.mark.parametrize(
    "value, text",
    [
        (np.float64(0.0), "0.0"),
        ([np.float64(1.5), np.int64(2)], "[1.5, 2]"),
        ({"a": (np.float32(0.5),)}, "{'a': (0.5,)}"),
        (np.eye(2), "[[1.0, 0.0], [0.0, 1.0]]"),
        (np.bool_(True), "True"),
        ("a\nb", "'a\\nb'"),
        pytest.param(10**5000, "too large to show", id="thousands of digits"),
    ],
)
def test_values_are_shown_plainly(value, text):
    assert shown(value) == text


def test_a_value_that_grows_without_end_is_cut_off():
    bomb = [1]
    for _ in range(80):
        bomb = [bomb, bomb]
    endless = []
    endless.append(endless)
    for value in (bomb, endless, np.zeros(10**6), "x" * 10**6, list(range(10**5))):
        assert len(shown(value)) <= 120


@pytest.mark.parametrize(
    "value, text",
    [
        (11270.4, "11270"),
        (113.66, "113.7"),
        (95.0, "95"),
        (0.0001234, "0.0001234"),
        (1e20, "1e+20"),
        (0, "0"),
    ],
)
def test_sizes_have_plain_digits(value, text):
    assert plain_digits(value) == text


def test_a_drawn_name_is_no_formula():
    assert drawn_text("$\\frac$\n") == "\\$\\frac\\$\\n"
    assert len(drawn_text("a" * 500)) == 40
