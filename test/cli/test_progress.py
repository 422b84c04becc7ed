"""What is said of work that takes long where no bar shows it."""

import time

import numba
from numba.core import event

from unc_physics.cli import output


def notes_of_one(capsys, count):
    """The first notes about work that goes on, and a check that they end with it."""
    said = ""
    with output.progress_display("cloud", "step", "a horizon of 9 s") as show:
        assert show is None  # telling costs time
        while said.count("\n") < count:
            time.sleep(0.01)
            said += capsys.readouterr().err
    capsys.readouterr()
    time.sleep(0.1)
    assert capsys.readouterr().err == ""
    return said


def test_notes_say_that_work_goes_on_and_end_with_it(capsys, monkeypatch):
    monkeypatch.setattr(output, "NOTE_AFTER", 0.02)
    assert notes_of_one(capsys, 2).startswith(
        "unc_physics: note: cloud: still at work on a horizon of 9 s after 0 s; --time-limit"
    )


def test_notes_say_that_kernels_are_compiled(capsys, monkeypatch):
    """Which neither a time limit nor a shorter horizon ends."""
    monkeypatch.setattr(output, "NOTE_AFTER", 0.02)
    with event.trigger_event("numba:compile", {"dispatcher": numba.njit(lambda: 0)}):
        with event.trigger_event("numba:compile", {"dispatcher": numba.njit(lambda: 1)}):
            pass
        said = notes_of_one(capsys, 1)
    assert said.startswith("unc_physics: note: cloud: still compiling kernels after 0 s; Ctrl-C ends it\n")
    assert "still at work" in notes_of_one(capsys, 1)
