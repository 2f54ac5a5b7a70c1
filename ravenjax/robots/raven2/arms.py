"""The names of arms and joints, in the order of every array. This module does not import JAX."""

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
LEADING_LENGTHS: tuple[int, ...] = (5,)
"""Possible lengths of a vector without entries for the jaws, such as the soft joint limits."""
SLIDING_JOINTS: tuple[str, ...] = ("insertion",)
"""Joints that slide, with the unit m. The other joints rotate, with the unit rad."""
