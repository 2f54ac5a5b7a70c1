"""session.mcap, read back by the mcap library with a decoder of definitions, and by the package itself."""

from __future__ import annotations

import json

import numpy as np
import pytest
from mcap.reader import make_reader
from test_trace_log import Decoder, types_of

from ravenjax.store import motion_mcap, session_file, session_log
from ravenjax.store.files import StoreError
from ravenjax.store.schema import JOINTS
from ravenjax.trainer.frame import Layout

LAYOUT = Layout.of(("gold", "green"))
START = 1_767_323_045_678_000_000  # ns, of the header's "started"
HEADER = {"arms": ["gold", "green"], "name": "é", "started": "2026-01-02T03:04:05.678+00:00"}
T = 95


@pytest.fixture(scope="module")
def rows():
    return np.random.default_rng(1).normal(size=(T, LAYOUT.size)).astype(np.float32)


@pytest.fixture(scope="module")
def written(rows, tmp_path_factory):
    path = tmp_path_factory.mktemp("log") / session_log.FILE
    writer = session_log.Writer(path, LAYOUT.names(), HEADER)
    writer.add(0, rows[:37], [{"tick": 5, "kind": "note", "text": "naïve"}])
    writer.add(37, rows[37:60])
    writer.add(70, rows[70:], [{"tick": 94, "kind": "end"}])  # ten rows were lost
    writer.close()
    return path


def messages(path):
    with open(path, "rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            definition = types_of(schema.data.decode())
            if definition[""][0] == ("string", "data"):
                yield channel.topic, message, {"data": message.data[8:-1].decode()}
                continue
            yield channel.topic, message, Decoder32(definition, message.data).value("")


class Decoder32(Decoder):
    """The decoder of traces, and float32."""

    def value(self, kind):
        if kind != "float32":
            return super().value(kind)
        self.at += -self.at % 4
        (value,) = np.frombuffer(self.data, "<f4", 1, self.at)
        self.at += 4
        return value


def test_it_reads_back_exactly(written, rows):
    log = session_log.read(written)
    kept = np.r_[0:60, 70:T]
    assert log.names == LAYOUT.names() and log.header == HEADER and log.complete and log.lost_bytes == 0
    np.testing.assert_array_equal(log.numbers, kept)
    np.testing.assert_array_equal(log.rows, rows[kept])
    assert log.events == [{"tick": 5, "kind": "note", "text": "naïve"}, {"tick": 94, "kind": "end"}]


def test_other_tools_find_standard_messages(written, rows):
    found: dict = {}
    for topic, message, value in messages(written):
        found.setdefault(topic, []).append((message.log_time, message.sequence, value))
    per_arm = ("measured_js", "setpoint_js", "model_js", "measured_cp", "model_cp", "haptic_cf")
    assert set(found) == {f"/arm{i}/{name}" for i in (1, 2) for name in per_arm} | {
        "/ravenjax/signals",
        "/ravenjax/events",
    }
    flat = found["/ravenjax/signals"]
    assert [number for _, number, _ in flat] == [*range(60), *range(70, T)]
    assert all(stamp == START + number * 1_000_000 for stamp, number, _ in flat)
    assert flat[60][2]["header"]["stamp"] == {"sec": START // 10**9, "nanosec": (START + 70_000_000) % 10**9}
    np.testing.assert_array_equal(list(flat[60][2].values())[1:], rows[70])
    every = [*range(0, 60, 10), *range(70, T, 10)]  # 100 Hz
    for i, arm in ((1, "gold"), (2, "green")):
        for name, channel in (("measured_js", "jpos"), ("setpoint_js", "jpos_d"), ("model_js", "model_jpos")):
            states = found[f"/arm{i}/{name}"]
            assert [number for _, number, _ in states] == every
            assert states[0][2]["name"] == list(JOINTS) and states[0][2]["header"]["frame_id"] == f"arm{i}_base"
            values = np.array([one["position"] for _, _, one in states])
            np.testing.assert_array_equal(values, rows[every, LAYOUT.places[f"{arm}/{channel}"]])
        for name, channel in (("measured_cp", "position"), ("model_cp", "model_tip")):
            poses = [one["pose"] for _, _, one in found[f"/arm{i}/{name}"]]
            points = np.array([list(one["position"].values()) for one in poses])
            np.testing.assert_array_equal(points, rows[every, LAYOUT.places[f"{arm}/{channel}"]])
            assert not np.array([list(one["orientation"].values()) for one in poses]).any()
        forces = np.array([list(one["wrench"]["force"].values()) for _, _, one in found[f"/arm{i}/haptic_cf"]])
        np.testing.assert_array_equal(forces, rows[every, LAYOUT.places[f"{arm}/force"]])
    assert json.loads(found["/ravenjax/events"][0][2]["data"])["text"] == "naïve"


def test_a_recorded_session_is_a_motion_for_campaigns(written, rows):
    found = motion_mcap.columns(written, ("gold", "green"))
    every = [*range(0, 60, 10), *range(70, T, 10)]
    np.testing.assert_array_equal(found["time_ns"], START + np.array(every) * 1_000_000)
    np.testing.assert_array_equal(found["green_y_m"], rows[every, LAYOUT.places["green/position"].start + 1])
    jaws = rows[every, LAYOUT.places["gold/jpos_d"]].astype(float)
    np.testing.assert_allclose(found["gold_grasp_rad"], jaws[:, 5] + jaws[:, 6])


def test_what_is_no_recording_says_so(tmp_path):
    path = tmp_path / session_log.FILE
    with pytest.raises(StoreError, match="cannot be read"):
        session_log.read(path)
    path.write_bytes(b"")
    with pytest.raises(StoreError, match="is no MCAP file"):
        session_log.read(path)
    with pytest.raises(StoreError, match="cannot be written"):
        session_log.Writer(tmp_path / "none" / "s.mcap", LAYOUT.names(), HEADER)


def test_session_json_is_merged_and_its_damage_named(tmp_path):
    session_file.write(tmp_path, {"name": "a", "summary": {"score": 3}})
    told = session_file.update(tmp_path, {"ended": "now", "summary": {"rows": 4}})
    assert told == session_file.read(tmp_path)
    assert told == {"version": 1, "name": "a", "ended": "now", "summary": {"score": 3, "rows": 4}}
    with pytest.raises(StoreError, match="not the folder of a session"):
        session_file.read(tmp_path / "elsewhere")
    (tmp_path / session_file.FILE).write_text('{"version": 99}')
    with pytest.raises(StoreError, match="version 99, expected 1 or less"):
        session_file.read(tmp_path)
    (tmp_path / session_file.FILE).write_text('{"version": ')
    with pytest.raises(StoreError, match="is not valid JSON"):
        session_file.read(tmp_path)
