"""Materials of pairs: friction and restitution between two things, in place of their own."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ..checks.errors import DuplicateIdError, InvalidRequestError
from ..checks.names import hint
from ..checks.shown import shown
from ..checks.validation import non_negative, share
from .entries import check_keys

#: The quantities of a pair, with their checks.
_CHECKS: dict[str, Callable[[Any, str], float]] = {
    "friction": non_negative,
    "restitution": share,
    "torsional_friction": non_negative,
    "rolling_friction": non_negative,
}


@dataclass(frozen=True)
class PairMaterial:
    """Contact properties between two bodies, or a body and an element of the environment.

    Attributes
    ----------
    between : (str, str)
        Their names.
    friction, restitution, torsional_friction, rolling_friction : float, optional
        Those of their contacts, exact; None takes the means of their own.
    """

    between: tuple[str, str]
    friction: float | None = None
    restitution: float | None = None
    torsional_friction: float | None = None
    rolling_friction: float | None = None

    @property
    def given(self) -> dict[str, float]:
        """The quantities that are given, by name."""
        return {key: value for key in _CHECKS if (value := getattr(self, key)) is not None}


def checked_pairs(
    pairs: Sequence[Mapping[str, Any] | PairMaterial], bodies: Sequence[str], elements: Sequence[str]
) -> tuple[PairMaterial, ...]:
    """Return the materials of pairs of things with these names.

    Raises
    ------
    InvalidRequestError, DuplicateIdError
        For entries that are no pairs, unknown names, a quantity out of range, and pairs that stand twice.
    """
    if isinstance(pairs, (str, Mapping, PairMaterial)) or not isinstance(pairs, Iterable):
        raise InvalidRequestError(
            "must be a list of pairs, as in [{'between': ['mug', 'tray'], 'friction': 0.3}]",
            field="pairs",
            value=shown(pairs),
        )
    found: dict[frozenset[str], PairMaterial] = {}
    for k, entry in enumerate(pairs):
        pair = _checked(entry, f"pairs[{k}]", bodies, elements)
        if frozenset(pair.between) in found:
            raise DuplicateIdError(
                "names a pair that stands before; give all of its values in one entry",
                field=f"pairs[{k}].between",
                value=list(pair.between),
            )
        found[frozenset(pair.between)] = pair
    return tuple(found.values())


def _checked(entry, field, bodies, elements):
    """Return one checked pair."""
    if isinstance(entry, PairMaterial):
        entry = {"between": entry.between} | entry.given
    if isinstance(entry, Mapping):
        entry = {key: value for key, value in entry.items() if value is not None}
    check_keys(entry, ("between", *_CHECKS), field)
    between, place = entry.get("between"), f"{field}.between"
    if not isinstance(between, (list, tuple)) or len(between) != 2:
        raise InvalidRequestError("must be a list of two names", field=place, value=between)
    names = [*bodies, *elements]
    for name in between:
        if name not in names:
            raise InvalidRequestError(
                f"is neither a body nor an element of the environment{hint(str(name), names)}",
                field=place,
                value=name,
            )
    if between[0] == between[1]:
        raise InvalidRequestError("must name two things", field=place, value=list(between))
    if not set(between) & set(bodies):
        raise InvalidRequestError(
            "must name a body; elements of the environment do not meet", field=place, value=list(between)
        )
    given = {key: check(entry[key], f"{field}.{key}") for key, check in _CHECKS.items() if key in entry}
    if not given:
        raise InvalidRequestError(f"must have one of {', '.join(_CHECKS)}", field=field)
    return PairMaterial((between[0], between[1]), **given)


def pairs_among(pairs: Iterable[PairMaterial], names: Iterable[str]) -> tuple[PairMaterial, ...]:
    """Return the pairs whose things both have one of these names."""
    names = set(names)
    return tuple(pair for pair in pairs if names.issuperset(pair.between))
