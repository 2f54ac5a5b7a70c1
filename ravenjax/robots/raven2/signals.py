"""What a monitor of the Raven-II can look at: fields of `loop.user_files.View`, in the robot's
order.
"""

from __future__ import annotations

from ravenjax.robots.raven2.arms import JOINTS
from ravenjax.vocabulary.signals import Signal

_POSITIONING = JOINTS[:3]
_TOOL = (("tool", JOINTS[3:]),)
_SLIDES = (("insertion", "m"),)
_SLIDING = (("insertion", "m/s"),)
_AXES = ("x", "y", "z")

SIGNALS: tuple[Signal, ...] = (
    Signal("delta", "L2", "increment of the tip in the packet", "um", _AXES, bounded=True),
    Signal("grasp", "L2", "grasp in the packet", "mrad", (), bounded=True),
    Signal("enc_val", "L6", "encoder counts as read from USB", "cnt", JOINTS, together=_TOOL),
    Signal("mpos", "L5", "motor position", "rad", JOINTS, together=_TOOL, against=("mpos_d",)),
    Signal("mvel", "L5", "motor velocity", "rad/s", JOINTS, together=_TOOL, bounded=True),
    Signal(
        "jpos",
        "L5",
        "joint position",
        "rad",
        JOINTS,
        _SLIDES,
        together=_TOOL,
        against=("jpos_d", "model_jpos"),
    ),
    Signal("jvel", "L5", "joint velocity", "rad/s", _POSITIONING, _SLIDING, bounded=True),
    Signal("pos", "L5", "measured tip", "um", _AXES, against=("pos_d",)),
    Signal("pos_d", "L3", "desired tip", "um", _AXES),
    Signal(
        "jpos_d",
        "L3",
        "desired joint position",
        "rad",
        JOINTS,
        _SLIDES,
        together=_TOOL,
        against=("model_jpos",),
    ),
    Signal("mpos_d", "L3", "desired motor position", "rad", JOINTS, together=_TOOL),
    Signal("tau_d", "L4", "desired torque", "N m", JOINTS, together=_TOOL, bounded=True),
    Signal(
        "current_cmd",
        "L4",
        "DAC command before the overdrive check",
        "cnt",
        JOINTS,
        together=_TOOL,
        bounded=True,
    ),
    Signal(
        "current_cmd_checked",
        "L4",
        "DAC command behind the overdrive check",
        "cnt",
        JOINTS,
        together=_TOOL,
        steps=False,
        against=("current_cmd",),
    ),
    Signal(
        "current_cmd_written",
        "L7",
        "DAC command as written to USB",
        "cnt",
        JOINTS,
        together=_TOOL,
        bounded=True,
        against=("current_cmd_checked",),
    ),
    Signal(
        "boards_cmd",
        "L7",
        "DAC command that the USB boards hold",
        "cnt",
        JOINTS,
        together=_TOOL,
        bounded=True,
        against=("current_cmd_written",),
    ),
    Signal("tip", "L5", "reported tip", "m", _AXES, against=("model_tip",)),
    Signal(
        "tip_error",
        "L5",
        "distance of the reported tip from the nominal model",
        "m",
        (),
        bounded=True,
    ),
)
"""A channel of an axis or joint stands at its place in the field; the first joints only where
there are fewer.
"""
