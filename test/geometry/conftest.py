"""Fixtures of the tests of geometry."""

from example_meshes import any_solid  # noqa: F401
