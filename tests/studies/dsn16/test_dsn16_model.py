"""The dynamic model against the recording: with it and without it."""

from __future__ import annotations

import jax
import numpy as np
import pytest

from ravenjax.robots.raven2.geometry import transmission
from ravenjax.studies.dsn16 import model
from ravenjax.studies.dsn16.recording import closed_loop, horizons
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


def ahead(scale: float) -> list[horizons.HorizonError]:
    """Errors as `horizons.compare` gives them; the bare rotor's are `scale` times the virtual robot's."""
    result = []
    for number, loop in enumerate((*horizons.LOOPS.values(), horizons.NO_LOOP)):
        models = tuple(horizons.CABLES) if number < 2 else (horizons.HELD_POSITION, horizons.HELD_VELOCITY)
        for name in models:
            for horizon in (*horizons.HORIZONS_MS, None):
                mean = np.array((0.1, 0.2, 0.3)) * (scale if name == horizons.ROTOR else 1.0)
                mean = np.array((0.05, 0.3, 0.2)) if number == 2 else mean
                result.append(horizons.HorizonError(loop, name, horizon, horizons.Error(mean, mean, mean, 3 * mean)))
    return result


@pytest.mark.parametrize(("scale", "words"), [(1.0, "It would meet A3, too"), (9.0, "It would not meet A3.")])
def test_the_null_models_are_told_as_the_table_has_them(scale, words):
    largest, rotor, driven = model._null_notes(model.literature.read("dsn16_model"), ahead(scale))
    assert "0.300 deg (shoulder), 0.600 deg (elbow), 0.900 mm (insertion)" in largest
    assert words in rotor and f"{0.1 * scale:.3f} deg (shoulder)" in rotor
    assert driven.endswith("It predicts better than the held velocity at the elbow.")
    table = model._horizon_table(ahead(scale))
    assert len(table.rows) == 6 * (len(horizons.HORIZONS_MS) + 1) and all(len(row) == 6 for row in table.rows)


def test_an_error_is_of_every_stretch_alike():
    apart = np.repeat(np.arange(10.0), 5)[:, None] * np.array((1.0, 2.0, 0.0))
    error = horizons.error_of(apart)
    np.testing.assert_allclose(error.mean, (4.5, 9.0, 0.0))
    np.testing.assert_allclose(error.largest, (9.0, 18.0, 0.0))
    assert 2.0 < error.low[0] < 4.5 < error.high[0] < 7.0


@pytest.mark.slow
def test_a_cut_cable_frees_the_rotor(shared_data):
    """In open loop the rotor alone goes where its own torque and friction lead it, and the link does not matter."""
    log = closed_loop.read(shared_data(closed_loop.FILE))
    with jax.enable_x64(True):
        angle, speed, dac = log.angle[500], log.speed[500], log.dac[500:520]
        whole, cut = (jax.jit(closed_loop.loop("dac", cables=c))(angle, speed, dac)[0][-1, :3] for c in (1.0, 0.0))
    apart = np.abs(np.asarray(whole) - np.asarray(cut))
    assert (apart > 0).all() and (apart * horizons.TO_JOINT < 0.05).all()


@pytest.mark.slow
def test_two_seconds_of_the_recording_are_followed(shared_data):
    path = shared_data(closed_loop.FILE)
    whole = closed_loop.read(path)
    found = closed_loop.JointRecording(*(part[:2000] for part in whole))
    with jax.enable_x64(True):
        error = model.error(found.asked, found)
    assert (error.mean < (0.2, 0.2, 0.3)).all() and (error.low <= error.mean).all() and (error.mean <= error.high).all()
