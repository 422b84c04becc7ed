"""Compilation of kernels by numba.

Kernels use three decorators: `kernel`, `inner` and `stage`. The modules in `tuned` depend on internals of
numba and support only tested versions (`versions`). Otherwise `plain` uses numba's public interface.
"""

from . import compile_time  # noqa: F401  (listens from the first compilation on)
from .decorators import inner, kernel, stage

__all__ = ["inner", "kernel", "stage"]
