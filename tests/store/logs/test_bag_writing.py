"""Recordings as bags: the library and, where it is installed, Debian's rosbag read in them what
was recorded.
"""

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from ravenjax.cli import USER_ERROR, main
from ravenjax.errors import UserError
from ravenjax.store.logs import bags, trace_log
from ravenjax.store.logs.session import log as session_log
from ravenjax.train.protocol import FrameLayout

DEBIANS_PYTHON = Path("/usr/bin/python3")
START = 1_767_323_045_678_000_000  # ns, of the session
T = 50
QUARTER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    """The folder of a recorded session whose tip moves by 1 mm along x every 10 ms."""
    folder = tmp_path_factory.mktemp("session")
    layout = FrameLayout.of(("gold",))
    names = layout.names()
    rows = np.zeros((T, layout.size), np.float32)
    for axis, place in enumerate((-0.078, -0.025, 0.013)):
        rows[:, names.index(f"gold/position/{axis}")] = place
    rows[:, names.index("gold/position/0")] += (np.arange(T) * 1e-4).astype(np.float32)
    rows[:, names.index("gold/jpos/2")] = 0.4
    writer = session_log.SessionWriter(
        folder / session_log.FILE,
        names,
        {"arms": ["gold"], "started": "2026-01-02T03:04:05.678+00:00"},
    )
    writer.add(0, rows, [{"tick": 3, "kind": "note", "text": "naïve"}])
    writer.close()
    return folder


@pytest.fixture(scope="module")
def trace(tmp_path_factory):
    path = tmp_path_factory.mktemp("trace") / "run.mcap"
    series = {
        "gold/jpos": np.linspace(0, 1, T * 7).reshape(T, 7),
        "gold/position": np.linspace(0, 0.1, T * 3).reshape(T, 3),
        "gold/rotation": np.tile(QUARTER, (T, 1, 1)),
        "runlevel": np.full(T, 3, np.int32),
    }
    trace_log.write_trace(
        path, series, events=[{"tick": 7, "kind": "fault", "text": "opens", "level": "info"}]
    )
    return path


def messages(path):
    """(topic, arrival in ns, message) of a bag, read by the library."""
    with AnyReader([path]) as reader:
        return [
            (one.topic, ns, reader.deserialize(data, one.msgtype))
            for one, ns, data in reader.messages()
        ]


def same(first, second):
    """Whether two messages say the same; numbers of headers are ROS 1's alone."""
    if hasattr(first, "__dataclass_fields__"):
        return all(
            same(getattr(first, n), getattr(second, n))
            for n in first.__dataclass_fields__
            if n != "seq"
        )
    if isinstance(first, list):
        return len(first) == len(second) and all(map(same, first, second))
    return np.array_equal(first, second)


@pytest.mark.parametrize("ros", [1, 2])
def test_a_session_is_the_same_in_a_bag(session, tmp_path, ros):
    told = bags.write_bag(session, ros, tmp_path / ("a.bag" if ros == 1 else "a"))
    recorded = messages(session / session_log.FILE)
    kept = [one for one in recorded if ros == 2 or one[0] != "/ravenjax/log"]
    found = messages(told.path)
    assert told.messages == len(found) == len(kept)
    assert [one[:2] for one in sorted(found, key=lambda one: one[:2])] == sorted(
        one[:2] for one in kept
    )
    assert all(
        same(*pair) for topic in {one[0] for one in kept} for pair in of_topic(topic, kept, found)
    )
    assert min(one[1] for one in found) == START


def of_topic(topic, *tables):
    """Pairs of messages."""
    return zip(
        *([message for name, _, message in table if name == topic] for table in tables), strict=True
    )


def test_a_trace_begins_a_second_later_in_ros1_where_zero_is_no_time(trace, tmp_path):
    found = messages(bags.write_bag(trace, 1, tmp_path / "a.bag").path)
    joints = [(ns, message) for topic, ns, message in found if topic == "/arm1/measured_js"]
    assert [ns for ns, _ in joints] == [10**9 + n * 10**6 for n in range(T)]
    assert all(one.header.stamp.sec * 10**9 + one.header.stamp.nanosec == ns for ns, one in joints)
    frames = next(message for topic, _, message in found if topic == "/tf")
    assert frames.transforms[0].header.stamp.sec == 1
    assert min(ns for _, ns, _ in messages(bags.write_bag(trace, 2, tmp_path / "a").path)) == 0


LOOK = """
import json, sys, rosbag
from importlib import import_module
bag = rosbag.Bag(sys.argv[1])
topics, counts, sums, sent = bag.get_type_and_topic_info().topics, {}, {}, {}
for topic, message, stamp in bag.read_messages():
    counts[topic] = counts.get(topic, 0) + 1
    sent.setdefault(topic, stamp.to_nsec())
    if topic.endswith("measured_cp"):
        sums[topic] = message.pose.position.x
known = {}
for name in topics:
    connection = next(bag._get_connections([name]))
    package, kind = connection.datatype.split("/")
    try:
        known[name] = getattr(import_module(package + ".msg"), kind)._md5sum == connection.md5sum
    except ImportError:
        pass  # a package that is not installed here
print(json.dumps({"counts": counts, "last": sums, "known": known, "begin": bag.get_start_time()}))
"""


def by_debian(program, *arguments):
    """What a program prints in Debian's Python, where that has rosbag."""
    script = [DEBIANS_PYTHON, "-c", program, *map(str, arguments)]
    if (
        not DEBIANS_PYTHON.exists()
        or subprocess.run([DEBIANS_PYTHON, "-c", "import rosbag"], env={}).returncode
    ):
        pytest.skip("Debian's python3-rosbag is not installed")
    return subprocess.run(
        script, env={"HOME": "/tmp"}, check=True, stdout=subprocess.PIPE, text=True
    ).stdout


@pytest.mark.parametrize("which", ["session", "trace"])
def test_debians_rosbag_reads_it(which, request, tmp_path):
    source = request.getfixturevalue(which)
    written = bags.write_bag(source, 1, tmp_path / "a.bag")
    told = json.loads(by_debian(LOOK, written.path))
    assert sum(told["counts"].values()) == written.messages
    assert told["known"] and all(told["known"].values()), (
        "types are those that Debian's own packages have"
    )
    assert told["begin"] == pytest.approx(START * 1e-9 if which == "session" else 1.0, abs=1e-6)
    last = messages(written.path)
    expected = [
        message.pose.position.x for topic, _, message in last if topic == "/arm1/measured_cp"
    ][-1]
    assert told["last"]["/arm1/measured_cp"] == expected


def test_what_cannot_be_written_is_one_sentence(session, trace, tmp_path, capsys):
    there = tmp_path / "there.bag"
    there.write_bytes(b"")
    for words, source, ros, out in (
        ("expected an existing MCAP file", tmp_path / "none.mcap", 1, None),
        ("expected an existing MCAP file", there, 1, None),
        ("exists already", trace, 1, there),
        (r"ends in \.bag", trace, 1, tmp_path / "a"),
        ("is a folder", trace, 2, tmp_path / "a.bag"),
    ):
        with pytest.raises(UserError, match=words):
            bags.write_bag(source, ros, out)
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(trace.read_bytes()[:3000])
    assert main(["log", "bag", str(cut)]) == USER_ERROR
    assert "ravenjax log recover" in capsys.readouterr().err.replace("\n", " ")
    assert not cut.with_suffix(".bag").exists()
