"""Tests whether 90 % intervals of `ravenjax calibrate` contain nine of ten hidden values. Prints
Markdown.

    python analysis/calibration/cover.py [LOGS] [SECONDS]

All parameters that a log can estimate are drawn from their priors for each virtual robot, which has
a separate log. If the intervals are correct, the number of hidden values inside is binomial with a
probability of 0.9 or more. Values of one log are not independent, so the number for each log is
also printed.
"""

import collections
import sys

import numpy as np
import virtual_log

from ravenjax.analyses.calibration import parameters
from ravenjax.analyses.calibration.calibrate import NORMAL_90
from ravenjax.document.html import markdown_table
from ravenjax.robots.raven2.plant import robot


def main(logs: int = 20, seconds: float = 14.0) -> None:
    """Calibrate `logs` logs and count."""
    wanted = parameters.select_unknowns(range(7))
    plant = robot.params(virtual_log.SETUP, "gold")
    base = parameters.prior_robot(plant, wanted)
    desired = virtual_log.swept(round(seconds * 1e3))
    inside: dict[str, list[bool]] = collections.defaultdict(list)
    left: dict[str, list[float]] = collections.defaultdict(list)
    of_logs = []
    for seed in range(logs):
        hidden = np.random.default_rng(seed).standard_normal(len(wanted))
        one = virtual_log.recorded(base, wanted, hidden, desired).calibrated(plant, wanted)
        holds = np.abs(one.fit.steps - hidden) <= NORMAL_90 * one.spread_ratio
        of_logs.append(int(holds.sum()))
        for unknown, hit, spread in zip(wanted, holds, one.spread_ratio, strict=True):
            inside[unknown.name].append(bool(hit))
            left[unknown.name].append(float(spread))
        print(f"log {seed}: {of_logs[-1]} of {len(wanted)}", file=sys.stderr, flush=True)
    rows = [
        (
            name,
            f"{sum(hits)} of {len(hits)}",
            f"{np.median(left[name]):.2f}",
            f"{np.mean(np.array(left[name]) < 0.5):.2f}",
        )
        for name, hits in inside.items()
    ]
    total, count = sum(of_logs), sum(map(len, inside.values()))
    rows.append(("all", f"{total} of {count}", "", ""))
    print(markdown_table(("values", "inside", "spread left, median", "share told"), rows))
    print(f"\nEach log: {min(of_logs)} to {max(of_logs)} of {len(wanted)}.")


if __name__ == "__main__":
    main(*(kind(word) for kind, word in zip((int, float), sys.argv[1:], strict=False)))
