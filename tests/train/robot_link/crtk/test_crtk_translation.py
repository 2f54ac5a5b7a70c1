"""Frames, increments, states and moves of CRTK, without any transport."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ravenjax.robots.raven2.geometry.arrays import forward_kinematics
from ravenjax.store.logs import ros_types
from ravenjax.store.ring import put_json
from ravenjax.train.protocol import Frame, FrameLayout
from ravenjax.train.robot import tip_pose
from ravenjax.train.robot_link.crtk import messages
from ravenjax.train.robot_link.crtk.bridge import CrtkConsole, newest_row
from ravenjax.train.robot_link.crtk.interpreter import (
    BASE,
    IDLE_MS,
    MAX_ACCELERATIONS,
    MAX_SPEEDS,
    STILL,
    Interpreter,
    OperatingState,
    Setpoint,
    SetpointFollower,
    Trajectory,
    from_base,
    to_base,
)

BOTH = ("gold", "green")
TOOLS = ("r_grasper",) * 2
# raven2, params/raven_*_crtk.yaml: joints, position m, quaternion, told to two or three digits
YAML = {
    "gold": (
        (0.523, 1.584, 0.4002, 0.0715, 0.0950, 0.7537, 0.852),
        (0.0239, -0.0144, -0.0779),
        (-0.14, 0.636, 0.02, 0.76),
    ),
    "green": (
        (0.524, 1.583, 0.400, 0.0660, 0.0598, 0.736, 0.844),
        (0.0242, 0.0141, -0.0780),
        (0.12, 0.62, 0.07, 0.77),
    ),
}


@pytest.mark.parametrize("arm", BOTH)
def test_the_home_poses_of_raven2s_own_crtk_are_told_and_come_back(arm):
    jpos, position, quat = YAML[arm]
    pose = tip_pose(arm, jpos)
    told = to_base(arm, *pose)
    assert told[0] == pytest.approx(position, abs=6e-4)
    assert abs(np.dot(told[1], quat)) / np.linalg.norm(quat) > 0.999
    for again, before in zip(from_base(arm, *map(np.array, told)), pose, strict=True):
        np.testing.assert_allclose(again, before, atol=1e-9)
    assert np.linalg.det(BASE[arm]) == pytest.approx(1.0)


@pytest.mark.parametrize("arm", BOTH)
def test_increments_add_up_to_the_target_within_the_limits(arm):
    """Accumulated as raven2 does it (`mapping.cpp`, `local_io.cpp`), written here anew."""
    axes = {
        "gold": [[0, 0, -1], [-1, 0, 0], [0, 1, 0]],
        "green": [[0, 0, -1], [1, 0, 0], [0, -1, 0]],
    }[arm]
    start = Setpoint(np.array([-78000.4, -24000.0, 14000.0]), Rotation.identity(), 1570.0)
    goal = Rotation.from_rotvec([0.1, -0.2, 0.3])
    target = Setpoint(start.position_um + [4000, -3000, 2500], goal, 1200.0)
    one = SetpointFollower(arm, TOOLS[0])
    assert not one.set_target(target) and one.step(1.0) == STILL  # pedal up
    one.engage(start)
    assert one.set_target(target)
    position, turn, jaws = np.array([-78000, -24000, 14000]), Rotation.identity(), 1570
    for _ in range(120):
        step = one.step(1.0)
        delta, frame = np.array(axes) @ step["delta_um"], Rotation.from_matrix(axes)
        assert np.linalg.norm(delta) <= 200 * 1.01 and abs(step["grasp_mrad"]) <= 4
        increment = frame * Rotation.from_quat(step["quat"]) * frame.inv()
        assert increment.magnitude() <= 4.01e-3
        position, turn, jaws = position + delta, increment * turn, jaws - step["grasp_mrad"]
    np.testing.assert_allclose(position, target.position_um, atol=0.6)
    assert (turn * goal.inv()).magnitude() < 1e-5
    assert jaws == 1200 and one.step(1.0) == STILL


def test_a_move_begins_and_ends_at_rest_within_its_limits():
    start = np.array(YAML["gold"][0])
    goal = start + [0.1, -0.2, 0.02, 0.5, 0, 0, 0.01]
    move = Trajectory(start, goal, 1000.0)
    times = 1000.0 + np.linspace(0, 1e3 * move.duration_s, 2001)
    path = np.array([move.at(ms)[0] for ms in times])
    np.testing.assert_allclose(path[[0, -1]], [start, goal])
    assert move.at(times[-1])[1] and not move.at(times[-2])[1]
    dt = move.duration_s / 2000
    speed = np.abs(np.diff(path, axis=0) / dt).max(axis=0) / MAX_SPEEDS
    acceleration = np.abs(np.diff(path, 2, axis=0) / dt**2).max(axis=0) / MAX_ACCELERATIONS
    assert 0.99 < max(speed.max(), acceleration.max()) < 1.001  # no slower than it must be
    assert Trajectory(start, start, 0.0).at(0.0)[1]


def settled(state, runlevel=None, ms=0.0, connected=True, stopped=False):
    level = (3 if state.pedal else 2) if runlevel is None else runlevel
    state.observe(level, stopped, connected, ms)
    return state.state


def driven():
    state = OperatingState()
    assert settled(state) == "DISABLED"
    state.command("enable", 0.0)
    assert settled(state) == "ENABLED"
    return state


def in_state(name):
    state = driven()
    if name == "PAUSED":
        state.command("pause", 0.0)
        settled(state)
    elif name == "DISABLED":
        state.command("disable", 0.0)
        settled(state, 0)
    elif name == "FAULT":
        settled(state, 0)
    assert state.state == name
    return state


# CRTK's own table of transitions, what is invalid there included
TABLE = {
    "DISABLED": ("ENABLED", "DISABLED", "DISABLED", "DISABLED"),
    "ENABLED": ("ENABLED", "DISABLED", "PAUSED", "ENABLED"),
    "PAUSED": ("PAUSED", "DISABLED", "PAUSED", "ENABLED"),
    "FAULT": ("ENABLED", "DISABLED", "FAULT", "FAULT"),
}


@pytest.mark.parametrize("begin", TABLE)
@pytest.mark.parametrize("number", range(4))
def test_commands_lead_where_crtks_table_says(begin, number):
    state = in_state(begin)
    level = state.runlevel
    for order in state.command(("enable", "disable", "pause", "resume")[number], 0.0):
        level = {"estop": 0, "restart": 2}[order]
        settled(state, level)
    if level != 0:
        settled(state)
    assert settled(state, level if level == 0 else None) == TABLE[begin][number]
    assert state.is_homed == (level != 0)


def test_a_pedal_is_held_by_somebody_or_comes_up():
    state = driven()
    assert settled(state, ms=IDLE_MS) == "ENABLED" and settled(state, ms=IDLE_MS + 1.0) == "PAUSED"
    assert state.why == "idle"
    state = driven()
    state.record_motion(True, 100.0)
    assert settled(state, ms=350.0) == "ENABLED" and settled(state, ms=351.0) == "PAUSED"
    assert state.why == "silence"
    state = driven()
    assert settled(state, connected=False) == "PAUSED" and state.why == "nobody"
    state = driven()
    state.is_busy = True  # a move needs no word on its way
    assert settled(state, ms=60_000.0) == "ENABLED"
    assert settled(state, ms=60_001.0, connected=False) == "PAUSED"


# --- messages ---


@pytest.mark.parametrize("ros", ["ros1", "ros2"])
def test_every_message_comes_back_from_its_bytes(ros):
    types = messages.message_types(ros)
    interpreter = Interpreter(BOTH, TOOLS, types)
    row = robot_row()
    published = messages.published_topics(BOTH, ros)
    interpreter.observe(row, True, row.clock_ns * 1e-6)
    told = [*interpreter.readings(row), *interpreter.states(row.stamp_ns)]
    assert {name for name, _ in told} == set(published)
    for name, message in told:
        again = types.decode(types.encode(message), messages.kind_of(name))
        if name == "arm2/measured_js":
            assert messages.stamp_ns(again.header) == row.stamp_ns
            assert again.header.frame_id == "arm2_base"
            assert list(again.position) == pytest.approx(YAML["green"][0], abs=1e-6)
        if name == "ravenstate":  # degrees, the insertion too, as raven2 multiplies everything
            assert again.jpos[2] == pytest.approx(math.degrees(0.4002), rel=1e-5)
            assert again.jpos[8] == pytest.approx(math.degrees(0.524), rel=1e-5)
            assert again.jpos[3] == 0
            assert list(again.pos[:3]) == pytest.approx([-77850, -24120, 14340], abs=400)
    with pytest.raises(ValueError, match="JointState"):
        types.decode(b"\0\1\0\0\7", ros_types.JOINT_STATE)


def robot_row(runlevel=2, taken=0):
    """A row as the loop tells it, through its ring."""
    frame = Frame(FrameLayout.of(BOTH))
    for arm in BOTH:
        frame[f"{arm}/jpos"] = frame[f"{arm}/jpos_d"] = YAML[arm][0]
    frame["runlevel"] = runlevel
    loop = CrtkConsole(frame.layout, "ros2")
    loop.taken = taken
    assert newest_row(loop.rows, frame) is None
    loop.send_frame(frame)
    row = newest_row(loop.rows, Frame(frame.layout))
    put_json(loop.commands, {"type": "operator", "do": "estop"})
    assert loop.poll() == [{"type": "operator", "do": "estop"}]
    assert loop.taken == 1 and loop.poll() == []
    loop.close()
    return row


@pytest.mark.parametrize("arm", BOTH)
def test_readings_are_the_kinematics_and_their_derivative(arm):
    row, base = robot_row(), BASE[arm]
    row.frame[f"{arm}/mvel"] = np.random.default_rng(3).normal(size=7)
    told = dict(Interpreter(BOTH, TOOLS, messages.message_types("ros2")).readings(row))
    joints = told[f"{messages.ARM_NAMES[arm]}/measured_js"]
    twist = told[f"{messages.ARM_NAMES[arm]}/measured_cv"].twist
    h = 1e-6
    ahead, behind = (
        forward_kinematics(joints.position + sign * h * joints.velocity, arm) for sign in (1, -1)
    )
    linear = (twist.linear.x, twist.linear.y, twist.linear.z)
    np.testing.assert_allclose(linear, base @ (ahead[0] - behind[0]) / (2 * h), atol=1e-6)
    spin = Rotation.from_matrix(ahead[1] @ behind[1].T).as_rotvec() / (2 * h)
    angular = (twist.angular.x, twist.angular.y, twist.angular.z)
    np.testing.assert_allclose(angular, base @ spin, atol=1e-5)


# what x, y, z of the base frame are in frame 0, as docs/how-to/crtk.md has them
DOCUMENTED = {"gold": lambda x, y, z: (-y, -z, x), "green": lambda x, y, z: (y, z, x)}


@pytest.mark.parametrize("ros", ["ros1", "ros2"])
def test_the_force_on_the_environment_is_told_against_the_one_that_is_felt(ros):
    types, row = messages.message_types(ros), robot_row()
    felt = {"gold": (0.5, -1.25, 2.0), "green": (0.0, 3.0, -0.75)}
    for arm, force in felt.items():
        row.frame[f"{arm}/contact"] = force
    told = dict(Interpreter(BOTH, TOOLS, types, contact=True).readings(row))
    offered = messages.published_topics(BOTH, ros, contact=True)
    assert set(told) == {name for name in offered if not name.endswith("operating_state")}
    for arm, name in messages.ARM_NAMES.items():
        content = types.encode(told[f"{name}/measured_cf"])
        again = types.decode(content, "geometry_msgs/msg/WrenchStamped")
        force, torque = again.wrench.force, again.wrench.torque
        assert (force.x, force.y, force.z) == tuple(-one for one in DOCUMENTED[arm](*felt[arm]))
        assert (torque.x, torque.y, torque.z) == (0, 0, 0)
        assert messages.stamp_ns(again.header) == row.stamp_ns
        assert again.header.frame_id == f"{name}_base"


def joints(types, header, position):
    return types.message(ros_types.JOINT_STATE, header, [], position, (), ())


def test_a_servo_command_becomes_increments_that_add_up():
    types = messages.message_types("ros2")
    interpreter = Interpreter(BOTH, TOOLS, types)
    row = robot_row(2)
    ms = row.clock_ns * 1e-6
    header = types.header(row.stamp_ns)
    interpreter.observe(row, True, ms)
    interpreter.receive("arm1/servo_jr", joints(types, header, [0.1] + [0] * 6), ms)
    assert interpreter.reasons == {"servo_jr: the robot is not enabled"}
    interpreter.receive("state_command", types.message(messages.STRING, header, "enable"), ms)
    row.frame["runlevel"] = 3
    interpreter.observe(row, True, ms)
    assert interpreter.state.drives
    (x, y, z), quat = to_base("gold", *tip_pose("gold", YAML["gold"][0]))
    goal = types.message(ros_types.POSE, header, ((x + 0.003, y, z), quat))
    interpreter.receive("arm1/servo_cp", goal, ms)
    total = np.zeros(3)
    for i in range(40):
        (command,) = interpreter.commands(ms + i)
        assert command["pedal"] is True and command["console"] == "crtk"
        total += command["arms"]["gold"]["delta_um"]
        assert command["arms"]["green"]["delta_um"] == [0, 0, 0]
    # x of CRTK is -y of gold's frame 0, which is x of the ITP frame
    assert total.tolist() == pytest.approx([3000, 0, 0], abs=1)
    for bad in ([9.0] + [0] * 6, [0.0] * 3, [float("nan")] * 7):
        interpreter.receive("arm1/servo_jp", joints(types, header, bad), ms)
    assert len(interpreter.reasons) == 3
    (still,) = interpreter.commands(ms + 60)
    assert still["arms"]["gold"]["delta_um"] == [0, 0, 0]
