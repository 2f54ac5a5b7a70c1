"""Recordings in MCAP: whose times count, and that they are no less checked than tables."""

import numpy as np
import pytest
from recorded_hands import HOME_MM, circle, play, refused, tip_mm

from ravenjax.store.logs import topics

TIME_S = np.cumsum([0.0, *np.where(np.arange(600) % 2, 0.008, 0.002)])
"""Three seconds of uneven samples."""


def write(path, poses):
    """poses: {topic of an arm: (log times ns, header times ns, positions [T, 3] m)}; rotations
    are those of no file.
    """
    with open(path, "wb") as file:
        writer = topics.LogWriter(file, [topics.tip_topic(arm, name) for arm, name in poses], {})
        for (arm, name), (log, header, place) in poses.items():
            topic = topics.tip_topic(arm, name)
            values = np.concatenate([place, np.zeros((len(place), 4))], axis=1)
            every_tick = topic._replace(schema="")
            for tick, data in every_tick.encode(header, values).items():
                writer._add(topic.name, int(log[tick]), data, tick)
        writer.finish()
    return path


def nanoseconds(time_s, start=1_700_000_000_000_000_000):
    return start + np.rint(np.asarray(time_s) * 1e9).astype(np.int64)


def place(time_s, arm="gold"):
    return (HOME_MM + circle(time_s)) * ([1, 1, 1] if arm == "gold" else [1, -1, 1]) * 1e-3


def test_header_stamps_count_where_there_are_any(tmp_path):
    """A recorder writes forty messages at once; when they were sampled stands in their headers."""
    arrival = nanoseconds((np.arange(601) // 40) * 0.2 + (np.arange(601) % 40) * 1e-5)
    by_header = play(
        write(
            tmp_path / "a.mcap",
            {("gold", "measured_cp"): (arrival, nanoseconds(TIME_S), place(TIME_S))},
        )
    )
    assert by_header.summary.clock == "header stamps of /arm1/measured_cp"
    assert by_header.summary.rate_hz == pytest.approx(200.0)
    np.testing.assert_allclose(
        tip_mm(by_header.motion)[999:3750], circle(np.arange(250, 3001) * 1e-3), atol=2e-3
    )
    empty = np.zeros(601, np.int64)
    path = write(tmp_path / "b.mcap", {("gold", "measured_cp"): (arrival, empty, place(TIME_S))})
    refused(
        path,
        "the time stamps come in bursts: according to log times of /arm1/measured_cp",
        "operator.rate_hz = ",
    )
    assert play(path, rate_hz=200.0).summary.notes == (
        "log times of /arm1/measured_cp is not used, because operator.rate_hz = 200 spaces rows"
        " evenly; it spans 3.000 s",
    )
    path = write(
        tmp_path / "c.mcap", {("gold", "measured_cp"): (nanoseconds(TIME_S), empty, place(TIME_S))}
    )
    by_log = play(path)
    assert by_log.summary.clock == "log times of /arm1/measured_cp"
    np.testing.assert_allclose(by_log.motion.position_um, by_header.motion.position_um, atol=1e-6)
