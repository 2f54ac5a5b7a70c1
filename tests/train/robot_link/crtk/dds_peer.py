"""A program of its own that speaks CRTK over DDS: it knows ROS 2's names and the definitions
below, nothing else.
"""

import os
import sys
import threading
import time
from dataclasses import dataclass

import crtk_questions
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct, types
from cyclonedds.idl.annotations import final
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration


@dataclass
@final
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: types.int32
    nanosec: types.uint32


@dataclass
@final
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
@final
class JointState(IdlStruct, typename="sensor_msgs::msg::dds_::JointState_"):
    header: Header
    name: types.sequence[str]
    position: types.sequence[types.float64]
    velocity: types.sequence[types.float64]
    effort: types.sequence[types.float64]


@dataclass
@final
class Joy(IdlStruct, typename="sensor_msgs::msg::dds_::Joy_"):
    header: Header
    axes: types.sequence[types.float32]
    buttons: types.sequence[types.int32]


@dataclass
@final
class Point(IdlStruct, typename="geometry_msgs::msg::dds_::Point_"):
    x: types.float64
    y: types.float64
    z: types.float64


@dataclass
@final
class Quaternion(IdlStruct, typename="geometry_msgs::msg::dds_::Quaternion_"):
    x: types.float64
    y: types.float64
    z: types.float64
    w: types.float64


@dataclass
@final
class Pose(IdlStruct, typename="geometry_msgs::msg::dds_::Pose_"):
    position: Point
    orientation: Quaternion


@dataclass
@final
class PoseStamped(IdlStruct, typename="geometry_msgs::msg::dds_::PoseStamped_"):
    header: Header
    pose: Pose


@dataclass
@final
class Vector3(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    x: types.float64
    y: types.float64
    z: types.float64


@dataclass
@final
class Twist(IdlStruct, typename="geometry_msgs::msg::dds_::Twist_"):
    linear: Vector3
    angular: Vector3


@dataclass
@final
class TwistStamped(IdlStruct, typename="geometry_msgs::msg::dds_::TwistStamped_"):
    header: Header
    twist: Twist


@dataclass
@final
class Wrench(IdlStruct, typename="geometry_msgs::msg::dds_::Wrench_"):
    force: Vector3
    torque: Vector3


@dataclass
@final
class WrenchStamped(IdlStruct, typename="geometry_msgs::msg::dds_::WrenchStamped_"):
    header: Header
    wrench: Wrench


@dataclass
@final
class OperatingState(IdlStruct, typename="crtk_msgs::msg::dds_::OperatingState_"):
    header: Header
    state: str
    is_homed: bool
    is_busy: bool


@dataclass
@final
class StringStamped(IdlStruct, typename="crtk_msgs::msg::dds_::StringStamped_"):
    header: Header
    string: str


KINDS = {
    "measured_js": JointState,
    "setpoint_js": JointState,
    "measured_cp": PoseStamped,
    "setpoint_cp": PoseStamped,
    "measured_cv": TwistStamped,
    "cue_cf": WrenchStamped,
    "measured_cf": WrenchStamped,
    "operating_state": OperatingState,
}
COMMANDS = {
    "arm1/state_command": StringStamped,
    "arm1/servo_cp": PoseStamped,
    "arm1/servo_jp": JointState,
    "arm1/servo_jr": JointState,
    "arm1/move_jp": JointState,
    "console/operator_present": Joy,
    "console/clutch": Joy,
}


class Peer:
    def __init__(self):
        participant = DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))
        default = Qos(  # rclcpp's
            Policy.Reliability.Reliable(duration(milliseconds=100)),
            Policy.Durability.Volatile,
            Policy.History.KeepLast(10),
        )
        self._readers = {
            f"arm1/{word}": DataReader(
                participant, Topic(participant, f"rt/arm1/{word}", kind), default
            )
            for word, kind in KINDS.items()
            if word != "operating_state"
        }
        latched = Qos(
            Policy.Reliability.Reliable(duration(milliseconds=100)),
            Policy.Durability.TransientLocal,
            Policy.History.KeepLast(10),
        )
        states = Topic(participant, "rt/arm1/operating_state", OperatingState)
        self._readers["arm1/operating_state"] = DataReader(participant, states, latched)
        self._writers = {
            name: DataWriter(participant, Topic(participant, f"rt/{name}", kind), default)
            for name, kind in COMMANDS.items()
        }
        self._last, self._count = {}, dict.fromkeys(self._readers, 0)
        self._arrived, self.heard = {}, None
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self):
        while True:
            for name, reader in self._readers.items():
                for sample in reader.take(N=100):
                    if hasattr(sample, "header"):
                        self._last[name], self._arrived[name] = sample, time.time()
                        self._count[name] += 1
                        if self.heard is not None:
                            self.heard(name, sample)
            time.sleep(0.001)

    def last(self, name):
        return self._last.get(name)

    def count(self, name):
        return self._count[name]

    def arrived(self, name):
        return self._arrived[name]

    def stamp(self, message):
        return message.header.stamp.sec + message.header.stamp.nanosec * 1e-9

    def send(self, name, string="", position=(), quat=(), buttons=()):
        header = Header(Time(*divmod(time.time_ns(), 10**9)), "")
        kind = COMMANDS[name]
        message = {
            StringStamped: lambda: StringStamped(header, string),
            PoseStamped: lambda: PoseStamped(header, Pose(Point(*position), Quaternion(*quat))),
            JointState: lambda: JointState(header, [], [float(x) for x in position], [], []),
            Joy: lambda: Joy(header, [], list(buttons)),
        }[kind]()
        self._writers[name].write(message)


if __name__ == "__main__":
    crtk_questions.main(Peer(), sys.argv[1:])
