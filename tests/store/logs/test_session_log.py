"""session.mcap, read back as other tools read it, and by the package itself."""

import numpy as np
import pytest
import ros2_log
from scipy.spatial.transform import Rotation

from ravenjax.errors import StoreError
from ravenjax.robots.raven2.arms import JOINTS
from ravenjax.robots.raven2.geometry import arrays
from ravenjax.store.logs import mcap_records
from ravenjax.store.logs.session import description
from ravenjax.store.logs.session import log as session_log
from ravenjax.store.motion import source
from ravenjax.store.motion.options import ReplayOptions
from ravenjax.train.protocol import FrameLayout

LAYOUT = FrameLayout.of(("gold", "green"))
HEADER = {
    "arms": ["gold", "green"],
    "name": "é",
    "started": "2026-01-02T03:04:05.678+00:00",
    "seed": 7,
    "code_hash": "ab" * 32,
    "versions": {"ravenjax": "0.1.0"},
    "scenario": {"name": "dac_burst", "duration_s": 60},
    "hazards": [{"title": "a burst"}],
    "bases": {"green": {"origin": [0.1, 0.2, 0.3], "quaternion": [0.0, 0.0, 1.0, 0.0]}},
}
T = 95
EVENTS = [
    {"tick": 5, "kind": "note", "text": "naïve"},
    {"tick": 94, "kind": "end", "reason": "time"},
]


@pytest.fixture(scope="module")
def rows():
    return np.random.default_rng(1).normal(size=(T, LAYOUT.size)).astype(np.float32)


@pytest.fixture(scope="module")
def written(rows, tmp_path_factory):
    path = tmp_path_factory.mktemp("log") / session_log.FILE
    writer = session_log.SessionWriter(path, LAYOUT.names(), HEADER)
    writer.add(0, rows[:37], EVENTS[:1])
    writer.add(37, rows[37:60])
    writer.add(70, rows[70:], EVENTS[1:])  # ten rows were lost
    writer.close()
    return path


@pytest.fixture(scope="module")
def log(written):
    return ros2_log.read(written)


def test_it_reads_back_exactly(written, rows):
    log = session_log.read_session_log(written)
    kept = np.r_[0:60, 70:T]
    assert (
        log.names == LAYOUT.names()
        and log.header == HEADER
        and log.complete
        and log.lost_bytes == 0
    )
    np.testing.assert_array_equal(log.numbers, kept)
    np.testing.assert_array_equal(log.rows, rows[kept])
    assert log.events == EVENTS


def test_damage_at_its_head_costs_no_row(written, rows, tmp_path):
    damaged = tmp_path / session_log.FILE
    content = bytearray(written.read_bytes())
    content[60:260] = bytes(200)
    damaged.write_bytes(content)
    log = session_log.read_session_log(damaged)
    assert log.names == LAYOUT.names() and log.header == HEADER and log.lost_bytes
    np.testing.assert_array_equal(log.rows, rows[np.r_[0:60, 70:T]])
    mcap_records.recover_records(damaged)
    assert session_log.read_session_log(mcap_records.recovered_path(damaged)).header == HEADER


EVERY = [*range(0, 60, 10), *range(70, T, 10)]
"""Rows of the topics of 100 Hz."""


@pytest.mark.parametrize(("i", "arm"), [(1, "gold"), (2, "green")])
def test_other_tools_find_standard_messages(log, rows, i, arm):
    for name, channel in (
        ("measured_js", "jpos"),
        ("setpoint_js", "jpos_d"),
        ("true_js", "link_jpos"),
        ("model_js", "model_jpos"),
    ):
        states = log.topics[f"/arm{i}/{name}"]
        assert (
            states[0].value.name == list(JOINTS)
            and states[0].value.header.frame_id == f"arm{i}_frame0"
        )
        values = log.column(f"/arm{i}/{name}", "position")
        np.testing.assert_array_equal(values, rows[EVERY, LAYOUT.places[f"{arm}/{channel}"]])
    for name, channel, joints in (
        ("measured_cp", "position", "jpos"),
        ("true_cp", "tip", "link_jpos"),
        ("model_cp", "model_tip", "model_jpos"),
    ):
        points = log.column(f"/arm{i}/{name}", "pose", "position")
        np.testing.assert_array_equal(points, rows[EVERY, LAYOUT.places[f"{arm}/{channel}"]])
        quaternion = log.column(f"/arm{i}/{name}", "pose", "orientation")
        np.testing.assert_allclose(np.linalg.norm(quaternion, axis=1), 1.0, atol=1e-12)
        _, wanted = arrays.forward_kinematics(rows[EVERY, LAYOUT.places[f"{arm}/{joints}"]], arm)
        np.testing.assert_allclose(Rotation.from_quat(quaternion).as_matrix(), wanted, atol=1e-6)
    forces = log.column(f"/arm{i}/haptic_cf", "wrench", "force")
    np.testing.assert_array_equal(forces, rows[EVERY, LAYOUT.places[f"{arm}/force"]])


def test_a_recorded_session_is_a_motion_for_campaigns(written, rows):
    track = source.read_track(written, ("gold", "green"), ReplayOptions())
    gold, green = track.arms["gold"], track.arms["green"]
    np.testing.assert_allclose(gold.time_s, np.array(EVERY) * 1e-3, rtol=0.0, atol=1e-12)
    np.testing.assert_array_equal(
        green.position[:, 1], rows[EVERY, LAYOUT.places["green/position"].start + 1]
    )
    jaws = rows[EVERY, LAYOUT.places["gold/jpos_d"]].astype(float)
    np.testing.assert_allclose(gold.opening_mrad, 1e3 * (jaws[:, 5] + jaws[:, 6]))


def test_what_is_no_recording_says_so(tmp_path):
    path = tmp_path / session_log.FILE
    with pytest.raises(StoreError, match="cannot be read"):
        session_log.read_session_log(path)
    path.write_bytes(b"")
    with pytest.raises(StoreError, match="is no MCAP file"):
        session_log.read_session_log(path)
    with pytest.raises(StoreError, match="cannot be written"):
        session_log.SessionWriter(tmp_path / "none" / "s.mcap", LAYOUT.names(), HEADER)


def test_session_json_is_merged_and_its_damage_named(tmp_path):
    description.write_session(tmp_path, {"name": "a", "summary": {"score": 3}})
    told = description.update_session(tmp_path, {"ended": "now", "summary": {"rows": 4}})
    assert told == description.read_session(tmp_path)
    assert told == {"version": 1, "name": "a", "ended": "now", "summary": {"score": 3, "rows": 4}}
    with pytest.raises(StoreError, match="not the folder of a session"):
        description.read_session(tmp_path / "elsewhere")
    (tmp_path / description.FILE).write_text('{"version": 99}')
    with pytest.raises(StoreError, match="version: got 99, expected less than or equal to 1"):
        description.read_session(tmp_path)
    (tmp_path / description.FILE).write_text('{"version": ')
    with pytest.raises(StoreError, match="is not valid JSON"):
        description.read_session(tmp_path)
