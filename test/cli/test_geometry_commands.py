"""The commands pack, models and show, as a user calls them."""

import json
import os
import re
import subprocess
import sys

import numpy as np
import pytest
import trimesh
from example_meshes import MESHES, raw

from unc_physics.__main__ import main
from unc_physics.checks.errors import ErrorCode, InvalidMeshError
from unc_physics.shapes import packing as packing_module
from unc_physics.shapes.packing_file import load_packing, save_packing
from unc_physics.shapes.solid_mesh import make_solid


@pytest.fixture
def torus(tmp_path):
    path = tmp_path / "torus.off"
    trimesh.Trimesh(*MESHES["torus"](), process=False).export(path)
    return path


def test_pack_writes_a_model(torus, tmp_path, capsys, monkeypatch):
    out = tmp_path / "ring.npz"
    monkeypatch.setattr(packing_module, "_BYTES_PER_SPHERE", 10**18)
    assert main(["pack", str(torus), "-o", str(out)]) == ErrorCode.LIMIT_EXCEEDED
    assert "packing 1000 spheres" in capsys.readouterr().err, "the default"
    monkeypatch.undo()
    assert main(["pack", str(torus), "-n", "30", "-o", str(out), "--scale", "0.1", "--mass", "0.3"]) == 0
    packing = load_packing(out)
    assert len(packing) == 30 and packing.mass == 0.3 and packing.name == "ring"
    np.testing.assert_allclose(packing.bounds[1], [0.13, 0.13, 0.03], rtol=0.05)
    shown = capsys.readouterr().out
    assert "ring" in shown and f"{100.0 * packing.fill:.1f}" in shown and str(out) in shown


def test_pack_without_a_file_name_makes_a_model_known_by_name(torus, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.delenv("UNC_PHYSICS_MODELS", raising=False)
    assert main(["pack", str(torus), "-n", "10", "--name", "my_ring"]) == 0
    capsys.readouterr()
    assert main(["models"]) == 0
    assert "my_ring" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        ("missing.off", "INVALID_MESH", "missing.off cannot be read: No such file.*; check the path"),
        ("text.off", "INVALID_MESH", "text.off is no mesh"),
        ("open.off", "INVALID_MESH", "open.off is open.*--repair"),
        (
            "half.off --repair",
            "INVALID_MESH",
            "no inside that holds spheres.*editor|repair could not mend it",
        ),
        ("/etc/passwd", "INVALID_MESH", "/etc/passwd must end in one of .*stl"),
        ("/dev/zero", "INVALID_MESH", "/dev/zero must end in one of .*stl"),
        ("folder.off", "INVALID_MESH", "folder.off is no file"),
        ("pipe.off", "INVALID_MESH", "pipe.off is no file"),
        (
            "torus.off --tolerance 1e-9",
            "INVALID_MESH",
            "mesh torus.off is .* mm off its .* pieces?, and 1e-06 mm are allowed; --tolerance .* allows it$",
        ),
        (
            "torus.off --tolerance 1e-3 --pieces 8",
            "INVALID_MESH",
            "off its . pieces?, .*; --pieces 16 asks for more pieces, and --tolerance .* allows it$",
        ),
        ("torus.off --tolerance -1", "INVALID_OPTION", r"--tolerance must be a positive number of metres"),
        ("torus.off -n 0", "INVALID_OPTION", r"-n must be at least 1 \(got 0\)"),
        ("torus.off --scale -1", "INVALID_OPTION", "--scale must be a positive number"),
        ("torus.off --scale nan", "INVALID_OPTION", "--scale must be a positive number"),
        ("torus.off -o nowhere/out.npz", "OUTPUT_FAILED", "folder that does not exist"),
        ("torus.off -o out.zip", "OUTPUT_FAILED", "must end in .npz"),
    ],
)
def test_bad_input_gets_a_sentence_and_a_status(
    torus, tmp_path, monkeypatch, capsys, arguments, code, message
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "text.off").write_text("hello")
    (tmp_path / "folder.off").mkdir()
    os.mkfifo(tmp_path / "pipe.off")  # which nobody writes to
    export_open_box(tmp_path)
    # filled by a fan, the edges of its hole have two triangles each, and yet there is no inside
    half = trimesh.creation.torus(1.0, 0.3, major_sections=12, minor_sections=8)
    faces = half.faces[half.triangles_center[:, 0] < 0.4]
    trimesh.Trimesh(half.vertices, faces, process=False).export(tmp_path / "half.off")
    before = sorted(tmp_path.iterdir())
    given = arguments.split()
    given += [] if "-n" in given else ["-n", "9"]
    given += [] if "-o" in given else ["-o", "out.npz"]
    assert main(["pack", *given]) == ErrorCode[code]
    lines = capsys.readouterr().err.splitlines()
    (error,) = (line for line in lines if not line.startswith("unc_physics: note: "))
    assert re.search(message, error), error
    assert sorted(tmp_path.iterdir()) == before


def export_open_box(folder):
    vertices, faces = raw(trimesh.creation.box())
    trimesh.Trimesh(vertices, faces[1:], process=False).export(folder / "open.off")


def test_repair_says_what_it_did(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    export_open_box(tmp_path)
    assert main(["pack", "open.off", "-n", "9", "-o", "box.npz", "--repair"]) == 0
    assert "repair: closed holes with 1 triangle" in capsys.readouterr().out


def test_spheres_that_leave_the_body_are_the_meshs_fault(tmp_path, monkeypatch):
    solid = make_solid("box", *MESHES["box"]())
    far = np.array([[5.0, 0.0, 0.0, 0.1]])
    monkeypatch.setattr(packing_module.GreedyPacker, "run", lambda *_: far)
    with pytest.raises(InvalidMeshError, match="mesh box has no inside that holds spheres"):
        packing_module.pack_solid(solid, 1)


def test_a_model_that_would_not_be_found_by_its_name_is_refused(torus, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.delenv("UNC_PHYSICS_MODELS", raising=False)
    assert main(["pack", str(torus), "-n", "9", "--name", "bunny"]) == ErrorCode.INVALID_OPTION
    assert re.search("bunny.npz, which would be found in place of the new one.*-o", capsys.readouterr().err)
    monkeypatch.setenv("UNC_PHYSICS_MODELS", str(tmp_path))
    assert main(["pack", str(torus), "-n", "9", "--name", "bunny"]) == 0
    assert f"models are looked for in {tmp_path} alone" in capsys.readouterr().err


def test_a_mesh_in_millimetres_is_noticed(torus, tmp_path, capsys):
    out = str(tmp_path / "ring.npz")
    assert main(["pack", str(torus), "-n", "9", "-o", out, "--scale", "100"]) == 0
    out, err = capsys.readouterr()
    assert "260000 x " in out and "e+0" not in out
    assert "millimetres" in err and "--scale 0.1 makes it 260 mm" in err


def test_interruption_leaves_no_file(torus, tmp_path, monkeypatch):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(packing_module.GreedyPacker, "place_batch", interrupt)
    before = sorted(tmp_path.iterdir())
    assert main(["pack", str(torus), "-n", "60", "-o", str(tmp_path / "ring.npz")]) == 130
    assert sorted(tmp_path.iterdir()) == before


def test_a_short_packing_says_why(tmp_path, monkeypatch, capsys):
    trimesh.creation.box().export(tmp_path / "box.off")
    monkeypatch.setattr(packing_module, "SMALLEST", 0.2)
    assert main(["pack", str(tmp_path / "box.off"), "-n", "200", "-o", str(tmp_path / "ring.npz")]) == 0
    assert "stopped at" in capsys.readouterr().out
    assert 9 <= len(load_packing(tmp_path / "ring.npz")) < 200


def test_models_lists_size_mass_spheres_and_fill(capsys):
    assert main(["models"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split()[:2] == ["model", "size"]
    bunny = next(line for line in lines if line.startswith("bunny "))
    assert "10000" in bunny and "88.0" in bunny


def test_models_makes_one_anew(tmp_path, capsys):
    assert main(["models", "--make", "brick", "-n", "20", "-o", str(tmp_path)]) == 0
    assert len(load_packing(tmp_path / "brick_20.npz")) == 20
    assert main(["models", "--make", "teapot"]) == ErrorCode.UNKNOWN_MODEL
    assert main(["models", "--make", "bunny", "-o", str(tmp_path)]) == ErrorCode.INVALID_MESH
    assert "--meshes" in capsys.readouterr().err
    assert main(["models", "-n", "20"]) == ErrorCode.INVALID_OPTION


def test_show_draws_a_picture(tmp_path, capsys):
    from matplotlib.image import imread

    out = tmp_path / "pin.png"
    assert main(["show", "pin", "-o", str(out)]) == 0
    picture = imread(out)[:, :, :3]
    assert picture.shape[0] > 300 and len(np.unique(picture.reshape(-1, 3), axis=0)) > 500
    capsys.readouterr()
    assert main(["show", "teapot"]) == ErrorCode.UNKNOWN_MODEL
    assert main(["show", "teapot.STL"]) == ErrorCode.UNKNOWN_MODEL
    assert "is a mesh, and no model; the command pack makes a model of it" in capsys.readouterr().err


def test_show_draws_a_model_without_a_mesh(tmp_path, capsys):
    np.savez(tmp_path / "one.npz", centers=[[0.0, 0.0, 0.0]], radii=[1.0])
    save_packing(tmp_path / "one.npz", load_packing(tmp_path / "one.npz"))
    assert main(["show", str(tmp_path / "one.npz"), "-o", str(tmp_path / "one.png")]) == 0


def test_listing_needs_no_mesh_library_and_no_compiler():
    code = (
        "import sys, json; from unc_physics.__main__ import main; main(['models']);"
        "print(json.dumps([m for m in ('trimesh', 'scipy', 'matplotlib', 'numba') if m in sys.modules]))"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert json.loads(result.stdout.splitlines()[-1]) == []
