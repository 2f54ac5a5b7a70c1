"""Converts CRTK messages to commands for the robot, and the robot's state to CRTK messages.

`OperatingState` computes CRTK's operating state, and whether a CRTK console holds the robot's pedal
down. docs/how-to/crtk.md describes the states and the commands. This module uses no transport,
clock or process. It gets CRTK messages and rows of the robot's state, each with its time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ravenjax import resources
from ravenjax.train import robot
from ravenjax.train.protocol import STALE_MS, Command, Frame, Json, Say
from ravenjax.train.robot import ARMS, E_STOP, INIT, PEDAL_DOWN, PEDAL_UP, ArmName, Arms, tip_pose
from ravenjax.train.robot_link.crtk import messages
from ravenjax.train.robot_link.itp import STILL
from ravenjax.train.session.console_arbiter import REASONS, RELEASED

SPEED_UM_MS = 200.0
"""The largest speed of the tip, 0.2 m/s; recorded teleoperation stays below 232 um per ms."""
# The largest speeds of rotation and of the jaws.
TURN_RAD_MS = 4e-3
GRASP_MRAD_MS = 4.0
MAX_DISTANCE_UM = 75_000.0
"""A pose farther than this from the arm's setpoint is refused, as in raven2's CRTK."""
TOLERANCE_UM, TOLERANCE_RAD = 20.0, 2e-3
"""Differences between setpoints that are larger than rounding errors."""
SETTLED_TICKS = 30  # Ticks after which the control software has processed the last increment
_TABLES = resources.read_tables(__file__, "interpreter.toml")
BASE: dict[ArmName, np.ndarray] = {arm: np.array(rows) for arm, rows in _TABLES["base"].items()}
MAX_SPEEDS, MAX_ACCELERATIONS = np.array([_TABLES["fastest"], _TABLES["strongest"]])
_PEAK_SPEED, _PEAK_ACCELERATION = 1.875, 10 / math.sqrt(3)
"""Peaks of the first two derivatives of the minimum-jerk profile 10 s^3 - 15 s^4 + 6 s^5."""


def to_base(arm: ArmName, position: np.ndarray, rotation: np.ndarray) -> tuple[Any, Any]:
    """Return position, m, and quaternion in CRTK's base frame of a pose in frame 0."""
    quat = Rotation.from_matrix(BASE[arm] @ rotation).as_quat(canonical=True)
    return (BASE[arm] @ position).tolist(), quat.tolist()


def from_base(
    arm: ArmName, position: np.ndarray, quat: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return position, m, and rotation in frame 0 of a pose in CRTK's base frame."""
    return BASE[arm].T @ position, BASE[arm].T @ Rotation.from_quat(quat).as_matrix()


class Setpoint(NamedTuple):
    """A setpoint of an arm in frame 0."""

    position_um: np.ndarray  # [3]
    rotation: Rotation
    grasp_mrad: float  # jaw opening

    @staticmethod
    def at(arm: ArmName, jpos: np.ndarray) -> Setpoint:
        """Return the setpoint at joints [7], rad and m."""
        position, rotation = tip_pose(arm, jpos)
        grasp_mrad = float(jpos[5] + jpos[6]) * 1e3
        return Setpoint(position * 1e6, Rotation.from_matrix(rotation), grasp_mrad)


class SetpointFollower:
    """Computes the increments that move one arm to its target."""

    # The last goal in joint space, to which relative goals are added.
    goal: np.ndarray | None = None
    move: Trajectory | None = None
    # The setpoint after all increments so far; None: the arm is not driven.
    commanded: Setpoint | None = None
    target: Setpoint | None = None

    def __init__(self, arm: ArmName, tool: str, grasp_gain: int = 1):
        """grasp_gain: mrad that the jaws close per mrad of an increment in the control software."""
        self.name: ArmName = arm
        self._gain = grasp_gain
        self.motors = robot.motor_matrix(arm, tool)  # from joints to motors
        # Limits of the first five joints; joints 5 and 6 are the jaws.
        self.lower, self.upper = (np.array(side[:5], float) for side in robot.soft_limits(tool)[:2])
        self.jpos_d = np.zeros(7)  # joint setpoint of the control software
        # The ITP axes as columns, in frame 0. The transpose turns vectors from frame 0 to ITP.
        self._axes = np.array(robot.ITP_AXES[arm], float)

    def engage(self, setpoint: Setpoint) -> None:
        """Start at the control software's setpoint, because the pedal went down."""
        # Increments are whole micrometres and milliradians.
        position_um, rotation, grasp_mrad = setpoint
        self.commanded = Setpoint(np.rint(position_um), rotation, round(grasp_mrad))
        self.target = None

    def set_target(self, target: Setpoint) -> bool:
        """Set the target. Return False, and keep the last target, if the pedal is up or the new one
        is farther than `MAX_DISTANCE_UM` from the commanded position.
        """
        start = self.commanded
        if start is None or math.dist(target.position_um, start.position_um) > MAX_DISTANCE_UM:
            return False
        self.target = target
        return True

    def continue_from(self, setpoint: Setpoint) -> bool:
        """Continue from the control software's setpoint if it differs from `commanded`. Return
        whether it differs.
        """
        commanded = self.commanded
        if commanded is None:
            return False
        differs = (
            np.abs(setpoint.position_um - commanded.position_um).max() > TOLERANCE_UM
            or (setpoint.rotation * commanded.rotation.inv()).magnitude() > TOLERANCE_RAD
            or abs(setpoint.grasp_mrad - commanded.grasp_mrad) * 1e-3 > TOLERANCE_RAD
        )
        if differs:
            self.engage(setpoint)
        return bool(differs)

    def step(self, elapsed_ms: float) -> Json:
        """Return the next increment toward the target, as in a command "increments", ITP frame. It
        is within the largest speeds. elapsed_ms: since the last increment.
        """
        if self.commanded is None or self.target is None:
            return STILL
        position, rotation, grasp = self.commanded
        way = self.target.position_um - position
        # If no time has elapsed, a tiny step avoids a division by 0 and is rounded to no motion.
        max_step_um = SPEED_UM_MS * elapsed_ms or 1e-9
        # The way, shortened to `max_step_um` if it is longer, in whole micrometres.
        delta = np.rint(way / max(1.0, float(np.linalg.norm(way)) / max_step_um))
        turn = (self.target.rotation * rotation.inv()).as_rotvec()
        angle = float(np.linalg.norm(turn))
        # Angles below 1e-6 rad are rounding errors.
        turn *= 0.0 if angle < 1e-6 else min(1.0, TURN_RAD_MS * elapsed_ms / angle)
        max_grasp = GRASP_MRAD_MS * elapsed_ms
        opens_by = min(max(self.target.grasp_mrad - grasp, -max_grasp), max_grasp)
        # An increment of 1 closes the jaws by `_gain` mrad.
        steps = round(opens_by / self._gain)
        if not delta.any() and not turn.any() and not steps:
            return STILL
        next_rotation = Rotation.from_rotvec(turn) * rotation
        self.commanded = Setpoint(position + delta, next_rotation, grasp + self._gain * steps)
        return {
            "delta_um": [int(n) for n in np.rint(self._axes.T @ delta)],
            "quat": Rotation.from_rotvec(self._axes.T @ turn).as_quat().tolist(),
            "grasp_mrad": -steps,
        }


class Trajectory:
    """A motion of CRTK's `move_jp`: minimum jerk, within each joint's speed and acceleration."""

    def __init__(self, start: np.ndarray, goal: np.ndarray, begins_ms: float):
        """start, goal: [7], rad, insertion m."""
        self._start, self._way, self._begins_ms = start, goal - start, begins_ms
        # The shortest duration of each joint, s. In a motion of T seconds, the largest speed is
        # _PEAK_SPEED * way / T, and the largest acceleration _PEAK_ACCELERATION * way / T^2.
        speed_s = _PEAK_SPEED * np.abs(self._way) / MAX_SPEEDS
        acceleration_s = np.sqrt(_PEAK_ACCELERATION * np.abs(self._way) / MAX_ACCELERATIONS)
        self.duration_s = float(max(speed_s.max(), acceleration_s.max()))

    def at(self, now_ms: float) -> tuple[np.ndarray, bool]:
        """Return the joints at this time, and whether the goal is reached. The share of the way is
        10 s^3 - 15 s^4 + 6 s^5, where s is the share of the duration.
        """
        elapsed_s = (now_ms - self._begins_ms) * 1e-3
        s = 1.0 if elapsed_s >= self.duration_s else max(elapsed_s / self.duration_s, 0.0)
        return self._start + s**3 * (10 + s * (6 * s - 15)) * self._way, s == 1.0


IDLE_MS = 5000  # The robot treats the pedal as up after this silence, ms (raven2 `local_io.cpp`)
REFUSED_MS = 500  # If the robot ignores a pedal for this time, ms, another console drives
Message = tuple[str, Any]  # Topic and message
MOVED_ELSEWHERE = "the robot moved elsewhere, at a joint limit or out of reach"


class OperatingState:
    """CRTK's operating state of one robot. Times are ms of one monotonic clock."""

    runlevel = PEDAL_UP
    is_busy = False  # whether a move is under way
    pedal = False  # whether CRTK requests the pedal down
    why = ""  # why the pedal went up last
    # Whether another console holds its pedal down, so that CRTK cannot drive.
    other_drives = False
    _stopped = _lost = False
    _disabled = True  # nobody has enabled the robot
    _disabling = False  # a stop was ordered, and the robot has not stopped yet
    _restarting = False  # A restart was ordered; the pedal goes down once the robot is ready
    _operator_present = _clutch_down = False  # feet on the two pedals
    _down_before_clutch = False  # the pedal was down when the clutch was pressed
    _has_servo_commands = False  # servo commands arrived since pedal-down
    # Last times of a servo command, of any command, of the robot in pedal-down by CRTK's pedal (or
    # of its press), and of a tick in which no other console drove.
    _servo_ms = _command_ms = _accepted_ms = _no_other_ms = -math.inf

    @property
    def state(self) -> str:
        """One of DISABLED, ENABLED, PAUSED, FAULT, as CRTK defines them."""
        if self._lost:
            return "FAULT"
        if self._stopped:
            return "DISABLED" if self._disabled else "FAULT"
        # A robot that homes or that another console drives is enabled, but not by CRTK.
        if self.runlevel == INIT or self.other_drives:
            return "ENABLED"
        if self._disabled:
            return "DISABLED"
        return "ENABLED" if self.pedal and self.runlevel == PEDAL_DOWN else "PAUSED"

    @property
    def is_homed(self) -> bool:
        """Whether the robot is homed. A robot without power has lost its homing."""
        return self.runlevel in (PEDAL_UP, PEDAL_DOWN)

    @property
    def drives(self) -> bool:
        """Whether the robot follows commands of motion."""
        return self.pedal and self.state == "ENABLED" and self.runlevel == PEDAL_DOWN

    def command(self, word: str, now_ms: float) -> list[str]:
        """Process a state command and return orders for the robot. Raises ValueError if unknown."""
        if word not in _TABLES["state_commands"]:
            raise ValueError(
                f"state command {word!r}, expected one of {', '.join(_TABLES['state_commands'])}"
            )
        self._command_ms = now_ms
        # A command that does not fit the present state has no effect.
        match word, self.state:
            case "disable" | "unhome", _:
                self._release(word)
                if self.runlevel != E_STOP:
                    self._disabling = True
                    return ["estop"]
                self._disabled = True
            case "pause", "ENABLED":
                self._release(word)
            case "resume", "PAUSED":
                self._press(now_ms)
            case "enable", "DISABLED" | "FAULT":
                if not self.is_homed or self._stopped or self._lost:
                    self._restarting = True
                    return ["restart"]
                self._disabled = False
                self._press(now_ms)
            case "home", _ if not self.is_homed:
                self._disabled = False
                return ["restart"]
        return []

    def update_pedal(self, is_clutch: bool, pressed: bool, now_ms: float) -> bool:
        """Process the state of a pedal: the clutch, or "operator present". An operator who is
        present drives, except while the clutch is down. Returns whether the presence has begun.
        """
        self._command_ms = now_ms
        if is_clutch:
            if pressed and not self._clutch_down:
                was_down = self.pedal
                self._release("clutch")
                # `_release` has reset this attribute.
                self._down_before_clutch = was_down
            released = self._clutch_down and not pressed
            if released and self._down_before_clutch and self.state == "PAUSED":
                self._press(now_ms)
            self._clutch_down = pressed
            return False
        steps_on = pressed and not self._operator_present
        self._operator_present = pressed
        may_drive = self.is_homed and self.state in ("PAUSED", "DISABLED") and not self._clutch_down
        if steps_on and may_drive:
            self._disabled = False
            self._press(now_ms)
        elif not pressed:
            self._release("operator")
        return steps_on

    def record_motion(self, is_servo: bool, now_ms: float) -> None:
        """Record a command of motion. is_servo: whether it is a servo command, sent repeatedly."""
        self._command_ms, self._has_servo_commands = now_ms, is_servo
        if is_servo:
            self._servo_ms = now_ms

    def observe(
        self, runlevel: int, stopped: bool, connected: bool, now_ms: float, lost: bool = False
    ) -> None:
        """Process the robot's state in this tick, and release the pedal if CRTK may not drive.

        CRTK may not drive after a stop or a loss of reports, if nobody publishes commands, if servo
        commands or all commands cease, or if the robot ignores the pedal. stopped: by the software.
        connected: somebody publishes commands. lost: no reports arrive.
        """
        was_stopped = self._stopped
        if lost and not self._lost:
            # Only the pedal goes up: a robot that was enabled stays enabled.
            self._release("lost")
        self.runlevel, self._lost = runlevel, lost
        self._stopped = stopped or runlevel == E_STOP
        if self._stopped and not was_stopped:
            self._release("stopped")
            self._disabled = False
        if self._stopped and self._disabling:
            self._disabled, self._disabling = True, False
        if self._restarting and not (stopped or lost) and runlevel == PEDAL_UP:
            self._restarting = self._disabled = False
            self._press(now_ms)
        if self.pedal or runlevel != PEDAL_DOWN:
            self._no_other_ms = now_ms
        self.other_drives = now_ms - self._no_other_ms > REFUSED_MS
        if not self.pedal:
            return
        # A move needs no further command.
        if self.is_busy:
            self._command_ms = now_ms
        if not connected:
            self._release("nobody")
        elif self._has_servo_commands and not self.is_busy and now_ms - self._servo_ms > STALE_MS:
            self._release("silence")
        elif now_ms - self._command_ms > IDLE_MS:
            self._release("idle")
        elif runlevel == PEDAL_DOWN:
            self._accepted_ms = now_ms
        elif now_ms - self._accepted_ms > REFUSED_MS:
            self._release("refused")

    def _press(self, now_ms: float):
        self.pedal, self._has_servo_commands, self._down_before_clutch = True, False, False
        self._accepted_ms = now_ms

    def _release(self, why: str):
        if self.pedal:
            self.why = why
        self.pedal = self._down_before_clutch = self._restarting = False


class RobotRow(NamedTuple):
    """The robot's state at one tick."""

    frame: Frame
    stamp_ns: int  # ns since 1970
    clock_ns: int  # monotonic
    last_command: int  # Number of the last command that the loop read before this tick
    number: int = 0  # number of the row, from 0


class Interpreter:
    """Converts messages and commands of one robot."""

    # The state published last; None: publish it again, because a state command arrived.
    _published: tuple[str, bool, bool] | None = None
    _last_step_ms: float | None = None
    # Whether CRTK drove at the last row, and whether the last commands contain a motion.
    _drove = _has_motion = False
    _sent_number = 0  # number of the last command that contains a motion
    # Number of the row before which the robot read this command; None: not yet.
    _processed_row: int | None = None

    def __init__(
        self,
        arms: Arms,
        tools: Sequence[str],
        types: messages.MessageTypes,
        grasp_gain: int = 1,
        contact: bool = False,
        report_refusal: Say = lambda _: None,
    ):
        """tools: one for each arm. report_refusal: called with why a message is ignored."""
        self.state = OperatingState()
        self.reasons: set[str] = set()
        """Reasons why messages were ignored. Each reason is reported once."""
        self._types, self._contact = types, contact
        self._report_refusal = report_refusal
        self._arms = {
            messages.ARM_NAMES[arm]: SetpointFollower(arm, tool, grasp_gain)
            for arm, tool in zip(arms, tools, strict=True)
        }
        self._orders: list[Command] = []

    def receive(self, name: str, message: Any, now_ms: float) -> None:
        """Process a message on a topic of `messages.command_topics`."""
        owner, _, word = name.partition("/")
        if name.endswith("state_command"):
            word = message.string.strip()
            try:
                orders = self.state.command(word, now_ms)
            except ValueError as error:
                self._refuse_once(str(error))
                return
            # `states` then publishes the state even if it has not changed.
            self._published = None
            self._orders += [{"type": "operator", "do": order} for order in orders]
            self._report_rival(wants_pedal=word in ("enable", "resume"))
        elif owner == "console":
            pressed = bool(len(message.buttons) and message.buttons[0])
            steps_on = self.state.update_pedal(word == "clutch", pressed, now_ms)
            self._report_rival(wants_pedal=steps_on)
        else:
            self.state.record_motion(is_servo=word != "move_jp", now_ms=now_ms)
            if reason := self._follow_command(self._arms[owner], word, message, now_ms):
                self._refuse_once(f"{word}: {reason}")

    def _report_rival(self, wants_pedal: bool):
        """Report if an operator wants the pedal down, but another console drives."""
        if wants_pedal and not self.state.pedal and self.state.other_drives:
            self._report_refusal(REASONS["rival"])

    def _follow_command(self, arm: SetpointFollower, word: str, message, now_ms: float) -> str:
        """Follow a command of motion and return "", or return why it is not followed."""
        if not self.state.drives or arm.commanded is None:
            return "the robot is not enabled"
        present = arm.target or arm.commanded
        joints: np.ndarray | None = None
        if word == "servo_cp":
            pose = messages.pose_of(message)
            if pose is None:
                return "pose has numbers that are not finite, or no unit quaternion"
            position, rotation = from_base(arm.name, *pose)
            target = Setpoint(position * 1e6, Rotation.from_matrix(rotation), present.grasp_mrad)
        elif word == "jaw/servo_jp":
            opening = messages.numbers_of(message.position, 1)
            if opening is None:
                return "position is not one finite number"
            target = present._replace(grasp_mrad=opening[0] * 1e3)
        else:
            joints = messages.numbers_of(message.position, 7)
            if joints is None:
                return "position is not 7 finite numbers"
            last_joints = arm.jpos_d if arm.goal is None else arm.goal
            # The joints of this command are relative.
            if word == "servo_jr":
                joints = joints + last_joints
            if not ((joints[:5] > arm.lower) & (joints[:5] < arm.upper)).all():
                return "a joint would leave its limits"
            if word == "move_jp":
                arm.move, arm.goal = Trajectory(last_joints, joints, now_ms), joints
                return ""
            target = Setpoint.at(arm.name, joints)
        if not arm.set_target(target):
            return "farther than 75 mm from the arm's setpoint"
        arm.goal, arm.move = joints, None
        return ""

    def _refuse_once(self, reason: str):
        if reason not in self.reasons:
            self.reasons.add(reason)
            self._report_refusal(reason)

    def observe(self, row: RobotRow, connected: bool, now_ms: float) -> None:
        # Processes the robot's state. If the robot stopped or moved elsewhere, motions end.
        frame = row.frame
        # In the first tick, no report can have arrived yet.
        reports_arrive = frame.number("link") != 0 or frame.number("session_tick") == 0
        is_recent = now_ms - row.clock_ns * 1e-6 <= STALE_MS
        runlevel, stopped = int(frame.number("runlevel")), bool(frame.number("soft_estopped"))
        was_down = self.state.pedal
        lost = not (is_recent and reports_arrive)
        self.state.observe(runlevel, stopped, connected, now_ms, lost)
        if was_down and not self.state.pedal and self.state.why in RELEASED:
            self._report_refusal(RELEASED[self.state.why])
        drives = self.state.drives
        if self._processed_row is None and row.last_command >= self._sent_number:
            self._processed_row = row.number
        # Until the robot has processed the last increment, its setpoint may differ from CRTK's.
        ticks = -1 if self._processed_row is None else row.number - self._processed_row
        settled = ticks >= SETTLED_TICKS
        for arm in self._arms.values():
            arm.jpos_d = frame[f"{arm.name}/jpos_d"].astype(float)
            # CRTK goes on driving, begins to drive, or does not drive.
            if drives and self._drove:
                if settled and arm.continue_from(Setpoint.at(arm.name, arm.jpos_d)):
                    arm.goal = arm.move = None
                    self._refuse_once(MOVED_ELSEWHERE)
                continue
            arm.goal = arm.move = None
            if drives:
                arm.engage(Setpoint.at(arm.name, arm.jpos_d))
            else:
                arm.commanded = arm.target = None
        self._drove = drives

    def commands(self, now_ms: float) -> list[Command]:
        """Return the orders, then one command with the pedal and the increments since last time."""
        # A longer delay counts as 20 ms, so that the arms do not jump.
        last_ms = now_ms if self._last_step_ms is None else self._last_step_ms
        elapsed, self._last_step_ms = min(now_ms - last_ms, 20.0), now_ms
        increments: Json = {}
        for arm in self._arms.values():
            if arm.move is not None:
                joints, is_done = arm.move.at(now_ms)
                if not arm.set_target(Setpoint.at(arm.name, joints)) or is_done:
                    arm.move = None
            increments[arm.name] = arm.step(elapsed)
        self._has_motion = any(increment != STILL for increment in increments.values())
        self.state.is_busy = any(arm.move is not None for arm in self._arms.values())
        orders, self._orders = self._orders, []
        hands = {"type": "increments", "pedal": self.state.pedal, "arms": increments}
        return [{**command, "source": "crtk", "console": "crtk"} for command in (*orders, hands)]

    def record_sent(self, number: int) -> None:
        """Record that `commands` were sent. number: of the last of them."""
        if self._has_motion:
            self._sent_number, self._processed_row = number, None

    def states(self, stamp_ns: int) -> list[Message]:
        """Return messages of the operating state if it has changed or a state command arrived."""
        state = self.state
        fields = state.state, state.is_homed, state.is_busy or state.runlevel == INIT
        # A state command has set `_published` to None.
        if fields == self._published:
            return []
        self._published = fields
        header = self._types.header(stamp_ns)
        message = self._types.message(messages.OPERATING_STATE, header, *fields)
        names = ["operating_state", *(f"{name}/operating_state" for name in self._arms)]
        return [(name, message) for name in names]

    def readings(self, row: RobotRow) -> list[Message]:
        """Return all measurements and setpoints, and over ROS 1 also ravenstate."""
        types, frame = self._types, row.frame
        outgoing: list[Message] = []
        # Fields of ravenstate. Fields without a value in the simulation are zero.
        raven: Json = {}
        for name, arm in self._arms.items():
            jpos, jpos_d, mpos, mvel, force, contact = (
                frame[f"{arm.name}/{channel}"].astype(float)
                for channel in ("jpos", "jpos_d", "mpos", "mvel", "force", "contact")
            )
            jvel = np.linalg.solve(arm.motors, mvel)
            pose, pose_d = tip_pose(arm.name, jpos), tip_pose(arm.name, jpos_d)
            twist, base = robot.tip_twist(arm.name, jpos, jvel), BASE[arm.name]
            grasp, rate, grasp_d = (sum(joints[5:7]) for joints in (jpos, jvel, jpos_d))
            no_torque, header = np.zeros(3), types.header(row.stamp_ns, f"{name}_base")
            contents = {
                "measured_js": (list(robot.JOINTS), jpos, jvel, ()),
                "setpoint_js": (list(robot.JOINTS), jpos_d, (), ()),
                "jaw/measured_js": (["jaw"], [grasp], [rate], ()),
                "jaw/setpoint_js": (["jaw"], [grasp_d], (), ()),
                "measured_cp": [to_base(arm.name, *pose)],
                "setpoint_cp": [to_base(arm.name, *pose_d)],
                "measured_cv": [[base @ part for part in twist]],
                "cue_cf": [(base @ force if self.state.drives else no_torque, no_torque)],
            }
            if self._contact:
                # Like CRTK's `servo_cf`, this is the robot's force on its environment, so it is
                # opposite to the force on the instrument. Subtracting from zero avoids -0.
                contents["measured_cf"] = [(base @ (0.0 - contact), no_torque)]
            for word, content in contents.items():
                topic = f"{name}/{word}"
                outgoing.append((topic, types.message(messages.kind_of(topic), header, *content)))
            angles = np.degrees([mpos, mvel, arm.motors @ jpos_d, jpos, jvel, jpos_d])
            joints = np.vstack([angles, frame[f"{arm.name}/dac"]])
            # ravenstate has 8 joints per arm; joint 3 does not exist on the robot.
            joints = np.insert(joints, 3, 0.0, axis=1)
            arm_fields = dict(zip(_TABLES["ravenstate"], joints, strict=True))
            for suffix, (position, rotation) in (("", pose), ("_d", pose_d)):
                arm_fields[f"pos{suffix}"] = np.rint(position * 1e6)
                arm_fields[f"ori{suffix}"] = rotation.ravel()
            arm_fields["grasp_d"] = np.array([grasp_d])
            arm_fields |= dict.fromkeys(("jac_vel", "jac_f"), np.concatenate(twist))
            for field, numbers in arm_fields.items():
                both = raven.setdefault(field, np.zeros(len(ARMS) * len(numbers)))
                both.reshape(len(ARMS), -1)[ARMS.index(arm.name)] = numbers
        if types.ros == "ros1":
            raven |= {
                "type": [0, 1],
                "dt": (0, 1_000_000),
                "hdr": types.header(row.stamp_ns, "0"),
                # Sublevel 3 of the initialisation: done.
                "sublevel": 3,
                **{name: int(frame.number(name)) for name in ("runlevel", "last_seq")},
            }
            names = [name for name, _ in types.store.fielddefs[messages.RAVEN_STATE][1]]
            values = [raven.get(name, np.zeros(16)) for name in names]
            outgoing.append(("ravenstate", types.message(messages.RAVEN_STATE, *values)))
        return outgoing
