"""The fork's dynamics-simulator build, and how a DAC command behind the checks is stored."""

import numpy as np
import pytest

import ravenjax as rj
from ravenjax.campaign.inspection.replay import Replayer

pytestmark = pytest.mark.slow

HOOK = {"site": "usb_out", "channel": "shoulder", "effect": "latch_offset", "trigger": "packet"}
CAMPAIGN = {"name": "hook", "duration_s": 1.6, "software": "fork2015", "console": "absolute"}


def campaign(fault, **changes):
    raw = {"campaign": {**CAMPAIGN, **changes}, "group": [{"name": "f", "fault": [HOOK | fault]}]}
    return rj.load_campaign(raw)


@pytest.fixture(scope="module")
def stopping():
    """The series of a run in which the overdrive check stops the robot in the middle of a long
    window, by build.
    """
    fault = {"value": 8000, "start_ms": 700, "duration_ms": 300}
    return {
        build: Replayer(campaign(fault, build=build), "simd").replay(0).series
        for build in ("robot", "dyn_sim")
    }


def test_packets_end_with_the_software_stop_in_the_simulator_build_alone(stopping):
    for build, series in stopping.items():
        stop = int(np.argmax(series["soft_estopped"] != 0))
        assert stop > 700
        grows = np.diff(series["last_seq"][stop + 1 :])
        assert (grows == (1 if build == "robot" else 0)).all()


def test_the_simulator_build_reads_its_model_without_encoders(stopping):
    """Motors 1-3 as they were after the last cycle, to the bit; tool joints where they should
    be.
    """
    series = stopping["dyn_sim"]
    np.testing.assert_array_equal(
        series["gold/mpos"][1:, :3], series["gold/motor_mpos"][:-1, :3].astype(np.float32)
    )
    np.testing.assert_array_equal(
        series["gold/mvel"][1:, :3], series["gold/motor_mvel"][:-1, :3].astype(np.float32)
    )
    np.testing.assert_array_equal(series["gold/mpos"][1:, 3:], series["gold/mpos_d"][:-1, 3:])
    assert (series["gold/mvel"][1:, 3:] == 0).all()


@pytest.mark.parametrize(
    "words, stored", [("wrap", 14464), ("saturate", 32767), ("unwrapped", 80000)]
)
def test_a_large_command_is_stored_as_asked(words, stored):
    fault = {"effect": "overwrite", "value": 80000, "start_ms": 700, "duration_ms": 1}
    series = Replayer(campaign(fault, dac_words=words), "simd").replay(0).series
    assert (series["gold/dac_cnt"][:, 0] == stored).sum() == 1


def test_a_delayed_command_moves_the_motor_so_much_later():
    """4000 counts make 3 rad/s of motor speed in a tick; the hands make a tenth of that."""
    fault = {
        "site": "usb_out",
        "channel": "shoulder",
        "effect": "offset",
        "value": 4000,
        "start_ms": 900,
    }
    raw = {
        "campaign": {"name": "late", "duration_s": 1.0},
        "group": [
            {"name": "f", "parameters": {"usb": {"command_delay": [0, 1, 5]}}, "fault": [fault]}
        ],
    }
    config = rj.load_campaign(raw)
    speeds = [Replayer(config, "simd").replay(k).series["gold/motor_mvel"][:, 0] for k in range(3)]
    struck = [int(np.flatnonzero(np.abs(np.diff(speed)) > 2.0)[0]) + 1 for speed in speeds]
    assert struck == [900, 901, 905]
