"""A program of its own that speaks CRTK over ROS 1, by rospy and the definitions below; run by
the system's Python.
"""

import os
import sys
import time

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

import crtk_questions
import rospy
from genpy.dynamic import generate_dynamic
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from sensor_msgs.msg import JointState, Joy

HEADER = "\n" + "=" * 80 + "\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n"
STATE = "std_msgs/Header header\nstring state\nbool is_homed\nbool is_busy\n" + HEADER
OperatingState = generate_dynamic("crtk_msgs/OperatingState", STATE)["crtk_msgs/OperatingState"]
STRING = "std_msgs/Header header\nstring string\n" + HEADER
StringStamped = generate_dynamic("crtk_msgs/StringStamped", STRING)["crtk_msgs/StringStamped"]
KINDS, COMMANDS = crtk_questions.topics(
    JointState, PoseStamped, TwistStamped, WrenchStamped, OperatingState, StringStamped, Joy
)


class Peer:
    def __init__(self):
        rospy.init_node("peer", anonymous=True)
        self._last, self._count, self._arrived = {}, {}, {}
        self.heard = None
        for word, kind in KINDS.items():
            self._count["arm1/" + word] = 0
            rospy.Subscriber("/arm1/" + word, kind, self._hear, "arm1/" + word, tcp_nodelay=True)
        self._publishers = {
            name: rospy.Publisher("/" + name, kind, queue_size=10, tcp_nodelay=True)
            for name, kind in COMMANDS.items()
        }

    def _hear(self, message, name):
        self._last[name], self._arrived[name] = message, time.time()
        self._count[name] += 1
        if self.heard is not None:
            self.heard(name, message)

    def last(self, name):
        return self._last.get(name)

    def count(self, name):
        return self._count[name]

    def arrived(self, name):
        return self._arrived[name]

    def stamp(self, message):
        return message.header.stamp.to_sec()

    def send(self, name, string="", position=(), quat=(), buttons=()):
        message = COMMANDS[name]()
        message.header.stamp = rospy.Time.from_sec(time.time())
        if name.endswith("state_command"):
            message.string = string
        elif name.endswith("servo_cp"):
            point, turn = message.pose.position, message.pose.orientation
            point.x, point.y, point.z = position
            turn.x, turn.y, turn.z, turn.w = quat
        elif name.startswith("console"):
            message.buttons = list(buttons)
        else:
            message.position = list(position)
        self._publishers[name].publish(message)


if __name__ == "__main__":
    crtk_questions.main(Peer(), sys.argv[1:])
