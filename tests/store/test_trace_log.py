"""MCAP traces, read back with the mcap reader and a CDR decoder of this test's own that knows only the definitions."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from mcap.reader import make_reader

from ravenjax.store import trace_log
from ravenjax.store.files import StoreError
from ravenjax.store.schema import JOINTS

TICKS = 2500
SIZES = {"float64": ("d", 8), "int32": ("i", 4), "uint32": ("I", 4)}


def types_of(text):
    """{type name: [(field type, field name)]} of a ros2msg definition; the main type is ''."""
    types = {}
    for block in text.split("=" * 80 + "\n"):
        lines = block.strip().splitlines()
        name = lines.pop(0).removeprefix("MSG: ") if lines[0].startswith("MSG: ") else ""
        types[name] = [tuple(line.split()) for line in lines]
    return types


class Decoder:
    """Reads CDR by walking a definition, so that it shares no offset with the writer."""

    def __init__(self, types, data):
        assert data[:4] == b"\x00\x01\x00\x00"
        self.types, self.data, self.at = types, data[4:], 0

    def take(self, kind):
        code, size = SIZES[kind]
        self.at += -self.at % size
        (value,) = struct.unpack_from("<" + code, self.data, self.at)
        self.at += size
        return value

    def value(self, kind):
        if kind.endswith("[]"):
            return [self.value(kind[:-2]) for _ in range(self.take("uint32"))]
        if kind == "string":
            length = self.take("uint32")
            text = self.data[self.at : self.at + length]
            self.at += length
            assert text.endswith(b"\0")
            return text[:-1].decode()
        if kind in SIZES:
            return self.take(kind)
        return {name: self.value(inner) for inner, name in self.types[kind]}


def read(path):
    """{topic: [(time ns, message)]} and the file's metadata."""
    with open(path, "rb") as file:
        reader = make_reader(file)
        assert reader.get_header().profile == "ros2"
        topics = {}
        for schema, channel, message in reader.iter_messages():
            assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
            decoder = Decoder(types_of(schema.data.decode()), message.data)
            topics.setdefault(channel.topic, []).append((message.log_time, decoder.value("")))
            assert decoder.at == len(decoder.data), "bytes left over"
        return topics, {record.name: record.metadata for record in reader.iter_metadata()}


@pytest.fixture(scope="module")
def series():
    random = np.random.default_rng(3)
    angle = np.linspace(0, 3, TICKS)
    turn = np.zeros((TICKS, 3, 3))
    turn[:, 0, 0] = turn[:, 1, 1] = np.cos(angle)
    turn[:, 1, 0], turn[:, 0, 1], turn[:, 2, 2] = np.sin(angle), -np.sin(angle), 1
    return {
        "gold/jpos": random.normal(size=(TICKS, 7)),
        "gold/jvel": random.normal(size=(TICKS, 7)).astype(np.float32),
        "gold/tau_d": random.normal(size=(TICKS, 7)),
        "gold/jpos_d": random.normal(size=(TICKS, 7)),
        "gold/position": random.normal(size=(TICKS, 3)),
        "gold/rotation": turn.reshape(TICKS, 9),
        "gold/position_d": random.normal(size=(TICKS, 3)),
        "gold/rotation_d": turn,
        "gold/model_position": random.normal(size=(TICKS, 3)),
        "gold/haptic_force": random.normal(size=(TICKS, 3)),
        "gold/current_cmd": random.integers(-32768, 32767, (TICKS, 7)).astype(np.int32),
        "green/jpos": random.normal(size=(TICKS, 7)),
        "runlevel": np.full(TICKS, 3, np.int32),
        "fault active": random.random(TICKS) < 0.5,
        "odd": random.normal(size=(TICKS, 2)),
    }


@pytest.fixture(scope="module")
def written(series, tmp_path_factory):
    path = tmp_path_factory.mktemp("trace") / "run.mcap"
    trace_log.write(path, series, {"run_id": "0123456789abcdef"})
    return path, *read(path)


def column(topics, topic, *keys):
    values = []
    for _, message in topics[topic]:
        for key in keys:
            message = message[key]
        values.append(list(message.values()) if isinstance(message, dict) else message)
    return np.array(values)


def test_topics_and_times(written):
    _, topics, metadata = written
    per_arm = ["measured_js", "setpoint_js", "measured_cp", "setpoint_cp", "model_cp", "haptic_cf"]
    assert set(topics) == {f"/arm1/{name}" for name in per_arm} | {"/arm2/measured_js", "/ravenjax/signals"}
    for messages in topics.values():
        assert [time for time, _ in messages] == [1_000_000 * tick for tick in range(TICKS)]
    assert metadata == {"ravenjax": {"run_id": "0123456789abcdef"}}
    stamp = topics["/arm1/measured_cp"][2345][1]["header"]["stamp"]
    assert stamp == {"sec": 2, "nanosec": 345_000_000}


def test_joint_states_are_exact(written, series):
    _, topics, _ = written
    first = topics["/arm1/measured_js"][0][1]
    assert first["name"] == list(JOINTS) and first["header"]["frame_id"] == "arm1_base" and first["effort"] == []
    np.testing.assert_array_equal(column(topics, "/arm1/measured_js", "position"), series["gold/jpos"])
    np.testing.assert_array_equal(column(topics, "/arm1/measured_js", "velocity"), series["gold/jvel"])
    np.testing.assert_array_equal(column(topics, "/arm1/setpoint_js", "position"), series["gold/jpos_d"])
    np.testing.assert_array_equal(column(topics, "/arm1/setpoint_js", "effort"), series["gold/tau_d"])
    np.testing.assert_array_equal(column(topics, "/arm2/measured_js", "position"), series["green/jpos"])


@pytest.mark.parametrize(("topic", "name"), [("measured_cp", ""), ("setpoint_cp", "_d")])
def test_poses(written, series, topic, name):
    _, topics, _ = written
    np.testing.assert_array_equal(column(topics, f"/arm1/{topic}", "pose", "position"), series[f"gold/position{name}"])
    turn = column(topics, f"/arm1/{topic}", "pose", "orientation")  # half-angle form of a turn about z
    angle = np.linspace(0, 3, TICKS)
    np.testing.assert_allclose(turn[:, 2], np.sin(angle / 2), atol=1e-12)
    np.testing.assert_allclose(turn[:, 3], np.cos(angle / 2), atol=1e-12)


def test_wrench_and_signals(written, series):
    _, topics, _ = written
    np.testing.assert_array_equal(column(topics, "/arm1/haptic_cf", "wrench", "force"), series["gold/haptic_force"])
    assert not column(topics, "/arm1/haptic_cf", "wrench", "torque").any()
    _, last = topics["/ravenjax/signals"][-1]
    assert list(last)[1:] == [
        *(f"gold_current_cmd_{joint}" for joint in JOINTS),
        *("runlevel", "fault_active", "odd_0", "odd_1"),
    ]
    for i, joint in enumerate(JOINTS):
        np.testing.assert_array_equal(
            column(topics, "/ravenjax/signals", f"gold_current_cmd_{joint}"), series["gold/current_cmd"][:, i]
        )
    np.testing.assert_array_equal(column(topics, "/ravenjax/signals", "fault_active"), series["fault active"])


def test_chunks_are_small_and_the_file_the_same_each_time(written, series, tmp_path):
    path, _, _ = written
    with open(path, "rb") as file:
        summary = make_reader(file).get_summary()
    assert max(index.uncompressed_size for index in summary.chunk_indexes) < 80_000
    again = tmp_path / "again.mcap"
    trace_log.write(again, series, {"run_id": "0123456789abcdef"})
    assert again.read_bytes() == path.read_bytes()


@pytest.mark.parametrize(
    "bad", [{}, {"a": np.zeros(3), "b": np.zeros(4)}, {"a": np.zeros((0, 7))}, {"a": np.float64(1)}]
)
def test_series_of_unequal_length_are_refused(tmp_path, bad):
    with pytest.raises(StoreError, match=r"run.mcap: a trace needs series of one length"):
        trace_log.write(tmp_path / "run.mcap", bad)
    assert list(tmp_path.iterdir()) == []
