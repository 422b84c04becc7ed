"""The table of laws at every time step."""

import pytest
from everyday_laws import LAWS, rows
from everyday_worlds import STEPS

#: Laws with a larger tolerance at one step [1/s]: (law, 1 / dt) to (name of the row, tolerance, reason).
LARGER: dict[tuple[str, int], tuple[str, float, str]] = {
    ("a_disc_rolls_on_its_rim", 120): ("tilt", 4.0, "the contact travels 0.46 rad of the rim in a step")
}


@pytest.mark.parametrize("dt", STEPS, ids=lambda dt: f"{round(1 / dt)}Hz")
@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.__name__)
def test_law(law, dt):
    name, tolerance, _ = LARGER.get((law.__name__, round(1 / dt)), ("", 0.0, ""))
    found = [row._replace(tolerance=tolerance) if name and name in row.name else row for row in rows(law, dt)]
    assert found
    short = [row for row in found if row.short]
    lines = (
        f"{row.name}: right {row.right:.6g} +- {row.tolerance:.3g}, found {row.found:.6g}" for row in short
    )
    assert not short, "\n".join(lines)
