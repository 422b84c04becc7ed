"""What all tests share: reproducible random examples."""

import sys
from pathlib import Path

from hypothesis import settings

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
sys.path[:0] = map(str, (HERE, ROOT))  # `twins`, and the package where it is not installed

from example_scenes import content, loaded  # noqa: F401  (fixtures)

settings.register_profile("tests", deadline=None, derandomize=True, max_examples=60)
settings.register_profile("thousands", settings.get_profile("tests"), derandomize=False, max_examples=1000)
settings.load_profile("tests")


def pytest_collection_modifyitems(items):
    """Let files with slow tests begin first where there are several processes: none is left to one alone."""
    if items and hasattr(items[0].config, "workerinput"):
        slow = {item.path for item in items if item.get_closest_marker("slow")}
        items.sort(key=lambda item: item.path not in slow)
