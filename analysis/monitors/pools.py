"""Simulates fault-free operations for coverage.py, with drawn robots, with one robot, and with
shifted robots.

    python analysis/monitors/pools.py FOLDER [--operators 4000] [--engine auto]

Writes three folders of scores: `drawn` (campaigns/drawn_robots.toml), `one` (the known robot: noise
and packets are drawn, but no property of the robot), `shifted` (drawn robots with 4 times the
friction of the known one). No two folders share an operator. An interrupted call can be continued.
"""

import argparse
import time
from pathlib import Path

from ravenjax.analyses.monitors import calibrate
from ravenjax.analyses.monitors.monitor import WHOLE, split_scores
from ravenjax.analyses.monitors.operations import OperationDesign
from ravenjax.campaign import loading
from ravenjax.campaign.file.config import CampaignConfig

LENGTH_S, ROBOTS = 60.0, 16
SHIFT = "parameters.plant.friction_scale=4"


def campaign(name: str) -> CampaignConfig:
    """Return the campaign of a pool."""
    if name == "one":
        config = loading.load_campaign("drawn_robots", ["campaign.kinematic_errors=none"])
        kept = {
            path: value for path, value in config.parameters.items() if path == "operator.scale"
        }
        return config.model_copy(update={"parameters": kept})
    return loading.load_campaign("drawn_robots", [SHIFT] if name == "shifted" else [])


def main() -> None:
    """Compute what is missing."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--operators", type=int, default=4000)
    parser.add_argument("--engine", default="auto")
    options = parser.parse_args()
    for seed, (name, share) in enumerate({"drawn": 1.0, "one": 1.0, "shifted": 0.1}.items()):
        began, config = time.perf_counter(), campaign(name)
        design = OperationDesign(calibrate.varying_motions(config), ROBOTS, LENGTH_S, seed)
        wanted = split_scores(calibrate.choose_candidates(config.robot, calibrate.SIGNALS))
        count, place = max(1, round(share * options.operators)), options.folder / name
        peaks = calibrate.simulate_operators(
            config, design, wanted, WHOLE, place, count, options.engine, lambda *_: None
        )
        hours = len(peaks.unit) * LENGTH_S / 3600
        print(
            f"{name}: {count} operators, {hours:.0f} h of operation,"
            f" {time.perf_counter() - began:.0f} s",
            flush=True,
        )


if __name__ == "__main__":
    main()
