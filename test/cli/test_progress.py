"""What is said of work that takes long where no bar shows it."""

import io
import re
import sys
import time

import numba
from numba.core import event

from unc_physics.cli import output

WORK = r"(unc_physics: note: cloud: still at work on a horizon of 9 s after \d+ s; --time-limit or .*\n)+"
COMPILING = r"(unc_physics: note: cloud: still compiling kernels after \d+ s; Ctrl-C ends it\n)+"


class Terminal(io.StringIO):
    """Standard error of a terminal."""

    def isatty(self):
        return True


def test_a_bar_shows_before_the_first_part_is_done(monkeypatch):
    monkeypatch.setattr(output, "PROGRESS_AFTER", 0.02)
    monkeypatch.setattr(sys, "stderr", Terminal())
    with output.progress_display("import", "part", "kitchen.sdf") as show:
        show(0, 7)
        while "0/7" not in sys.stderr.getvalue():
            time.sleep(0.01)
    assert sys.stderr.getvalue().startswith("\rimport:   0%")


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
