"""The seams of the Raven-II's tick: what crosses from one part to the next, in the robot's order.

Each is looked at behind the fault site of its name, as the next part reads it. What cables and
links do crosses no wire: no part of the robot reads it, so it has no normal range.
"""

from __future__ import annotations

from ravenjax.robots.raven2.arms import JOINTS
from ravenjax.vocabulary.seams import Seam, SeamChannel


def _joints(site: str, units: tuple[str, str]) -> tuple[SeamChannel, ...]:
    """One number a joint; `units` of a revolute joint and of the insertion."""
    return tuple(
        SeamChannel(joint, units[1] if joint == "insertion" else units[0], site) for joint in JOINTS
    )


def _axes(site: str, unit: str) -> tuple[SeamChannel, ...]:
    return tuple(SeamChannel(axis, unit, site) for axis in "xyz")


def _rotation(site: str) -> tuple[SeamChannel, ...]:
    """A rotation as its quaternion, of which ranges are known, and as the matrix that is stored."""
    entries = tuple(SeamChannel(f"r{i}{j}", "1") for i in (1, 2, 3) for j in (1, 2, 3))
    return (*(SeamChannel(name, "1", site) for name in ("qx", "qy", "qz", "qw")), *entries)


_ALL = (
    Seam(
        "network",
        "L9",
        False,
        (SeamChannel("received", "1"), SeamChannel("sequence", "1", "packet_header")),
        "whether a packet reaches the robot in this cycle, and which",
    ),
    Seam(
        "packet_header",
        "L2",
        False,
        tuple(
            SeamChannel(name, unit, "packet_header")
            for name, unit in (("sequence", "1"), ("surgeon_mode", "1"), ("size", "bytes"))
        ),
        "header of a received packet, as the software's checks read it",
    ),
    Seam(
        "packet",
        "L2",
        True,
        (
            *(SeamChannel(f"del{axis}", "um", "packet") for axis in "xyz"),
            *(SeamChannel(name, "1", "packet") for name in ("qx", "qy", "qz", "qw")),
            SeamChannel("grasp", "mrad", "packet"),
        ),
        "content of a received packet, as the software reads it",
    ),
    Seam(
        "usb_in",
        "L6",
        True,
        _joints("usb_in", ("cnt", "cnt")),
        "encoder counts as the software has them",
    ),
    Seam(
        "runlevel",
        "L5",
        False,
        (
            SeamChannel("rl_desired", "1", "runlevel"),
            SeamChannel("soft_estopped", "1"),
            SeamChannel("pedal", "1"),
        ),
        "run level that the software is in, its software E-stop, the pedal as it has it",
    ),
    Seam("mpos", "L5", True, _joints("mpos", ("rad", "rad")), "estimated motor positions"),
    Seam("mvel", "L5", True, _joints("mvel", ("rad/s", "rad/s")), "estimated motor velocities"),
    Seam("jpos", "L5", True, _joints("jpos", ("rad", "m")), "joint positions"),
    Seam("jvel", "L5", True, _joints("jvel", ("rad/s", "m/s")), "joint velocities"),
    Seam("pos", "L5", True, _axes("pos", "um"), "measured tip position"),
    Seam("ori", "L5", True, _rotation("ori"), "measured tip rotation"),
    Seam("pos_d", "L3", True, _axes("pos_d", "um"), "desired tip position"),
    Seam("ori_d", "L3", True, _rotation("ori_d"), "desired tip rotation"),
    Seam("jpos_d", "L3", True, _joints("jpos_d", ("rad", "m")), "desired joints"),
    Seam("mpos_d", "L3", True, _joints("mpos_d", ("rad", "rad")), "desired motor positions"),
    Seam("tau_d", "L4", True, _joints("tau_d", ("N m", "N m")), "desired torque at the capstan"),
    Seam(
        "current_cmd",
        "L4",
        True,
        _joints("current_cmd", ("cnt", "cnt")),
        "DAC command before the overdrive check",
    ),
    Seam(
        "checked_cmd",
        "L4",
        True,
        _joints("current_cmd", ("cnt", "cnt")),
        "DAC command behind the overdrive check",
    ),
    Seam(
        "usb_out",
        "L7",
        True,
        _joints("usb_out", ("cnt", "cnt")),
        "DAC command as written to the USB boards",
    ),
    Seam(
        "boards",
        "L7",
        True,
        _joints("usb_out", ("cnt", "cnt")),
        "DAC command that the boards hand to the motors",
    ),
    Seam(
        "pins_out",
        "L8",
        False,
        (SeamChannel("pins", "bits", "pins_out"),),
        "output pins to the PLC",
    ),
    Seam("plc", "L8", False, (SeamChannel("runlevel", "1", "plc"),), "run level of the PLC"),
    Seam("brake", "L7", False, (SeamChannel("engaged", "1", "brake"),), "brake command of the PLC"),
    Seam("motor_mpos", "L7", True, _joints("", ("rad", "rad")), "true motor positions"),
    Seam("motor_mvel", "L7", True, _joints("", ("rad/s", "rad/s")), "true motor velocities"),
    Seam("cable_tension", "L10", True, _joints("", ("N", "N")), "tension of the cables"),
    Seam("link_jpos", "L10", True, _joints("", ("rad", "m")), "true joint positions of the links"),
    Seam(
        "link_jvel",
        "L10",
        True,
        _joints("", ("rad/s", "m/s")),
        "true joint velocities of the links",
    ),
    Seam(
        "encoder",
        "L6",
        True,
        _joints("encoder", ("cnt", "cnt")),
        "encoder counts as the robot makes them",
    ),
    Seam("tip", "L10", True, _axes("", "m"), "true tip"),
)

SEAMS: dict[str, Seam] = {seam.name: seam for seam in _ALL}
"""Every seam in the order of the tick."""

CHECK_SEAMS: dict[str, str] = {
    "packet": "packets as received, before the software's own checks of them; limit drops one",
    "mpos": "estimated motor positions",
    "jpos": "measured joint positions, of which the tip's pose and inverse kinematics are made",
    "jpos_d": "desired joints, of which motor control makes torques",
    "tau_d": "desired torques, of which the DAC commands are made",
    "current_cmd": "DAC commands before the overdrive check",
    "checked_cmd": "DAC commands behind the overdrive check, before they are written to USB",
    "usb_out": "the USB boards, behind the USB write: what arrives there of a command",
}
"""Where a check of one's own may stand, in the order of the tick."""
