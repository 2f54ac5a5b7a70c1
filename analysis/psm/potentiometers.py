"""Computes which encoder faults of a PSM campaign the potentiometer check of the real robot would
have detected. Prints Markdown.

    ravenjax run analysis/psm/psm.toml --out results/psm
    python analysis/psm/potentiometers.py results/psm

The campaign has no potentiometers, so this script runs the encoder faults again, and uses the true
joints as ideal potentiometers. It applies the check of sawRobotIO1394: the arm loses power if
potentiometers and encoders differ by more than a tolerance for longer than a latency. The motion
after the loss of power is not simulated.
"""

import sys
from pathlib import Path

import numpy as np

import ravenjax as rj
from ravenjax.document.html import markdown_table

CAMPAIGN = Path(__file__).with_name("psm.toml")
TOLERANCE = {"yaw": 0.0873, "pitch": 0.0873, "insertion": 0.005}
LATENCY_MS = 10
"""Tolerances (5 degrees, 5 mm) and latency of the io file of PSM1 28007."""


def first_alarm(run: object, joint: str) -> int:
    """Return the millisecond in which the check trips, or -1."""
    joints = run.sel(arm="arm", joint=joint)  # type: ignore[attr-defined]
    wrong = np.abs(joints["link_jpos"].values - joints["jpos"].values) > TOLERANCE[joint]
    since = 0
    for now, is_wrong in enumerate(wrong):
        since = since + 1 if is_wrong else 0
        if since > LATENCY_MS:
            return now
    return -1


def main(folder: str) -> None:
    """Print how many faults evade the checks, and how many of these the potentiometers notice."""
    results = rj.open_results(folder).to_pandas()
    rows = []
    for group in ("encoder_angle", "encoder_insertion"):
        own = results[(results["group"] == group) & results["activated"]]
        evading = own[(own["response"] == "silent") & (own["unintended_first_ms"] >= 0)]
        alarms = np.array(
            [
                first_alarm(rj.simulate(str(CAMPAIGN), int(index)), joint)
                for index, joint in zip(evading["index"], evading["fault0_channel"], strict=True)
            ]
        )
        noticed = alarms >= 0
        early = noticed & (alarms < np.asarray(evading["unintended_first_ms"]))
        numbers = (len(own), len(evading), noticed.sum(), early.sum())
        rows.append((group, *map(str, numbers)))
    heads = ("group", "faults", "evade", "of these noticed", "before 3 mm")
    print(markdown_table(heads, rows))


if __name__ == "__main__":
    main(*sys.argv[1:])
