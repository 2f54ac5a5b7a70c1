"""Layers of the robot, from the surgeon's console to the mechanics."""

from __future__ import annotations

from ravenjax.vocabulary.sites import SITES

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

OTHER = "other"


def name(site: str) -> str:
    """A site's layer in words: usb_out -> "USB out, motors"; "other" for a site that this version does not know."""
    return LAYERS[SITES[site].layer] if site in SITES else OTHER
