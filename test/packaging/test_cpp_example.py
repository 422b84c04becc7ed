"""The C++ example: what it does with messages is compiled against their headers, and run.

rclcpp comes with ROS from apt alone; without it the few lines that call it are not compiled here.
"""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
from building import ROOT, run

EXAMPLE = ROOT / "examples" / "cpp"
MESSAGES = "unc_physics_msgs"
MAIN = r"""
#include <iostream>
#include "can_and_brick.hpp"

int main()
{
  const auto request = can_and_brick::request();
  for (const auto & object : request.scene.objects) {
    std::cout << object.id << " " << object.model << " " << object.spheres << " " << int(object.kind)
              << " " << object.pose.pose.position.x << " " << object.pose.covariance[35] << "\n";
  }
  can_and_brick::Response response;
  response.prediction.objects.resize(1);
  response.prediction.objects[0].states.resize(2);
  auto & state = response.prediction.objects[0].states[1];
  state.time_from_start.nanosec = 500'000'000;
  state.pose.pose.position.y = 0.25;
  state.pose.covariance[7] = 0.04;
  std::cout << can_and_brick::text(response);
  response.result.error_code = can_and_brick::Result::TIMEOUT;
  response.result.error_msg = "too late";
  std::cout << can_and_brick::text(response);
}
"""


def found(pattern):
    """Paths below the prefixes that ROS is installed in."""
    prefixes = [sys.prefix, *filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep))]
    return [path for prefix in prefixes for path in sorted(Path(prefix).glob(pattern))]


@pytest.fixture(scope="module")
def headers(tmp_path_factory):
    """Folder of the messages' C++ headers, as the interface package's build makes them."""
    generator = pytest.importorskip("rosidl_generator_cpp", reason="needs ROS 2's generators")
    own = found(f"share/{MESSAGES}")[0]
    templates = found(f"share/{generator.__name__}/resource")[0]
    folder = tmp_path_factory.mktemp("headers")
    idls = sorted(path.relative_to(own) for path in own.glob("*/*.idl"))
    arguments = {
        "package_name": MESSAGES,
        "output_dir": str(folder / MESSAGES),
        "template_dir": str(templates),
        "idl_tuples": [f"{own}:{path}" for path in idls],
        "ros_interface_dependencies": [],
        "target_dependencies": [],
        "type_description_tuples": [f"{path}:{own / path.with_suffix('.json')}" for path in idls],
    }
    (folder / "arguments.json").write_text(json.dumps(arguments))
    generator.generate_cpp(str(folder / "arguments.json"))
    visibility = (templates / "rosidl_generator_cpp__visibility_control.hpp.in").read_text()
    for name, value in (("@PROJECT_NAME@", MESSAGES), ("@PROJECT_NAME_UPPER@", MESSAGES.upper())):
        visibility = visibility.replace(name, value)
    (folder / MESSAGES / "msg" / "rosidl_generator_cpp__visibility_control.hpp").write_text(visibility)
    return folder


@pytest.mark.skipif(shutil.which("g++") is None, reason="needs g++")
def test_it_fills_the_request_and_reads_the_answer(headers, tmp_path):
    (tmp_path / "main.cpp").write_text(MAIN)
    included = [headers, *found("include/*")]
    command = ["g++", "-std=c++17", "-O0", "-Wall", "-Wextra", "-Wpedantic", "-Werror", f"-I{EXAMPLE}/src"]
    command += [f"-isystem{path}" for path in included]
    run([*command, "main.cpp", "-o", "main"], cwd=tmp_path, env=None)
    out = subprocess.run([tmp_path / "main"], capture_output=True, text=True, check=True).stdout.splitlines()
    assert out == [
        "can can 0 0 -0.2 0.0004",
        "brick brick 0 1 0 0",
        "0.000 s: (0.000, 0.000, 0.000) m +- (0.000, 0.000, 0.000) m",
        "0.500 s: (0.000, 0.250, 0.000) m +- (0.000, 0.200, 0.000) m",
        "error 25: too late",
    ]


def test_its_package_builds_what_it_depends_on():
    cmake = (EXAMPLE / "CMakeLists.txt").read_text()
    package = ElementTree.parse(EXAMPLE / "package.xml").getroot()
    assert f"project({package.findtext('name')} " in cmake
    for depend in package.findall("depend"):
        assert f"find_package({depend.text} REQUIRED)" in cmake
    for source in (EXAMPLE / "src").glob("*.cpp"):
        assert f"src/{source.name}" in cmake
