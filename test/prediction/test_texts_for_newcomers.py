"""Texts that a first user meets: flags and rankings."""

from unc_physics import primitive_model
from unc_physics.prediction.body_status import Status
from unc_physics.shapes import primitive_models


def test_flags_are_printed_by_name():
    assert str(Status.NOT_CONVERGED | Status.MEAN_NOT_POSSIBLE) == "NOT_CONVERGED MEAN_NOT_POSSIBLE"
    assert f"{Status.FINE}" == "FINE"


def test_packing_a_shape_is_announced_once(tmp_path, monkeypatch, caplog):
    monkeypatch.setattr(primitive_models, "cache_dir", lambda: tmp_path / "models")
    monkeypatch.setattr(primitive_models, "SPHERES", 20)
    for _ in range(2):
        assert len(primitive_model("box", size=(0.051, 0.052, 0.053)).centers) <= 20
    assert caplog.text.count("Packing a box with 20 spheres") == 1
