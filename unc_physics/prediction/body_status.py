"""Result of a status: flags, measures, reasons and notes of each body."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntFlag


class Status(IntFlag):
    """Flags of one body's prediction; the numbers are those of ``unc_physics_msgs/msg/PredictedObject``."""

    FINE = 0
    NOT_CONVERGED = 1
    OUTSIDE_VALIDITY = 2
    INITIAL_OVERLAP = 4
    MEAN_NOT_POSSIBLE = 8

    def __str__(self) -> str:
        """Return the names of the flags, as the command line prints them."""
        return " ".join(flag.name or "" for flag in self) or "FINE"


@dataclass(frozen=True, repr=False)
class BodyStatus:
    """Flags of one body's prediction with their measures and reasons.

    Attributes
    ----------
    body : str
        Its name.
    flags : Status
    measures : dict of str to float
        What the flags were judged by, each by name (`assess`).
    reasons : tuple of str
        The flags in words.
    notes : tuple of str
        What to know besides: facts that raise no flag, such as few spheres.
    """

    body: str
    flags: Status
    measures: dict[str, float]
    reasons: tuple[str, ...]
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return f"<BodyStatus '{self.body}': {'; '.join((str(self.flags), *self.reasons))}>"

    @property
    def message(self) -> str:
        """The reasons in one text; empty when fine."""
        return "; ".join(self.reasons)
