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
"""Lengths of vectors for the first joints only, because jaws have no limits."""
LINEAR: tuple[str, ...] = ("insertion",)
"""Joints that slide, with the unit m. Other joints have the unit rad."""
