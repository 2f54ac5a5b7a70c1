"""How long packets last: measured where the answer is known, and again in the public recordings."""

import numpy as np
import pandas as pd
import pytest

from ravenjax.robots.raven2.geometry import transmission
from ravenjax.vocabulary import packets
from studies.dsn16 import recording
from validation import packets as measured_packets


def test_lengths_are_recovered_from_the_dac():
    """A PD law that is asked for positions which last as drawn; its torque is truncated to
    counts.
    """
    rng = np.random.default_rng(3)
    lengths = rng.choice([1, 2, 3, 4], 800, p=packets.SHARES[packets.MEASURED])
    row = np.repeat(np.cumsum(lengths) - lengths, lengths)
    asked = np.stack([0.008 * row, 0.01 * row, -0.004 * row], axis=1)
    angle = np.cumsum(np.full(asked.shape, (0.008, 0.01, -0.004)), axis=0)
    speed = np.full(asked.shape, (8.0, 10.0, -4.0))
    torque = recording.KP * (asked - angle) - recording.KD * speed
    dac = -np.trunc(torque * np.array(transmission.COUNTS_PER_NM[:3]))
    measured = measured_packets.of_robot(recording.JointRecording(angle, speed, dac))
    assert len(measured) > 770 and "".join(map(str, measured)) in "".join(map(str, lengths))


def test_the_measured_distribution_is_that_of_the_recorded_robot(shared_data):
    lengths = measured_packets.of_robot(recording.read(shared_data(recording.FILE)))
    shares = packets.length_shares(lengths)
    stated = packets.SHARES[packets.MEASURED]
    assert len(lengths) == 7478
    np.testing.assert_allclose(shares[: len(stated)], stated, atol=5e-4)
    assert shares[len(stated) :].sum() < 1e-3
    assert lengths.mean() == pytest.approx(packets.mean_cycles(stated), abs=0.003)


@pytest.mark.parametrize("phase", [0.0, 0.5])
def test_bursts_are_those_of_the_recorded_console(shared_data, phase):
    ms = (
        pd.read_parquet(shared_data("console_itp_packets.parquet"))["arrival_us"].to_numpy() * 1e-6
    )  # they are ns
    shares = packets.length_shares(packets.packet_lengths(ms[ms > 200.0] - phase))
    stated = packets.SHARES[packets.BURSTS]
    np.testing.assert_allclose(shares[: len(stated)], stated, atol=5e-3)
    assert shares[len(stated) :].sum() < 5e-4
