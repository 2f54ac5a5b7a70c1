"""The dynamic model against the recording: with it and without it."""

from __future__ import annotations

import jax
import numpy as np
import pytest

from ravenjax.robots.raven2.geometry import transmission
from ravenjax.studies.dsn16 import closed_loop, model
from ravenjax.studies.framework.study import Context


def test_without_the_recording_nothing_is_predicted_and_it_is_said_what_is_missing(monkeypatch, tmp_path):
    monkeypatch.setenv(closed_loop.DATA, str(tmp_path))
    found = model.STUDY.compare(Context({}))
    assert [line.target for line in found.lines] == ["A3"] * 3
    assert all(line.predicted is None and line.passed is None for line in found.lines)
    assert all(closed_loop.FILE in line.reason and closed_loop.DATA in line.reason for line in found.lines)


def test_bands_are_those_of_the_target():
    published = model.literature.read("dsn16_model")
    assert [published.band(f"error.{joint}")[1] for joint in model.UNITS] == [1.0, 1.8, 1.4]


def test_the_asked_motor_angles_give_back_the_torque():
    rng = np.random.default_rng(1)
    found = closed_loop.JointRecording(*(rng.normal(size=(9, 3)) for _ in range(3)))
    torque = closed_loop.KP * (found.asked - found.angle) - closed_loop.KD * found.speed
    np.testing.assert_allclose(torque, -found.dac / np.array(transmission.COUNTS_PER_NM[:3]))


@pytest.mark.slow
def test_two_seconds_of_the_recording_are_followed(shared_data):
    path = shared_data(closed_loop.FILE)
    whole = closed_loop.read(path)
    found = closed_loop.JointRecording(*(part[:2000] for part in whole))
    with jax.enable_x64(True):
        error = model.error(found.asked, found)
    assert (error.mean < (0.2, 0.2, 0.3)).all() and (error.low <= error.mean).all() and (error.mean <= error.high).all()
