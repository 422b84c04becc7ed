"""Where a rollout's time goes: every step is of one phase."""

import pytest

from unc_physics_evaluation.experiments import contacts
from unc_physics_evaluation.jobs import Job


def test_every_step_is_of_one_phase():
    rows = contacts.run(Job("contacts", {"model": "pin", "spheres": 10, "repeats": 2})).rows
    steps = {row.method: row.value for row in rows if row.quantity == contacts.STEPS}
    times = {row.method: row.value for row in rows if row.quantity == contacts.WALL_TIME}
    (mean,) = (row.value for row in rows if row.quantity == contacts.CONTACTS)
    assert list(steps) == list(times) == list(contacts.PHASES)
    assert sum(steps.values()) == pytest.approx(500) and steps["contact"] > 0
    assert mean >= 1.0
