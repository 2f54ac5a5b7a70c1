"""What a check of one's own may see of one arm at its seam: all that has crossed a seam by then in
this millisecond.

Nothing that only we know is among it: not the true tip, not the links' true motion, not the fault.
What comes later in the tick is not there yet; a check that needs it of the millisecond before
remembers it where it can see it, and one that needs what no later seam has (the nominal model) is a
detector.

The boards of the real robot have but what stands under `usb_out`: a check there that reads more
than that needs a wire.
"""

from __future__ import annotations

from typing import Any

from ravenjax.numbers.vec import Scalar, Vec


class CheckView:
    """One arm in one millisecond, in the robot's order; joints are shoulder .. grasp2. `at`: the
    seam.
    """

    # from packet on
    tick: Scalar  # int32, ms since the run began
    # int32, of raven2: 0 E-stop, 1 init, 2 pedal up, 3 pedal down; at packet: of the last cycle
    runlevel: Scalar
    received: Scalar  # int32, 1 where a packet did reach the robot
    sequence: Scalar  # int32
    size: Scalar  # int32 bytes
    delta: Vec  # 3 int32 um, increment of the tip (with console = "absolute": its position)
    grasp: Scalar  # int32 mrad
    surgeon_mode: Scalar  # int32, 1: pedal down
    # from mpos on
    enc_val: Vec  # 7 int32 counts, as read from USB
    mpos: Vec  # 7 rad, of motors
    mvel: Vec  # 7 rad/s
    # from jpos on
    jpos: Vec  # 7, rad and m
    jvel: Vec  # 7, rad/s and m/s; tool joints 0, as in the original
    # from jpos_d on
    pos: Vec  # 3 int32 um, measured tip
    pos_d: Vec  # 3 int32 um, desired tip
    jpos_d: Vec  # 7, rad and m
    # from tau_d on
    mpos_d: Vec  # 7 rad
    tau_d: Vec  # 7 N m at the capstan
    # from current_cmd on
    current_cmd: Vec  # 7 int32 DAC counts, before the overdrive check
    # from checked_cmd on
    current_cmd_checked: Vec  # 7 int32 DAC counts, after it
    # at usb_out: what the arm's board has
    boards_cmd: Vec  # 7 int32 DAC counts that arrive; where the USB write failed, those it holds
    held_cmd: Vec  # 7 int32 DAC counts that it holds from the millisecond before
    boards_enc_val: Vec  # 7 int32 counts, as its encoders showed them when this cycle began
    pins: Scalar  # int32 output byte to the PLC, as it arrives
    plc_runlevel: Scalar  # int32, run level on the PLC's pins

    def __init__(self, at: str, numbers: dict[str, Any]) -> None:
        self.__dict__.update(numbers)
        self.__dict__["at"] = at

    def __getattr__(self, name: str) -> Any:
        if name in CheckView.__annotations__:
            raise AttributeError(
                f"view has no {name} yet: it comes after {self.__dict__.get('at')} in the tick"
            )
        there = ", ".join(key for key in CheckView.__annotations__ if key in self.__dict__)
        raise AttributeError(f"view has no {name} at {self.__dict__.get('at')}; it has {there}")
