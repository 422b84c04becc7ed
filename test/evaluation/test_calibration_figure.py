"""The figure of how well probabilities are calibrated."""

from pathlib import Path

from unc_physics_evaluation.experiments.calibration import TOLERANCE

PAGES = Path(__file__).resolve().parents[2] / "docs"


def test_its_band_is_the_captions():
    captions = [line for page in PAGES.rglob("*.md") for line in page.read_text("utf-8").splitlines()]
    (caption,) = [line for line in captions if "images/calibration.png" in line]
    assert f"shaded: within {TOLERANCE:g}" in caption
