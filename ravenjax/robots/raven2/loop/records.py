"""Records of the tick: parameters, state, inputs, signals, and the inputs of optional stages."""

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ravenjax.faults import fault
from ravenjax.numbers import Scalar, Vec, describe_fields, record
from ravenjax.robots.raven2.console import operator
from ravenjax.robots.raven2.loop import control, user_files
from ravenjax.robots.raven2.plant import nominal
from ravenjax.robots.raven2.plant import robot as plant
from ravenjax.robots.raven2.setup import PerArm, RavenSetup
from ravenjax.robots.raven2.stages import plc, usb
from ravenjax.stages import haptics, monitor
from ravenjax.vocabulary import packets


@describe_fields
@record
class NetworkParams:
    """Parameters of the channel from console to robot."""

    cycles_per_packet: Scalar = np.int32(1)  # int32; 1: one packet per millisecond
    packets: Scalar = np.int32(packets.EVERY_CYCLE)  # int32, distribution of vocabulary.packets
    packet_key: Scalar = np.uint32(0)  # uint32; a run and its golden run share it


@describe_fields
@record
class UsbParams:
    """Parameters of the path from USB board to motor."""

    command_delay: Scalar = np.int32(0)  # int32, at most Setup.command_delay


@describe_fields
@record
class TickParams:
    """Everything that a campaign may vary, one sub-record per stage."""

    operator: operator.OperatorParams
    network: NetworkParams
    usb: UsbParams
    control: control.ControlParams
    plc: plc.PlcParams
    plant: PerArm[plant.PlantParams]
    nominal: PerArm[nominal.NominalParams]
    haptics: haptics.HapticParams
    # parameters of each of `optional.STAGES` that is in the tick, or None; paths omit "stages"
    stages: dict[str, Any]
    checks: user_files.CheckParams
    monitor: monitor.MonitorParams
    start: PerArm[Vec]  # joints at the start of the run, 7, rad and m


@record
class TickState:
    """The state from one tick to the next. Only one stage writes each part."""

    faults: fault.FaultState
    control: control.ControlState
    boards: usb.UsbOut  # present values of the USB boards
    # int32, commands of the boards in earlier ticks, latest first
    commands: tuple[PerArm[Vec], ...]
    plc: plc.PlcState
    plant: PerArm[plant.PlantState]
    enc_val: PerArm[Vec]  # int32, counts of the encoders
    motors: PerArm[tuple[Vec, Vec]]  # rad, rad/s of motors 1-3, only for dynamics-simulator builds
    nominal: PerArm[nominal.NominalState]
    haptics: PerArm[haptics.HapticState]
    hands: operator.HandOffsets
    files: user_files.UserFilesState
    monitor: monitor.MonitorState
    stages: dict[str, Any]  # state of each of `optional.STAGES` that is in the tick
    pedal_ticks: Scalar  # int32, ticks since pedal-down was entered; negative: not in pedal-down
    pedal_down_ticks: Scalar  # int32, ticks in pedal-down so far
    packet: Scalar  # int32, index of the console's newest packet; -1: none yet
    delivered: Scalar  # int32, index of the packet that last reached the robot; -1: none yet


@record
class Input:
    """Inputs of a tick."""

    tick: Scalar  # int32, ticks since the run began
    motion: tuple[Any, ...]  # columns of the operator's motion, 1-D: the only arrays of the tick
    reference: monitor.Reference  # the golden run in this tick
    packet: Any = None  # packet.Packet of an external console; None: packets are made of the motion
    # bool, False: no fault has acted so far, and the robot is its own golden run; None: always True
    golden_differs: Any = None


@record
class TickSignals:
    """Signals at the seams in this tick; also the schema of a trace."""

    packet: Any  # packet.Packet as it reached the robot
    control: control.ControlSignals
    plant: PerArm[plant.PlantOutput]
    boards: PerArm[Vec]  # 7 int32 DAC counts of the USB boards, after their checks
    plc: plc.PlcOutput
    nominal: PerArm[nominal.NominalOutput]
    haptics: PerArm[haptics.HapticOutput]
    tip: PerArm[Vec]  # m, true tip in frame 0
    depth: PerArm[Scalar]  # m below the tissue's surface, negative above
    tip_distance: Scalar  # m between the tips; infinite with one arm
    fault_active: tuple[Scalar, ...]  # bool, one per slot
    live: Scalar  # bool, pedal-down without software E-stop
    detectors: Any = None  # detectors.DetectorsState; None: there are no detectors


@record
class Network:
    """The effect of faults on the newest packet on its way to the robot."""

    lag: Scalar  # int32, packets; age of the packet that is sent instead of the newest
    delay: Scalar  # int32, packets; delay of a channel that delivers in order
    lost: Scalar  # bool
    bursts: Scalar  # float, seed of the channel's losses; 0: none
    jitter: Scalar  # float, seed of the channel's delays; 0: none


class Start(NamedTuple):
    """The start of a run."""

    setup: RavenSetup
    params: TickParams
    jpos: PerArm[Vec]  # 7, rad and m
    tips: PerArm[Vec]  # m, frame 0
    runlevel: int


class PlanMoment(NamedTuple):
    """The place of the operator's hands in the planned motion in a tick."""

    row: Scalar  # int32, row of the motion
    before: Scalar  # int32, row of the motion when the plan last continued
    continues: Scalar  # bool, the plan continues in this tick


@dataclasses.dataclass
class Console:
    """The console in this tick. Stages that `act` may change the fields after `signal`."""

    setup: RavenSetup
    params: TickParams
    signal: Input
    newest: Scalar  # int32, index of the newest packet before this tick; -1: none yet
    soft_estopped: Scalar  # int32 flag of the control software
    fresh: Scalar  # bool, there is a new packet in this tick
    sequence: Scalar  # int32, index of the newest packet after this tick
    timing: operator.PacketTiming
    plan: PlanMoment
    hands: operator.HandOffsets
    older: Callable[[Network], operator.PacketTiming]  # returns the timing of the arriving packet
    packets_in: Callable[[Scalar], Scalar]  # ms (int32) -> number of packets sent (int32)
    # Returns the operator's deviation from the plan in a packet with this timing
    deviate: Callable[[operator.PacketTiming], operator.Deviation] = lambda _: operator.NO_DEVIATION


@dataclasses.dataclass
class Sight:
    """The inputs of stages that run after the robot has moved. Stages may move the hands."""

    setup: RavenSetup
    params: TickParams
    tick: Scalar  # int32
    pedal_down: Scalar  # bool, the control software is in run level pedal-down
    live: Scalar  # bool, pedal-down without software E-stop
    foot_on_pedal: Scalar  # bool, the operator holds the pedal down
    signals: TickSignals
    files: user_files.UserFiles
    hands: operator.HandOffsets

    @property
    def model_tips(self) -> PerArm[Vec]:
        """Tips of the nominal model, m in frame 0."""
        return tuple(out.tip_position for out in self.signals.nominal)
