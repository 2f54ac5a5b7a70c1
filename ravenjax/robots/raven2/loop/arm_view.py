"""What a part of one's own may see of one arm: everything that crosses a seam of the robot, nothing
that only we know.

The true tip, the links' true motion and the fault are not among it. Values are those of this
millisecond, after the faults of their seam.
"""

from __future__ import annotations

from ravenjax.numbers.vec import Scalar, Vec, record


@record
class ArmView:
    """One arm in one millisecond, in the robot's order; joints are shoulder .. grasp2."""

    # packet, as it reached the robot
    received: Scalar  # int32, 1 where one did
    delta: Vec  # 3 int32 um, increment of the tip (with console = "absolute": its position)
    grasp: Scalar  # int32 mrad
    surgeon_mode: Scalar  # int32, 1: pedal down
    # control software
    tick: Scalar  # int32, ms since the run began
    runlevel: Scalar  # int32, of raven2: 0 E-stop, 1 init, 2 pedal up, 3 pedal down
    enc_val: Vec  # 7 int32 counts, as read from USB
    mpos: Vec  # 7 rad, of motors
    mvel: Vec  # 7 rad/s
    jpos: Vec  # 7, rad and m
    jvel: Vec  # 7, rad/s and m/s; tool joints 0, as in the original
    pos: Vec  # 3 int32 um, measured tip
    pos_d: Vec  # 3 int32 um, desired tip
    jpos_d: Vec  # 7, rad and m
    mpos_d: Vec  # 7 rad
    tau_d: Vec  # 7 N m at the capstan
    current_cmd: Vec  # 7 int32 DAC counts, before the overdrive check
    current_cmd_checked: Vec  # 7 int32 DAC counts, after it
    current_cmd_written: Vec  # 7 int32 DAC counts, as written to USB
    # USB boards
    boards_cmd: Vec  # 7 int32 DAC counts that they hold
    brakes: Scalar  # int32, 1: the PLC closes the brakes
    # nominal model, which follows the console's clean packets
    model_jpos: Vec  # 7, rad and m
    model_tip: Vec  # 3 m
    tip: Vec  # 3 m, reported tip: that of the robot's own `jpos`, unrounded
    tip_error: Scalar  # m, distance of the two
