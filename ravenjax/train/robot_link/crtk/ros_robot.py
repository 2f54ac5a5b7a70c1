"""Connects a session to a robot that reports its state over ROS and is driven over ITP, such as a
real Raven.

Over ROS 1 the robot reports raven2's `ravenstate`, in any version of the message. Over ROS 2 it
reports CRTK's `measured_js`, `setpoint_js` and `operating_state` of each arm. The session sends an
E-stop as the `state_command` `disable`, and a restart as `home`. It cannot arm hazards there.
"""

import time
from typing import Any

import numpy as np

from ravenjax.errors import UserError
from ravenjax.train.protocol import Json, Say
from ravenjax.train.robot import ARMS, ArmName, Arms, motor_matrix, run_levels, tip_pose
from ravenjax.train.robot_link import WORDS
from ravenjax.train.robot_link.crtk import messages
from ravenjax.train.robot_link.joint_stream import ARM_SIZES, JointReport, RobotLink


class RosRobot(RobotLink):
    """The connection to a robot that reports its state over ROS."""

    _first_stamp_ns = 0

    def __init__(
        self, host: str, itp_port: int, arms: Arms, tools: tuple[str, ...], transport: Any, say: Say
    ):
        """tools: one for each arm. transport: exchanges messages on `topics`. say: prints a message
        if ROS fails. Raises UserError if the host has no address.
        """
        super().__init__(host, itp_port)
        self._transport, self._say = transport, say
        self._arms: dict[str, ArmName] = {messages.ARM_NAMES[arm]: arm for arm in arms}
        self._channels = {
            f"{arm}/{name}": [0.0] * size for arm in arms for name, size in ARM_SIZES.items()
        }
        self._motors = dict(zip(arms, map(motor_matrix, arms, tools), strict=True))
        self._missing = set(messages.state_topics(arms, transport.types.ros))
        self._levels: dict[ArmName, int] = {}

    @staticmethod
    def topics(arms: Arms, ros: messages.Ros) -> tuple[list[str], list[str]]:
        """Return the topics that the session publishes, and those to which it subscribes."""
        return ["state_command"], messages.state_topics(arms, ros)

    def order(self, content: Json) -> None:
        """Send the state command of an order. Orders without a state command are ignored."""
        word = WORDS["state_commands"].get(content["order"])
        if word is not None and not self.lost:
            types = self._transport.types
            message = types.message(messages.STRING, types.header(time.time_ns()), word)
            self._transport.publish("state_command", message)

    def _read_reports(self):
        """Read the messages that have arrived. If ROS fails, the robot counts as stopped."""
        try:
            arrivals = self._transport.poll()
        except UserError as error:
            self.lost = True
            self._say(
                f"reports of the robot have ended ({error}), so the robot counts as stopped. Start"
                " the session again"
            )
            return
        for name, message in arrivals:
            if name == "ravenstate":
                self._store_raven_state(message)
            else:
                self._store_message(name, message)

    def _store_raven_state(self, message):
        # Stores the state of all arms, then the report. Angles arrive in degrees.
        # Versions of the message name the DAC counts differently, or lack them.
        counts = getattr(message, "dac_val", getattr(message, "current_cmd", np.zeros(16)))
        names = "jpos", "jpos_d", "mpos", "mvel"
        joints = {name: np.radians(getattr(message, name)) for name in names}
        for arm in self._arms.values():
            index = ARMS.index(arm)
            for name, numbers in (joints | {"dac": counts}).items():
                # ravenstate has 8 joints per arm; joint 3 does not exist on the robot.
                arm_numbers = np.delete(np.reshape(numbers, (len(ARMS), 8))[index], 3)
                self._channels[f"{arm}/{name}"] = arm_numbers.tolist()
            position_um = np.reshape(message.pos, (len(ARMS), 3))[index]
            self._channels[f"{arm}/position"] = (1e-6 * position_um).tolist()
        self._finish_report(message.hdr, int(message.runlevel), int(message.last_seq))

    def _store_message(self, name: str, message):
        # Stores one message. Motor positions are computed, because CRTK does not send them.
        alias, _, word = name.partition("/")
        arm = self._arms[alias]
        if word == "operating_state":
            self._levels[arm] = _runlevel(message)
        else:
            jpos = messages.numbers_of(message.position, 7)
            if jpos is None:
                return
            if word == "setpoint_js":
                self._channels[f"{arm}/jpos_d"] = jpos.tolist()
            else:
                motors, jvel = self._motors[arm], messages.numbers_of(message.velocity, 7)
                self._channels |= {
                    f"{arm}/jpos": jpos.tolist(),
                    f"{arm}/mpos": (motors @ jpos).tolist(),
                    f"{arm}/mvel": [0.0] * 7 if jvel is None else (motors @ jvel).tolist(),
                    f"{arm}/position": tip_pose(arm, jpos)[0].tolist(),
                }
        # A report is complete when the last arm's joints arrive. The first report is complete when
        # every message has arrived. CRTK does not send the number of the last packet: 0.
        was_missing = name in self._missing
        self._missing.discard(name)
        is_last = word == "measured_js" and alias == list(self._arms)[-1]
        if not self._missing and (was_missing or is_last):
            self._finish_report(message.header, min(self._levels.values()), 0)

    def _finish_report(self, header, runlevel: int, last_seq: int):
        # Stores the channels as the report of one tick. Ticks count from the first report.
        stamp_ns = messages.stamp_ns(header)
        self._first_stamp_ns = self._first_stamp_ns or stamp_ns
        # A run level has two bits.
        is_pedal_down = runlevel == run_levels.PEDAL_DOWN
        state = {"runlevel": [runlevel & 3], "surgeon_mode": [int(is_pedal_down)]}
        report = JointReport.model_construct(
            tick=max(stamp_ns - self._first_stamp_ns, 0) // 10**6,
            last_seq=last_seq,
            channels=state | self._channels,
        )
        self._store_report(report)


def _runlevel(message) -> int:
    # Returns raven2's run level that fits CRTK's operating state best.
    if message.state == "ENABLED":
        is_homing = message.is_busy and not message.is_homed
        return run_levels.INIT if is_homing else run_levels.PEDAL_DOWN
    return run_levels.PEDAL_UP if message.is_homed else run_levels.E_STOP
