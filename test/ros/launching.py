"""Launches a file as ``ros2 launch`` does: ``python test/ros/launching.py FILE [NAME:=VALUE ...]``."""

import os
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def prefix_with_the_package(folder) -> dict:
    """Lay out the package below a folder as an installation does; the environment that finds it there."""
    share, programs = folder / "share" / "unc_physics", folder / "lib" / "unc_physics"
    index = folder / "share" / "ament_index" / "resource_index" / "packages"
    for parent in (share, programs, index):
        parent.mkdir(parents=True)
    (index / "unc_physics").touch()
    for name in ("config", "launch"):
        (share / name).symlink_to(ROOT / name)
    for script in (ROOT / "scripts").iterdir():
        text = script.read_text().replace("#!/usr/bin/env python3", f"#!{sys.executable}", 1)
        (programs / script.name).write_text(text)
        (programs / script.name).chmod(0o755)
    before = os.environ.get("AMENT_PREFIX_PATH", "")
    return os.environ | {"AMENT_PREFIX_PATH": f"{folder}:{before or sys.prefix}"}


def main(file, *arguments):
    """Launch, until SIGINT or SIGTERM."""
    from launch.actions import IncludeLaunchDescription  # pyright: ignore[reportMissingImports]
    from launch.launch_description_sources import PythonLaunchDescriptionSource  # pyright: ignore[reportMissingImports]

    from launch import LaunchDescription, LaunchService  # pyright: ignore[reportMissingImports]

    given = [tuple(argument.split(":=", 1)) for argument in arguments]
    service = LaunchService()
    source = PythonLaunchDescriptionSource(file)
    service.include_launch_description(
        LaunchDescription([IncludeLaunchDescription(source, launch_arguments=given)])
    )
    return service.run()


if __name__ == "__main__":
    # this repository's own launch folder is no package
    sys.path[:] = [entry for entry in sys.path if Path(entry or ".").resolve() != ROOT] + [str(ROOT)]
    sys.exit(main(*sys.argv[1:]))
