"""Processors that kernels are compiled for: this one, or a named level that many processors support."""

# pyright: reportAttributeAccessIssue=false
# numba creates its settings at run time

import platform
from typing import NamedTuple

import numba
from llvmlite import binding
from numba.core.codegen import get_host_cpu_features

_V2 = "cmov cx16 fxsr mmx popcnt sahf sse sse2 sse3 sse4.1 sse4.2 ssse3"
_V3 = f"{_V2} avx avx2 bmi bmi2 f16c fma lzcnt movbe xsave"


class Target(NamedTuple):
    """Processor as LLVM names it, and additional instructions."""

    processor: str
    features: str

    @classmethod
    def current(cls):
        """Return the target of this process's compilations: numba's settings, or this processor."""
        name, features = numba.config.CPU_NAME, numba.config.CPU_FEATURES
        return cls(
            binding.get_host_cpu_name() if name is None else name,
            get_host_cpu_features() if features is None else features,
        )


#: Targets of the kernels in wheels, best first, and the instructions that a processor must have.
SHIPPED = {
    "x86_64": {Target("x86-64-v3", ""): frozenset(_V3.split())},
    "aarch64": {Target("generic", ""): frozenset()},
}


def supported_targets():
    """Return the shipped targets that this processor supports, best first; none if numba has settings."""
    if Target.current() != Target(binding.get_host_cpu_name(), binding.get_host_cpu_features().flatten()):
        return []
    targets = SHIPPED.get(platform.machine(), {})
    has = {name for name, present in binding.get_host_cpu_features().items() if present}
    return [target for target, needed in targets.items() if needed <= has]
