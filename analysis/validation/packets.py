"""Measures the length of the console's packets in public recordings: the time from a packet to the
next. Prints Markdown tables.

    python analysis/validation/packets.py [FOLDER]

FOLDER holds recording_gold_joints123, operator_positions, recording_gold_7joints and
console_itp_packets (.parquet). The default is $RAVENJAX_DATA, then ../shared/data beside the
repository. `ravenjax.vocabulary.packets` states the conclusions.
"""

import os
import sys
from pathlib import Path

import numpy as np
import pandas as pd

sys.path.insert(0, str(Path(__file__).parents[1]))

from ravenjax.robots.raven2.geometry import transmission
from ravenjax.vocabulary.packets import length_shares, packet_lengths
from studies.dsn16 import recording
from studies.dsn16.recording import KP, JointRecording

CONSOLE_BEGINS_MS = 200.0
"""Before this time the recorded console waits for the robot."""


RAD_PER_COUNT = 1.0 / (np.array(transmission.COUNTS_PER_NM[:3]) * KP)
"""Motor angle of one DAC count: the uncertainty of `JointRecording.asked` due to truncation."""

SAME_COUNTS = 1.02
"""Two truncated numbers of equal values differ by less than one count. The excess allows for
printing.
"""

HALF_WINDOW = 10
"""Rows on each side over which the speed is averaged, to distinguish a resting hand from a repeated
packet.
"""


def of_robot(log: JointRecording, counts_per_ms: float = 5.0) -> np.ndarray:
    """Return for how many cycles each desired position is repeated while the arm moves, int
    [packets].

    `counts_per_ms`: least motion of the fastest motor, in RAD_PER_COUNT, at which a step of the
    hand shows in the DAC.
    """
    change = np.diff(log.asked, axis=0) / RAD_PER_COUNT
    repeats = np.all(np.abs(change) <= SAME_COUNTS, axis=1)
    far = np.abs(log.angle[2 * HALF_WINDOW :] - log.angle[: -2 * HALF_WINDOW])
    fast = (far / (2 * HALF_WINDOW * RAD_PER_COUNT)).max(axis=1) > counts_per_ms
    return run_lengths(repeats, np.pad(fast, HALF_WINDOW))


def of_positions(position: np.ndarray, um_per_ms: float = 10.0) -> np.ndarray:
    """Return the same from desired positions at 1 kHz (um, [T, 3]) while the hand moves faster than
    `um_per_ms`.
    """
    repeats = np.all(np.diff(position, axis=0) == 0, axis=1)
    far = np.linalg.norm(position[2 * HALF_WINDOW :] - position[: -2 * HALF_WINDOW], axis=1)
    return run_lengths(repeats, np.pad(far / (2 * HALF_WINDOW) > um_per_ms, HALF_WINDOW))


def run_lengths(repeats: np.ndarray, moving: np.ndarray) -> np.ndarray:
    """Return the rows from one change to the next, int, for runs in which every row is `moving`
    (bool [T]).

    `repeats`: bool [T - 1], row i + 1 equals row i.
    """
    first = np.flatnonzero(~repeats) + 1
    at_rest = np.concatenate([[0], np.cumsum(~moving)])
    resting_rows = at_rest[first[1:]] - at_rest[first[:-1]]
    return np.diff(first)[resting_rows == 0]


def line(what: str, lengths: np.ndarray) -> None:
    percent = 100.0 * length_shares(lengths)[:12]
    print(
        f"{what:32s} {len(lengths):6d} packets, mean {lengths.mean():5.3f} cycles; % of 1, 2, ..:",
        end=" ",
    )
    print(" ".join(f"{share:.1f}" for share in percent))


def main() -> None:
    default = (
        os.environ.get("RAVENJAX_DATA") or Path(__file__).resolve().parents[3] / "shared" / "data"
    )
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else default)
    robot = recording.read(folder / recording.FILE)
    for counts in (3.0, 5.0, 8.0, 12.0, 16.0):
        line(f"robot, above {counts:g} counts/ms", of_robot(robot, counts))
    hands = pd.read_parquet(folder / "operator_positions.parquet")
    for arm in ("gold", "green"):
        position = hands[[f"{arm}_{axis}_um" for axis in "xyz"]].to_numpy(float)
        line(f"operator_positions, {arm}", of_positions(position))
    joints = pd.read_parquet(folder / "recording_gold_7joints.parquet")
    repeats = np.all(np.diff(joints.filter(like="jpos_d_").to_numpy(), axis=0) == 0, axis=1)
    print(f"recording_gold_7joints: {100.0 * repeats.mean():.2f} % of rows, 4.94 ms apart, repeat")
    ms = (
        pd.read_parquet(folder / "console_itp_packets.parquet")["arrival_us"].to_numpy() * 1e-6
    )  # times are in ns
    ms = ms[ms > CONSOLE_BEGINS_MS]
    for phase in (0.0, 0.25, 0.5, 0.75):
        line(f"console, cycle begins at {phase:g} ms", packet_lengths(ms - phase))
    burst = np.bincount(np.unique(np.floor(ms), return_counts=True)[1])[1:]
    print(
        "console, % of cycles with 1, 2, .. datagrams:",
        " ".join(f"{x:.1f}" for x in 100.0 * burst / burst.sum()),
    )


if __name__ == "__main__":
    main()
