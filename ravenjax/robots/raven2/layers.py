"""Layers of the robot, from the surgeon's console to the mechanics."""

from __future__ import annotations

LAYERS = {
    "L1": "console",
    "L9": "network",
    "L2": "packets",
    "L3": "process model",
    "L5": "estimation",
    "L4": "control output",
    "L6": "USB in",
    "L7": "USB out, motors",
    "L8": "PLC link",
    "L10": "mechanics",
}
"""Name of each layer, in the robot's order."""
