"""Fixtures of the tests of shapes."""

from example_meshes import any_solid  # noqa: F401
