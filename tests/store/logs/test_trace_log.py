"""MCAP traces, read back as other tools read them."""

import json

import numpy as np
import pytest
import ros2_log
from scipy.spatial.transform import Rotation

from ravenjax.robots.raven2.arms import JOINTS
from ravenjax.store.logs import trace_log
from ravenjax.store.logs.topics import Base

TICKS = 2500
EVENTS = [
    {"tick": 1200, "kind": "cue", "text": "cue on: 3 mm off", "level": "warn", "distance_mm": 3.01},
    {"tick": 700, "kind": "fault", "text": "window opens", "level": "info"},
    {"tick": 1200, "kind": "hazard", "text": "unintended motion begins", "level": "error"},
]
BASES = {
    "gold": Base(
        (0.1, 0.2, 0.3), tuple(Rotation.from_euler("xyz", [10, 20, 30], degrees=True).as_quat())
    )
}


def turns(axis):
    """Rotations [T, 3, 3] about an axis, by up to 3 rad."""
    return Rotation.from_rotvec(np.outer(np.linspace(0, 3, TICKS), np.eye(3)[axis])).as_matrix()


@pytest.fixture(scope="module")
def series():
    random = np.random.default_rng(3)
    unknown = turns(1)
    unknown[100], unknown[101], unknown[102] = (
        np.nan,
        0.0,
        -np.eye(3),
    )  # no number, no rotation, a mirror
    return {
        "gold/jpos": random.normal(size=(TICKS, 7)),
        "gold/jvel": random.normal(size=(TICKS, 7)).astype(np.float32),
        "gold/tau_d": random.normal(size=(TICKS, 7)),
        "gold/jpos_d": random.normal(size=(TICKS, 7)),
        "gold/link_jpos": random.normal(size=(TICKS, 7)),
        "gold/position": random.normal(size=(TICKS, 3)),
        "gold/rotation": turns(2).reshape(TICKS, 9).astype(np.float32),
        "gold/position_d": random.normal(size=(TICKS, 3)),
        "gold/rotation_d": turns(2),
        "gold/tip": random.normal(size=(TICKS, 3)),
        "gold/tip_rotation": unknown,
        "gold/model_position": random.normal(size=(TICKS, 3)),
        "gold/model_rotation": turns(0),
        "gold/golden_tip": random.normal(size=(TICKS, 3)),
        "gold/haptic_force": random.normal(size=(TICKS, 3)),
        "gold/current_cmd": random.integers(-32768, 32767, (TICKS, 7)).astype(np.int32),
        "green/jpos": random.normal(size=(TICKS, 7)),
        "green/model_position": random.normal(size=(TICKS, 3)),
        "runlevel": np.full(TICKS, 3, np.int32),
        "fault active": random.random(TICKS) < 0.5,
        "odd": random.normal(size=(TICKS, 2)),
    }


@pytest.fixture(scope="module")
def path(series, tmp_path_factory):
    path = tmp_path_factory.mktemp("trace") / "run.mcap"
    trace_log.write_trace(path, series, {"run_id": "0123456789abcdef"}, bases=BASES, events=EVENTS)
    return path


@pytest.fixture(scope="module")
def log(path):
    return ros2_log.read(path)


def test_frames_are_one_tree_that_ends_in_the_poses(log, series):
    messages = [message.value.transforms for message in log.topics["/tf"]]
    pairs = [(one.header.frame_id, one.child_frame_id) for one in messages[0]]
    assert pairs == [
        ("world", "arm1_frame0"),
        ("arm1_frame0", "arm1_tip_measured"),
        ("arm1_frame0", "arm1_tip_true"),
        ("arm1_frame0", "arm1_tip_model"),
    ]
    known = np.array([message.number for message in log.topics["/tf"]])
    assert known.tolist() == [*range(100), *range(103, TICKS)]
    for tick, frames in zip(known.tolist(), messages, strict=True):
        assert all(
            one.header.stamp.sec * 10**9 + one.header.stamp.nanosec == tick * 1_000_000
            for one in frames
        )
    places, turned = {}, {}
    for i, (_, child) in enumerate(pairs):
        numbers = [
            (one.transform.translation, one.transform.rotation)
            for one in (frames[i] for frames in messages)
        ]
        places[child] = np.array([[p.x, p.y, p.z] for p, _ in numbers])
        quaternion = np.array([[q.x, q.y, q.z, q.w] for _, q in numbers])
        np.testing.assert_allclose(np.linalg.norm(quaternion, axis=1), 1.0, atol=1e-12)
        turned[child] = Rotation.from_quat(quaternion)
    np.testing.assert_allclose(
        places["arm1_frame0"], np.tile(BASES["gold"].origin, (len(known), 1))
    )
    for child, place, rotation in (
        ("arm1_tip_measured", "position", "rotation"),
        ("arm1_tip_true", "tip", "tip_rotation"),
        ("arm1_tip_model", "model_position", "model_rotation"),
    ):
        base = Rotation.from_quat(BASES["gold"].quaternion)
        in_world = turned["arm1_frame0"].apply(places[child]) + places["arm1_frame0"]
        wanted = base.apply(series[f"gold/{place}"][known]) + BASES["gold"].origin
        np.testing.assert_allclose(in_world, wanted, atol=1e-12)
        whole = (turned["arm1_frame0"] * turned[child]).as_matrix()
        np.testing.assert_allclose(
            whole, base.as_matrix() @ series[f"gold/{rotation}"].reshape(-1, 3, 3)[known], atol=1e-6
        )


def test_events_are_json_and_words_in_order(log):
    told = [json.loads(message.value.data) for message in log.topics["/ravenjax/events"]]
    assert told == [EVENTS[1], EVENTS[0], EVENTS[2]]
    words = log.topics["/ravenjax/log"]
    assert [(message.time_ns, message.value.name, message.value.msg) for message in words] == [
        (700_000_000, "fault", "window opens"),
        (1_200_000_000, "cue", "cue on: 3 mm off"),
        (1_200_000_000, "hazard", "unintended motion begins"),
    ]
    assert [message.value.level for message in words] == [20, 30, 40]
    stamp = words[1].value.stamp
    assert (stamp.sec, stamp.nanosec) == (1, 200_000_000)


def test_wrench_and_signals(log, series):
    np.testing.assert_array_equal(
        log.column("/arm1/haptic_cf", "wrench", "force"), series["gold/haptic_force"]
    )
    assert not log.column("/arm1/haptic_cf", "wrench", "torque").any()
    assert ros2_log.fields(log.topics["/ravenjax/signals"][-1].value)[1:] == [
        *(f"gold_tip_{i}" for i in range(3)),
        *(f"gold_golden_tip_{i}" for i in range(3)),
        *(f"gold_current_cmd_{joint}" for joint in JOINTS),
        *("runlevel", "fault_active", "odd_0", "odd_1"),
    ]
    for i, joint in enumerate(JOINTS):
        np.testing.assert_array_equal(
            log.column("/ravenjax/signals", f"gold_current_cmd_{joint}"),
            series["gold/current_cmd"][:, i],
        )
    np.testing.assert_array_equal(
        log.column("/ravenjax/signals", "fault_active"), series["fault active"]
    )
