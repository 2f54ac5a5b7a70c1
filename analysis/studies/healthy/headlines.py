"""What kinematic errors do to the headlines: the same faults, and none, on robots without them,
with half, with all.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from ravenjax.hazards import severity
from ravenjax.outcomes.verdict import LIMIT_MM
from ravenjax.report.data import facts as run_facts
from ravenjax.stats.bootstrap import units
from ravenjax.stats.bootstrap.units import Units
from ravenjax.stats.intervals import Estimate, Rate
from ravenjax.store import folder, manifest
from studies.framework import kinds

SCALE = "plant.kinematic_errors.scale"
COLUMN = f"param:{SCALE}"
OFF, HALF, FULL = SCALES = (0.0, 0.5, 1.0)
THRESHOLDS_MM = (3.0, 1.0)
"""Of the cue, in the order of its sets."""

SHARES = {
    "unintended": f"unintended motion of more than {LIMIT_MM:g} mm",
    "evaded": "evades the checks: unintended motion, and nobody is told",
    "stopped": "a check stops the robot",
    "misreport": "false report",
    "cue3": "cue at 3 mm",
    "cue1": "cue at 1 mm",
    "missed3": "unintended motion before the cue of 3 mm, or without one",
    "deeper": f"more than {severity.DEPTH_MM:g} mm deeper in the tissue than the golden run",
}
"""Of faults that changed a bit."""


class ScaledFaults(NamedTuple):
    """The same faults at every scale."""

    events: Mapping[float, pd.DataFrame]  # scale -> bool [faults], columns SHARES
    faults: Units  # kinds of the faults

    def share(self, event: str, scale: float) -> Rate:
        """Of the faults, with its interval over kinds."""
        return units.rate(self.events[scale][event].to_numpy(), self.faults)

    def change(self, event: str, scale: float) -> Estimate:
        """Share at a scale minus share without kinematic errors, of pairs; its interval over
        kinds.
        """
        return kinds.difference(
            self.events[scale][event].to_numpy(), self.events[OFF][event].to_numpy(), self.faults
        )


def faulty(path: Path) -> ScaledFaults:
    """Of a result folder with faults, those that changed a bit at every scale."""
    frame, header = folder.read_all(path), manifest.read(path)
    facts = run_facts.of(frame, header)
    valid = (facts["activated"] & facts["faulty"] & ~facts["failed"]).to_numpy()
    events = _events(frame, facts).assign(
        scale=frame[COLUMN], pair=frame["pair"], kind=kinds.names(frame["group"])
    )
    by_scale = {
        scale: events[valid & np.isclose(events["scale"], scale)].set_index("pair")
        for scale in SCALES
    }
    common = sorted(set.intersection(*(set(part.index) for part in by_scale.values())))
    parts = {scale: part.loc[common] for scale, part in by_scale.items()}
    return ScaledFaults(parts, units.units(parts[OFF]["kind"].to_numpy()))


def _events(frame: pd.DataFrame, facts: pd.DataFrame) -> pd.DataFrame:
    """SHARES of each run."""
    warned = (facts["warned_ms"] >= 0) & (facts["warned_ms"] < facts["unintended_ms"])
    return pd.DataFrame(
        {
            "unintended": facts["unintended"],
            "evaded": facts["evaded"],
            "stopped": facts["response"] == "stopped",
            "misreport": facts["misreport"],
            "cue3": frame["cue0_first_ms"] >= 0,
            "cue1": frame["cue1_first_ms"] >= 0,
            "missed3": facts["unintended"] & ~warned,
            "deeper": (
                frame["tissue_depth_mm"] - frame["golden_tissue_depth_mm"] > severity.DEPTH_MM
            ),
        }
    )


MEASURES = {
    "largest": "true tip from the nominal model, largest, mm",
    "rms": "true tip from the nominal model, rms, mm",
    "cue3": "robots with a cue of 3 mm, %",
    "cue1": "robots with a cue of 1 mm, %",
    "depth": "deepest in the tissue, mm",
}
"""Of robots without a fault."""


def free(path: Path) -> dict[float, pd.DataFrame]:
    """MEASURES of each robot [robots], by scale, of a result folder without faults."""
    frame = folder.read_all(path)
    measures = pd.DataFrame(
        {
            "largest": frame["peak_live_deviation_mm"],
            "rms": frame["rms_model_deviation_mm"],
            "cue3": 100.0 * (frame["cue0_first_ms"] >= 0),
            "cue1": 100.0 * (frame["cue1_first_ms"] >= 0),
            "depth": frame["tissue_depth_mm"],
        }
    ).set_index(frame["pair"])
    return {scale: measures.loc[np.isclose(frame[COLUMN], scale)] for scale in SCALES}


def mean(robots: pd.DataFrame, measure: str) -> Estimate:
    """Of a measure over robots, with a 95 % bootstrap interval over them."""
    values = robots[measure].to_numpy(float)
    band = units.ratio(values, 1.0, units.units(np.arange(len(values))))
    return Estimate(band.value, band.low, band.high)
