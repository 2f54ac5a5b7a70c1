"""What a tick takes and gives: parameters, state, what enters it, signals. One entry an arm in
each tuple.
"""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np

from ravenjax.faults import fault
from ravenjax.numbers.quantity import Quantity, Reserved
from ravenjax.numbers.vec import Scalar, Vec, record
from ravenjax.robots.raven2.console import operator, reaction
from ravenjax.robots.raven2.loop import control, user_files
from ravenjax.robots.raven2.loop.observers import ObserverParams
from ravenjax.robots.raven2.plant import contact, nominal
from ravenjax.robots.raven2.plant import robot as plant
from ravenjax.robots.raven2.stages import plc, usb
from ravenjax.stages import (
    detectors,
    hand,
    haptics,
    monitor,
)
from ravenjax.vocabulary import packets


@record
class TickParams:
    """Everything that a campaign may vary, one sub-record a stage."""

    operator: operator.OperatorParams
    network: NetworkParams
    usb: UsbParams
    control: control.ControlParams
    plc: plc.PlcParams
    plant: tuple[plant.PlantParams, ...]
    nominal: tuple[nominal.NominalParams, ...]
    haptics: haptics.HapticParams
    reaction: reaction.ReactionParams | None  # where Setup.reacts
    hand: hand.HandParams | None  # where Setup.hand_yields
    detectors: detectors.DetectorParams | None  # where there are any
    checks: user_files.CheckParams | None  # where there are any
    contact: contact.ContactParams | None  # where Setup.contact
    monitor: Annotated[
        monitor.MonitorParams, Reserved("it belongs to the observer, not to the robot")
    ]
    start: Annotated[  # joints where the run begins, 7, rad and m
        tuple[Vec, ...],
        Reserved("it is where the operator's motion begins; write [operator.start]"),
    ]

    @property
    def observers(self) -> ObserverParams:
        """Those of the half of the tick beside the robot."""
        return ObserverParams(self.nominal, self.haptics, self.monitor)


@record
class NetworkParams:
    """The channel from console to robot."""

    cycles_per_packet: Annotated[  # int32; 1: a packet a millisecond
        Scalar, Quantity("cycles", 1, 1000, "how long a packet of the console lasts", whole=True)
    ] = np.int32(1)
    packets: Annotated[  # int32, one of vocabulary.packets
        Scalar,
        Quantity(
            "",
            0,
            3,
            "how long packets last, drawn: 0 every_cycle, 1 measured, 2 bursts, 3 the shares in"
            " campaign.packets",
            whole=True,
        ),
    ] = np.int32(packets.EVERY_CYCLE)
    packet_key: Annotated[  # uint32; a run and its golden run share it
        Scalar,
        Reserved(
            "it is derived from each run's id, so that no two runs draw the same packets; set"
            " campaign.packets"
        ),
    ] = np.uint32(0)


@record
class UsbParams:
    """The way from USB board to motor."""

    command_delay: Annotated[  # int32, at most Setup.command_delay
        Scalar, Quantity("ms", 0, 16, "from USB write to motor", whole=True)
    ] = np.int32(0)


@record
class TickState:
    """What is remembered from one tick to the next; each part is written by its own stage only."""

    faults: fault.FaultState
    control: control.ControlState
    boards: usb.UsbOut  # what the USB boards hold
    # int32, what the boards held in the ticks before, latest first
    commands: tuple[tuple[Vec, ...], ...]
    plc: plc.PlcState
    plant: tuple[plant.PlantState, ...]
    enc_val: tuple[Vec, ...]  # int32 counts that the encoders show
    # rad, rad/s of motors 1-3, for the dynamics-simulator builds alone
    motors: tuple[tuple[Vec, Vec], ...]
    nominal: tuple[nominal.NominalState, ...]
    haptics: tuple[haptics.HapticState, ...]
    hands: operator.HandOffsets
    files: user_files.UserFilesState
    monitor: monitor.MonitorState
    stages: dict[str, Any]  # of each of `optional.STAGES` that is in the tick
    pedal_ticks: Scalar  # int32, ticks since pedal-down was entered; negative: not in it
    pedal_down_ticks: Scalar  # int32, ticks in pedal-down so far
    packet: Scalar  # int32, index of the console's newest packet; -1: none yet
    delivered: Scalar  # int32, index of the packet that last reached the robot; -1: none yet


@record
class Input:
    """What enters a tick from outside."""

    tick: Scalar  # int32, ticks since the run began
    motion: tuple[
        Any, ...
    ]  # columns of the operator's motion, each a 1-D array: the only arrays of the tick
    reference: monitor.Reference  # the golden run in this tick
    packet: Any = (
        None  # packet.Packet of a console outside, in place of those that the motion makes
    )
    apart: Any = None  # bool, False: nothing has struck so far, and the robot is its own golden run


@record
class TickSignals:
    """What crossed the seams in this tick; also the schema of a trace."""

    packet: Any  # packet.Packet as it reached the robot
    control: control.ControlSignals
    plant: tuple[plant.PlantOutput, ...]
    boards: tuple[
        Vec, ...
    ]  # 7 int32 DAC counts that the USB boards hold, after what checks there refuse
    plc: plc.PlcOutput
    nominal: tuple[nominal.NominalOutput, ...]
    haptics: tuple[haptics.HapticOutput, ...]
    tip: tuple[Vec, ...]  # m, true tip in frame 0
    depth: tuple[Scalar, ...]  # m below the tissue's surface, negative above
    tip_distance: Scalar  # m between the tips; infinite with one arm
    fault_active: tuple[Scalar, ...]  # bool, one a slot
