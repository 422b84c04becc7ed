"""colcon finds both packages, in the repository and in a workspace, and builds them with the ROS wheels.

The interfaces take minutes, and ``make`` has built them by the same CMakeLists.txt: colcon builds them only
where CPP_INTERFACES=ON asks for those of C++ too.
"""

import json
import os

import pytest
from building import ROOT, copy_sources, run, wheels_environment

# what an overlay must find in itself, not in the venv below it
USE = """
import json, os, sys
import unc_physics, unc_physics_msgs.srv
from ament_index_python.packages import get_package_prefix, get_package_share_directory
from rclpy.serialization import deserialize_message, serialize_message
from unc_physics.shapes.library import list_models

request = unc_physics_msgs.srv.Predict.Request()
request.request.horizon.sec, request.request.propagator = 2, "ünï"
assert deserialize_message(serialize_message(request), type(request)) == request
print(json.dumps({
    "modules": [unc_physics.__file__, unc_physics_msgs.srv.__file__],
    "prefixes": [get_package_prefix("unc_physics"), get_package_prefix("unc_physics_msgs")],
    "models": {name: str(path) for name, path in list_models().items()},
}))
"""

# starts the installed node as ros2 run does, asks it for its capabilities, which takes no kernels to
# compile, and ends it
ASK = """
import os, signal, subprocess, sys
import rclpy
from ament_index_python.packages import get_package_prefix
from rclpy.node import Node
from unc_physics_msgs.srv import GetCapabilities

executable = os.path.join(get_package_prefix("unc_physics"), "lib", "unc_physics", "unc_physics_node")
server = subprocess.Popen([executable, "--ros-args", "-p", "warm_up:=['']"])
try:
    rclpy.init()
    node = Node("asker")
    client = node.create_client(GetCapabilities, "/unc_physics/get_capabilities")
    while not client.wait_for_service(timeout_sec=1.0):
        assert server.poll() is None, "the node ended"
    future = client.call_async(GetCapabilities.Request())
    while not future.done():
        rclpy.spin_once(node, timeout_sec=1.0)
    assert future.result().world_frame == "world", future.result()
    server.send_signal(signal.SIGINT)
    sys.exit(server.wait())
finally:
    server.kill()
    rclpy.try_shutdown()
"""

# where the sources are, and what `colcon` is told of them, as docs/how-to/install.md says
LAYOUTS = {
    "repository": (".", ["--base-paths", ".", "unc_physics_msgs"]),
    "workspace": ("src/unc_physics", ["--base-paths", "src", "src/unc_physics/unc_physics_msgs"]),
}


def run_sourced(program, installed, folder, env):
    """Run a Python program in a shell that has sourced the workspace, away from the sources."""
    script = folder / "program.py"
    script.write_text(program)
    return run(["bash", "-c", f"source {installed}/setup.bash && exec python {script}"], cwd=folder, env=env)


def test_the_readme_has_the_command():
    command = " ".join(["colcon build", *LAYOUTS["repository"][1]])
    assert command in (ROOT / "README.md").read_text()
    assert command in (ROOT / "docs" / "how-to" / "install.md").read_text()


@pytest.mark.parametrize("layout", LAYOUTS)
def test_colcon_finds_both_packages(layout, tmp_path):
    sources, base_paths = LAYOUTS[layout]
    workspace = tmp_path / "workspace"
    copy_sources(workspace / sources)
    listed = run(["colcon", "list", "--names-only", *base_paths], cwd=workspace, env=wheels_environment())
    assert sorted(listed.stdout.split()) == ["unc_physics", "unc_physics_msgs"]


@pytest.mark.long
def test_colcon_builds_and_result_can_be_used(tmp_path):
    sources, base_paths = LAYOUTS["repository"]
    workspace = tmp_path / "workspace"
    copy_sources(workspace / sources)
    env = wheels_environment() | {
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_DOMAIN_ID": str(os.getpid() % 100),
        "NUMBA_CACHE_DIR": str(tmp_path / "numba"),
        "XDG_CACHE_HOME": str(tmp_path / "no models of the user"),
    }
    both = os.environ.get("CPP_INTERFACES") == "ON"
    which = [] if both else ["--packages-ignore", "unc_physics_msgs"]
    arguments = [f"-DCMAKE_PROJECT_INCLUDE={ROOT / 'cmake' / 'ros_wheels.cmake'}", "-DCPP_INTERFACES=ON"]
    run(["colcon", "build", *base_paths, *which, "--cmake-args", *arguments], cwd=workspace, env=env)

    installed = workspace / "install"
    for file in (
        "lib/unc_physics/unc_physics",
        "share/unc_physics/models/bunny.npz",
        "share/unc_physics/package.xml",
        "share/ament_index/resource_index/packages/unc_physics",
    ):
        assert (installed / "unc_physics" / file).is_file(), file
    for script in (ROOT / "scripts").iterdir():
        executable = installed / "unc_physics" / "lib" / "unc_physics" / script.name
        assert executable.stat().st_mode & 0o111, f"{executable}: ros2 run finds executables only"
    header = "include/unc_physics_msgs/unc_physics_msgs/srv/predict.hpp"
    assert (installed / "unc_physics_msgs" / header).is_file() == both

    found = json.loads(run_sourced(USE, installed, tmp_path, env).stdout)
    count = 2 if both else 1  # of the packages, those that the workspace has
    for path in (*found["modules"][:count], *found["prefixes"][:count], *found["models"].values()):
        assert path.startswith(str(installed)), path
    assert {"armadillo", "bunny", "pin"} <= found["models"].keys()
    run_sourced(ASK, installed, tmp_path, env)
