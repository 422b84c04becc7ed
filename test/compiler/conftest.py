"""What tests of the compilation share: copies of the package."""

from compiler_copies import copy, server, sources  # noqa: F401  (fixtures)
