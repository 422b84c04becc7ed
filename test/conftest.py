"""What all tests share: reproducible random examples."""

import sys
from pathlib import Path

import pytest
from hypothesis import settings

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
sys.path[:0] = map(
    str, (HERE, ROOT, ROOT / "evaluation")
)  # `twins`, and the packages where they are not installed

from example_scenes import content, loaded  # noqa: F401  (fixtures)

settings.register_profile("tests", deadline=None, derandomize=True, max_examples=60)
settings.register_profile("thousands", settings.get_profile("tests"), derandomize=False, max_examples=1000)
settings.load_profile("tests")


def pytest_collection_modifyitems(items):
    """Let the tests of a file run in one process, as they share fixtures, and those of the node too."""
    for item in items:
        ros = HERE / "ros" in item.path.parents
        item.add_marker(pytest.mark.xdist_group("ros" if ros else str(item.path)))
