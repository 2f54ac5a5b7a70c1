"""Whose hands moved while the attacks struck, and the lever of a shoulder fault: the tip's distance
to the first axis.

The two published trajectories are not at hand; the recording of one of them has levers of 77 to 85
mm, as have the generated motions, which begin at home. Three variants are the same stitches with
the instrument drawn back, so that levers of 80 to 180 mm are covered. Where the environment
variable RAVENJAX_DATA names a folder that holds the public `operator_positions.parquet`, four
windows of it are added: real hands, at 55 to 183 mm. They stand in tables of their own, and nothing
else depends on whether they are there. The windows were chosen by length and reach alone. The time
stamps come in bursts, so rows are spaced evenly; a low-pass removes the steps of the recorder.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np

from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.campaign import hands
from ravenjax.robots.raven2.campaign.config import of_raven
from ravenjax.robots.raven2.geometry import kinematics
from ravenjax.robots.raven2.geometry.mapping import ITP_AXES

T = TypeVar("T")

DATA = "RAVENJAX_DATA"
RECORDING = "operator_positions.parquet"
RATE_HZ, CUTOFF_HZ = 999.9508, 5.0
"""Mean rate of its rows by its time stamps, and the low-pass of its motion."""

HANDS = "Recorded hands"
"""How each table and note begins that needs the recording."""

WINDOWS_S = ((0.0, 2.95), (6.4, 14.9), (18.2, 47.9), (50.7, 60.9))
"""Stretches of the public recording, s, that the arm reaches with a fixed wrist: the longest,
and the first.
"""

MOTIONS: Mapping[str, tuple[str, ...]] = {
    "peg_transfer": ("operator.motion=peg_transfer",),
    "palpate": ("operator.motion=palpate",),
    "circle": ("operator.motion=circle",),
    "reach": ("operator.motion=reach",),
    "still": ("operator.motion=still",),
}
"""Other motions that begin at home."""

LEVERS: Mapping[str, tuple[str, ...]] = {
    f"suture_{lever}mm": (f"operator.start.insertion_m={insertion}",)
    for lever, insertion in ((110, 0.372), (145, 0.336), (180, 0.300))
}
"""The stitches of the baseline with the insertion drawn back at the start."""


def recorded(environment: Mapping[str, str] | None = None) -> dict[str, tuple[str, ...]]:
    """Overrides of each window of the public recording, none where it is not at hand."""
    folder = (os.environ if environment is None else environment).get(DATA)
    path = Path(folder or ".").absolute() / RECORDING
    if not folder or not path.is_file():
        return {}
    even = (
        f"operator.rate_hz={RATE_HZ}",
        f"operator.cutoff_hz={CUTOFF_HZ:g}",
        "operator.at_end=reverse",
    )
    return {
        f"recorded_{begin:.0f}s": (
            "operator={}",
            f"operator.file={path}",
            f"operator.window_s=[{begin},{end}]",
            *even,
        )
        for begin, end in WINDOWS_S
    }


def apart(variants: Mapping[str, T]) -> tuple[dict[str, T], dict[str, T]]:
    """What everybody has of `variants` (name -> anything), and the windows of the recording,
    which stand apart.
    """
    windows = recorded()
    return (
        {name: one for name, one in variants.items() if name not in windows},
        {name: one for name, one in variants.items() if name in windows},
    )


def hands_note(windows: int) -> str:
    """What a study says of this many windows of the recording."""
    if not windows:
        return (
            f"{HANDS}: none were run. Set {DATA} to the folder that holds {RECORDING}, and they get"
            " tables here."
        )
    return (
        f"{HANDS}: {windows} windows of {RECORDING} stand in tables of their own. No other line,"
        f" table, figure or note depends on them: without the recording ({DATA}) all the rest is"
        " the same."
    )


class Lever(NamedTuple):
    """Distance of the desired tip from the first axis over some packets, mm."""

    low: float
    high: float

    @property
    def words(self) -> str:
        """As a range."""
        return (
            f"{self.low:.0f} mm"
            if round(self.low) == round(self.high)
            else f"{self.low:.0f}-{self.high:.0f} mm"
        )


def lever(config: CampaignConfig, rows: np.ndarray) -> Lever:
    """Of the gold arm's desired tip at these rows of the motion, ms. The first axis is the z axis
    of the arm's frame 0."""
    tips = desired_tip(config)[np.asarray(rows, int)]
    distance = np.hypot(tips[:, 0], tips[:, 1]) * 1e3
    return Lever(float(distance.min()), float(distance.max()))


def desired_tip(config: CampaignConfig) -> np.ndarray:
    """Where the operator wants the gold tip, [ms, 3] m in frame 0."""
    from ravenjax.numbers.lazy import jax

    raven = of_raven(config)
    motion = hands.operator_motion(raven)
    with jax.enable_x64(True):
        start = kinematics.forward(
            "gold", Vec(np.float64(q) for q in motion.start_jpos[0])
        ).position
    axes = np.array(ITP_AXES["gold"], float)
    return (
        np.array([float(x) for x in start])
        + motion.position_um[:, 0] @ axes.T * raven.operator.scale * 1e-6
    )
