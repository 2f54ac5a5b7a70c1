"""The figure of one run: every panel, marker and window is drawn, the same bytes each time."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

from ravenjax.report.run.plot import trace_plot
from ravenjax.robots.raven2.arms import JOINTS

TICKS = 3000


def series(arms=("gold",)):
    random = np.random.default_rng(5)
    time = np.arange(TICKS)
    fault = (time >= 1200) & (time < 1500)
    kick = np.where(
        time >= 1200,
        np.exp(-np.maximum(time - 1350, 0) / 200.0) * np.minimum((time - 1200) / 150.0, 1),
        0,
    )
    made = {
        "runlevel": np.where(time < 1700, 3, 0),
        "pedal": (time > 100) * 1,
        "fault_active": fault,
    }
    for k, arm in enumerate(arms):
        model = np.stack(
            [0.01 * np.sin(time / 300.0), 0.02 * np.cos(time / 400.0), 0 * time], axis=1
        )
        offset = (0.6e-3 + 6e-3 * kick * (k == 0))[:, None] * np.array([0.6, 0.8, 0.0])
        error = np.linalg.norm(offset, axis=1) * 1000
        made[f"{arm}/model_position"], made[f"{arm}/position"] = model, model + offset
        made[f"{arm}/tip"] = model + 2.0 * offset
        made[f"{arm}/haptic_force"] = (np.where(error > 3, 0.0045 * error, 0)[:, None]) * np.array(
            [0, 0, 1.0]
        )
        dac = 800 * np.sin(time[:, None] / np.arange(120, 190, 10)) + random.normal(
            0, 60, (TICKS, 7)
        )
        dac[fault, 0] = 14000 if k == 0 else dac[fault, 0]
        made[f"{arm}/current_cmd"] = dac.astype(int)
    return made


EVENTS = {"cue": 1275, "stopped: overdrive": 1700, "never": -1}


@pytest.fixture
def figures(monkeypatch):
    """The figures that are drawn."""
    drawn, save = [], Figure.savefig

    def saved(figure, *given, **named):
        drawn.append(figure)
        save(figure, *given, **named)

    monkeypatch.setattr(Figure, "savefig", saved)
    return drawn


def lines(axes):
    """Name of each line that has one -> its y values."""
    return {
        line.get_label(): line.get_ydata()
        for line in axes.lines
        if not line.get_label().startswith("_")
    }


@pytest.mark.parametrize(("suffix", "begins"), [(".png", b"\x89PNG"), (".pdf", b"%PDF")])
def test_values_events_and_windows_stand_where_they_belong(tmp_path, figures, suffix, begins):
    given = series()
    path = trace_plot(given, tmp_path / f"run{suffix}", events=EVENTS)
    assert path.read_bytes().startswith(begins)
    (figure,) = figures
    error, force, dac, state = figure.axes
    for label, name in (("gold, true", "tip"), ("gold, as reported", "position")):
        off = given[f"gold/{name}"] - given["gold/model_position"]
        np.testing.assert_allclose(lines(error)[label], 1e3 * np.sqrt((off**2).sum(axis=1)))
    np.testing.assert_allclose(force.lines[0].get_ydata(), given["gold/haptic_force"][:, 2])
    peaks = np.abs(given["gold/current_cmd"]).max(axis=0)
    assert set(lines(dac)) == {
        JOINTS[joint] for joint in np.argsort(peaks)[-3:]
    } and "shoulder" in lines(dac)
    np.testing.assert_array_equal(lines(dac)["shoulder"], given["gold/current_cmd"][:, 0])
    np.testing.assert_array_equal(lines(state)["runlevel"], given["runlevel"])
    for axes in figure.axes:
        upright = [
            line.get_xdata()[0]
            for line in axes.lines
            if len(line.get_xdata()) == 2 and line.get_xdata()[0] > 1
        ]
        assert upright == [1.275, 1.7], "events, s"
        (window,) = axes.patches
        assert window.get_x() == 1.2 and window.get_width() == pytest.approx(0.3), "the fault, s"
    assert next(line.get_ydata()[0] for line in error.lines if len(line.get_ydata()) == 2) == 3.0, (
        "the cue, mm"
    )
