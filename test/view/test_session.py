"""What a page shows, without a browser: frames, and beliefs as they are adjusted."""

import numpy as np
import pytest

from unc_physics import Belief, BodyBelief, ErrorCode, Plane, RigidBody, Scene, load_model, make_propagator
from unc_physics.__main__ import main
from unc_physics.view.adjusting import adjustable, adjusted

pytest.importorskip("trimesh", reason="the extra 'view' is not installed")


@pytest.fixture(scope="module")
def scene():
    box = RigidBody("box", load_model("salt_box").prefix(10), 0.52)
    wall = RigidBody("wall", load_model("salt_box").prefix(10), fixed=True)
    return Scene.everyday([box, wall], exact=True, environment=[Plane(name="floor")])


@pytest.fixture(scope="module")
def belief(scene):
    box = BodyBelief(position=(0, 0, 0.07), linear_velocity=(0.4, 0, 0), position_std=(0.01, 0.02, 0.001))
    return Belief.of(scene, {"box": box, "wall": BodyBelief(position=(3, 0, 0.07))})


@pytest.mark.parametrize(("name", "options"), [("sigma_points", {}), ("monte_carlo", {"samples": 16})])
def test_frames_are_the_predictions(scene, belief, name, options):
    from unc_physics.view.session import Session

    session = Session(scene, belief, 0.25, make_propagator(name, **options), 6, 8)
    frames = session.predict()
    assert frames.times[0] == 0.0 and frames.times[-1] == pytest.approx(0.25)
    np.testing.assert_allclose(frames.positions[-1, 0], session.prediction["box"].position)
    np.testing.assert_allclose(np.roll(frames.orientations[-1, 0], -1), session.prediction["box"].orientation)
    assert frames.ghost_positions.shape == (len(frames.times), 8, 2, 3)
    if name == "monte_carlo":
        own = session.prediction.samples(8)[:, 0, :3]
        np.testing.assert_array_equal(frames.ghost_positions[-1, :, 0], own)
    assert frames.ellipsoids[0][1] == ()
    (first,) = frames.ellipsoids[0][0]
    np.testing.assert_allclose(np.sort(first.half_axes), 2.0 * np.array([0.001, 0.01, 0.02]), rtol=0.05)
    assert name in session.summary()
    assert "± " in session.summary()


def test_standard_deviations_are_scaled_or_given(scene, belief):
    quantities = {quantity.key: quantity.value for quantity in adjustable(scene, belief)}
    rms = np.sqrt((0.01**2 + 0.02**2 + 0.001**2) / 3.0)
    assert quantities["position_std"] == pytest.approx(rms)
    assert (quantities["orientation_std"], quantities["friction"]) == (0.0, 0.5)
    most = {quantity.key: quantity.most for quantity in adjustable(scene, belief)}
    assert (most["position_std"], most["orientation_std"], most["friction"]) == (
        pytest.approx(0.05),
        pytest.approx(0.2),
        2.0,
    ), "sliders end at round numbers"
    other, changed = adjusted(
        scene,
        belief,
        {"position_std": 2.0 * rms, "orientation_std": 0.1, "friction": 0.0, "friction_std": 0.2},
    )
    std = np.sqrt(changed.marginal(0).diagonal())
    np.testing.assert_allclose(std[:3], [0.02, 0.04, 0.002])
    np.testing.assert_allclose(std[6:9], 0.1)
    assert (other.friction, other.friction_std) == (0.0, 0.0), "what is uncertain varies about more than 0"


@pytest.mark.parametrize("joint", [False, True])
def test_spreads_of_several_bodies_are_scaled_with_their_correlations(joint):
    """Of two bodies beside a fixed one, whose angular velocities are known."""
    pin, rng = load_model("pin").prefix(10), np.random.default_rng(0)
    bodies = [RigidBody("a", pin, 0.5), RigidBody("post", pin, fixed=True), RigidBody("b", pin, 1.5)]
    scene = Scene.everyday(bodies, exact=True, environment=[Plane()])
    root = 0.01 * rng.standard_normal((2, 12, 40))
    root[:, 9:] = 0.0
    P = np.einsum("aik,bjk->aibj", root, root)
    given = P.reshape(24, 24) if joint else P[[0, 1], :, [0, 1]]
    mean = np.tile([0.0, 0, 1, 0, 0, 0, 0.6, 0, 0, 0.8, 0, 0, 0], (3, 1))
    rms = np.sqrt(np.mean(np.einsum("aiai->ai", P)[:, 6:9]))
    asked = {"orientation_std": 3.0 * rms, "angular_velocity_std": 0.2, "friction": 0.3, "friction_std": 0.9}
    other, changed = adjusted(scene, Belief(mean, given, [0, 2]), asked)
    factors, added = np.repeat([1.0, 3.0, 1.0], [6, 3, 3]), np.diag(np.repeat([0.0, 0.04], [9, 3]))
    expected = P * factors[:, None, None] * factors + np.einsum("ab,ij->aibj", np.eye(2), added)
    expected = expected.reshape(24, 24) if joint else expected[[0, 1], :, [0, 1]]
    np.testing.assert_allclose(changed.covariance, expected, rtol=1e-12, atol=1e-18)
    assert (other.friction, other.friction_std) == (0.3, 0.3), "a standard deviation is at most the friction"


@pytest.mark.parametrize(
    ("options", "code", "said"),
    [
        (["--frames", "1"], ErrorCode.INVALID_REQUEST, "--frames must be"),
        (["--mesh", "tin=tin.stl"], ErrorCode.INVALID_REQUEST, "--mesh is no body of the scene"),
        (["--record", "page.png"], ErrorCode.OUTPUT_FAILED, "must end in .html"),
        (["--propagator", "magic"], ErrorCode.UNKNOWN_PROPAGATOR, "magic"),
    ],
)
def test_wrong_arguments_get_one_sentence(capsys, options, code, said):
    assert main(["view", "examples/scenes/salt_box_on_table.yaml", *options]) == code
    assert said in capsys.readouterr().err


def test_without_the_extra_it_says_so(capsys, monkeypatch):
    monkeypatch.setattr("unc_physics.view.session.find_spec", lambda name: None)
    assert main(["view", "examples/scenes/salt_box_on_table.yaml"]) == ErrorCode.NOT_SUPPORTED
    assert "install the extra 'view'" in capsys.readouterr().err


def test_a_mesh_is_fitted_to_its_model(tmp_path):
    import trimesh

    from unc_physics import load_solid, pack_solid
    from unc_physics.checks.errors import InvalidMeshError
    from unc_physics.view.meshes import fitted_mesh

    mesh = trimesh.creation.box([100.0, 60.0, 40.0])
    mesh.apply_translation([50.0, 0.0, 0.0])
    mesh.export(tmp_path / "box.stl")
    model = pack_solid(load_solid(tmp_path / "box.stl")[0].scaled(1e-3), 5)
    vertices, _ = fitted_mesh(tmp_path / "box.stl", model)
    np.testing.assert_allclose(vertices.max(axis=0), [0.05, 0.03, 0.02], atol=1e-9)
    trimesh.creation.box([1.0, 1.0, 1.0]).export(tmp_path / "cube.stl")
    with pytest.raises(InvalidMeshError, match="is not what model"):
        fitted_mesh(tmp_path / "cube.stl", model)
