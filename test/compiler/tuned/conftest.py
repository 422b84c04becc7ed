"""Tests of the tuned compilation, where it is in use."""

from unc_physics.compiler.backend import TUNED

collect_ignore_glob = [] if TUNED else ["test_*.py"]
