"""Stamps of kernels: the same in each process, and of code that is understood."""

import math
import os
import subprocess
import sys

from unc_physics.compiler.tuned import kernel_stamp

PROGRAM = """
import importlib, pkgutil, sys
import unc_physics
from numba.core.dispatcher import Dispatcher
from unc_physics.compiler.tuned.kernel_stamp import stamp

for part in ("physics", "spatial", "propagators", "shapes"):
    folder = importlib.import_module(f"unc_physics.{part}")
    for module in pkgutil.walk_packages(folder.__path__, folder.__name__ + "."):
        for name, value in sorted(vars(importlib.import_module(module.name)).items()):
            if isinstance(value, Dispatcher):
                print(module.name, name, stamp(value.py_func))
"""


def stamps(seed):
    env = os.environ | {"PYTHONHASHSEED": str(seed)}
    return subprocess.run([sys.executable, "-c", PROGRAM], env=env, check=True, capture_output=True).stdout


def test_stamps_are_the_same_in_each_process():
    first = stamps(1)
    assert len(first.splitlines()) > 100
    assert stamps(2) == first


def test_a_value_that_is_not_understood_counts_as_the_whole_file(monkeypatch):
    unknown = object()

    def names_it():
        return unknown

    before = kernel_stamp.stamp(names_it)
    assert kernel_stamp.stamp(names_it) == before
    monkeypatch.setattr(kernel_stamp, "_file", lambda function: b"another text")
    assert kernel_stamp.stamp(names_it) != before


def test_a_name_of_an_attribute_counts():
    """Byte code refers to it by its place among the names, which stays the same."""
    pairs = ((lambda x: math.sin(x), lambda x: math.cos(x)), (lambda row: row.first, lambda row: row.last))
    for one, other in pairs:
        assert one.__code__.co_code == other.__code__.co_code
        assert kernel_stamp.stamp(one) != kernel_stamp.stamp(other)
