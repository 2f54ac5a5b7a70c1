"""The dynamic model against the recording: with it and without it."""

import jax
import numpy as np
import pytest

from studies.dsn16 import model, recording
from studies.study import Context


def test_without_the_recording_nothing_is_predicted_and_it_is_said_what_is_missing(
    monkeypatch, tmp_path
):
    monkeypatch.setenv(recording.DATA, str(tmp_path))
    found = model.STUDY.compare(Context({}))
    assert [line.target for line in found.lines] == ["A3"] * 3
    assert all(line.predicted is None and line.passed is None for line in found.lines)
    assert all(
        recording.FILE in line.reason and recording.DATA in line.reason for line in found.lines
    )


def test_a_steady_motion_is_what_a_held_velocity_predicts():
    """And a held position is off by the way that the motion makes."""
    ms = np.arange(600)[:, None]
    speed = np.array((20.0, -10.0, 5.0))
    log = recording.JointRecording(ms * 1e-3 * speed, np.tile(speed, (600, 1)), np.zeros((600, 3)))
    found = model.predictions(log, model.held(log))
    errors = {(name, horizon): error for (_, name, horizon), error in found.items()}
    for horizon in (*model.HORIZONS_MS, None):
        np.testing.assert_allclose(errors[model.HELD_VELOCITY, horizon].largest, 0.0, atol=1e-12)
        way = np.abs(speed * recording.TO_JOINT) * (horizon or ms[-1]) * 1e-3
        np.testing.assert_allclose(errors[model.HELD_POSITION, horizon].largest, way)


@pytest.mark.slow
def test_a_stretch_of_the_recording_is_followed(shared_data):
    whole = recording.read(shared_data(recording.FILE))
    log = recording.JointRecording(*(part[:2000] for part in recording.second_half(whole)))
    with jax.enable_x64(True):
        error = model.error(log.asked, log)
    assert (error.mean < (0.2, 0.2, 0.3)).all() and (error.mean <= error.largest).all()
