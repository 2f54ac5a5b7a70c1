"""Names arms and joints, in the order of every array. It does not import JAX."""

from typing import Literal, TypeAlias, TypeVar

Entry = TypeVar("Entry")
PerArm: TypeAlias = tuple[Entry, ...]
"""One entry per arm of `RavenSetup.arms`, in their order."""
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
