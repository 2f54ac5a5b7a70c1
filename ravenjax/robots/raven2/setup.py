"""What picks the code of a Raven-II's tick."""

from __future__ import annotations

import dataclasses
from typing import ClassVar, Literal

from ravenjax.numbers import setup
from ravenjax.robots.raven2.arms import JOINTS, LEADING, ArmName
from ravenjax.vocabulary.parts import OwnSource


@dataclasses.dataclass(frozen=True)
class RavenSetup(setup.Setup):
    """Everything that picks code. Static and hashable: one Setup, one compile."""

    joints: ClassVar[tuple[str, ...]] = JOINTS
    leading_joints: ClassVar[tuple[int, ...]] = LEADING
    arms: tuple[ArmName, ...] = ("gold",)  # in mechanism order, gold first
    software: Literal["raven2", "fork2015"] = (
        "raven2"  # present raven2 software, or the 2015 simulator fork
    )
    tools: tuple[str, ...] = (
        "r_grasper",
    )  # one per arm, a name of ravenjax.robots.raven2.geometry.tools
    build: Literal["robot", "dyn_sim", "dyn_sim_tools"] = (
        "robot"  # for the robot, or a dynamics simulator of the fork
    )
    console: Literal["increments", "absolute"] = (
        "increments"  # what a packet carries (spec 5.3, 5.4)
    )
    dac_words: Literal["wrap", "saturate", "unwrapped"] = (
        "wrap"  # how a faulty DAC command is stored for USB
    )
    substeps: int = 1  # plant steps per 1 ms tick
    packets: tuple[
        tuple[float, ...], ...
    ] = ()  # shares of packets that last 1, 2, .. cycles, by choice; (): all one
    packet_history: int = (
        0  # ms; where `packets`: how old those may be that faults of the network send again
    )
    cables: Literal["unwatched", "unbreakable", "break"] = (
        "unwatched"  # whether their load is an outcome; what it does
    )
    contact: bool = False  # instruments touch tissue, vessel and each other
    command_delay: int = 0  # ms, the longest that a DAC command may take from USB write to motor
    controller: tuple[
        tuple[str, OwnSource], ...
    ] = ()  # (stage of `loop.user_files`, file of one's own in its place)
    hands: OwnSource | None = None  # the operator, where it is a file of one's own
    explained: tuple[
        tuple[float, float] | None, ...
    ] = ()  # normal range of each number that `loop.explained` compares

    def __post_init__(self) -> None:
        if len(self.tools) != len(self.arms):
            raise ValueError(
                f"Setup.tools has {len(self.tools)} names for {len(self.arms)} arms {self.arms};"
                " give one per arm"
            )
