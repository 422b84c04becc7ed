"""The node's log: messages of the library, and warnings of several kinds."""

from types import SimpleNamespace

from unc_physics.ros.diagnostics import LIBRARY, LibraryLog, ThrottledWarnings


def test_messages_of_the_library_are_the_nodes_until_it_ends(capfd):
    said = []
    passing = LibraryLog(SimpleNamespace(info=said.append))
    LIBRARY.warning("Compiling %s", "kernels")
    assert said == ["Compiling kernels"]
    assert capfd.readouterr().err == "", "and not to standard error as well"
    passing.close()
    assert passing not in LIBRARY.handlers


def test_warnings_of_one_kind_are_throttled_and_hide_no_others(monkeypatch):
    said, now = [], [100.0]
    monkeypatch.setattr("unc_physics.ros.diagnostics.time.monotonic", lambda: now[0])
    warn = ThrottledWarnings(SimpleNamespace(warning=said.append))
    for now[0], kind, text in (
        (100.0, "dropped", "1"),
        (100.0, "left out", "2"),
        (104.0, "dropped", "3"),
        (104.0, "left out", "4"),
        (105.5, "dropped", "5"),
        (106.0, "dropped", "6"),
    ):
        warn(kind, text)
    assert said == ["1", "2", "5"]
