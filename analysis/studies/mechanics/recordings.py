"""The two recorded arms, each with the software that its recording shows; both lie where
RAVENJAX_DATA says.
"""

from __future__ import annotations

from pathlib import Path

from ravenjax.analyses.calibration import position_loop, table_file
from ravenjax.analyses.calibration.calibrate import LoggedRobot
from ravenjax.robots.raven2.setup import RavenSetup
from studies.dsn16.recording import closed_loop

THREE_JOINTS, SEVEN_JOINTS = closed_loop.FILE, "recording_gold_7joints.parquet"
DATA = closed_loop.DATA
SEVEN_PERIOD_MS = 4.94  # 8 144 rows in 40 s, received in bursts
SETUP = RavenSetup(software="fork2015", arms=("gold",), tools=("r_grasper",))
"""Also of the arm with seven joints: its first jaw follows the insertion like its second, unlike
raven2's today.
"""


def three_joints(path: Path) -> LoggedRobot:
    """The authors' arm in teleoperation, 21 s at 1 kHz; what it was asked for is found from its
    PD law.
    """
    log = table_file.read(
        path, "gold", SETUP.tools[0], SETUP.software, position_loop.FORK2015, period_ms=1.0
    )
    return LoggedRobot(log, SETUP, "gold", position_loop.FORK2015)


def seven_joints(path: Path) -> LoggedRobot:
    """Another arm, driven along circles by its own controller with today's gains, 40 s."""
    log = table_file.read(
        path,
        "gold",
        SETUP.tools[0],
        SETUP.software,
        position_loop.RAVEN2,
        period_ms=SEVEN_PERIOD_MS,
    )
    return LoggedRobot(log, SETUP, "gold", position_loop.RAVEN2)
