"""Options of propagators: typed, with limits and in words."""

from dataclasses import dataclass

import pytest

from unc_physics.checks.errors import InvalidOptionError, LimitExceededError, NotFiniteError
from unc_physics.propagators.monte_carlo import MonteCarlo
from unc_physics.propagators.options import option


@dataclass(frozen=True)
class Toy(MonteCarlo):
    """Monte Carlo with options of all kinds."""

    name = "toy"

    share: float = option(0.5, "a share", low=0.0, high=1.0)
    fast: bool = option(False, "whether to hurry")
    way: str = option("short", "which way", choices=("short", "long"))
    inner: object = None  # no option


def test_they_are_described():
    assert list(Toy.options()) == ["samples", "seed", "share", "fast", "way"]
    texts = {option.name: option.as_text() for option in Toy.described_options()}
    assert texts["share"] == "a share; default 0.5"
    assert texts["way"] == "which way (short or long); default short"


@pytest.mark.parametrize(
    "text, name, value",
    [
        ("0.25", "share", 0.25),
        ("true", "fast", True),
        ("False", "fast", False),
        ("long", "way", "long"),
        ("7", "samples", 7),
    ],
)
def test_they_are_read_from_texts(text, name, value):
    options = {option.name: option for option in Toy.described_options()}
    read = options[name].from_text(text)
    assert read == value and type(read) is type(value)
    assert getattr(Toy(**{name: read}), name) == value


@pytest.mark.parametrize(
    "given, error, words",
    [
        ({"share": -0.1}, InvalidOptionError, "share must be at least 0"),
        ({"share": 1.5}, LimitExceededError, "share must be at most 1"),
        ({"share": float("nan")}, NotFiniteError, "share must be finite"),
        ({"fast": 1}, InvalidOptionError, "fast must be true or false"),
        ({"way": "far"}, InvalidOptionError, "way must be 'short' or 'long'"),
        ({"way": 3}, InvalidOptionError, "way must be a text"),
        ({"samples": 0}, InvalidOptionError, "samples must be at least 1"),
        ({"samples": 2.0}, InvalidOptionError, "samples must be an integer"),
        ({"samples": 10**8}, LimitExceededError, "samples must be at most"),
        ({"seed": -1}, InvalidOptionError, "seed must be at least 0"),
    ],
)
def test_what_they_cannot_take(given, error, words):
    with pytest.raises(error, match=words):
        Toy(**given)


@pytest.mark.parametrize(
    "text, name, words",
    [
        ("wide", "share", "must be a number"),
        ("1.5", "samples", "must be an integer"),
        ("1", "fast", "must be true or false"),
    ],
)
def test_texts_that_are_none(text, name, words):
    options = {option.name: option for option in Toy.described_options()}
    with pytest.raises(InvalidOptionError, match=words):
        options[name].from_text(text)
