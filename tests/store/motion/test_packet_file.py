"""Recorded packets as a motion: compared with sums of the raw fields."""

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from ravenjax.errors import UserError
from ravenjax.robots.raven2.console.packet import U_STRUCT
from ravenjax.store.motion import packet_file, recording
from ravenjax.store.motion.options import ReplayOptions

FILE = "console_itp_packets.parquet"
TO_FRAME_0 = {"gold": lambda x, y, z: (-z, -x, y), "green": lambda x, y, z: (-z, x, -y)}
"""As the original's mapping has it, spelt out."""


def table(path, **changes):
    """Packets of a standard console that moves gold by 10 um every 2 ms."""
    fields = np.zeros(50, U_STRUCT)
    fields["sequence"] = np.arange(1, 51)
    fields["Qw"] = 1.0
    fields["delx"][:, 0] = 10
    fields["surgeon_mode"] = 1
    for name, values in changes.pop("fields", {}).items():
        fields[name] = values
    fields["checksum"] = fields["sequence"] + fields["surgeon_mode"] + fields["delx"].sum(axis=1)
    columns = {
        "arrival_us": np.arange(50) * 1000,
        "packet": [one.tobytes() for one in fields],
    } | changes
    pd.DataFrame(
        {name: values for name, values in columns.items() if values is not None}
    ).to_parquet(path)
    return path


def test_tips_follow_the_recorded_console_in_direction_and_scale(shared_data):
    path = shared_data(FILE)
    one = recording.load_recording(path, ("gold", "green"), ReplayOptions(max_gap_s=0.2))
    raw = pd.read_parquet(path)
    sent = np.frombuffer(b"".join(raw["packet"]), U_STRUCT)
    assert any(
        "arrival_us is read in ns, which gives 511.5 packets per second" in note
        for note in one.track.notes
    )
    assert any("the robot would drop 0 of 20,754" in note for note in one.track.notes)
    for slot, arm in enumerate(("gold", "green")):
        way = np.stack(
            TO_FRAME_0[arm](*(np.cumsum(sent[axis][:, slot]) for axis in ("delx", "dely", "delz"))),
            axis=1,
        )
        samples = one.track.arms[arm]
        np.testing.assert_allclose(
            (samples.position - samples.position[0]) * 1e6, way - way[0], atol=1e-6
        )
        np.testing.assert_allclose(
            samples.opening_mrad[0] - samples.opening_mrad,
            sent["grasp"][:, slot] - sent["grasp"][0, slot],
        )
        angle = np.sqrt(sum(sent[axis][:, slot] ** 2 for axis in ("Qx", "Qy", "Qz"))) * 1e-3
        turns = Rotation.from_quat(samples.quat)
        np.testing.assert_allclose((turns[1:] * turns[:-1].inv()).magnitude(), angle[1:], atol=1e-9)
    np.testing.assert_array_equal(one.track.surgeon_mode, sent["surgeon_mode"])
    np.testing.assert_allclose(
        one.track.arms["gold"].time_s, (raw["arrival_us"] - raw["arrival_us"][0]) * 1e-9
    )


def test_under_another_profile_it_is_refused_and_the_right_one_named(shared_data):
    with pytest.raises(
        UserError, match=r"do not fit console profile raven.*write operator\.console = 'dv_trainer'"
    ):
        recording.load_recording(shared_data(FILE), ("gold",), ReplayOptions(console="raven"))


def test_packets_that_the_robot_would_drop_move_nothing(tmp_path):
    numbers = np.arange(1, 51)
    numbers[10] = 10  # again
    numbers[11:] += 5  # a gap: the packet after it is lost, too
    read = packet_file.read_stream(
        table(tmp_path / "a.parquet", fields={"sequence": numbers}), ("gold",), "raven"
    )
    assert np.flatnonzero(~read.accepted).tolist() == [10, 11]
    assert read.delta_um[:, 0, 0].sum() == 48 * 10


@pytest.mark.parametrize(
    ("first", "silence_ms", "counted"),
    [
        (2000, 0, 24),  # the robot's own rule: far behind is a restart
        (500, 0, 0),  # not far: older packets, until the numbers are reached again
        (500, 300, 24),  # number 1 after a quarter of a second of silence
        (500, 2500, 24),
    ],
)
def test_a_console_that_starts_anew_goes_on_after_one_lost_packet(
    tmp_path, first, silence_ms, counted
):
    numbers = np.concatenate([np.arange(first, first + 25), np.arange(1, 26)])
    arrival = np.arange(50) * 2.0
    arrival[25:] += silence_ms
    changes = {"arrival_us": None, "arrival_ms": arrival}
    path = table(tmp_path / "a.parquet", fields={"sequence": numbers, "grasp": 0}, **changes)
    read = packet_file.read_stream(path, ("gold",), "raven")
    assert read.accepted[:25].all() and read.accepted[25:].sum() == counted
    assert read.delta_um[:, 0, 0].sum() == (25 + counted) * 10
