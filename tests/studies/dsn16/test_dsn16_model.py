"""The dynamic model against the recording: with it and without it."""

from __future__ import annotations

import jax
import numpy as np
import pytest

from ravenjax.robots.raven2.geometry import transmission
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


def test_the_asked_motor_angles_give_back_the_torque():
    rng = np.random.default_rng(1)
    found = recording.JointRecording(*(rng.normal(size=(9, 3)) for _ in range(3)))
    torque = recording.KP * (found.asked - found.angle) - recording.KD * found.speed
    np.testing.assert_allclose(torque, -found.dac / np.array(transmission.COUNTS_PER_NM[:3]))


def ahead(scale: float) -> list[recording.HorizonError]:
    """Errors as `horizons.compare` gives them; the bare rotors' are `scale` times the virtual
    robot's.
    """
    mean = np.array((0.1, 0.2, 0.3))
    models = [
        (recording.CLOSED, "virtual robot, traj3", mean),
        (recording.CLOSED, f"{recording.ROTORS}, traj3", scale * mean),
        (recording.NO_LOOP, recording.HELD_POSITION, 2.0 * mean),
        (recording.NO_LOOP, recording.HELD_VELOCITY, np.array((0.05, 0.3, 0.2))),
    ]
    return [
        recording.HorizonError(loop, name, horizon, mine, 3 * mine)
        for loop, name, mine in models
        for horizon in (*recording.HORIZONS_MS, None)
    ]


PART = recording.RecordedStretch(np.zeros((1000, 3)), np.zeros((1000, 3)), 1.0, recording.UNITS)


@pytest.mark.parametrize(
    ("scale", "words", "best"),
    [(1.0, "would meet A3, too", 0), (9.0, "would not meet A3.", 4)],
)
def test_the_null_models_are_told_as_the_table_has_them(scale, words, best):
    rows = ahead(scale)
    largest, rotor = model._notes(model.Published("dsn16_model"), model.Error(*rows[0][3:]), rows)
    assert "0.300 deg (shoulder), 0.600 deg (elbow), 0.900 mm (insertion)" in largest
    assert words in rotor and f"{0.1 * scale:.3f} deg (shoulder)" in rotor
    (said,) = recording.prediction_sentences(PART, rows)
    assert said.startswith(
        "Virtual robot, traj3, closed loop: its mean error is smaller than that of a held velocity"
    )
    for when in ("after 20 ms", "after 50 ms", "after 128 ms", "over the whole"):
        assert f"{when} at 1 of 3 joints (elbow)" in said
    assert f"every null model in {best} of 12 comparisons" in said
    table = recording.prediction_table("x", PART, rows)
    assert len(table.rows) == 4 * (len(recording.HORIZONS_MS) + 1) and all(
        len(row) == 6 for row in table.rows
    )
    assert table.rows[0][3:] == ("0.100, 0.30", "0.200, 0.60", "0.300, 0.90")


def test_a_steady_motion_is_what_a_held_velocity_predicts():
    """And a held position is off by the way that the motion makes, at rows of any distance."""
    for period_ms in (1.0, 4.94):
        seconds = np.arange(600)[:, None] * period_ms * 1e-3
        speed = np.array((2.0, -1.0, 0.5))
        part = recording.RecordedStretch(
            seconds * speed, np.tile(speed, (600, 1)), period_ms, recording.UNITS
        )
        errors = {(one.model, one.horizon_ms): one for one in recording.horizon_errors(part, [])}
        for horizon in (*recording.HORIZONS_MS, None):
            np.testing.assert_allclose(
                errors[recording.HELD_VELOCITY, horizon].largest, 0.0, atol=1e-12
            )
            way = np.abs(speed) * (
                seconds[-1] if horizon is None else part.rows(horizon) * period_ms * 1e-3
            )
            np.testing.assert_allclose(errors[recording.HELD_POSITION, horizon].largest, way)
            assert horizon is None or abs(part.rows(horizon) * period_ms - horizon) <= period_ms / 2


@pytest.mark.slow
def test_a_cut_cable_frees_the_rotor(shared_data):
    """In open loop the rotor alone goes where its own torque and friction lead it, and the link
    does not matter.
    """
    log = recording.read(shared_data(recording.FILE))
    with jax.enable_x64(True):
        angle, speed, dac = log.angle[500], log.speed[500], log.dac[500:520]
        whole, cut = (
            jax.jit(recording.loop("dac", one.params, one.cables))(angle, speed, dac)[0][-1, :3]
            for one in recording.virtual_robots(recording.SETUP, recording.ARM)[::2]
        )
    apart = np.abs(np.asarray(whole) - np.asarray(cut))
    assert (apart > 0).all() and (apart * recording.TO_JOINT < 0.2).all()


@pytest.mark.slow
def test_a_stretch_of_the_recording_is_followed(shared_data):
    whole = recording.read(shared_data(recording.FILE))
    log = recording.JointRecording(*(part[:2000] for part in recording.second_half(whole)))
    with jax.enable_x64(True):
        error = model.error(log.asked, log)
    assert (error.mean < (0.2, 0.2, 0.3)).all() and (error.mean <= error.largest).all()
