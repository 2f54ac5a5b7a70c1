"""The robot's built-in checks: name, unit of the margin, what a check looks at, and what it does
when it trips.
"""

from __future__ import annotations

from ravenjax.vocabulary.checks import Check

_ALL = (
    Check(
        "overdrive_instant",
        "DAC counts",
        "overdrive detection: command beyond the instant limit, stops",
        "stop",
        "overdrive",
    ),
    Check(
        "overdrive_hard",
        "ticks",
        "overdrive detection: shared counter of the hard policy full, stops",
        "stop",
        "hard_counter",
    ),
    Check(
        "overdrive_clip",
        "DAC counts",
        "overdrive detection: command clipped to its joint's limit",
        "limit",
    ),
    Check("soft_estop", "1", "software E-stop raised", "stop", follows=True),
    Check("plc_watchdog", "ms", "PLC: watchdog wave missing", "stop", "watchdog", follows=True),
    Check("estop", "1", "run level 0 entered", "stop", "plc", follows=True),
    Check("ik_reject", "rad", "inverse kinematics: no valid solution", "flag"),
    Check(
        "joint_limit", "of the range", "desired joint position clamped to its soft limit", "flag"
    ),
    Check("master_timeout", "ticks", "operator packets missing for too long", "flag"),
    Check("packet_size", "bytes", "operator packet too short", "limit"),
    Check("packet_zero", "1", "operator packet with the reserved sequence number 0", "limit"),
    Check("packet_skip", "1", "operator packet after a gap, dropped", "limit"),
    Check("packet_duplicate", "1", "operator packet seen before, dropped", "limit"),
    Check("packet_reset", "1", "operator packet far behind, taken as a restart, dropped", "limit"),
    Check("packet_order", "1", "operator packet behind, dropped", "limit"),
)

CHECKS: dict[str, Check] = {check.name: check for check in _ALL}
"""Every check in the order of the loop.

What counts as telling a person: inverse kinematics without a solution, a saturated joint and a
silent master are the error messages that the published experiments took as detections (SAFECOMP
2015; DSN 2016). A clipped command prints a line on the control computer in one of a hundred cycles,
and the network layer logs what it drops: at the console nobody sees either, so both are limits.
"""
