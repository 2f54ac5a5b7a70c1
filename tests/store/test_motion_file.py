"""Recorded operator motions: kinds of files, units, smoothing, reach, and one clear error for each kind of damage."""

import numpy as np
import pandas as pd
import pytest

from ravenjax.errors import UserError
from ravenjax.robot.mapping import ITP_AXES
from ravenjax.store import motion_file, motion_table, trace_log

HOME_MM = np.array([-77.946997893, -25.265555299, 13.225627957])  # gold's tip at home, frame 0
ROWS = 3000


def recording(unit="um", arms=("gold",), rows=ROWS):
    """A slow circle of 10 mm about the home tip, a row a millisecond; green mirrored."""
    phase = 2.0 * np.pi * np.arange(rows) / 3000.0
    circle = np.stack([10.0 * (1.0 - np.cos(phase)) * 0.3, 10.0 * np.sin(phase), 0.0 * phase], axis=1)
    factor = {"um": 1e3, "mm": 1.0, "m": 1e-3}[unit]
    table = {}
    for arm in arms:
        place = (HOME_MM + circle) * ([1, 1, 1] if arm == "gold" else [1, -1, 1]) * factor
        table |= {f"{arm}_{axis}_{unit}": place[:, i] for i, axis in enumerate("xyz")}
    return pd.DataFrame(table)


def tip_mm(motion, arm="gold"):
    """Tip path of a motion at scale 0.1, relative to its start, mm."""
    return motion.position_um[:, motion.arms.index(arm)] @ np.array(ITP_AXES[arm]).T * 0.1e-3


def refused(path, *args, **keys):
    with pytest.raises(UserError) as error:
        motion_file.read(path, *args, **keys)
    assert str(path) in str(error.value)
    return str(error.value)


@pytest.fixture
def parquet(tmp_path):
    def write(frame):
        path = tmp_path / "motion.parquet"
        frame.to_parquet(path)
        return path

    return write


@pytest.mark.parametrize("unit", ["um", "mm", "m"])
@pytest.mark.parametrize("kind", ["parquet", "csv"])
def test_units_and_kinds_agree(tmp_path, unit, kind):
    path = tmp_path / f"motion.{kind}"
    frame = recording(unit)
    frame.to_parquet(path) if kind == "parquet" else frame.to_csv(path, index=False)
    motion = motion_file.read(path)
    assert motion.name == "motion"
    assert np.abs(tip_mm(motion)[-1] - tip_mm(motion)[0]).max() < 0.2  # once round
    assert np.ptp(tip_mm(motion), axis=0) == pytest.approx([6.0, 20.0, 0.0], abs=0.05)
    assert motion.start_jpos[0][:3] == pytest.approx([np.radians(30), np.radians(90), 0.4], abs=2e-3)


def test_replays_the_recorded_path(parquet):
    """After the run-up of half a second the tip is where it was recorded, a quarter of a second later than the rest."""
    frame = recording()
    motion = motion_file.read(parquet(frame))
    recorded = frame.to_numpy() * 1e-3 - HOME_MM
    late = 500 + 250  # rest, and what the run-up costs
    shown = tip_mm(motion)[1500:3000] + (recorded[0] - 0.0)
    assert np.abs(shown - recorded[1500 - late : 3000 - late]).max() < 0.05


def test_begins_at_rest_with_the_pedal_up(parquet):
    motion = motion_file.read(parquet(recording()))
    assert (motion.surgeon_mode[:200] == 0).all() and (motion.surgeon_mode[200:] == 1).all()
    assert np.abs(motion.position_um[:500]).max() == 0.0
    step = np.linalg.norm(np.diff(tip_mm(motion), axis=0), axis=1)
    assert np.abs(np.diff(step)).max() < 1e-3  # no jump of speed at the start either: mm per ms


def test_slow_down(parquet):
    path = parquet(recording())
    once, slow = motion_file.read(path), motion_file.read(path, slow_down=2.0)
    assert len(slow) - 500 == pytest.approx(2 * (len(once) - 500), abs=600)
    assert np.ptp(tip_mm(slow), axis=0) == pytest.approx(np.ptp(tip_mm(once), axis=0), abs=0.05)
    assert np.abs(np.diff(tip_mm(slow), axis=0)).max() < 0.6 * np.abs(np.diff(tip_mm(once), axis=0)).max()


def test_low_pass_takes_out_steps(parquet):
    frame = recording()
    frame["gold_z_um"] += 300.0 * (np.arange(ROWS) % 40 < 20)
    motion = motion_file.read(parquet(frame))
    assert np.ptp(tip_mm(motion)[800:-200, 2]) < 0.05


def test_both_arms_pedal_and_grasp(parquet):
    frame = recording(arms=("gold", "green"))
    frame["surgeon_mode"] = (np.arange(ROWS) < 2000).astype(int)
    frame["green_grasp_deg"] = 90.0 - 30.0 * np.clip((np.arange(ROWS) - 1000) / 1000.0, 0.0, 1.0)
    motion = motion_file.read(parquet(frame), ("gold", "green"))
    assert motion.surgeon_mode[1000] == 1.0 and motion.surgeon_mode[-1] == 0.0
    assert motion.grasp_mrad[-1, 1] == pytest.approx(np.radians(30.0) * 1e3, abs=1.0)  # closing is positive
    assert np.abs(motion.grasp_mrad[:, 0]).max() < 1e-9
    assert np.abs(tip_mm(motion, "gold") - tip_mm(motion, "green") * [1, -1, 1]).max() < 1e-6


def test_orientation_is_followed(parquet):
    frame = recording()
    home = motion_file._home_quat("gold")
    from scipy.spatial.transform import Rotation

    angle = np.radians(20.0) * np.sin(np.pi * np.arange(ROWS) / ROWS) ** 2
    turned = (Rotation.from_rotvec(angle[:, None] * [[0.0, 0.0, 1.0]]) * Rotation.from_quat(home)).as_quat()
    for i, c in enumerate("xyzw"):
        frame[f"gold_q{c}"] = turned[:, i]
    motion = motion_file.read(parquet(frame))
    turns = 2.0 * np.arccos(np.clip(motion.quat[:, 0, 3], -1.0, 1.0))
    assert np.degrees(turns.max()) == pytest.approx(20.0, abs=0.1)
    axis = motion.quat[np.argmax(turns), 0, :3] @ np.array(ITP_AXES["gold"]).T
    assert axis / np.linalg.norm(axis) == pytest.approx([0.0, 0.0, 1.0], abs=1e-3)


def test_bursts_of_time_stamps_are_spread(parquet):
    frame = recording()
    plain = motion_file.read(parquet(frame))
    frame["time_ns"] = 1_422_318_506_000_000_000 + (np.arange(ROWS) // 40) * 40_000_000 + np.arange(ROWS) % 40
    burst = motion_file.read(parquet(frame))
    assert len(burst) == pytest.approx(len(plain), abs=60)
    assert np.abs(np.diff(tip_mm(burst), axis=0)).max() < 1.1 * np.abs(np.diff(tip_mm(plain), axis=0)).max()


def test_other_rates(parquet):
    frame = recording().iloc[::10].reset_index(drop=True)
    frame["time_s"] = np.arange(len(frame)) * 0.01
    assert len(motion_file.read(parquet(frame))) == pytest.approx(ROWS + 750, abs=30)


def test_a_trace_is_a_recording(tmp_path):
    """What `ravenjax trace` writes can be played again."""
    path = tmp_path / "run.mcap"
    place = recording("m").to_numpy()
    from scipy.spatial.transform import Rotation

    home = Rotation.from_quat(motion_file._home_quat("gold")).as_matrix()
    jpos = np.tile([0.5, 1.5, 0.4, 0.0, 0.0, 0.7, 0.8], (ROWS, 1))
    series = {
        "gold/position": place + 0.001,
        "gold/rotation": np.tile(home.reshape(1, 9), (ROWS, 1)),
        "gold/position_d": place,
        "gold/rotation_d": np.tile(home.reshape(1, 9), (ROWS, 1)),
        "gold/jpos": jpos,
        "gold/jpos_d": jpos,
    }
    trace_log.write(path, series)
    motion = motion_file.read(path)
    frame = recording()
    frame.to_parquet(tmp_path / "same.parquet")
    same = motion_file.read(tmp_path / "same.parquet")
    assert np.abs(tip_mm(motion) - tip_mm(same)).max() < 1e-6
    assert motion_table.read(path, ("gold",)).arms["gold"].opening_mrad[0] == pytest.approx(1500.0)
    assert "no topic /arm2/setpoint_cp or /arm2/measured_cp" in refused(path, ("gold", "green"))

    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    assert "truncated" in refused(path)


# --- what the arm can reach -------------------------------------------------------------------------------------------


@pytest.fixture
def leaving():
    """A recording that leaves the workspace between 1.4 and 1.6 s, along the shaft through the remote centre."""
    frame = recording()
    away = np.clip(1.0 - np.abs(np.arange(ROWS) - 1500) / 150.0, 0.0, 1.0)
    for i, axis in enumerate("xyz"):
        frame[f"gold_{axis}_um"] -= 1e3 * HOME_MM[i] * 1.5 * away
    return frame


def test_unreachable_window_is_refused_with_those_that_are_reachable(parquet, leaving):
    path = parquet(leaving)
    message = refused(path, window_s=(0.0, 3.0))
    assert "cannot reach" in message and "Reachable stretches" in message
    whole = motion_file.read(path)  # the longest one
    assert 1.3 < whole.duration_s < 2.3
    assert motion_file.read(path, window_s=(0.0, 1.0)).duration_s == pytest.approx(1.75, abs=0.01)


def test_window_outside_the_recording(parquet):
    assert "outside the recording, expected in 0 .. 3.000 s" in refused(parquet(recording()), window_s=(1.0, 9.0))


def test_nowhere_reachable(parquet):
    frame = recording()
    frame["gold_x_um"] += 500_000.0
    assert "nothing can be replayed" in refused(parquet(frame))


# --- damage -----------------------------------------------------------------------------------------------------------


def test_missing_empty_and_unknown(tmp_path):
    assert "no such file" in refused(tmp_path / "none.parquet")
    (tmp_path / "empty.csv").write_bytes(b"")
    assert "is empty" in refused(tmp_path / "empty.csv")
    (tmp_path / "header.csv").write_text("gold_x_um,gold_y_um,gold_z_um\n")
    assert "no rows" in refused(tmp_path / "header.csv")
    (tmp_path / "motion.txt").write_text("x")
    assert "unknown kind of file '.txt'" in refused(tmp_path / "motion.txt")


@pytest.mark.parametrize("part", [0.1, 0.5, 0.99])
def test_truncated_parquet(parquet, part):
    path = parquet(recording())
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * part)])
    assert "truncated" in refused(path)


def test_nan_is_named_by_row_and_column(parquet):
    frame = recording()
    frame.loc[[17, 99], "gold_y_um"] = np.nan
    message = refused(parquet(frame))
    assert "row 17, column gold_y_um: got nan" in message and "2 such rows" in message


def test_text_in_a_column(tmp_path):
    path = tmp_path / "m.csv"
    frame = recording(rows=50).astype(object)
    frame.loc[7, "gold_z_um"] = "oops"
    frame.to_csv(path, index=False)
    assert "row 7, column gold_z_um: got 'oops', expected a number" in refused(path)


def test_gap_says_where_how_long_and_what_is_allowed(parquet):
    frame = recording()
    time = np.arange(ROWS) * 1e-3
    time[1200:] += 0.75
    time[2000:] += 0.2
    frame["time_s"] = time
    message = refused(parquet(frame))
    for part in ("gap of 0.751 s after row 1199 (t = 1.199 s)", "at most 0.1 s", "2 such gaps"):
        assert part in message, message


def test_time_that_goes_back(parquet):
    frame = recording()
    frame["time_s"] = np.arange(ROWS) * 1e-3
    frame.loc[40, "time_s"] = 0.0
    assert "row 40: time goes back by 0.039 s" in refused(parquet(frame))


def test_wrong_columns_have_a_suggestion(parquet):
    frame = recording().rename(columns={"gold_y_um": "goldy_um"})
    message = refused(parquet(frame))
    assert "no column gold_y_m or gold_y_mm or gold_y_um" in message and "Did you mean 'goldy_um'" in message
    assert "green_x_m" in refused(parquet(recording()), ("gold", "green"))


def test_two_units_of_one_column(parquet):
    frame = recording()
    frame["gold_x_mm"] = frame["gold_x_um"] / 1e3
    assert "gold_x_mm and gold_x_um say the same" in refused(parquet(frame))


def test_bad_quaternions(parquet):
    frame = recording()
    for c in "xyzw":
        frame[f"gold_q{c}"] = 0.5
    frame.loc[30, "gold_qx"] = 0.9
    assert "row 30: quaternion" in refused(parquet(frame))
    assert "gold_qw missing" in refused(parquet(frame.drop(columns="gold_qw")))


# --- the public recording ---------------------------------------------------------------------------------------------


def test_public_recording(shared_data):
    path = shared_data("operator_positions.parquet")
    motion = motion_file.read(path)
    assert motion.duration_s > 25.0
    speed = np.linalg.norm(np.diff(tip_mm(motion), axis=0), axis=1)  # mm per ms
    assert speed.max() < 0.2
    assert np.abs(np.diff(speed)).max() < 3e-3  # smooth: below 3 m/s2
    both = motion_file.read(path, ("gold", "green"), window_s=None)
    assert both.duration_s > 3.0


def test_dates_are_no_numbers(parquet):
    frame = recording()
    frame = frame.drop(columns="time_s", errors="ignore").assign(
        time_ms=pd.date_range("2026-01-01", periods=len(frame))
    )
    assert "dates or durations" in refused(parquet(frame[[c for c in frame if c != "time_us"]]))


def test_what_nobody_reads_is_not_read_but_named(parquet):
    frame = recording().assign(note=["x" * 1000] * ROWS).rename(columns={"gold_x_um": "gld_x_um"})
    message = refused(parquet(frame))
    assert "note" in message and "Did you mean 'gld_x_um'" in message
