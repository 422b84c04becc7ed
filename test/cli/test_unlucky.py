"""What goes wrong around a command: no room, nobody who reads, Ctrl-C, and options without effect."""

import os
import signal
import subprocess
import sys

import numpy as np
import pytest
import yaml
from example_scenes import CONTENTS

from unc_physics import ErrorCode
from unc_physics.__main__ import main
from unc_physics.checks.errors import OutputError
from unc_physics.cli.output import writing
from unc_physics.programs import dying_at_interrupt

COMMAND = [sys.executable, "-m", "unc_physics"]


@pytest.fixture
def scene(tmp_path):
    """A file with a scene whose prediction takes no time."""
    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump(CONTENTS["two_bodies"]() | {"horizon": 0.02}))
    return path


def text_of(capsys):
    """Lines of output and of errors."""
    out, err = capsys.readouterr()
    assert "Traceback" not in err
    return out.splitlines(), err.splitlines()


# -- output that goes nowhere ----------------------------------------------------------------------


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs a device that is always full")
def test_a_full_disk_gets_a_sentence():
    with open("/dev/full", "w") as full:
        run = subprocess.run(
            [*COMMAND, "schema", "scene"], stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
    assert run.returncode == ErrorCode.OUTPUT_FAILED
    assert run.stderr == "unc_physics: standard output cannot be written: No space left on device\n"


def test_a_reader_that_has_seen_enough_is_no_error():
    run = subprocess.Popen(
        [*COMMAND, "schema", "scene"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert run.stdout is not None and run.stderr is not None
    run.stdout.close()
    assert (run.stderr.read(), run.wait()) == ("", 141)


def test_a_closed_standard_output_is_no_error():
    done = subprocess.run(
        ["sh", "-c", 'exec "$@" >&-', "sh", *COMMAND, "models"],
        check=False,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_a_file_that_cannot_be_finished_leaves_nothing_behind(tmp_path):
    path = tmp_path / "picture.png"
    words = r"--output cannot be written: No space left.*picture.png"
    with pytest.raises(OutputError, match=words), writing(path, "--output"):
        path.write_text("half")
        raise OSError(28, "No space left on device")
    assert not path.exists()


@pytest.mark.parametrize("command", ["show", "predict"])
def test_a_picture_that_cannot_be_written(scene, tmp_path, capsys, monkeypatch, command):
    from matplotlib.figure import Figure

    def no_room(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Figure, "savefig", no_room)
    picture = str(tmp_path / "picture.png")
    arguments = ["show", "pin", "-o"] if command == "show" else ["predict", str(scene), "--picture"]
    assert main([*arguments, picture]) == ErrorCode.OUTPUT_FAILED
    (line,) = text_of(capsys)[1]
    assert "cannot be written: No space left on device" in line and "picture.png" in line


# -- Ctrl-C ----------------------------------------------------------------------------------------


def heed_interrupts():
    """In a process to be: what a shell starts in the background ignores interrupts, as do its children."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@pytest.mark.parametrize(
    ("program", "imported", "status"),
    [
        ("unc_physics.ros.node", "unc_physics.ros.node", -signal.SIGINT),
        ("unc_physics.ros.lifecycle_node", "unc_physics.ros.lifecycle_node", -signal.SIGINT),
        *(("unc_physics", name, -signal.SIGINT) for name in ("ast", "unc_physics.__main__")),
        *(("unc_physics", name, 130) for name in ("yaml", "numba.core", "unc_physics.prediction.driver")),
    ],
)
def test_an_interrupt_at_any_import_says_nothing(scene, tmp_path, program, imported, status):
    """The interpreter's own start, before the package's first line, is all that is left."""
    (tmp_path / "sitecustomize.py").write_text(f"""
import os, signal, sys
class Interrupting:
    def find_spec(self, name, *_):
        if name == {imported!r}:
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Interrupting())
""")
    path = os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])])
    run = subprocess.run(
        [sys.executable, "-m", program, "predict", scene],
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=heed_interrupts,
    )
    assert (run.returncode, run.stdout, run.stderr) == (status, "", "")


def test_a_process_that_imports_the_package_keeps_its_interrupts():
    code = "import signal, unc_physics; assert signal.getsignal(2) is signal.default_int_handler"
    subprocess.run([sys.executable, "-c", code], check=True, preexec_fn=heed_interrupts)


@pytest.mark.parametrize(
    ("program", "given", "threads"),
    [
        ("unc_physics_node", None, "1"),
        ("unc_physics", None, "1"),
        ("unc_physics", "3", "3"),
        ("own.py", None, None),
    ],
)
def test_programs_of_the_package_alone_set_the_threads_of_blas(program, given, threads):
    """A matrix product of two threads is slow where other processes run; a user's program decides itself."""
    environment = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    if given is not None:
        environment["OPENBLAS_NUM_THREADS"] = given
    code = (
        f"import os, sys; sys.argv[0] = {program!r}; import unc_physics;"
        "print(os.environ.get('OPENBLAS_NUM_THREADS'))"
    )
    run = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    assert run.stdout.strip() == str(threads)


def test_imports_that_swallow_an_interrupt_do_not_get_it():
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with dying_at_interrupt():
            assert signal.getsignal(signal.SIGINT) == signal.SIG_DFL
        assert signal.getsignal(signal.SIGINT) == signal.default_int_handler
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # as of a job in the background
        with dying_at_interrupt():
            assert signal.getsignal(signal.SIGINT) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


# -- what has no effect ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    "options, words",
    [
        ("--propagator sigma_points --seed 3", "--seed 3 has no effect, as sigma_points draws nothing"),
        ("--period 5", "--period 5 s is not below the horizon of 0.02 s"),
        ("--period 0.01", None),
    ],
)
def test_what_has_no_effect_is_noted(scene, capsys, options, words):
    assert main(["predict", str(scene), *options.split()]) == 0
    out, err = text_of(capsys)
    assert len(err) == bool(words) and all(line.startswith("unc_physics: note: ") for line in err)
    assert words is None or words in err[0]
    assert out[-1] == "status: fine"


def test_a_file_that_is_replaced_is_noted(tmp_path, capsys):
    picture = str(tmp_path / "pin.png")
    for notes in (0, 1):
        assert main(["show", "pin", "-o", picture]) == 0
        err = text_of(capsys)[1]
        assert len(err) == notes and all("was there already, and is replaced" in line for line in err)


def test_a_time_limit(tmp_path, capsys):
    content = CONTENTS["everyday"]() | {"horizon": 400.0}
    (tmp_path / "long.yaml").write_text(yaml.safe_dump(content))
    assert main(["predict", str(tmp_path / "long.yaml"), "--time-limit", "0.2"]) == ErrorCode.TIMEOUT
    (line,) = text_of(capsys)[1]
    assert main(["predict", str(tmp_path / "long.yaml"), "--time-limit", "0"]) != 0
    assert "--time-limit must be positive (got 0.0)" in text_of(capsys)[1][0]
    assert "--time-limit ran out" in line


# -- names that are more than names ----------------------------------------------------------------


def test_a_name_forges_no_line(tmp_path, capsys):
    content = CONTENTS["two_bodies"]() | {"horizon": 0.02}
    content["bodies"][0]["name"] = "left\nstatus: fine\n\x1b[2Jgone"
    content["bodies"][1]["name"] = r"$\frac{1$"  # no formula, where it is drawn
    path, picture = tmp_path / "scene.yaml", tmp_path / "picture.png"
    path.write_text(yaml.safe_dump(content))
    assert main(["predict", str(path), "--probabilities", "--picture", str(picture)]) == 0
    out, err = text_of(capsys)
    assert err == [] and all(line.isprintable() for line in out)
    assert sum(line == "status: fine" for line in out) == 1
    content["bodies"][0]["mass"] = -1.0
    content["bodies"][1]["name"] = content["bodies"][0]["name"]
    path.write_text(yaml.safe_dump(content))
    assert main(["predict", str(path)]) == ErrorCode.INVALID_MASS
    assert len(text_of(capsys)[1]) == 1


def test_arguments_with_line_ends_make_one_line(capsys):
    with pytest.raises(SystemExit):
        main(["fly\nstatus: fine"])
    assert len(text_of(capsys)[1]) == 1


def test_the_status_says_what_to_do(tmp_path, capsys):
    content = CONTENTS["two_bodies"]() | {"stiffness": 10.0}
    (tmp_path / "soft.yaml").write_text(yaml.safe_dump(content))
    assert main(["predict", str(tmp_path / "soft.yaml"), "--json"]) == 0
    out, _ = text_of(capsys)
    assert "raise stiffness, now 10, above" in out[0]
    assert np.isfinite(float(out[0].split("now 10, above ")[1].split()[0]))
