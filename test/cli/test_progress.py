"""What is said of work that takes long where no bar shows it."""

import time

from unc_physics.cli import output


def test_notes_say_that_work_goes_on_and_end_with_it(capsys, monkeypatch):
    monkeypatch.setattr(output, "NOTE_AFTER", 0.02)
    said = ""
    with output.progress_display("cloud", "step", "a horizon of 9 s") as show:
        assert show is None  # telling costs time
        while said.count("\n") < 2:
            time.sleep(0.01)
            said += capsys.readouterr().err
    capsys.readouterr()
    assert said.startswith(
        "unc_physics: note: cloud: still at work on a horizon of 9 s after 0 s; --time-limit"
    )
    time.sleep(0.1)
    assert capsys.readouterr().err == ""
