"""What all tests share: reproducible random examples."""

import sys
from pathlib import Path

from hypothesis import settings

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]  # `twins`, and `unc_physics` where it is not installed

from example_scenes import content, loaded  # noqa: F401  (fixtures)

settings.register_profile("tests", deadline=None, derandomize=True, max_examples=60)
settings.register_profile("thousands", settings.get_profile("tests"), derandomize=False, max_examples=1000)
settings.load_profile("tests")
