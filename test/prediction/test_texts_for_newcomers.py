"""Texts that a first user meets: flags and rankings."""

from unc_physics import (
    Belief,
    BodyBelief,
    Plane,
    RigidBody,
    Scene,
    Touches,
    assess,
    load_model,
    make_propagator,
    predict,
    primitive_model,
    rank,
)
from unc_physics.geometry import primitive_models
from unc_physics.prediction.body_status import Status

CUP = RigidBody("cup", load_model("mug"))
FLOOR = Plane(name="floor")


def test_flags_are_printed_by_name():
    assert str(Status.NOT_CONVERGED | Status.MEAN_NOT_POSSIBLE) == "NOT_CONVERGED MEAN_NOT_POSSIBLE"
    assert f"{Status.FINE}" == "FINE"


def test_a_body_of_too_few_spheres_is_flagged_with_number_and_loss():
    few = RigidBody("dish", load_model("plate").prefix(20))
    scene = Scene.everyday([few], environment=[FLOOR], exact=True)
    belief = Belief.of(scene, {"dish": BodyBelief(origin="model", position=(0, 0, 0.002))})
    (status,) = assess(predict(scene, belief, make_propagator("monte_carlo", samples=20), 0.1))
    loss = few.model.extent_loss
    assert loss is not None
    assert f"20 spheres reach up to {1e3 * loss:.1f} mm less far than the mesh" in status.message


def test_tied_actions_without_margins_keep_their_order():
    scene = Scene.everyday([CUP], environment=[FLOOR])
    belief = Belief.of(scene, {"cup": BodyBelief(origin="model", position=(0, 0, 0.001))})
    actions = {"here": {}, "there": {"cup": {"position": (0.1, 0, 0.04)}}}
    found = rank(scene, belief, actions, Touches("cup", "floor"), 0.1, rollouts=20)
    assert [action.name for action in found] == ["here", "there"]
    assert "Contacts have no margin, so they are in the order in which they were given" in str(found)


def test_packing_a_shape_is_announced_once(tmp_path, monkeypatch, caplog):
    monkeypatch.setattr(primitive_models, "cache_dir", lambda: tmp_path / "models")
    monkeypatch.setattr(primitive_models, "SPHERES", 20)
    for _ in range(2):
        primitive_model("box", size=(0.051, 0.052, 0.053))
    assert caplog.text.count("Packing a box with 20 spheres") == 1
