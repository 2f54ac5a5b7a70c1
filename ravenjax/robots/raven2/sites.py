"""Where on the Raven's loop a fault can strike: named sites, their channels, number types and
units.

A site is a seam between two stages of the tick, in the robot's order.
"""

from __future__ import annotations

from ravenjax.robots.raven2 import run_levels
from ravenjax.robots.raven2.arms import JOINTS
from ravenjax.vocabulary.sites import ARM, Channel, Field, Kind, Site

USB_SITE = "usb_out"
"""The site whose words `[campaign] dac_words` is about."""

RUN_LEVEL = Field(0, len(run_levels.NAMES) - 1, "a run level", 2)
BYTE = Field(0, 255, "a byte", 8)
DATAGRAM = Field(0, 65507, "the length of a datagram", 16)


def _joints(kind: Kind, units: tuple[str, str], *prefix: str | int) -> tuple[Channel, ...]:
    """One channel a joint; `units` of a revolute joint and of the insertion."""
    return tuple(
        Channel(joint, (*prefix, ARM, i), kind, units[1] if joint == "insertion" else units[0])
        for i, joint in enumerate(JOINTS)
    )


def _vector(
    names: tuple[str, ...], kind: Kind, unit: str, *prefix: str | int
) -> tuple[Channel, ...]:
    return tuple(Channel(name, (*prefix, i), kind, unit) for i, name in enumerate(names))


def _position() -> tuple[Channel, ...]:
    return tuple(Channel(axis, (ARM, i), "int32", "um") for i, axis in enumerate("xyz"))


def _rotation() -> tuple[Channel, ...]:
    return _vector(("qx", "qy", "qz", "qw"), "float", "1", ARM)


SITES: dict[str, Site] = {
    site.name: site
    for site in (
        Site(
            "hand",
            "L1",
            True,
            tuple(Channel(axis, (ARM, i), "float", "um") for i, axis in enumerate("xyz")),
            "what the hand moves beyond the plan in this ms, before scaling (so mm/s); it stays"
            " where it was taken; robot and nominal model follow it alike",
        ),
        Site(
            "console",
            "L1",
            False,
            (Channel("scale", ("scale",), "float", "1"),),
            "teleoperation scale of the packets sent to the robot; the nominal model keeps the"
            " clean one",
        ),
        Site(
            "network",
            "L9",
            False,
            (
                Channel("lag", ("lag",), "int32", "packets"),
                Channel("delay", ("delay",), "int32", "packets"),
                Channel("lost", ("lost",), "bool", "1"),
                Channel("bursts", ("bursts",), "float", "1"),
                Channel("jitter", ("jitter",), "float", "1"),
            ),
            "between console and robot: which packet arrives in a cycle, if one does; lag sends old"
            " ones again; bursts and jitter seed the channel of stages.channel, which is ideal"
            " where they are 0",
        ),
        Site(
            "packet",
            "L2",
            True,
            (
                *_vector(("delx", "dely", "delz"), "int32", "um", "delta", ARM),
                *_vector(("qx", "qy", "qz", "qw"), "float", "1", "quat", ARM),
                Channel("grasp", ("grasp", ARM), "int32", "mrad"),
            ),
            "content of a received packet, before the size and sequence checks",
        ),
        Site(
            "packet_header",
            "L2",
            False,
            (
                Channel("sequence", ("sequence",), "int32", "1"),
                Channel("surgeon_mode", ("surgeon_mode",), "int32", "1"),
                Channel("size", ("size",), "int32", "bytes", DATAGRAM),
            ),
            "header of a received packet, before the size and sequence checks",
        ),
        Site(
            "encoder",
            "L6",
            True,
            _joints("int24", ("cnt", "cnt")),
            "encoder counts as they leave the robot",
        ),
        Site(
            "usb_in",
            "L6",
            True,
            (
                *_joints("int24", ("cnt", "cnt"), "enc_val"),
                Channel("pins", ("pins", ARM), "int32", "bits", BYTE),
            ),
            "buffers read from the USB boards: encoder counts and the PLC's input pins",
        ),
        Site(
            "usb_status",
            "L6",
            True,
            (
                Channel("read_ok", ("read_ok", ARM), "bool", "1"),
                Channel("write_ok", ("write_ok", ARM), "bool", "1"),
            ),
            "USB transfers: a failed read leaves old buffers, a failed write leaves the board's old"
            " command",
        ),
        Site(
            "runlevel",
            "L5",
            False,
            (Channel("rl_desired", (), "int32", "1", RUN_LEVEL),),
            "run level asked for by the PLC pins",
        ),
        Site("mpos", "L5", True, _joints("float", ("rad", "rad")), "estimated motor positions"),
        Site(
            "mvel", "L5", True, _joints("float", ("rad/s", "rad/s")), "estimated motor velocities"
        ),
        Site(
            "jpos",
            "L5",
            True,
            _joints("float", ("rad", "m")),
            "joint positions after forward cable coupling",
        ),
        Site(
            "jvel",
            "L5",
            True,
            _joints("float", ("rad/s", "m/s")),
            "joint velocities; nothing in the loop uses them",
        ),
        Site(
            "pos",
            "L5",
            True,
            _position(),
            "measured tip position, before the desired one follows it",
        ),
        Site(
            "ori",
            "L5",
            True,
            _rotation(),
            "measured tip rotation, likewise; as a quaternion of any length but 0",
        ),
        Site("pos_d", "L3", True, _position(), "desired tip position, before inverse kinematics"),
        Site(
            "ori_d",
            "L3",
            True,
            _rotation(),
            "desired tip rotation, likewise; as a quaternion of any length but 0",
        ),
        Site(
            "jpos_d",
            "L3",
            True,
            _joints("float", ("rad", "m")),
            "desired joints, after kinematics and joint limits",
        ),
        Site("mpos_d", "L3", True, _joints("float", ("rad", "rad")), "desired motor positions"),
        Site(
            "tau_d",
            "L4",
            True,
            _joints("float", ("N m", "N m")),
            "desired torque at the capstan, before the DAC",
        ),
        Site(
            "current_cmd",
            "L4",
            True,
            _joints("int16", ("cnt", "cnt")),
            "DAC command, before the overdrive check",
        ),
        Site(
            USB_SITE,
            "L7",
            True,
            _joints("int16", ("cnt", "cnt")),
            "DAC command, after every software check",
            beyond='dac_words = "wrap" (or "saturate", "unwrapped") in [campaign]',
        ),
        Site(
            "pins_out",
            "L8",
            False,
            (Channel("pins", (), "int32", "bits", BYTE),),
            "output pins to the PLC",
        ),
        Site(
            "plc",
            "L8",
            False,
            (Channel("runlevel", (), "int32", "1", RUN_LEVEL),),
            "run level that the PLC puts on its pins",
        ),
        Site(
            "buttons",
            "L8",
            False,
            tuple(Channel(name, (name,), "bool", "1") for name in ("estop", "start")),
            "the PLC's buttons, 1 while pressed; without faults nobody touches them",
        ),
        Site(
            "torque_scale",
            "L7",
            True,
            _joints("float", ("1", "1")),
            "motor constant of each motor, times this",
        ),
        Site(
            "cable_scale",
            "L10",
            True,
            _joints("float", ("1", "1")),
            "cable stiffness and damping, times this",
        ),
        Site(
            "friction_scale",
            "L10",
            True,
            _joints("float", ("1", "1")),
            "friction of motor and joint, times this",
        ),
        Site(
            "external_torque",
            "L10",
            True,
            _joints("float", ("N m", "N")),
            "load on each joint from outside",
        ),
        Site(
            "brake", "L7", False, (Channel("engaged", (), "bool", "1"),), "brake command of the PLC"
        ),
    )
}
