"""Learns the thresholds of the detector `steps` from fault-free motion. Prints the numbers that the
package contains.

    python analysis/detector_thresholds/learn.py

The script runs every generated motion, 20 s each, at teleoperation scales 0.05 and 0.1, with
encoder and torque noise, both arms, and the present raven2 software. The rule is the published one:
the percentile of all steps of 1 ms of all runs, per variable and joint. The publication gives
percentiles of 99.8 to 99.9 without assigning them to variables, so 99.85 is used for all. Ticks
before the pedal is down, and the first half second of a run, are omitted.
"""

import numpy as np

from ravenjax.campaign import loading, plan
from ravenjax.campaign.inspection import replay
from ravenjax.engines import selection
from ravenjax.engines.interface import Block
from ravenjax.robots.raven2 import run_levels
from ravenjax.robots.raven2.arms import ARMS
from ravenjax.robots.raven2.console.motions import MOTIONS
from ravenjax.stages import detectors

SCALES = (0.05, 0.1)
SECONDS = 20.0
PERCENTILE = 99.85
ARMED_AFTER = 500  # ms, as for detectors


def steps(motion: str) -> np.ndarray:
    """Return |step| [steps, 3 variables, 3 joints] of both arms at every scale."""
    config = loading.from_dict(
        {
            "campaign": {"name": motion, "duration_s": SECONDS, "arms": list(ARMS), "noise": True},
            "operator": {"motion": motion},
            "group": [{"name": "free", "parameters": {"operator": {"scale": list(SCALES)}}}],
        }
    )
    ready = plan.make_plan(config)
    tracer = selection.select_engine("auto", ready.program.setup.precision).tracer(
        ready.program, replay.LANES
    )
    varied, faults = ready.lanes(range(ready.runs), replay.LANES, harmless=True)
    block, found = Block(varied, faults, None), []
    for lane in range(ready.runs):
        one = Block(
            {path: np.full_like(v, v[lane]) for path, v in block.varied.items()}, faults, None
        )
        *_, signals = tracer.run(one, one, ready.columns)
        down = np.asarray(signals.control.runlevel) == run_levels.PEDAL_DOWN
        for out in signals.plant:
            values = np.stack(
                [
                    np.stack([np.asarray(x) for x in getattr(out, name)[:3]], axis=-1)
                    for name in ("mpos", "mvel", "jpos")
                ],
                axis=1,
            )
            kept = down[1:] & (np.arange(1, len(down)) >= ARMED_AFTER)
            found.append(np.abs(np.diff(values, axis=0))[kept])
    return np.concatenate(found)


def main() -> None:
    """Print the learned steps."""
    pooled = np.concatenate([steps(motion) for motion in MOTIONS])
    learned = np.percentile(pooled, PERCENTILE, axis=0)
    print(
        f"{len(pooled)} steps of {len(MOTIONS)} motions, {PERCENTILE} percentile; in brackets the"
        " largest"
    )
    for j, (joint, kept) in enumerate(detectors.LEARNED_STEPS.items()):
        largest = pooled[:, :, j].max(axis=0)
        told = ", ".join(
            f"{value:.3g} ({top:.3g})" for value, top in zip(learned[:, j], largest, strict=True)
        )
        print(f"{joint}: mpos rad, mvel rad/s, jpos rad or m: {told}; in the package {kept}")


if __name__ == "__main__":
    main()
