"""A program of its own that speaks CRTK over DDS: it knows ROS 2's names and the definitions
below, nothing else.
"""

import os
import sys
import threading
import time
from dataclasses import dataclass
from types import new_class

import crtk_questions
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct, types
from cyclonedds.idl.annotations import final
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

NUMBERS = types.sequence[types.float64]


def message(kind, **fields):
    """The DDS type of a message, such as "std_msgs/Header", with these fields."""
    package, name = kind.split("/")
    typename = f"{package}::msg::dds_::{name}_"
    bare = new_class(
        name, (IdlStruct,), {"typename": typename}, lambda body: body.update(__annotations__=fields)
    )
    return dataclass(final(bare))


def xyz(kind, more=""):
    return message(kind, **dict.fromkeys("xyz" + more, types.float64))


Time = message("builtin_interfaces/Time", sec=types.int32, nanosec=types.uint32)
Header = message("std_msgs/Header", stamp=Time, frame_id=str)
JointState = message(
    "sensor_msgs/JointState",
    header=Header,
    name=types.sequence[str],
    position=NUMBERS,
    velocity=NUMBERS,
    effort=NUMBERS,
)
Joy = message(
    "sensor_msgs/Joy",
    header=Header,
    axes=types.sequence[types.float32],
    buttons=types.sequence[types.int32],
)
Point, Vector3 = xyz("geometry_msgs/Point"), xyz("geometry_msgs/Vector3")
Quaternion = xyz("geometry_msgs/Quaternion", "w")
Pose = message("geometry_msgs/Pose", position=Point, orientation=Quaternion)
PoseStamped = message("geometry_msgs/PoseStamped", header=Header, pose=Pose)
Twist = message("geometry_msgs/Twist", linear=Vector3, angular=Vector3)
TwistStamped = message("geometry_msgs/TwistStamped", header=Header, twist=Twist)
Wrench = message("geometry_msgs/Wrench", force=Vector3, torque=Vector3)
WrenchStamped = message("geometry_msgs/WrenchStamped", header=Header, wrench=Wrench)
OperatingState = message(
    "crtk_msgs/OperatingState", header=Header, state=str, is_homed=bool, is_busy=bool
)
StringStamped = message("crtk_msgs/StringStamped", header=Header, string=str)

KINDS, COMMANDS = crtk_questions.topics(
    JointState, PoseStamped, TwistStamped, WrenchStamped, OperatingState, StringStamped, Joy
)


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
