"""The tests of the evaluation, which is a package of its own."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "evaluation"))  # where it is not installed
