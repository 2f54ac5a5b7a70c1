"""Names of the arms and their joints, in the order of every array. Without JAX, for readers of
results.
"""

from __future__ import annotations

from typing import Literal

ArmName = Literal["gold", "green"]
ARMS: tuple[ArmName, ...] = ("gold", "green")
JOINTS: tuple[str, ...] = (
    "shoulder",
    "elbow",
    "insertion",
    "tool_roll",
    "wrist",
    "grasp1",
    "grasp2",
)
LEADING: tuple[int, ...] = (5,)
"""Lengths of vectors that hold the first joints only: the jaws have no limits of their own."""
LINEAR: tuple[str, ...] = ("insertion",)
"""Joints that slide: their unit is m, where the others have rad."""
