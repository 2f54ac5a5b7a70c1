"""What CRTK's messages mean for the robot, and what the robot's rows are as CRTK's messages.

No transport, clock or process is touched here: messages and rows go in with their time, messages
and commands of `protocol.messages` come out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ravenjax.numbers.lazy import at_once
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.arms import ARMS, JOINTS, ArmName
from ravenjax.robots.raven2.geometry import transmission
from ravenjax.robots.raven2.geometry.limits import soft_limits
from ravenjax.train.protocol.messages import STALE_MS
from ravenjax.train.robot_link.crtk import follower, frames, messages
from ravenjax.train.robot_link.crtk.exchange import RobotRow
from ravenjax.train.robot_link.crtk.follower import (
    SETTLED_TICKS,
    STILL,
    Setpoint,
    SetpointFollower,
)
from ravenjax.train.robot_link.crtk.frames import BASE, ArmReading
from ravenjax.train.robot_link.crtk.messages import MessageTypes
from ravenjax.train.robot_link.crtk.names import ARM_NAMES, arm_topic, frame_id
from ravenjax.train.robot_link.crtk.operating_state import OperatingState
from ravenjax.train.robot_link.crtk.trajectory import Trajectory
from ravenjax.train.session import pedal

Message = tuple[str, Any]
_PER_DEGREE = 180 / np.pi


class _Arm:
    """What is known and wanted of one arm."""

    def __init__(self, arm: ArmName, tool: str, grasp_gain: int) -> None:
        self.name: ArmName = arm
        self.follower = SetpointFollower(arm, grasp_gain)
        limits = soft_limits(tool)
        self.lower, self.upper = (
            np.array(side[:5], float) for side in (limits.lower, limits.upper)
        )
        self.jpos_d = np.zeros(7)  # as the software wants it
        self.joints: np.ndarray | None = (
            None  # last goal in joint space, what relative ones count from
        )
        self.move: Trajectory | None = None

    def within(self, jpos: np.ndarray) -> bool:
        """Whether the software would go there and not clamp."""
        return bool(((jpos[:5] > self.lower) & (jpos[:5] < self.upper)).all())

    def goal(self, jpos: np.ndarray) -> Setpoint:
        """The pose at these joints."""
        return follower.setpoint(*frames.reached(self.name, jpos), float(jpos[5] + jpos[6]))

    def stand(self) -> Setpoint:
        """Where the software wants it."""
        return self.goal(self.jpos_d)


class Interpreter:
    """Of one robot."""

    def __init__(
        self,
        arms: Sequence[ArmName],
        tools: Sequence[str],
        types: MessageTypes,
        grasp_gain: int = 1,
        console: str = "crtk",
        contact: bool = False,
        refused: Callable[[str], None] = lambda _: None,
    ) -> None:
        """tools: one an arm. console: whose commands these are. contact: whether the robot tells of
        its force.

        refused: told why a message was not followed."""
        self.state = OperatingState()
        self.counts: dict[str, int] = {}
        """Messages that were not followed, by reason."""
        self._types, self._console, self._refused = types, console, refused
        self._arms: dict[ArmName, _Arm] = {
            arm: _Arm(arm, tool, grasp_gain) for arm, tool in zip(arms, tools, strict=True)
        }
        self._tools, self._contact = tools, contact
        self._told: tuple[str, bool, bool] | None = None
        self._answer = False  # a state command came: the state is told again
        self._orders: list[dict[str, Any]] = []
        self._stepped_ms: float | None = None
        self._drove = self._present = False
        self._moves = False  # the last commands have an increment
        self._sent = 0  # number of the last command with an increment
        self._taken: int | None = None  # row before which the robot took it

    # --- what is heard ---

    def hear(self, name: str, message: Any, now_ms: float) -> None:
        """A message that came for a topic of `names.subscribed`."""
        place, _, word = name.partition("/")
        arm = next(
            (
                self._arms[one]
                for one, alias in ARM_NAMES.items()
                if alias == place and one in self._arms
            ),
            None,
        )
        if name == "state_command" or (arm is not None and word == "state_command"):
            self._command(message.string.strip(), now_ms)
        elif place == "console":
            pressed = bool(len(message.buttons) and message.buttons[0])
            present = word == "operator_present"
            self.state.foot(pressed if present else None, None if present else pressed, now_ms)
            if present:
                self._wished(pressed and not self._present)
                self._present = pressed
        elif arm is not None:
            self._move(arm, word, message, now_ms)

    def _command(self, word: str, now_ms: float) -> None:
        try:
            orders = self.state.command(word, now_ms)
        except ValueError as error:
            self._refuse(str(error))
            return
        self._answer = True
        self._orders += [{"type": "operator", "do": order} for order in orders]
        self._wished(word in ("enable", "resume"))

    def _wished(self, wished: bool) -> None:
        """Somebody wants the pedal down: say where another has it."""
        if wished and not self.state.pedal and self.state.other_drives:
            self._refused(pedal.rival("another console"))

    def _move(self, arm: _Arm, word: str, message: Any, now_ms: float) -> None:
        servo = word != "move_jp"
        (self.state.servo if servo else self.state.word)(now_ms)
        if not self.state.drives or arm.follower.sum is None:
            self._refuse(f"{word}: the robot is not enabled")
            return
        now = arm.follower.target or arm.follower.sum
        goal: Setpoint | None = None
        joints: np.ndarray | None = None
        if word == "servo_cp":
            pose = messages.pose_of(message)
            if pose is None:
                self._refuse(f"{word}: no pose of finite numbers with a unit quaternion")
                return
            goal = follower.setpoint(*frames.to_frame0(arm.name, pose), now.grasp_mrad * 1e-3)
        elif word == "jaw/servo_jp":
            opening = messages.numbers_of(message.position, 1)
            if opening is None:
                self._refuse(f"{word}: position is not one finite number")
                return
            goal = now._replace(grasp_mrad=opening[0] * 1e3)
        else:
            numbers = messages.numbers_of(message.position, 7)
            if numbers is None:
                self._refuse(f"{word}: position is not 7 finite numbers")
                return
            joints = np.array(numbers)
            if word == "servo_jr":
                joints = joints + (arm.jpos_d if arm.joints is None else arm.joints)
            if not arm.within(joints):
                self._refuse(f"{word}: a joint would leave its limits")
                return
            if word == "move_jp":
                arm.move = Trajectory(
                    arm.jpos_d if arm.joints is None else arm.joints, joints, now_ms
                )
                arm.joints = joints
                return
            goal = arm.goal(joints)
        if not arm.follower.aim(goal):
            self._refuse(f"{word}: farther than 75 mm from where the arm is wanted")
            return
        arm.joints, arm.move = joints, None

    def _refuse(self, why: str) -> None:
        self.counts[why] = self.counts.get(why, 0) + 1
        if self.counts[why] == 1:
            self._refused(why)

    # --- what the robot does ---

    def observe(self, row: RobotRow, connected: bool, now_ms: float) -> None:
        """The robot's newest row."""
        frame = row.frame
        heard = frame.number("link") != 0 or frame.number("session_tick") == 0
        fresh = now_ms - row.clock_ns * 1e-6 <= STALE_MS
        runlevel, stopped = int(frame.number("runlevel")), bool(frame.number("soft_estopped"))
        was_down = self.state.pedal
        self.state.observe(runlevel, stopped, connected, now_ms, lost=not (fresh and heard))
        if was_down and not self.state.pedal and self.state.why in pedal.RELEASED:
            self._refused(pedal.RELEASED[self.state.why])
        drives = self.state.drives
        if self._taken is None and row.last_command >= self._sent:
            self._taken = row.number
        settled = self._taken is not None and row.number - self._taken >= SETTLED_TICKS
        for arm in self._arms.values():
            arm.jpos_d = frame[f"{arm.name}/jpos_d"].astype(float)
            if drives and not self._drove:
                arm.follower.engage(arm.stand())
                arm.joints = arm.move = None
            elif not drives:
                arm.follower.release()
                arm.joints = arm.move = None
            elif settled:
                slips = arm.follower.slips
                arm.follower.compare(arm.stand())
                if arm.follower.slips > slips:
                    arm.joints = arm.move = None
                    self._refuse("the robot went elsewhere: at a joint limit, or out of reach")
        self._drove = drives

    def commands(self, now_ms: float) -> list[dict[str, Any]]:
        """What the robot is asked for now: orders, and the increments since the last call with
        the pedal.
        """
        elapsed = 0.0 if self._stepped_ms is None else min(now_ms - self._stepped_ms, 20.0)
        self._stepped_ms = now_ms
        self._moves = False
        arms: dict[str, Any] = {}
        for arm in self._arms.values():
            if arm.move is not None:
                joints, done = arm.move.at(now_ms)
                if not arm.follower.aim(arm.goal(joints)) or done:
                    arm.move = None
            increment = arm.follower.step(elapsed)
            self._moves |= increment != STILL
            arms[arm.name] = {
                "delta_um": list(increment.delta_um),
                "quat": list(increment.quat),
                "grasp_mrad": increment.grasp_mrad,
            }
        self.state.is_busy = any(arm.move is not None for arm in self._arms.values())
        orders, self._orders = self._orders, []
        increments = {
            "type": "increments",
            "source": "crtk",
            "pedal": self.state.pedal,
            "arms": arms,
        }
        return [{**one, "console": self._console} for one in (*orders, increments)]

    def note_sent(self, number: int) -> None:
        """The number of the last of `commands` that went out."""
        if self._moves:
            self._sent, self._taken = number, None

    # --- what is told ---

    def states(self, stamp_ns: int) -> list[Message]:
        """The operating state, where it has changed or was asked about."""
        now = (
            self.state.state,
            self.state.is_homed,
            self.state.is_busy or self.state.runlevel == 1,
        )
        if now == self._told and not self._answer:
            return []
        self._told, self._answer = now, False
        message = self._types.operating_state(self._types.header(stamp_ns, ""), *now)
        names = ["operating_state", *(arm_topic(arm, "operating_state") for arm in self._arms)]
        return [(name, message) for name in names]

    def readings(self, row: RobotRow) -> list[Message]:
        """Everything measured and wanted, and ravenstate over ROS 1."""
        types, frame, arms = self._types, row.frame, tuple(self._arms)
        channels = [
            np.array([frame[f"{arm}/{name}"] for arm in arms])
            for name in ("jpos", "jpos_d", "mvel")
        ]
        read = [frames.read(*one) for one in zip(arms, self._tools, *channels, strict=True)]
        messages_out: list[Message] = []
        for arm, jpos, jpos_d, one in zip(arms, channels[0], channels[1], read, strict=True):
            header = types.header(row.stamp_ns, frame_id(arm))
            measured = types.joint_state(header, JOINTS, jpos, one.jvel)
            wanted = types.joint_state(header, JOINTS, jpos_d)
            poses = [
                frames.from_frame0(arm, position, rotation)
                for position, rotation in (
                    (one.position, one.rotation),
                    (one.position_d, one.rotation_d),
                )
            ]
            turned, force = BASE[arm], self._force(arm, frame)
            jaw = types.joint_state(
                header, ("jaw",), (jpos[5] + jpos[6],), (one.jvel[5] + one.jvel[6],)
            )
            jaw_d = types.joint_state(header, ("jaw",), (jpos_d[5] + jpos_d[6],))
            words = {
                "measured_js": measured,
                "setpoint_js": wanted,
                "measured_cp": types.pose(header, poses[0]),
                "setpoint_cp": types.pose(header, poses[1]),
                "measured_cv": types.twist(header, turned @ one.linear, turned @ one.angular),
                "jaw/measured_js": jaw,
                "jaw/setpoint_js": jaw_d,
                "cue_cf": types.wrench(header, turned @ force),
            }
            if self._contact:
                words["measured_cf"] = types.wrench(header, turned @ frames.pressing(frame, arm))
            messages_out += [(arm_topic(arm, word), message) for word, message in words.items()]
        if types.ros == "ros1":
            messages_out.append(("ravenstate", self._raven_state(row, read)))
        return messages_out

    def _force(self, arm: ArmName, frame: Any) -> np.ndarray:
        """Of the cue, frame 0: nobody feels it whose pedal is up."""
        return frame[f"{arm}/force"].astype(float) if self.state.drives else np.zeros(3)

    def _raven_state(self, row: RobotRow, read: list[ArmReading]) -> Any:
        frame = row.frame
        wide = {
            name: np.zeros(16, np.float32)
            for name in ("mpos", "jpos", "mvel", "jvel", "mpos_d", "jpos_d")
        }
        dac, pos, pos_d = np.zeros(16, np.int32), np.zeros(6, np.int32), np.zeros(6, np.int32)
        ori, ori_d = np.zeros(18, np.float32), np.zeros(18, np.float32)
        grasp_d, jac_vel = np.zeros(2, np.float32), np.zeros(12, np.float32)
        for arm, tool, one in zip(self._arms, self._tools, read, strict=True):
            slot = ARMS.index(arm)
            places = 8 * slot + np.array([0, 1, 2, 4, 5, 6, 7])  # number 3 is not connected
            jpos_d = frame[f"{arm}/jpos_d"].astype(float)
            with at_once():
                mpos_d = np.array(
                    transmission.motor_from_joint(arm, tool, Vec(jpos_d.tolist())), float
                )
            own = {"jvel": one.jvel, "mpos_d": mpos_d}
            for name, values in wide.items():
                values[places] = _PER_DEGREE * (
                    own[name] if name in own else frame[f"{arm}/{name}"]
                )
            dac[places] = frame[f"{arm}/dac"]
            three = slice(3 * slot, 3 * slot + 3)
            pos[three], pos_d[three] = np.rint(one.position * 1e6), np.rint(one.position_d * 1e6)
            nine = slice(9 * slot, 9 * slot + 9)
            ori[nine], ori_d[nine] = one.rotation.ravel(), one.rotation_d.ravel()
            grasp_d[slot] = jpos_d[5] + jpos_d[6]
            jac_vel[6 * slot : 6 * slot + 6] = (*one.linear, *one.angular)
        store = self._types.store.types
        return store[messages.RAVEN_STATE](
            self._types.header(row.stamp_ns, "0"),
            int(frame.number("runlevel")),
            3,  # of the initialisation: done
            int(frame.number("last_seq")),
            np.array((0, 1), np.int32),
            *(pos, ori, ori_d, pos_d),
            store["builtin_interfaces/msg/Duration"](0, 1_000_000),
            np.zeros(16, np.int32),
            dac,
            np.zeros(16, np.float32),
            *wide.values(),
            grasp_d,
            np.zeros(16, np.float32),
            jac_vel,
            jac_vel,
        )
