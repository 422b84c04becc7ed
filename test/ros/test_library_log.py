"""What the library says goes to the node's log."""

from types import SimpleNamespace

from unc_physics.ros.diagnostics import LIBRARY, LibraryLog


def test_messages_of_the_library_are_the_nodes_until_it_ends(capfd):
    said = []
    passing = LibraryLog(SimpleNamespace(info=said.append))
    LIBRARY.warning("Compiling %s", "kernels")
    assert said == ["Compiling kernels"]
    assert capfd.readouterr().err == "", "and not to standard error as well"
    passing.close()
    assert passing not in LIBRARY.handlers
