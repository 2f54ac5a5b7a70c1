"""Measures rate, age and loss of a robot's CRTK messages: `python analysis/crtk/rates.py ros1|ros2
[SECONDS]`.

The robot, and the program in tests/train/robot_link/crtk that drives it and receives its messages,
run as separate processes on this machine. All messages of one tick have the same time stamp. If a
stamp arrives on one topic but not on another, a message was lost. If no message of a stamp arrives,
this is a gap. The age of a message is the time from its stamp to its arrival. With ROS 1, a
`roscore` must run.
"""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

PEERS = Path(__file__).resolve().parents[2] / "tests/train/robot_link/crtk"


def main() -> None:
    """Print one line of JSON."""
    ros, seconds = sys.argv[1], sys.argv[2] if len(sys.argv) > 2 else "180"
    os.environ.setdefault("ROS_DOMAIN_ID", "0")
    command = [
        sys.executable,
        "-m",
        "ravenjax.cli",
        "robot",
        "--itp-port",
        "0",
        "--joint-port",
        "0",
        "--crtk",
        ros,
    ]
    robot = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert robot.stdout is not None
    try:
        lines = iter(robot.stdout.readline, "")
        if not any(line.startswith("CRTK") for line in lines):
            sys.exit(f"the robot did not start (code {robot.wait()})")
        python = sys.executable if ros == "ros2" else "/usr/bin/python3"
        environ = {
            name: value
            for name, value in os.environ.items()
            if ros == "ros2" or name != "PYTHONPATH"
        }
        program = PEERS / ("dds_peer.py" if ros == "ros2" else "ros1_peer.py")
        before = os.getloadavg()[0]
        peer = subprocess.run(
            [python, str(program), str(Path(__file__).with_name("soak.py")), seconds],
            stdout=subprocess.PIPE,
            text=True,
            env=environ,
            check=True,
        )
        load = [round(before, 1), *(round(one, 1) for one in os.getloadavg()[:2])]
        told = json.loads(peer.stdout.splitlines()[-1])
        print(json.dumps({"ros": ros, "cpus": os.cpu_count(), "load": load, **told}))
    finally:
        robot.send_signal(signal.SIGINT)
        robot.communicate()


if __name__ == "__main__":
    main()
