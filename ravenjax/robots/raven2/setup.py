"""Defines options that are fixed when the code of a Raven-II's tick is generated."""

import dataclasses
from collections.abc import Callable
from typing import Any, ClassVar, Literal

from ravenjax.numbers import setup
from ravenjax.robots.raven2.arms import JOINTS, LEADING_LENGTHS, ArmName, PerArm
from ravenjax.vocabulary.parts import OwnSource

__all__ = ["ArmName", "PerArm", "RavenSetup", "map_arms"]


@dataclasses.dataclass(frozen=True)
class RavenSetup(setup.Setup):
    """Options that select the code of the tick. Each combination is compiled once."""

    joints: ClassVar[tuple[str, ...]] = JOINTS
    leading_joints: ClassVar[tuple[int, ...]] = LEADING_LENGTHS
    arms: tuple[ArmName, ...] = ("gold",)  # in mechanism order, gold first
    # the present raven2 software, or the 2015 simulator fork
    software: Literal["raven2", "fork2015"] = "raven2"
    tools: tuple[str, ...] = ("r_grasper",)  # one per arm, a name of geometry.tools
    # how the fork is built: for the robot, or for a dynamics simulator
    build: Literal["robot", "dyn_sim", "dyn_sim_tools"] = "robot"
    console: Literal["increments", "absolute"] = "increments"  # content of packets
    dac_words: Literal["wrap", "saturate", "unwrapped"] = "wrap"  # how USB stores a DAC command
    # how the links' motion is computed: by printed equations, or in engine mjx by MuJoCo MJX
    link_dynamics: Literal["unrolled", "mjx"] = "unrolled"
    substeps: int = 1  # plant steps per 1 ms tick
    # shares of packets that last 1, 2, .. cycles, by choice; (): all packets last equally long
    packets: tuple[tuple[float, ...], ...] = ()
    packet_history: int = 0  # ms; age of the oldest packet that faults may send again
    cables: Literal["unbreakable", "break"] = "unbreakable"  # what an overload does to a cable
    command_delay: int = 0  # ms, longest delay of a DAC command from USB write to motor
    controller: tuple[tuple[str, OwnSource], ...] = ()  # (stage, user's file that replaces it)
    hands: OwnSource | None = None  # a user's file that replaces the operator


def map_arms(
    setup: RavenSetup, function: Callable[..., Any], *columns: tuple[Any, ...]
) -> tuple[Any, ...]:
    """Return `function(setup, arm, *entries)` for each arm, with the arm's entry of each column."""
    return tuple(function(setup, *row) for row in zip(setup.arms, *columns, strict=True))
