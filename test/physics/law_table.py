"""Tables of laws: quantities of known value beside what the everyday step finds.

``python test/physics/law_table.py HZ [NAME ...]`` prints the rows that are short at a time step of 1 / HZ.
"""

import sys
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

import pytest

if __name__ == "__main__":
    sys.path[:0] = [str(Path(__file__).resolve().parents[1])]

from plain_scenes import STEPS


class Row(NamedTuple):
    """A quantity: its right value, the value found, and how far these may be apart."""

    name: str
    right: float
    found: float
    tolerance: float

    @property
    def short(self) -> bool:
        """Whether the value found is not right."""
        return not abs(self.found - self.right) <= self.tolerance

    def __str__(self):
        return f"{self.name}: right {self.right:.6g} +- {self.tolerance:.3g}, found {self.found:.6g}"


class Laws(list):
    """The laws of one subject, each with the time steps [s] at which it is tested.

    A law is a function of the time step that yields rows (quantity, right, found, tolerance). Its name is the
    law, its first line the formula.
    """

    def __call__(self, function):
        """Add a law."""
        return self.at(*STEPS)(function)

    def at(self, *steps):
        """Return a decorator that adds a law that is tested at other steps."""

        def add(function):
            self.append((function, steps))
            return function

        return add

    def test(self, larger=None):
        """Return the test of all laws; ``larger`` maps (law, HZ) to (part of names, tolerance)."""
        cases = [(law, dt) for law, steps in self for dt in steps]

        @pytest.mark.parametrize(
            "law, dt", cases, ids=[f"{law.__name__}-{round(1 / dt)}Hz" for law, dt in cases]
        )
        def test_law(law, dt):
            part, tolerance = (larger or {}).get((law.__name__, round(1 / dt)), (None, 0.0))
            rows = [Row(*row) for row in law(dt)]
            rows = [row._replace(tolerance=tolerance) if part and part in row.name else row for row in rows]
            assert rows
            short = [row for row in rows if row.short]
            assert not short, "\n".join(map(str, short))

        return test_law


def main(hz, *names):
    """Print the rows of all laws, or of those whose names contain one of ``names``."""
    short = total = 0
    for path in sorted(Path(__file__).parent.glob("test_laws_*.py")):
        for law, _ in import_module(path.stem).law:
            if names and not any(name in law.__name__ for name in names):
                continue
            found = [Row(*row) for row in law(1 / float(hz))]
            bad = [row for row in found if row.short]
            total, short = total + 1, short + bool(bad)
            print(f"{law.__name__}: {len(found)} rows, {len(bad)} short")
            print(*(f"    1/{hz} {row}" for row in bad), sep="\n", end="\n" if bad else "")
    print(f"{short} of {total} laws short at 1/{hz}")


if __name__ == "__main__":
    main(*sys.argv[1:])
