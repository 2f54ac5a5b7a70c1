"""Layers of the robot, from the surgeon's console to the mechanics, and which one each fault site belongs to."""

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

OF_SITE = {
    "hand": "L1",
    "console": "L1",
    "network": "L9",
    "packet": "L2",
    "packet_header": "L2",
    "encoder": "L6",
    "usb_in": "L6",
    "usb_status": "L6",
    "runlevel": "L5",
    "mpos": "L5",
    "mvel": "L5",
    "jpos": "L5",
    "jvel": "L5",
    "pos": "L5",
    "ori": "L5",
    "pos_d": "L3",
    "ori_d": "L3",
    "jpos_d": "L3",
    "mpos_d": "L3",
    "tau_d": "L4",
    "current_cmd": "L4",
    "usb_out": "L7",
    "pins_out": "L8",
    "plc": "L8",
    "buttons": "L8",
    "torque_scale": "L7",
    "cable_scale": "L10",
    "friction_scale": "L10",
    "external_torque": "L10",
    "brake": "L7",
}
"""As ravenjax.robot.sites.SITES, which cannot be imported without importing jax."""

OTHER = "other"


def name(site: str) -> str:
    """A site's layer in words: usb_out -> "USB out, motors"; "other" for a site that this version does not know."""
    return LAYERS.get(OF_SITE.get(site, ""), OTHER)
