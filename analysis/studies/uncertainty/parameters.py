"""What nobody knows exactly of the robot, with the range of each parameter and where that comes
from.

The published sets are eight hand-tuned descriptions of the same joints by the same authors (from
raven2_sim, in raven2.plant.published); what they disagree about is a measure of what is not known,
and each of them, with the authors' law, is another robot. Where they agree, or say nothing, a range
is an assumption and says so.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pandas as pd

from ravenjax.campaign.file import bounds
from ravenjax.robots.raven2 import ROBOT
from ravenjax.robots.raven2.plant import published


class Uncertain(NamedTuple):
    """One parameter of the robot that is not known exactly."""

    path: str  # as a campaign names it
    words: str
    law: str  # distribution, as a campaign file writes it
    low: float  # ends of the range, at which it is tried alone
    high: float
    nominal: float  # the value of the robot as it is known
    source: str

    @property
    def unit(self) -> str:
        """As the robot's record says."""
        return bounds.of(ROBOT, self.path)[0].unit

    @property
    def column(self) -> str:
        """Of the result table."""
        return f"param:{self.path}"

    @property
    def drawn(self) -> str:
        """Override that draws it for each run."""
        return f"parameters.{self.path}={self.law}"

    @property
    def crossed(self) -> str:
        """Override that runs every fault at both ends."""
        return f"cross.{self.path}=[{self.low:g}, {self.high:g}]"

    def values(self, frame: pd.DataFrame) -> np.ndarray:
        """Its value in each run of a result table."""
        nominal = pd.Series(self.nominal, frame.index)
        return (
            frame[self.column].fillna(self.nominal) if self.column in frame else nominal
        ).to_numpy(float)


PARAMETERS = (
    Uncertain(
        "plant.friction_scale",
        "friction",
        "{loguniform=[0.5, 2]}",
        0.5,
        2.0,
        1.0,
        "published sets: Coulomb friction of the motors 0.45 to 2 times the base (insertion to 5)",
    ),
    Uncertain(
        "plant.cable_stiffness_scale",
        "cable stiffness",
        "{loguniform=[0.5, 2]}",
        0.5,
        2.0,
        1.0,
        "published sets: elbow 1 to 3 times the base (here 2 is 1); the lower end, for worn cables,"
        " is assumed",
    ),
    Uncertain(
        "plant.cable_damping.shoulder",
        "cable damping, shoulder",
        "{loguniform=[1000, 4000]}",
        1000.0,
        4000.0,
        4000.0,
        "published sets: 0.25 to 1 times the base",
    ),
    Uncertain(
        "plant.cable_damping.elbow",
        "cable damping, elbow",
        "{loguniform=[1380, 4140]}",
        1380.0,
        4140.0,
        1380.0,
        "published sets: 1 to 3 times the base",
    ),
    Uncertain(
        "plant.cable_damping.insertion",
        "cable damping, insertion",
        "{loguniform=[400, 560]}",
        400.0,
        560.0,
        400.0,
        "published sets: 1 to 1.4 times the base",
    ),
    Uncertain(
        "plant.motor_constant_scale",
        "motor constant",
        "{uniform=[0.85, 1.15]}",
        0.85,
        1.15,
        1.0,
        "published torque a count 0.94 to 1 of this one, gains 0.8 to 1; widened to both sides by"
        " assumption",
    ),
    Uncertain(
        "plant.mass_scale",
        "mass of the links",
        "{uniform=[0.8, 1.2]}",
        0.8,
        1.2,
        1.0,
        "assumed: tools of different mass, masses from drawings",
    ),
    Uncertain(
        "usb.command_delay",
        "delay of a command",
        "{choice=[0, 1, 2, 3]}",
        0.0,
        3.0,
        0.0,
        "assumed: none as in the authors' simulator, to three frames of 1 ms of full-speed USB",
    ),
    Uncertain(
        "network.cycles_per_packet",
        "control cycles a packet",
        "{choice=[1, 2]}",
        1.0,
        2.0,
        1.0,
        "not told for the published experiments, 1 to 2; on a recorded robot two in 93 of 100",
    ),
    Uncertain(
        "plant.encoder_noise",
        "encoder noise",
        "{uniform=[0, 2]}",
        0.0,
        2.0,
        0.0,
        "assumed: up to two counts; quadrature encoders err by about one",
    ),
    Uncertain(
        "plant.torque_noise",
        "torque noise",
        "{uniform=[0, 0.01]}",
        0.0,
        0.01,
        0.0,
        "assumed: up to an eighth of the elbow motor's Coulomb friction",
    ),
    Uncertain(
        "plant.brakes.engage_ticks",
        "delay of the brakes",
        "{choice=[5, 10, 15, 25, 50]}",
        5.0,
        50.0,
        15.0,
        "assumed: power-off brakes of this size close within 5 to 50 ms",
    ),
)

SETS = tuple(published.SETS)
"""The published sets, with the authors' law of motor and cable."""
