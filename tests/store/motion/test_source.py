"""Recordings of other laboratories: layouts of tables, topics of bags, and frames."""

import bags
import numpy as np
import pandas as pd
import pytest
from recorded_hands import HOME_MM, circle, play, refused, tip_mm
from rosbags.convert.converter import convert
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from ravenjax.store.motion import recording

TIME_S = np.arange(120) / 30.0
PLACE_MM = HOME_MM + circle(TIME_S)
NAMES = ["time_s", "gold_x_mm", "gold_y_mm", "gold_z_mm"]
FRAME = pd.DataFrame(np.column_stack([TIME_S, PLACE_MM]), columns=NAMES)
LAB = Rotation.from_euler("xyz", [20.0, 30.0, 40.0], degrees=True)


def csv(path, frame=FRAME, **keys):
    frame.to_csv(path, index=False, **keys)
    return path


def assert_circle(one, atol=0.02):
    moved = tip_mm(one.motion)
    np.testing.assert_allclose(moved[999:3999:500], circle(np.arange(0.25, 3.25, 0.5)), atol=atol)


@pytest.mark.parametrize(
    ("name", "keys", "options"),
    [
        ("a.csv", {"sep": ";", "decimal": ","}, {}),
        ("a.tsv", {"sep": "\t"}, {}),
        ("a.csv", {"sep": "|"}, {}),
        ("a.csv", {"decimal": ","}, {}),
        ("a.txt", {"sep": " ", "decimal": ","}, {}),
        ("a.txt", {"sep": " ", "header": False}, {"columns": NAMES}),
        (
            "a.csv",
            {"header": ["t", "X (mm)", "Y", "Z"]},
            {"columns": dict(zip(NAMES, ["t", "X (mm)", "Y", "Z"], strict=True))},
        ),
    ],
)
def test_texts_are_read_in_every_layout(tmp_path, name, keys, options):
    assert_circle(play(csv(tmp_path / name, **keys), **options))


@pytest.mark.parametrize("mark", ["# ", "% "])
def test_a_header_line_may_be_a_comment(tmp_path, mark):
    path = tmp_path / "a.txt"
    np.savetxt(path, FRAME, header=f"of a lab\n{' '.join(NAMES)}", comments=mark)
    assert_circle(play(path))


def test_a_table_without_header_and_a_missing_column_say_what_to_write(tmp_path):
    path = csv(tmp_path / "a.csv", header=False)
    refused(path, "the first line contains numbers", "time_s,gold_x_um", "operator.columns = [")
    refused(path, "has 4 columns; expected only numbers, in 2", columns=["time_s", "gold_x_mm"])
    twice = ["time_s", *["gold_x_mm"] * 3]
    refused(path, "column gold_x_mm is there twice", columns=twice)
    path.write_text("time_s,gold_x_mm\n0,1,2,\n1,2,3,\n")
    refused(path, "rows have more cells than the header line")
    path = csv(tmp_path / "b.csv")
    refused(path, "no column 'gold_x'", "Did you mean", columns={"gold_x_mm": "gold_x"})
    path.write_text("version https://git-lfs.github.com/spec/v1\noid sha256:00\n")
    refused(path, "only a Git LFS pointer", "git lfs pull")


def test_sensors_in_one_column(tmp_path):
    frame = FRAME.rename(columns={name: name.removeprefix("gold_") for name in NAMES})
    other = frame.assign(time_s=TIME_S + 0.01, y_mm=-frame["y_mm"], tool=2)
    path = csv(tmp_path / "a.csv", pd.concat([frame.assign(tool=1), other]).sort_values("time_s"))
    sensors = {"column": "tool", "gold": "1", "green": "2"}
    one = play(path, ("gold", "green"), sensors=sensors)
    np.testing.assert_allclose(
        tip_mm(one.motion, "green")[1500], tip_mm(one.motion)[1510] * [1, -1, 1], atol=0.3
    )
    refused(
        path,
        "has '3' in 0 rows; expected at least 2 rows. Its values are 1, 2",
        sensors={"column": "tool", "gold": "3"},
    )


def test_kinematics_of_jigsaws_begin_at_home(tmp_path):
    """76 numbers a row, 30 rows a second; the slave on the left stands in columns 39 to 57."""
    rows = np.zeros((120, 76))
    rows[:, 38:41] = LAB.apply(circle(TIME_S)) * 1e-3 + [0.05, 0.02, -0.03]
    turns = Rotation.from_rotvec(np.outer(np.sin(TIME_S), [0.0, 0.0, 0.2]))
    rows[:, 41:50] = turns.as_matrix().reshape(-1, 9)
    path = tmp_path / "Suturing_B001.txt"
    np.savetxt(path, rows, fmt="%.9f")
    options = {"columns": "jigsaws", "rate_hz": 30.0, "place": "home"}
    one = play(path, rotation=tuple(LAB.inv().as_quat()), **options)
    assert_circle(one)
    assert one.summary.arms[0].orientation == "recorded"
    assert one.summary.arms[0].distance_mm[0] == pytest.approx(np.linalg.norm(HOME_MM), abs=9.0)


@pytest.mark.parametrize("by_matrix", [True, False])
def test_a_rigid_transform_moves_tips_into_frame_0(tmp_path, by_matrix):
    there = LAB.inv().apply(PLACE_MM - [100.0, 200.0, 300.0])
    path = csv(tmp_path / "a.csv", FRAME.assign(**dict(zip(NAMES[1:], there.T, strict=True))))
    refused(path, 'operator.place = "home"')
    rows = LAB.as_matrix().tolist() if by_matrix else LAB.as_quat().tolist()
    assert_circle(play(path, rotation={"gold": rows}, offset_mm=(100.0, 200.0, 300.0)))


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"topics": {"gold": "/lab"}}, "operator.topics applies to a bag: remove operator.topics"),
        ({"console": "raven"}, "is a table, but operator.console applies to a stream"),
        (
            {"offset_mm": {"green": (0, 0, 0)}},
            "operator.offset_mm has a value for green, but none for gold",
        ),
    ],
)
def test_an_option_that_nothing_would_read_is_refused(tmp_path, options, says):
    refused(csv(tmp_path / "a.csv"), says, **options)


@pytest.mark.parametrize(
    ("namespace", "options"), [("/arm1", {}), ("/lab/PSM2", {"topics": {"gold": "/lab/PSM2"}})]
)
@pytest.mark.parametrize("jaws", ["raven2", "alone", "none"])
def test_bags_of_crtk_in_the_base_frame(tmp_path, namespace, options, jaws):
    x, y, z = PLACE_MM.T * 1e-3
    base = np.stack([-y, -z, x], axis=1)
    path = bags.pose_bag(tmp_path / "a.bag", namespace, TIME_S, base, "arm1_base", jaws)
    one = play(path, **options)
    assert_circle(one)
    assert "is in frame arm1_base; it is turned into frame 0" in one.summary.notes[0]
    assert one.summary.arms[0].jaws == ("home" if jaws == "none" else "recorded")
    if options:
        refused(path, 'write operator.topics.gold = "/lab/PSM2"')


def test_jaws_of_another_time_are_not_read(tmp_path):
    place = PLACE_MM * 1e-3
    late = bags.pose_bag(tmp_path / "a.bag", "/arm1", TIME_S, place, "", "alone", jaws_late_s=0.5)
    one = play(late)
    assert one.summary.arms[0].jaws == "home" and "0 to 0.5 s" in one.summary.notes[0]
    assert play(late, max_gap_s=0.6).summary.arms[0].jaws == "recorded"


def test_an_unknown_frame_and_a_stamp_of_zero(tmp_path):
    path = bags.pose_bag(tmp_path / "a.bag", "/arm1", TIME_S, PLACE_MM * 1e-3, "PSM1_base")
    refused(path, "is in the unknown frame 'PSM1_base'", "operator.frame =")
    one = play(path, frame="frame0")
    assert_circle(one)
    path = bags.pose_bag(tmp_path / "b.bag", "/arm1", TIME_S, PLACE_MM * 1e-3, first_ns=0)
    assert (
        "message 0 of /arm1/setpoint_cp has time 0, and the next message 1.7e+09 s"
        in (play(path).summary.notes[0])
    )


@pytest.mark.parametrize(
    ("rows", "change", "advice"),
    [
        (
            [60],
            -2.0,
            "row 60: time goes back by 1.96667 s (column time_s; 1 such row); expected no",
        ),
        ([60], -2.0, "Remove the rows with wrong times"),
        ([60, 61], -1.5, "Remove the rows with wrong times"),
        ([60], 50.0, "row 61: time goes back"),
        (range(60, 120), -0.5, "Cut the file there"),
        (range(0, 120, 2), 0.05, "Sort the rows by time"),
    ],
)
def test_times_that_go_back_say_what_to_do(tmp_path, rows, change, advice):
    time_s = TIME_S.copy()
    time_s[list(rows)] += change
    refused(csv(tmp_path / "a.csv", FRAME.assign(time_s=time_s)), advice)


def test_what_a_name_says_twice_or_in_another_unit(tmp_path):
    path = csv(tmp_path / "a.csv", pd.concat([FRAME, FRAME[["gold_x_mm"]]], axis=1))
    refused(path, "column gold_x_mm is there twice; keep one")
    one = play(csv(tmp_path / "b.csv", FRAME.assign(gold_grasp_deg=0.5)))
    assert "if these are radians, name the column gold_grasp_rad" in one.summary.notes[0]
    arm = one.summary.arms[0]
    assert arm.start_mm == pytest.approx(HOME_MM, abs=1e-3) and arm.from_home_mm < 1e-3


def test_a_last_row_that_is_cut_off_is_noted(tmp_path):
    path = csv(tmp_path / "a.csv", FRAME)
    assert not play(path).summary.notes
    path.write_text(path.read_text().rstrip()[:-2])
    assert "the last row is probably cut off" in play(path).summary.notes[0]


def test_a_folder_of_ros_2_is_a_bag(tmp_path):
    path = bags.pose_bag(tmp_path / "a.bag", "/arm1", TIME_S, PLACE_MM * 1e-3, "")
    folder, everything = tmp_path / "ros2", ([], [], [], [])
    store = get_typestore(Stores.LATEST)
    convert([path], folder, "sqlite3", 8, None, "file", None, store, *everything)
    assert recording.arms_in(folder) == ("gold",)
    one = play(folder)
    assert_circle(one)
    (folder / ".lock").mkdir()
    assert play(folder).summary.sha256 == one.summary.sha256
    refused(tmp_path, "a folder without metadata.yaml")


def test_a_clock_that_was_set_is_refused_at_once(tmp_path):
    frame = FRAME.assign(time_s=TIME_S + 3600.0 * (TIME_S > 2.0))
    refused(csv(tmp_path / "a.csv", frame), "gap of 3600.033 s after row 60", "Cut the file")


def test_two_consoles_on_one_stream_are_refused(tmp_path):
    from test_packet_file import table

    numbers = np.arange(50) // 2 + np.where(np.arange(50) % 2, 500_000, 1)
    path = table(tmp_path / "a.parquet", fields={"sequence": numbers})
    refused(path, "would drop 49 of 50 packets", "because two streams are mixed", console="raven")
    numbers = np.r_[26:51, 1:26]
    path = table(tmp_path / "c.parquet", fields={"sequence": numbers})
    refused(path, "Packet numbers decrease after packet 24. Cut the file", console="raven")
    path = table(tmp_path / "b.parquet", fields={"sequence": np.arange(50) // 2 + 1})
    refused(path, "would drop 25 of 50 packets", "each packet was recorded twice", console="raven")
