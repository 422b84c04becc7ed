"""What is said of work that takes long where no bar shows it."""

import re
import time

import numba
from numba.core import event

from unc_physics.cli import output

WORK = r"(unc_physics: note: cloud: still at work on a horizon of 9 s after \d+ s; --time-limit or .*\n)+"
COMPILING = r"(unc_physics: note: cloud: still compiling kernels after \d+ s; Ctrl-C ends it\n)+"


def test_notes_say_what_goes_on_and_end_with_it(capsys, monkeypatch):
    """A time limit and a shorter horizon do not end a compilation."""
    monkeypatch.setattr(output, "NOTE_AFTER", 0.02)

    def notes(count):
        said = ""
        with output.progress_display("cloud", "step", "a horizon of 9 s") as show:
            assert show is None  # telling costs time
            while said.count("\n") < count:
                time.sleep(0.01)
                said += capsys.readouterr().err
        return said + capsys.readouterr().err

    assert re.fullmatch(WORK, notes(2))
    with event.trigger_event("numba:compile", {"dispatcher": numba.njit(lambda: 0)}):
        with event.trigger_event("numba:compile", {"dispatcher": numba.njit(lambda: 1)}):
            pass
        assert re.fullmatch(COMPILING, notes(1))
    assert re.fullmatch(WORK, notes(1))
