"""``python -m unc_physics.ros.demo``: a node and a client, each a process of its own, predict two colliding
bunnies.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

from ..checks.errors import OutputError
from ..propagators.names import ANYTIME, REFERENCE
from .demo_client import NODE

_END_TIMEOUT = 10.0  # s
_PHYSICS = {  # the paper's
    "dt": 0.01,
    "stiffness": 1e4,
    "damping": 0.3,
    "gravity": [0.0, 0.0, 0.0],
    "integrator": "explicit",
    "friction": 0.0,
    "restitution": 1.0,
    "gyroscopic": "false",
    "islands": "false",
}


def node_command() -> list[str]:
    """Command line of the demo's node: weightless bunnies, and zeros mean exactly known."""
    parameters = _PHYSICS | {"zero_covariance": "exact", "warm_up": f"[{ANYTIME}, {REFERENCE}]"}
    options = [part for name, value in parameters.items() for part in ("-p", f"{name}:={value}")]
    return [sys.executable, "-m", "unc_physics.ros.node", "--ros-args", "-r", f"__node:={NODE}", *options]


def main(arguments=None) -> int:
    """Run the demo; returns the exit status."""
    parser = argparse.ArgumentParser(prog="unc_physics.ros.demo", description=__doc__)
    parser.add_argument(
        "--output", default="demo.png", metavar="FILE.png", help="picture to write (default demo.png)"
    )
    options = parser.parse_args(arguments)
    output = Path(options.output).resolve()
    if not output.parent.is_dir():
        error = OutputError("is no folder", field="--output", value=str(output.parent))
        print(f"demo: {error}", file=sys.stderr)
        return int(error.code)
    environment = os.environ | {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    print(f"Starting the node /{NODE} and a client ...", flush=True)
    with tempfile.TemporaryFile("w+") as log:
        node = subprocess.Popen(node_command(), env=environment, stdout=log, stderr=subprocess.STDOUT)
        client = None
        try:
            client = subprocess.Popen(
                [sys.executable, "-m", "unc_physics.ros.demo_client", "--output", str(output)],
                env=environment,
            )
            while (status := _ended(client)) is None:
                if node.poll() is not None:
                    status = 1
                    break
        except KeyboardInterrupt:  # the children got it, too
            status = 130
        finally:
            node_status = _end(node)
            _end(client)
        if status or node_status:
            log.seek(0)
            print(f"demo: failed; the node's log:\n{log.read()}", file=sys.stderr)
            return status or 1
    print("The node has shut down cleanly.")
    return 0


def _ended(process):
    """Exit status of a process, None if it still runs after a while."""
    try:
        return process.wait(0.5)
    except subprocess.TimeoutExpired:
        return None


def _end(process):
    """End a process with SIGINT, or by force if it does not react; returns its exit status."""
    if process is None:
        return None
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
    try:
        return process.wait(_END_TIMEOUT)
    except subprocess.TimeoutExpired:
        process.kill()
        return process.wait()


if __name__ == "__main__":
    sys.exit(main())
